#pragma once
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "components/unit/variables.h"
#include "models/trajectory/axes.h"

namespace cotwin::io {

/// The largest speed of a joint that is believed, rad/s (prismatic: m/s): twice its limit; infinite without one.
double largest_speed(const trajectory::Axis& axis);

/// Numbers, states and bits of a device's messages, each by itself. Two damaged ones of any five are never used.
///   kNumber   the middle one of the last five: two messages late; what lasts for less than three messages is not seen
///   kState    the last value that three messages in a row had
///   kBits     the same of each bit of a whole number
/// A number that is not finite is left out.
class BelievedNumbers {
 public:
  enum class Kind : std::uint8_t { kNumber, kState, kBits };
  static constexpr std::size_t kLast = 5, kInARow = 3;  // messages

  /// The index of the first of `count` more.
  std::size_t add(Kind kind, std::size_t count = 1);
  /// Nothing is known: used values are 0 until there are enough.
  void forget();
  /// The value of number i in a message. Returns what is used.
  double put(std::size_t i, double value);
  double used(std::size_t i) const { return numbers_[i].used; }
  /// Of kNumber: the value of the message from which the used one would be if none was damaged.
  double expected(std::size_t i) const { return numbers_[i].back(kLast / 2); }
  bool known(std::size_t i) const { return numbers_[i].messages >= (numbers_[i].kind == Kind::kNumber ? kLast : kInARow); }

 private:
  struct Number {
    double back(std::size_t messages_ago) const { return last[(at + kLast - messages_ago) % kLast]; }
    Kind kind;
    std::array<double, kLast> last{};
    std::size_t at = 0, messages = 0;  // of the newest one; that there were, at most kLast
    double used = 0;
  };
  std::vector<Number> numbers_;
};

/// What a robot asks for, 0: nothing. `value` is what three messages in a row said, or 0 after three that said something else.
struct ConfirmedState {
  int value = 0, last = 0, in_a_row = 0, against = 0;

  void see(int now);
  /// Whether the last message said that, too.
  bool is_sure() const { return value == last; }
};

/// Positions of a device's messages, which may be damaged though they are well-formed, and the count of all that a link does not use.
///   position   further than kLargestJump from where the last two believed ones lead with at most kLargestAcceleration, or from
///              the last one with largest_speed(): held. The fifth in a row shows that the robot is elsewhere (a jump), if the five
///              follow from one another in this way. First positions are used from the `first`th on that does so
///   range      a speed beyond largest_speed(), or a time that does not follow: held. Further than kMargin beyond the limits of
///              position: used only if positions have followed from one another for kOutsideTime
/// A message whose position is held is held as a whole: its caller uses nothing else of it, as long as it commands anything.
/// Five damaged positions that follow from one another are believed; one that drifts by less than kLargestJump a message is, too,
/// which Agreement finds.
class Belief {
 public:
  static constexpr double kLargestJump = 5e-3;        // rad (prismatic: m), or kLargestCounts if they are more
  static constexpr double kLargestCounts = 3;         // of set_resolution()
  static constexpr double kLargestAcceleration = 40;  // rad/s², that of UR's fastest motions; others are slower
  static constexpr int kMostHeld = 4;
  static constexpr double kMargin = 0.1;       // rad (prismatic: m)
  static constexpr double kOutsideTime = 0.5;  // s
  /// kFirst: used without one before; kJump: used because of those that were held.
  enum class Verdict : std::uint8_t { kPlausible, kHeld, kJump, kFirst };

  explicit Belief(std::span<const trajectory::Axis> axes, int first = kMostHeld + 1);

  /// Declares the output implausible. `what` is counted: "messages".
  void declare(Variables& v, const std::string& what);
  /// The start of a run.
  void begin();
  /// The positions of joint i are multiples of this, rad (prismatic: m).
  void set_resolution(std::size_t i, double resolution);
  /// Nothing is known: the next positions are the first ones.
  void forget();
  /// The robot sets its positions anew (homing): the next one is used if it follows from the one before, whatever was believed.
  void expect_jump();
  /// A position, `elapsed` seconds after the one of the last call; 0: not known. `in_time`: whether its time follows from those
  /// before. `possible`: whether the rest of the message can be true; otherwise it is held, however often it comes.
  Verdict add(std::span<const double> q, double elapsed, bool in_time = true, bool possible = true);
  /// Whether the last message was held.
  bool is_held() const { return held_; }
  /// Whether joint i can have this measured speed, rad/s.
  bool allows(std::size_t i, double dq) const { return std::abs(dq) <= fastest_[i]; }

  /// Counts a message that is not plausible, because `reason`.
  void count_implausible(const char* reason);
  /// Messages that were not plausible since begin().
  std::int32_t implausible() const { return implausible_; }
  /// Appends a sentence if there were any; `one`: "message".
  void append_notes(std::vector<std::string>& sentences, const std::string& one) const;

 private:
  /// Positions of which each follows from the ones before.
  struct Track {
    explicit Track(std::size_t n) : q(n), dq(n) {}
    void append(std::span<const double> q_next, double elapsed);
    std::vector<double> q, dq;  // the last position, and the mean speed up to it, within kLargestAcceleration
    double interval = 0;        // s, of that speed
    double duration = 0;        // s, from the first position to the last
    int positions = 0;          // one has no speed yet
  };
  bool explains(const Track& track, std::span<const double> q, double elapsed) const;
  bool is_confirmed(std::span<const double> q) const;

  // Per joint.
  std::vector<double> fastest_;           // rad/s
  std::vector<double> largest_jump_;      // rad
  std::vector<double> q_least_, q_most_;  // rad, with kMargin
  int first_, needed_;                    // positions, until the first one is used
  Track believed_, recent_;               // positions that were used, and the last ones whether used or not
  double since_ = 0;                      // s since the last one that was used
  int in_a_row_ = 0;                      // that were held
  bool lost_ = false;                     // what was believed is too old
  bool held_ = false;
  std::int32_t implausible_ = 0;
  const char* reason_ = "";  // of the last one
};

/// Whether positions have moved as their speeds say, over kLongest, or kWindow messages at first. Commands may begin only then: a
/// position that is damaged by less than Belief finds in each message may have drifted away from where the robot is.
class Agreement {
 public:
  static constexpr std::size_t kWindow = 50;
  static constexpr double kLongest = 0.5;  // s

  explicit Agreement(std::span<const trajectory::Axis> axes);

  /// The positions of joint i are multiples of `step`, rad (prismatic: m), its speeds of `dq_step`, rad/s.
  void set_resolution(std::size_t i, double step, double dq_step);
  void forget();
  /// A believed position and its speed, rad/s, `elapsed` s after those of the last call; 0: they are the first ones. A way
  /// over three missing messages is left out. A speed that is not finite is not given. Returns why they do not agree, once, when
  /// there were enough, else nullptr.
  const char* compare(std::span<const double> q, std::span<const double> dq, double elapsed);
  bool holds() const { return complete_ && disagrees_ < 0; }
  bool differs() const { return disagrees_ >= 0; }

 private:
  struct Moment {
    double t = 0;                             // s
    std::vector<double> q, dq, way, covered;  // rad, rad/s; integrals of the speed and of its amount, rad
  };
  int disagreeing(const Moment& from, const Moment& to) const;

  std::vector<std::string> names_;
  std::vector<double> step_, dq_step_;  // rad, rad/s
  std::array<Moment, kWindow> window_;
  std::size_t oldest_ = 0, moments_ = 0, messages_ = 0;  // messages_: at most kWindow
  double shortest_ = 0;                                  // s, between two messages
  bool complete_ = false;                                // there were enough
  bool told_ = false;                                    // that they do not agree
  int disagrees_ = -1;                                   // the first joint that does; −1: none
  std::array<char, 160> why_{};
};

/// The torques of a robot's messages, of which the middle one of five is used (BelievedNumbers). One beyond kLargest times the effort
/// of its joint never is. They are known from the fifth message on, and no longer after more than kMostHeld in a row beyond that.
class BelievedTorques {
 public:
  static constexpr double kLargest = 10;         // of the effort; a hit goes past the gears to the motors
  static constexpr double kLargestTorque = 1e4;  // N.m (prismatic: N), where the URDF gives no effort
  static constexpr double kNamed = 0.05;         // of the effort: a difference from what is used that is counted
  static constexpr double kWithoutEffort = 100;  // N.m, likewise

  /// `along`: how many other values are used with the torques.
  explicit BelievedTorques(std::span<const trajectory::Axis> axes, std::size_t along = 0);

  /// Nothing is known.
  void forget();
  /// The torques of a message (N.m; prismatic: N), and values that go along with them, as the forces whose torques they are.
  /// `possible`: whether the rest of the message can be true. Returns why a torque is not used, now or two messages ago, else nullptr.
  const char* add(std::span<const double> tau, std::span<const double> along = {}, bool possible = true);
  bool known() const { return numbers_.known(0); }
  /// What is used of torque i; 0 if it is not known.
  double torque(std::size_t i) const { return numbers_.used(i); }
  double along(std::size_t i) const { return numbers_.used(largest_.size() + i); }

 private:
  std::vector<double> largest_, named_;  // N.m
  BelievedNumbers numbers_;
  int in_a_row_ = 0;  // that were not used
};

/// Where a robot commands itself to be, from which commands begin. What does not follow from the set points before (Belief), or is
/// further than kFarthest from where the robot was measured, may be damaged: the measured position is taken instead, with the
/// difference from it that was believed last; without it, if the set point does not move as the measured position does (Agreement).
class BelievedSetPoint {
 public:
  static constexpr double kFarthest = 0.1;  // rad (prismatic: m)

  explicit BelievedSetPoint(std::span<const trajectory::Axis> axes)
      : positions_(axes, 2), moves_(axes), offset_(axes.size()), before_q_(axes.size()), dq_(axes.size()) {}

  /// The next set point is the first one, as after a jump, or of another source.
  void forget();
  /// The set point `q` of a message, replaced unless it is believed. `elapsed`: s since the message before; `measured`: whether the
  /// position measured there, q_measured, is believed, else nothing is replaced; `yields`: the robot is impedance-controlled and may
  /// be anywhere beside its set point; `follows`: it follows commands already. Returns why the two do not move alike, where they did
  /// before, else nullptr.
  const char* take(std::span<double> q, std::span<const double> q_measured, double elapsed, bool measured, bool yields,
                   bool follows);
  /// Whether those of the last two messages were.
  bool believed() const { return believed_ && before_; }
  /// Whether it moves as the measured position does, or need not.
  bool moves_alike() const { return free_ || moves_.holds(); }

 private:
  Belief positions_;
  Agreement moves_;                    // of the measured position and the speed of the set point
  std::vector<double> offset_;         // rad, from the measured position
  std::vector<double> before_q_, dq_;  // rad, rad/s: the last one and its speed
  double since_ = 0;                   // s since that
  int points_ = 0;                     // in a row
  bool free_ = false;
  bool first_ = true, believed_ = true, before_ = true;
};

}  // namespace cotwin::io
