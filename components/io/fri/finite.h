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

}  // namespace cotwin::fri
