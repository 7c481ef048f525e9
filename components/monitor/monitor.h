#pragma once
#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "components/monitor/parts.h"
#include "components/unit/event_ports.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/cloud/tree.h"
#include "models/collision/cell/cell.h"
#include "models/collision/meeting/sweep.h"

namespace cotwin::monitor {

/// Distances of robots that move, from each other, from the bodies of a scene and from themselves (VI-F: safety hulls, imminent collisions). All
/// outputs are functions of the inputs at the step's end, and of those at its beginning; nothing acts on the robots, unless `speed` is connected to
/// their motions (separation.h).
///
/// Shapes of robots are inflated by r, so that the distance of a robot's link from a body is d − r, and of two robots' links d − 2 r; links of one
/// robot are not inflated towards each other. The pairs are those of models/collision/cell.
///   ḋ = nᵀ (v_b − v_a) at the nearest points        time_to_contact = −d / ḋ
/// least_distance: the least one since the last step, with joints (and positions of bodies) linear in between, and orientations at constant angular
/// velocity. Nothing is passed, however thin it is (sweep.h): the sign is exact; the value is too large by at most 5 % of how far the pair
/// can have moved, 0.1 % of itself, or 1 µm.
class Monitor final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  /// Throws Error for a robot without shapes, for shapes whose distance is not measured, and for unknown names in `ignore` and `obstacles`.
  explicit Monitor(Settings& settings);

  void declare(Variables& v) override;
  /// Throws Error for quaternions whose length is not 1.
  void initialise(Time start) override;
  /// Throws Error if an input is not finite, but for bodies from which robots keep their distance.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void append_notes(std::vector<std::string>& notes) const override;

 private:
  std::vector<std::size_t> bodies_of(const std::string& setting, const std::string& names) const;
  void add_parts(Settings& settings);
  void add_obstacles(const std::string& names);
  void add_cloud(Settings& settings);
  void add_separation(Settings& settings);
  void declare_ports(Variables& v, Ports& ports, const std::string& prefix, const std::string& of);
  void declare_separation(Variables& v);
  void check_inputs(Time now) const;
  void place_static();
  void place(Time now, Duration h);
  void place_obstacle(std::size_t part);
  void measure();
  void measure(std::size_t pair);
  void remember();
  void write_outputs();
  void write(std::size_t group, int robot, Ports& ports) const;
  Twist twist_of(std::size_t part) const;
  double speed_of(std::size_t part) const;

  // separation.cpp
  void keep_separation(double t, double h);

  // sweep.cpp: least_distance
  void find_motions();
  void sweep();
  double motion(std::size_t part) const;
  Pose pose_at(std::size_t part, double share);

  /// Groups of pairs: 2 i with others of robot i, 2 i + 1 of links of robot i.
  std::size_t groups() const { return 2 * robots_.size(); }
  std::array<std::size_t, 2> groups_of(const collision::Pair& pair) const;
  double inflation(const collision::Pair& pair) const;
  Robot& robot_of(const collision::Part& part) const { return *robots_[static_cast<std::size_t>(part.robot)]; }

  std::string place_;  // for messages
  scene::Cell given_;
  bool floating_, separates_;
  collision::Cell cell_;  // its first parts are bodies_
  std::vector<std::unique_ptr<Robot>> robots_;
  std::vector<std::unique_ptr<Body>> bodies_;
  double r_ = 0;                                                 // tunable
  std::shared_ptr<const cloud::Obstacle> obstacle_;              // the point cloud
  std::size_t cloud_ = std::numeric_limits<std::size_t>::max();  // its body, the last one
  double cloud_r_ = 0;                                           // tunable
  Ports all_;
  SeparationFigures figures_;
  EventPorts events_;
  std::int32_t event_body_ = 0;

  std::vector<collision::Distance> nearest_;  // by group, with inflation
  std::vector<std::size_t> nearest_pairs_;    // by group
  Values least_;                              // by group
  Values bounds_;                             // by pair: lower bounds of their distances
  Values motions_;                            // by part: how far a point can have moved since the last step, m
  std::vector<char> jumped_;  // by part: it is elsewhere or of another shape than in the last step, without a motion
  std::vector<collision::Interval> intervals_;
};

}  // namespace cotwin::monitor
