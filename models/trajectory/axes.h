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

/// Name and limits of a joint, in rad or m.
struct Axis {
  std::string name;  // "joint 2" without a robot
  bool revolute = true;
  double q_min = -std::numeric_limits<double>::infinity();
  double q_max = +std::numeric_limits<double>::infinity();
  double dq_max = +std::numeric_limits<double>::infinity();
  double ddq_max = +std::numeric_limits<double>::infinity();
  double dddq_max = +std::numeric_limits<double>::infinity();
  double tau_max = +std::numeric_limits<double>::infinity();  // N.m or N
  friend bool operator==(const Axis&, const Axis&) = default;
};

std::vector<Axis> axes_of(const robot::RobotModel& robot);
/// `n` revolute joints without limits.
std::vector<Axis> free_axes(std::size_t n);

/// Checks the motion `path` with phase `phase` against the joint limits. Returns the first violation as a sentence with joint,
/// value, time and limit, or an empty string. Velocities are those at the phase's full rate. `tolerance` is relative to the
/// limit (position: to the range).
std::string limit_violation(const Path& path, const Phase& phase, std::span<const Axis> axes, double tolerance = 1e-9);

}  // namespace cotwin::trajectory
