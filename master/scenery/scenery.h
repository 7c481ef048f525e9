#pragma once
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/scenario/scenario.h"
#include "master/scenery/cell_of.h"
#include "master/scenery/recorded.h"
#include "models/mechanics/inertia.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

/// What is on the stage of a page: robots, what moves them, and the bodies around them. Found by the names of settings and variables, so that no
/// unit is made.
namespace cotwin::master {

/// A robot with its file, from which visuals and collision shapes are read.
struct StagedModel {
  std::shared_ptr<const robot::RobotModel> model;
  std::filesystem::path urdf;
};

/// Where the base of a robot is: its start, and the signals of its motion, which may not be recorded.
struct StagedBase {
  Pose X_WB;
  std::string p, quat;
};

/// Joint positions that a recording has of a robot.
struct StagedTrack {
  enum class Role { kMain, kDesired, kCompliant, kOther };
  Role role = Role::kOther;
  std::string signal;              // n elements
  std::optional<StagedBase> base;  // its own, not the robot's
};

/// A tool that events of the scenario mount on a robot and remove.
struct StagedTool {
  std::string name;
  int body = -1;                // that carries it; −1: the base
  Pose X_BA;                    // the tool's frame in that of the body
  Inertia inertia;              // in A
  double from = 0;              // s, of the simulation
  std::optional<double> until;  // s; none: to the end
  std::filesystem::path urdf;   // with its collision shapes; empty without
};

/// One robot on the stage: the components that compute or control it.
struct StagedRobot {
  std::string name;
  std::size_t model = 0;                // in Scenery::models
  std::vector<std::string> prefixes;    // of its variables: "drive.", "world.left."
  std::vector<std::string> components;  // "drive", "world"
  std::vector<StagedTrack> tracks;      // the main one first
  std::vector<StagedTool> tools;        // in the order of their events
  StagedBase base;
  std::string by;          // who places its base: "world", "monitor.left"; "": nobody
  bool fed = false;        // a connection moves the base from the start on
  bool floats = false;     // its base moves
  std::vector<double> q0;  // n
};

/// A body of a component.
struct StagedBody : collision::PlacedCell::Body {
  std::string component, prefix;  // of its variables: "world.block"
  bool comes = false;             // an obstacle of a monitor
  bool appears = false;           // by an event
  std::string fed_by = {};        // prefix of the body whose pose a connection gives it from the start on; "": none
  bool shown = true;              // on a page; others are there as those of another component
};

/// A component with a scene, a cloud or robots in it.
struct StagedCell {
  std::string component, ignore;
  std::shared_ptr<const scene::Cell> cell;
};

struct Scenery {
  std::vector<StagedModel> models;
  std::vector<StagedRobot> robots;
  std::vector<StagedCell> cells;
  std::vector<StagedBody> bodies;                    // of contact worlds, then of monitors, then of scanners
  std::vector<collision::PlacedCell::Cloud> clouds;  // of monitors, without points
  Differing differing;
  std::vector<std::string> worlds;    // components with a contact world
  std::set<std::string> ghosts;       // those of which all robots are ghosts of others
  std::vector<std::string> monitors;  // prefixes of the distances of monitors: "monitor.left."
  std::vector<std::string> scanners;  // prefixes of profiles: "scanner."
  std::vector<std::string> remarks;
};

/// Whether a variable belongs to such a world.
bool is_of_ghost(const Scenery& stage, std::string_view variable);

/// The stage of a scenario with its recording. Components whose robot or scene cannot be read are left out, with a remark. Without `values` those of the texts; with them it throws Error instead. `models`: as for Settings.
Scenery scenery_of(const Scenario& scenario, const Recorded& recorded, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders, const StartValues& values = {},
                   const std::shared_ptr<FileStore>& models = nullptr);

/// A stage with one robot whose joints follow all recorded signals with names of positions and as many elements as joints: q, q_d, q_c,
/// q_link, also after a component's name.
Scenery scenery_of(const StagedModel& model, const Recorded& recorded);

}  // namespace cotwin::master
