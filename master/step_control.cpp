#include "master/step_control.h"

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

}  // namespace cotwin::master
