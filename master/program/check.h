#pragma once
#include <filesystem>
#include <iosfwd>
#include <span>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "master/ssp/scenario.h"

namespace cotwin::master {

/// Everything that is wrong with a scenario (.ssd, .ssp) and can be found in one go: each component is loaded, each connector,
/// start value, connection, event, recording, report and bond looked at for itself; nothing is stepped. A scenario that cannot
/// be read is one error.
std::vector<fmu::Finding> check_scenario(const std::filesystem::path& file, std::span<const UnitType> types,
                                         const std::vector<std::filesystem::path>& folders);

/// What a scenario is, for people: its time, components and connections.
void write_info(std::ostream& out, const Scenario& scenario);

}  // namespace cotwin::master
