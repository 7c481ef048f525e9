#pragma once
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "components/monitor/separation.h"
#include "components/unit/event_ports.h"
#include "components/unit/settings.h"
#include "components/unit/unit.h"
#include "models/distance/distance.h"
#include "models/scene/cell.h"

namespace cotwin::monitor {

/// Distances of robots that move, from each other, from the bodies of a scene and from themselves (VI-F: safety hulls, imminent collisions). All
/// outputs are functions of the inputs at the step's end, and of those at its beginning; nothing acts on the robots, unless `speed` is connected to
/// their motions (separation.h).
///
/// Shapes of robots are inflated by r, so that the distance of a robot's link from a body is d − r, and of two robots' links d − 2 r; links of one
/// robot are not inflated towards each other. No pairs are: static bodies, neighbours in a robot, those that the scene or `ignore` excludes.
///   ḋ = nᵀ (v_b − v_a) at the nearest points        time_to_contact = −d / ḋ
/// least_distance: the least one since the last step, with joints (and positions of bodies) linear in between, and orientations at constant angular
/// velocity. Between two instants the distance changes at most by the way that a point of the pair can move, so that no thin plate is passed: the
/// sign is exact; the value is at most 5 % of that way, 0.1 % of itself, or 1 µm, too large.
class Monitor final : public Unit {
 public:
  static void declare_settings(SettingList& s);
  /// Throws Error for a robot without shapes, for shapes whose distance is not measured, and for unknown names in `ignore` and `obstacles`.
  explicit Monitor(Settings& settings);
  ~Monitor() override;

  void declare(Variables& v) override;
  /// Throws Error for poses that are none.
  void initialise(Time start) override;
  /// Throws Error if an input is not finite.
  StepResult step(Time now, Duration h) override;
  void restored() override;
  void append_notes(std::vector<std::string>& notes) const override;

 private:
  using Values = std::vector<double>;
  struct Ports;
  struct Part;
  struct Robot;
  struct Body;
  struct Pair;
  /// The nearest pair of a group of pairs.
  struct Nearest {
    distance::Distance way;  // d with inflation
    std::size_t pair = 0;
  };

  std::vector<Body*> bodies_of(const std::string& setting, const std::string& names) const;
  void add_obstacles(const std::string& names);
  void add_pairs(const std::string& ignored);
  void add_separation(Settings& settings);
  std::size_t part(const std::string& name, const std::string& ignored) const;
  void declare_ports(Variables& v, Ports& ports, const std::string& prefix, const std::string& of);
  void declare_separation(Variables& v);
  void check_inputs(Time now) const;
  void place_static();
  void place(Time now);
  void place_obstacle(Body& body);
  void measure();
  void measure(std::size_t pair);
  void remember();
  void write_outputs();
  void write(const Nearest& nearest, int robot, Ports& ports) const;
  Eigen::Vector3d velocity(const Part& part, const Eigen::Vector3d& p_W) const;

  // separation.cpp
  double speed_of(const Part& part) const;
  void keep_separation(double t, double h);

  // sweep.cpp: least_distance
  void find_motions();
  void sweep();
  double least_distance(const Pair& pair, double last, double motion, double most);
  double motion(const Part& part) const;
  Pose pose_at(const Part& part, double share);

  /// Groups of pairs: 2 i with others of robot i, 2 i + 1 of links of robot i.
  std::size_t groups() const { return 2 * robots_.size(); }
  double inflation(const Pair& pair) const;

  std::string place_;  // for messages
  scene::Cell cell_;
  bool floating_, separates_;
  std::vector<std::unique_ptr<Robot>> robots_;
  std::vector<std::unique_ptr<Body>> bodies_;
  std::vector<std::unique_ptr<Part>> parts_;  // bodies of the scene, then base and links of each robot
  std::vector<Pair> pairs_;
  double r_ = 0;  // tunable
  std::unique_ptr<Ports> all_;
  SeparationFigures figures_;
  EventPorts events_;

  std::vector<Nearest> nearest_;  // by group
  Values least_;                  // by group
  std::vector<double> bounds_;    // by pair: lower bounds of their distances
  distance::Finder finder_;
  struct Interval {
    double from, to, d_from, d_to;
  };
  std::vector<Interval> intervals_;
};

}  // namespace cotwin::monitor
