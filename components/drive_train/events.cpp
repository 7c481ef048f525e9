#include "components/drive_train/events.h"

#include <algorithm>
#include <cmath>

namespace cotwin::drive_train {
namespace {

// The torque that friction has to hold on a motor at rest: (2b), (2c) with θ̈ = θ̇ = 0.
double held_load(const Equations& e, std::size_t i, double t, const double* x) {
  const std::size_t n = e.n();
  const double tau_J = e.joint_torque(i, x[2 * n + i] - x[i], -x[n + i]).torque;
  return e.motor_torque(i, t) - tau_J - e.parameters().tau_0[i];
}

bool motors_stick(const Equations& e) { return e.friction() == Friction::kCoulomb; }

}  // namespace

std::size_t event_count(const Equations& e) { return (motors_stick(e) ? e.n() : 0) + (e.has_stops() ? e.n() : 0); }

void event_values(const Equations& e, double t, const double* x, double* values) {
  const std::size_t n = e.n();
  if (motors_stick(e)) {
    for (std::size_t i = 0; i < n; ++i) {
      *values++ = e.stuck(i) ? e.bristle(i).tau_S - std::abs(held_load(e, i, t, x)) : e.modes().slip[i] * x[3 * n + i];
    }
  }
  if (e.has_stops()) {
    const Parameters& p = e.parameters();
    for (std::size_t i = 0; i < n; ++i) {
      const double above = x[i] - p.q_min[i], below = p.q_max[i] - x[i];
      const int side = e.modes().stop[i];
      *values++ = p.stop_stiffness[i] <= 0 ? 1 : side > 0 ? -below : side < 0 ? -above : std::min(above, below);
    }
  }
}

void apply_event(Equations& e, std::size_t event, double t, double* x) {
  const std::size_t n = e.n();
  if (motors_stick(e)) {
    if (event < n) {
      double& dtheta = x[3 * n + event];
      auto& slip = e.modes().slip[event];
      dtheta = 0;
      const double load = held_load(e, event, t, x);
      // A sticking motor breaks away in the direction of the load; at the zero itself |load| = τ_S.
      slip = slip == 0 ? (load > 0 ? 1 : -1) : robot::StickSlip::mode_at_rest(e.bristle(event), load);
      return;
    }
    event -= n;
  }
  auto& side = e.modes().stop[event];
  if (side != 0) {
    side = 0;
  } else {
    const Parameters& p = e.parameters();
    side = p.q_max[event] - x[event] < x[event] - p.q_min[event] ? 1 : -1;
    e.modes().impact[event] = std::max(side * x[n + event], 0.0);
  }
}

bool settle_modes(Equations& e, double* x, bool afresh) {
  const std::size_t n = e.n();
  bool changed = false;
  const auto set = [&changed](auto& mode, int value) {
    changed |= mode != value;
    mode = value;
  };
  if (motors_stick(e)) {
    for (std::size_t i = 0; i < n; ++i) {
      const double dtheta = x[3 * n + i];
      if (dtheta == 0) {
        set(e.modes().slip[i], robot::StickSlip::mode_at_rest(e.bristle(i), held_load(e, i, 0, x)));
      } else if (afresh) {
        set(e.modes().slip[i], dtheta > 0 ? 1 : -1);
      }
    }
  }
  if (afresh && e.has_stops()) {
    const Parameters& p = e.parameters();
    for (std::size_t i = 0; i < n; ++i) {
      const bool stops = p.stop_stiffness[i] > 0;
      set(e.modes().stop[i], stops && x[i] > p.q_max[i] ? 1 : stops && x[i] < p.q_min[i] ? -1 : 0);
      e.modes().impact[i] = e.modes().stop[i] == 0 ? 0 : std::max(e.modes().stop[i] * x[n + i], 0.0);
    }
  }
  return changed;
}

}  // namespace cotwin::drive_train
