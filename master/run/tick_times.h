#pragma once
#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <utility>

#include "master/engine/engine.h"

namespace cotwin::master {

/// Where the loop's time goes, sampled: reading the clock costs as much as a light unit, so only some ticks are timed.
class TickTimes {
 public:
  /// `ticks`: of the run; `first`: where it begins.
  void begin_run(std::int64_t ticks, std::int64_t first) {
    all_ = ticks < kTimeAll;
    next_ = first + (all_ ? 0 : 1);
  }
  /// The next tick to be timed.
  std::int64_t next() const { return next_; }
  void begin_tick() { last_ = Clock::now(); }
  void end_stepping() { stepping_ += lap(); }
  void end_checking() { checking_ += lap(); }
  void end_tick(std::int64_t tick, const Engine& engine) {
    observing_ += lap();
    ++samples_;
    next_ = tick + interval(engine);
  }

  /// Seconds that `ticks` ticks took, without those of the units: events, exchange, checkpoints …
  double stepping(std::int64_t ticks, const Engine& engine) const {
    return scale(ticks) * std::max(0.0, stepping_ - engine.timed_seconds() - engine.measuring_seconds());
  }
  double checking(std::int64_t ticks) const { return scale(ticks) * checking_; }    // … searching for NaN …
  double observing(std::int64_t ticks) const { return scale(ticks) * observing_; }  // … statistics and recording

 private:
  using Clock = std::chrono::steady_clock;
  // Ticks between two timed ones: the smallest that costs at most kMeasuring. Primes, so that no period of the scenario is
  // always hit or always missed.
  static constexpr std::array<std::int64_t, 5> kIntervals = {61, 127, 251, 509, 1021};
  static constexpr double kMeasuring = 0.01;      // of the run's time
  static constexpr int kReadings = 4;             // of the clock in a timed tick, without those of its units
  static constexpr std::int64_t kTimeAll = 1024;  // a run of fewer ticks is timed throughout

  double lap() {
    const auto before = std::exchange(last_, Clock::now());
    return std::chrono::duration<double>(last_ - before).count();
  }
  std::int64_t interval(const Engine& engine) const {
    if (all_) return 1;
    const double seconds = stepping_ + checking_ + observing_;
    const double measuring = engine.measuring_seconds() + kReadings * static_cast<double>(samples_) * engine.clock_seconds();
    for (const std::int64_t every : kIntervals) {
      if (measuring <= kMeasuring * static_cast<double>(every) * (seconds - measuring)) return every;
    }
    return kIntervals.back();
  }
  double scale(std::int64_t ticks) const {
    return static_cast<double>(ticks) / static_cast<double>(std::max<std::int64_t>(1, samples_));
  }

  bool all_ = false;
  std::int64_t next_ = 0, samples_ = 0;
  Clock::time_point last_;
  double stepping_ = 0, checking_ = 0, observing_ = 0;  // s, of the timed ticks
};

}  // namespace cotwin::master
