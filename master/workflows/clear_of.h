#pragma once
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "master/scenario/scenario.h"
#include "master/scenery/cell_of.h"
#include "models/collision/meeting/meeting.h"

/// Whether motions of a scenario meet anything.
namespace cotwin::master {

/// Quintics through samples of q, q̇, q̈ (n each, row by row) at times.
trajectory::Path path_of(std::size_t joints, const std::vector<double>& t, const std::vector<double>& rows);

/// What is nearer than this to the hulls of a robot that was scanned, too, is a point of the robot, m.
inline constexpr double kOwn = 0.01;

/// Whether the robot that a unit:motion of a scenario moves keeps clear on straight ways between postures, of what stands around it and of itself, with
/// the tools that the scenario mounts at any time. Other robots rest where they start.
class LegCheck {
 public:
  /// Throws Error.
  LegCheck(const Scenario& scenario, const std::string& motion, const CellRequest& request, std::span<const UnitType> types);
  const std::vector<std::string>& notes() const { return notes_; }
  const std::vector<collision::Place>& places() const { return places_; }
  /// "link_5 meets table"; "" for a way that is clear.
  std::string meets(std::span<const double> from, std::span<const double> to);

 private:
  std::optional<collision::Checker> checker_;
  std::vector<collision::Motion> motions_;
  std::vector<std::string> notes_;
  std::vector<collision::Place> places_;
};

/// What the desired motions of the joints in a scenario come near to: a note for each robot that keeps clear, an error with the leg between two waypoints
/// for one that does not. `names`, `bases`: of a CellRequest. Robots carry the tools that events of the scenario mount, and meet the other robots,
/// each in its own motion. A warning for what two components place differently. Throws Error.
std::vector<fmu::Finding> check_clear(const std::filesystem::path& scenario, std::span<const UnitType> types,
                                      const std::vector<std::string>& names, const std::vector<std::string>& bases);

}  // namespace cotwin::master
