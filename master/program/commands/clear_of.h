#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "fmu/check/check.h"
#include "models/clearance/clearance.h"

/// Collisions for commands.
namespace cotwin::master {

/// The scene at a path, or scenes/NAME/scene.sdf of the model folders; "": an empty one. With a floor at that height, m, the solid below it.
/// Throws Error.
scene::Scene scene_with(const std::string& name, std::optional<double> floor);

/// Quintics through samples of q, q̇, q̈ (n each, row by row) at times.
trajectory::Path path_of(std::size_t joints, const std::vector<double>& t, const std::vector<double>& rows);

/// What the desired motions of the joints in a scenario come near to: a note for each unit:motion that keeps clear, an error with the leg between
/// two waypoints for one that does not. Robots stand where contact worlds and monitors of the scenario have them. Throws Error.
std::vector<fmu::Finding> check_clear(const std::filesystem::path& scenario, const std::string& scene);

}  // namespace cotwin::master
