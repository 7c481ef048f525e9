#include "master/run/clock.h"

#include <time.h>

#include <algorithm>
#include <cerrno>

#include "models/support/error.h"

namespace cotwin::master {

namespace {

/// A later wake-up is an overrun. Linux without a real-time kernel wakes about 50 µs late.
constexpr std::int64_t kTolerated = 200'000;  // ns

std::int64_t monotonic() {
  timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return static_cast<std::int64_t>(t.tv_sec) * 1'000'000'000 + t.tv_nsec;
}

}  // namespace

void RealTimeClock::start(Time now) { zero_ = monotonic() - now.ns; }

bool RealTimeClock::wait(Time now) {
  const std::int64_t deadline = zero_ + now.ns;
  if (monotonic() < deadline) {
    const timespec t{deadline / 1'000'000'000, deadline % 1'000'000'000};
    if (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, nullptr) == EINTR) return false;
  }
  const Duration delay{monotonic() - deadline};
  worst_ = std::max(worst_, delay);
  if (delay.ns > kTolerated) ++overruns_;
  return true;
}

std::unique_ptr<Clock> make_clock(ClockKind kind) {
  if (kind == ClockKind::kFree) return std::make_unique<FreeClock>();
  return std::make_unique<RealTimeClock>();
}

}  // namespace cotwin::master
