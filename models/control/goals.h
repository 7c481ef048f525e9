#pragma once
#include <Eigen/Cholesky>
#include <Eigen/Core>

#include "models/control/cascade.h"
#include "models/robot/dynamics.h"
#include "models/robot/indices.h"

/// Potentials V(q) in joule for self-motion (null_space.h), each with a weight; 0: off. Each function adds ∇V to `gradient` (n)
/// and returns V. Where a weight rises or falls continuously, so do V and ∇V. Nothing allocates or throws.
namespace cotwin::control {

/// ½ Σ K_i (q_i − q_0,i)², K ≥ 0 in N.m/rad.
double posture(const VectorIn& q, const VectorIn& q_0, const VectorIn& K, VectorOut gradient);

/// weight Σ (1/x − 1/m)² for x < m, x = distance to the nearer limit/(q_max − q_min), m = `margin` ≤ 0.5. Zero and with zero
/// gradient at more than m from the limits, unlike Σ range²/((q_max − q)(q − q_min)), which pushes every joint to its middle.
/// Below x = m/100 and beyond the limits it continues as a straight line, so that ∇V is finite and points back inside. Joints
/// without limits, q_min ≥ q_max or infinite, add nothing. `weight` in J.
double joint_limits(const VectorIn& q, const VectorIn& q_min, const VectorIn& q_max, double weight, double margin,
                    VectorOut gradient);

/// weight m_u(q), the effective mass along u (models/robot/indices.h); `weight` in J/kg. V is 0 where m_u is infinite.
class EffectiveMassGoal {
 public:
  explicit EffectiveMassGoal(int n);

  /// `B` as in robot::frame_inertia; e: unit vector in the axes of `direction`. Computes m_u also for weight = 0.
  double add(const robot::Mechanism&, robot::Data&, const VectorIn& q, const VectorIn& B, const robot::FrameOnBody& frame,
             const Eigen::Vector3d& e, robot::Direction direction, double weight, VectorOut gradient);

  double m_u = 0;  // kg

 private:
  robot::FrameInertia inertia_;
  Eigen::VectorXd slope_;
};

/// −weight ln w, w = √det(J Jᵀ + ε² 1) with ε = 1e-3 m per rad, so that V and ∇V are finite at singular positions. J: rows of
/// the frame's Jacobian, those of the rotation times a length. The derivative of J is a central difference.
class ManipulabilityGoal {
 public:
  /// Translation and rotation, or one of them.
  enum class Rows { kTranslation, kRotation, kBoth };
  ManipulabilityGoal(int n, Rows rows, double length);

  double add(const robot::Mechanism&, robot::Data&, const VectorIn& q, const robot::FrameOnBody& frame, double weight,
             VectorOut gradient);
  /// √det(J Jᵀ), or √det(Jᵀ J) for robots with fewer joints than rows.
  double w(const robot::Mechanism&, robot::Data&, const VectorIn& q, const robot::FrameOnBody& frame);

 private:
  void update_jacobian(const robot::Mechanism&, robot::Data&, const VectorIn& q, const robot::FrameOnBody& frame);
  void factorise(double addition);

  int first_, rows_;
  bool tall_;  // more rows than joints
  double length_;
  Eigen::VectorXd q_;
  Eigen::MatrixXd J_;                 // 6 x n, rotation scaled
  Eigen::MatrixXd rows_of_J_, plus_;  // rows x n
  Eigen::MatrixXd G_;
  Eigen::LLT<Eigen::MatrixXd> factor_;
};

}  // namespace cotwin::control
