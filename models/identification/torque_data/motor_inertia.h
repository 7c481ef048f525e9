#pragma once
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::identification {

/// Least motor inertia per joint, kg·m²: a thousandth of the inertia that the joint moves at q = 0; 0 for a
/// passive joint. It replaces an identified B
/// of 0, because a drive train divides by B. Torques may give B = 0 where the inertia of the link includes that of the motor; a
/// thousandth has no measurable effect on a torque.
std::vector<double> least_motor_inertia(const robot::RobotModel& robot);

}  // namespace cotwin::identification
