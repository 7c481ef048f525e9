#include "master/engine/step_control.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/fields.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t kWatchEvery = 4096;  // ticks between two measurements of the gains of loops, at checkpoints
constexpr std::int64_t kCarefulTicks = 64;  // after a discarded one, with a checkpoint each

// Steps to a tolerance. A jump within a step of the shortest length changes an integral over the tick by no more than the
// tolerance, as part of the jump.
constexpr double kShortest = 1.0 / 1024;  // of the tick; or the tolerance if that is smaller
constexpr double kFirst = 0.0073;         // of the tick, for the first step and after an event; no simple fraction, so that a
                                          // signal with such a period is seen
constexpr double kDiscardError = 2.56;    // counts for a discarded step: the next one has half its length

/// Length of the next step / length of one with this error.
double factor(double error) { return std::clamp(0.8 / std::sqrt(std::max(error, 1e-12)), 0.3, 2.0); }

int most_parts_of(const Tick& tick) { return static_cast<int>(std::min<std::int64_t>(kMostParts, (tick.end - tick.begin).ns)); }

}  // namespace

void Checkpoint::take(std::int64_t tick, std::span<const Member> members, const Engine& engine) {
  tick_ = tick;
  snapshots_.resize(members.size());
  progress_.resize(members.size());
  for (const ScheduledUnit& slot : engine.schedule.slots) {
    const Member& member = members[slot.member];
    if (!slot.once) snapshots_[slot.member].take(member.variables(), *slot.unit);
    progress_[slot.member] = {slot.time, slot.last_step};
  }
  engine.events.save(events_);
  engine.save_coupling(coupling_);
}

void Checkpoint::restore(std::span<const Member> members, Engine& engine) const {
  for (ScheduledUnit& slot : engine.schedule.slots) {
    if (slot.once) continue;
    snapshots_[slot.member].restore(members[slot.member].variables(), *slot.unit);
    slot.time = progress_[slot.member].time;
    slot.last_step = progress_[slot.member].last_step;
  }
  engine.events.restore(events_);
  engine.restore_coupling(coupling_);
}

void Checkpoint::read(ByteReader& in, std::span<const Member> members, const Engine& engine) {
  const Schedule& schedule = engine.schedule;
  Getter(in).get(*this);
  if (tick_ < 0 || tick_ > schedule.ticks()) in.fail("is at tick " + std::to_string(tick_) + " of another run");
  if (snapshots_.size() != members.size() || progress_.size() != members.size()) in.fail("has the states of other units");
  for (const Progress& p : progress_) {
    if (p.time < schedule.time(0) || p.time > schedule.time(tick_) || p.last_step.ns < 0)
      in.fail("has impossible times of steps");
  }
  if (!engine.events.is_valid(events_)) in.fail("is amid other events");
  if (!engine.is_coupling(coupling_)) in.fail("has other loops");
}

StepControl::StepControl(Engine& engine, std::span<const Member> members, double tolerance, Recall recall, bool repeats)
    : engine_(engine),
      members_(members),
      recall_(std::move(recall)),
      discarded_by_(members.size()),
      repeats_(repeats),
      tolerance_(tolerance) {
  const auto found = std::ranges::find_if(members, [](const Member& m) { return !m.instance.unit->restorable(); });
  if (found != members.end()) {
    not_restorable_ = &*found;
    next_checkpoint_ = kNever;
  }
  if (tolerance > 0) input_error_.emplace(engine.links, members, tolerance);
}

void StepControl::initialise() {
  if (not_restorable_ == nullptr) save_checkpoint(0);
  if (!input_error_) return;
  input_error_->start(engine_);
  step_begin_.take(0, members_, engine_);
  energies_.assign(engine_.bonds.state().begin(), engine_.bonds.state().end());
  next_ = {};
}

bool StepControl::save_checkpoint(std::int64_t tick) {
  const std::int64_t regular = (checkpoint_.tick() / kCheckpointEvery + 1) * kCheckpointEvery;
  const bool may_wait = checkpoint_.tick() >= 0 && next_checkpoint_ >= regular && tick < regular + kMostWaiting;
  if (may_wait && engine_.is_rising() && engine_.may_change()) {
    next_checkpoint_ = tick + 1;
    return false;
  }
  if (tick > 0 && tick % kWatchEvery == 0 && !input_error_) {
    const Tick next = engine_.schedule.tick(tick);
    if (const auto change = engine_.watch_loops(next.begin, next.end - next.begin)) engine_.apply(*change);
  }
  checkpoint_.take(tick, members_, engine_);
  find_next_checkpoint(tick);
  return true;
}

std::size_t StepControl::end_growth(const Tick& tick) {
  constexpr int kMostTimes = 3;
  const std::optional<Engine::CouplingChange> change = engine_.find_coupling_change(tick.end, tick.end - tick.begin);
  if (!change) return Engine::kNoSlot;
  if (input_error_) {  // with a checkpoint in every tick there is nothing to go back to
    engine_.apply(*change);
    input_error_->start(engine_);
    next_checkpoint_ = 0;
    return Engine::kNoSlot;
  }
  const std::int64_t from = checkpoint_.tick();
  times_rewound_ = std::exchange(last_rewound_, from) == from ? times_rewound_ + 1 : 1;
  if (not_restorable_ != nullptr || times_rewound_ > kMostTimes) {  // or changes that alternate
    engine_.apply(*change);
    if (not_restorable_ == nullptr) next_checkpoint_ = 0;
    return Engine::kNoSlot;
  }
  restore_checkpoint();
  engine_.apply(*change);
  checkpoint_.take(from, members_, engine_);
  find_next_checkpoint(from);
  if (!repeats_) {
    rewound_ = from;
    return Engine::kNoSlot;
  }
  std::size_t discarded_by = Engine::kNoSlot;
  for (std::int64_t past = from; past <= tick.index && discarded_by == Engine::kNoSlot; ++past)
    discarded_by = step(recall_(past));
  return discarded_by;
}

void StepControl::find_next_checkpoint(std::int64_t tick) {
  const bool every_tick = tick < careful_until_ || input_error_;
  next_checkpoint_ = every_tick ? tick + 1 : (tick / kCheckpointEvery + 1) * kCheckpointEvery;
}

/// Restores the last checkpoint and steps the ticks since then again, to the same bits. In most runs this is cheaper than a
/// checkpoint in every tick.
void StepControl::replay_until(std::int64_t tick) {
  restore_checkpoint();
  for (std::int64_t past = checkpoint_.tick(); past < tick; ++past) {
    const Tick again = recall_(past);
    const std::size_t discarded_by = engine_.step(again);
    if (discarded_by == Engine::kNoSlot) {
      engine_.watch_growth();
      continue;
    }
    throw Error("'" + engine_.name(discarded_by) + "' discards at t = " + text::to_text(again.begin.seconds()) +
                " s a step that it has made before: its declared variables do not contain its whole state");
  }
  recall_(tick);
  careful_until_ = tick + kCarefulTicks;
  checkpoint_.take(tick, members_, engine_);
  find_next_checkpoint(tick);
}

std::size_t StepControl::step_in_parts(const Tick& tick, std::size_t discarded_by) {
  count_discard(discarded_by);
  if (not_restorable_) return discarded_by;
  replay_until(tick.index - tick.skipped);
  for (int parts = 2; parts <= most_parts_of(tick); parts *= 2) {
    discarded_by = engine_.step(tick, parts);
    if (discarded_by == Engine::kNoSlot) {
      most_parts_ = std::max(most_parts_, parts);
      return discarded_by;
    }
    restore_checkpoint();
  }
  forget();
  return discarded_by;
}

/// Length of the next step, so that no short rest is left before the next event or the end of the tick.
Duration StepControl::length(Duration left) const {
  if (next_ >= left) return left;
  return 2 * next_ > left ? Duration{(left.ns + 1) / 2} : next_;
}

void StepControl::choose_next(Duration made, double error, Duration shortest, Duration longest) {
  const Duration proposed{static_cast<std::int64_t>(factor(error) * static_cast<double>(made.ns))};
  const bool shortened = made < next_ && proposed >= made;  // for an event or the end of the tick
  next_ = std::clamp(shortened ? std::max(next_, proposed) : proposed, shortest, longest);
}

/// Steps of free length that end at the events and at the end of the tick. A step whose error is too large, or that a unit
/// discards, is repeated with a shorter one.
std::size_t StepControl::step_to_tolerance(const Tick& tick, bool timed) {
  const Duration whole = tick.end - tick.begin;
  const auto share = [&](double s) {
    return Duration{std::max<std::int64_t>(1, std::llround(s * static_cast<double>(whole.ns)))};
  };
  const Duration shortest = share(std::min(kShortest, tolerance_)), first = std::max(shortest, share(kFirst));
  if (std::exchange(jump_, false)) next_ = std::min(next_, first);
  if (next_.ns == 0) next_ = first;
  int parts = 0;
  Time now = tick.begin;
  bool finished = false;
  engine_.begin_tick();
  while (now < tick.end && !finished) {
    const Time event = engine_.events.next_after(now), limit = std::min(tick.end, event);
    const Duration h = length(limit - now);
    step_begin_.take(tick.index, members_, engine_);
    energies_.assign(engine_.bonds.state().begin(), engine_.bonds.state().end());
    input_error_->begin(h);
    const std::size_t discarded_by = engine_.step_between(tick, now, now + h, timed);
    const bool is_discarded = discarded_by != Engine::kNoSlot;
    if (is_discarded) {
      count_discard(discarded_by);
      if (h <= shortest || engine_.schedule.slots[discarded_by].once) return discarded_by;
    }
    const double error =
        is_discarded ? kDiscardError : std::max(input_error_->end(), engine_.bonds.error(energies_, tolerance_));
    if (is_discarded || (error > 1 && h > shortest)) {
      ++rejected_;
      next_ = std::max(shortest, Duration{static_cast<std::int64_t>(factor(error) * static_cast<double>(h.ns))});
      step_begin_.restore(members_, engine_);
      continue;
    }
    if (error > 1) ++tolerance_missed_;
    input_error_->accept(h, h <= shortest);
    finished = engine_.finished_by() != Engine::kNoSlot;
    now = now + h;
    ++parts;
    choose_next(h, error, shortest, whole);
    if (now == event) next_ = std::min(next_, first);
  }
  parts_sum_ += parts;
  most_parts_ = std::max(most_parts_, parts);
  return Engine::kNoSlot;
}

std::int64_t StepControl::discarded() const {
  return std::accumulate(discarded_by_.begin(), discarded_by_.end(), std::int64_t{0});
}

double StepControl::mean_parts(std::int64_t ticks) const {
  return input_error_ && ticks > 0 ? static_cast<double>(parts_sum_) / static_cast<double>(ticks) : 1;
}

double StepControl::mean_tries(std::int64_t ticks) const {
  return input_error_ && ticks > 0 ? static_cast<double>(parts_sum_ + rejected_) / static_cast<double>(ticks) : 1;
}

void StepControl::write(ByteWriter& out) const {
  Putter(out).put(checkpoint_, *this);
  engine_.write_counts(out);
  Putter(out).put(input_error_.has_value());
  if (input_error_) Putter(out).put(*input_error_);
}

std::int64_t StepControl::restore(ByteReader& in) {
  checkpoint_.read(in, members_, engine_);
  restore_checkpoint();
  Getter(in).get(*this);
  if (discarded_by_.size() != members_.size()) in.fail("has the states of other units");
  if (most_parts_ < 1 || next_.ns < 0) in.fail("is damaged");
  engine_.read_counts(in);
  bool has_tolerance = false;
  Getter(in).get(has_tolerance);
  if (has_tolerance != input_error_.has_value()) in.fail("is of another tolerance");
  if (input_error_) input_error_->read(in);
  find_next_checkpoint(checkpoint_.tick());
  return checkpoint_.tick();
}

}  // namespace cotwin::master
