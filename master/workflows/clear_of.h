#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "master/scenario/scenario.h"
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

/// What is nearer than this to the hulls of a robot that was scanned, too, is a point of the robot, m.
inline constexpr double kOwn = 0.01;

/// Whether the robot that a unit:motion of a scenario moves keeps clear on straight ways between postures, of surroundings and of itself, with the tools
/// that the scenario mounts at any time. Other robots rest where they start.
class LegCheck {
 public:
  /// Throws Error.
  LegCheck(const Scenario& scenario, const std::string& motion, const Surroundings& around, std::span<const UnitType> types);
  const std::vector<std::string>& notes() const { return notes_; }
  /// "link_5 meets table"; "" for a way that is clear.
  std::string meets(std::span<const double> from, std::span<const double> to);

 private:
  std::optional<collision::Checker> checker_;
  std::vector<collision::Motion> motions_;
  std::vector<std::string> notes_;
};

/// What the desired motions of the joints in a scenario come near to: a note for each unit:motion that keeps clear, an error with the leg between
/// two waypoints for one that does not. `surroundings`: names for surroundings(). Robots carry the tools that events of the scenario mount, and meet the other robots, each in its own motion.
/// They stand where contact worlds and monitors of the scenario, or `bases` (texts for read_base()), have them. Throws Error.
std::vector<fmu::Finding> check_clear(const std::filesystem::path& scenario, std::span<const UnitType> types,
                                      const std::vector<std::string>& surroundings, const std::vector<std::string>& bases);

}  // namespace cotwin::master
