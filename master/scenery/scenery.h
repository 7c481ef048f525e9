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
  bool in_world = false;   // its base has a place: in a contact world, before a monitor or scanner, or floating
  std::vector<double> q0;  // n
};

struct StagedBody {
  scene::Body body;
  std::string prefix;             // of its variables: "world.block"
  bool comes = false;             // an obstacle of a monitor
  double present = 1, scale = 1;  // of an obstacle, at the start
};

/// The point cloud of a monitor.
struct StagedCloud {
  std::string name;  // of the monitor
  std::filesystem::path file;
  Pose X_WC;
};

struct Scenery {
  std::vector<StagedModel> models;
  std::vector<StagedRobot> robots;
  std::vector<StagedBody> bodies;
  std::vector<StagedCloud> clouds;
  std::vector<std::string> worlds;    // components with a contact world
  std::set<std::string> ghosts;       // those of which all robots are ghosts of others
  std::vector<std::string> monitors;  // prefixes of the distances of monitors: "monitor.left."
  std::vector<std::string> scanners;  // prefixes of profiles: "scanner."
  std::vector<std::string> remarks;
};

/// Whether a variable belongs to such a world.
bool is_of_ghost(const Scenery& stage, std::string_view variable);

/// The stage of a scenario with its recording. Components whose robot or scene cannot be read are left out, with a remark.
Scenery scenery_of(const Scenario& scenario, const Recorded& recorded, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders);

/// A stage with one robot whose joints follow all recorded signals with names of positions and as many elements as joints: q, q_d, q_c,
/// q_link, also after a component's name.
Scenery scenery_of(const StagedModel& model, const Recorded& recorded);

/// The values of a parameter of a component that the scenario gives, such as "0 0 0.5" as three numbers; `numbers` if it gives none, with the
/// elements that it gives alone.
std::vector<double> given_numbers(const Scenario& scenario, const std::string& component, const std::string& parameter,
                                  std::vector<double> numbers = {});

}  // namespace cotwin::master
