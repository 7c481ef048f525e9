#pragma once
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

namespace cotwin::anomaly {

/// Values of successive blocks are alike: with thresholds of independent values, healthy robots raise alarms within seconds. A first-order
/// autoregression takes that out,
///   w_b = (z_b − ρ z_{b−1}) / √(1 − ρ²)
/// and of a lasting shift of z by δ it leaves δ √((1 − ρ)/(1 + ρ)).
struct Whitening {
  double rho = 0;
  double operator()(double z, double before) const { return (z - rho * before) / std::sqrt(1 - rho * rho); }
  double gain() const { return std::sqrt((1 - rho) / (1 + rho)); }
};

/// Σ x_b x_{b−1} / Σ x_b² over the values; 0 for fewer than two, or if all are 0.
inline double correlation(std::span<const double> x) {
  double product = 0, square = 0;
  for (std::size_t b = 0; b < x.size(); ++b) {
    if (b > 0) product += x[b] * x[b - 1];
    square += x[b] * x[b];
  }
  return square > 0 ? product / square : 0;
}

/// The autoregression of one series of `count` values among others: its own correlation, drawn to that of all, `pooled`, as far as its values are
/// few, and freed of the bias −(1 + 4ρ)/count that estimates from few values have (Kendall, Biometrika 41, 1954). Within 0 to 0.9.
inline Whitening whitening(double correlation, double pooled, double count) {
  constexpr double kPooled = 20;  // values that the pooled correlation counts as
  const double rho = (count * correlation + kPooled * pooled) / (count + kPooled);
  return {std::clamp(rho + (1 + 4 * rho) / count, 0.0, 0.9)};
}

}  // namespace cotwin::anomaly
