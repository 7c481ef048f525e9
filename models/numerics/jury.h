#pragma once
#include <cstddef>
#include <span>

namespace cotwin::numerics {

/// Whether all zeros of the polynomial c[0] zⁿ + c[1] zⁿ⁻¹ + … + c[n] lie inside the unit circle, so that the sequence
/// c[0] x(k) + c[1] x(k − 1) + … = 0 decays (Jury's criterion). c[0] ≠ 0, n ≤ kMaxDegree. A zero on the circle to rounding may
/// count as either. Throws Error for other polynomials.
bool is_stable_polynomial(std::span<const double> c);

inline constexpr std::size_t kMaxDegree = 63;

}  // namespace cotwin::numerics
