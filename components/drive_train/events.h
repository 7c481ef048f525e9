#pragma once
#include <cstddef>
#include <span>

#include "components/drive_train/equations.h"

/// Discrete modes of the drive train: motors that stick or slip (Friction::kCoulomb), links in their stops. Each mode has an
/// event function, which is positive while the mode lasts; its zero is the event:
///   slipping motor in direction d   d θ̇                         the motor comes to rest: it sticks or reverses
///   sticking motor                  τ_S − |τ_m − τ_J − τ_0|      the motor breaks away
///   link in a stop                  depth                       the link leaves the stop
///   free link                       min(q − q_min, q_max − q)   the link meets the nearer stop
namespace cotwin::drive_train {

/// Number of event functions: n each for motors and links, where the variant has them.
std::size_t event_count(const Equations& equations);

/// Their values at (t, x), of length event_count. Allocates nothing.
void event_values(const Equations& equations, double t, const double* x, double* values);

/// Changes the mode of event function `event`, which is at its zero, and sets x to exactly that zero (θ̇ = 0).
void apply_event(Equations& equations, std::size_t event, double t, double* x);

/// Sets the modes for x and the course at t = 0, the beginning of a step or a run: motors at rest stick or break away under the
/// new torques. With `afresh` also the modes of moving motors and of links beyond their limits are determined. Returns whether
/// any mode changed.
bool settle_modes(Equations& equations, double* x, bool afresh);

}  // namespace cotwin::drive_train
