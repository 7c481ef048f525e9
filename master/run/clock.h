#pragma once
#include <cstdint>
#include <memory>
#include <string>

#include "components/unit/time.h"

namespace cotwin::master {

/// Decides when a tick may begin. The only place in the loop that blocks on purpose.
class Clock {
 public:
  virtual ~Clock() = default;
  /// The run begins: `now` is the instant of the scenario that is now.
  virtual void start(Time now) = 0;
  /// Returns true when `now` has come, or at once if it is past; false after a signal before that: whoever runs the loop then
  /// looks whether to stop.
  virtual bool wait(Time now) = 0;
  /// wait() always returns true at once: it need not be asked.
  virtual bool never_waits() const { return false; }
  /// Ticks that began late, and by how much at most.
  virtual std::int64_t overruns() const { return 0; }
  virtual Duration worst_delay() const { return {}; }
  /// Somebody depends on the time: the loop must not wait for files.
  virtual bool real_time() const { return false; }
};

/// As fast as possible.
class FreeClock final : public Clock {
 public:
  void start(Time) override {}
  bool wait(Time) override { return true; }
  bool never_waits() const override { return true; }
};

/// Scenario seconds are seconds (CLOCK_MONOTONIC). Deadlines are absolute: a late tick does not delay the next ones.
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

/// "free" or "real-time". Throws Error for anything else.
std::unique_ptr<Clock> make_clock(const std::string& name);

}  // namespace cotwin::master
