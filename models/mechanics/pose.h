#pragma once
#include <Eigen/Core>

namespace cotwin {

/// X_RT: pose of frame T in frame R. Chains cancel by eye: X_WE = X_WB * X_BE.
struct Pose {
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();  // R_RT, columns are T's axes in R
  Eigen::Vector3d p = Eigen::Vector3d::Zero();      // p_RT, T's origin in R, m
  static auto fields(auto& X, auto each) { return each(X.R, X.p); }

  friend Pose operator*(const Pose& X_AB, const Pose& X_BC) { return {X_AB.R * X_BC.R, X_AB.p + X_AB.R * X_BC.p}; }
  friend Eigen::Vector3d operator*(const Pose& X_AB, const Eigen::Vector3d& p_BQ) { return X_AB.p + X_AB.R * p_BQ; }
  Pose inverse() const { return {R.transpose(), -(R.transpose() * p)}; }
  friend bool operator==(const Pose& a, const Pose& b) { return a.R == b.R && a.p == b.p; }
};

/// [v; w], linear first as in (1).
using Twist = Eigen::Matrix<double, 6, 1>;
/// [f; m], force first.
using Wrench = Eigen::Matrix<double, 6, 1>;

/// URDF's fixed-axis roll, pitch, yaw in rad: R = Rz(yaw) Ry(pitch) Rx(roll).
Eigen::Matrix3d rotation_from_rpy(double roll, double pitch, double yaw);

/// Whether R is a rotation matrix: orthonormal to 1e-9 and right-handed.
bool is_rotation(const Eigen::Matrix3d& R);

}  // namespace cotwin
