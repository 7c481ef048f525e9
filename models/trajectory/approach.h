#pragma once
#include <algorithm>
#include <cmath>

namespace cotwin::trajectory {

/// The largest speed towards a place at a distance ≥ 0 from which steps of h seconds end there with the deceleration a (∞: not limited).
inline double approach_speed(double distance, double a, double h) {
  if (std::isinf(a)) return distance / h;
  return std::min(distance / h, std::sqrt(a * h * a * h / 4 + 2 * a * distance) - a * h / 2);
}

}  // namespace cotwin::trajectory
