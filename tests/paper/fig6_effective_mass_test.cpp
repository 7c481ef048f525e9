// V-B, Fig. 6 left: the effective mass of the LWR 4+ along z of link_7 on the self-motion of a held pose. The self-motion is
// found here without models/control: steps along the kernel of the Jacobian, with Newton's method back to the pose, and the mass
// from dense matrices.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <cmath>

#include "models/robot/dynamics.h"
#include "models/robot/urdf.h"
#include "tests/support/places.h"

namespace cotwin::robot {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;

class Arm {
 public:
  Arm()
      : model_(load_urdf(places::source() + "/models/robots/lwr4/robot.urdf")),
        mechanism_(model_),
        data_(mechanism_),
        frame_(on_body(model_.frame("link_7"))) {}

  Pose pose(const VectorXd& q) { return forward_kinematics(mechanism_, data_, q, frame_); }
  MatrixXd jacobian(const VectorXd& q) {
    MatrixXd J(6, 7);
    robot::jacobian(mechanism_, data_, q, frame_, J);
    return J;
  }
  double mass(const VectorXd& q) {
    MatrixXd M(7, 7);
    mass_matrix(mechanism_, data_, q, M);
    const Vector3d u = pose(q).R.col(2);
    const VectorXd row = jacobian(q).topRows(3).transpose() * u;
    return 1 / row.dot(M.inverse() * row);
  }
  bool inside(const VectorXd& q) const {
    for (Eigen::Index i = 0; i < 7; ++i) {
      const Joint& joint = model_.joints[static_cast<std::size_t>(i)];
      if (q[i] < joint.q_min || q[i] > joint.q_max) return false;
    }
    return true;
  }
  /// Newton's method with the pseudo-inverse.
  void return_to(const Pose& X, VectorXd& q) {
    for (int i = 0; i < 3; ++i) {
      const Pose now = pose(q);
      const Eigen::AngleAxisd turn(X.R * now.R.transpose());
      VectorXd e(6);
      e << X.p - now.p, turn.angle() * turn.axis();
      q += Eigen::JacobiSVD<MatrixXd>(jacobian(q), Eigen::ComputeThinU | Eigen::ComputeThinV).solve(e);
    }
  }

 private:
  RobotModel model_;
  Mechanism mechanism_;
  Data data_;
  FrameOnBody frame_;
};

TEST(EffectiveMass, LiesBetweenItsPublishedBoundsOnTheSelfMotionOfAHeldPose) {
  Arm arm;
  VectorXd q = (VectorXd(7) << 0, 30, 0, -60, 0, 60, 0).finished() * std::acos(-1.0) / 180;
  const Pose X = arm.pose(q);
  EXPECT_NEAR(arm.mass(q), 3.28702, 5e-6);
  double least = 10, least_inside = 10, most = 0, most_inside = 0;
  VectorXd at_least = q, at_most = q, before = VectorXd::Unit(7, 2);
  for (int i = 0; i < 12000; ++i) {  // more than one turn of the elbow
    VectorXd z = Eigen::JacobiSVD<MatrixXd>(arm.jacobian(q), Eigen::ComputeFullV).matrixV().col(6);
    if (z.dot(before) < 0) z = -z;
    before = z;
    q += 1e-3 * z;
    arm.return_to(X, q);
    const double m = arm.mass(q);
    if (m < least) least = m, at_least = q;
    if (m > most) most = m, at_most = q;
    if (!arm.inside(q)) continue;
    least_inside = std::min(least_inside, m);
    most_inside = std::max(most_inside, m);
  }
  EXPECT_LT((arm.pose(q).p - X.p).norm(), 1e-12);
  EXPECT_NEAR(least, 2.62214, 1e-5);
  EXPECT_NEAR(least_inside, least, 1e-9);  // the optimum is within the limits
  EXPECT_NEAR(at_least[2] * 180 / std::acos(-1.0), 105.4, 0.1);
  EXPECT_NEAR(most, 3.31740, 1e-5);
  EXPECT_LT(most_inside, most - 0.01);  // the worst is not
  EXPECT_NEAR(std::abs(at_most[2]) * 180 / std::acos(-1.0), 180, 0.2);
}

}  // namespace
}  // namespace cotwin::robot
