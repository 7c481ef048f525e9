#pragma once
#include <cstddef>
#include <span>

#include "components/drive_train/equations.h"

/// The discrete half of the drive train: motors that stick or slip (Friction::kCoulomb), links in their stops. An event is the
/// zero of one of these functions, which are positive while the mode lasts:
///   slipping motor      d θ̇                        ends at rest: sticks or turns round
///   sticking motor      τ_S − |τ_m − τ_J − τ_0|     breaks away
///   link in a stop      depth                      leaves it
///   free link           q − q_min, q_max − q       comes to the nearer one
namespace cotwin::drive_train {

/// Number of event functions: n each for motors and links, where the variant has them.
std::size_t event_count(const Equations& equations);

/// Their values at (t, x), of length event_count. Allocates nothing.
void event_values(const Equations& equations, double t, const double* x, double* values);

/// Changes the mode whose event function is `event`, at its zero, and puts x exactly there (θ̇ = 0).
void apply_event(Equations& equations, std::size_t event, double t, double* x);

/// Modes that agree with x and the course at t = 0, at the beginning of a step or a run: motors at rest stick or break away
/// under the new torques; with `afresh` those of moving motors and of links beyond their limits are found as well. Returns
/// whether any mode has changed.
bool settle_modes(Equations& equations, double* x, bool afresh);

}  // namespace cotwin::drive_train
