// cotwin check --clear-of, cotwin excite --clear-of: against a monitor that watches the motion, and known legs.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace clear_of_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using ::testing::HasSubstr;

std::string box(const std::string& pose) {
  return "<sdf version=\"1.11\"><world name=\"w\"><model name=\"box\"><static>true</static><pose>" + pose +
         " 0 0 0</pose><link name=\"box\"><collision name=\"c\"><geometry><box><size>0.2 0.2 0.2</size></box></geometry>"
         "</collision></link></model></world></sdf>";
}

// The left robot goes from joint_1 = -2 to -0.4, and stands 0.31 m above the ground by the monitor's place.
TEST(CheckClearOf, NamesTheLegTheLinkAndTheTime) {
  const cotwin::testing::TemporaryFolder folder("clear_of");
  const std::string cell = cotwin::places::source() + "/examples/25_shared_cell/cell.ssd";
  folder.write("far.sdf", box("0 3 0.5"));
  const RunResult clear = run_program({"check", cell, "--clear-of", folder / "far.sdf"});
  EXPECT_EQ(clear.code, 0) << clear.out << clear.err;
  EXPECT_THAT(clear.out, HasSubstr("note: left: clear; nearest: "));
  EXPECT_THAT(clear.out, HasSubstr("note: right: clear; nearest: "));
  folder.write("near.sdf", box("0.4 -0.4 0.6"));
  const RunResult near = run_program({"check", cell, "--clear-of", folder / "near.sdf"});
  EXPECT_EQ(near.code, 2);
  EXPECT_THAT(near.out,
              ::testing::ContainsRegex("error: left: link_[3-7] meets box at [01]\\.[0-9]+ s, between waypoints 1 and 2"));
  EXPECT_THAT(near.out, HasSubstr("note: right: clear"));
  EXPECT_THAT(run_program({"check", cell, "--clear-of", "nowhere"}).err, HasSubstr("scene 'nowhere': is neither a file nor"));
}

// The monitor sees the same motion, at every millisecond.
TEST(ExciteClearOf, FindsAMotionThatAMonitorSeesTouchNothing) {
  const cotwin::testing::TemporaryFolder folder("excite_clear");
  folder.write(
      "floor.sdf",
      "<sdf version=\"1.11\"><world name=\"w\"><model name=\"floor\"><static>true</static><pose>0 0 -0.02 0 0 0</pose><link "
      "name=\"floor\"><collision name=\"c\"><geometry><plane><normal>0 0 1</normal></plane></geometry></collision></link>"
      "</model></world></sdf>");
  const auto excite = [&](std::vector<std::string> more) {
    std::vector<std::string> command{"excite",      "--robot", "ur5e",  "--rounds",           "12",
                                     "--particles", "8",       "--out", folder / "motion.csv"};
    command.insert(command.end(), more.begin(), more.end());
    return run_program(command);
  };
  const auto watched = [&] {
    const RunResult run = run_program({"run", folder / "cell.ssd", "--out", folder / "results", "--quiet"});
    EXPECT_EQ(run.code, 0) << run.err;
    std::ifstream in(folder / "results/signals.csv");
    std::string line;
    double least = 1e12;
    for (std::getline(in, line); std::getline(in, line);) {
      std::istringstream row(line);
      std::string t, distance, self;
      std::getline(row, t, ',') && std::getline(row, distance, ',') && std::getline(row, self, ',');
      least = std::min({least, std::stod(distance), std::stod(self)});
    }
    fs::remove_all(folder / "results");
    return least;
  };
  folder.write("cell.ssd", R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="cell" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="cell">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=ur5e&amp;kind=csv" type="application/x-cotwin-unit">
        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="file"><ssv:Parameters>
          <ssv:Parameter name="file"><ssv:String value=")" +
                               (folder / "motion.csv").string() +
                               R"("/></ssv:Parameter>
        </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
      </ssd:Component>
      <ssd:Component name="monitor" source="unit:monitor?robot=ur5e&amp;scene=floor.sdf" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="motion" startConnector="q_d" endElement="monitor" endConnector="q"/>
    </ssd:Connections>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="10"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master">
    <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="2 ms">
      <cotwin:Component name="motion" stage="0"/>
      <cotwin:Component name="monitor" stage="1"/>
      <cotwin:Recording decimation="1"><cotwin:Record variables="monitor.distance monitor.self_distance"/></cotwin:Recording>
    </cotwin:Master>
  </ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>
)");
  ASSERT_EQ(excite({"--quiet"}).code, 0);
  EXPECT_LT(watched(), 0) << "without a scene this robot touches itself or the floor";
  const auto checked = [&] { return run_program({"check", folder / "cell.ssd", "--clear-of", folder / "floor.sdf"}); };
  EXPECT_THAT(checked().out, ::testing::ContainsRegex("error: motion: [a-z0-9_]+ meets [a-z0-9_]+ at [0-9.]+ s\n"));
  const RunResult found = excite({"--clear-of", folder / "floor.sdf"});
  ASSERT_EQ(found.code, 0) << found.err;
  EXPECT_THAT(found.err,
              ::testing::ContainsRegex("search 1: [a-z0-9_]+ meets [a-z0-9_]+ at [0-9.]+ s; again with smaller ranges"));
  EXPECT_THAT(found.out, HasSubstr("clear: "));
  EXPECT_THAT(found.out, ::testing::Not(HasSubstr("not checked for collisions")));
  EXPECT_GT(watched(), 0);
  EXPECT_THAT(checked().out, HasSubstr("note: motion: clear; nearest: "));

  fs::remove(folder / "motion.csv");
  const RunResult never = excite({"--floor", "0.3"});
  EXPECT_EQ(never.code, 2);
  EXPECT_THAT(never.err, HasSubstr("meets floor in every posture"));
  EXPECT_FALSE(fs::exists(folder / "motion.csv")) << "nothing is written";
}

}  // namespace
}  // namespace clear_of_test
