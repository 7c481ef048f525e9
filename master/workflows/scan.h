#pragma once
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "models/cloud/tree.h"
#include "models/collision/cell/placed_cell.h"
#include "models/mechanics/pose.h"
#include "models/scene/cell.h"

/// A cell that a scanner on a robot measures: postures, profiles, and the cloud that they give (VI-F, Fig. 16).
namespace cotwin::master {

/// Where a scanner is fixed, among what it measures.
struct ScannerSite {
  std::string name;          // of the component
  scene::Cell cell;          // with its bodies where they start
  scene::PlacedFrame frame;  // on a robot
  std::string prefix;        // of the variables of that robot: "", "left."
  Pose X_FS;
  bool floating = false;
};
/// Of the unit:scanner `name`, or the only one for "". Throws Error for none, for several, and for one that is on no robot.
ScannerSite site_of(const Scenario& scenario, const std::string& name, std::span<const UnitType> types);

struct ScanRequest {
  std::vector<double> at;          // first posture; empty: where the motion of the scenario begins
  double step = 0.05;              // of the last joint, rad or m
  int count = 61;                  // postures
  std::filesystem::path postures;  // in place of the three: waypoints, whose times do not count
  double settle = 0.5;             // between the arrival and the profile, s
  std::vector<std::string> clear_of;
};

/// A scenario that goes through postures, rests in each and triggers a profile there.
struct ScanPlan {
  Scenario scenario;
  std::string motion;  // the component that goes through them
  std::vector<std::vector<double>> postures;
  std::vector<std::string> skipped, notes;  // sentences
  std::vector<collision::Place> places;     // what the ways were checked against
};
/// Replaces the waypoints of the motion that moves the scanner's robot, its triggers and the stop time. A posture beyond limits of the joints, or to
/// which the robot would not keep clear, of what the scanner and monitors watch, of `clear_of` (names of a CellRequest) and of itself, with its tools, is left out; other robots are
/// taken to rest. Throws Error, also if no posture is left.
ScanPlan plan_scan(const Scenario& scenario, const ScannerSite& site, const ScanRequest& request,
                   std::span<const UnitType> types);

/// The text of a scenario for a file in `folder`, to which relative names of files are turned.
std::string scenario_text(const Scenario& scenario, std::span<const UnitType> types, const std::filesystem::path& folder);

/// Gathers the points of profiles while a run goes on.
class ProfileTaker {
 public:
  /// `posture`: a signal with the positions of the joints by which points are placed, "" for those of the links, which the scanner has. `mounting`: the
  /// scanner in its frame by which they are placed. Throws Error.
  ProfileTaker(Master& master, const ScannerSite& site, const std::string& posture, const std::optional<Pose>& mounting);
  ~ProfileTaker();
  /// After the initialisation, and after each tick.
  void take();

  std::size_t profiles() const { return profiles_; }
  std::size_t empty_profiles() const { return empty_; }  // without a range
  std::size_t own_points() const { return own_; }        // on robots and their tools: left out
  const std::vector<Eigen::Vector3d>& points() const { return points_; }

 private:
  struct Robots;
  std::unique_ptr<Robots> robots_;
  const ScannerSite& site_;
  Pose X_FS_;
  std::size_t profiles_ = 0, empty_ = 0, own_ = 0;
  std::vector<Eigen::Vector3d> points_;
};

/// How well a cloud shows the bodies of a scene.
struct ScanFigures {
  struct OfBody {
    std::string name;
    std::optional<double>
        seen;  // share of its surface with a point of the cloud nearer than twice the spacing; none without area
  };
  cloud::Spacing spacing{};
  std::vector<OfBody> bodies;
  double rms = std::nan(""), largest = std::nan("");  // distance of the points from the scene, m; no number without bodies
};
/// Bodies that move are taken where they start.
ScanFigures judge_scan(std::shared_ptr<const cloud::Tree> tree, const scene::Scene& scene);

}  // namespace cotwin::master
