#pragma once

#include "components/drive_train/equations.h"

namespace cotwin::drive_train {

/// rad/s, rad or N.m: an event function this close to zero is at it.
inline constexpr double kOnTheEvent = 1e-10;

struct Tolerances {
  double relative = 0;
  double angle = 0;  // rad, of q and θ
  double speed = 0;  // rad/s, of q̇ and θ̇
};

/// Energy flows of a step and the quality of its solution.
struct StepAccount {
  double work_m = 0;      // ∫ τ_m θ̇ dt, J
  double work_e = 0;      // ∫ τ_e q̇ dt, J; link outside: −∫ τ_J q̇ dt
  double dissipated = 0;  // in friction, damping and stops, J
  double error = 0;       // largest local error estimate over tolerance; ≤ 1 unless substeps were forced
  int substeps = 0;       // accepted
  int forced = 0;         // of them, accepted beyond the tolerance because max_substeps was reached
  int events = 0;
};

/// Adds the work of the course's torques over [t, t + h], in which x goes from x0 to x1: exact for held torques, of fourth
/// order for ramped ones.
void add_torque_work(const Equations& equations, double t, double h, const double* x0, const double* x1, StepAccount& account);

}  // namespace cotwin::drive_train
