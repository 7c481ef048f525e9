#include "master/run/step_control.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::int64_t kNever = std::numeric_limits<std::int64_t>::max();
constexpr std::int64_t kCarefulTicks = 64;  // after a discarded one, with a checkpoint each

}  // namespace

void Checkpoint::take(std::int64_t tick, std::span<const Member> members, const Schedule& schedule, const Events& events) {
  tick_ = tick;
  snapshots_.resize(members.size());
  for (std::size_t m = 0; m < members.size(); ++m) snapshots_[m].take(members[m].variables(), *members[m].instance.unit);
  progress_.clear();
  for (const Slot& slot : schedule.slots) progress_.push_back({slot.time, slot.last_step});
  events.save(events_);
}

void Checkpoint::restore(std::span<const Member> members, Schedule& schedule, Events& events) const {
  for (std::size_t m = 0; m < members.size(); ++m) snapshots_[m].restore(members[m].variables(), *members[m].instance.unit);
  for (std::size_t i = 0; i < progress_.size(); ++i) {
    schedule.slots[i].time = progress_[i].time;
    schedule.slots[i].last_step = progress_[i].last_step;
  }
  events.restore(events_);
}

void Checkpoint::write(ByteWriter& out) const {
  out.value(tick_);
  out.value(static_cast<std::uint64_t>(snapshots_.size()));
  for (const Snapshot& snapshot : snapshots_) out.text(snapshot.serialise());
  out.value(static_cast<std::uint64_t>(progress_.size()));
  for (const Progress& p : progress_) {
    out.value(p.time.ns);
    out.value(p.last_step.ns);
  }
  events_.write(out);
}

void Checkpoint::read(ByteReader& in, std::span<const Member> members, const Schedule& schedule, const Events& events) {
  tick_ = in.value<std::int64_t>();
  if (tick_ < 0 || tick_ > schedule.ticks()) in.fail("is at tick " + std::to_string(tick_) + " of another run");
  if (in.count(sizeof(std::uint64_t)) != members.size()) in.fail("has the states of other units");
  snapshots_.clear();
  for (std::size_t m = 0; m < members.size(); ++m) snapshots_.push_back(Snapshot::deserialise(in.text()));
  if (in.count(2 * sizeof(std::int64_t)) != schedule.slots.size()) in.fail("has the states of other units");
  progress_.clear();
  for (std::size_t i = 0; i < schedule.slots.size(); ++i) {
    const Time time{in.value<std::int64_t>()};
    const Duration last{in.value<std::int64_t>()};
    if (time < schedule.time(0) || time > schedule.time(tick_) || last.ns < 0) in.fail("has impossible times of steps");
    progress_.push_back({time, last});
  }
  events_.read(in);
  if (!events.is_valid(events_)) in.fail("is amid other events");
}

OutputError::OutputError(std::span<const Member> members, double tolerance) : tolerance_(tolerance) {
  std::size_t size = 0;
  for (const Member& member : members) {
    for (const Variable& v : member.variables()) {
      if (v.role != Role::kOutput || v.kind() != Kind::kReal) continue;
      outputs_.push_back({v.reals(), size, kFloor});
      size += v.size();
    }
  }
  remembered_.resize(size);
}

void OutputError::remember() {
  for (const Output& o : outputs_)
    std::copy(o.values.begin(), o.values.end(), remembered_.begin() + static_cast<std::ptrdiff_t>(o.at));
}

double OutputError::compare() {
  double worst = 0;
  for (Output& o : outputs_) {
    double difference = 0;
    for (std::size_t i = 0; i < o.values.size(); ++i) {
      o.scale = std::max(o.scale, std::abs(o.values[i]));
      difference = std::max(difference, std::abs(o.values[i] - remembered_[o.at + i]));
    }
    worst = std::max(worst, difference / (tolerance_ * o.scale));
  }
  return worst;
}

void OutputError::write(ByteWriter& out) const {
  out.value(static_cast<std::uint64_t>(outputs_.size()));
  for (const Output& o : outputs_) out.value(o.scale);
}

void OutputError::read(ByteReader& in) {
  if (in.count(sizeof(double)) != outputs_.size()) in.fail("has the scales of other outputs");
  for (Output& o : outputs_) o.scale = in.value<double>();
}

StepControl::StepControl(Engine& engine, std::span<const Member> members, double tolerance, Recall recall)
    : engine_(engine), members_(members), recall_(std::move(recall)), discarded_by_(members.size()) {
  const auto found = std::ranges::find_if(members, [](const Member& m) { return !m.instance.unit->restorable(); });
  if (found != members.end()) {
    not_restorable_ = &*found;
    next_checkpoint_ = kNever;
  }
  if (tolerance > 0) output_error_.emplace(members, tolerance);
}

void StepControl::initialise() {
  if (not_restorable_ == nullptr) take_checkpoint(0);
  if (output_error_) output_error_->remember();
}

void StepControl::take_checkpoint(std::int64_t tick) {
  checkpoint_.take(tick, members_, engine_.schedule, engine_.events);
  find_next_checkpoint(tick);
}

void StepControl::find_next_checkpoint(std::int64_t tick) {
  const bool every_tick = tick < careful_until_ || output_error_;
  next_checkpoint_ = every_tick ? tick + 1 : (tick / kCheckpointEvery + 1) * kCheckpointEvery;
}

/// Restores the last checkpoint and steps the ticks since then again, to the same bits. In most runs this is cheaper than a
/// checkpoint in every tick.
void StepControl::replay_until(std::int64_t tick) {
  restore_checkpoint();
  for (std::int64_t past = checkpoint_.tick(); past < tick; ++past) {
    const Tick again = recall_(past);
    const std::size_t discarded_by = engine_.step(again);
    if (discarded_by == Engine::kNoSlot) continue;
    throw Error("'" + engine_.name(discarded_by) + "' discards at t = " + text::to_text(again.begin.seconds()) +
                " s a step that it has made before: its declared variables do not contain its whole state");
  }
  recall_(tick);
  careful_until_ = tick + kCarefulTicks;
  take_checkpoint(tick);
}

std::size_t StepControl::step_in_parts(const Tick& tick, std::size_t discarded_by) {
  count_discard(discarded_by);
  if (not_restorable_) return discarded_by;
  replay_until(tick.index);
  for (int parts = 2; parts <= kMostParts; parts *= 2) {
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

/// Step doubling: the tick in p parts is compared with the tick in 2p, which is kept if they agree within the tolerance;
/// otherwise p is doubled. Where they agree within an eighth of it, the next tick begins with half the parts.
std::size_t StepControl::step_to_tolerance(const Tick& tick, bool timed) {
  std::size_t discarded_by = Engine::kNoSlot;
  const auto try_parts = [&](int parts, bool timed_try) {
    discarded_by = engine_.step(tick, parts, timed_try);
    if (discarded_by != Engine::kNoSlot) count_discard(discarded_by);
    return discarded_by == Engine::kNoSlot;
  };
  bool has_coarse = try_parts(parts_, timed);
  for (;; parts_ *= 2) {
    if (has_coarse) output_error_->remember();
    restore_checkpoint();
    const int finer = 2 * parts_;
    const bool made = try_parts(finer, false);
    const double error = made && has_coarse ? output_error_->compare() : std::numeric_limits<double>::infinity();
    has_coarse = made;
    if (finer < kMostParts && !(error <= 1)) continue;
    if (!made) return discarded_by;
    if (!(error <= 1)) ++tolerance_missed_;
    parts_sum_ += finer;
    most_parts_ = std::max(most_parts_, finer);
    if (error <= 0.125) parts_ = std::max(1, parts_ / 2);
    return Engine::kNoSlot;
  }
}

std::int64_t StepControl::discarded() const {
  return std::accumulate(discarded_by_.begin(), discarded_by_.end(), std::int64_t{0});
}

double StepControl::mean_parts(std::int64_t ticks) const {
  return output_error_ && ticks > 0 ? static_cast<double>(parts_sum_) / static_cast<double>(ticks) : 1;
}

void StepControl::write(ByteWriter& out) const {
  checkpoint_.write(out);
  out.value(careful_until_);
  out.value(static_cast<std::uint64_t>(discarded_by_.size()));
  for (const std::int64_t count : discarded_by_) out.value(count);
  out.value(static_cast<std::int32_t>(parts_));
  out.value(static_cast<std::int32_t>(most_parts_));
  out.value(parts_sum_);
  out.value(tolerance_missed_);
  out.value(static_cast<std::uint8_t>(output_error_.has_value()));
  if (output_error_) output_error_->write(out);
}

std::int64_t StepControl::restore(ByteReader& in) {
  checkpoint_.read(in, members_, engine_.schedule, engine_.events);
  careful_until_ = in.value<std::int64_t>();
  if (in.count(sizeof(std::int64_t)) != discarded_by_.size()) in.fail("has the states of other units");
  for (std::int64_t& count : discarded_by_) count = in.value<std::int64_t>();
  parts_ = in.value<std::int32_t>();
  most_parts_ = in.value<std::int32_t>();
  if (parts_ < 1 || parts_ > kMostParts || most_parts_ < 1) in.fail("is damaged");
  parts_sum_ = in.value<std::int64_t>();
  tolerance_missed_ = in.value<std::int64_t>();
  if ((in.value<std::uint8_t>() != 0) != output_error_.has_value()) in.fail("is of another tolerance");
  if (output_error_) output_error_->read(in);
  restore_checkpoint();
  find_next_checkpoint(checkpoint_.tick());
  return checkpoint_.tick();
}

}  // namespace cotwin::master
