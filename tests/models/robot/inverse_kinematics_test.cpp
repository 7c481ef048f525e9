#include "models/robot/inverse_kinematics.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::robot::inverse_kinematics_test {
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
    const Posture found = ik.solve(target_of(X), posture(robot, draw), 1);
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
  EXPECT_EQ(reached, count);
}

const VectorXd kPosture{{0.3, 0.7, -0.4, 1.3, 0.5, -0.9, 0.6}};

TEST(InverseKinematics, FindsThePostureClosestToTheReference) {
  // Against a scan along the self-motion: the arm angle parametrises it.
  const RobotModel robot = robot_named("lwr4");
  Kinematics kinematics(robot);
  const PoseTarget target = target_of(kinematics.pose(kPosture));
  Draw draw(5);
  for (int i = 0; i < 5; ++i) {
    const VectorXd reference = posture(robot, draw, 0.6);
    InverseKinematics ik(robot, robot.end_effector());
    const Posture found = ik.solve(target, reference);
    ASSERT_TRUE(found.reached);
    double least = 1e9;
    for (double angle = -3.1; angle < 3.14; angle += 0.1) {
      InverseKinematics given(robot, robot.end_effector(), {}, {PostureChoice::Kind::kArmAngle, 0, angle});
      const Posture other = given.solve(target, reference, 16);
      if (!other.reached) continue;
      EXPECT_NEAR(given.value_of(other.q), angle, 1e-9);
      EXPECT_LT((kinematics.pose(other.q).p - target.p).norm(), 1e-9);
      least = std::min(least, (other.q - reference).norm());
    }
    EXPECT_LE((found.q - reference).norm(), least + 1e-9);
    EXPECT_GE((found.q - reference).norm(), least - 0.15) << "the scan has steps of 0.1 rad";
  }
}

TEST(InverseKinematics, PutsAJointWhereItIsGivenOrTheJointsInTheMiddleOfTheirLimits) {
  const RobotModel robot = robot_named("lwr4");
  Kinematics kinematics(robot);
  const PoseTarget target = target_of(kinematics.pose(kPosture));
  InverseKinematics joint(robot, robot.end_effector(), {}, {PostureChoice::Kind::kJoint, 2, 0.25});
  const Posture third = joint.solve(target, kPosture);
  ASSERT_TRUE(third.reached);
  EXPECT_NEAR(third.q[2], 0.25, 1e-10);
  EXPECT_LT((kinematics.pose(third.q).R - kinematics.pose(kPosture).R).norm(), 1e-10);

  InverseKinematics centre(robot, robot.end_effector(), {}, {PostureChoice::Kind::kCentre, 0, 0});
  const Posture middle = centre.solve(target, kPosture);
  ASSERT_TRUE(middle.reached);
  // At the minimum of Σ (q_i / half range)² along the self-motion, its gradient has no part there.
  VectorXd gradient(7);
  for (int i = 0; i < 7; ++i) {
    gradient[i] = middle.q[i] / std::pow(robot.joints[static_cast<std::size_t>(i)].q_max, 2);
  }
  const Eigen::JacobiSVD<MatrixXd> svd(kinematics.jacobian(middle.q), Eigen::ComputeFullV);
  EXPECT_LT(std::abs(svd.matrixV().col(6).dot(gradient)), 1e-8);
}

TEST(InverseKinematics, TellsWhatIsLeftOfAPoseOutOfReachAndWhichLimitsBind) {
  // Straight up the arm has no limit in its way; 3 m away, 0.79 m of reach (0.4 + 0.39) are used.
  const RobotModel robot = robot_named("lwr4");
  InverseKinematics ik(robot, robot.end_effector(), task_directions("x,y,z"));
  const Posture far = ik.solve({{0, 0, 3}, Eigen::Quaterniond::Identity()}, kPosture);
  EXPECT_FALSE(far.reached);
  EXPECT_NEAR(far.distance, 3 - 0.79, 1e-4);
  EXPECT_THAT(far.message, ::testing::AllOf(HasSubstr("2.21 m"), HasSubstr("out of reach")));

  // The elbow of the two-link arm folds by 2.8 rad at most: the closest that the tip comes to its shoulder.
  const RobotModel planar = robot_named("planar2");
  InverseKinematics folded(planar, planar.end_effector(), task_directions("x,z"));
  const double closest = std::sqrt(0.4 * 0.4 + 0.35 * 0.35 + 2 * 0.4 * 0.35 * std::cos(2.8));
  const Posture near = folded.solve({{0.05, 0, 0.5}, Eigen::Quaterniond::Identity()}, VectorXd::Zero(2));
  EXPECT_FALSE(near.reached);
  EXPECT_LT(near.distance, closest - 0.05 + 1e-6);
  EXPECT_THAT(near.message,
              ::testing::AnyOf(HasSubstr("elbow at its limit of 2.8 rad"), HasSubstr("elbow at its limit of -2.8 rad")));
  const VectorXd q{{1.0, 2.8}};
  EXPECT_TRUE(folded.solve(target_of(Kinematics(planar).pose(q)), VectorXd::Zero(2)).reached) << "at the limit itself";
}

TEST(InverseKinematics, ReachesSingularPosesAndTheEdgeOfTheWorkspace) {
  const RobotModel robot = robot_named("lwr4");
  Kinematics kinematics(robot);
  InverseKinematics ik(robot, robot.end_effector());
  for (const VectorXd& q :
       {VectorXd(VectorXd::Zero(7)), VectorXd{{0.3, 0.8, 0, 0, 0.4, 0, 0.2}}, VectorXd{{0.3, 0, 0.5, 1.0, 0.4, 0, 0.2}}}) {
    const Posture found = ik.solve(target_of(kinematics.pose(q)), kPosture);
    EXPECT_TRUE(found.reached) << found.message;
    EXPECT_LT((kinematics.pose(found.q).p - kinematics.pose(q).p).norm(), 2e-10);
  }
}

TEST(InverseKinematics, TurnsJointsWithoutLimitsTheShortWayToTheReference) {
  RobotModel robot = robot_named("kr300_r2500");
  for (Joint& joint : robot.joints) {
    joint.q_min = -std::numeric_limits<double>::infinity();
    joint.q_max = std::numeric_limits<double>::infinity();
  }
  Kinematics kinematics(robot);
  const VectorXd q{{0.3, -1.2, 1.4, 0.4, 0.7, -0.3}};
  InverseKinematics ik(robot, robot.end_effector());
  const VectorXd turned = q + 2 * std::numbers::pi * VectorXd{{1, 0, -1, 3, 0, -2}};
  const Posture found = ik.solve(target_of(kinematics.pose(q)), turned + VectorXd::Constant(6, 0.01));
  ASSERT_TRUE(found.reached);
  EXPECT_LT((found.q - turned).norm(), 1e-9);
}

TEST(InverseKinematics, MovesMimicsAndPrismaticJointsWithTheirLeaders) {
  // A gantry with a telescope: the second stage extends half as far as the first, from an offset.
  Draw draw(6);
  for (int i = 0; i < 20; ++i) {
    RobotModel robot = draw.robot(testing::Kind::kMixedChain, 7);
    const Joint follower = robot.joints[4];
    Mimic mimic;
    mimic.joint = follower;
    mimic.leader = draw.integer(0, 3);
    mimic.multiplier = draw.number(-1.5, 1.5);
    mimic.offset = draw.number(-0.5, 0.5);
    mimic.place = 4;
    // Body 4 becomes that of the mimic and moves behind the others.
    robot.joints.erase(robot.joints.begin() + 4);
    const Body body = robot.bodies[4];
    robot.bodies.erase(robot.bodies.begin() + 4);
    robot.bodies.push_back(body);
    const auto renumbered = [](int b) { return b == 4 ? 6 : b > 4 ? b - 1 : b; };
    for (Joint& joint : robot.joints) joint.parent = renumbered(joint.parent);
    for (Frame& frame : robot.frames) frame.body = renumbered(frame.body);
    robot.mimics.push_back(mimic);
    Kinematics kinematics(robot);
    InverseKinematics ik(robot, robot.end_effector());
    const VectorXd q = posture(robot, draw, 0.5);
    const Posture found = ik.solve(target_of(kinematics.pose(q)), VectorXd::Zero(6));
    ASSERT_TRUE(found.reached) << found.message;
    EXPECT_LT((kinematics.pose(found.q).p - kinematics.pose(q).p).norm(), 5e-10);
    EXPECT_LT((kinematics.pose(found.q).R - kinematics.pose(q).R).norm(), 5e-10);
  }
}

TEST(InverseKinematics, GivesTheSameBitsEveryTime) {
  const RobotModel robot = robot_named("lwr4");
  Kinematics kinematics(robot);
  InverseKinematics a(robot, robot.end_effector()), b(robot, robot.end_effector());
  const PoseTarget target = target_of(kinematics.pose(kPosture));
  a.solve({{0.1, 0.2, 0.3}, Eigen::Quaterniond::Identity()}, kPosture);  // no memory of earlier poses
  EXPECT_EQ(a.solve(target, VectorXd::Zero(7)).q, b.solve(target, VectorXd::Zero(7)).q);
  PoseTarget negative = target;
  negative.Q.coeffs() = -negative.Q.coeffs();
  EXPECT_EQ(a.solve(negative, VectorXd::Zero(7)).q, b.solve(target, VectorXd::Zero(7)).q);
}

TEST(InverseKinematics, RefusesTasksThatTheRobotHasNot) {
  const RobotModel robot = robot_named("planar2");
  EXPECT_THAT(error_of([&] {
                InverseKinematics(robot, robot.end_effector(), {}, {PostureChoice::Kind::kArmAngle, 0, 0});
              }),
              HasSubstr("planar2 is not a chain of seven revolute joints"));
  EXPECT_THAT(error_of([] { task_directions("x,z,rw"); }), HasSubstr("'rw', expected all, or some of x, y, z, rx, ry, rz"));
  EXPECT_THAT(error_of([] { task_directions(""); }), HasSubstr("''"));
}

TEST(FrameKinematics, HasAQuaternionThatIsContinuousInTheJoints) {
  // The product of the joints' quaternions follows a full turn of a joint to the negative quaternion.
  const RobotModel robot = robot_named("lwr4");
  FrameKinematics kinematics(robot, robot.end_effector());
  Eigen::Quaterniond before = kinematics.at(kPosture, kPosture, kPosture).Q;
  const Eigen::Quaterniond first = before;
  VectorXd q = kPosture;
  for (int k = 1; k <= 100; ++k) {
    q[3] = kPosture[3] + 2 * std::numbers::pi * k / 100;
    const Eigen::Quaterniond Q = kinematics.at(q, q, q).Q;
    EXPECT_GT(Q.dot(before), 0.99);
    before = Q;
  }
  EXPECT_NEAR(before.dot(first), -1, 1e-14);
}

}  // namespace
}  // namespace cotwin::robot::inverse_kinematics_test
