#pragma once
#include <functional>
#include <string>
#include <vector>

#include "components/contact_world/engine/world.h"
#include "components/unit/variables.h"
#include "models/scene/cell.h"

namespace cotwin::contact_world {

/// A latch of the unit: its two frames and its variables. It closes in the step in which `close` becomes true and its frames are within
/// reach, and opens in the one in which `close` becomes false.
class LatchPort {
 public:
  /// Of the setting NAME|frame|frame;…: a frame is ROBOT/FRAME, FRAME of the only robot, BODY, or BODY/FRAME (MODEL/FRAME) of the scene.
  /// Throws Error.
  static std::vector<LatchPort> read(const std::string& place, const std::string& setting, const scene::Cell& cell);

  const std::string& name() const { return name_; }
  void declare(Variables& v);
  /// Adds the latch; `body`: index in the scene of the body that an end is on.
  void add(scene::Scene& scene, const std::function<int(const scene::PlacedFrame&)>& body) const;
  /// At the start of a run: open.
  void reset();
  /// Before a step at `now` (s): brings tunables into force, opens and closes. Allocates nothing. Throws Error for tunables that are not
  /// finite.
  void follow(const std::string& place, World& world, std::size_t latch, double now);
  /// Adds an impulse and angular impulse of the last step, which the drive trains decided, to those of the next one.
  void carry(const Eigen::Vector3d& impulse, const Eigen::Vector3d& moment);
  void write(const Latch& latch, double end, double h);
  void append_notes(std::vector<std::string>& notes) const;
  const Wrench& wrench() const { return wrench_; }  // on the second body, mean over the step, without what was carried

 private:
  std::string name_;
  scene::PlacedFrame ends_[2];
  bool close_ = false, closed_ = false;
  std::vector<double> p_{0, 0, 0}, f_{0, 0, 0}, m_{0, 0, 0};
  Wrench wrench_ = Wrench::Zero();
  Wrench carried_ = Wrench::Zero();  // impulse
  double distance_ = 0, angle_ = 0;
  LatchLaw law_;                // tunables, with 0 for a force and a moment without bound
  bool closed_before_ = false;  // state
  std::vector<double> missed_{0, 0, 0, 0},
      broken_{0, 0};  // state: how often; the first time, s; then distance, m, and angle, rad
};

}  // namespace cotwin::contact_world
