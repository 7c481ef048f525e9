#include "models/trajectory/joint_path.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/SVD>
#include <cmath>
#include <filesystem>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/robot/urdf/urdf.h"
#include "tests/models/robot/random_robots.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/places.h"

namespace cotwin::trajectory::joint_path_test {
namespace {

using cotwin::testing::error_of;
using Eigen::MatrixXd, Eigen::Quaterniond, Eigen::Vector3d, Eigen::Vector4d, Eigen::VectorXd;
using robot::InverseKinematics, robot::PostureChoice, robot::RobotModel, robot::TaskDirections;
using robot::testing::Draw;
using ::testing::HasSubstr;

RobotModel robot_named(const std::string& name) {
  return robot::load_urdf(std::filesystem::path(places::source()) / "models/robots" / name / "robot.urdf");
}

/// Pose, J and J̇ q̇ of the end-effector by the kernels.
class Kinematics {
 public:
  explicit Kinematics(const RobotModel& robot)
      : mechanism_(robot), data_(mechanism_), frame_(robot::on_body(robot.end_effector())), J(6, robot.n()) {}
  Pose at(const VectorXd& q) { return robot::jacobian(mechanism_, data_, q, frame_, J); }
  Twist bias(const VectorXd& q, const VectorXd& dq) {
    Twist a;
    robot::jacobian_dot_times_dq(mechanism_, data_, q, dq, frame_, a);
    return a;
  }

 private:
  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::FrameOnBody frame_;

 public:
  MatrixXd J;
};

/// A path through poses that the robot has at the given postures.
PosePath path_of(const RobotModel& robot, const std::vector<VectorXd>& postures, PosePassing passing, double leg = 1) {
  Kinematics kinematics(robot);
  PoseWaypoints points;
  for (std::size_t k = 0; k < postures.size(); ++k) {
    const Pose X = kinematics.at(postures[k]);
    const Quaterniond Q(X.R);
    points.t.push_back(static_cast<double>(k) * leg);
    points.p.push_back(X.p);
    points.Q.emplace_back(Q.w(), Q.x(), Q.y(), Q.z());
    points.dwell.push_back(0);
  }
  points.legs.resize(postures.size() - 1);
  points.speed.assign(postures.size() - 1, 0);
  points.turn_speed = points.speed;
  return make_pose_path(points, passing, 0.3);
}

struct Sample {
  VectorXd q, dq, ddq;
};
Sample at(JointPath& path, double t) {
  const std::size_t n = path.table().joints();
  Sample s{VectorXd(n), VectorXd(n), VectorXd(n)};
  path.at(t, {s.q.data(), n}, {s.dq.data(), n}, {s.ddq.data(), n});
  return s;
}

const VectorXd kElbowUp{{0.2, 0.6, -0.3, 1.2, 0.4, -0.8, 0.5}};

/// Poses, twists and accelerations of the joints are those of the path, and q̇, q̈ are the derivatives of q.
void check(JointPath& path, const PosePath& poses, const RobotModel& robot, double derivative_tolerance) {
  Kinematics kinematics(robot);
  const double T = poses.end() - poses.begin(), e = 1e-4;
  for (double x = 0.01; x < 1; x += 0.0137) {
    const double t = poses.begin() + x * T;
    const PoseMotion m = poses.at(t);
    const Sample s = at(path, t);
    const Pose X = kinematics.at(s.q);
    EXPECT_LT((X.p - m.p).norm(), 1e-12);
    EXPECT_LT((X.R - Quaterniond(m.Q[0], m.Q[1], m.Q[2], m.Q[3]).toRotationMatrix()).norm(), 1e-12);
    Twist V, dV;
    V << m.v, m.w;
    dV << m.dv, m.dw;
    EXPECT_LT((kinematics.J * s.dq - V).norm(), 1e-11 * (1 + V.norm()));
    EXPECT_LT((kinematics.J * s.ddq + kinematics.bias(s.q, s.dq) - dV).norm(), 1e-10 * (1 + dV.norm()));
    const Sample a = at(path, t - e), b = at(path, t + e), c = at(path, t - 2 * e), d = at(path, t + 2 * e);
    const VectorXd dq = (8 * (b.q - a.q) - (d.q - c.q)) / (12 * e), ddq = (8 * (b.dq - a.dq) - (d.dq - c.dq)) / (12 * e);
    EXPECT_LT((dq - s.dq).norm(), derivative_tolerance * (1 + s.dq.norm())) << "at " << x;
    EXPECT_LT((ddq - s.ddq).norm(), 20 * derivative_tolerance * (1 + s.ddq.norm())) << "at " << x;
  }
}

TEST(JointPath, FollowsThePathAndKeepsClosestToTheReference) {
  const RobotModel robot = robot_named("lwr4");
  VectorXd second = kElbowUp, third = kElbowUp;
  second[0] += 0.5;
  second[3] -= 0.4;
  third[1] -= 0.3;
  third[5] += 0.6;
  for (const PosePassing passing : {PosePassing::kRest, PosePassing::kBlend, PosePassing::kThrough}) {
    const PosePath poses = path_of(robot, {kElbowUp, second, third}, passing);
    InverseKinematics kinematics(robot, robot.end_effector());
    JointPath path(poses, Pose{}, kinematics, kElbowUp, kElbowUp);
    EXPECT_LT(path.table_error(), 1e-9);
    check(path, poses, robot, 1e-6);
    // The difference to the reference is orthogonal to the self-motion.
    Kinematics jacobian(robot);
    for (const double t : {0.3, 1.0, 1.7}) {
      const VectorXd q = at(path, t).q;
      jacobian.at(q);
      const Eigen::JacobiSVD<MatrixXd> svd(jacobian.J, Eigen::ComputeFullV);
      EXPECT_LT(std::abs(svd.matrixV().col(6).dot(q - kElbowUp)), 1e-7);
    }
  }
}

TEST(JointPath, HoldsAJointOrTheArmAngle) {
  const RobotModel robot = robot_named("lwr4");
  VectorXd second = kElbowUp;
  second[0] += 0.5;
  second[3] -= 0.4;
  const PosePath poses = path_of(robot, {kElbowUp, second}, PosePassing::kRest);
  for (const auto kind : {PostureChoice::Kind::kJoint, PostureChoice::Kind::kArmAngle}) {
    InverseKinematics kinematics(robot, robot.end_effector(), {}, {kind, 2, 0});
    kinematics.set_value(kinematics.value_of(kElbowUp));
    JointPath path(poses, Pose{}, kinematics, kElbowUp, kElbowUp);
    check(path, poses, robot, 1e-6);
    for (double t = 0; t <= 1; t += 0.1) EXPECT_NEAR(kinematics.value_of(at(path, t).q), kinematics.value_of(kElbowUp), 1e-8);
  }
}

TEST(JointPath, OfSixJointsHasTheDerivativesOfTheInverse) {
  const RobotModel robot = robot_named("kr300_r2500");
  const VectorXd a{{0.3, -1.2, 1.4, 0.4, 0.7, -0.3}};
  VectorXd b = a;
  b[0] -= 0.6;
  b[2] += 0.3;
  b[4] += 0.4;
  const PosePath poses = path_of(robot, {a, b}, PosePassing::kRest);
  InverseKinematics kinematics(robot, robot.end_effector());
  JointPath path(poses, Pose{}, kinematics, a, a);
  check(path, poses, robot, 1e-7);
  EXPECT_LT((at(path, 1).q - b).norm(), 1e-9) << "the branch of the start is kept";
}

TEST(JointPath, OfATwoJointArmFollowsItsDirections) {
  const RobotModel robot = robot_named("planar2");
  const VectorXd a{{0.5, 0.8}}, b{{0.2, 1.4}};
  const PosePath poses = path_of(robot, {a, b}, PosePassing::kRest);
  InverseKinematics kinematics(robot, robot.end_effector(), robot::task_directions("x,z"));
  JointPath path(poses, Pose{}, kinematics, a, a);
  Kinematics forward(robot);
  const double e = 1e-4;
  for (double t = 0.02; t < 1; t += 0.06) {
    const PoseMotion m = poses.at(t);
    const Sample s = at(path, t);
    const Pose X = forward.at(s.q);
    EXPECT_LT(std::hypot(X.p[0] - m.p[0], X.p[2] - m.p[2]), 1e-13);
    EXPECT_NEAR(forward.J.row(0) * s.dq, m.v[0], 1e-12);
    EXPECT_NEAR((forward.J * s.ddq + forward.bias(s.q, s.dq))[2], m.dv[2], 1e-11);
    EXPECT_LT(((at(path, t + e).q - at(path, t - e).q) / (2 * e) - s.dq).norm(), 1e-5);
  }
}

TEST(JointPath, PointsTheToolAndLeavesTheTurnAboutItFree) {
  const RobotModel robot = robot_named("lwr4");
  VectorXd second = kElbowUp;
  second[0] += 0.4;
  second[6] += 2.5;  // a turn about the tool axis that need not be followed
  const PosePath poses = path_of(robot, {kElbowUp, second}, PosePassing::kRest);
  const TaskDirections task = robot::task_directions("x,y,z,rx,ry", true);
  InverseKinematics kinematics(robot, robot.end_effector(), task);
  JointPath path(poses, Pose{}, kinematics, kElbowUp, kElbowUp);
  Kinematics forward(robot);
  const double e = 1e-4;
  double largest = 0;
  for (double t = 0.02; t < 1; t += 0.06) {
    const PoseMotion m = poses.at(t);
    const Quaterniond Q_d(m.Q[0], m.Q[1], m.Q[2], m.Q[3]);
    const Sample s = at(path, t);
    const Pose X = forward.at(s.q);
    EXPECT_LT((X.p - m.p).norm(), 1e-12);
    EXPECT_LT((X.R.col(2) - Q_d * Vector3d::UnitZ()).norm(), 1e-11);
    largest = std::max(largest, std::abs(std::remainder((X.R.col(0) - Q_d * Vector3d::UnitX()).norm(), 10)));
    const Sample a = at(path, t - e), b = at(path, t + e);
    EXPECT_LT(((b.q - a.q) / (2 * e) - s.dq).norm(), 1e-5);
    EXPECT_LT(((b.dq - a.dq) / (2 * e) - s.ddq).norm(), 1e-4);
    EXPECT_LT((forward.J.topRows<3>() * s.dq - m.v).norm(), 1e-12);
  }
  EXPECT_GT(largest, 0.5) << "the turn about the tool is not followed";
}

TEST(JointPath, ReturnsToItsPostureOnAClosedPath) {
  const RobotModel robot = robot_named("lwr4");
  VectorXd second = kElbowUp, third = kElbowUp;
  second[0] += 0.5;
  third[1] -= 0.4;
  const PosePath poses = path_of(robot, {kElbowUp, second, third, kElbowUp}, PosePassing::kThrough);
  InverseKinematics kinematics(robot, robot.end_effector());
  JointPath path(poses, Pose{}, kinematics, kElbowUp, kElbowUp);
  EXPECT_LT((at(path, 3).q - kElbowUp).norm(), 1e-9);
  // Three directions leave four to the reference.
  InverseKinematics position(robot, robot.end_effector(), robot::task_directions("x,y,z"));
  JointPath free(poses, Pose{}, position, kElbowUp, kElbowUp);
  Kinematics forward(robot);
  const double e = 1e-4;
  for (double t = 0.02; t < 3; t += 0.11) {
    const Sample s = at(free, t);
    EXPECT_LT((forward.at(s.q).p - poses.at(t).p).norm(), 1e-12);
    EXPECT_LT(((at(free, t + e).q - at(free, t - e).q) / (2 * e) - s.dq).norm(), 1e-5);
    const Eigen::JacobiSVD<MatrixXd> svd(forward.J.topRows<3>(), Eigen::ComputeFullV);
    EXPECT_LT((svd.matrixV().rightCols<4>().transpose() * (s.q - kElbowUp)).norm(), 1e-6);
  }
  EXPECT_LT((at(free, 3).q - kElbowUp).norm(), 1e-9);
}

TEST(JointPath, PassesCloseToSingularPosturesAndTellsHowClose) {
  // The elbow is nearly stretched in the middle of a line through the shoulder's neighbourhood.
  const RobotModel robot = robot_named("planar2");
  const VectorXd a{{0.8, -0.3}}, b{{-0.4, -0.25}};
  const PosePath poses = path_of(robot, {a, b}, PosePassing::kRest);
  InverseKinematics kinematics(robot, robot.end_effector(), robot::task_directions("x,z"));
  JointPath path(poses, Pose{}, kinematics, a, a);
  Kinematics forward(robot);
  for (double t = 0; t <= 1; t += 0.01) {
    const Sample s = at(path, t);
    const Pose X = forward.at(s.q);
    EXPECT_LT(std::hypot(X.p[0] - poses.at(t).p[0], X.p[2] - poses.at(t).p[2]), 1e-12);
    // det J of the two-link arm is l₁ l₂ sin q₂; the smallest singular value is below |det| over the largest.
    const MatrixXd J{{forward.J(0, 0), forward.J(0, 1)}, {forward.J(2, 0), forward.J(2, 1)}};
    EXPECT_NEAR(path.sigma_min(t), J.jacobiSvd().singularValues()[1], 2e-3);
  }
  EXPECT_LT(path.least_sigma().value, 0.06);
}

TEST(JointPath, NamesTheTimeAtWhichThePoseIsOutOfReach) {
  const RobotModel robot = robot_named("lwr4");
  Kinematics kinematics(robot);
  const Pose X = kinematics.at(kElbowUp);
  const Quaterniond Q(X.R);
  PoseWaypoints points;
  points.t = {0, 2};
  points.p = {X.p, X.p + Vector3d(3, 0, 0)};
  points.Q.assign(2, Vector4d(Q.w(), Q.x(), Q.y(), Q.z()));
  points.dwell = {0, 0};
  points.legs.resize(1);
  points.speed = points.turn_speed = {0};
  const PosePath poses = make_pose_path(points, PosePassing::kRest);
  InverseKinematics inverse(robot, robot.end_effector());
  EXPECT_THAT(error_of([&] { JointPath(poses, Pose{}, inverse, kElbowUp, kElbowUp); }),
              ::testing::AllOf(HasSubstr("inverse kinematics at "), HasSubstr(" m and ")));
}

/// Turns of the tip of planar2 without joint limits about its shoulder in one leg of a second, at uniform speed in the middle.
PosePath turns_about_the_shoulder(RobotModel& robot, const VectorXd& q, double turns) {
  for (robot::Joint& joint : robot.joints) {
    joint.q_min = -std::numeric_limits<double>::infinity();
    joint.q_max = std::numeric_limits<double>::infinity();
  }
  const Pose X = Kinematics(robot).at(q);
  PoseWaypoints points;
  points.t = {0, 1};
  points.p = {X.p, X.p};
  points.Q.assign(2, Vector4d(1, 0, 0, 0));
  points.dwell = {0, 0};
  points.legs = {{LegShape::Kind::kCircle, {0, 0, 0.5}, {0, -1, 0}, turns * 2 * std::numbers::pi}};
  points.speed = points.turn_speed = {0};
  return make_pose_path(points, PosePassing::kBlend, 0.1);
}

TEST(JointPath, DoesNotTakeFullTurnsForRest) {
  const VectorXd a{{0.5, 0.8}};
  for (const double turns : {1.0, 8.0, 16.0, 32.0, -9.0}) {  // also such that all samples would be at the same place
    RobotModel robot = robot_named("planar2");
    const PosePath poses = turns_about_the_shoulder(robot, a, turns);
    InverseKinematics kinematics(robot, robot.end_effector(), robot::task_directions("x,z"));
    JointPath path(poses, Pose{}, kinematics, a, a);
    EXPECT_LT((at(path, 1).q - a - VectorXd{{2 * std::numbers::pi * turns, 0}}).norm(), 1e-9) << turns;
    EXPECT_NEAR(at(path, 0.5).q[0], a[0] + std::numbers::pi * turns, 1e-9);
  }
}

TEST(JointPath, EndsWithAnErrorWhereItWouldNeedTooManyPostures) {
  const VectorXd a{{0.5, 0.8}};
  RobotModel robot = robot_named("planar2");
  const PosePath poses = turns_about_the_shoulder(robot, a, 1e5);
  InverseKinematics kinematics(robot, robot.end_effector(), robot::task_directions("x,z"));
  EXPECT_THAT(error_of([&] { JointPath(poses, Pose{}, kinematics, a, a); }), HasSubstr("s: the leg needs "));
}

TEST(JointPath, AllocatesNothingAtARandomTime) {
  const RobotModel robot = robot_named("lwr4");
  VectorXd second = kElbowUp;
  second[0] += 0.5;
  const PosePath poses = path_of(robot, {kElbowUp, second}, PosePassing::kRest);
  InverseKinematics kinematics(robot, robot.end_effector());
  JointPath path(poses, Pose{}, kinematics, kElbowUp, kElbowUp);
  std::array<double, 7> q, dq, ddq;
  const std::uint64_t before = cotwin::testing::allocations();
  for (const double t : {0.7, 0.2, 0.9}) path.at(t, q, dq, ddq);
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

}  // namespace
}  // namespace cotwin::trajectory::joint_path_test
