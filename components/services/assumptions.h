#pragma once
#include <string>
#include <vector>

#include "components/services/robots.h"

namespace cotwin::services {

/// What an answer rests on without anybody having told or measured it.
struct Assumption {
  std::string what;           // "inertia of motors"
  std::vector<double> value;  // that counts: one for all joints or one per joint; empty: none, or those of several parameters
  std::string effect;         // "durations, torques and power are too small"
  std::string file;           // that has the value, or would have it
  bool unknown = false;       // nobody has told the value; else a file of the robot calls it assumed
};

/// What an answer needs.
struct Needs {
  std::string without_drives;  // why inertia and friction of the motors do not count; "": they do
  bool searched = false;       // a duration that was searched
  bool contact = false;        // the mass in a collision
  bool limits_of_speed = true, limits_of_torque = true;
  double load = 0;       // kg, which the motion does not know
  bool elastic = false;  // stiffness of joints, bristles
  bool energy = false;   // of the mains
};

/// Data of the drives, energy data and limits that the robot does not have, that its files call `assumed`, or that the request leaves out.
std::vector<Assumption> assumptions(const Robot& robot, const Needs& needs);

/// Why the motors of the robot are unknown, as a sentence; "" if their inertias are known.
std::string unknown_motors(const Robot& robot);

}  // namespace cotwin::services
