#pragma once
#include <vector>

#include "components/drive_train/equations.h"
#include "components/drive_train/step_account.h"

namespace cotwin::drive_train {

/// The linearly implicit method for hard real time: two stages of order 2 and a third stage for the error, after Shampine and
/// Reichelt (SIAM J. Sci. Comput. 18(1), 1997, "modified Rosenbrock formula"). It is L-stable and of order 2 for any W, so W
/// needs only the stiff terms:
///   W k1 = F0 + γ ∂f/∂t                      W = I − γ J, γ = d h, d = 1/(2 + √2)
///   W (k2 − k1) = F1 − k1                    F1 = f(t + h/2, x + h/2 k1)
///   x1 = x + h k2                            F2 = f(t + h, x1), F0 of the next sub-step
///   W k3 = F2 − (6 + √2)(k2 − F1) − 2 (k1 − F0) + γ ∂f/∂t,   error = h/6 (k1 − 2 k2 + k3)
/// Departures: (i) rows of speeds are multiplied by M and B, so that no stage needs M⁻¹; (ii) in F1 and F2, M(x₀) q̈ is M(x₀) a
/// + (force − inverse dynamics of a) with a = k1 or k2; the error (M − M(x₀)) (q̈ − a) = O(h²) keeps order 2, and this costs one
/// recursion instead of a mass matrix and its factors; (iii) the error of z, which follows θ̇ and has no tolerance, is not
/// counted; (iv) z is clamped to the range of exact solutions, so that sub-steps beyond the tolerance stay bounded.
class Rosenbrock {
 public:
  explicit Rosenbrock(Equations& equations);

  /// One sub-step of length h from x at time t, with the forces `p0` there. Writes the state at its end to x1 and the forces there
  /// to p1. Returns the estimated error over its tolerance, NaN if something is not finite.
  double attempt(double t, double h, const double* x, const Tolerances& tolerances, const Point& p0, double* x1, Point& p1);

 private:
  Equations& equations_;
  Point stage_;
  std::vector<double> rhs_, k1_, k2_, k3_, f0_, f1_, tau_;
};

}  // namespace cotwin::drive_train
