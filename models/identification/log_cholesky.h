#pragma once
#include <Eigen/Core>

#include "models/mechanics/inertia.h"

namespace cotwin::identification {

using Vector10d = Eigen::Matrix<double, 10, 1>;
using Matrix10d = Eigen::Matrix<double, 10, 10>;

/// Pseudo-inertia P = [Σ h; hᵀ m] (4 x 4) of a body: Σ = ∫ r rᵀ dm = ½ tr(I) U − I, h = m c. It is positive definite if and
/// only if mass and principal moments are positive and the moments satisfy the triangle inequality strictly (Wensing, Kim,
/// Slotine, RA-L 3(1), 2018). π as Inertia::parameters().
Eigen::Matrix4d pseudo_inertia(const Vector10d& pi);
Vector10d from_pseudo_inertia(const Eigen::Matrix4d& P);

/// The ten coordinates ξ of a body, relative to a prior: P(ξ) = (U_0 U(ξ)) (U_0 U(ξ))ᵀ with the upper triangular
///   U(ξ) = e^α [e^d1 s12 s13 t1;  0 e^d2 s23 t2;  0 0 e^d3 t3;  0 0 0 1],     ξ = (α, d1, d2, d3, s12, s23, s13, t1, t2, t3)
/// (Rucker, Wensing, RA-L 7(2), 2022, there with U_0 = 1), and U_0 the factor of the prior's P = U_0 U_0ᵀ. Every ξ in R¹⁰ is a
/// physically consistent body, every consistent body has its ξ, and ξ = 0 is the prior. All coordinates are dimensionless:
/// e^(2α) is the mass in that of the prior, t the shift of the centre of mass in standard deviations of the prior's mass
/// distribution, d and s stretch and shear that distribution.
class LogCholesky {
 public:
  /// Throws Error for a prior that is not strictly consistent: see consistent().
  explicit LogCholesky(const Inertia& prior);

  Vector10d parameters(const Vector10d& xi) const;
  /// π(ξ) and ∂π/∂ξ.
  Vector10d parameters(const Vector10d& xi, Matrix10d& jacobian) const;
  /// U_0
  const Eigen::Matrix4d& factor() const { return U_0_; }

 private:
  Eigen::Matrix4d U_0_;
};

/// The divergence of a body from its prior, D = tr(P_0⁻¹ P) − log det(P_0⁻¹ P) − 4 ≥ 0, as a sum of ten squares: returns their
/// roots and the derivatives by ξ. D does not depend on frames or units and is convex in π (Lee, Wensing, Park, "Geometric
/// Robot Dynamic Identification: A Convex Programming Approach", T-RO 36(2), 2020).
Vector10d divergence_roots(const Vector10d& xi, Matrix10d& jacobian);

/// The nearest body that can be a prior: mass of at least `least_mass` kg, and standard deviations of the mass distribution
/// about its centre of at least `least_radius` m in every direction. Values in files are rounded, and drawings have point
/// masses and bodies without mass. A body that satisfies this is returned unchanged.
Inertia consistent(const Inertia& inertia, double least_mass = 1e-3, double least_radius = 1e-3);

}  // namespace cotwin::identification
