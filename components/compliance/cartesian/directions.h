#pragma once
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {

/// The components of a twist [v; ω] in the base's axes that `task` names, x, y, z, rx, ry, rz separated by commas, as indices;
/// empty: all six. Throws Error at `place` that says what the robot can render if it cannot render these together.
std::vector<int> rendered_directions(const std::string& place, const std::string& task, const robot::RobotModel& robot,
                                     const robot::FrameOnBody& frame);

}  // namespace cotwin::compliance
