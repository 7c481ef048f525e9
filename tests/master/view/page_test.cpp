// The pages of `cotwin view` in Chromium: what they show is compared with forward kinematics and with the recording.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>

#include "master/results/results.h"
#include "master/scenery/recorded.h"
#include "models/cloud/cloud_file.h"
#include "models/robot/frame_kinematics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::master::page_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using nlohmann::json;
using ::testing::HasSubstr;
using ::testing::Not;

/// Four columns of four, as the page has its matrices.
json matrix_of(const Eigen::Matrix3d& R, const Eigen::Vector3d& p) {
  json list = json::array();
  for (int column = 0; column < 3; ++column) {
    for (int row = 0; row < 3; ++row) list.push_back(R(row, column));
    list.push_back(0);
  }
  for (const double x : {p.x(), p.y(), p.z(), 1.0}) list.push_back(x);
  return list;
}

json pose_of(const robot::RobotModel& robot, const robot::Frame& frame, const Eigen::VectorXd& q, const Pose& X_WB = {}) {
  const Eigen::VectorXd rest = Eigen::VectorXd::Zero(robot.n());
  const robot::FrameMotion motion = robot::FrameKinematics(robot, frame).at(q, rest, rest);
  const Pose X_WF = X_WB * Pose{motion.Q.toRotationMatrix(), motion.p};
  return matrix_of(X_WF.R, X_WF.p);
}

/// Forward kinematics of all bodies and of the tip.
json poses_of(const robot::RobotModel& robot, const Eigen::VectorXd& q, const Pose& X_WB = {}) {
  const auto pose = [&](const robot::Frame& frame) { return pose_of(robot, frame, q, X_WB); };
  json figure = {{"bodies", json::array()}, {"tip", pose(robot.end_effector())}};
  for (int body = 0; body < robot.body_count(); ++body) figure["bodies"].push_back(pose({"", body, {}}));
  return figure;
}

Eigen::VectorXd values_of(const Recorded& recorded, const std::string& name, std::size_t row) {
  const RecordedSignal* signal = recorded.find(name);
  if (signal == nullptr) throw std::runtime_error(name + " is not recorded");
  Eigen::VectorXd values(static_cast<Eigen::Index>(signal->count));
  for (std::size_t i = 0; i < signal->count; ++i) values[static_cast<Eigen::Index>(i)] = recorded.column(*signal, i)[row];
  return values;
}

json list_of(const Eigen::VectorXd& values) {
  json list = json::array();
  for (const double x : values) list.push_back(std::isnan(x) ? json(nullptr) : json(x));
  return list;
}

class Page : public ::testing::Test {
 protected:
  RunResult cotwin(std::vector<std::string> arguments) {
    return cotwin::testing::run_program(std::move(arguments), {.folder = folder_.path()});
  }
  /// Opens the pages in the browser and compares them with the plan.
  void check(const json& plan) {
    const fs::path file = folder_.write("plan.json", plan.dump());
    const fs::path script = fs::path(places::source()) / "master/view/page/test/check_pages.mjs";
    std::vector<std::string> command = {COTWIN_NODE, script.string(), COTWIN_CHROMIUM, file.string()};
    if (const char* shots = std::getenv("COTWIN_SCREENSHOTS")) command.emplace_back(shots);
    const RunResult result = cotwin::testing::run_command(command, {.merge = true, .limit = std::chrono::seconds(500)});
    EXPECT_EQ(result.code, 0) << result.out << result.err;
  }
  std::string page(const std::string& name) const { return (folder_ / name).string(); }

  const TemporaryFolder folder_{"page"};
  const fs::path root_ = places::source();
};

TEST_F(Page, ShowsTheMainExampleAsForwardKinematicsAndTheRecordingHaveIt) {
  const RunResult run =
      cotwin({"run", (root_ / "examples/02_free_motion_lwr4/twin.ssd").string(), "--stop", "4", "--out", "results", "--quiet",
              "--attach", "payload,parent=link_7,xyz=0 0 0.1,mass=2,com=0 0 0.05,inertia=4e-3 0 0 4e-3 0 4e-3@1", "--detach",
              "payload@2.5"});
  ASSERT_EQ(run.code, 0) << run.err;
  const RunResult view = cotwin({"view", "results", "--plot", "drive.tau_J", "--plot", "drive.q"});
  ASSERT_EQ(view.code, 0) << view.err;
  EXPECT_THAT(view.out, HasSubstr("page: results/view.html"));
  EXPECT_EQ(view.err, "");
  const Recorded recorded = load_recorded(folder_ / "results/signals.csv");
  const robot::RobotModel arm = robot::load_urdf(root_ / "models/robots/lwr4/robot.urdf");
  json seeks = json::array();
  for (const std::size_t row : {std::size_t{0}, std::size_t{123}, std::size_t{250}, recorded.time.size() - 1}) {
    const double t = static_cast<double>(recorded.time[row]) * 1e-9;
    const Eigen::VectorXd q = values_of(recorded, "drive.q", row);
    const robot::Frame payload{"payload", arm.end_effector().body, {Eigen::Matrix3d::Identity(), {0, 0, 0.1}}};
    seeks.push_back({{"t", t},
                     {"range", 100},
                     {"figures", json::array({poses_of(arm, q)})},
                     {"tools", {{"payload", t >= 1 && t < 2.5 ? pose_of(arm, payload, q) : json(nullptr)}}},
                     {"plots", {{"drive.tau_J", list_of(values_of(recorded, "drive.tau_J", row))}, {"drive.q", list_of(q)}}}});
  }
  const json common = {{"file", page("results/view.html")}, {"title", "free_motion_lwr4"}};
  json first = common, second = common;
  first.update({{"seeks", seeks}, {"keys", true}, {"themes", true}, {"zoom", "drive.q"}, {"first", 1}, {"hash", true}});
  second.update(
      {{"dark", true},
       {"size", json::array({700, 900})},
       {"themes", true},
       {"cues", json::array({"ghosts", "trails", "mass", "manipulability", "stiffness", "limits", "energy", "tau_e"})},
       {"lacking", json::array({"contacts", "hand", "distances"})}});
  check(json::array({first, second}));
}

TEST_F(Page, ShowsTwoRobotsAndABodyInContact) {
  const RunResult run = cotwin({"run", (root_ / "examples/10_cooperation/clamping.ssd").string(), "--stop", "1", "--out",
                                "results", "--quiet", "--record", "world.*.q_link", "--record", "world.block.*", "--record",
                                "world.contact_*", "--record", "world.*.tau_e"});
  ASSERT_EQ(run.code, 0) << run.err;
  ASSERT_EQ(cotwin({"view", "results"}).code, 0);
  const Recorded recorded = load_recorded(folder_ / "results/signals.csv");
  const robot::RobotModel arm = robot::load_urdf(root_ / "examples/10_cooperation/lwr4_punch.urdf");
  const Pose facing{Eigen::Vector3d(-1, -1, 1).asDiagonal(), {1.4, 0, 0}};  // half a turn about z
  json seeks = json::array();
  for (const std::size_t row : {std::size_t{0}, recorded.time.size() / 2, recorded.time.size() - 1}) {
    const Eigen::VectorXd p = values_of(recorded, "world.block.p", row), quat = values_of(recorded, "world.block.quat", row);
    const Eigen::Matrix3d R = Eigen::Quaterniond(quat[0], quat[1], quat[2], quat[3]).toRotationMatrix();
    seeks.push_back({{"t", static_cast<double>(recorded.time[row]) * 1e-9},
                     {"figures",
                      {poses_of(arm, values_of(recorded, "world.left.q_link", row)),
                       poses_of(arm, values_of(recorded, "world.right.q_link", row), facing)}},
                     {"bodies", {{"block", matrix_of(R, p)}}}});
  }
  const json shown = {{"file", page("results/view.html")},
                      {"seeks", seeks},
                      {"first", 2},
                      {"cues", json::array({"contacts", "tau_e", "trails", "mass", "energy"})},
                      {"lacking", json::array({"hand"})}};
  // A trolley that comes and grows stops one of two robots.
  const RunResult cell =
      cotwin({"run", (root_ / "examples/25_shared_cell/cell.ssd").string(), "--stop", "0.6", "--out", "cell", "--quiet",
              "--event", "t=0.2 monitor.trolley.present=1", "--event", "t=0.4 monitor.trolley.scale=2"});
  ASSERT_EQ(cell.code, 0) << cell.err;
  ASSERT_EQ(cotwin({"view", "cell"}).code, 0);
  const auto trolley = [](double t, double size, const char* right) -> json {
    return {{"t", t},
            {"bodies", {{"trolley", matrix_of(size * Eigen::Matrix3d::Identity(), {3.5, -1.05, 0.45})}}},
            {"lights", {{"left", "clear"}, {"right", right}}}};
  };
  const json watched = {{"file", page("cell/view.html")},
                        {"seeks", json::array({trolley(0.1, 1e-9, "clear"), trolley(0.3, 1, "slow"), trolley(0.5, 2, "stop")})},
                        {"cues", json::array({"distances", "trails", "contacts"})},
                        {"lacking", json::array({"hand"})}};
  check(json::array({shown, watched}));
}

// Its points are where they were measured, and marked near the link.
TEST_F(Page, ShowsAScannedCell) {
  const RunResult run = cotwin({"run", (root_ / "examples/29_scanned_cell/cell.ssd").string(), "--stop", "0.1", "--out",
                                "scanned", "--quiet", "--set", "monitor.cloud.p0=0 0.1 0.2"});
  ASSERT_EQ(run.code, 0) << run.err;
  ASSERT_EQ(cotwin({"view", "scanned"}).code, 0);
  const Recorded recorded = load_recorded(folder_ / "scanned/signals.csv");
  Eigen::Vector3d low = Eigen::Vector3d::Constant(1e9), high = -low;
  const cloud::Cloud points = cloud::load_cloud(root_ / "models/scenes/cell_cloud/scene.pcd").cloud;
  for (std::size_t k = 0; k < points.points.size(); ++k) {
    low = low.cwiseMin(points.point(k));
    high = high.cwiseMax(points.point(k));
  }
  json box = json::array();
  for (const Eigen::Vector3d& corner : {low, high})
    for (Eigen::Index i = 0; i < 3; ++i) box.push_back(corner[i] + Eigen::Vector3d(0, 0.1, 0.2)[i]);
  // Another one is scanned: the points of the last profile, none before the first.
  const RunResult scan = cotwin({"run", (root_ / "examples/30_scan_the_cell/profile.ssd").string(), "--stop", "0.7", "--out",
                                 "scan", "--quiet", "--set", "scanner.mount_quat=0.6 0 0 0.8"});
  ASSERT_EQ(scan.code, 0) << scan.err;
  ASSERT_EQ(cotwin({"view", "scan"}).code, 0);
  const Recorded profile = load_recorded(folder_ / "scan/signals.csv");
  const std::size_t end = profile.time.size() - 1;
  const Eigen::VectorXd ranges = values_of(profile, "scanner.ranges", end), quat = values_of(profile, "scanner.quat_scan", end);
  json points_of_profile = json::array();
  for (Eigen::Index i = 0; i < ranges.size(); ++i) {
    if (ranges[i] == 0) continue;
    const double angle = static_cast<double>(i - 60) * std::numbers::pi / 180;
    const Eigen::Vector3d in_S = ranges[i] * Eigen::Vector3d(std::sin(angle), 0, std::cos(angle));
    const Eigen::Vector3d p =
        values_of(profile, "scanner.p_scan", end) + Eigen::Quaterniond(quat[0], quat[1], quat[2], quat[3]) * in_S;
    for (const double x : p) points_of_profile.push_back(x);
  }
  ASSERT_GT(points_of_profile.size(), 100u);
  const json scanned = {{"file", page("scan/view.html")},
                        {"seeks", json::array({{{"t", 0.7}}})},
                        {"cues", json::array({"profiles"})},
                        {"profile", points_of_profile},
                        {"words", {std::to_string(points_of_profile.size() / 3) + " of 121 beams came back"}}};
  check(json::array(
      {scanned,
       {{"file", page("scanned/view.html")},
        {"seeks", json::array({{{"t", 0.1}}})},
        {"cues", json::array({"distances"})},
        {"cloud", {{"box", box}, {"near", list_of(values_of(recorded, "monitor.p_b", recorded.time.size() - 1))}}}}}));
}

// What moves is in view.bin; each number of a slide is in m and N.
TEST_F(Page, ShowsARunOfWhichOnlyTorquesWereRecorded) {
  const fs::path urdf = root_ / "tests/components/data/scara.urdf";
  ASSERT_EQ(cotwin({"new", "--robot", urdf.string(), "--out", "arm"}).code, 0);
  const RunResult run =
      cotwin({"run", "arm/twin.ssd", "--quiet", "--out", "results", "--record", "drive.tau_J", "--joint-names", "--event",
              "t=1 drive.tau_e=1,2,3,4", "--event", "t=1 compliance.tau_e=1,2,3,4"});
  ASSERT_EQ(run.code, 0) << run.err;
  ASSERT_EQ(cotwin({"view", "results", "--plot", "drive.tau_J", "--plot", "drive.q"}).code, 0);
  const robot::RobotModel arm = robot::load_urdf(urdf);
  const Recorded view = load_view_data(folder_ / "results/view.bin");
  const nlohmann::json record = nlohmann::json::parse(cotwin::testing::content(folder_ / "results/run.json"));
  const Recorded recorded = load_recorded(folder_ / "results/signals.csv", {}, {}, report::column_facts(record));
  json seeks = json::array();
  for (const std::size_t row : {std::size_t{0}, view.time.size() / 3, view.time.size() / 2, view.time.size() - 1}) {
    const std::int64_t t = view.time[row];
    const auto of = static_cast<std::size_t>(std::ranges::find(recorded.time, t) - recorded.time.begin());
    if (of == recorded.time.size()) continue;  // no row was recorded then
    const Eigen::VectorXd q = values_of(view, "drive.q", row), tau = values_of(recorded, "drive.tau_J", of);
    seeks.push_back({{"t", static_cast<double>(t) * 1e-9},
                     {"range", 10},
                     {"figures", json::array({poses_of(arm, q)})},
                     {"plots",
                      {{"drive.tau_J N.m", {tau[0], tau[1], tau[3]}},
                       {"drive.tau_J N", {tau[2]}},
                       {"drive.q rad", {q[0], q[1], q[3]}},
                       {"drive.q m", {q[2]}}}}});
  }
  ASSERT_GE(seeks.size(), 2u);
  const json shown = {
      {"file", page("results/view.html")},
      {"seeks", seeks},
      {"cues", json::array({"ghosts", "trails", "mass", "stiffness", "tau_e", "limits", "energy"})},
      {"lacking", json::array({"contacts"})},
      {"words", json::array({"first arm", "second_arm_of_the_selective_compliance_robot", "4.000 N·m", "3.000 N"})}};
  check(json::array({shown}));
}

/// A robot with 45 joints: a trunk with four arms.
std::string robot_of_many_joints() {
  std::string urdf = "<robot name='many'><link name='link_0'/>";
  for (int i = 1; i <= 45; ++i) {
    const std::string name = std::to_string(i), parent = std::to_string(i % 10 == 6 ? 5 : i - 1);
    urdf +=
        "<link name='link_" + name +
        "'><inertial><origin xyz='0.05 0 0'/><mass value='0.5'/><inertia ixx='1e-3' iyy='1e-3' izz='1e-3' ixy='0' ixz='0' "
        "iyz='0'/></inertial><collision><origin xyz='0.05 0 0'/><geometry><box size='0.1 0.03 0.03'/></geometry></collision>"
        "</link><joint name='joint_" +
        name + "' type='revolute'><parent link='link_" + parent + "'/><child link='link_" + name + "'/><origin xyz='" +
        (i > 1 ? "0.1 0 0" : "0 0 0.5") + "'/><axis xyz='" + (i % 2 == 0 ? "0 1 0" : "0 0 1") +
        "'/><limit lower='-2' upper='2' effort='200' velocity='2'/></joint>";
  }
  return urdf + "</robot>";
}

// On a screen and on a phone: robots are large and what comes near them is in view, labels are whole, legends short, the help begins at its top.
TEST_F(Page, IsTrueAtFirstSight) {
  json plan = json::array();
  const auto show = [&](const std::string& name, const json& expected, const std::vector<std::string>& plots = {}) {
    std::vector<std::string> view = {"view", name, "--no-open"};
    for (const std::string& plot : plots) view.insert(view.end(), {"--plot", plot});
    const RunResult made = cotwin(view);
    ASSERT_EQ(made.code, 0) << made.err;
    plan.push_back({{"file", page(name + "/view.html")}});
    plan.back().update(expected);
  };
  const auto run = [&](const std::string& scenario, const std::string& name, const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments = {"run", scenario, "--out", name, "--quiet"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const RunResult done = cotwin(arguments);
    ASSERT_EQ(done.code, 0) << done.err;
  };
  // The person who stops the left robot stands beside it at 7 s.
  run((root_ / "examples/25_shared_cell/cell.ssd").string(), "cell", {"--stop", "8"});
  show("cell", {{"first", 2}, {"near", {"person", 7}}});
  // A satellite that falls out of the view.
  run((root_ / "examples/24_satellite_servicing/servicing.ssd").string(), "falls",
      {"--stop", "3", "--set", "free_world.gravity=0 0 -9.81"});
  show("falls", {{"first", 1}});
  folder_.write("many.urdf", robot_of_many_joints());
  ASSERT_EQ(cotwin({"new", "--robot", "many.urdf", "--kind", "contact", "--out", "many"}).code, 0);
  run("many/twin.ssd", "joints", {"--stop", "2"});
  show("joints", {{"first", 1}, {"arrows", "m"}, {"legend", 8}});
  // The torques of a slide's robot are rounding errors beside its forces; a signal that is small by itself is not.
  ASSERT_EQ(
      cotwin({"new", "--robot", (root_ / "tests/components/data/scara.urdf").string(), "--kind", "contact", "--out", "arm"})
          .code,
      0);
  run("arm/twin.ssd", "slide", {"--stop", "1"});
  show("slide", {{"first", 1}, {"seeks", json::array({{{"t", 0.4}, {"texts", {{"drive.tau_J N.m", {"0", "0", "0"}}}}}})}},
       {"drive.tau_J"});
  const fs::path log = folder_.write(
      "log.csv",
      "t,q1,q2,small,far,huge,none\n1e5,nan,0.2,-5e-6,1234567.25,-1e30,nan\n100001,0.1,0.2,5e-6,1234567.5,1e30,inf\n");
  ASSERT_EQ(cotwin({"view", log.string(), "--robot", "planar2", "--no-open", "-o", page("log.html"), "--plot", "*"}).code, 0);
  plan.push_back(
      {{"file", page("log.html")},
       {"first", 1},
       {"plots", 6},
       {"seeks",
        {{{"t", 1e5},
          // Where the camera looked for the first joint, which has no number yet, it has not stayed.
          {"figures",
           json::array({poses_of(robot::load_urdf(root_ / "models/robots/planar2/robot.urdf"), Eigen::Vector2d(0, 0.2))})},
          {"texts", {{"small", {"-5.000e-6"}}, {"far", {"1.235e6"}}, {"huge", {"-1.000e30"}}, {"none", {"NaN"}}}}}}}});
  // Nothing but a plane.
  folder_.write("plane.sdf",
                "<sdf version='1.11'><world name='w'><model name='ground'><static>true</static><link name='l'><collision "
                "name='c'><geometry><plane><normal>0 0 1</normal></plane></geometry></collision></link></model></world></sdf>");
  folder_.write("plane.ssd", R"(<?xml version="1.0"?>
<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription" version="1.0" name="plane">
  <System name="plane"><Elements><Component name="world" type="application/x-cotwin-unit" source="unit:contact_world?scene=plane.sdf"/>
  </Elements></System><DefaultExperiment startTime="0" stopTime="0.01"/></SystemStructureDescription>)");
  run("plane.ssd", "plane");
  show("plane", {{"first", 0}, {"colours", 2}});
  check(plan);
}

TEST_F(Page, RunsNothingFromNamesAndShowsWhatIsLeftOfARecording) {
  const std::string name = "</script><script>hacked=1</script><img src=x onerror=hacked=1>";
  folder_.write("twin.csv", "t,q1,q2,<!--" + name +
                                "\n0,0.1,0.2,nan\n0.1,nan,0.3,1e300\n0.2,0.2,0.4,-inf\n0.3,0.3,oops,5\n0.4,0.4,0.5,6\n0.5,0.");
  const RunResult view = cotwin({"view", "twin.csv", "--robot", "planar2", "--out", "page.html", "--plot", "<!--" + name});
  ASSERT_EQ(view.code, 0) << view.err;
  const std::string html = cotwin::testing::content(folder_ / "page.html");
  EXPECT_THAT(html, Not(HasSubstr("<script>hacked")));
  EXPECT_THAT(html, Not(HasSubstr("<img")));
  const robot::RobotModel arm = robot::load_urdf(root_ / "models/robots/planar2/robot.urdf");
  folder_.write("empty.csv", "time,q[1],q[2],drive.tau[1]\n");
  ASSERT_EQ(cotwin({"view", "empty.csv", "--robot", "planar2", "--out", "empty.html"}).code, 0);
  // The first joint, which has no number at 0.1 s, does not move then; afterwards all is as recorded.
  json seeks = json::array();
  seeks.push_back({{"t", 0}, {"figures", json::array({poses_of(arm, Eigen::Vector2d(0.1, 0.2))})}});
  seeks.back()["plots"]["<!--" + name] = json::array({nullptr});
  seeks.push_back({{"t", 0.1}, {"figures", json::array({poses_of(arm, Eigen::Vector2d(0.1, 0.3))})}});
  seeks.push_back({{"t", 0.4}, {"figures", json::array({poses_of(arm, Eigen::Vector2d(0.4, 0.5))})}});
  seeks.back()["plots"]["<!--" + name] = json::array({6});
  json left = {{"file", page("page.html")}, {"title", "twin.csv"}, {"seeks", seeks}};
  left["remarks"] = {"cut short", "no number"};
  left["cues"] = {"trails", "limits"};
  json empty = {{"file", page("empty.html")}, {"title", "empty.csv"}};
  empty["remarks"] = json::array({"the recording has no rows"});
  check(json::array({left, empty}));
}

TEST_F(Page, TellsWhereScenarioRecordingAndRecordAreNoLongerThoseOfTheRun) {
  fs::copy(root_ / "models/robots/planar2/robot.urdf", folder_ / "arm.urdf");
  folder_.write("twin.ssd", R"(<?xml version="1.0"?>
<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription" version="1.0" name="arm">
  <System name="arm"><Elements><Component name="drive" type="application/x-cotwin-unit" source="unit:drive_train?robot=arm.urdf">
  </Component></Elements></System>
  <DefaultExperiment startTime="0" stopTime="0.1"/>
</SystemStructureDescription>)");
  ASSERT_EQ(cotwin({"run", "twin.ssd", "--out", "r", "--quiet"}).code, 0);
  EXPECT_EQ(cotwin({"view", "r", "--no-open"}).err, "");
  // Options of the run are no changes of its files.
  const RunResult optioned = cotwin({"run", "twin.ssd", "--out", "o", "--quiet", "--record", "drive.q", "--set",
                                     "drive.q0=0.1 0", "--event", "t=0.01 drive.tau_m=1 0", "--stop", "0.05"});
  ASSERT_EQ(optioned.code, 0) << optioned.err;
  EXPECT_EQ(cotwin({"view", "o", "--no-open"}).err, "");
  const std::string urdf = cotwin::testing::content(folder_ / "arm.urdf");
  folder_.write("arm.urdf", urdf + "\n");
  const RunResult changed = cotwin({"view", "r", "--no-open"});
  EXPECT_EQ(changed.code, 0);
  EXPECT_THAT(changed.err, HasSubstr("twin.ssd, or a file that it names (URDF, scene, CSV), is not as it was in the run"));
  EXPECT_THAT(cotwin::testing::content(folder_ / "r/view.html"), HasSubstr("is not as it was in the run"));
  fs::copy_file(root_ / "models/robots/lwr4/robot.urdf", folder_ / "arm.urdf", fs::copy_options::overwrite_existing);
  EXPECT_THAT(cotwin({"view", "r", "--no-open"}).err,
              HasSubstr("2 elements of drive.q are recorded, the robot has 7 joints now, so it stands still"));
  folder_.write("arm.urdf", urdf);
  folder_.write("r/signals.csv", "time,drive.q[1],drive.q[2]\n0,0,0\n0.3,0,0\n");
  const RunResult other = cotwin({"view", "r", "--no-open"});
  EXPECT_EQ(other.code, 0);
  EXPECT_THAT(other.err, HasSubstr("note: run.json does not fit signals.csv, which has "));
  EXPECT_THAT(other.err, HasSubstr("its end at 0.3 s, expected 0.1 s"));
}

TEST_F(Page, TakesPatternsAndElementsForItsPlots) {
  folder_.write("log.csv", "time_ms,a.q[1],a.q[2],a.x,b\n0,1,2,3,4\n1,1,2,3,4\n");
  const std::vector<std::string> view = {"view", "log.csv", "--no-open", "--t-column", "time_ms", "--time-unit", "ms"};
  const auto with = [&](std::vector<std::string> more) {
    more.insert(more.begin(), view.begin(), view.end());
    return cotwin(more);
  };
  ASSERT_EQ(with({"--plot", "a.q[2]"}).code, 0);
  EXPECT_THAT(cotwin::testing::content(folder_ / "view.html"), HasSubstr(R"("plots":["a.q"])"));
  ASSERT_EQ(with({"--plot", "a.*"}).code, 0);
  EXPECT_THAT(cotwin::testing::content(folder_ / "view.html"), HasSubstr(R"("plots":["a.q","a.x"])"));
  EXPECT_EQ(with({"--plot", "c.*"}).code, 2);
  EXPECT_EQ(cotwin({"view", "log.csv", "--no-open"}).code, 2);
  EXPECT_THAT(cotwin({"view", "log.csv", "--no-open", "--time-unit", "h"}).err, HasSubstr("--time-unit: 'h', expected"));
}

TEST_F(Page, ShowsMeshesAndLeavesOutWhatIsNone) {
  const auto facet = [](const std::string& a, const std::string& b, const std::string& c) {
    return "facet normal 0 0 0\nouter loop\nvertex " + a + "\nvertex " + b + "\nvertex " + c + "\nendloop\nendfacet\n";
  };
  folder_.write("arm/body.stl",
                "solid x\n" + facet("0 0 0", "0.1 0 0", "0 0.1 0.4") + facet("0 0 0", "0 0.1 0.4", "0.1 0 0") + "endsolid x\n");
  folder_.write("arm/body.obj", "v 0 0 0\nv 0.2 0 0\nv 0 0.2 0.3\nf 1 2 3\n");
  folder_.write("arm/body.dae",
                R"(<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="meter" meter="1"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>http://example.invalid/x.png</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON><technique sid="c"><phong><diffuse><color>0 0.6 0.2 1</color></diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh><source id="p"><float_array id="pa" count="9">0 0 0 0.3 0 0 0 0.3 0.2</float_array><technique_common>
<accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices><triangles count="1" material="s"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>)");
  folder_.write("arm/body.gltf", R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],
"meshes":[{"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"images":[{"uri":"http://example.invalid/y.png"}],"textures":[{"source":0}],
"materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.8,0.1,0.1,1],"baseColorTexture":{"index":0}}}],
"accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,0]}],"bufferViews":[{"buffer":0,"byteLength":36}],
"buffers":[{"byteLength":36,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})");
  folder_.write("arm/bad.stl", "this is no mesh");
  std::string visuals;
  int at = 0;  // beside each other
  for (const char* name : {"body.stl", "body.obj", "body.dae", "body.gltf", "bad.stl", "none.stl"})
    visuals += "<visual><origin xyz='0 " + std::to_string(0.4 * at++) + " 0'/><geometry><mesh filename='package://arm/" +
               std::string(name) + "' scale='" + (std::string(name) == "body.gltf" ? "0.3 0.3 0.3" : "1 1 1") +
               "'/></geometry></visual>";
  folder_.write(
      "arm/arm.urdf",
      "<robot name='arm'><link name='base'/><link name='a'><inertial><mass value='1'/><inertia ixx='1' iyy='1' izz='1' "
      "ixy='0' ixz='0' iyz='0'/></inertial>" +
          visuals +
          "</link><joint name='j' type='continuous'><parent link='base'/>"
          "<child link='a'/><axis xyz='0 0 1'/></joint></robot>");
  folder_.write("r.csv", "t,q\n0,0\n1,1\n");
  const RunResult view = cotwin({"view", "r.csv", "--robot", "arm/arm.urdf"});
  ASSERT_EQ(view.code, 0) << view.err;
  EXPECT_THAT(view.err, HasSubstr("none.stl' not found"));
  // Flat triangles: at least the background, the lines of the ground, and four meshes that are lit from different sides.
  const json shown = {
      {"file", page("view.html")}, {"colours", 6}, {"remarks", json::array({"none.stl", "bad.stl is left out"})}};
  check(json::array({shown}));

  // Two robots of one file, which differ, have its notes once.
  folder_.write("two.urdf",
                R"(<robot name="two"><link name="base"><visual><geometry><mesh filename="none.stl"/></geometry></visual></link>
<link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/></joint>
<joint name="k" type="continuous"><parent link="a"/><child link="b"/><axis xyz="0 1 0"/></joint></robot>)");
  folder_.write("two.ssd", R"(<?xml version="1.0"?>
<SystemStructureDescription xmlns="http://ssp-standard.org/SSP1/SystemStructureDescription" version="1.0" name="two">
  <System name="two"><Elements><Component name="whole" type="application/x-cotwin-unit" source="unit:drive_train?robot=two.urdf"/>
  <Component name="locked" type="application/x-cotwin-unit" source="unit:drive_train?robot=two.urdf&amp;lock=k:0"/></Elements></System>
  <DefaultExperiment startTime="0" stopTime="0.01"/></SystemStructureDescription>)");
  ASSERT_EQ(cotwin({"run", "two.ssd", "--out", "two", "--quiet"}).code, 0);
  const std::string notes = cotwin({"view", "two", "--no-open"}).err;
  EXPECT_THAT(notes, HasSubstr("none.stl"));
  EXPECT_EQ(notes.find("none.stl"), notes.rfind("none.stl")) << notes;
}

TEST_F(Page, ThatIsNotThereIsAnErrorThatNamesWhatTheBuildLacked) {
  // The program looks for the page beside itself.
  fs::create_directories(folder_ / "bin");
  fs::copy_file(places::program(), folder_ / "bin/cotwin");
  folder_.write("r.csv", "t,q\n0,0\n1,1\n");
  const RunResult view = cotwin::testing::run_command({page("bin/cotwin"), "view", page("r.csv")});
  EXPECT_EQ(view.code, 2);
  EXPECT_THAT(view.err, HasSubstr("share/cotwin/view/view.html"));
  EXPECT_THAT(view.err, HasSubstr("nodejs and npm"));
  EXPECT_FALSE(fs::exists(folder_ / "view.html"));
}

TEST_F(Page, OfResultsThatAreNoneIsAnErrorWithThePlace) {
  folder_.write("empty/run.json", "{}");
  folder_.write("empty.csv", "");
  folder_.write("r.csv", "t,q\n0,0\n1,1\n");
  for (const auto& [arguments, message] : std::vector<std::pair<std::vector<std::string>, std::string>>{
           {{"view", "nowhere"}, "nowhere: does not exist"},
           {{"view", "empty"}, "has no signals.csv"},
           {{"view", "empty.csv"}, "empty.csv"},
           {{"view", "r.csv", "--robot", "none_such"}, "none_such"},
           {{"view", "r.csv", "--plot", "qq"}, "did you mean 'q'"},
           {{"view", "r.csv", "--scenario", "none.ssd"}, "none.ssd"}}) {
    const RunResult view = cotwin(arguments);
    EXPECT_EQ(view.code, 2) << arguments[1];
    EXPECT_THAT(view.err, HasSubstr(message));
  }
}

}  // namespace
}  // namespace cotwin::master::page_test
