#pragma once
#include <memory>
#include <string>
#include <string_view>

#include "components/unit/snapshot.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

namespace cotwin::fmu {

/// What an exported unit is built from: its file kPackageFile in the archive's folder resources/. It stands in for URDF, SDF,
/// SSV and the scenario's defaults, so that the shared library needs no XML. Other files of the unit (recordings) lie beside
/// it.
struct Package {
  std::string token;                               // the instantiation token (FMI 2: GUID) that the host must know
  std::string unit;                                // "drive_train"
  std::string query;                               // its settings, "robot=lwr4&link=inside"
  std::shared_ptr<const robot::RobotModel> robot;  // nullptr if the unit has none; without its history
  std::shared_ptr<const scene::Cell> cell;         // nullptr if the unit has none; without its robots' histories
  Snapshot start;                                  // the start values of all variables
};

inline constexpr const char* kPackageFile = "unit.bin";

/// Versioned, with a hash over all bytes.
std::string serialise(const Package& package);
/// Throws Error `place: …` for bytes that are not a package of this version, or are damaged.
Package deserialise_package(std::string_view bytes, const std::string& place);

}  // namespace cotwin::fmu
