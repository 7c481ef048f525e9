#pragma once
#include <string>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A robot that stands in a scene.
struct PlacedRobot {
  std::string name;  // "" for the only one
  robot::RobotModel model;
  std::vector<std::vector<Shape>> shapes;  // of the base, then of each body of the model, in its frame
};

/// All that a contact world is made of.
struct Cell {
  Scene scene;
  std::vector<PlacedRobot> robots;
};

}  // namespace cotwin::scene
