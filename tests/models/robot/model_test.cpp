#include "models/robot/robot_model.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "models/foundation/support/error.h"

namespace cotwin::robot::model_test {
namespace {

/// Bodies with the given parents; the frame of each is named like its index, that of the base "base".
RobotModel tree(const std::vector<int>& parents) {
  RobotModel robot;
  robot.name = "tree";
  robot.base.name = "base";
  robot.frames.push_back({"base", -1, {}});
  for (std::size_t i = 0; i < parents.size(); ++i) {
    robot.joints.push_back({});
    robot.joints.back().parent = parents[i];
    robot.bodies.push_back({std::to_string(i), {}});
    robot.frames.push_back({std::to_string(i), static_cast<int>(i), {}});
  }
  return robot;
}

TEST(RobotModel, FindsAFrameByItsName) {
  const RobotModel robot = tree({-1, 0});
  EXPECT_EQ(robot.frame("1").body, 1);
  EXPECT_EQ(robot.frame("base").body, -1);
}

TEST(RobotModel, NamesTheClosestFrameWhereOneIsUnknown) {
  RobotModel robot = tree({-1});
  robot.frames.push_back({"wrist_3_link", 0, {}});
  try {
    robot.frame("wrist3_link");
    FAIL();
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "robot 'tree': no frame 'wrist3_link', did you mean 'wrist_3_link'?");
  }
}

TEST(RobotModel, NamesAllFramesWhereNoneIsClose) {
  const RobotModel robot = tree({-1, 0});
  try {
    robot.frame("camera");
    FAIL();
  } catch (const Error& error) {
    EXPECT_STREQ(error.what(), "robot 'tree': no frame 'camera', expected one of base, 0, 1");
  }
}

TEST(RobotModel, EndEffectorIsTheLastFrameOfTheLastBodyOfAChain) {
  RobotModel robot = tree({-1, 0, 1});
  EXPECT_EQ(robot.end_effector().name, "2");
  robot.frames.push_back({"flange", 2, {}});
  robot.frames.push_back({"tool", 2, {}});
  robot.frames.push_back({"camera on the shoulder", 0, {}});
  EXPECT_EQ(robot.end_effector().name, "tool");
}

TEST(RobotModel, EndEffectorOfATreeIsOnTheLongestBranch) {
  //      0 - 1
  // base
  //      2 - 3 - 4
  EXPECT_EQ(tree({-1, 0, -1, 2, 3}).end_effector().name, "4");
}

TEST(RobotModel, EndEffectorOfTwoArmsOfEqualLengthIsOnTheFirst) { EXPECT_EQ(tree({-1, 0, -1, 2}).end_effector().name, "1"); }

TEST(RobotModel, EndEffectorWithoutJointsIsTheLastFrameOfTheBase) {
  RobotModel robot = tree({});
  robot.frames.push_back({"tool", -1, {}});
  EXPECT_EQ(robot.end_effector().name, "tool");
  EXPECT_THROW(RobotModel{}.end_effector(), Error);
}

TEST(RobotModel, IsAValueThatCanBeCompared) {
  const RobotModel robot = tree({-1, 0});
  RobotModel other = robot;
  EXPECT_EQ(robot, other);
  other.joints[1].q_max = 1;
  EXPECT_NE(robot, other);
}

}  // namespace
}  // namespace cotwin::robot::model_test
