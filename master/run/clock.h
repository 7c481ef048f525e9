#pragma once
#include <cstdint>
#include <memory>

#include "components/unit/time.h"
#include "master/ssp/scenario.h"

namespace cotwin::master {

/// Decides when a tick may begin. Only this blocks the loop on purpose.
class Clock {
 public:
  virtual ~Clock() = default;
  /// Begins the run. `now`: the present scenario time.
  virtual void start(Time now) = 0;
  /// Returns true when `now` is reached, at once if it is past. Returns false if a signal came before; the caller of the loop
  /// then checks whether to stop.
  virtual bool wait(Time now) = 0;
  /// Whether wait() always returns true at once and need not be called.
  virtual bool never_waits() const { return false; }
  /// Number of ticks that began late, and the largest delay.
  virtual std::int64_t overruns() const { return 0; }
  virtual Duration worst_delay() const { return {}; }
  /// Whether ticks have deadlines, so that the loop must not wait for files.
  virtual bool real_time() const { return false; }
};

/// As fast as possible.
class FreeClock final : public Clock {
 public:
  void start(Time) override {}
  bool wait(Time) override { return true; }
  bool never_waits() const override { return true; }
};

/// A second of the scenario takes a second of CLOCK_MONOTONIC. Deadlines are absolute: a late tick does not delay the next
/// ones.
class RealTimeClock final : public Clock {
 public:
  void start(Time now) override;
  bool wait(Time now) override;
  std::int64_t overruns() const override { return overruns_; }
  Duration worst_delay() const override { return worst_; }
  bool real_time() const override { return true; }

 private:
  std::int64_t zero_ = 0;  // CLOCK_MONOTONIC at scenario time 0, ns
  std::int64_t overruns_ = 0;
  Duration worst_;
};

std::unique_ptr<Clock> make_clock(ClockKind kind);

}  // namespace cotwin::master
