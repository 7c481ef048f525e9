#pragma once
#include <Eigen/Core>
#include <vector>

#include "models/control/cascade.h"

namespace cotwin::control {

/// Self-motion ν = N q̇ below the tasks of a cascade, of a robot with q̈ = J̄ … + N ξ (IV-A3):
///   ξ = −k_ν ν − M⁻¹ (∇V − s τ_e) − Ṅ q̇ − ½ M⁻¹ Ṁ ν
/// N is symmetric in M and N² = N, so with W = ½ νᵀ M ν and ν̇ = N ξ + Ṅ q̇
///   Ẇ = −k_ν νᵀ M ν − νᵀ ∇V + s νᵀ τ_e
/// The self-motion is passive from τ_e to ν. While the tasks stand still, ν = q̇ and W + V + ∫ (k_ν νᵀ M ν − s νᵀ τ_e) dt is
/// constant. Only N ξ acts, so Ṅ q̇ is needed up to a part that N removes. From M (q̇ − ν) = Σ J_kᵀ f_k, differentiated at
/// constant q̇,
///   N Ṅ q̇ = N M⁻¹ (Ṁ (q̇ − ν) − Σ J̇_kᵀ f_k)
///   N ξ = −k_ν ν − N M⁻¹ (∇V − s τ_e + Ṁ (q̇ − ½ ν) − Σ J̇_kᵀ f_k)
/// The sign of V's force, M⁻¹ ∇V, is the gradient in the metric M; ∇V alone would not make W + V decrease. In directions that
/// the cascade damps, and with tasks partly active, N is no projector and the balance is not exact.
class NullSpace {
 public:
  explicit NullSpace(const Cascade& cascade);

  struct Inputs {
    VectorIn dq;        // n
    MatrixIn M, dM;     // n x n: M(q), the metric of the cascade, and Ṁ = C + Cᵀ
    VectorIn gradient;  // n: ∇V, J/rad
    VectorIn tau_e;     // n: external joint torque, N.m
    double yield = 0;   // s ≥ 0: 0: stiff against τ_e, 1: moves with the inertia of the robot, > 1: lighter
    double k_nu = 0;    // 1/s, ≥ 0; 0: self-motion never stops
    const Eigen::VectorXd* also = nullptr;  // n: an acceleration that is added to ξ
  };
  /// After Cascade::decompose() at the same q, with dJ of the tasks. Computes the following.
  void evaluate(Cascade& cascade, const Inputs& inputs);

  Eigen::VectorXd nu;        // n: N q̇
  Eigen::VectorXd ddq;       // n: N ξ
  double energy = 0;         // J: W
  double dissipation = 0;    // W: k_ν νᵀ M ν
  double external_work = 0;  // W: s νᵀ τ_e

 private:
  Eigen::VectorXd p_, force_, Mnu_;
  std::vector<Eigen::VectorXd> forces_;
};

}  // namespace cotwin::control
