#pragma once
#include <algorithm>
#include <bit>
#include <chrono>
#include <cstdint>
#include <exception>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <set>
#include <span>
#include <vector>

#include "master/engine/coupling/bonds.h"
#include "master/engine/coupling/explicit_steps.h"
#include "master/engine/coupling/group_solver.h"
#include "master/engine/coupling/growth_watch.h"
#include "master/engine/coupling/initialisation.h"
#include "master/engine/events.h"
#include "master/engine/tools.h"
#include "master/engine/wiring/arrangement.h"
#include "master/engine/wiring/members.h"
#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/wiring.h"
#include "master/engine/workers.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

/// Steps all units over one tick: events, then the exchange and the steps of each stage. StepControl adds checkpoints and
/// repeated ticks, Master adds clock and files.
class Engine {
 public:
  static constexpr std::size_t kNoSlot = static_cast<std::size_t>(-1);

  /// `threads`: upper limit, 0 for the number of cores. `always_threads`: use them even where they are slower (for tests).
  Engine(const Scenario& scenario, std::span<Member> members, int threads, bool always_threads);

  /// Initialises all units consistently, decides which loops are solved, and starts the threads that may be needed.
  Initialisation initialise(Time start);

  /// Steps every unit that is due in the tick. With `parts` > 1 the interval of each unit is cut into so many steps, with an
  /// exchange before each. `timed`: measures the time of each step. Returns kNoSlot, or the first slot that discarded its step;
  /// then the caller must restore all units. Adds name and time to an Error that a unit throws.
  std::size_t step(const Tick& tick, int parts = 1, bool timed = false) {
    tick_ = tick;
    parts_ = parts;
    part_end_ = tick.end;
    last_part_ = true;
    timed_ = timed;
    finished_by_ = kNoSlot;
    const bool measured = timed || tick.index >= next_trial_;
    return measured ? step_measured() : parts == 1 ? step_part(tick.begin, tick.end) : step_in_parts();
  }

  /// Call before the first step_between() of a tick.
  void begin_tick() {
    for (ScheduledUnit& slot : schedule.slots) slot.stepped = false;
  }
  /// Steps from `begin` to `end` within the tick. Units that cannot be restored step once, over the whole tick, in the first
  /// part; units with a period in the last one. Returns as step().
  std::size_t step_between(const Tick& tick, Time begin, Time end, bool timed) {
    tick_ = tick;
    parts_ = 1;
    part_end_ = end;
    last_part_ = end == tick.end;
    timed_ = timed;
    finished_by_ = kNoSlot;
    const std::size_t discarded_by = step_part(begin, end);
    if (timed) report_costs();
    return discarded_by;
  }

  /// The slot that asked for an orderly end of the run in the last tick (StepResult::kFinished), or kNoSlot.
  std::size_t finished_by() const { return finished_by_; }

  /// Throws Error naming unit, variable and time if a real output or state is not finite.
  void check_finite(Time now) const {
    std::uint64_t seen = 0;
    for (const double* value : watched_values_) seen |= sign_if_not_finite(*value);
    for (const std::span<const double> row : watched_rows_) {
      for (const double value : row) seen |= sign_if_not_finite(value);
    }
    if (seen >> 63 != 0) [[unlikely]]
      report_non_finite(now);
  }

  struct Cost {
    double seconds_per_step = 0;  // mean of the timed steps
    double steps = 0;             // ticks / period, times the tries in a tick
    std::int64_t samples = 0;
    double seconds() const { return seconds_per_step * steps; }
  };
  /// `tries`: mean number of steps in a tick, also of those that were taken back.
  Cost cost(std::size_t member, std::int64_t ticks, double tries = 1) const;
  /// Of all units in all timed ticks.
  double timed_seconds() const { return std::accumulate(seconds_sum_.begin(), seconds_sum_.end(), 0.0); }
  /// Time spent on reading the clock before and after each of those steps. Ticks that are not timed do not spend it.
  double measuring_seconds() const {
    return 2 * clock_seconds_ * static_cast<double>(std::accumulate(samples_.begin(), samples_.end(), std::int64_t{0}));
  }
  double clock_seconds() const { return clock_seconds_; }
  int threads_used() const { return threads_used_; }

  /// Calls task(context, i) once on each thread that may step units; i = 0: the caller's. Call after initialise().
  void on_each_thread(Workers::Task task, void* context);
  int threads() const { return workers_ ? workers_->threads() : 1; }

  const std::string& name(std::size_t slot) const { return members_[schedule.slots[slot].member].name(); }

  /// Which loops are solved and by which rules, so that their values stop growing.
  struct CouplingChange {
    std::vector<bool> solved;              // per loop of continuous connections
    std::vector<GroupSolver::Rule> rules;  // likewise, for units that hold their inputs
    friend bool operator==(const CouplingChange&, const CouplingChange&) = default;
  };
  /// Call after each tick: whether the values of a loop change more and more (GrowthWatch).
  bool watch_growth() {
    bool grows = false;
    for (GrowthWatch& watch : growth_) grows = watch.tick() || grows;
    return grows;
  }
  /// Call where watch_growth() is true: the coupling that ends the growth; nothing if the present one may stay. Throws Error naming the members of a
  /// loop whose values diverge and that no other coupling stabilises.
  std::optional<CouplingChange> find_coupling_change(Time now, Duration tick);
  /// Measures the gains of the loops that step explicitly with coupling=auto, and returns what find_coupling_change does. `tick`: length of one.
  std::optional<CouplingChange> watch_loops(Time now, Duration tick);
  /// Call between two ticks. Solves or steps the loops accordingly from here on. Allocates.
  void apply(const CouplingChange& change);
  /// Whether values of a loop change more than before.
  bool is_rising() const { return std::ranges::any_of(growth_, &GrowthWatch::is_rising); }
  /// Whether the coupling can change in this run.
  bool may_change() const;
  /// The loops with their gain in a tick and their stability border, whatever the coupling of the scenario. A loop with a unit
  /// without a cheap way back, or with more than `most_unknowns` unknowns, is not measured. Call after initialise(start) and
  /// before the first step. The units keep their values; the search steps each of them some ten thousand ticks in the worst case.
  std::vector<LoopReport> measure_loops(Time start, std::size_t most_unknowns);
  /// Loops of continuous connections. Valid after initialise().
  std::vector<LoopReport> loops() const;
  /// Loops whose values are probably wrong, because they step explicitly.
  std::vector<std::string> loop_warnings() const;
  /// Whether a connection is solved for, so that its input is known at the end of the step.
  bool solves(const ResolvedConnection& link) const;

  /// Numbers of the coupling on which the next step depends, and the energies of the bonds. Their number changes in initialise()
  /// only.
  void save_coupling(std::vector<double>& numbers) const;
  void restore_coupling(std::span<const double> numbers);
  /// How often the loops were iterated so far, for a resumed run.
  void write_counts(ByteWriter& out) const;
  void read_counts(ByteReader& in);
  /// Whether the numbers are of this scenario's loops.
  bool is_coupling(std::span<const double> numbers) const;

  Schedule schedule;
  std::vector<ResolvedConnection> links;
  Wiring wiring;
  Events events;
  Bonds bonds;
  Tools tools;

 private:
  using Clock = std::chrono::steady_clock;

  /// What the engine needs to step a stage.
  struct StageRun {
    std::span<ScheduledUnit> slots;
    std::span<const ScheduledUnit> exchanged;  // slots that get their inputs before this stage; none if they have got them
    std::span<const Wiring::Copy> copies;      // into all of these
    bool every_tick = true;                    // all of these are due in every tick and part of it
    bool begins_ramps = false;                 // one of these has an input that is followed linearly
    bool ends_ramps = false;                   // one of `slots` has
    bool once = false;                         // in steps to a tolerance: one of `slots` steps over whole ticks only
    bool plain = true;                         // all of `slots` are due in every tick and part of it, and none is metered
    GroupSolver* solver = nullptr;             // if the stage is a solved group
    std::unique_ptr<Balance> balance;          // if the stage may be spread over threads
    std::vector<double> unit_seconds;          // per slot, of the timed tick
  };

  /// Adding one to the exponent of a NaN or an infinity, which is all ones, sets the sign bit. This needs no branch and
  /// vectorises.
  static std::uint64_t sign_if_not_finite(double value) {
    return (std::bit_cast<std::uint64_t>(value) & 0x7ff0'0000'0000'0000u) + 0x0010'0000'0000'0000u;
  }

  void arrange(const Arrangement& arrangement);
  void choose_groups(const Initialisation& initialised);
  Duration first_tick() const { return schedule.tick(0).end - schedule.tick(0).begin; }
  void arrange_solved();
  bool is_watched(const Variable& v) const;
  void watch_values();
  std::string loop_of(std::size_t member) const;
  [[noreturn]] void report_non_finite(Time now) const;
  void start_workers(int threads, bool always);

  std::size_t step_measured();
  std::size_t step_in_parts();
  std::size_t step_part(Time begin, Time end);
  void exchange(const StageRun& stage);
  void end_ramps(const StageRun& stage);
  void note_stepped(const StageRun& stage);
  std::size_t step_stage(StageRun& stage);
  std::size_t solve(StageRun& stage, Time begin, Time end);
  template <bool kAllInOnePart>
  std::size_t step_in_turn(std::span<ScheduledUnit> slots);
  std::size_t step_on_threads(const StageRun& stage);
  static void step_on_worker(void* engine, std::size_t index);
  StepResult step_slot(ScheduledUnit& slot, Time end) {
    slot.last_step = end - slot.time;
    const StepResult result = slot.unit->step(slot.time, slot.last_step);
    slot.time = end;
    return result;
  }
  StepResult step_metered(ScheduledUnit& slot, Time end);
  StepResult step_due(ScheduledUnit& slot);
  [[noreturn]] void rethrow_named(const ScheduledUnit& slot, const Error& error) const;

  void begin_trial();
  void end_trial_tick(double seconds);
  void report_costs();
  void find_next_trial();

  std::size_t index(const ScheduledUnit& slot) const { return static_cast<std::size_t>(&slot - schedule.slots.data()); }
  bool due(const ScheduledUnit& slot) const {
    return schedule.due(slot, tick_) && (slot.once ? !slot.stepped : slot.period == 1 || last_part_);
  }
  /// Where the present step of the slot ends.
  Time target(const ScheduledUnit& slot) const {
    if (parts_ > 1) return cut(slot.interval_begin, tick_.end, part_, parts_);
    return slot.once ? tick_.end : part_end_;
  }

  const Scenario& scenario_;
  std::span<Member> members_;
  std::vector<std::unique_ptr<GroupSolver>> solvers_;
  std::vector<LoopReport> loops_;                 // counts: see solvers_
  std::vector<std::vector<std::size_t>> groups_;  // members of loops_
  /// A loop that can be measured, with its own list of slots.
  struct LoopProbe {
    std::size_t loop = 0;
    std::vector<ScheduledUnit> slots;
    std::unique_ptr<GroupSolver> solver;
    std::unique_ptr<ExplicitSteps> steps;
  };
  LoopProbe make_probe(std::size_t loop);
  [[noreturn]] void fail_diverging(std::size_t loop, double factor, Time now) const;
  static GroupSolver::Rule rule_for(const LoopProbe& probe, Time now, Duration tick);
  void measure_gain(const LoopProbe& probe, Time now, Duration tick);
  void watch_all();
  bool may_diverge(std::size_t loop) const;
  bool is_free() const { return scenario_.clock.kind == ClockKind::kFree; }
  GroupSolver* solver_of(std::size_t loop) const;
  CouplingChange present() const;
  std::vector<LoopProbe> probes_;    // of the loops that may be solved later
  std::vector<GrowthWatch> growth_;  // per loop of loops_
  std::vector<std::size_t> solver_of_loop_;
  Arrangement arrangement_;
  int threads_;
  bool always_threads_;
  std::vector<StageRun> stages_;
  std::set<const Variable*> may_be_lost_;
  std::vector<std::span<const double>> watched_rows_;  // values that must stay finite: adjacent ones …
  std::vector<const double*> watched_values_;          // … and single ones
  std::unique_ptr<Workers> workers_;
  int threads_used_ = 1;
  static constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
  std::int64_t next_trial_ = kNever;  // the tick with which a trial is due; 0 during a trial
  Balance* on_trial_ = nullptr;       // of one stage at a time

  // The part of the tick that is being stepped.
  Tick tick_;
  int part_ = 0, parts_ = 1;
  Time part_end_;
  bool last_part_ = true;  // of the tick
  bool timed_ = false;
  std::size_t finished_by_ = kNoSlot;
  std::span<ScheduledUnit> threaded_slots_;     // of the stage on the workers
  std::vector<StepResult> results_;             // per slot, of steps on workers
  std::vector<std::exception_ptr> exceptions_;  // likewise

  std::vector<double> seconds_;  // per slot, the last timed step
  std::vector<double> seconds_sum_;
  std::vector<std::int64_t> samples_;
  double clock_seconds_ = 0;  // one reading of the clock
};

}  // namespace cotwin::master
