#pragma once
#include <span>
#include <string>
#include <vector>

#include "components/unit/variables.h"

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

/// Finds positions that no motion of a robot explains: further than kLargestJump from where the last two positions lead with an
/// acceleration of at most kLargestAcceleration.
class JumpDetector {
 public:
  static constexpr double kLargestJump = 5e-3;        // rad (prismatic: m)
  static constexpr double kLargestAcceleration = 40;  // rad/s², that of UR's fastest motions; others are slower

  explicit JumpDetector(std::size_t joints) : q_(joints), dq_(joints) {}

  /// The next position is the first one.
  void forget() { positions_ = 0; }
  /// A position, `elapsed` seconds after the last one; 0: not known, as after forget(). Whether it is a jump.
  bool add(std::span<const double> q, double elapsed);

 private:
  std::vector<double> q_, dq_;  // the last position, and the mean speed up to it
  double interval_ = 0;         // s, of that speed
  int positions_ = 0;           // that are known: one has no speed yet
};

}  // namespace cotwin::io
