#pragma once
#include <string>
#include <string_view>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// Returns the URDF `xml` with the mass distribution, joint damping and friction of `robot`, which was read from it; all other
/// elements are kept. The whole inertia of a changed body is written to the link that its joint moves, and links fixed to that
/// have none; unchanged bodies keep their elements, and mimics theirs, except that damping and friction of a group with changed
/// ones are written to its leader. Locked joints (RobotModel::locked) become fixed ones at their position. The result loads with the robot's bodies to the last bit. Throws Error
/// `place: …` if the file does not have the links of the robot.
std::string updated_urdf(std::string_view xml, const std::string& place, const RobotModel& robot);

}  // namespace cotwin::robot
