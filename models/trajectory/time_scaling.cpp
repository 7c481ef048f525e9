#include "models/trajectory/time_scaling.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::trajectory {

namespace {

/// The rate x³(10 − 15x + 6x²) over x in [0, 1], its integral and its derivatives.
Phase::Value ramp(double x) {
  const double r = 1 - x;
  return {x * x * x * x * (2.5 + x * (x - 3)), x * x * x * (10 + x * (6 * x - 15)), 30 * x * x * r * r,
          60 * x * r * (1 - 2 * x)};
}

constexpr double kSteepest = 1.875;            // max 30x²(1 − x)²
const double kSharpest = 10 / std::sqrt(3.0);  // max |60x(1 − x)(1 − 2x)|

}  // namespace

Phase::Phase(double length, double stretch, double ramp_up, double ramp_down)
    : length_(length), stretch_(stretch), up_(ramp_up), down_(ramp_down) {
  if (!(stretch > 0)) throw Error("time scaling", "factor " + text::to_text(stretch) + ", expected > 0");
  if (!(ramp_up >= 0) || !(ramp_down >= 0) || ramp_up + ramp_down > 2 * length) {
    throw Error("time scaling", "soft start of " + text::to_text(ramp_up) + " s and stop of " + text::to_text(ramp_down) +
                                    " s, expected >= 0 and together at most twice the motion's " + text::to_text(length) +
                                    " s");
  }
}

double Phase::duration() const { return stretch_ * (length_ + 0.5 * (up_ + down_)); }

Phase::Value Phase::at(double t) const {
  const double x = t / stretch_;                          // time before stretching
  const double left = length_ + 0.5 * (up_ + down_) - x;  // until the end
  if (x < 0) return {};
  if (left < 0) return {length_, 0, 0, 0};
  Value v{x - 0.5 * up_, 1, 0, 0};
  if (x < up_) {
    const Value r = ramp(x / up_);
    v = {up_ * r.s, r.ds, r.dds / up_, r.ddds / (up_ * up_)};
  } else if (left < down_) {
    const Value r = ramp(left / down_);
    v = {length_ - down_ * r.s, r.ds, -r.dds / down_, r.ddds / (down_ * down_)};
  }
  const double rate = 1 / stretch_;
  return {std::clamp(v.s, 0.0, length_), v.ds * rate, v.dds * rate * rate, v.ddds * rate * rate * rate};
}

double Phase::time_of(double s) const {
  if (s <= 0) return 0;
  double before = 0, after = duration();
  for (int i = 0; i < 60; ++i) {  // s(t) is monotonic
    const double middle = 0.5 * (before + after);
    (at(middle).s < s ? before : after) = middle;
  }
  return after;
}

Phase::Value Phase::largest() const {
  const double rate = 1 / stretch_;
  Value v{length_, rate, 0, 0};
  for (const double duration : {up_, down_}) {
    if (duration == 0) continue;
    v.dds = std::max(v.dds, kSteepest / duration * rate * rate);
    v.ddds = std::max(v.ddds, kSharpest / (duration * duration) * rate * rate * rate);
  }
  return v;
}

void apply_chain_rule(const Phase::Value& phase, std::span<double> dq, std::span<double> ddq, std::span<double> dddq) {
  const double v = phase.ds, a = phase.dds;
  for (std::size_t j = 0; j < dq.size(); ++j) {
    if (!dddq.empty()) dddq[j] = dddq[j] * v * v * v + 3 * ddq[j] * v * a + dq[j] * phase.ddds;
    ddq[j] = ddq[j] * v * v + dq[j] * a;
    dq[j] *= v;
  }
}

double bound(const Path& path, const Phase& phase, std::size_t joint, int derivative) {
  std::array<double, 3> largest{};
  for (int order = phase.largest().dds > 0 ? 1 : derivative; order <= derivative; ++order) {
    largest[static_cast<std::size_t>(order - 1)] = std::abs(path.range(joint, order).largest().value);
  }
  return bound(largest, phase, derivative);
}

double bound(const std::array<double, 3>& largest, const Phase& phase, int derivative) {
  const Phase::Value s = phase.largest();
  if (derivative == 1) return largest[0] * s.ds;
  if (derivative == 2) return largest[1] * s.ds * s.ds + largest[0] * s.dds;
  assert(derivative == 3);
  return largest[2] * s.ds * s.ds * s.ds + 3 * largest[1] * s.ds * s.dds + largest[0] * s.ddds;
}

double stretch_to(const Path& path, const Phase& phase, std::span<const Limits> limits) {
  assert(limits.size() == path.joints());
  double factor = 0;
  for (std::size_t j = 0; j < limits.size(); ++j) {
    const double limit[] = {limits[j].dq, limits[j].ddq, limits[j].dddq};
    for (int derivative = 1; derivative <= 3; ++derivative) {
      const double most = limit[derivative - 1];
      if (!(most > 0))
        throw Error("time scaling", "limit " + text::to_text(most) + " of joint " + std::to_string(j + 1) + ", expected > 0");
      if (std::isinf(most)) continue;
      factor = std::max(factor, std::pow(bound(path, phase, j, derivative) / most, 1.0 / derivative));
    }
  }
  return factor;
}

}  // namespace cotwin::trajectory
