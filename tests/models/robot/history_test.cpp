#include "models/robot/changes/history.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/changes/tool.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::robot::history_test {
namespace {

using cotwin::testing::error_of;
using Eigen::Vector3d;
using Eigen::VectorXd;
using ::testing::AllOf;
using ::testing::HasSubstr;

RobotModel load_robot(const std::string& name) {
  UrdfOptions options;
  options.unphysical = Unphysical::kWarn;
  return load_urdf(places::source() + "/models/robots/" + name + "/robot.urdf", options);
}

constexpr const char* kGripper = R"(<robot name="gripper">
  <link name="flange"><inertial><origin xyz="0 0 0.03"/><mass value="0.5"/>
    <inertia ixx="1e-3" ixy="1e-5" ixz="0" iyy="1.2e-3" iyz="2e-5" izz="8e-4"/></inertial></link>
  <link name="finger"><inertial><origin xyz="0 0.01 0" rpy="0.2 0 0"/><mass value="0.1"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="2e-5" iyz="0" izz="1e-4"/></inertial></link>
  <link name="tcp"/>
  <joint name="f" type="fixed"><parent link="flange"/><child link="finger"/><origin xyz="0 0.02 0.08" rpy="0 0.3 0"/></joint>
  <joint name="t" type="fixed"><parent link="finger"/><child link="tcp"/><origin xyz="0 0 0.05" rpy="0.1 0 0.4"/></joint>
</robot>)";

Attachment gripper(const std::string& parent) {
  Attachment tool = parse_tool(kGripper, "gripper.urdf", "gripper");
  tool.parent = parent;
  tool.X_PA = {rotation_from_rpy(0.3, -0.7, 1.1), {0.01, -0.02, 0.1}};
  return tool;
}

Attachment camera() {
  Attachment part{
      "camera", "tcp", {rotation_from_rpy(-1, 0.2, 0.9), {0.03, 0, 0.004}}, {0.21, {0, 0.001, 0.01}, Eigen::Matrix3d::Zero()}};
  part.inertia.I_CC.diagonal() << 1e-4, 1.1e-4, 0.9e-4;
  return part;
}

/// A robot whose tools came and went in a run.
RobotModel changed(RobotModel robot) {
  attach(robot, gripper(robot.end_effector().name), "pick", 1.5);
  attach(robot, camera(), "", 1.5);
  Inertia tuned = robot.bodies.back().inertia;
  tuned.mass *= 1.01;
  set_inertia(robot, static_cast<int>(robot.bodies.size()) - 1, tuned, "tuned", 2.25);
  detach(robot, "camera", "broken", 3.0);
  detach(robot, "gripper", "", 1.0 / 3 + 3);
  return robot;
}

VectorXd accelerations(const RobotModel& robot, const VectorXd& q, const VectorXd& dq, const VectorXd& tau) {
  const Mechanism mechanism(robot);
  Data data(mechanism);
  VectorXd ddq(robot.n());
  forward_dynamics(mechanism, data, q, dq, tau, ddq);
  return ddq;
}

TEST(Tool, FromAUrdfIsOneRigidPartWithTheFramesOfItsLinks) {
  const Attachment tool = gripper("");
  // Steiner, with the finger's frame at (0, 0.02, 0.08) turned by 0.3 rad about y
  const Pose finger{rotation_from_rpy(0, 0.3, 0), {0, 0.02, 0.08}};
  EXPECT_DOUBLE_EQ(tool.inertia.mass, 0.6);
  EXPECT_TRUE(tool.inertia.p_LC.isApprox((0.5 * Vector3d(0, 0, 0.03) + 0.1 * (finger * Vector3d(0, 0.01, 0))) / 0.6, 1e-14));
  ASSERT_EQ(tool.further.size(), 2u);
  EXPECT_EQ(tool.further[0].name, "finger");
  EXPECT_EQ(tool.further[1].name, "tcp");
  EXPECT_TRUE(tool.further[1].X_AF.p.isApprox(finger * Vector3d(0, 0, 0.05), 1e-14));
}

TEST(Tool, WithAMovingJointOrANameOfTheRobotIsAnError) {
  std::string moving = kGripper;
  moving.replace(moving.find("type=\"fixed\""), 12, "type=\"continuous\"");
  EXPECT_THAT(error_of([&] { parse_tool(moving, "gripper.urdf", "gripper"); }),
              HasSubstr("'f' of a tool moves, expected only"));
  RobotModel robot = load_robot("lwr4");
  Attachment tool = gripper(robot.end_effector().name);
  tool.further[1].name = "finger";
  EXPECT_THAT(error_of([&] { attach(robot, tool); }), HasSubstr("its frame 'finger' has no name of its own"));
  tool.further[1].name = robot.frames.front().name;
  EXPECT_THAT(error_of([&] { attach(robot, tool); }), HasSubstr("has no name of its own"));
  EXPECT_TRUE(robot.history.empty());
}

TEST(Tool, ComesAndGoesWithItsFrames) {
  RobotModel robot = load_robot("lwr4");
  const RobotModel bare = robot;
  attach(robot, gripper(robot.end_effector().name));
  EXPECT_EQ(robot.frames.size(), bare.frames.size() + 3);
  attach(robot, camera());
  EXPECT_THAT(error_of([&] { detach(robot, "gripper"); }), HasSubstr("'camera' is mounted on 'gripper'; detach it first"));
  EXPECT_THAT(error_of([&] { detach(robot, "tcp"); }), HasSubstr("is a link of the robot or of a part"));
  detach(robot, "camera");
  detach(robot, "gripper");
  EXPECT_EQ(robot.frames, bare.frames);
  EXPECT_EQ(robot.bodies, bare.bodies);
  for (std::size_t k = 0; k <= 4; ++k) {
    const RobotModel earlier = before(robot, k);
    EXPECT_EQ(earlier.frames.size(), bare.frames.size() + std::size_t(k == 0 ? 0 : k == 1 ? 3 : k == 2 ? 4 : k == 3 ? 3 : 0));
  }
}

TEST(History, IsReadBackToTheLastBit) {
  for (const char* name : {"lwr4", "planar2", "kr300_r2500"}) {
    SCOPED_TRACE(name);
    const RobotHistory history{name, "robot.urdf", {"drive", "world.left"}, changed(load_robot(name))};
    const std::vector<RobotHistory> one{history};
    const std::vector<RobotHistory> back = parse_history(to_json(one), "history.json");
    ASSERT_EQ(back.size(), 1u);
    EXPECT_EQ(back[0], history);
    EXPECT_EQ(to_json(back), to_json(one));
  }
}

TEST(History, GivesEveryEarlierConfigurationAndItsTime) {
  const RobotModel bare = load_robot("lwr4"), robot = changed(bare);
  for (const auto& [time, count] : {std::pair{0.0, 0u}, {1.499, 0u}, {1.5, 2u}, {2.25, 3u}, {3.2, 4u}, {9.0, 5u}})
    EXPECT_EQ(changes_until(robot, time), count) << time;
  EXPECT_EQ(before(robot, 0), bare);
  EXPECT_EQ(before(robot, 2).end_effector().name, "camera");
}

// The dynamics of the exported URDF, which is read by another path, are those of the robot at that time.
TEST(History, ExportsARobotWithTheSameDynamics) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (const char* name : {"lwr4", "planar2", "kr300_r2500"}) {
    const RobotModel robot = changed(load_robot(name));
    for (std::size_t k = 0; k <= robot.history.size(); ++k) {
      const RobotModel then = before(robot, k);
      UrdfOptions options;
      options.unphysical = Unphysical::kWarn;
      const RobotModel loaded = parse_urdf(to_urdf(then), "exported.urdf", options);
      const auto vector = [&] { return VectorXd::NullaryExpr(then.n(), [&] { return uniform(random); }).eval(); };
      const VectorXd q = vector(), dq = vector(), tau = 10 * vector();
      const VectorXd a = accelerations(then, q, dq, tau), b = accelerations(loaded, q, dq, tau);
      EXPECT_LE((a - b).norm(), 1e-12 * (1 + a.norm())) << name << ", change " << k;
      EXPECT_EQ(loaded.frames.size(), then.frames.size());
    }
  }
}

// The tool as a part of the URDF from the start, in its own links.
TEST(History, AgreesWithAUrdfThatHasTheToolFromTheStart) {
  const std::string file = places::source() + "/models/robots/planar2/robot.urdf";
  RobotModel robot = load_urdf(file);
  Attachment tool = gripper(robot.end_effector().name);
  attach(robot, tool);
  std::string xml = to_urdf(load_urdf(file)), parts = kGripper;
  parts = parts.substr(parts.find("<link"), parts.rfind("</robot>") - parts.find("<link"));
  const std::string mount = "<joint name=\"mount\" type=\"fixed\"><parent link=\"" + tool.parent +
                            "\"/><child link=\"flange\"/><origin xyz=\"0.01 -0.02 0.1\" rpy=\"0.3 -0.7 1.1\"/></joint>";
  xml.insert(xml.rfind("</robot>"), parts + mount);
  const RobotModel whole = parse_urdf(xml, "whole.urdf");
  const VectorXd q = VectorXd::LinSpaced(2, 0.3, -0.8), dq = VectorXd::LinSpaced(2, 1, 2), tau = VectorXd::LinSpaced(2, 5, -3);
  EXPECT_TRUE(accelerations(robot, q, dq, tau).isApprox(accelerations(whole, q, dq, tau), 1e-12));
  EXPECT_TRUE(robot.frame("tcp").X_BF.p.isApprox(whole.frame("tcp").X_BF.p, 1e-14));
}

TEST(History, RefusesDamagedFilesWithOneSentence) {
  const std::vector<RobotHistory> one{{"arm", "", {}, changed(load_robot("planar2"))}};
  const auto good = nlohmann::ordered_json::parse(to_json(one));
  const auto refusal = [&](auto damage) {
    auto file = good;
    damage(file);
    return error_of([&] { parse_history(file.dump(), "h.json"); });
  };
  using Json = nlohmann::ordered_json;
  const auto change = [](Json& f, std::size_t k) -> Json& { return f["robots"][0]["changes"][k]; };
  EXPECT_THAT(error_of([] { parse_history("{", "h.json"); }), HasSubstr("h.json: is no JSON"));
  EXPECT_THAT(error_of([] { parse_history("[]", "h.json"); }), HasSubstr("h.json: is no object"));
  EXPECT_THAT(refusal([](Json& f) { f["cotwin_history"] = 2; }), HasSubstr("is no history file of version 1"));
  EXPECT_THAT(refusal([](Json& f) { f["more"] = 1; }), HasSubstr("unknown member 'more'"));
  EXPECT_THAT(refusal([](Json& f) { f["robots"][0]["urdf"] = "<robot/>"; }), HasSubstr("robot 1"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["time"] = "soon"; }), HasSubstr("change 1: 'time' is no number"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 3)["time"] = 2.0; }),
              AllOf(HasSubstr("change 4: "), HasSubstr("at 2 s, expected one not before 2.25 s")));
  EXPECT_THAT(
      refusal([&](Json& f) { change(f, 3).erase("time"); }),
      AllOf(HasSubstr("change 4: "), HasSubstr("without a time, expected one not before 2.25 s, that of 'set inertia")));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["parent"] = "nowhere"; }), HasSubstr("nowhere"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["name"] = "two\nlines"; }), HasSubstr("not a valid name in a URDF"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["body"] = "nobody"; }), HasSubstr("no body 'nobody'"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["change"] = "glue"; }), HasSubstr("'glue', expected attach, detach"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["pose"]["R"][0] = 2; }), HasSubstr("no rotation matrix"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["part"]["mass"] = -1; }), HasSubstr("change 1"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["part"]["com"] = {1, 2}; }), HasSubstr("no list of 3 numbers"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 0)["part"]["mass"] = 0.61; }), HasSubstr("'result' is not the inertia of body"));
  EXPECT_THAT(refusal([&](Json& f) { change(f, 4)["result"]["mass"] = 1e3; }),
              HasSubstr("'result' is not the inertia of body"));
  EXPECT_THAT(refusal([&](Json& f) { f["robots"][0]["changes"].erase(3); }), HasSubstr("mounted on 'gripper'"));
}

}  // namespace
}  // namespace cotwin::robot::history_test
