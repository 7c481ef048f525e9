#pragma once
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

enum class Base {
  kFixed,    // a static body
  kDriven,   // moves as it is told
  kFloating  // a body like the others; must have an inertia
};

/// Which bodies and joints of a scene are a robot's.
struct Assembled {
  std::size_t base = 0;             // body of the base
  std::vector<std::size_t> bodies;  // of each body of the RobotModel, in its order
  std::vector<std::size_t> joints;  // of each joint of the RobotModel, in its order
};

/// Adds a robot to a scene: its base and bodies with their frames, and its joints with their limits; at X_WB, q (rad, m) and q̇.
/// Friction and damping of the joints are the drive train's (2b), so the scene's joints have none. Bodies and joints are named
/// as in the model, behind `prefix`. Throws Error if q or dq is not of n numbers, or a floating base has no physical inertia.
Assembled assemble(scene::Scene& scene, const robot::RobotModel& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq, const std::string& prefix = "");

/// The same with its shapes; the prefix is the robot's name and a slash.
Assembled assemble(scene::Scene& scene, const scene::PlacedRobot& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq);

}  // namespace cotwin::contact_world
