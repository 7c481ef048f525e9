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

/// Finds positions that no motion of a robot explains: further than kLargestJump from where the last two believed ones lead with an
/// acceleration of at most kLargestAcceleration, or from the last one with largest_speed(). They are not used (held), because a message may be
/// damaged. The fifth in a row shows that the robot is elsewhere, if it and the four before it follow from one another in this way. The first
/// positions after begin() and forget() are used from the second one that follows from the one before (a third if a joint has no limit of speed).
/// What is further than kMargin beyond the limits of position is used only if the positions have followed from one another for kOutsideTime.
class JumpDetector {
 public:
  static constexpr double kLargestJump = 5e-3;        // rad (prismatic: m), or kLargestCounts if they are more
  static constexpr double kLargestCounts = 3;         // of set_resolution()
  static constexpr double kLargestAcceleration = 40;  // rad/s², that of UR's fastest motions; others are slower
  static constexpr int kMostHeld = 4;
  static constexpr double kMargin = 0.1;       // rad (prismatic: m)
  static constexpr double kOutsideTime = 0.5;  // s
  /// kFirst: used without one before; kJump: used because of those that were held.
  enum class Verdict : std::uint8_t { kPlausible, kHeld, kJump, kFirst };

  explicit JumpDetector(std::span<const trajectory::Axis> axes);

  /// Declares the output implausible. `what` is counted: "messages".
  void declare(Variables& v, const std::string& what);
  /// The start of a run.
  void begin();
  /// The positions of joint i are multiples of this, rad (prismatic: m).
  void set_resolution(std::size_t i, double resolution);
  /// Nothing is known: the next positions are the first ones.
  void forget();
  /// The robot sets its positions anew (homing): the next one is used if it follows from the one before, whatever was believed.
  void expect_jump() { believed_.positions = in_a_row_ = 0; }
  /// A position, `elapsed` seconds after the one of the last call; 0: not known. `in_time`: whether its time follows from the times before.
  /// `possible`: whether the rest of the message can be true; otherwise it is held, however often it comes.
  Verdict add(std::span<const double> q, double elapsed, bool in_time = true, bool possible = true);
  /// Whether joint i can have this measured speed, rad/s.
  bool allows(std::size_t i, double dq) const { return std::abs(dq) <= fastest_[i]; }
  /// Counts a message that is not plausible for another reason.
  void count_implausible();
  /// Messages that were not plausible since begin().
  std::int32_t implausible() const { return implausible_; }
  /// Appends a sentence if there were any; `one`: "message".
  void append_notes(std::vector<std::string>& sentences, const std::string& one) const;

 private:
  /// Positions of which each follows from the ones before.
  struct Track {
    explicit Track(std::size_t n) : q(n), dq(n) {}
    void append(std::span<const double> q_next, double elapsed);
    std::vector<double> q, dq;  // the last position, and the mean speed up to it
    double interval = 0;        // s, of that speed
    double duration = 0;        // s, from the first position to the last
    int positions = 0;          // one has no speed yet
  };
  bool explains(const Track& track, std::span<const double> q, double elapsed) const;
  bool is_confirmed(std::span<const double> q) const;

  std::vector<double> fastest_;           // rad/s
  std::vector<double> largest_jump_;      // rad
  std::vector<double> q_least_, q_most_;  // rad, with kMargin
  Track believed_, recent_;               // positions that were used, and the last ones whether used or not
  double since_ = 0;                      // s since the last one that was used
  int in_a_row_ = 0;                      // that were held
  bool lost_ = false;                     // what was believed is too old
  std::int32_t implausible_ = 0;
};

}  // namespace cotwin::io
