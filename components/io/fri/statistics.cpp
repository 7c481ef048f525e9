#include "components/io/fri/statistics.h"

#include <algorithm>
#include <cmath>

namespace cotwin::fri {

void Moments::add(double x) {  // Welford 1962
  ++count_;
  const double d = x - mean_;
  mean_ += d / static_cast<double>(count_);
  squares_ += d * (x - mean_);
  minimum_ = count_ == 1 ? x : std::min(minimum_, x);
  maximum_ = count_ == 1 ? x : std::max(maximum_, x);
}

double Moments::deviation() const { return count_ < 2 ? 0 : std::sqrt(squares_ / static_cast<double>(count_ - 1)); }

void TimeHistogram::add(std::int64_t ns) {
  const double octaves = std::log2(std::max(static_cast<double>(ns) * 1e-3, 1.0));
  const auto bin = static_cast<std::size_t>(octaves * kPerOctave);
  ++bins_[std::min(bin, bins_.size() - 1)];
  ++count_;
}

double TimeHistogram::quantile(double share) const {
  if (count_ == 0) return 0;
  const double wanted = share * static_cast<double>(count_);
  std::uint64_t sum = 0;
  std::size_t bin = 0;
  while (bin + 1 < bins_.size()) {
    sum += bins_[bin];
    if (static_cast<double>(sum) >= wanted && sum > 0) break;
    ++bin;
  }
  return 1e-6 * std::exp2(static_cast<double>(bin + 1) / kPerOctave);
}

bool SequenceTracker::seen(std::int64_t position) const {
  const auto bit = static_cast<std::size_t>(position & (kWindow - 1));
  return (seen_[bit / 64] >> bit % 64 & 1) != 0;
}

void SequenceTracker::mark(std::int64_t position, bool seen) {
  const auto bit = static_cast<std::size_t>(position & (kWindow - 1));
  const std::uint64_t mask = std::uint64_t{1} << bit % 64;
  seen_[bit / 64] = seen ? seen_[bit / 64] | mask : seen_[bit / 64] & ~mask;
}

void SequenceTracker::begin(std::uint32_t number) {
  seen_.fill(0);
  first_ = position_ = ++newest_;
  number_ = number;
  mark(newest_, true);
  run_ = 0;
  ++received_;
}

void SequenceTracker::begin_at_newest() {
  lost_ -= gap_;
  gap_ = 0;
  seen_.fill(0);
  first_ = newest_;
  mark(newest_, true);
  ++restarts_;
}

SequenceTracker::Arrival SequenceTracker::add(std::uint32_t number, bool silent) {
  if (!started_) {
    started_ = true;
    begin(number);
    return Arrival::kNew;
  }
  const unsigned shift = 32 - bits_;
  const std::int64_t difference = ahead(number);
  position_ = newest_ + difference;
  if (difference > 0 && difference <= kLargestGap) {
    gap_ = static_cast<std::uint64_t>(difference - 1);
    lost_ += gap_;
    for (std::int64_t p = std::max(newest_ + 1, position_ - kWindow + 1); p < position_; ++p) mark(p, false);
    mark(position_, true);
    newest_ = position_;
    number_ = number;
    run_ = 0;
    ++received_;
    return Arrival::kNew;
  }
  // Not newer: a straggler, or the first of a sender that has begun anew.
  const bool again = silent && difference != 0 && (number + 1) << shift == after_ << shift;
  run_ = again || number << shift == after_ << shift ? run_ + 1 : 1;
  after_ = number + 1;
  if (difference > 0 || difference <= -kWindow || (silent && difference != 0)) {
    if (run_ >= 2) {
      ++restarts_;
      begin(number);
      return Arrival::kNew;
    }
    ++stale_;
    return Arrival::kStale;
  }
  if (position_ < first_ || !seen(position_)) {
    if (position_ > first_) --lost_;
    mark(position_, true);
    ++reordered_;
    ++received_;
    return Arrival::kReordered;
  }
  if (run_ >= kRepeats) {
    ++restarts_;
    begin(number);
    return Arrival::kNew;
  }
  ++duplicates_;
  return Arrival::kDuplicate;
}

}  // namespace cotwin::fri
