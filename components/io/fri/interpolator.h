#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "components/io/fri/fri.h"

namespace cotwin::fri {

/// The controller's set points of the joints between the commands. Commands belong to messages with numbers k, T apart:
///   in time     the set point goes to the command of message k − 1 during the command period that begins with message k
///   lost, late  the line through the last two commands is continued: q_k = q_a + (k − a)(q_a − q_b)/(a − b)
///   stopped     the speed falls linearly to 0 within the stop time, the position stays where that ends
/// Command periods above 1 ms are interpolated linearly, shorter ones are stepped through. No joint is faster than its limit.
class Interpolator {
 public:
  /// `period`: ns, at which commands are expected; `speed_limit`: rad/s, one per joint; `stop_time`: ns.
  Interpolator(std::vector<double> speed_limit, std::int64_t period, std::int64_t stop_time);

  /// Rests at q. Later commands are answers to messages after `index`.
  void start(std::span<const double> q, std::int64_t index);
  /// The client's command as an answer to message `index`, newer than the ones before.
  void command(std::span<const double> q, std::int64_t index);
  /// Whether q is a step to message `index` that no joint can make: beyond its speed limit, and rounding of single floats.
  bool is_jump(std::span<const double> q, std::int64_t index) const;
  /// At `now` begins the command period of message `index` (the commands up to index − 1 have been given). `lost`: messages
  /// without a command, to be bridged.
  void begin_period(std::int64_t now, std::int64_t lost);
  /// Begins to stop.
  void stop(std::int64_t now);

  /// The set point.
  void at(std::int64_t now, std::span<double> q, std::span<double> dq) const;
  bool at_rest(std::int64_t now) const { return stopping_ && now - begin_ >= stop_time_; }
  /// Message that the newest command answers.
  std::int64_t index() const { return index_; }

 private:
  std::size_t n_;
  std::vector<double> speed_limit_;
  std::int64_t period_, stop_time_;
  double messages_per_second_ = 0;
  std::vector<double> q_, slope_;  // newest command, rad, and rad per message
  std::int64_t index_ = 0;         // message that it answers
  std::vector<double> from_, to_;  // rad, of the period
  std::vector<double> speed_;      // rad/s, in the period or when the stop began
  std::int64_t begin_ = 0;         // ns
  bool stopping_ = false;
};

}  // namespace cotwin::fri
