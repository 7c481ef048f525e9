#pragma once
#include "models/energetics/drives.h"

namespace cotwin::energetics {

/// What a robot takes while it waits at rest, and whether closing the brakes pays. While brakes close and open, the motors hold:
///   held     E = (P_0 + P_brake + P_hold) t
///   closed   E = (P_0 + P_brake + P_hold) (t_close + t_release) + P_off (t − t_close − t_release) + E_release
struct Waiting {
  double energy = 0;      // J, of the cheaper way
  double held = 0;        // J
  double closed = 0;      // J; infinity if the time is too short for closing and opening
  bool closes = false;    // the brakes close
  double break_even = 0;  // s, the shortest wait for which closing pays; infinity if it never does
};

/// A wait of `t` ≥ 0 seconds with the motors' losses `P_hold` (W) for holding the pose.
Waiting wait(const Standby& standby, double P_hold, double t);

}  // namespace cotwin::energetics
