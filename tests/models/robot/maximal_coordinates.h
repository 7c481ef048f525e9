#pragma once
#include <Eigen/Geometry>
#include <vector>

#include "models/robot/robot_model.h"

/// The second formulation for tests of dynamics: M = J_mcᵀ M*_mc J_mc and g of (2a) by definition, from poses and body
/// Jacobians of the RobotModel alone, without recursion over forces.
namespace cotwin::robot::testing {

/// X_BL of a body's URDF frame.
inline Pose body_pose(const RobotModel& robot, const Eigen::VectorXd& q, int body) {
  if (body < 0) return {};
  const Joint& joint = robot.joints[static_cast<std::size_t>(body)];
  const Pose X = body_pose(robot, q, joint.parent) * joint.X_PJ;
  if (joint.type == JointType::kPrismatic) return X * Pose{Eigen::Matrix3d::Identity(), q[body] * joint.axis};
  return X * Pose{Eigen::AngleAxisd(q[body], joint.axis).toRotationMatrix(), Eigen::Vector3d::Zero()};
}

/// J (6 x n), linear first, of the point p of a body, all in the base.
inline Eigen::MatrixXd point_jacobian(const RobotModel& robot, const Eigen::VectorXd& q, int body, const Eigen::Vector3d& p) {
  Eigen::MatrixXd J = Eigen::MatrixXd::Zero(6, robot.n());
  for (int j = body; j >= 0; j = robot.joints[static_cast<std::size_t>(j)].parent) {
    const Joint& joint = robot.joints[static_cast<std::size_t>(j)];
    const Pose X = body_pose(robot, q, j);
    const Eigen::Vector3d z = X.R * joint.axis;
    if (joint.type == JointType::kRevolute) {
      J.col(j) << z.cross(p - X.p), z;
    } else {
      J.col(j) << z, Eigen::Vector3d::Zero();
    }
  }
  return J;
}

struct MaximalDynamics {
  Eigen::MatrixXd M;
  Eigen::VectorXd g;
  double U = 0;  // potential energy
};

inline MaximalDynamics maximal_dynamics(const RobotModel& robot, const Eigen::VectorXd& q) {
  const int n = robot.n();
  MaximalDynamics result{Eigen::MatrixXd::Zero(n, n), Eigen::VectorXd::Zero(n)};
  for (int b = 0; b < n; ++b) {
    const Inertia& body = robot.bodies[static_cast<std::size_t>(b)].inertia;
    const Pose X = body_pose(robot, q, b);
    const Eigen::Vector3d c = X * body.p_LC;
    const Eigen::MatrixXd J = point_jacobian(robot, q, b, c);
    Eigen::Matrix<double, 6, 6> M_body = Eigen::Matrix<double, 6, 6>::Zero();
    M_body.topLeftCorner<3, 3>() = body.mass * Eigen::Matrix3d::Identity();
    M_body.bottomRightCorner<3, 3>() = X.R * body.I_CC * X.R.transpose();
    result.M += J.transpose() * M_body * J;
    result.g -= body.mass * J.topRows<3>().transpose() * robot.gravity;  // (2a): g = −J_mcᵀ F_g, on the left side
    result.U -= body.mass * robot.gravity.dot(c);
  }
  return result;
}

}  // namespace cotwin::robot::testing
