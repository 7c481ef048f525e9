#pragma once
#include <cstdint>

#include "components/compliance/second_order.h"

namespace cotwin::compliance {

/// What a joint may do in its compliant motion (IV-A3), as its URDF says.
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

/// Velocities that a deviation Δ = q_c − q_d may have at the end of a step, and the largest |Δ| in either direction.
struct Allowed {
  double dx_low, dx_high;
  double x_low, x_high;
  Limit low, high;  // what bounds dx_low and dx_high
};

/// The limits as one-sided walls on the compliant motion q_c = q_d + Δ. Before a limit of position at distance s, q_c
/// approaches it with at most √(2 braking s), so it stops there with the deceleration `braking`, does not pass it and is not
/// thrown back. A wall only takes kinetic energy. Limits bound what compliance adds: Δ = 0 is always allowed, also where the
/// desired motion itself is outside its limits. Over a step, Δ is taken to move with constant acceleration.
Allowed allowed(const Limits& limits, const Desired& desired, const Deviation& start, double h);

/// Whether Δ at the end of a step needs no limit: q_c is inside, and slow enough to stop there. What allowed() costs is saved.
inline bool clear_of(const Limits& limits, const Desired& desired, const Deviation& end) {
  const double q = desired.q + end.x, dq = desired.dq + end.dx;
  if (limits.bound_speed() && !(dq <= limits.dq_max && dq >= -limits.dq_max)) return false;
  if (!limits.bound_position()) return true;
  const double ahead = dq > 0 ? limits.q_max - q : q - limits.q_min;
  return q <= limits.q_max && q >= limits.q_min && dq * dq <= 2 * limits.braking * ahead;
}

/// Whether the desired motion itself is outside its limits.
bool outside(const Limits& limits, const Desired& desired);

}  // namespace cotwin::compliance
