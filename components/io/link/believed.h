#pragma once
#include <span>
#include <vector>

#include "components/io/link/acknowledgement.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// The torques of a robot's messages, without those that may be damaged. A torque beyond kLargest times the effort of its joint is never used.
/// One that is further than kLargestStep of the effort from the last used one waits for the next message: then the middle one of the last used
/// one, the one that waited and the new one is used, so that a step that goes on is used one message late, and one that does not go on never is.
/// They are known from the second message that agrees with the one before, and no longer after more than kMostHeld in a row that were not used.
class BelievedTorques {
 public:
  static constexpr double kLargest = 10, kLargestStep = 0.05;  // of the effort; a hit goes past the gears to the motors
  static constexpr double kWithoutEffort = 100;                // N.m (prismatic: N), for steps, where the URDF gives none
  static constexpr double kLargestTorque = 1e4;                // N.m, likewise for torques
  static constexpr int kMostHeld = 4;

  /// `along`: how many other values are used with the torques.
  explicit BelievedTorques(std::span<const trajectory::Axis> axes, std::size_t along = 0);

  /// Nothing is known.
  void forget();
  /// The torques of a message (N.m; prismatic: N), and the values that go along with them, as the forces whose torques they are. `possible`: whether
  /// the rest of the message can be true. False if the torques before are shown not to be sound, or these cannot be.
  bool add(std::span<const double> tau, std::span<const double> along = {}, bool possible = true);
  bool known() const { return known_; }
  /// What is used; 0 if it is not known.
  std::span<const double> torques() const { return tau_.used; }
  std::span<const double> along() const { return along_.used; }

 private:
  struct Values {
    explicit Values(std::size_t n) : used(n), last(n) {}
    void use_middle(std::span<const double> next);
    std::vector<double> used, last;  // last: of the message before, used or not
  };

  std::vector<double> largest_, largest_step_;  // N.m
  Values tau_, along_;
  bool known_ = false, begun_ = false;  // begun: there is a last one
  bool stepping_ = false;               // a step went on in the message before
  int in_a_row_ = 0;                    // that were not used
};

/// Where a robot commands itself to be, from which commands begin. What does not follow from the positions of the messages before (JumpDetector), or
/// is further than kFarthest from where the robot was measured, may be damaged: the measured position is taken instead, with the difference
/// from it that was believed last.
class BelievedSetPoint {
 public:
  static constexpr double kFarthest = 0.1;  // rad (prismatic: m)

  explicit BelievedSetPoint(std::span<const trajectory::Axis> axes) : jumps_(axes), offset_(axes.size()) {}

  /// The next set point is the first one.
  void forget();
  /// The set point `q` of a message, replaced unless it is believed. `elapsed`: s since the message before; `measured`: whether the position measured
  /// there, q_measured, is believed, else nothing is replaced; `yields`: the robot is impedance-controlled and may be anywhere beside its set point.
  void take(std::span<double> q, std::span<const double> q_measured, double elapsed, bool measured, bool yields);
  /// Whether those of the last two messages were.
  bool believed() const { return believed_ && before_; }

 private:
  JumpDetector jumps_;
  std::vector<double> offset_;  // rad, from the measured position
  bool first_ = true, believed_ = true, before_ = true;
};

}  // namespace cotwin::io
