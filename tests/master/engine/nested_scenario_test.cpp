// A scenario as a component of another one: its annotation is kept.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <sstream>

#include "master/run/master.h"
#include "master/workflows/check.h"
#include "models/foundation/support/error.h"
#include "tests/support/places.h"

namespace cotwin::master::nested_scenario_test {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const char* const kSpaces =
    " xmlns:ssd='http://ssp-standard.org/SSP1/SystemStructureDescription' "
    "xmlns:ssc='http://ssp-standard.org/SSP1/SystemStructureCommon'"
    " xmlns:ssv='http://ssp-standard.org/SSP1/SystemStructureParameterValues' xmlns:cotwin='urn:cotwin:master:1'";

std::string ssd(const std::string& name, const std::string& system, const std::string& annotation) {
  return "<ssd:SystemStructureDescription version='1.0' name='" + name + "'" + kSpaces + "><ssd:System name='" + name + "'>" +
         system + "</ssd:System><ssd:DefaultExperiment startTime='0' stopTime='0.05'/>" +
         (annotation.empty()
              ? ""
              : "<ssd:Annotations><ssc:Annotation type='cotwin.master'>" + annotation + "</ssc:Annotation></ssd:Annotations>") +
         "</ssd:SystemStructureDescription>";
}

std::string values(const std::string& parameters) {
  return "<ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version='1.0' "
         "name='p'><ssv:Parameters>" +
         parameters +
         "</ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>";
}

const std::string kArm =
    "<ssd:Elements><ssd:Component name='motion' source='unit:motion'>" +
    values("<ssv:Parameter name='waypoint_q'><ssv:String value='0.5 -0.8 0.6 -0.9'/></ssv:Parameter>") +
    "</ssd:Component><ssd:Component name='controller' source='unit:compliance'/>"
    "<ssd:Component name='drive' source='unit:drive_train'>" +
    values("<ssv:Parameter name='q0'><ssv:String value='0.5 -0.8'/></ssv:Parameter>") +
    "</ssd:Component></ssd:Elements><ssd:Connections>"
    "<ssd:Connection startElement='motion' startConnector='q_d' endElement='controller' endConnector='q_d'/>"
    "<ssd:Connection startElement='motion' startConnector='dq_d' endElement='controller' endConnector='dq_d'/>"
    "<ssd:Connection startElement='motion' startConnector='ddq_d' endElement='controller' endConnector='ddq_d'/>"
    "<ssd:Connection startElement='drive' startConnector='q' endElement='controller' endConnector='q'/>"
    "<ssd:Connection startElement='drive' startConnector='dq' endElement='controller' endConnector='dq'/>"
    "<ssd:Connection startElement='drive' startConnector='theta' endElement='controller' endConnector='theta'/>"
    "<ssd:Connection startElement='drive' startConnector='dtheta' endElement='controller' endConnector='dtheta'/>"
    "<ssd:Connection startElement='controller' startConnector='tau_m' endElement='drive' endConnector='tau_m'/>"
    "</ssd:Connections>";
const std::string kArmMaster =
    "<cotwin:Setting name='robot' value='planar2'/>"
    "<cotwin:Component name='controller' stage='1'/><cotwin:Component name='drive' stage='2'/>"
    "<cotwin:Event time='0.01' variable='drive.tau_e' value='20 9'/>"
    "<cotwin:Event time='0.01' variable='controller.tau_e' value='20 9' ramp='5 ms'/>"
    "<cotwin:Event time='0.01' variable='controller.S_a' value='100'/>"
    "<cotwin:Recording><cotwin:Record variables='drive.q drive.z controller.S_a'/></cotwin:Recording>"
    "<cotwin:Comparison name='tracking' a='drive.q' b='motion.q_d'/>"
    "<cotwin:Report kind='energy' a='drive.tau_J' b='drive.dq'/>";

std::string nested(const std::string& name, const std::string& file) {
  return "<ssd:Component name='" + name + "' source='" + file + "' type='application/x-ssp-definition'/>";
}

class Nested : public ::testing::Test {
 protected:
  Nested() { fs::create_directories(folder_); }
  ~Nested() override { fs::remove_all(folder_); }
  fs::path write(const std::string& name, const std::string& text) const {
    fs::create_directories((folder_ / name).parent_path());
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }
  static MasterOptions options(const fs::path& file) {
    MasterOptions o;
    o.types = unit_types();
    o.folders = {file.parent_path(), fs::path(places::source()) / "models"};
    return o;
  }
  /// The recording of a run.
  std::string recorded(const Scenario& scenario) const {
    MasterOptions o = options(scenario.file);
    o.results = folder_ / "results";
    Master master(scenario, std::move(o));
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
    std::ifstream in(folder_ / "results/signals.csv");
    std::stringstream text;
    text << in.rdbuf();
    return text.str();
  }
  static std::string error_of(const fs::path& file) {
    try {
      Master(load_scenario(file), options(file));
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_nested_" + std::to_string(::getpid()) + "_" +
                                                        ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

std::string without(std::string text, const std::string& part) {
  for (std::size_t at; (at = text.find(part)) != std::string::npos;) text.erase(at, part.size());
  return text;
}

TEST_F(Nested, AScenarioRunsToTheSameBitsAsByItself) {
  const fs::path arm = write("arms/arm.ssd", ssd("arm", kArm, "<cotwin:Master>" + kArmMaster + "</cotwin:Master>"));
  const fs::path cell = write("cell.ssd", ssd("cell", "<ssd:Elements>" + nested("left", "arms/arm.ssd") + "</ssd:Elements>",
                                              "<cotwin:Master><cotwin:Recording><cotwin:Record variables='left.motion.q_d'/>"
                                              "</cotwin:Recording></cotwin:Master>"));
  Scenario alone = load_scenario(arm), inside = load_scenario(cell);
  EXPECT_THAT(inside.warnings, IsEmpty());
  EXPECT_EQ(inside.events.size(), 3u);
  inside.recording.erase(inside.recording.begin());  // of the outer scenario itself
  const std::string expected = recorded(alone);
  EXPECT_THAT(expected, StartsWith("time,controller.S_a"));
  EXPECT_EQ(without(recorded(inside), "left."), expected);
}

TEST_F(Nested, EachScenarioHasItsOwnRobot) {
  write("arm.ssd", ssd("arm", kArm, "<cotwin:Master>" + kArmMaster + "</cotwin:Master>"));
  write("big.ssd", ssd("big", "<ssd:Elements><ssd:Component name='drive' source='unit:drive_train'/></ssd:Elements>", ""));
  const fs::path cell = write(
      "cell.ssd", ssd("cell", "<ssd:Elements>" + nested("left", "arm.ssd") + nested("right", "big.ssd") + "</ssd:Elements>",
                      "<cotwin:Master><cotwin:Setting name='robot' value='lwr4'/></cotwin:Master>"));
  Scenario scenario = load_scenario(cell);
  {
    Master master(scenario, options(cell));
    EXPECT_EQ(find_signal(master.members(), "left.drive.q", "").count, 2u);
    EXPECT_EQ(find_signal(master.members(), "right.drive.q", "").count, 7u);
    EXPECT_EQ(master.members()[1].spec.stage, 1);
  }
  assign(scenario, "robot=planar2");  // the user's value applies to all
  EXPECT_EQ(settings_for(scenario, "right.drive").at("robot"), "planar2");
  EXPECT_EQ(settings_for(scenario, "left.drive").at("robot"), "planar2");
}

TEST_F(Nested, ARobotFileIsLookedUpBesideTheNestedScenario) {
  fs::create_directories(folder_ / "arms");
  fs::copy_file(fs::path(places::source()) / "models/robots/planar2/robot.urdf", folder_ / "arms/mine.urdf");
  write("arms/arm.ssd", ssd("arm", kArm, "<cotwin:Master><cotwin:Setting name='robot' value='mine.urdf'/></cotwin:Master>"));
  const fs::path cell = write("cell.ssd", ssd("cell", "<ssd:Elements>" + nested("a", "arms/arm.ssd") + "</ssd:Elements>", ""));
  EXPECT_EQ(error_of(cell), "");
}

TEST_F(Nested, RecordsEveryOutputBesideWhatTheNestedScenarioChooses) {
  write("arm.ssd", ssd("arm", kArm, "<cotwin:Master>" + kArmMaster + "</cotwin:Master>"));
  const fs::path cell = write("cell.ssd", ssd("cell", "<ssd:Elements>" + nested("arm", "arm.ssd") + "</ssd:Elements>", ""));
  const std::string csv = recorded(load_scenario(cell));
  const std::string heading = csv.substr(0, csv.find('\n'));
  for (const char* name : {"arm.drive.tau_J[1]", "arm.motion.q_d[2]", "arm.drive.z[1]", "arm.controller.S_a[2]"})
    EXPECT_THAT(heading, HasSubstr(name));
}

TEST_F(Nested, TheOuterScenarioHasPriority) {
  write("arm.ssd",
        ssd("arm", kArm, "<cotwin:Master tick='2 ms' clock='free' tolerance='0.1'>" + kArmMaster + "</cotwin:Master>"));
  write("middle.ssd", ssd("middle", "<ssd:Elements>" + nested("arm", "arm.ssd") + "</ssd:Elements>",
                          "<cotwin:Master><cotwin:Setting name='method' value='cvode'/>"
                          "<cotwin:Event time='0.02' variable='arm.drive.tau_e' value='1'/></cotwin:Master>"));
  const fs::path cell =
      write("cell.ssd", ssd("cell", "<ssd:Elements>" + nested("m", "middle.ssd") + "</ssd:Elements>",
                            "<cotwin:Master><cotwin:Component name='m.arm.controller' period='2'/></cotwin:Master>"));
  const Scenario s = load_scenario(cell);
  EXPECT_EQ(s.components[1].stage, 1);   // of the nested scenario
  EXPECT_EQ(s.components[1].period, 2);  // of the outer one
  EXPECT_EQ(s.tick.ns, 1'000'000);
  EXPECT_THAT(s.warnings, ElementsAre(HasSubstr("tick, tolerance of the nested scenario 'm.arm' has no effect")));
  EXPECT_EQ(s.events.back().variable, "m.arm.drive.tau_e");
  EXPECT_EQ(s.comparisons.at(0).a, "m.arm.drive.q");
  EXPECT_EQ(s.comparisons.at(0).name, "m.arm: tracking");
  EXPECT_EQ(s.reports.at(0).b, "m.arm.drive.dq");
  EXPECT_EQ(settings_for(s, "m.arm.drive"), (std::map<std::string, std::string>{{"method", "cvode"}, {"robot", "planar2"}}));
}

TEST_F(Nested, ErrorsInItHaveTheirPlace) {
  write("arm.ssd", ssd("arm", kArm, "<cotwin:Master><cotwin:Setting name='robto' value='planar2'/></cotwin:Master>"));
  const std::string outer = ssd("cell", "<ssd:Elements>" + nested("a", "arm.ssd") + "</ssd:Elements>",
                                "<cotwin:Master><cotwin:Setting name='robot' value='planar2'/></cotwin:Master>");
  const fs::path cell = write("cell.ssd", outer);
  EXPECT_THAT(error_of(cell),
              HasSubstr("setting 'robto' = 'planar2': no unit of the nested scenario 'a' has it; did you mean 'robot'?"));
  EXPECT_THAT(error_of(cell), HasSubstr("arm.ssd:1: "));
  write("arm.ssd",
        ssd("arm", kArm, "<cotwin:Master><cotwin:Event time='1' variable='dirve.tau_e' value='1'/></cotwin:Master>"));
  EXPECT_THAT(error_of(cell), HasSubstr("did you mean 'drive.tau_e'?"));
  write("arm.ssd", ssd("arm", kArm, "<cotwin:Master><cotwin:Record variables='*'/></cotwin:Master>"));
  EXPECT_THAT(error_of(cell), HasSubstr("'Record'"));
}

TEST_F(Nested, OmissionsInItAreReported) {
  std::string arm = kArm;
  const std::string q_d =
      "<ssd:Connection startElement='motion' startConnector='q_d' endElement='controller' endConnector='q_d'/>";
  arm.erase(arm.find(q_d), q_d.size());
  write("arm.ssd", ssd("arm", arm, "<cotwin:Master>" + kArmMaster + "</cotwin:Master>"));
  const fs::path cell = write("cell.ssd", ssd("cell", "<ssd:Elements>" + nested("a", "arm.ssd") + "</ssd:Elements>", ""));
  std::vector<std::string> findings;
  for (const fmu::Finding& f : check_scenario(cell, unit_types(), options(cell).folders)) findings.push_back(f.text);
  EXPECT_THAT(findings, Contains(HasSubstr("a.controller.q_d (desired joint position")));
}

}  // namespace
}  // namespace cotwin::master::nested_scenario_test
