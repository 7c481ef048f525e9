#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/workflows/starter/files.h"
#include "master/workflows/starter/sketch.h"
#include "models/robot/robot_model.h"

namespace cotwin::master::starter {

/// What the user chose.
struct Request {
  std::string robot;  // absolute path of a URDF, or the name of a robot
  Kind kind = Kind::kMotion;
  std::string lock;
  std::string end_effector;          // "": flange() of the robot
  std::string unphysical = "error";  // the setting
  std::string units;                 // of the URDF: robot::parse_urdf_units; "": SI, checked
};

/// A scenario that was tried.
struct Starter {
  std::string robot;  // name in the URDF
  robot::RobotModel model;
  Sketch sketch;
  std::string lock, unphysical;  // the settings
  std::string converted;         // the URDF in SI, for robot.urdf; "": the robot is used as it is
  std::vector<File> companions;  // of the robot, that go with robot.urdf: drive_train.ssv, energy.ssv

  /// `robot_setting`: how the scenario names its robot.
  std::vector<File> files(const std::string& scenario, const std::string& robot_setting) const;
};

/// Chooses the numbers of a first scenario and tries it (try_scenario): for a contact several postures and directions, at first with the
/// collision shapes of the links. Joints whose limits are equal are locked there. Throws Error where nothing runs; if it would with other
/// options, the message ends in a line "it runs with: OPTIONS", which was tried too; where these have other units than SI, in "if its numbers are in these
/// units it runs with: OPTIONS; if they are in SI: --urdf-units si", because a trial cannot tell units apart.
Starter make_starter(const Request& request, std::span<const UnitType> types);

}  // namespace cotwin::master::starter
