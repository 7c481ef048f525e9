#pragma once
#include <span>
#include <string>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Position at the start where the user gives none: 0, or where the limits exclude it their middle (with one limit: that limit).
double default_start(const Joint& joint);

/// Throws Error `place.q0[i]: …` for a position at the start that is beyond the limits q_min and q_max, with the tolerance that
/// waypoints have (10⁻⁹ of the range), or larger than 10⁶ rad or m. All have one value per joint.
void check_start(const std::string& place, std::span<const Joint> joints, std::span<const double> q0,
                 std::span<const double> q_min, std::span<const double> q_max);
/// With the limits of the robot.
void check_start(const std::string& place, const RobotModel& robot, std::span<const double> q0);

}  // namespace cotwin::robot
