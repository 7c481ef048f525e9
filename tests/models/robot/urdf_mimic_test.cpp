// Mimic, locked and passive joints of URDF files.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <cmath>

#include "models/foundation/support/error.h"
#include "models/robot/changes/attachment.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "models/robot/urdf/urdf_update.h"

namespace cotwin::robot::urdf_mimic_test {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string link(const std::string& name) {
  return "<link name=\"" + name +
         "\"><inertial><origin xyz=\"0.01 0.02 0.03\"/><mass value=\"0.5\"/><inertia ixx=\"0.02\" ixy=\"0\" ixz=\"0\" "
         "iyy=\"0.03\" iyz=\"0\" izz=\"0.02\"/></inertial></link>";
}
std::string joint(const std::string& name, const std::string& parent, const std::string& child, const std::string& more = "",
                  const std::string& type = "revolute") {
  return "<joint name=\"" + name + "\" type=\"" + type + "\"><parent link=\"" + parent + "\"/><child link=\"" + child +
         "\"/><origin xyz=\"0.1 0 0.2\" rpy=\"0.1 0.2 0.3\"/><axis xyz=\"0 1 0\"/>"
         "<limit lower=\"-1\" upper=\"1\" effort=\"4\" velocity=\"3\"/>" +
         more + "</joint>\n";
}
std::string mimic(const std::string& leader, const std::string& multiplier = "1", const std::string& offset = "0") {
  return "<mimic joint=\"" + leader + "\" multiplier=\"" + multiplier + "\" offset=\"" + offset + "\"/>";
}
/// base – a; beside it b; on b: c; on a: d.
std::string tree(const std::string& of_a, const std::string& of_b, const std::string& of_c, const std::string& of_d = "",
                 const std::string& type_c = "revolute") {
  return "<robot name=\"r\">\n<link name=\"base\"/>" + link("A") + link("B") + link("C") + link("D") + "\n" +
         joint("b", "base", "B", of_b) + joint("a", "base", "A", of_a) + joint("d", "A", "D", of_d) +
         joint("c", "B", "C", of_c, type_c) + "</robot>";
}
RobotModel parsed(const std::string& xml, const UrdfOptions& options = {}, std::vector<std::string>* warnings = nullptr) {
  return parse_urdf(xml, "hand.urdf", options, warnings);
}
std::string refusal_of(const std::string& xml, const UrdfOptions& options = {}) {
  try {
    parsed(xml, options);
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}
UrdfOptions locking(const std::string& name, double q) {
  UrdfOptions options;
  options.locked[name] = q;
  return options;
}
double kinetic(const RobotModel& robot, const Eigen::VectorXd& q, const Eigen::VectorXd& dq) {
  const Mechanism mechanism(robot);
  Data data(mechanism);
  return kinetic_energy(mechanism, data, q, dq);
}

TEST(UrdfMimic, FollowsTheJointAtTheEndOfItsChain) {
  // q_b = 2 q_c + 0.5, q_c = −3 q_a + 0.1: q_b = −6 q_a + 0.7
  const RobotModel robot = parsed(tree("", mimic("c", "2", "0.5"), mimic("a", "-3", "0.1")));
  ASSERT_EQ(robot.n(), 2);
  EXPECT_EQ(robot.joints[0].name, "a");
  EXPECT_EQ(robot.joints[1].name, "d");
  ASSERT_EQ(robot.mimics.size(), 2u);
  EXPECT_EQ(robot.mimics[0].joint.name, "b");
  EXPECT_EQ(robot.mimics[0].leader, 0);
  EXPECT_DOUBLE_EQ(robot.mimics[0].multiplier, -6);
  EXPECT_DOUBLE_EQ(robot.mimics[0].offset, 0.7);
  EXPECT_EQ(robot.mimics[1].joint.name, "c");
  EXPECT_EQ(robot.mimics[1].joint.parent, 2);  // the body of b
  EXPECT_EQ(robot.bodies[2].name, "B");
  EXPECT_EQ(robot.frame("C").body, 3);
  EXPECT_TRUE(robot.moves(0, 3));
  EXPECT_FALSE(robot.moves(1, 3));
  EXPECT_THAT(robot.depth_first(), ElementsAre(2, 3, 0, 1));
}

TEST(UrdfMimic, MayHaveAnIndependentChildAndAnotherTypeThanItsLeader) {
  const RobotModel robot = parsed(tree("", mimic("a", "0.1"), "", "", "prismatic"));
  ASSERT_EQ(robot.n(), 3);
  EXPECT_EQ(robot.joints[0].name, "c");  // depth-first: b (a mimic), c, a, d
  EXPECT_EQ(robot.joints[0].parent, 3);
  EXPECT_EQ(robot.mimics[0].leader, 1);
  const RobotModel sliding = parsed(tree("", "", mimic("a", "0.1"), "", "prismatic"));
  EXPECT_EQ(sliding.mimics[0].joint.type, JointType::kPrismatic);
}

TEST(UrdfMimic, WithoutMultiplierAndOffsetCopiesItsLeader) {
  const RobotModel robot = parsed(tree("", "<mimic joint=\"a\"/>", ""));
  EXPECT_EQ(robot.mimics[0].multiplier, 1);
  EXPECT_EQ(robot.mimics[0].offset, 0);
}

TEST(UrdfMimic, GivesItsFrictionToItsLeader) {
  // the power d (2 q̇)² + f |2 q̇| of the mimic at the leader's speed
  const RobotModel robot = parsed(tree("<dynamics damping=\"1\" friction=\"0.5\"/>",
                                       "<dynamics damping=\"0.1\" friction=\"0.25\"/>" + mimic("a", "-2"), ""));
  EXPECT_DOUBLE_EQ(robot.joints[1].damping, 1 + 4 * 0.1);
  EXPECT_DOUBLE_EQ(robot.joints[1].friction, 0.5 + 2 * 0.25);
  EXPECT_EQ(robot.mimics[0].joint.damping, 0);
}

TEST(UrdfMimic, ThatItsLeaderMovesBeyondItsLimitsIsAWarning) {
  std::vector<std::string> warnings;
  parsed(tree("", mimic("a", "-1"), ""), {}, &warnings);
  EXPECT_THAT(warnings, IsEmpty());
  parsed(tree("", mimic("a", "-2", "0.5"), ""), {}, &warnings);
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("hand.urdf:3: joint 'b': the limits of its leader 'a' move it from -1.5 to 2.5; its own "
                                     "limits -1 to 1 are not used"));
}

TEST(UrdfMimic, ThatIsWrongIsOneError) {
  EXPECT_THAT(refusal_of(tree("", mimic("b"), "")), HasSubstr("hand.urdf:3: joint 'b': mimics itself, expected another joint"));
  EXPECT_THAT(refusal_of(tree(mimic("c"), mimic("a"), mimic("b"))), HasSubstr("mimics itself through"));
  EXPECT_THAT(refusal_of(tree("", mimic("aa"), "")),
              HasSubstr("hand.urdf:3: joint 'b': mimics 'aa', expected a joint of the file; did you mean 'a'?"));
  EXPECT_THAT(refusal_of(tree("", mimic("a", "inf"), "")), HasSubstr("expected a finite number"));
  EXPECT_THAT(refusal_of(tree("", mimic("a", "x"), "")), HasSubstr("multiplier 'x' of <mimic>, expected a number"));
  EXPECT_THAT(refusal_of(tree("", mimic("c", "1e14"), mimic("a", "1e14"))), HasSubstr("expected magnitudes below"));
  EXPECT_THAT(refusal_of(tree("", R"(<mimic joint="a"><multiplier>2</multiplier></mimic>)", "")),
              HasSubstr("'multiplier' in <mimic> is not read, expected it as an attribute"));
  EXPECT_THAT(refusal_of(tree("", R"(<mimic joint="a">2</mimic>)", "")), HasSubstr("text in <mimic> is not read"));
  EXPECT_THAT(refusal_of(tree("", "<mimic/>", "")), HasSubstr("<mimic> without 'joint'"));
  EXPECT_THAT(refusal_of(tree("", mimic("a") + mimic("d"), "")), HasSubstr("<mimic> more than once"));
  UrdfOptions chain;
  chain.tip = "C";
  EXPECT_THAT(refusal_of(tree("", mimic("a"), ""), chain), HasSubstr("mimics 'a', which is not on the chain to 'C'"));
}

TEST(UrdfMimic, OfWhatStandsStillStandsStillWithAWarning) {
  std::vector<std::string> warnings;
  const RobotModel by_zero = parsed(tree("", mimic("a", "0", "0.4"), ""), {}, &warnings);
  EXPECT_EQ(by_zero.n(), 3);
  EXPECT_THAT(by_zero.mimics, IsEmpty());
  ASSERT_EQ(warnings.size(), 1u);
  EXPECT_THAT(warnings[0], HasSubstr("stands still at 0.4, because the multiplier of its <mimic> is 0"));
  EXPECT_EQ(by_zero, parsed(tree("", "", ""), locking("b", 0.4)));

  std::string fixed = tree("", mimic("a", "2", "0.4"), "");
  const std::string from = "<joint name=\"a\" type=\"revolute\">";
  fixed.replace(fixed.find(from), from.size(), "<joint name=\"a\" type=\"fixed\">");
  warnings.clear();
  EXPECT_EQ(parsed(fixed, {}, &warnings).n(), 2);
  EXPECT_THAT(warnings[0], HasSubstr("stands still at 0.4, because it mimics 'a', which is fixed"));
  warnings.clear();
  std::string follower = tree("", mimic("a"), "");
  follower.replace(follower.find("type=\"revolute\""), 15, "type=\"fixed\"");
  EXPECT_THAT(parsed(follower, {}, &warnings).mimics, IsEmpty());
  EXPECT_THAT(warnings[0], HasSubstr("<mimic> of a fixed joint has no effect"));
}

TEST(UrdfMimic, LockedJointMovesLikeTheFreeOneAtRestThere) {
  const std::string xml = tree("", "", "");
  const RobotModel free = parsed(xml), locked = parsed(xml, locking("b", 0.7));
  ASSERT_EQ(free.n(), 4);  // b, c, a, d
  ASSERT_EQ(locked.n(), 3);
  const Eigen::Vector3d q(0.3, -0.4, 0.9), dq(1, -2, 0.5);
  Eigen::VectorXd q_free(4), dq_free(4);
  q_free << 0.7, q;
  dq_free << 0, dq;
  EXPECT_NEAR(kinetic(locked, q, dq), kinetic(free, q_free, dq_free), 1e-14);
  EXPECT_DOUBLE_EQ(locked.base.inertia.mass, 0.5);
}

TEST(UrdfMimic, OfALockedJointIsLockedWithIt) {
  const RobotModel robot = parsed(tree("", mimic("a", "2", "0.1"), ""), locking("a", 0.2));
  EXPECT_EQ(robot, parsed(tree("", "", ""), {Unphysical::kError, "", {{"a", 0.2}, {"b", 2 * 0.2 + 0.1}}}));
}

TEST(UrdfMimic, WrongNamesToLockOrToBePassiveAreErrors) {
  const std::string xml = tree("", mimic("a"), "");
  EXPECT_THAT(refusal_of(xml, locking("aa", 0)),
              HasSubstr("no joint 'aa' to lock, expected a joint of the file; did you mean"));
  EXPECT_THAT(refusal_of(xml, locking("b", 0)), HasSubstr("joint 'b': mimics 'a', expected that joint to be locked"));
  EXPECT_THAT(refusal_of(xml, locking("a", std::nan(""))), HasSubstr("locked at nan"));
  std::vector<std::string> warnings;
  parsed(xml, locking("a", 2), &warnings);
  EXPECT_THAT(warnings[0], HasSubstr("stands at 2, outside its limits -1 to 1"));
  UrdfOptions passive;
  passive.passive = {"b"};
  EXPECT_THAT(refusal_of(xml, passive), HasSubstr("joint 'b': mimics 'a', expected that joint to be passive"));
  passive.passive = {"x"};
  EXPECT_THAT(refusal_of(xml, passive), HasSubstr("no joint 'x' to be passive"));
  passive.passive = {"a"};
  passive.locked = {{"a", 0.0}};
  EXPECT_THAT(refusal_of(xml, passive), HasSubstr("joint 'a': does not move and cannot be passive"));
}

TEST(UrdfMimic, IsWrittenAndReadAgainToTheLastBit) {
  UrdfOptions passive;
  passive.passive = {"d"};
  for (const std::string& xml : {tree("", mimic("c", "2", "0.5"), mimic("a", "-0.3", "0.1")), tree("", mimic("a", "0.1"), ""),
                                 tree(mimic("c", "0.7"), "", "", mimic("b", "-1.3"))}) {
    const RobotModel robot =
        parsed(xml, passive.passive.count("d") && xml.find("joint=\"b\"") == std::string::npos ? passive : UrdfOptions{});
    EXPECT_EQ(parse_urdf(to_urdf(robot), "again.urdf"), robot);
  }
}

TEST(UrdfMimic, StaysInTheFileOfATunedRobot) {
  const std::string xml =
      tree("", "<dynamics damping=\"0.1\" friction=\"0.2\"/>" + mimic("c", "2", "0.5"), mimic("a", "-3", "0.1"));
  RobotModel robot = parsed(xml);
  set_inertia(robot, 2, {0.7, {0.01, 0, 0.02}, Eigen::Vector3d(0.02, 0.03, 0.02).asDiagonal()}, "tuned");
  robot.joints[0].damping = 9;
  robot.joints[1].passive = true;
  const std::string updated = updated_urdf(xml, "hand.urdf", robot);
  EXPECT_THAT(updated, HasSubstr("<mimic joint=\"c\" multiplier=\"2\" offset=\"0.5\"/>"));
  RobotModel back = parsed(updated);
  back.history = robot.history;
  EXPECT_EQ(back, robot);
}

TEST(UrdfMimic, OfALockedJointIsFixedInTheFileOfATunedRobot) {
  const std::string xml = tree("", mimic("a", "2", "0.1"), mimic("d"));
  RobotModel robot = parsed(xml, locking("a", 0.2));
  set_inertia(robot, 0, {0.7, {0.01, 0, 0.02}, Eigen::Vector3d(0.02, 0.03, 0.02).asDiagonal()}, "tuned");
  RobotModel back = parsed(updated_urdf(xml, "hand.urdf", robot));  // without the setting
  back.history = robot.history;
  back.locked = robot.locked;
  EXPECT_EQ(back, robot);
}

TEST(UrdfMimic, XacroIsOneErrorThatTellsHowToExpandIt) {
  const std::string how =
      ", expected a URDF; expand it first: xacro FILE > robot.urdf (ROS package xacro, or pip install xacro)";
  EXPECT_EQ(refusal_of("<robot xmlns:xacro=\"http://wiki.ros.org/xacro\">\n<xacro:property name=\"m\" value=\"1\"/></robot>"),
            "hand.urdf:2: an element of xacro" + how);
  EXPECT_EQ(refusal_of("<robot name=\"r\">\n<link name=\"${prefix}base\"/></robot>"),
            "hand.urdf:2: '${prefix}base' is an expression of xacro" + how);
}

}  // namespace
}  // namespace cotwin::robot::urdf_mimic_test
