// cotwin scan: a turret that turns a scanner about z, between walls whose distance from each point is known.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <thread>
#include <vector>

#include "models/cloud/cloud_file.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace scan_command_test {
namespace {

namespace fs = std::filesystem;
using cotwin::cloud::Cloud;
using cotwin::cloud::load_cloud;
using cotwin::testing::content;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using Eigen::Vector3d;
using nlohmann::json;
using ::testing::Each;
using ::testing::HasSubstr;

class ScanCommand : public ::testing::Test {
 protected:
  ScanCommand() {
    const std::string inertial =
        "<inertial><mass value=\"1\"/><inertia ixx=\"1\" iyy=\"1\" izz=\"1\" ixy=\"0\" ixz=\"0\" iyz=\"0\"/></inertial>";
    folder_.write("turret.urdf",
                  "<robot name=\"turret\"><link name=\"base\">" + inertial + "</link><link name=\"arm\">" + inertial +
                      "<collision><origin xyz=\"0.1 0 0\"/><geometry><box size=\"0.3 0.04 0.04\"/></geometry></collision>"
                      "</link><joint name=\"turn\" type=\"continuous\"><parent link=\"base\"/><child link=\"arm\"/><axis "
                      "xyz=\"0 0 1\"/></joint></robot>");
    write_cell("");
  }
  static std::string body(const std::string& name, const std::string& pose, const std::string& geometry) {
    return "<model name=\"" + name + "\"><static>true</static><pose>" + pose + "</pose><link name=\"" + name +
           "\"><collision name=\"c\"><geometry>" + geometry + "</geometry></collision></link></model>";
  }
  /// A wall in front, from x = 1.95 on; one behind that the first beams do not see; and what else.
  void write_cell(const std::string& more) {
    folder_.write("cell.sdf", "<sdf version=\"1.11\"><world name=\"w\">" +
                                  body("front", "2 0 0 0 0 0", "<box><size>0.1 6 9</size></box>") +
                                  body("behind", "-3 0 0 0 0 0", "<box><size>0.1 1 1</size></box>") + more + "</world></sdf>");
  }
  /// `links`: attributes and content of the connection to the scanner; `more`: components, `events`: of the annotation.
  std::string scenario(const std::string& parameters = "", const std::string& link = "/>", const std::string& more = "",
                       const std::string& events = "") {
    folder_.write("cell.ssd",
                  R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="turret" xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="turret"><ssd:Elements>
    <ssd:Component name="motion" source="unit:motion?points=2" type="application/x-cotwin-unit"><ssd:ParameterBindings><ssd:ParameterBinding>
      <ssd:ParameterValues><ssv:ParameterSet version="1.0" name="m"><ssv:Parameters>
        <ssv:Parameter name="waypoint_q"><ssv:String value="-0.5 0.5"/></ssv:Parameter>
        <ssv:Parameter name="loop"><ssv:String value="there_and_back"/></ssv:Parameter>
      </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>
    <ssd:Component name="scanner" source="unit:scanner?scene=cell.sdf&amp;frame=arm&amp;beams=51" type="application/x-cotwin-unit">
      <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="s"><ssv:Parameters>
        <ssv:Parameter name="mount_p"><ssv:String value="0.3 0 0"/></ssv:Parameter>
        <ssv:Parameter name="mount_quat"><ssv:String value="0.7071067811865476 0 0.7071067811865476 0"/></ssv:Parameter>)" +
                      parameters + R"(
      </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings></ssd:Component>)" +
                      more + R"(
  </ssd:Elements><ssd:Connections>
    <ssd:Connection startElement="motion" startConnector="q_d" endElement="scanner" endConnector="q")" +
                      link + R"(
  </ssd:Connections></ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1"/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="1 ms">
    <cotwin:Setting name="robot" value="turret.urdf"/>
    <cotwin:Component name="scanner" stage="1"/>)" +
                      events + R"(
  </cotwin:Master></ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>
)");
    return "cell.ssd";
  }
  RunResult run(std::vector<std::string> arguments) const {
    return run_program(std::move(arguments), {.folder = folder_.path()});
  }
  RunResult scan(std::vector<std::string> arguments) const {
    arguments.insert(arguments.begin(), {"scan", "cell.ssd", "--out", "out"});
    return run(std::move(arguments));
  }
  json summary() const { return json::parse(content(folder_ / "out/summary.json")); }
  std::vector<Vector3d> points() const {
    const Cloud cloud = load_cloud(folder_ / "out/cloud.pcd").cloud;
    std::vector<Vector3d> all;
    for (std::size_t k = 0; k < cloud.points.size(); ++k) all.push_back(cloud.point(k));
    return all;
  }
  static double seen(const json& summary, const std::string& name) {
    for (const json& body : summary.at("bodies"))
      if (body.at("name") == name) return body.at("seen").get<double>();
    return -1;
  }

  TemporaryFolder folder_{"scan"};
};

TEST_F(ScanCommand, PutsAWallWhereItIs) {
  scenario();
  const RunResult done = scan({"--step", "0.1", "--count", "11"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.out, HasSubstr("profiles   11 of 11 postures\n"));
  EXPECT_THAT(done.out, HasSubstr("never seen behind\n"));
  const json figures = summary();
  EXPECT_EQ(figures.at("points"), 11 * 51);
  EXPECT_EQ(figures.at("points_of_robots"), 0);
  EXPECT_LT(figures.at("distance_from_scene_m").at("largest"), 1e-7 * 4);
  EXPECT_EQ(figures.at("never_seen"), json::array({"behind"}));
  EXPECT_GT(seen(figures, "front"), 0.05);
  EXPECT_LT(seen(figures, "front"), 0.5);
  // Each where its beam meets the wall, posture by posture.
  const std::vector<Vector3d> all = points();
  for (int k = 0; k < 11; ++k) {
    const double q = -0.5 + 0.1 * k, way = (1.95 - 0.3 * std::cos(q)) / std::cos(q);
    for (int i = 0; i < 51; ++i) {
      const double angle = (i - 25) * (2 * std::numbers::pi / 3) / 50;
      const Vector3d p(1.95, (0.3 + way) * std::sin(q), -way * std::tan(angle));
      EXPECT_TRUE(std::ranges::any_of(all, [&](const Vector3d& other) { return (other - p).norm() < 1e-6; })) << k << ' ' << i;
    }
  }
  // The scenario that scanned, from anywhere; again, to the same bytes.
  const std::string first = content(folder_ / "out/cloud.pcd");
  ASSERT_EQ(scan({"--step", "0.1", "--count", "11"}).code, 0);
  EXPECT_EQ(content(folder_ / "out/cloud.pcd"), first);
  const RunResult again = run_program({"run", (folder_ / "out/scan.ssd").string(), "--out", (folder_ / "again").string()});
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_THAT(again.out, HasSubstr("scanner: took 11 profiles; 100 % of the beams came back"));
}

TEST_F(ScanCommand, HasTheNoiseOfTheSensor) {
  scenario(R"(<ssv:Parameter name="sigma"><ssv:Real value="0.002"/></ssv:Parameter>)");
  ASSERT_EQ(scan({"--step", "0.02", "--count", "51", "--set", "scanner.opening=0.4"}).code, 0);
  const double rms = summary().at("distance_from_scene_m").at("rms");
  EXPECT_LT(rms, 1.1 * 0.002);
  EXPECT_GT(rms, 0.7 * 0.002);  // aslant
}

// The links are not where the controller has them, or the scanner is not where it should be.
TEST_F(ScanCommand, ShowsErrorsOfJointsAndMountingAsDistances) {
  constexpr double kTurn = 0.01;
  scenario();
  ASSERT_EQ(scan({"--step", "0.1", "--count", "11"}).code, 0);
  const std::vector<Vector3d> exact = points();
  double by_joint = 0;
  for (const Vector3d& p : exact) by_joint += std::pow(p.y() * kTurn, 2);
  by_joint = std::sqrt(by_joint / static_cast<double>(exact.size()));
  scenario("", R"(><ssc:LinearTransformation factor="1" offset="0.01"/></ssd:Connection>)");
  const std::vector<std::string> same = {"--step", "0.1", "--count", "11", "--at", "-0.51"};
  std::vector<std::string> as_planned = same;
  as_planned.insert(as_planned.end(), {"--posture", "motion.q_d"});
  ASSERT_EQ(scan(same).code, 0);
  EXPECT_LT(summary().at("distance_from_scene_m").at("largest"), 1e-6);
  ASSERT_EQ(scan(as_planned).code, 0);
  EXPECT_NEAR(summary().at("distance_from_scene_m").at("rms"), by_joint, 0.02 * by_joint);

  scenario();
  // 1° about the scanner's x, which is -z of the arm: as a turn of the joint, but about the scanner.
  ASSERT_EQ(scan({"--step", "0.1", "--count", "11", "--mounting", "0.3 0 0 0 1.5707963267948966 0.017453292519943295"}).code,
            0);
  const double turn = std::numbers::pi / 180;
  double by_mounting = 0;
  for (const Vector3d& p : exact) {
    const double q = std::atan2(p.y(), p.x());
    by_mounting += std::pow((p.y() - 0.3 * std::sin(q)) * turn, 2);
  }
  by_mounting = std::sqrt(by_mounting / static_cast<double>(exact.size()));
  EXPECT_NEAR(summary().at("distance_from_scene_m").at("rms"), by_mounting, 0.03 * by_mounting);
}

TEST_F(ScanCommand, LeavesOutPosturesThatAreNotClear) {
  write_cell(body("post", "0 0.2 0 0 0 0", "<cylinder><radius>0.02</radius><length>1</length></cylinder>"));
  scenario();
  folder_.write("turns.csv", "t,q1\n0,-0.5\n1,1.5\n2,2.5\n3,0.5\n");
  const RunResult done = scan({"--postures", "turns.csv"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.err, HasSubstr("posture 2 is left out: on the way there arm meets post"));
  EXPECT_THAT(done.err, HasSubstr("posture 3 is left out: on the way there arm meets post"));
  EXPECT_EQ(summary().at("postures"), 2);
  EXPECT_EQ(summary().at("left_out").size(), 2u);
  EXPECT_EQ(summary().at("profiles"), 2);
  // Also clear of a cloud, in one posture alone, and in none.
  ASSERT_EQ(run({"cloud", "--from", "cell.sdf", "--spacing", "0.05", "-o", "all.pcd"}).code, 0);
  const RunResult one = scan({"--at", "0", "--count", "1", "--clear-of", "all.pcd"});
  EXPECT_EQ(one.code, 0) << one.err;
  EXPECT_EQ(summary().at("profiles"), 1);
  folder_.write("pole.sdf", "<sdf version=\"1.11\"><world name=\"w\">" +
                                body("pole", "0.2 0 0 0 0 0", "<sphere><radius>0.05</radius></sphere>") + "</world></sdf>");
  fs::remove_all(folder_ / "out");
  EXPECT_THAT(scan({"--at", "0", "--count", "1", "--clear-of", "pole.sdf"}).err, HasSubstr("on the way there arm meets pole"));
  const RunResult none = scan({"--at", "1.5", "--count", "1"});
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, HasSubstr("no posture is clear: posture 1 is left out: on the way there arm meets post"));
  EXPECT_FALSE(fs::exists(folder_ / "out"));
  // A monitor's cloud, where the monitor has it.
  folder_.write("pole.xyz", "9 9 9\n");
  scenario("", "/>",
           R"(<ssd:Component name="monitor" source="unit:monitor?robot=turret.urdf&amp;cloud=pole.xyz" )"
           R"(type="application/x-cotwin-unit"><ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>)"
           R"(<ssv:ParameterSet version="1.0" name="p"><ssv:Parameters><ssv:Parameter name="cloud.p0">)"
           R"(<ssv:String value="-8.8 -9 -9"/></ssv:Parameter><ssv:Parameter name="cloud.r"><ssv:Real value="0.05"/>)"
           R"(</ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>)"
           R"(</ssd:ParameterBindings></ssd:Component>)");
  EXPECT_THAT(scan({"--at", "0", "--count", "1"}).err, HasSubstr("on the way there arm meets cloud"));
  ASSERT_EQ(scan({"--at", "-0.7", "--count", "1"}).code, 0);
  const json cloud = {{"name", "cloud"},
                      {"p_m", {-8.8, -9.0, -9.0}},
                      {"quaternion_wxyz", {1.0, 0.0, 0.0, 0.0}},
                      {"radius_m", 0.05},
                      {"by", "monitor"}};
  EXPECT_EQ(summary().at("places").back(), cloud) << summary().at("places");
}

TEST_F(ScanCommand, LeavesOutPosturesBeyondTheLimitsOfTheJoints) {
  std::string urdf = content(folder_ / "turret.urdf");
  urdf.replace(urdf.find("continuous"), 10, "revolute");
  urdf.insert(urdf.find("</joint>"), "<limit lower=\"-1\" upper=\"0.25\" effort=\"1\" velocity=\"5\"/>");
  folder_.write("turret.urdf", urdf);
  scenario();
  const RunResult done = scan({"--at", "0", "--step", "0.2", "--count", "3", "--set", "motion.waypoint_q=-0.5 0.2"});
  ASSERT_EQ(done.code, 0) << done.err;
  EXPECT_THAT(done.err, HasSubstr("posture 3 is left out: on the way there turn is at 0.4, beyond its limits -1 to 0.25"));
  EXPECT_EQ(summary().at("profiles"), 2);
}

TEST_F(ScanCommand, DropsThePointsOfTheRobotAndTellsOfEmptyProfiles) {
  scenario(R"(<ssv:Parameter name="opening"><ssv:Real value="6"/></ssv:Parameter>)");
  const RunResult done = scan({"--at", "0", "--step", "1.5707963267948966", "--count", "2", "--set", "scanner.beams=7"});
  ASSERT_EQ(done.code, 0) << done.err;
  // Behind the scanner is its own arm; beside it, at 90°, is nothing else.
  EXPECT_EQ(summary().at("points_of_robots"), 4);
  EXPECT_EQ(summary().at("points"), 3);
  EXPECT_EQ(summary().at("profiles_without_points"), 0);
  const RunResult empty = scan({"--at", "0", "--step", "1.5707963267948966", "--count", "2", "--set", "scanner.opening=1"});
  ASSERT_EQ(empty.code, 0) << empty.err;
  EXPECT_THAT(empty.out, HasSubstr("profiles   2 of 2 postures, 1 of them without a point"));
  fs::remove_all(folder_ / "out");
  EXPECT_THAT(scan({"--at", "1.5707963267948966", "--count", "1", "--set", "scanner.opening=1"}).err,
              HasSubstr("scanner: met nothing, so there is no cloud"));
}

TEST_F(ScanCommand, SeesAWallOfOneTriangle) {
  folder_.write("wall.obj", "v 1 -5 -5\nv 1 5 -5\nv 1 0 5\nf 1 2 3\n");
  write_cell(body("sheet", "0 0 0 0 0 0", "<mesh><uri>wall.obj</uri></mesh>"));
  scenario();
  ASSERT_EQ(scan({"--at", "0", "--step", "0.05", "--count", "5", "--set", "scanner.opening=0.5"}).code, 0);
  for (const Vector3d& p : points()) EXPECT_NEAR(p.x(), 1, 1e-6);
  EXPECT_LT(summary().at("distance_from_scene_m").at("largest"), 1e-6);
}

TEST_F(ScanCommand, RefusesWhatItCannotScan) {
  const auto refused = [&](const std::vector<std::string>& arguments) {
    const RunResult result = scan(arguments);
    EXPECT_EQ(result.code, 2) << result.out;
    EXPECT_FALSE(fs::exists(folder_ / "out"));
    return result.err;
  };
  scenario();
  EXPECT_THAT(refused({"--at", "0,1"}), HasSubstr("--at: 2 positions, expected 1, of the joints of turret"));
  EXPECT_THAT(refused({"--posture", "motion.done"}), HasSubstr("motion.done"));
  EXPECT_THAT(refused({"--posture", "nobody.q"}), HasSubstr("nobody"));
  EXPECT_THAT(refused({"--mounting", "1 2"}), HasSubstr("--mounting: '1 2', expected x y z"));
  EXPECT_THAT(refused({"--scanner", "motion"}), HasSubstr("--scanner: 'motion' is none, expected one of scanner"));
  EXPECT_THAT(refused({"--clear-of", "nowhere"}), HasSubstr("scene 'nowhere'"));
  EXPECT_THAT(refused({"--settle", "-1"}), HasSubstr("--settle: -1, expected 0 to 3600 s"));
  EXPECT_THAT(refused({"--settle", "1e300"}), HasSubstr("--settle: 1e+300, expected"));
  EXPECT_THAT(refused({"--at", "nan"}), HasSubstr("--at: nan, expected finite positions"));
  EXPECT_THAT(refused({"--set", "scanner.frame=front"}), HasSubstr("scanner: is fixed to the scene, frame=front"));
  const std::string second =
      R"(<ssd:Component name="other" source="unit:scanner?frame=arm" type="application/x-cotwin-unit"/>)";
  scenario("", "/>", second);
  EXPECT_THAT(refused({}), HasSubstr("--scanner: is not given, expected one of scanner, other"));
  EXPECT_THAT(refused({"--scanner", "other"}), HasSubstr("no unit:motion reaches other.q by connections"));
  scenario(
      "",
      "/><ssd:Connection startElement=\"motion\" startConnector=\"done\" endElement=\"scanner\" endConnector=\"trigger\"/>");
  EXPECT_THAT(refused({}), HasSubstr("scanner.trigger: is connected"));
  EXPECT_THAT(
      run_program({"scan", cotwin::places::source() + "/examples/02_free_motion_lwr4/twin.ssd"}, {.folder = folder_.path()})
          .err,
      HasSubstr("has no unit:scanner, expected one"));
}

TEST_F(ScanCommand, WritesWhatWasScannedBeforeASignal) {
  scenario("", "/>", "", "<cotwin:Clock kind=\"wall\"/>");
  cotwin::testing::Process scan = cotwin::testing::start_program(
      {"scan", "cell.ssd", "--out", "out", "--settle", "0", "--count", "1000", "--step", "0.0005"}, {.folder = folder_.path()});
  for (int k = 0; k < 6000 && !fs::exists(folder_ / "out/scan.ssd"); ++k)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  scan.signal(SIGINT);
  const RunResult result = scan.wait();
  EXPECT_EQ(result.code, 128 + SIGINT) << result.err;
  EXPECT_THAT(result.err, HasSubstr("cotwin: stopped by SIGINT at "));
  if (result.err.find("after 0 of") != std::string::npos) return;  // on a busy machine
  EXPECT_GE(summary().at("profiles"), 1);
  EXPECT_LT(summary().at("profiles"), 1000);
  EXPECT_EQ(points().size(), summary().at("points"));
}

}  // namespace
}  // namespace scan_command_test
