#pragma once
#include "master/package.h"

namespace cotwin::master {

/// Writes a scenario as one FMU that stands alone, with the master inside: a Twin (twin.h) whose outputs are what the scenario
/// records. Returns the warnings of the units. Throws Error as loading and wiring do, for a component that is itself an FMU,
/// and for a scenario that asks for an adaptive communication step.
std::vector<std::string> pack_twin(const Scenario& scenario, const PackageOptions& options, const std::filesystem::path& out);

}  // namespace cotwin::master
