#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "models/collision/meeting/meeting.h"

/// Whether motions of a scenario meet anything.
namespace cotwin::master {

/// What motions keep clear of.
struct Surroundings {
  scene::Scene scene;
  std::vector<collision::PlacedCloud> clouds;  // in W, with balls that touch
};
/// Of a scene and a point cloud, each at most once, in any order: paths (a cloud by its ending), or NAME of scenes/NAME/scene.sdf or, where there is
/// none, scenes/NAME/scene.pcd of the model folders. With a floor at that height, m, the solid below it. `notes`: what their readers warn of. Throws
/// Error.
Surroundings surroundings(const std::vector<std::string>& names, std::optional<double> floor, std::vector<std::string>& notes);

/// "NAME: x y z roll pitch yaw" in m and rad, the angles and "NAME:" optional, as a name and the pose of a base. Throws Error with `option`.
std::pair<std::string, Pose> read_base(const std::string& text, const std::string& option = "--base");

/// Quintics through samples of q, q̇, q̈ (n each, row by row) at times.
trajectory::Path path_of(std::size_t joints, const std::vector<double>& t, const std::vector<double>& rows);

/// What the desired motions of the joints in a scenario come near to: a note for each unit:motion that keeps clear, an error with the leg between
/// two waypoints for one that does not. `surroundings`: names for surroundings(). Robots carry the tools that events of the scenario mount, and meet the other robots, each in its own motion.
/// They stand where contact worlds and monitors of the scenario, or `bases` (texts for read_base()), have them. Throws Error.
std::vector<fmu::Finding> check_clear(const std::filesystem::path& scenario, std::span<const UnitType> types,
                                      const std::vector<std::string>& surroundings, const std::vector<std::string>& bases);

}  // namespace cotwin::master
