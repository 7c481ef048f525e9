#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>

#include "components/compliance/cartesian/frame/translation.h"

namespace cotwin::compliance {

/// Potential of a rotation (η, ε) with axis·angle φ, and its elastic moment −∂U:
///   kQuaternion  U = 2 εᵀ S ε      moment 2 Eᵀ S ε, E = ηI − S(ε)     k sin φ about a principal axis, largest at 90°
///   kLog         U = ½ φᵀ S φ      moment J_l(φ)⁻ᵀ S φ                 k φ about a principal axis, to 180°
enum class Potential { kQuaternion, kLog };

/// The compliant frame C relative to the desired frame D: R_DC, and Δω = R_WDᵀ (ω_C − ω_D) in the axes of D.
struct Turn {
  Eigen::Quaterniond Q{1, 0, 0, 0};             // η ≥ 0
  Eigen::Vector3d w = Eigen::Vector3d::Zero();  // rad/s
};

/// J. `S`: stiffness K_o of the impedance.
double potential_energy(Potential potential, const Eigen::Matrix3d& S, const Eigen::Quaterniond& Q);
/// N.m, in the axes of D: the moment that turns C back.
Eigen::Vector3d elastic_moment(Potential potential, const Eigen::Matrix3d& S, const Eigen::Quaterniond& Q);

struct Turned {
  Turn turn;
  double dissipated = 0;  // J, by D
};

/// (3b) over h seconds under the moment m0 + m1 t in the axes of D:
///   M Δω̇ + D Δω + 2 Eᵀ S ε = m      (Caccavale et al. 1999)
/// by implicit midpoints on the unit quaternions. With Q̄ the mean of the quaternions before and after a part of the step and Ω
/// that of Δω,
///   Q₊ − Q₋ = ¼ h (0, Ω) ⊗ (Q₊ + Q₋)      M (Δω₊ − Δω₋) = h (m − D Ω − 2 E(Q̄)ᵀ S ε̄)
/// so that ½ Δωᵀ M Δω + 2 εᵀ S ε changes by exactly h Ωᵀ m − h Ωᵀ D Ω: no energy is made, with parts of any length.
class RotationStep {
 public:
  /// Prepares steps of `h` > 0 seconds. Returns at once if nothing has changed since the last call.
  void prepare(const Impedance& impedance, double h);
  Turned advance(Potential potential, const Turn& start, const Eigen::Vector3d& m0, const Eigen::Vector3d& m1) const;

 private:
  Impedance impedance_;
  double h_ = 0, part_ = 0;  // s
  int count_ = 0;
  Eigen::Matrix3d inertia_, resistance_, inverse_;  // 2 M/part, this and D, and of this and S part/2 the inverse
};

/// φ̇ = J_l⁻¹(φ) Δω of an axis times angle φ, with Δω in the axes that do not turn with φ.
Eigen::Matrix3d inverse_left_jacobian(const Eigen::Vector3d& phi);
/// S(v) with S(v) w = v × w.
Eigen::Matrix3d cross_matrix(const Eigen::Vector3d& v);

/// Axis times angle of a unit quaternion, at most π.
Eigen::Vector3d axis_angle(const Eigen::Quaterniond& Q);
/// The unit quaternion of a rotation by |r| about r.
Eigen::Quaterniond quaternion_of(const Eigen::Vector3d& r);

}  // namespace cotwin::compliance
