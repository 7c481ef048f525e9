#include "components/io/emulators/kuka/rating.h"

#include <algorithm>
#include <cmath>

namespace cotwin::fri {

Rating::Rating(const RatingSettings& settings, std::int64_t period)
    : settings_(settings), period_(period), outcomes_(settings.window), latencies_(settings.window) {}

void Rating::clear() {
  std::fill(outcomes_.begin(), outcomes_.end(), std::uint8_t{0});
  next_outcome_ = next_latency_ = latencies_count_ = 0;
  in_time_ = 0;
  latency_ = jitter_ = 0;
}

void Rating::close_period(bool in_time) {
  std::uint8_t& outcome = outcomes_[next_outcome_];
  in_time_ = in_time_ - outcome + (in_time ? 1u : 0u);
  outcome = in_time ? 1 : 0;
  next_outcome_ = (next_outcome_ + 1) % outcomes_.size();
}

void Rating::correct(std::int64_t age) {
  if (age < 1 || age > static_cast<std::int64_t>(outcomes_.size())) return;
  std::uint8_t& outcome = outcomes_[(next_outcome_ + outcomes_.size() - static_cast<std::size_t>(age)) % outcomes_.size()];
  in_time_ += 1u - outcome;
  outcome = 1;
}

void Rating::add_latency(std::int64_t ns) {
  latencies_[next_latency_] = ns;
  next_latency_ = (next_latency_ + 1) % latencies_.size();
  latencies_count_ = std::min(latencies_count_ + 1, latencies_.size());
  const double n = static_cast<double>(latencies_count_);
  std::int64_t sum = 0;
  for (std::size_t i = 0; i < latencies_count_; ++i) sum += latencies_[i];
  const double mean = static_cast<double>(sum) / n;
  double deviation = 0;
  for (std::size_t i = 0; i < latencies_count_; ++i) deviation += std::abs(static_cast<double>(latencies_[i]) - mean);
  latency_ = mean * 1e-9;
  jitter_ = deviation / n * 1e-9;
}

Quality Rating::quality() const {
  const double rate = answer_rate();
  if (rate >= settings_.excellent && latency_ < settings_.excellent_latency * static_cast<double>(period_) * 1e-9) {
    return Quality::kExcellent;
  }
  if (rate >= settings_.good) return Quality::kGood;
  return rate >= settings_.fair ? Quality::kFair : Quality::kPoor;
}

}  // namespace cotwin::fri
