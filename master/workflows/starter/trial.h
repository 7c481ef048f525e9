#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/workflows/starter/sketch.h"

namespace cotwin::master::starter {

/// Runs a scenario of `cotwin new` to its end, without a recording, and compares it with what its introduction promises: the drives follow
/// the compliant motion within 5 mrad or 5 mm, deviations are tau_e / S_a within 10 %, and the force at rest is that of the sketch within
/// 10 %. Throws Error for a run that fails or breaks a promise.
void try_scenario(const std::filesystem::path& twin, const Sketch& sketch, const robot::RobotModel& robot,
                  std::span<const UnitType> types);

/// Runs the first second of a scenario with a contact. Returns which bodies touch before the probe can, as "'a' and 'b' touch each other",
/// or the reason why the world cannot go on; nullopt if nothing touches.
std::optional<std::string> touching_at_start(const std::filesystem::path& twin, const robot::RobotModel& robot,
                                             std::span<const UnitType> types);

}  // namespace cotwin::master::starter
