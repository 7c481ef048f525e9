#include "tests/support/lossy_line.h"

#include <algorithm>
#include <limits>

#include "models/numerics/random.h"

namespace cotwin::testing {

void LossyLine::push(std::int64_t now, std::span<const std::uint8_t> bytes) {
  const std::int64_t number = counts_.sent++;
  const auto draw = [&](std::uint32_t what) {
    return numerics::uniform({disturbance_.seed, what, static_cast<std::uint32_t>(number), 0, 0});
  };
  if (burst_left_ == 0 && draw(0) < disturbance_.loss) burst_left_ = disturbance_.burst;
  if (burst_left_ > 0) {
    --burst_left_;
    ++counts_.lost;
    return;
  }
  std::int64_t at = now + disturbance_.delay + static_cast<std::int64_t>(draw(1) * static_cast<double>(disturbance_.jitter));
  if (draw(2) < disturbance_.reorder) {
    at += disturbance_.hold;
  } else {
    at = last_due_ = std::max(at, last_due_);
  }
  schedule(at, number, bytes);
  if (draw(3) < disturbance_.duplicate) schedule(at, number, bytes);
}

void LossyLine::schedule(std::int64_t at, std::int64_t number, std::span<const std::uint8_t> bytes) {
  waiting_.emplace(std::pair(at, scheduled_++), Datagram{number, {bytes.begin(), bytes.end()}});
}

std::vector<std::uint8_t> LossyLine::pop(std::int64_t now) {
  if (due() > now) return {};
  Datagram first = std::move(waiting_.begin()->second);
  waiting_.erase(waiting_.begin());
  ++counts_.delivered;
  if (!delivered_.insert(first.number).second) {
    ++counts_.duplicates;
  } else if (first.number < newest_) {
    ++counts_.overtaken;
  }
  newest_ = std::max(newest_, first.number);
  return std::move(first.bytes);
}

std::int64_t LossyLine::due() const {
  return waiting_.empty() ? std::numeric_limits<std::int64_t>::max() : waiting_.begin()->first.first;
}

}  // namespace cotwin::testing
