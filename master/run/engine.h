#pragma once
#include <bit>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <numeric>
#include <span>
#include <vector>

#include "master/run/events.h"
#include "master/run/initialisation.h"
#include "master/run/members.h"
#include "master/run/schedule.h"
#include "master/run/wiring.h"
#include "master/run/workers.h"
#include "models/support/error.h"

/// Takes all units over one tick: events, exchange, steps. It knows nothing of files, clocks and going back.
namespace cotwin::master {

class Engine {
 public:
  static constexpr std::size_t kNobody = static_cast<std::size_t>(-1);

  /// `threads`: at most so many, 0: as many as the machine has; `always_threads`: also where they do not pay.
  Engine(const Scenario& scenario, std::span<Member> members, int threads, bool always_threads);

  /// Makes all units agree and starts the threads that may be needed.
  Initialisation initialise(Time start);

  /// Steps every unit that is due in the tick, the way of each cut into `parts` with an exchange before each; `sampled`:
  /// measures times. Returns kNobody, or the first slot that discarded; then everything must be restored. Throws what a unit
  /// throws, with its name and time in front if it is an Error.
  std::size_t advance(std::int64_t tick, int parts, bool sampled) {
    return advance(tick, schedule.time(tick), schedule.time(tick + 1), parts, sampled);
  }
  /// The same where somebody else says how long the tick is.
  std::size_t advance(std::int64_t tick, Time begin, Time end, int parts, bool sampled);

  /// The tick from which on advance_plainly() will not do, if nothing unforeseen happens; it is looked at again then.
  std::int64_t plain_until(std::int64_t tick) const;
  /// As advance(tick, 1, false), in a tick before plain_until() that ends at `end`: what is the same in every such tick is not
  /// asked.
  std::size_t advance_plainly(Time end) {
    for (const PlainStage& stage : plain_stages_) {
      for (const Wiring::Copy& copy : stage.copies) Wiring::run(copy);
      const std::size_t who = step_range<false, true>(stage.slots, end);
      if (who != kNobody) [[unlikely]]
        return who;
    }
    return kNobody;
  }

  /// The slot that asked for an orderly end of the run in the last tick (StepResult::kFinished), or kNobody.
  std::size_t finished_by() const { return finished_by_; }

  /// Throws Error naming unit, variable and time if an output or a state is not a number.
  void check_numbers(Time now) const {
    for (const double* value : watched_alone_) {
      if (sign_if_not_finite(*value) >> 63 != 0) [[unlikely]]
        tell_not_a_number(now);
    }
    if (!watched_.empty() && look_at_rows() >> 63 != 0) [[unlikely]]
      tell_not_a_number(now);
  }

  struct Cost {
    double seconds_per_step = 0;  // mean of the sampled steps
    std::int64_t steps = 0;       // per run without discards: ticks / period
    std::int64_t samples = 0;
    double seconds() const { return seconds_per_step * static_cast<double>(steps); }
  };
  Cost cost(std::size_t member, std::int64_t ticks) const;
  /// Of all units in all sampled ticks.
  double sampled_seconds() const { return std::accumulate(seconds_sum_.begin(), seconds_sum_.end(), 0.0); }
  /// What reading the clock before and after each of those steps cost, which ticks that are not sampled do not pay.
  double measuring_seconds() const {
    return 2 * clock_seconds_ * static_cast<double>(std::accumulate(samples_.begin(), samples_.end(), std::int64_t{0}));
  }
  double clock_seconds() const { return clock_seconds_; }
  int threads_used() const { return spread_ever_ ? workers_->threads() : 1; }

  const std::string& name(std::size_t slot) const { return members_[schedule.slots[slot].member].name(); }

  Schedule schedule;
  std::vector<Link> links;
  Wiring wiring;
  Events events;

 private:
  using Clock = std::chrono::steady_clock;

  /// Adjacent doubles that must stay numbers.
  struct Watched {
    const double* values;
    std::size_t count;
  };
  struct StageRun {
    bool ramps = false;
    std::unique_ptr<Balance> balance;  // of a stage that may be spread over threads
    std::vector<double> unit_seconds;  // of the sampled tick
  };

  /// What a plain tick does in a stage.
  struct PlainStage {
    std::span<const Wiring::Copy> copies;
    std::span<Slot> slots;
  };

  /// The exponent of a NaN or an infinity, all ones, overflows into the sign bit: no branch, and several fit into one
  /// instruction.
  static std::uint64_t sign_if_not_finite(double value) {
    return (std::bit_cast<std::uint64_t>(value) & 0x7ff0'0000'0000'0000u) + 0x0010'0000'0000'0000u;
  }

  std::span<Slot> slots_of(const Stage& stage) {
    return std::span(schedule.slots).subspan(stage.first, stage.last - stage.first);
  }
  void watch_outputs();
  std::uint64_t look_at_rows() const;
  void start_workers(int threads, bool always);
  void exchange(const Stage& stage, bool ramps);
  std::size_t step_in_turn(const Stage& stage);
  std::size_t step_on_threads(const Stage& stage, StageRun& run);
  void step_sampled(const Stage& stage, StageRun& run, std::size_t* who);
  std::size_t step_stages(Time begin);
  std::size_t step_on_trial(Time begin);
  template <bool kTimed, bool kPlain>
  std::size_t step_range(std::span<Slot> slots, Time end);
  StepResult step(Slot& slot, Time end) {
    slot.last_step = end - slot.time;
    const StepResult result = slot.unit->step(slot.time, slot.last_step);
    slot.time = end;
    return result;
  }
  StepResult step_timed(std::size_t slot);
  [[noreturn]] void tell_who(std::size_t slot, const Error& error) const;
  static void step_on_worker(void* engine, std::size_t index);
  bool due(const Slot& slot) const { return schedule.due(slot, tick_); }
  Time target(std::size_t slot) const { return parts_ == 1 ? end_ : cut(interval_begin_[slot], end_, part_, parts_); }
  [[noreturn]] void tell_not_a_number(Time now) const;

  std::span<Member> members_;
  int threads_;
  bool always_threads_;
  std::vector<StageRun> runs_;
  std::vector<PlainStage> plain_stages_;
  std::vector<Watched> watched_;              // long rows …
  std::vector<const double*> watched_alone_;  // … and what stands in short ones
  std::unique_ptr<Workers> workers_;
  bool spread_ever_ = false;
  Balance* on_trial_ = nullptr;  // of one stage at a time

  // The part of the tick that is being stepped.
  std::int64_t tick_ = 0;
  Time end_;
  int part_ = 0, parts_ = 1;
  bool sampled_ = false;
  std::size_t finished_by_ = kNobody;
  std::size_t first_ = 0;                       // slot of the stage on the workers
  std::vector<Time> interval_begin_;            // per slot, of a tick in parts
  std::vector<StepResult> results_;             // per slot, of steps on workers
  std::vector<std::exception_ptr> exceptions_;  // likewise

  std::vector<double> seconds_;  // per slot, the last sampled step
  std::vector<double> seconds_sum_;
  std::vector<std::int64_t> samples_;
  double clock_seconds_ = 0;  // what measuring itself costs
};

/// Every unit of a stage that is due; `kPlain`: that is all of them, and the tick is not cut into parts.
template <bool kTimed, bool kPlain>
std::size_t Engine::step_range(std::span<Slot> slots, Time end) {
  auto slot = slots.begin();
  const auto index = [&] { return static_cast<std::size_t>(&*slot - schedule.slots.data()); };
  try {
    for (; slot != slots.end(); ++slot) {
      if (!kPlain && !due(*slot)) continue;
      const StepResult result = kTimed ? step_timed(index()) : step(*slot, kPlain ? end : target(index()));
      if (result != StepResult::kDone) [[unlikely]] {
        if (result == StepResult::kDiscard) return index();
        if (finished_by_ == kNobody) finished_by_ = index();
      }
    }
  } catch (const Error& error) {
    tell_who(index(), error);
  }
  return kNobody;
}

}  // namespace cotwin::master
