#pragma once
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/export/pack.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

struct PackageOptions {
  std::span<const UnitType> types;
  std::vector<std::filesystem::path> folders;  // where units search for named data
  fmu::Version version = fmu::Version::k2;     // FMI version of the packed units
  std::vector<std::string> platforms;          // as in fmu::PackRequest
  std::filesystem::path libraries;
  std::vector<std::filesystem::path> libraries_of_modules = {};
};

/// Writes a scenario as a self-contained SSP 1.0 package (.ssp): SystemStructure.ssd, and in resources/ an FMU for each
/// component (units are packed, FMUs are copied). The scenario's start values are in the system structure. Nested systems are
/// flattened; the Cotwin annotation is kept. Strings that the scenario gives a unit, also file names, become start values inside its
/// FMU, and so do the values that connected inputs have after the initialisation, for hosts that exchange none before the first
/// step. Run by this master, the package gives the same bits as the scenario. Returns the warnings of the units, and one where the
/// scenario cannot be initialised here. Throws Error as loading and wiring do, and for a foreign FMU that is not an archive.
std::vector<std::string> pack_scenario(const Scenario& scenario, const PackageOptions& options,
                                       const std::filesystem::path& out);

}  // namespace cotwin::master
