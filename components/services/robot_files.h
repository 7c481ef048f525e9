#pragma once
#include "components/services/robots.h"

/// The files beside a URDF, for the sources of this folder. Both throw Error with file and line for a name that the unit does not have, a
/// value out of range, and another unit of measure than that of the unit's variable.
namespace cotwin::services {

DriveData load_drives(const std::filesystem::path& file, const robot::RobotModel& robot);
EnergyData load_energy(const std::filesystem::path& file, const robot::RobotModel& robot);

}  // namespace cotwin::services
