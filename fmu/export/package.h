#pragma once
#include <memory>
#include <string>
#include <string_view>

#include "components/unit/snapshot.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

namespace cotwin::fmu {

/// The data from which an exported unit is built: the file kPackageFile in the FMU's folder resources/. It replaces URDF, SDF,
/// SSV and the scenario's defaults, so that the shared library needs no XML reader. Other files of the unit (recordings) are in
/// the same folder.
struct Package {
  std::string token;                               // the instantiation token (FMI 2: GUID) that the host must pass
  std::string unit;                                // "drive_train"
  std::string query;                               // its settings, "robot=lwr4&link_side=inside"
  std::shared_ptr<const robot::RobotModel> robot;  // nullptr if the unit has none; without what RobotModel leaves out
  std::shared_ptr<const scene::Cell> cell;         // nullptr if the unit has none; likewise for its robots
  Snapshot start;                                  // the start values of all variables

  static auto fields(auto& p, auto each) { return each(p.token, p.unit, p.query, p.robot, p.cell, p.start); }
};

inline constexpr const char* kPackageFile = "unit.bin";

/// Writes a package with a version and a hash.
std::string serialise(const Package& package);
/// Reads a package. Throws Error `place: …` for bytes that are damaged or not a package of this version.
Package deserialise_package(std::string_view bytes, const std::string& place);

}  // namespace cotwin::fmu
