#pragma once
#include <string>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

/// What Settings::robot() and Settings::cell() read from files and keep in a FileStore.
namespace cotwin {

struct FoundRobot {
  robot::RobotModel model;
  std::vector<std::string> warnings;
};

struct FoundCell {
  scene::Cell cell;
  std::vector<std::string> warnings;
};

/// Beginnings of their keys.
inline constexpr const char* kRobotKey = "robot\n";
inline constexpr const char* kCellKey = "cell\n";

}  // namespace cotwin
