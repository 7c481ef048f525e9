#include "models/robot/inverse_kinematics.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "models/robot/urdf.h"
#include "models/support/error.h"
#include "tests/models/random_robots.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::robot {
namespace {

using cotwin::testing::error_of;
using Eigen::MatrixXd, Eigen::Vector3d, Eigen::VectorXd;
using testing::Draw;
using ::testing::HasSubstr;

RobotModel robot_named(const std::string& name) {
  return load_urdf(std::filesystem::path(places::source()) / "models/robots" / name / "robot.urdf");
}

/// Poses by the kernels, not by the quaternions of FrameKinematics.
class Kinematics {
 public:
  explicit Kinematics(const RobotModel& robot) : mechanism_(robot), data_(mechanism_), frame_(on_body(robot.end_effector())) {}
  Pose pose(const VectorXd& q) { return forward_kinematics(mechanism_, data_, q, frame_); }
  MatrixXd jacobian(const VectorXd& q) {
    MatrixXd J(6, q.size());
    robot::jacobian(mechanism_, data_, q, frame_, J);
    return J;
  }

 private:
  Mechanism mechanism_;
  Data data_;
  FrameOnBody frame_;
};

PoseTarget target_of(const Pose& X) { return {X.p, Eigen::Quaterniond(X.R)}; }

/// Any posture within the limits.
VectorXd posture(const RobotModel& robot, Draw& draw, double share = 1) {
  VectorXd q(robot.n());
  for (int i = 0; i < robot.n(); ++i) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(i)];
    const double low = std::max(joint.q_min, -3.0), high = std::min(joint.q_max, 3.0);
    q[i] = 0.5 * (low + high) + share * 0.5 * draw.number(low - high, high - low);
  }
  return q;
}

bool within_limits(const RobotModel& robot, const VectorXd& q) {
  for (int i = 0; i < robot.n(); ++i) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(i)];
    if (!(q[i] >= joint.q_min && q[i] <= joint.q_max)) return false;
  }
  return true;
}

/// Share of random poses in the workspace that are reached, each checked by forward kinematics.
double success(const RobotModel& robot, const TaskDirections& task, int count, std::uint64_t seed) {
  Draw draw(seed);
  InverseKinematics ik(robot, robot.end_effector(), task);
  Kinematics kinematics(robot);
  int reached = 0;
  for (int i = 0; i < count; ++i) {
    const Pose X = kinematics.pose(posture(robot, draw));
    const Posture found = ik.solve(target_of(X), posture(robot, draw));
    if (!found.reached) continue;
    ++reached;
    const Pose there = kinematics.pose(found.q);
    EXPECT_TRUE(within_limits(robot, found.q));
    for (int k = 0; k < 3; ++k) {
      EXPECT_TRUE(!task.used[static_cast<std::size_t>(k)] || std::abs(there.p[k] - X.p[k]) < 2e-10);
    }
    EXPECT_TRUE(task.count() < 6 || (there.R - X.R).norm() < 3e-10);
  }
  return static_cast<double>(reached) / count;
}

TEST(InverseKinematics, ReachesAnyPoseOfTheWorkspace) {
  for (const char* name : {"lwr4", "kr300_r2500", "planar2"}) {
    const double share = success(robot_named(name), {}, 100, 1);
    std::printf("%s: %.3f\n", name, share);
    EXPECT_EQ(share, 1) << name;
  }
  EXPECT_EQ(success(robot_named("planar2"), task_directions("x,z"), 300, 2), 1);
  EXPECT_EQ(success(robot_named("lwr4"), task_directions("x,y,z"), 50, 3), 1);
}

TEST(InverseKinematics, ReachesThePosesOfRandomArms) {
  Draw draw(4);
  int reached = 0, count = 0;
  for (int i = 0; i < 60; ++i) {
    const int n = draw.integer(2, 8);
    RobotModel robot = draw.robot(i % 2 == 0 ? testing::Kind::kChain : testing::Kind::kMixedChain, n);
    for (Joint& joint : robot.joints) {
      joint.q_min = draw.number(-3, -0.5);
      joint.q_max = draw.number(0.5, 3);
    }
    const int each = 5;
    reached += static_cast<int>(std::lround(each * success(robot, {}, each, static_cast<std::uint64_t>(100 + i))));
    count += each;
  }
  std::printf("random arms: %d of %d\n", reached, count);
  EXPECT_EQ(reached, count);
}

}  // namespace
}  // namespace cotwin::robot
