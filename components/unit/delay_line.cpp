#include "components/unit/delay_line.h"

#include <algorithm>
#include <cassert>
#include <cmath>

namespace cotwin {

DelayLine::DelayLine(std::size_t width, std::size_t capacity)
    : width_(width), capacity_(capacity), x_(width * capacity), t_(capacity) {
  assert(width > 0 && capacity > 0);
}

void DelayLine::declare(Variables& v, const std::string& name, const std::string& si, const std::string& what) {
  v.state(name, x_, si, "last samples of " + what + ", a ring");
  v.state(name + "_t", t_, "s", "times of the samples of " + name);
  v.state(name + "_place", place_, "ring " + name + ": slot of the latest sample, number held, whether the first was replaced");
}

// Restored values are not trusted: a slot is always within the ring.
std::size_t DelayLine::held() const {
  return static_cast<std::size_t>(std::clamp(place_[1], 1, static_cast<std::int32_t>(capacity_)));
}

std::size_t DelayLine::slot(std::size_t age) const {
  const std::size_t latest = static_cast<std::size_t>(std::max(place_[0], 0)) % capacity_;
  return (latest + capacity_ - age) % capacity_;
}

// Whole nanoseconds, so that a delay of whole steps meets a sample.
double DelayLine::nanoseconds(std::size_t age) const { return std::round(t_[slot(age)] * 1e9); }

void DelayLine::start(Time now, std::span<const double> value) {
  std::fill(x_.begin(), x_.end(), 0.0);
  std::fill(t_.begin(), t_.end(), 0.0);
  place_ = {0, 1, 0};
  t_[0] = now.seconds();
  std::copy(value.begin(), value.end(), x_.begin());
}

void DelayLine::push(Time now, std::span<const double> value) {
  if (nanoseconds(0) != static_cast<double>(now.ns)) {
    if (held() == capacity_) place_[2] = 1;
    place_[1] = static_cast<std::int32_t>(std::min(held() + 1, capacity_));
    place_[0] = static_cast<std::int32_t>((slot(0) + 1) % capacity_);
  }
  t_[slot(0)] = now.seconds();
  std::copy(value.begin(), value.end(), x_.begin() + static_cast<std::ptrdiff_t>(slot(0) * width_));
}

bool DelayLine::at(Time t, std::span<double> value) const {
  const auto ns = static_cast<double>(t.ns);
  const std::size_t oldest = held() - 1;
  if (ns < nanoseconds(oldest) && place_[2] != 0) return false;
  std::size_t before = oldest, after = 0;  // ages: the sample at or before t and the next one
  if (ns <= nanoseconds(oldest)) {
    after = oldest;
  } else if (ns >= nanoseconds(0)) {
    before = 0;
  } else {
    while (before - after > 1) {
      const std::size_t middle = (before + after) / 2;
      (nanoseconds(middle) <= ns ? before : after) = middle;
    }
    if (nanoseconds(before) == ns) after = before;
  }
  const std::span<const double> x0 = sample(before), x1 = sample(after);
  const double span = nanoseconds(after) - nanoseconds(before);
  const double share = span > 0 ? (ns - nanoseconds(before)) / span : 0;
  for (std::size_t i = 0; i < width_; ++i) value[i] = share > 0 ? x0[i] + share * (x1[i] - x0[i]) : x0[i];
  return true;
}

}  // namespace cotwin
