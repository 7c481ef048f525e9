#pragma once
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "models/robot/robot_model.h"

namespace cotwin::robot {

/// A robot with its history, as it is kept in a history file (IV-A2).
struct RobotHistory {
  std::string name;                     // of the robot
  std::string source;                   // file or robot from which it was read, for people; may be empty
  std::vector<std::string> components;  // of the scenario whose model this is; empty outside of a run
  RobotModel robot;                     // after the last change; before() and changes_until() give earlier configurations

  friend bool operator==(const RobotHistory&, const RobotHistory&) = default;
};

/// Writes a history file (JSON): the initial robot as URDF, and each change with time, reason, name, parent frame, pose, inertia
/// and the resulting inertia of the body that carries it. Numbers are written such that they are read back to the last bit.
/// Throws Error for a robot that a URDF cannot represent (to_urdf) or a number that is not finite.
std::string to_json(std::span<const RobotHistory> histories);

/// Reads a history file by replaying its changes on the initial robot. Throws Error `place: …` for text that is not JSON, missing,
/// unknown and ill-typed members, decreasing times, changes that the robot does not permit (attach(), detach(), set_inertia())
/// and a resulting inertia that differs from the file's by more than rounding.
std::vector<RobotHistory> parse_history(std::string_view json, const std::string& place);

}  // namespace cotwin::robot
