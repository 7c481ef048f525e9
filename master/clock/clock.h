#pragma once
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "components/unit/time.h"
#include "components/unit/variables.h"
#include "master/clock/histogram.h"
#include "master/clock/host_time.h"
#include "master/clock/phase_locked_loop.h"
#include "master/engine/wiring/members.h"
#include "master/scenario/scenario.h"

namespace cotwin::master {

/// What a clock measures; recorded as clock.offset …
struct ClockState {
  double offset = 0;    // s, of the last measurement: by how much the ticks are later than the source's cycles
  double jitter = 0;    // s, rms of the offset about its mean, over about the last 64 measurements
  double worst = 0;     // s, largest |offset| while locked
  double drift = 0;     // host time / source time − 1
  double lateness = 0;  // s, from the instant at which the tick was due to its start
  bool locked = false;
  bool silent = false;        // no packet for the time-out
  std::int32_t overruns = 0;  // ticks that began later than ClockSpec::late
  std::int32_t skipped = 0;   // ticks left out
  std::int32_t missed = 0;    // cycles without a packet in time
  std::int32_t steps = 0;     // of the source's clock

  void declare(Variables& v);
};

/// Decides when a tick may begin. Only this blocks the loop on purpose.
class Clock {
 public:
  explicit Clock(HostTime& host = HostTime::system()) : host_(host) {}
  virtual ~Clock() = default;
  /// Begins the run. `now`: the present scenario time. Throws Error if a unit's clock does not fit to the tick.
  virtual void start(Time now) = 0;
  /// Returns true when `now` is reached, at once if it is past. Returns false if a signal came before, and after kSlice; the
  /// caller of the loop then checks whether to stop. Allocates nothing. Throws Error if the source is silent and the run must
  /// stop.
  virtual bool wait(Time now) = 0;
  /// Whether wait() always returns true at once and need not be called.
  virtual bool never_waits() const { return false; }
  /// Whether ticks have deadlines, so that the loop must not wait for files.
  virtual bool real_time() const { return false; }

  static constexpr std::int64_t kSlice = 100'000'000;  // ns

  /// Delay of the tick that wait() has let begin, and whether it counts as an overrun.
  Duration lateness() const { return lateness_; }
  bool overrun() const { return lateness_ > late_; }
  /// Call at the end of the tick, and after `ticks` were left out.
  void end_tick() {
    if (began_ >= 0) run_times_.add(host_.now() - began_);
  }
  void skip(std::int64_t ticks) { state_.skipped += static_cast<std::int32_t>(ticks); }

  ClockState& state() { return state_; }
  std::int64_t overruns() const { return state_.overruns; }
  Duration worst_delay() const { return {start_delays_.max()}; }
  const Histogram& start_delays() const { return start_delays_; }
  const Histogram& run_times() const { return run_times_; }
  /// Rms of the offset over all measurements while locked, s.
  double rms_offset() const;

  static constexpr Duration kLate{200'000};  // Linux without a real-time kernel wakes about 50 µs late

 protected:
  void set_late(Duration late) { late_ = late; }
  /// Notes the start of a tick that was due at `due`.
  void begin_tick(std::int64_t due);
  void note_offset(double ns);

  HostTime& host_;
  ClockState state_;

 private:
  Duration late_ = kLate, lateness_;
  std::int64_t began_ = -1;
  Histogram start_delays_, run_times_;
  double squares_ = 0;
  std::int64_t measured_ = 0;
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
  explicit RealTimeClock(Duration late = kLate, HostTime& host = HostTime::system()) : Clock(host) { set_late(late); }
  void start(Time now) override;
  bool wait(Time now) override;
  bool real_time() const override { return true; }

 private:
  std::int64_t zero_ = 0;  // CLOCK_MONOTONIC at scenario time 0, ns
};

/// The clock of a robot or bus, with what both ways to follow it have in common.
class SourceClock : public Clock {
 public:
  /// `name`: of the component, for messages.
  SourceClock(const ClockSpec& spec, Duration tick, TickSource& source, std::string name, HostTime& host);
  bool real_time() const override { return true; }

 protected:
  /// The length of the source's cycle: the scenario's, the source's own, or a tick. Throws Error if neither of cycle and tick is
  /// a multiple of the other, or if the time-out is shorter than two cycles.
  std::int64_t choose_cycle();
  /// Waits for a packet until `deadline`, or for kSlice.
  std::optional<Arrival> receive(std::int64_t deadline);
  /// Notes whether the source is silent, after receive(). Throws Error if it is and the run must stop then.
  void check_silence();
  bool pauses() const { return state_.silent && spec_.silence == SilencePolicy::kWait; }

  const ClockSpec spec_;
  std::int64_t tick_;       // ns
  std::int64_t cycle_;      // ns
  std::int64_t heard_ = 0;  // host time of the last packet, or of the start
  TickSource& source_;

 private:
  std::string name_;
};

/// A tick begins when a packet of the source comes; ticks within a cycle follow at their distance on the host's clock. A tick
/// whose packet does not come in time begins half a cycle late (cycle missed). Lost packets are recognised by the source's time, or
/// else by the time that has passed.
class ArrivalClock final : public SourceClock {
 public:
  using SourceClock::SourceClock;
  void start(Time now) override;
  bool wait(Time now) override;

 private:
  std::int64_t due(Time now) const { return anchor_ + (now.ns - reached_.ns); }
  bool needs_packet(Time now) const;
  void accept(const Arrival& arrival, Time now);
  std::int64_t cycles_since(const Arrival& arrival, double& offset);

  std::int64_t start_ = 0;   // host time
  bool any_ = false;         // there was a packet, or the wall clock stands in for it
  std::int64_t anchor_ = 0;  // host time at which the scenario time `reached_` was due
  Time reached_;
  double grid_ = 0;               // anchor_ without jitter
  std::int64_t source_time_ = 0;  // of the last packet
  double owed_ = 0;               // cycles that were counted by the host's clock and whose packets may still come
  int punctual_ = 0;              // packets since the last of these
  double mean_ = 0, square_ = 0;  // of the offset
  std::int64_t followed_ = 0;     // packets since the source was silent
};

/// Ticks begin at instants of the host's clock that a phase-locked loop keeps at a phase of the source's cycle.
class LockedClock final : public SourceClock {
 public:
  using SourceClock::SourceClock;
  void start(Time now) override;
  bool wait(Time now) override;

 private:
  void accept(const Arrival& arrival);

  std::optional<PhaseLockedLoop> loop_;
  Time at_;                      // scenario time of the loop's instant
  std::int64_t not_before_ = 0;  // host time of the last correction to an earlier instant: no tick was due before it
};

/// The clock that the scenario asks for. `members` have the units whose clock can be followed. Throws Error if the named component,
/// or without a name exactly one, has no such clock.
std::unique_ptr<Clock> make_clock(const ClockSpec& spec, Duration tick, std::span<const Member> members,
                                  HostTime& host = HostTime::system());

}  // namespace cotwin::master
