#include "models/anomaly/cusum.h"

#include <cmath>

namespace cotwin::anomaly {

namespace {
constexpr double kOvershoot = 1.166;  // of a random walk over both boundaries, 2 · 0.583
}

double run_length(double k, double h) {
  const double x = 2 * k * (h + kOvershoot);
  return (std::expm1(x) - x) / (2 * k * k);
}

double threshold(double k, double length) {
  double low = 0, high = 1;
  while (run_length(k, high) < length) high *= 2;
  for (int i = 0; i < 60; ++i) {
    const double middle = 0.5 * (low + high);
    (run_length(k, middle) < length ? low : high) = middle;
  }
  return high;
}

}  // namespace cotwin::anomaly
