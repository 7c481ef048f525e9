#include "master/run/engine.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

std::vector<Signal> fed_signals(const std::vector<Link>& links) {
  std::vector<Signal> fed;
  for (const Link& link : links) {
    if (!link.initial) fed.push_back(link.to);
  }
  return fed;
}

double seconds_between(std::chrono::steady_clock::time_point a, std::chrono::steady_clock::time_point b) {
  return std::chrono::duration<double>(b - a).count();
}

constexpr std::size_t kLongRow = 4;

bool is_watched(const Variable& v) { return v.kind() == Kind::kReal && (v.role == Role::kOutput || v.role == Role::kState); }

}  // namespace

Engine::Engine(const Scenario& scenario, std::span<Member> members, int threads, bool always_threads)
    : schedule(scenario, members),
      links(resolve_links(scenario, members)),
      wiring(links, schedule),
      events(scenario, members, fed_signals(links)),
      members_(members),
      threads_(threads),
      always_threads_(always_threads),
      interval_begin_(schedule.slots.size()),
      results_(schedule.slots.size(), StepResult::kDone),
      exceptions_(schedule.slots.size()),
      seconds_(schedule.slots.size()),
      seconds_sum_(schedule.slots.size()),
      samples_(schedule.slots.size()) {
  for (const Stage& stage : schedule.stages) {
    StageRun& run = runs_.emplace_back();
    for (std::size_t i = stage.first; i < stage.last; ++i) run.ramps = run.ramps || wiring.ramped(i);
    plain_stages_.push_back({wiring.copies(stage.first, stage.last), slots_of(stage)});
  }
  watch_outputs();
}

void Engine::watch_outputs() {
  for (const Slot& slot : schedule.slots) {
    for (const Variable& v : members_[slot.member].variables()) {
      if (!is_watched(v) || v.size() == 0) continue;
      const std::span<double> values = v.reals();
      const bool continues = !watched_.empty() && watched_.back().values + watched_.back().count == values.data();
      if (continues) {
        watched_.back().count += values.size();
      } else {
        watched_.push_back({values.data(), values.size()});
      }
    }
  }
  std::erase_if(watched_, [&](const Watched& w) {
    if (w.count >= kLongRow) return false;
    for (std::size_t i = 0; i < w.count; ++i) watched_alone_.push_back(w.values + i);
    return true;
  });
}

Initialisation Engine::initialise(Time start) {
  for (Slot& slot : schedule.slots) {
    slot.time = start;
    slot.last_step = {};
  }
  if (!workers_) start_workers(threads_, always_threads_);
  constexpr int kReadings = 64;
  const auto begin = Clock::now();
  for (int i = 1; i < kReadings; ++i) (void)Clock::now();
  clock_seconds_ = seconds_between(begin, Clock::now()) / kReadings;
  return initialise_units(members_, schedule, links, wiring, start);
}

void Engine::start_workers(int threads, bool always) {
  const int machine = static_cast<int>(std::max(1u, std::thread::hardware_concurrency()));
  std::size_t widest = 0;
  for (const Stage& stage : schedule.stages) widest = std::max(widest, stage.last - stage.first);
  int wanted = threads > 0 ? threads : machine;
  if (!always) wanted = std::min(wanted, machine);
  wanted = std::min({wanted, static_cast<int>(std::min<std::size_t>(widest, 255)), 255});
  if (wanted < 2) return;
  workers_ = std::make_unique<Workers>(wanted);
  wanted = workers_->threads();
  if (wanted < 2) return workers_.reset();
  const double barrier = workers_->barrier_seconds();
  for (std::size_t s = 0; s < runs_.size(); ++s) {
    const Stage& stage = schedule.stages[s];
    if (stage.last - stage.first < 2) continue;
    std::vector<bool> movable;
    for (std::size_t i = stage.first; i < stage.last; ++i) movable.push_back(schedule.slots[i].threads);
    runs_[s].unit_seconds.resize(movable.size());
    runs_[s].balance = std::make_unique<Balance>(std::move(movable), wanted, barrier, always);
  }
}

std::size_t Engine::advance(std::int64_t tick, Time begin, Time end, int parts, bool sampled) {
  tick_ = tick;
  end_ = end;
  parts_ = parts;
  sampled_ = sampled;
  finished_by_ = kNobody;
  if (parts > 1) {
    for (std::size_t i = 0; i < schedule.slots.size(); ++i) interval_begin_[i] = schedule.slots[i].time;
  }
  for (StageRun& run : runs_) {
    if (!on_trial_ && run.balance && tick >= run.balance->next_trial()) {
      on_trial_ = run.balance.get();
      on_trial_->begin_trial();
    }
  }
  return on_trial_ && !sampled && parts == 1 ? step_on_trial(begin) : step_stages(begin);
}

/// As step_stages(), measured.
std::size_t Engine::step_on_trial(Time begin) {
  const auto start = Clock::now();
  const std::size_t who = step_stages(begin);
  if (who != kNobody) return who;
  on_trial_->trial_tick(tick_, seconds_between(start, Clock::now()));
  if (!on_trial_->on_trial()) on_trial_ = nullptr;
  return who;
}

std::size_t Engine::step_stages(Time begin) {
  for (part_ = 0; part_ < parts_ && finished_by_ == kNobody; ++part_) {
    const Time from = part_ == 0 ? begin : cut(begin, end_, part_ - 1, parts_);
    events.apply(from, cut(begin, end_, part_, parts_) - from);
    for (std::size_t s = 0; s < schedule.stages.size(); ++s) {
      const Stage& stage = schedule.stages[s];
      StageRun& run = runs_[s];
      exchange(stage, run.ramps);
      std::size_t who = kNobody;
      if (sampled_ && run.balance) {
        step_sampled(stage, run, &who);
      } else {
        who = run.balance && run.balance->parallel() ? step_on_threads(stage, run) : step_in_turn(stage);
      }
      if (who != kNobody) return who;
      if (!run.ramps) continue;
      for (std::size_t i = stage.first; i < stage.last; ++i) {
        if (wiring.ramped(i) && due(schedule.slots[i])) wiring.end_ramps(i);
      }
    }
  }
  return kNobody;
}

std::int64_t Engine::plain_until(std::int64_t tick) const {
  std::int64_t until = std::min(schedule.ticks() - 1, schedule.first_tick_from(events.next_time()));
  for (std::size_t s = 0; s < runs_.size(); ++s) {
    const Balance* balance = runs_[s].balance.get();
    const bool spread = balance && (balance->parallel() || balance->on_trial());
    if (!schedule.stages[s].every_tick || runs_[s].ramps || spread) return tick;
    if (balance) until = std::min(until, balance->next_trial());
  }
  return until;
}

void Engine::exchange(const Stage& stage, bool ramps) {
  if (stage.every_tick) {
    wiring.exchange(stage.first, stage.last);
  } else {
    for (std::size_t i = stage.first; i < stage.last; ++i) {
      if (due(schedule.slots[i])) wiring.exchange(i, i + 1);
    }
  }
  if (!ramps) return;
  for (std::size_t i = stage.first; i < stage.last; ++i) {
    const Slot& slot = schedule.slots[i];
    if (wiring.ramped(i) && due(slot)) wiring.begin_ramps(i, target(i) - slot.time, slot.last_step);
  }
}

std::size_t Engine::step_in_turn(const Stage& stage) {
  if (sampled_) return step_range<true, false>(slots_of(stage), end_);
  return stage.every_tick && parts_ == 1 ? step_range<false, true>(slots_of(stage), end_)
                                         : step_range<false, false>(slots_of(stage), end_);
}

std::size_t Engine::step_on_threads(const Stage& stage, StageRun& run) {
  spread_ever_ = true;
  first_ = stage.first;
  workers_->run(run.balance->thread_of(), step_on_worker, this);
  for (std::size_t i = stage.first; i < stage.last; ++i) {  // in a fixed order, whoever was first
    if (!exceptions_[i]) continue;
    const std::exception_ptr exception = exceptions_[i];
    std::fill(exceptions_.begin(), exceptions_.end(), nullptr);
    try {
      std::rethrow_exception(exception);
    } catch (const Error& error) {
      tell_who(i, error);
    }
  }
  for (std::size_t i = stage.first; i < stage.last; ++i) {
    if (!due(schedule.slots[i])) continue;
    if (results_[i] == StepResult::kDiscard) return i;
    if (results_[i] == StepResult::kFinished && finished_by_ == kNobody) finished_by_ = i;
  }
  return kNobody;
}

void Engine::step_sampled(const Stage& stage, StageRun& run, std::size_t* who) {
  *who = run.balance->parallel() ? step_on_threads(stage, run) : step_in_turn(stage);
  for (std::size_t i = stage.first; i < stage.last; ++i) {
    run.unit_seconds[i - stage.first] = due(schedule.slots[i]) ? seconds_[i] : 0;
  }
  run.balance->sampled(run.unit_seconds);
}

void Engine::tell_who(std::size_t i, const Error& error) const {
  throw Error(name(i) + " at t = " + text::to_text(schedule.slots[i].time.seconds()) + " s", error.what());
}

StepResult Engine::step_timed(std::size_t i) {
  const auto begin = Clock::now();
  const StepResult result = step(schedule.slots[i], target(i));
  seconds_[i] = std::max(0.0, seconds_between(begin, Clock::now()) - clock_seconds_);
  seconds_sum_[i] += seconds_[i];
  ++samples_[i];
  return result;
}

void Engine::step_on_worker(void* context, std::size_t index) {
  Engine& engine = *static_cast<Engine*>(context);
  const std::size_t i = engine.first_ + index;
  if (!engine.due(engine.schedule.slots[i])) return;
  try {
    engine.results_[i] = engine.sampled_ ? engine.step_timed(i) : engine.step(engine.schedule.slots[i], engine.target(i));
  } catch (...) {
    engine.exceptions_[i] = std::current_exception();
  }
}

std::uint64_t Engine::look_at_rows() const {
  std::uint64_t seen = 0;
  for (const Watched& w : watched_) {
    for (std::size_t i = 0; i < w.count; ++i) seen |= sign_if_not_finite(w.values[i]);
  }
  return seen;
}

Engine::Cost Engine::cost(std::size_t member, std::int64_t ticks) const {
  const std::size_t slot = schedule.slot_of[member];
  const double mean = samples_[slot] > 0 ? seconds_sum_[slot] / static_cast<double>(samples_[slot]) : 0;
  return {mean, ticks / schedule.slots[slot].period, samples_[slot]};
}

void Engine::tell_not_a_number(Time now) const {
  for (const Slot& slot : schedule.slots) {  // in the order of stepping: the first is where it came from
    for (const Variable& v : members_[slot.member].variables()) {
      if (!is_watched(v)) continue;
      const std::span<double> values = v.reals();
      for (std::size_t i = 0; i < values.size(); ++i) {
        if (std::isfinite(values[i])) continue;
        const std::string& member = members_[slot.member].name();
        throw Error(element_name(member, v, i) + " is " + text::to_text(values[i]) + " at t = " + text::to_text(now.seconds()) +
                    " s, expected a finite " + std::string(name_of(v.role)));
      }
    }
  }
  throw Error("a value is not finite at t = " + text::to_text(now.seconds()) + " s");
}

}  // namespace cotwin::master
