#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "master/ssp/scenario.h"

namespace cotwin::master {

struct PackageOptions {
  std::span<const UnitType> types;
  std::vector<std::filesystem::path> folders;  // where units look up named data
  fmu::Version version = fmu::Version::k2;     // of the FMUs that units become
  std::vector<std::string> platforms;          // as in fmu::PackRequest
  std::filesystem::path libraries;
  std::vector<std::filesystem::path> libraries_of_modules = {};
};

/// Writes a scenario as an SSP 1.0 package (.ssp) that stands alone: SystemStructure.ssd, and in resources/ an FMU for each
/// component, the units' own packed and foreign ones copied, with an SSV of the start values that the scenario gives. Nested
/// systems are dissolved; our annotation is kept. Texts that the scenario gives a unit, file names among them, are start values
/// inside its FMU. Run in this master the package gives the same bits as the scenario. Returns the warnings of the units.
/// Throws Error as loading and wiring do, and for a foreign FMU that is no archive.
std::vector<std::string> pack_scenario(const Scenario& scenario, const PackageOptions& options,
                                       const std::filesystem::path& out);

}  // namespace cotwin::master
