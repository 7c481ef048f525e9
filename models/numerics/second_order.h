#pragma once

namespace cotwin::numerics {

/// One mass–damper–spring: M ẍ + D ẋ + S x = u, with M > 0, D ≥ 0, S ≥ 0.
struct SecondOrder {
  double M = 1, D = 0, S = 0;
};

struct Deviation {
  double x = 0, dx = 0;
};

/// The state after `h` seconds under the input u(t) = u0 + u1 t: the exact solution to rounding for any h > 0, for free (S =
/// 0), undamped (D = 0), stiff and overdamped systems. N short steps give the same result as one long step.
Deviation advance(const SecondOrder& system, const Deviation& start, double u0, double u1, double h);

/// ẍ from the equation above.
inline double acceleration(const SecondOrder& system, const Deviation& at, double u) {
  return (u - system.D * at.dx - system.S * at.x) / system.M;
}

}  // namespace cotwin::numerics
