#pragma once
#include <array>
#include <cmath>
#include <optional>
#include <string>

namespace cotwin::anomaly {

/// How well a twin renders torques: the RMS of the residual over the joint's limit of torque (IV). Nothing where the limit is not known.
inline std::optional<double> maturity(double rms, double limit) {
  return limit > 0 && std::isfinite(limit) ? std::optional(rms / limit) : std::nullopt;
}

/// Whether a joint's torque is not that of the tuned robot: beyond the last band; without a limit, a residual larger than the torque itself. Where half
/// of the joints that move are so, it is another robot.
inline bool beyond(double rms, double torque_rms, double limit) {
  constexpr double kLastBand = 0.04;
  const std::optional<double> index = maturity(rms, limit);
  return index ? *index > kLastBand : rms > torque_rms;
}

/// The band of an index.
inline std::string maturity_band(const std::optional<double>& index) {
  if (!index) return "unknown: the joint has no limit of torque";
  return *index <= 0.01 ? "up to 1 %" : *index <= 0.025 ? "1 to 2.5 %" : *index <= 0.04 ? "2.5 to 4 %" : "beyond 4 %";
}

/// The largest discrepancies of the paper's LWR 4+ (Table I, N.m) over its limits of torque, in percent: for comparison.
inline constexpr std::array<double, 7> kPaperMaturity = {100 * 4.22 / 176, 100 * 4.32 / 176, 2.33, 3.66, 0.71,
                                                         100 * 0.73 / 38,  100 * 0.09 / 38};

}  // namespace cotwin::anomaly
