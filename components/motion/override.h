#pragma once
#include <algorithm>
#include <cmath>

#include "components/unit/variables.h"
#include "models/trajectory/time_scaling.h"

namespace cotwin::motion {

/// Slows a motion along its path: with the rate r of path time, q_d(t) = q(t − delay) and
///   q̇_d = q̇ r,   q̈_d = q̈ r² + q̇ ṙ
/// r follows the input `speed`. ṙ is constant in a step and bounded, so that the path is kept exactly and stopping takes its time. At r = 1 the motion
/// is the planned one to the last bit, if it has no delay.
class Override {
 public:
  void declare(Variables& v) {
    v.input("speed", speed_, "1",
            "share of the planned speed along the path, 0 (rest) to 1; values outside count as the nearest, NaN as 0");
    v.output("path_speed", rate_, "1", "share in force, which follows speed as fast as speed_ramp and ddq_limit allow");
    v.output("delay", delay_, "s", "by how much the motion is later than planned");
    v.parameter("speed_ramp", ramp_, "s",
                "shortest time in which path_speed goes from 1 to 0 or back; longer where q̈_d would exceed ddq_limit")
        .range(1e-6, 1e6);
  }
  void begin() {
    rate_ = wanted();
    delay_ = change_ = 0;
  }
  /// The least and the largest ṙ that the limits allow, 1/s; 0 is between them.
  struct Range {
    double low, high;
  };
  /// Follows `speed` over a step of length h, s. `range`: of the delay and the rate at its end.
  template <class F>
  void advance(double h, F&& range) {
    const double most = 1 / ramp_, rate = wanted();
    change_ = std::clamp((rate - rate_) / h, -most, most);
    // The limits at the step's end depend on ṙ; those at its beginning are close to them.
    constexpr int kRounds = 3;
    for (int k = 0; k <= kRounds && change_ != 0; ++k) {
      const Range allowed = k == 0 ? range(delay_ + h, rate_) : range(delay_after(h), rate_ + change_ * h);
      change_ = std::clamp(change_, allowed.low, allowed.high);
    }
    delay_ = delay_after(h);
    const double next = rate_ + change_ * h;
    rate_ = std::abs(next - rate) < kReached ? rate : next;
  }
  double delay() const { return delay_; }
  trajectory::Phase::Value slowed(const trajectory::Phase::Value& s) const {
    return {s.s, s.ds * rate_, s.dds * rate_ * rate_ + s.ds * change_, 0};
  }

 private:
  static constexpr double kReached = 1e-12;

  double wanted() const { return std::isnan(speed_) ? 0 : std::clamp(speed_, 0.0, 1.0); }
  double delay_after(double h) const { return delay_ + (h - (rate_ + change_ * h / 2) * h); }

  double speed_ = 1, ramp_ = 0.25;
  double rate_ = 1, delay_ = 0;
  double change_ = 0;  // ṙ of the last step, 1/s
};

}  // namespace cotwin::motion
