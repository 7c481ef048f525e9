#pragma once
#include "master/twin/package.h"

namespace cotwin::master {

/// Writes a scenario as one self-contained FMU that includes the master: a Twin (twin.h) with the recorded variables as
/// outputs. Components that are FMUs are included, unpacked. Returns the warnings of the units. Throws Error as loading and
/// wiring do, for an FMU that must run in a process of its own or has no library for one of the platforms, and for a scenario
/// with a tolerance.
std::vector<std::string> pack_twin(const Scenario& scenario, const PackageOptions& options, const std::filesystem::path& out);

}  // namespace cotwin::master
