#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "components/io/fri/fri.h"

namespace cotwin::fri {

/// KUKA's thresholds are not public; these are ours. A quality needs the share of answers in time, EXCELLENT also the latency.
struct RatingSettings {
  std::uint32_t window = 100;  // command periods
  double excellent = 0.99, good = 0.95, fair = 0.75;
  double excellent_latency = 0.5;  // command periods
};

/// Rates the answers of a client over the last command periods. Before the first `window` periods the missing ones count as
/// unanswered, so that a good quality needs a while.
class Rating {
 public:
  /// `period`: ns, at which answers are expected.
  Rating(const RatingSettings& settings, std::int64_t period);

  void clear();
  /// A period has ended; `in_time`: with an answer.
  void close_period(bool in_time);
  /// An answer to the period that ended `age` periods ago (1: the last) was in time after all: it had arrived, but was read late.
  void correct(std::int64_t age);
  void add_latency(std::int64_t ns);

  Quality quality() const;
  double answer_rate() const { return static_cast<double>(in_time_) / static_cast<double>(settings_.window); }
  double latency() const { return latency_; }  // s, mean
  double jitter() const { return jitter_; }    // s, mean deviation from the mean latency

 private:
  RatingSettings settings_;
  std::int64_t period_;
  std::vector<std::uint8_t> outcomes_;   // ring
  std::vector<std::int64_t> latencies_;  // ns, ring
  std::size_t next_outcome_ = 0, next_latency_ = 0, latencies_count_ = 0;
  std::uint32_t in_time_ = 0;
  double latency_ = 0, jitter_ = 0;
};

}  // namespace cotwin::fri
