#pragma once
#include <cstdint>

#include "components/compliance/joints/second_order.h"

namespace cotwin::compliance {

/// Limits of the compliant motion of a joint (IV-A3), from its URDF.
struct Limits {
  double q_min = 0, q_max = 0;  // rad; q_min >= q_max: no limit
  double dq_max = 0;            // rad/s; 0: no limit
  double braking = 10;          // rad/s²; deceleration before a limit of position, > 0

  bool bound_position() const { return q_min < q_max; }
  bool bound_speed() const { return dq_max > 0; }
};

/// Which limit acts on a joint.
enum class Limit : std::int32_t { kNone = 0, kPosition = 1, kSpeed = 2 };

/// The desired motion of a joint at the end of a step.
struct Desired {
  double q = 0, dq = 0;
};

/// Bounds of the velocity of the deviation Δ = q_c − q_d at the end of a step, and of Δ in both directions.
struct Allowed {
  double dx_low, dx_high;
  double x_low, x_high;
  Limit low, high;  // the limits behind dx_low and dx_high
};

/// The limits as one-sided walls for the compliant motion q_c = q_d + Δ. At distance s from a limit of position, q_c approaches
/// it with at most √(2 braking s): it stops at the limit with the deceleration `braking`, without passing it or rebounding. A
/// wall only takes kinetic energy. Limits bound the compliant deviation: Δ = 0 is always allowed, also if the desired motion
/// itself is outside its limits. Δ is assumed to have constant acceleration over the step.
Allowed allowed(const Limits& limits, const Desired& desired, const Deviation& start, double h);

/// Returns whether q_c at the end of a step of h seconds is inside the limits and slow enough to stop there, in steps of h; then
/// allowed() is not needed.
inline bool clear_of(const Limits& limits, const Desired& desired, const Deviation& end, double h) {
  const double q = desired.q + end.x, dq = desired.dq + end.dx;
  if (limits.bound_speed() && !(dq <= limits.dq_max && dq >= -limits.dq_max)) return false;
  if (!limits.bound_position()) return true;
  const double ahead = dq > 0 ? limits.q_max - q : q - limits.q_min;
  return q <= limits.q_max && q >= limits.q_min && dq * dq <= 2 * limits.braking * ahead &&
         h * (dq > 0 ? dq : -dq) <= 2 * ahead;
}

/// Returns whether the desired motion itself is outside its limits.
bool outside(const Limits& limits, const Desired& desired);

}  // namespace cotwin::compliance
