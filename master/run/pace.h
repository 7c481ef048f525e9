#pragma once
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "master/clock/clock.h"
#include "master/engine/engine.h"

namespace cotwin::master {

/// Figures of a run that is not free-running, for its summary.
struct ClockReport {
  ClockKind kind = ClockKind::kFree;
  ClockState state;
  double rms_offset = 0;                    // s, while locked
  Histogram start_delays, run_times;        // of the ticks
  std::optional<std::int64_t> page_faults;  // of the threads that step units, since the first tick; unknown before finish()
};

/// The clock of a loop, what happens to late ticks, and the scheduling of its threads.
class Pace {
 public:
  /// `given`: a clock in place of the scenario's. `host`: in place of the system's time; may be nullptr. Throws Error for settings
  /// that this machine or the units do not permit.
  Pace(const Scenario& scenario, std::span<const Member> members, std::unique_ptr<Clock> given, HostTime* host);

  /// Whether wait() must be called before each tick, and end_tick() after it.
  bool waits() const { return waits_; }
  bool real_time() const { return clock_->real_time(); }
  /// The clock's variables, for the recorder.
  const Variables& variables() const { return variables_; }

  /// Gives the calling thread and the engine's other ones the priority, CPUs and memory of the scenario. Once; later calls do
  /// nothing.
  void prepare_threads(Engine& engine);
  /// What was not permitted there, as sentences.
  const std::vector<std::string>& refused() const { return refused_; }

  /// Returns true when the tick may begin. Prepares the threads and starts the clock when called first. Returns false as
  /// Clock::wait. Throws Error for a late tick if the run must stop then.
  bool wait(Engine& engine, std::int64_t tick);
  /// The tick that begins now: longer than one if ticks are left out.
  Tick next(const Engine& engine, std::int64_t tick) {
    return late_ticks_ == 0 ? engine.schedule.tick(tick) : long_tick(engine, tick);
  }
  void end_tick() { clock_->end_tick(); }
  /// Call after the loop stood still: the next tick is due at once. Not for clocks that follow a source.
  void restart(const Engine& engine, std::int64_t tick) {
    if (started_) clock_->start(engine.schedule.time(tick));
  }

  /// Counts the page faults. Call on the thread of the loop.
  void finish(Engine& engine);
  ClockReport report() const;

 private:
  void handle_overrun(const Engine& engine, std::int64_t tick);
  Tick long_tick(const Engine& engine, std::int64_t tick);
  static std::int64_t count_page_faults(Engine& engine);

  const ClockSpec& spec_;
  Duration tick_;
  std::unique_ptr<Clock> clock_;
  bool waits_;
  Variables variables_;
  bool prepared_ = false, started_ = false;
  std::thread::id loop_thread_;
  std::int64_t faults_at_start_ = 0;
  std::optional<std::int64_t> page_faults_;
  std::int64_t late_ticks_ = 0;  // whole ticks by which the present one is late, if they are to be left out
  std::vector<std::string> refused_;
};

}  // namespace cotwin::master
