#pragma once
#include <string>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {

/// One task of the motion of the joints: directions of the compliance frame E, or of another frame of the robot that is held.
struct TaskEntry {
  std::string name;             // as in the setting
  bool held = false;            // another frame
  robot::FrameOnBody frame;     // of a held one
  std::vector<int> directions;  // x, y, z, rx, ry, rz in the base's axes as indices; of a held frame x, y, z only
};

/// The tasks of the setting `tasks`, highest first, separated by commas: `pose`, `position`, `orientation`, x, y, z, rx, ry, rz
/// of E; FRAME or FRAME:x, FRAME:y, FRAME:z: the position of a frame of the robot is held, or one coordinate of it. Empty:
/// `pose`. `rendered`: the directions of E that the compliance renders; each must be in exactly one task, the others are left
/// out. Throws Error at `place`.
std::vector<TaskEntry> task_list(const std::string& place, const std::string& tasks, const std::vector<int>& rendered,
                                 const robot::RobotModel& robot);

/// The number of rows of each task.
std::vector<int> row_counts(const std::vector<TaskEntry>& tasks);

}  // namespace cotwin::compliance
