#pragma once
#include <string>
#include <vector>

#include "master/workflows/starter/sketch.h"

namespace cotwin::master::starter {

/// How the scenario names its robot.
struct Naming {
  std::string scenario;    // name of the scenario
  std::string robot;       // the setting `robot`: a name, or a path from the scenario's folder
  std::string lock;        // the setting `lock`, or ""
  std::string unphysical;  // the setting `unphysical`
};

/// A file in the scenario's folder.
struct File {
  std::string name, text;
};

/// The files of the scenario, twin.ssd first: start values and, for a contact, scene and probe.
std::vector<File> files_of(const Sketch& sketch, const robot::RobotModel& robot, const Naming& naming);

}  // namespace cotwin::master::starter
