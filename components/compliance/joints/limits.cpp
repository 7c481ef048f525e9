#include "components/compliance/joints/limits.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::compliance {
namespace {

constexpr double kAny = std::numeric_limits<double>::infinity();
constexpr double kRetreat = 1;      // rad/s, after a desired motion jumped beyond a limit, if there is no limit of speed
constexpr double kRounding = 1e-9;  // relative tolerance for a desired motion at its limit

struct Bound {
  double dx, x;
};

/// Bounds that keep Δ below a wall, which is at `wall` ≥ 0 at the end of the step and moves at `wall_speed`. With
/// w = Δ̇ − wall_speed and constant acceleration, the gap at the end is
///   A − h w/2,   A = wall − Δ − h (Δ̇ + wall_speed)/2     with (Δ, Δ̇) at the start,
/// and w² ≤ 2 b (A − h w/2) leaves the distance for braking with b, h w/2 ≤ A − h w/2 that for a stop within the next step. A < 0: Δ
/// stops within the step.
Bound below(double wall, double wall_speed, const Limits& limits, const Deviation& start, double h) {
  const double b = limits.braking;
  const double gap = wall - h * wall_speed - start.x;  // at the start
  const double A = wall - start.x - h * (start.dx + wall_speed) / 2;
  double w = A > 0 ? std::min(2 * A / (h / 2 + std::sqrt(h * h / 4 + 2 * A / b)), A / h) : 0.0;
  // A desired motion that jumps towards its limit moves Δ, but not faster than the joint may move.
  const double retreat = limits.bound_speed() ? limits.dq_max : kRetreat;
  if (gap < 0) w = std::max(gap / h, -retreat);
  // The wall moves Δ back at most to 0: the desired motion is never restricted.
  const double back_to_0 = start.x > 0 ? -start.x / h : 0.0;
  return {std::max(w + wall_speed, back_to_0), std::max(wall, start.x - h * (retreat + std::abs(wall_speed)))};
}

}  // namespace

Allowed allowed(const Limits& limits, const Desired& desired, const Deviation& start, double h) {
  Allowed a{-kAny, kAny, -kAny, kAny, Limit::kNone, Limit::kNone};
  if (limits.bound_position()) {
    // Relative to a desired motion inside its limits the wall moves; otherwise the wall is at the desired motion.
    const double above = limits.q_max - desired.q, under = desired.q - limits.q_min;
    const Bound high = below(std::max(above, 0.0), above > 0 ? -desired.dq : 0.0, limits, start, h);
    const Bound low = below(std::max(under, 0.0), under > 0 ? desired.dq : 0.0, limits, {-start.x, -start.dx}, h);
    a = {-low.dx, high.dx, -low.x, high.x, Limit::kPosition, Limit::kPosition};
  }
  if (limits.bound_speed()) {
    const double dq_max = limits.dq_max * (1 + kRounding);
    const double fastest = std::max(dq_max - desired.dq, 0.0), slowest = std::min(-dq_max - desired.dq, 0.0);
    if (fastest < a.dx_high) {
      a.dx_high = fastest;
      a.high = Limit::kSpeed;
    }
    if (slowest > a.dx_low) {
      a.dx_low = slowest;
      a.low = Limit::kSpeed;
    }
  }
  return a;
}

bool outside(const Limits& limits, const Desired& desired) {
  const double slack = kRounding * (limits.q_max - limits.q_min);
  return (limits.bound_position() && (desired.q > limits.q_max + slack || desired.q < limits.q_min - slack)) ||
         (limits.bound_speed() && std::abs(desired.dq) > limits.dq_max * (1 + kRounding));
}

}  // namespace cotwin::compliance
