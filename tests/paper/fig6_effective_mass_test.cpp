// V-B, Fig. 6 (left): the effective mass that an arm with seven joints has in one direction at a held pose of its end-effector,
// along its self-motion.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <vector>

#include "models/robot/indices.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::robot::fig6_effective_mass_test {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

double rad(double degrees) { return degrees * std::acos(-1.0) / 180; }

class SelfMotion {
 public:
  SelfMotion() : robot_(load_urdf(places::source() + "/models/robots/lwr4/robot.urdf")), q(7), gradient(7) {
    q << 0, rad(30), 0, rad(-60), 0, rad(60), 0;
    held_ = forward_kinematics(mechanism_, data_, q, E_);
    evaluate();
  }
  /// m_z along the axis z of link_7, and its gradient.
  double evaluate() {
    frame_inertia(mechanism_, data_, q, VectorXd(), E_, f_);
    const Vector3d z = f_.X_BF.R.col(2);
    effective_mass_gradient(mechanism_, data_, q, E_, f_, z, Direction::kInFrame, gradient);
    return effective_mass(f_, z);
  }
  /// The unit vector of joint speeds that leave E at rest, in the direction of `along`.
  VectorXd null_vector(const VectorXd& along) const {
    const Eigen::FullPivLU<MatrixXd> lu(f_.J);
    const VectorXd n = lu.kernel().col(0).normalized();
    return n.dot(along) < 0 ? VectorXd(-n) : n;
  }
  /// A step of length `s` along the self-motion, back onto the held pose by Newton's method.
  void move(const VectorXd& direction, double s) {
    q += s * direction;
    for (int i = 0; i < 5; ++i) {
      frame_inertia(mechanism_, data_, q, VectorXd(), E_, f_);
      const Eigen::AngleAxisd turn(held_.R * f_.X_BF.R.transpose());
      Eigen::Matrix<double, 6, 1> error;
      error << held_.p - f_.X_BF.p, turn.angle() * turn.axis();
      q += f_.J.transpose() * (f_.J * f_.J.transpose()).ldlt().solve(error);
    }
  }
  double distance_from_pose() {
    const Pose X = forward_kinematics(mechanism_, data_, q, E_);
    return (X.p - held_.p).norm() + (X.R - held_.R).norm();
  }

 private:
  RobotModel robot_;
  Mechanism mechanism_{robot_};
  Data data_{mechanism_};
  FrameOnBody E_ = on_body(robot_.frame("link_7"));
  FrameInertia f_{7};
  Pose held_;

 public:
  VectorXd q, gradient;
};

TEST(Fig6, EffectiveMassAtTheReferencePoseGoesFrom262To332KilogramsAlongTheSelfMotion) {
  SelfMotion arm;
  EXPECT_NEAR(arm.evaluate(), 3.28702, 5e-6);
  // Once around the closed branch, joint angles modulo full turns.
  const VectorXd start = arm.q;
  VectorXd direction = arm.null_vector(VectorXd::Unit(7, 2));
  double least = 1e9, most = 0, length = 0;
  VectorXd at_least, at_most;
  constexpr double kStep = 0.01;
  for (bool away = false; length < 50; length += kStep) {
    arm.move(direction, kStep);
    const double m = arm.evaluate();
    if (m < least) least = m, at_least = arm.q;
    if (m > most) most = m, at_most = arm.q;
    direction = arm.null_vector(direction);
    const VectorXd off = (arm.q - start).unaryExpr([](double x) { return std::remainder(x, 2 * std::acos(-1.0)); });
    away |= off.norm() > 0.5;
    if (away && off.norm() < kStep) break;
  }
  ASSERT_LT(length, 50) << "the branch is closed";
  EXPECT_LT(arm.distance_from_pose(), 1e-9);
  EXPECT_NEAR(least, 2.62214, 2e-5);
  EXPECT_NEAR(most, 3.31740, 2e-5);
  // Where the figures of the specification say, to the step's length; the branch is symmetric in q₃.
  EXPECT_NEAR(std::abs(at_least[2]), rad(105.4), 0.02);
  EXPECT_NEAR(at_least[1], rad(63.4), 0.02);
  EXPECT_NEAR(std::abs(std::remainder(at_most[2], 2 * rad(180))), rad(180), 0.02);
  EXPECT_NEAR(at_most[1], rad(89.2), 0.02);
}

// The branch has two minima, nearly mirror images (centres of mass beside the arm's plane make the difference): 2.62214 kg at
// q₃ = 105.4° and 2.62254 kg at q₃ = −106.2°.
TEST(Fig6, DescentOfTheGradientInTheNullSpaceEndsAtAMinimumFromAnyStart) {
  for (const double first : {-1.2, -0.4, 0.5, 1.5, 2.5}) {  // along the branch, in rad of its length
    SelfMotion arm;
    VectorXd direction = arm.null_vector(VectorXd::Unit(7, 2));
    for (int i = 0; i < 100; ++i) {
      arm.move(direction, first / 100);
      arm.evaluate();
      direction = arm.null_vector(direction);
    }
    double m = arm.evaluate();
    for (int i = 0; i < 2000; ++i) {
      const VectorXd n = arm.null_vector(-arm.gradient);
      const double slope = n.dot(arm.gradient);
      if (std::abs(slope) < 1e-10) break;
      arm.move(n, std::min(0.02, 0.1 * std::abs(slope)));
      const double next = arm.evaluate();
      EXPECT_LT(next, m + 1e-12) << "start " << first;
      m = next;
    }
    EXPECT_NEAR(m, arm.q[2] > 0 ? 2.62214 : 2.62254, 1e-5) << "start " << first;
    EXPECT_NEAR(std::abs(arm.q[2]), rad(105.8), 0.01) << "start " << first;
  }
}

}  // namespace
}  // namespace cotwin::robot::fig6_effective_mass_test
