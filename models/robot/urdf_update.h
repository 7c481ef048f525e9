#pragma once
#include <string>
#include <string_view>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// The URDF `xml` with the mass distribution, joint damping and friction of `robot`, which was read from it: visuals,
/// collisions, transmissions and whatever else it holds stay. A moving body's whole inertia stands at the link that its joint
/// moves, and links that are rigid on it have none; bodies whose inertia is not other than the file's keep it as it was
/// written. Reads back to the robot's bodies to the last bit. Throws Error `place: …` if the file has not the links of the
/// robot.
std::string updated_urdf(std::string_view xml, const std::string& place, const RobotModel& robot);

}  // namespace cotwin::robot
