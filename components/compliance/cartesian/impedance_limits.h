#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "components/compliance/joints/limits.h"
#include "components/compliance/joints/link_dynamics.h"
#include "components/compliance/joints/tracking.h"
#include "models/robot/drives/drive_parameters.h"

namespace cotwin::compliance {

/// Bounds of the speed and the acceleration towards a wall.
struct Approach {
  double speed;         // rad/s (m/s)
  double acceleration;  // rad/s² (m/s²) at the present speed
};

/// The fastest approach to a wall at distance s, rad (m), behind which a motion at `speed` stops with the deceleration `braking`: √(2 b (s − b T²/2)) from
/// s = b T² on, s/T nearer. The acceleration follows the curve and corrects the speed with the time constant T/4: near the wall
/// the distance has the poles −1/T and −4/T. Behind the wall (s < 0) the speed is negative: back.
Approach approach(double s, double speed, double braking, double T);

/// Limits of joints with render=impedance: torques that take from u what would drive a joint across.
///
/// Each limit is a row g = ±e_i with the speed g q̇ ≤ w. The accelerations (M + B/r) q̈ = u + τ_e − C q̇ − g, with the measured τ_e, are
/// bounded by approach(); the torques Σ g_i λ_i with λ_i ≤ 0, (g_i q̈ − a_i) λ_i = 0, are those of ideal one-sided walls (Gauss's
/// principle), so E goes on with the compliance that the other joints leave it. Speeds are those of the motors: links on soft gears swing
/// about them. A push that is not measured meets a spring and a damper with these poles.
///
/// A joint that starts behind a limit is not driven back: it may not go further, and the wall follows it back.
class ImpedanceLimits {
 public:
  explicit ImpedanceLimits(Eigen::Index n);

  /// The robot at the beginning of a step of h > 0 seconds.
  struct Robot {
    const Eigen::VectorXd &q, &dq;  // n; rad, rad/s (m, m/s): static link positions, motor speeds
    const Joints& q_measured;       // rad (m); of the links. The one of both that is further out counts
    const Eigen::MatrixXd& M;       // n x n, M + B/r
    const Eigen::LLT<Eigen::MatrixXd>& M_llt;
    const robot::DriveParameters& drives;
    const Joints &shaping, &tau_e;  // τ_e, N.m: the measured external torque
    double h;                       // s
  };
  /// The walls begin where the robot is.
  void start(const Eigen::VectorXd& q, std::span<const Limits> joints);
  /// Changes the torques `u` (n, N.m).
  void confine(LinkDynamics& links, const Robot& robot, std::span<const Limits> joints, Eigen::VectorXd& u);

  // States: how far beyond q_max and q_min the motion may be. n; rad (m)
  Eigen::VectorXd beyond_high, beyond_low;
  // Result: the Limit that acted, by joint.
  std::vector<std::int32_t> met;

 private:
  struct Row {
    double acceleration;  // bound of g q̈
    int joint, side;      // g = side e_joint
    Limit limit;
  };
  void take(const Robot& robot, std::span<const Limits> joints);
  void solve();

  int count_ = 0;
  std::vector<Row> rows_;
  Eigen::MatrixXd Y_, A_;                 // n x rows: L⁻¹ Gᵀ; G (M + B/r)⁻¹ Gᵀ
  Eigen::VectorXd lambda_, a_, ddq_, g_;  // N.m; g q̈ less its bound (rows); n
};

}  // namespace cotwin::compliance
