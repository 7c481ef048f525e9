#pragma once
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/unit/variables.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// Whether a link may command its device after a loss. Nothing may move by itself when a cable is plugged in again or a controller
/// has started again: after demand() the link commands nothing until the input `acknowledge` rises while the device is ready.
/// The start of a run needs no acknowledgement.
class Acknowledgement {
 public:
  /// Declares the output awaits_acknowledgement, the input acknowledge and the parameter restart. `withheld`: what holds
  /// meanwhile, "outputs are off"; `ready`: when an edge counts, "the bus is operational".
  void declare(Variables& v, const std::string& withheld, const std::string& ready);
  /// The start of a run: nothing is awaited, and an input that is on has not risen. Throws Error at `place` if the parameter has another value.
  void begin(const std::string& place);
  /// After a loss, a restart or a jump. Without effect with restart=automatic.
  void demand();
  /// Once in each step. `ready`: the device is back, so that an edge counts.
  void decide(bool ready);
  bool awaits() const { return awaits_; }
  /// Whether nothing is ever awaited.
  bool is_automatic() const { return restart_ == "automatic"; }

 private:
  std::string restart_ = "acknowledged";
  bool acknowledge_ = false, before_ = false;  // the input, and its last value
  bool awaits_ = false;
};

/// The largest speed of a joint that is believed, rad/s (prismatic: m/s): twice its limit; infinite without one.
double largest_speed(const trajectory::Axis& axis);

/// Finds positions that no motion of a robot explains: further than kLargestJump from where the last two positions lead with an
/// acceleration of at most kLargestAcceleration, or from the last one with largest_speed(). A single one is a
/// damaged message; kMostHeld are not used, and one more in a row shows that the robot is elsewhere.
class JumpDetector {
 public:
  static constexpr double kLargestJump = 5e-3;        // rad (prismatic: m)
  static constexpr double kLargestAcceleration = 40;  // rad/s², that of UR's fastest motions; others are slower
  static constexpr int kMostHeld = 4;
  enum class Verdict : std::uint8_t { kPlausible, kHeld, kJump };

  explicit JumpDetector(std::span<const trajectory::Axis> axes);

  /// Declares the output implausible. `what` is counted: "messages".
  void declare(Variables& v, const std::string& what);
  /// The start of a run.
  void begin();
  /// The next position is the first one.
  void forget();
  /// A position, `elapsed` seconds after the last one that was not held; 0: not known, as after forget(). `credible`: whether the rest of the
  /// message can be true.
  Verdict add(std::span<const double> q, double elapsed, bool credible = true);
  /// Whether joint i can have this measured speed, rad/s.
  bool allows(std::size_t i, double dq) const { return std::abs(dq) <= fastest_[i]; }
  /// Positions that were not plausible since begin().
  std::int32_t implausible() const { return implausible_; }
  /// Appends a sentence if there were any; `one`: "message".
  void append_notes(std::vector<std::string>& sentences, const std::string& one) const;

 private:
  bool is_plausible(std::span<const double> q, double elapsed) const;

  std::vector<double> fastest_;  // rad/s
  std::vector<double> q_, dq_;   // the last position, and the mean speed up to it
  double interval_ = 0;          // s, of that speed
  int positions_ = 0;            // that are known: one has no speed yet
  int in_a_row_ = 0;             // that were held
  std::int32_t implausible_ = 0;
};

}  // namespace cotwin::io
