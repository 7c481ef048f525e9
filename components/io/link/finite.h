#pragma once
#include <cmath>

namespace cotwin::io {

inline double finite(double value, double otherwise) { return std::isfinite(value) ? value : otherwise; }

}  // namespace cotwin::io
