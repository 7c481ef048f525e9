#pragma once
#include <string>
#include <string_view>
#include <vector>

#include "models/robot/robot_model.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A robot in a scene.
struct PlacedRobot {
  std::string name;  // "" for a single robot
  robot::RobotModel model;
  std::vector<std::vector<Shape>> shapes;  // of the base, then of each body of the model, in its frame

  static auto fields(auto& r, auto each) { return each(r.name, r.model, r.shapes); }
  friend bool operator==(const PlacedRobot&, const PlacedRobot&) = default;
};

/// A scene and its robots.
struct Cell {
  Scene scene;
  std::vector<PlacedRobot> robots;

  static auto fields(auto& c, auto each) { return each(c.scene, c.robots); }
  friend bool operator==(const Cell&, const Cell&) = default;
};

/// A frame on a body of a robot or of the scene.
struct PlacedFrame {
  int robot = -1;  // index; −1: of the scene
  int body = -1;   // of the robot (−1: its base) or of the scene (−1: the world)
  Pose X_BF;
};

/// The frame ROBOT/FRAME, FRAME of the only robot, BODY, or BODY/FRAME (MODEL/FRAME) of the scene. Throws Error at `where` with what there is.
PlacedFrame find_frame(const Cell& cell, std::string_view name, const std::string& where);

}  // namespace cotwin::scene
