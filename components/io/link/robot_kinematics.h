#pragma once
#include <Eigen/Core>
#include <optional>
#include <span>

#include "models/mechanics/pose.h"
#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::io {

/// The wrench F (force, moment) at the point `from`, as that at the point `to` (m): the same force, m + (from − to) × f.
Wrench moved(const Wrench& F, const Eigen::Vector3d& from, const Eigen::Vector3d& to);

/// Kinematics of a robot at its end-effector E, as its controller reports and uses them. Poses are in the base; twists,
/// wrenches and J (6 × n, linear first) are those of E in the axes of the base. Allocates nothing after the constructor.
class RobotKinematics {
 public:
  explicit RobotKinematics(const robot::RobotModel& robot);

  int n() const { return static_cast<int>(q_.size()); }
  Pose pose(std::span<const double> q);
  /// J, until the next call.
  const Eigen::MatrixXd& jacobian(std::span<const double> q);
  /// J dq with the last J.
  Twist twist(std::span<const double> dq) const;
  /// M, kg.m², and g, N.m, until the next call.
  const Eigen::MatrixXd& mass_matrix(std::span<const double> q);
  const Eigen::VectorXd& gravity(std::span<const double> q);

  /// τ = Jᵀ F, N.m.
  void torques_of(const Wrench& F, std::span<const double> q, std::span<double> tau);
  /// The wrench on E that explains external joint torques best: with J = U Σ Vᵀ, F = Σ u_k σ_k (v_kᵀ τ)/max(σ_k, σ_0)²: the least
  /// |Jᵀ F − τ|, exact for τ = Jᵀ F, and falling to 0 in directions in which the robot is near a singularity (σ_k < σ_0 = 0.02 in
  /// m and rad).
  Wrench wrench_of(std::span<const double> tau, std::span<const double> q);

  /// Moves q to the posture near it in which E has the pose X and, if `third` is given, the third joint that position (rad). By
  /// Newton's method with damping: Δq = J̄ᵀ (J̄ J̄ᵀ + μ 1)⁻¹ e, μ = |e|²/1000. False if the error is not below 1e-9 (m, rad) after 40
  /// steps; q is unspecified then. Joint limits are not regarded.
  bool reach(const Pose& X, std::optional<double> third, std::span<double> q);

 private:
  robot::Mechanism mechanism_;
  robot::Data data_;
  robot::FrameOnBody tool_;
  Eigen::MatrixXd J_, M_;
  Eigen::VectorXd g_, q_, step_;
};

}  // namespace cotwin::io
