#pragma once
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::identification {

/// B, kg·m², of motors that were found to have none: torques may say so where the link's inertia stands for the motor's, but a
/// drive train divides by B. A thousandth of what the joint moves at q = 0 is of no account in any torque.
std::vector<double> least_motor_inertia(const robot::RobotModel& robot);

}  // namespace cotwin::identification
