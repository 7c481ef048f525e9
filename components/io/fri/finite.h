#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>

#include "components/io/fri/fri.h"
#include "models/mechanics/pose.h"

namespace cotwin::fri {

/// The first n values.
inline bool all_finite(const Joints& values, std::size_t n) {
  return std::all_of(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n),
                     [](double x) { return std::isfinite(x); });
}

inline bool is_finite(const Pose& X) { return X.R.allFinite() && X.p.allFinite(); }

/// Up to the rounding of single floats, and what clients with little care for it send; false for numbers that are not finite.
inline bool is_nearly_rotation(const Eigen::Matrix3d& R) {
  constexpr double kTolerance = 1e-3;
  const Eigen::Matrix3d error = R * R.transpose() - Eigen::Matrix3d::Identity();
  return (error.array().abs() < kTolerance).all() && R.determinant() > 0;
}

}  // namespace cotwin::fri
