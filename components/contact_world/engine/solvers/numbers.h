#pragma once
#include <cstddef>
#include <limits>

namespace cotwin::contact_world {

inline constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Numbers of bodies, rows and islands are int; containers are indexed by std::size_t.
inline std::size_t index(int i) { return static_cast<std::size_t>(i); }

/// aᵀ b; both have n values. The sum is in the order of the values.
inline double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

}  // namespace cotwin::contact_world
