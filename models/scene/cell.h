#pragma once
#include <string>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A robot in a scene.
struct PlacedRobot {
  std::string name;  // "" for a single robot
  robot::RobotModel model;
  std::vector<std::vector<Shape>> shapes;  // of the base, then of each body of the model, in its frame
};

/// A scene and its robots.
struct Cell {
  Scene scene;
  std::vector<PlacedRobot> robots;
};

}  // namespace cotwin::scene
