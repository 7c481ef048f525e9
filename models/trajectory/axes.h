#pragma once
#include <cstddef>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "models/trajectory/time_scaling.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::robot {
struct RobotModel;
}

namespace cotwin::trajectory {

/// What a motion must know of a joint: its name and, in rad or m, what it may do.
struct Axis {
  std::string name;  // "joint 2" where there is no robot
  bool revolute = true;
  double q_min = -std::numeric_limits<double>::infinity();
  double q_max = +std::numeric_limits<double>::infinity();
  double dq_max = +std::numeric_limits<double>::infinity();
  double ddq_max = +std::numeric_limits<double>::infinity();
  double dddq_max = +std::numeric_limits<double>::infinity();
  friend bool operator==(const Axis&, const Axis&) = default;
};

std::vector<Axis> axes_of(const robot::RobotModel& robot);
/// `n` revolute joints without limits.
std::vector<Axis> free_axes(std::size_t n);

/// What the motion `path`, run through by `phase`, does beyond a joint's limits, as a sentence with joint, value, time and
/// limit; empty if nothing. Velocities are judged at the phase's full rate. `tolerance` is a share of the limit (of a position:
/// of the range).
std::string limit_violation(const Path& path, const Phase& phase, std::span<const Axis> axes, double tolerance = 1e-9);

}  // namespace cotwin::trajectory
