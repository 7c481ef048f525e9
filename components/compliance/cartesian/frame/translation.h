#pragma once
#include <Eigen/Core>

namespace cotwin::compliance {

/// Mass, damping and stiffness of three directions: M ẍ + D ẋ + S x = u. M is symmetric and positive definite, D and S are
/// symmetric and positive semidefinite.
struct Impedance {
  Eigen::Matrix3d M = Eigen::Matrix3d::Identity(), D = Eigen::Matrix3d::Zero(), S = Eigen::Matrix3d::Zero();

  friend bool operator==(const Impedance&, const Impedance&) = default;
};

/// 2 zeta M V diag(max(√λ, omega_free)) Vᵀ M with S v = λ M v and Vᵀ M V = I: every mode gets the damping ratio `zeta`, that of
/// an oscillator of at least `omega_free`, rad/s. For diagonal matrices 2 zeta √(S M).
Eigen::Matrix3d modal_damping(const Eigen::Matrix3d& M, const Eigen::Matrix3d& S, double zeta, double omega_free);

/// The exact solution of M ẍ + D ẋ + S x = u0 + u1 t over a span, as second_order.h has it for one direction.
class Propagator {
 public:
  /// Prepares spans of `h` > 0 seconds. Returns at once if nothing has changed since the last call.
  void prepare(const Impedance& impedance, double h);
  void advance(Eigen::Vector3d& x, Eigen::Vector3d& dx, const Eigen::Vector3d& u0, const Eigen::Vector3d& u1) const;

 private:
  Impedance impedance_;
  double h_ = 0;
  // [x; ẋ](h) = (U + E) [x; ẋ](0) + Γ0 u0 + Γ1 u1. E is stored without the unit matrix U, so that small changes keep all digits.
  Eigen::Matrix3d xx_, xv_, vx_, vv_, x0_, v0_, x1_, v1_;
};

}  // namespace cotwin::compliance
