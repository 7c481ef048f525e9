#include "master/engine/engine.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <utility>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

std::vector<Signal> fed_signals(const std::vector<ResolvedConnection>& links) {
  std::vector<Signal> fed;
  for (const ResolvedConnection& link : links) {
    if (!link.initial) fed.push_back(link.to);
  }
  return fed;
}

double seconds_between(std::chrono::steady_clock::time_point a, std::chrono::steady_clock::time_point b) {
  return std::chrono::duration<double>(b - a).count();
}

constexpr std::size_t kLongRow = 4;  // values

}  // namespace

/// Whether the values of a variable must stay finite: those of sensors that feed only inputs that may be lost need not.
bool Engine::is_watched(const Variable& v) const {
  return v.kind() == Kind::kReal && (v.role == Role::kOutput || v.role == Role::kState) && !may_be_lost_.contains(&v);
}

Engine::Engine(const Scenario& scenario, std::span<Member> members, int threads, bool always_threads)
    : schedule(scenario, members, arrange_as_given(members)),
      links(resolve_connections(scenario, members)),
      wiring(links, schedule, arrange_as_given(members).group_of),
      events(scenario, members, fed_signals(links)),
      bonds(scenario, members),
      tools(scenario, members, fed_signals(links)),
      scenario_(scenario),
      members_(members),
      threads_(threads),
      always_threads_(always_threads) {
  for (const ResolvedConnection& link : links)
    if (link.to.variable->may_be_lost) may_be_lost_.insert(link.from.variable);
  for (const ResolvedConnection& link : links)
    if (!link.to.variable->may_be_lost) may_be_lost_.erase(link.from.variable);
  if (!tools.jumps().empty()) events.add(tools.jumps());
  arrange(arrange_as_given(members));
}

void Engine::arrange(const Arrangement& arrangement) {
  arrangement_ = arrangement;
  schedule = Schedule(scenario_, members_, arrangement);
  wiring = Wiring(links, schedule, arrangement.group_of);
  const std::size_t slots = schedule.slots.size();
  results_.assign(slots, StepResult::kDone);
  exceptions_.assign(slots, nullptr);
  seconds_.assign(slots, 0);
  seconds_sum_.assign(slots, 0);
  samples_.assign(slots, 0);
  on_trial_ = nullptr;  // a balance of the stages
  next_trial_ = kNever;
  stages_.clear();
  solvers_.clear();
  for (ScheduledUnit& slot : schedule.slots) slot.metered = bonds.meters(slot.member);
  for (auto stage = schedule.stages.begin(); stage != schedule.stages.end(); ++stage) {
    StageRun& run = stages_.emplace_back();
    run.slots = std::span(schedule.slots).subspan(stage->first, stage->last - stage->first);
    const auto always_due = [&](const ScheduledUnit& slot) {
      return slot.period == 1 && !(slot.once && scenario_.tolerance > 0);
    };
    run.plain = std::ranges::all_of(run.slots, [&](const ScheduledUnit& slot) { return always_due(slot) && !slot.metered; });
    run.once = scenario_.tolerance > 0 && std::ranges::any_of(run.slots, &ScheduledUnit::once);
    run.ends_ramps = std::ranges::any_of(run.slots, [&](const ScheduledUnit& slot) { return wiring.ramped(index(slot)); });
    if (stage->group != kNoGroup) {
      solvers_.push_back(std::make_unique<GroupSolver>(run.slots, members_, links, bonds, scenario_.tolerance));
      run.solver = solvers_.back().get();
    }
    if (stage != schedule.stages.begin() && (stage - 1)->exchange == stage->exchange) continue;
    std::size_t last = stage->last;
    for (auto other = stage; other != schedule.stages.end() && other->exchange == stage->exchange; ++other) last = other->last;
    run.exchanged = std::span(schedule.slots).subspan(stage->first, last - stage->first);
    run.copies = wiring.copies(stage->first, last);
    run.every_tick = std::ranges::all_of(run.exchanged, always_due);
    run.begins_ramps =
        std::ranges::any_of(run.exchanged, [&](const ScheduledUnit& slot) { return wiring.ramped(index(slot)); });
  }
  watched_rows_.clear();
  watched_values_.clear();
  watch_values();
}

/// Joins variables that are adjacent in memory. Rows that are too short for vector instructions become single values.
void Engine::watch_values() {
  for (const ScheduledUnit& slot : schedule.slots) {
    for (const Variable& v : members_[slot.member].variables()) {
      if (!is_watched(v) || v.size() == 0) continue;
      const std::span<const double> values = v.reals();
      const bool continues =
          !watched_rows_.empty() && watched_rows_.back().data() + watched_rows_.back().size() == values.data();
      if (continues) {
        watched_rows_.back() = {watched_rows_.back().data(), watched_rows_.back().size() + values.size()};
      } else {
        watched_rows_.push_back(values);
      }
    }
  }
  std::erase_if(watched_rows_, [&](std::span<const double> row) {
    if (row.size() >= kLongRow) return false;
    for (const double& value : row) watched_values_.push_back(&value);
    return true;
  });
}

Initialisation Engine::initialise(Time start) {
  arrange(arrange_as_given(members_));
  for (ScheduledUnit& slot : schedule.slots) slot.time = start;
  constexpr int kReadings = 64;
  const auto begin = Clock::now();
  for (int i = 1; i < kReadings; ++i) (void)Clock::now();
  clock_seconds_ = seconds_between(begin, Clock::now()) / kReadings;
  tools.plan();
  events.retarget(tools.jumps());
  Initialisation result = initialise_units(members_, schedule, links, wiring, start);
  choose_groups(result);
  for (ScheduledUnit& slot : schedule.slots) slot.time = start;
  bonds.start();
  for (const auto& solver : solvers_) solver->prepare();
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    GroupSolver* const solver = solver_of(g);
    if (solver != nullptr && may_diverge(g)) solver->choose_rule(start, first_tick());
  }
  watch_all();
  start_workers(threads_, always_threads_);
  return result;
}

void Engine::start_workers(int threads, bool always) {
  workers_.reset();
  const int cores = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::size_t widest = 0;
  for (const StageRun& stage : stages_) {
    if (stage.solver == nullptr) widest = std::max(widest, stage.slots.size());
  }
  int wanted = threads > 0 ? threads : cores;
  if (!always) wanted = std::min(wanted, cores);
  wanted = std::min({wanted, static_cast<int>(std::min<std::size_t>(widest, 255)), 255});
  if (wanted < 2) return;
  workers_ = std::make_unique<Workers>(wanted);
  wanted = workers_->threads();
  if (wanted < 2) return workers_.reset();
  const double barrier = workers_->barrier_seconds();
  for (StageRun& stage : stages_) {
    if (stage.slots.size() < 2 || stage.solver != nullptr) continue;
    std::vector<bool> movable;
    for (const ScheduledUnit& slot : stage.slots) movable.push_back(slot.threads);
    stage.unit_seconds.resize(movable.size());
    stage.balance = std::make_unique<Balance>(std::move(movable), wanted, barrier, always);
  }
}

void Engine::on_each_thread(Workers::Task task, void* context) {
  if (!workers_) return task(context, 0);
  std::array<std::uint8_t, 256> thread_of;
  std::iota(thread_of.begin(), thread_of.end(), std::uint8_t{0});
  workers_->run(std::span(thread_of).first(static_cast<std::size_t>(workers_->threads())), task, context);
}

/// A tick that is timed for the report and the balances, or that belongs to a trial of a balance.
std::size_t Engine::step_measured() {
  if (!on_trial_ && tick_.index >= next_trial_) begin_trial();
  const auto begin = Clock::now();
  const std::size_t discarded_by = parts_ == 1 ? step_part(tick_.begin, tick_.end) : step_in_parts();
  if (timed_) {
    report_costs();
  } else if (on_trial_ && parts_ == 1 && discarded_by == kNoSlot) {
    end_trial_tick(seconds_between(begin, Clock::now()));
  }
  return discarded_by;
}

std::size_t Engine::step_in_parts() {
  for (ScheduledUnit& slot : schedule.slots) slot.interval_begin = slot.time;
  std::size_t discarded_by = kNoSlot;
  Time begin = tick_.begin;
  for (part_ = 0; part_ < parts_ && discarded_by == kNoSlot && finished_by_ == kNoSlot; ++part_) {
    const Time end = cut(tick_.begin, tick_.end, part_, parts_);
    discarded_by = step_part(begin, end);
    begin = end;
  }
  return discarded_by;
}

/// A tick, or a part of one: the loop body of "One master step" in docs/architecture.md.
std::size_t Engine::step_part(Time begin, Time end) {
  events.apply(begin, end - begin);
  tools.check_load(begin);
  for (StageRun& stage : stages_) {
    exchange(stage);
    const std::size_t discarded_by = stage.solver == nullptr ? step_stage(stage) : solve(stage, begin, end);
    if (stage.ends_ramps && discarded_by == kNoSlot) end_ramps(stage);
    if (stage.once) note_stepped(stage);
    if (discarded_by != kNoSlot) [[unlikely]]
      return discarded_by;
  }
  if (!bonds.empty()) bonds.end_part(end - begin);
  return kNoSlot;
}

[[gnu::always_inline]] inline void Engine::exchange(const StageRun& stage) {
  if (stage.every_tick) {
    for (const Wiring::Copy& copy : stage.copies) Wiring::run(copy);
  } else {
    for (const ScheduledUnit& slot : stage.exchanged) {
      if (due(slot)) wiring.exchange(index(slot));
    }
  }
  if (!stage.begins_ramps) return;
  for (const ScheduledUnit& slot : stage.exchanged) {
    if (wiring.ramped(index(slot)) && due(slot)) wiring.begin_ramps(schedule.slots, index(slot), target(slot));
  }
}

void Engine::end_ramps(const StageRun& stage) {
  for (const ScheduledUnit& slot : stage.slots) {
    if (wiring.ramped(index(slot)) && due(slot)) wiring.end_ramps(index(slot));
  }
}

/// A unit that cannot be restored makes no second step in a tick, also if that of another unit is repeated.
void Engine::note_stepped(const StageRun& stage) {
  for (ScheduledUnit& slot : stage.slots) slot.stepped = slot.once && slot.time >= tick_.end;
}

[[gnu::always_inline]] inline std::size_t Engine::step_stage(StageRun& stage) {
  if (stage.balance && stage.balance->parallel()) return step_on_threads(stage);
  const bool all_in_one_part = stage.plain && parts_ == 1 && !timed_;
  return all_in_one_part ? step_in_turn<true>(stage.slots) : step_in_turn<false>(stage.slots);
}

/// `kAllInOnePart`: all units are due, over the whole tick, and are not timed. Then nothing is asked per unit, which saves a
/// third of the loop's own time where units are light.
template <bool kAllInOnePart>
[[gnu::always_inline]] inline std::size_t Engine::step_in_turn(std::span<ScheduledUnit> slots) {
  auto slot = slots.begin();
  const auto last = slots.end();
  const Time end = part_end_;
  try {
    for (; slot != last; ++slot) {
      if (!kAllInOnePart && !due(*slot)) continue;
      const StepResult result = kAllInOnePart ? step_slot(*slot, end) : step_due(*slot);
      if (result == StepResult::kDone) [[likely]]
        continue;
      if (result == StepResult::kDiscard) return index(*slot);
      if (finished_by_ == kNoSlot) finished_by_ = index(*slot);
    }
  } catch (const Error& error) {
    rethrow_named(*slot, error);
  }
  return kNoSlot;
}

/// Looks at exceptions and results in the order of the slots, whichever thread was first.
std::size_t Engine::step_on_threads(const StageRun& stage) {
  threads_used_ = workers_->threads();
  threaded_slots_ = stage.slots;
  workers_->run(stage.balance->thread_of(), step_on_worker, this);
  for (const ScheduledUnit& slot : stage.slots) {
    if (!exceptions_[index(slot)]) continue;
    const std::exception_ptr exception = exceptions_[index(slot)];
    std::fill(exceptions_.begin(), exceptions_.end(), nullptr);
    try {
      std::rethrow_exception(exception);
    } catch (const Error& error) {
      rethrow_named(slot, error);
    }
  }
  for (const ScheduledUnit& slot : stage.slots) {
    if (!due(slot)) continue;
    const std::size_t i = index(slot);
    if (results_[i] == StepResult::kDiscard) return i;
    if (results_[i] == StepResult::kFinished && finished_by_ == kNoSlot) finished_by_ = i;
  }
  return kNoSlot;
}

void Engine::step_on_worker(void* context, std::size_t index_in_stage) {
  Engine& engine = *static_cast<Engine*>(context);
  ScheduledUnit& slot = engine.threaded_slots_[index_in_stage];
  if (!engine.due(slot)) return;
  const std::size_t i = engine.index(slot);
  try {
    engine.results_[i] = engine.step_due(slot);
  } catch (...) {
    engine.exceptions_[i] = std::current_exception();
  }
}

/// One unit over the tick or its present part, timed where the tick is.
StepResult Engine::step_due(ScheduledUnit& slot) {
  if (!timed_) return slot.metered ? step_metered(slot, target(slot)) : step_slot(slot, target(slot));
  const auto begin = Clock::now();
  const StepResult result = slot.metered ? step_metered(slot, target(slot)) : step_slot(slot, target(slot));
  const std::size_t i = index(slot);
  seconds_[i] = std::max(0.0, seconds_between(begin, Clock::now()) - clock_seconds_);
  seconds_sum_[i] += seconds_[i];
  ++samples_[i];
  return result;
}

StepResult Engine::step_metered(ScheduledUnit& slot, Time end) {
  const Duration h = end - slot.time;
  bonds.begin(slot.member, h);
  const StepResult result = step_slot(slot, end);
  if (result != StepResult::kDiscard) bonds.end(slot.member, h);
  return result;
}

/// Steps a solved group.
std::size_t Engine::solve(StageRun& stage, Time begin, Time end) {
  const std::size_t first = index(stage.slots.front()), count = stage.slots.size();
  const std::span<double> seconds = timed_ ? std::span(seconds_).subspan(first, count) : std::span<double>();
  std::ranges::fill(seconds, 0);
  const ScheduledUnit* discarded_by = stage.solver->step(begin, end, seconds);
  for (std::size_t i = first; i < first + seconds.size(); ++i) {
    seconds_sum_[i] += seconds_[i];
    ++samples_[i];
  }
  if (discarded_by != nullptr) return index(*discarded_by);
  if (stage.solver->finished() != nullptr && finished_by_ == kNoSlot) finished_by_ = index(*stage.solver->finished());
  return kNoSlot;
}

void Engine::rethrow_named(const ScheduledUnit& slot, const Error& error) const {
  throw Error(name(index(slot)) + " at t = " + text::to_text(slot.time.seconds()) + " s", error.what());
}

void Engine::begin_trial() {
  for (StageRun& stage : stages_) {
    if (on_trial_ || !stage.balance || tick_.index < stage.balance->next_trial()) continue;
    on_trial_ = stage.balance.get();
    on_trial_->begin_trial();
  }
  find_next_trial();
}

void Engine::end_trial_tick(double seconds) {
  on_trial_->trial_tick(tick_.index, seconds);
  if (on_trial_->on_trial()) return;
  on_trial_ = nullptr;
  find_next_trial();
}

/// Passes the times of a timed tick to the balances.
void Engine::report_costs() {
  for (StageRun& stage : stages_) {
    if (!stage.balance) continue;
    for (std::size_t i = 0; i < stage.slots.size(); ++i)
      stage.unit_seconds[i] = due(stage.slots[i]) ? seconds_[index(stage.slots[i])] : 0;
    stage.balance->sampled(stage.unit_seconds);
  }
  find_next_trial();
}

void Engine::find_next_trial() {
  next_trial_ = on_trial_ ? 0 : kNever;
  if (on_trial_) return;
  for (const StageRun& stage : stages_) {
    if (stage.balance) next_trial_ = std::min(next_trial_, stage.balance->next_trial());
  }
}

Engine::Cost Engine::cost(std::size_t member, std::int64_t ticks, double tries) const {
  const std::size_t slot = schedule.slot_of[member];
  const double mean = samples_[slot] > 0 ? seconds_sum_[slot] / static_cast<double>(samples_[slot]) : 0;
  const bool every_try = schedule.slots[slot].period == 1 && !schedule.slots[slot].once;
  const auto steps = static_cast<double>(ticks / schedule.slots[slot].period);
  return {mean, every_try ? steps * tries : steps, samples_[slot]};
}

/// What a value that is not finite may come from: the loop of the member, if it is in one. Else "".
std::string Engine::loop_of(std::size_t member) const {
  constexpr std::size_t kMostNames = 6;
  for (std::size_t g = 0; g < groups_.size(); ++g) {
    if (std::ranges::find(groups_[g], member) == groups_[g].end()) continue;
    std::vector<std::string> names;
    for (const std::size_t m : groups_[g]) {
      if (names.size() < kMostNames) names.push_back(members_[m].name());
    }
    const std::string more = groups_[g].size() > kMostNames ? " and more" : "";
    return "; it is in the loop " + text::joined(names) + more +
           (loops_[g].solved
                ? ", which is solved in each step: if its values grow, expected a smaller tick"
                : ", which is stepped explicitly: if its values grow, expected coupling=implicit or a smaller tick") +
           " (cotwin check tells its gain)";
  }
  return "";
}

void Engine::report_non_finite(Time now) const {
  std::string first;
  for (const ScheduledUnit& slot :
       schedule.slots) {  // in the order of stepping: the first one found is the origin, unless it is in a loop
    const Member& member = members_[slot.member];
    const std::string loop = loop_of(slot.member);
    const bool is_maker = !loop.empty() && has_moderate_inputs(member);
    if (!first.empty() && !is_maker) continue;
    for (const Variable& v : member.variables()) {
      if (!is_watched(v)) continue;
      const std::span<double> values = v.reals();
      const auto broken = std::ranges::find_if(values, [](double x) { return !std::isfinite(x); });
      if (broken == values.end()) continue;
      const auto element = static_cast<std::size_t>(broken - values.begin());
      const std::string what = not_finite(member, v, element, *broken, now.seconds());
      if (is_maker) throw Error(what + kOwnFault);
      if (loop.empty()) throw Error(what);
      if (first.empty()) first = what + loop;
    }
  }
  throw Error(first.empty() ? "a value is not finite at t = " + text::to_text(now.seconds()) + " s" : first);
}

}  // namespace cotwin::master
