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
  kDriven,   // follows a prescribed twist
  kFloating  // dynamic; must have an inertia
};

/// Indices of a robot's bodies and joints in a scene.
struct Assembled {
  std::size_t base = 0;             // body of the base
  std::vector<std::size_t> bodies;  // body of each body of the RobotModel, in its order
  std::vector<std::size_t> joints;  // joint that moves each body of the RobotModel, in its order
};

/// Adds a robot to a scene: its base at X_WB, its bodies with their frames, and its joints with their limits, at q (rad, m) and
/// q̇ of the independent joints, with a gear for each mimic. The joints have no friction and damping: those belong to the drive train (2b). Names are those of the model after
/// `prefix`. Throws Error if q or dq does not have n elements or a floating base has no physical inertia.
Assembled assemble(scene::Scene& scene, const robot::RobotModel& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq, const std::string& prefix = "");

/// As above, with the robot's shapes; the prefix is the robot's name and a slash.
Assembled assemble(scene::Scene& scene, const scene::PlacedRobot& robot, const Pose& X_WB, Base base, std::span<const double> q,
                   std::span<const double> dq);

}  // namespace cotwin::contact_world
