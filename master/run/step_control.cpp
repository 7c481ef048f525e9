#include "master/run/step_control.h"

#include <algorithm>
#include <cmath>

namespace cotwin::master {

void Checkpoint::take(std::int64_t tick, std::span<const Member> members, const Schedule& schedule, const Events& events) {
  tick_ = tick;
  snapshots_.resize(members.size());
  for (std::size_t m = 0; m < members.size(); ++m) snapshots_[m].take(members[m].variables(), *members[m].instance.unit);
  progress_.clear();
  for (const Slot& slot : schedule.slots) progress_.push_back({slot.time, slot.last_step});
  events.mark(events_);
}

void Checkpoint::restore(std::span<const Member> members, Schedule& schedule, Events& events) const {
  for (std::size_t m = 0; m < members.size(); ++m) snapshots_[m].restore(members[m].variables(), *members[m].instance.unit);
  for (std::size_t i = 0; i < progress_.size(); ++i) {
    schedule.slots[i].time = progress_[i].time;
    schedule.slots[i].last_step = progress_[i].last_step;
  }
  events.back_to(events_);
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
  if (!events.fits(events_)) in.fail("is amid other events");
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

double OutputError::against_remembered() {
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

}  // namespace cotwin::master
