#pragma once
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "components/io/fri/fri.h"

namespace cotwin::fri {

inline constexpr double kLongestStep = 1e-3;  // s: shorter command periods are not interpolated

struct InterpolatorSettings {
  std::vector<double> speed_limit;   // rad/s, one per joint
  std::vector<double> lower, upper;  // rad; empty: no limits
  std::int64_t message_period = 0;   // ns
  std::uint32_t multiplier = 1;      // messages per command
  std::int64_t stop_time = 0;        // ns
  std::int64_t slack = 0;            // ns, added to the time between two commands when their speed is checked
  double longest_lag = 0;            // command periods at full speed: distance of a command from the set point
  double acceleration_limit = std::numeric_limits<double>::infinity();  // rad/s²
};

/// The controller's set points of the joints between the commands. Commands are answers to messages, which have numbers k:
///   in time     during the command period that begins with message k, the set point goes to the answer to message k − 1
///   lost, late  the line through the last two answers is continued: q_k = q_a + (k − a)(q_a − q_b)/(a − b)
///   stopped     the speed falls linearly to 0 within the stop time, and the position stays where that ends
/// Command periods above 1 ms are interpolated linearly, shorter ones are stepped through. No joint is faster than its limit, none changes its
/// speed faster than by acceleration_limit from period to period, and none goes beyond its limits of position by itself.
class Interpolator {
 public:
  explicit Interpolator(InterpolatorSettings settings);

  /// Rests at q. Later commands are answers to messages after `index`.
  void start(const Joints& q, std::int64_t index);
  /// The client's command as an answer to message `index`, which is newer than the ones before.
  /// `soft`: its speed has the acceleration limit.
  void command(const Joints& q, std::int64_t index, bool soft = true);
  const Joints& newest() const { return q_; }  // command
  /// Whether q is a step to message `index` beyond a joint's speed limit, from the newest command, or too far from the set
  /// point; apart from the rounding of single floats.
  bool is_jump(const Joints& q, std::int64_t index) const;
  /// Whether q changes the speed of the commands by more than the acceleration limit, apart from that rounding.
  bool is_jerk(const Joints& q, std::int64_t index) const;
  /// At `now` a command period begins. `lost`: messages that should have been answered after the newest command.
  void begin_period(std::int64_t now, std::int64_t lost);
  /// Begins to stop.
  void stop(std::int64_t now);

  /// The set point: rad, rad/s.
  void at(std::int64_t now, Joints& q, Joints& dq) const;
  /// 1 in motion, falls to 0 while the joints stop.
  double share_of_speed(std::int64_t now) const;
  bool at_rest(std::int64_t now) const { return stopping_ && now - begin_ >= settings_.stop_time; }

 private:
  double limited(std::size_t joint, double q) const;
  double softened(std::size_t joint, double target) const;

  InterpolatorSettings settings_;
  std::size_t n_;
  double period_;           // s, of commands
  Joints q_{}, slope_{};    // newest command, rad, and rad per message
  std::int64_t index_ = 0;  // message that it answers
  std::int64_t gap_ = 1;    // messages from the command before
  Joints from_{}, to_{};    // rad, of the period
  Joints speed_{};          // rad/s, in the period or when the stop began
  std::int64_t begin_ = 0;  // ns
  bool stopping_ = false, soft_ = true;
};

}  // namespace cotwin::fri
