#pragma once
#include <filesystem>
#include <iosfwd>
#include <span>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// Returns all errors and warnings of a scenario (.ssd, .ssp) that can be found in one pass. Loads each component and checks
/// each connector, start value, connection, event, recording, report and bond by itself, and then the loops (check_coupling). A
/// scenario that cannot be read gives one error.
std::vector<fmu::Finding> check_scenario(const std::filesystem::path& file, std::span<const UnitType> types,
                                         const std::vector<std::filesystem::path>& folders);

/// Writes a readable summary of a scenario: time, settings, components, connections and events.
void write_info(std::ostream& out, const Scenario& scenario);

}  // namespace cotwin::master
