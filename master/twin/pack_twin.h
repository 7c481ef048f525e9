#pragma once
#include "master/twin/package.h"

namespace cotwin::master {

/// Writes a scenario as one FMU that stands alone, with the master inside: a Twin (twin.h) whose outputs are what the scenario
/// records. A component that is an FMU travels along, unpacked. Returns the warnings of the units. Throws Error as loading and
/// wiring do, for an FMU that is to run in a process of its own or has no library for one of the platforms, and for a scenario
/// that asks for an adaptive communication step.
std::vector<std::string> pack_twin(const Scenario& scenario, const PackageOptions& options, const std::filesystem::path& out);

}  // namespace cotwin::master
