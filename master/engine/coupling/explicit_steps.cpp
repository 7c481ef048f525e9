#include "master/engine/coupling/explicit_steps.h"

#include <algorithm>
#include <cmath>

#include "master/engine/wiring/arrangement.h"

namespace cotwin::master {

namespace {

std::vector<ResolvedConnection> links_within(const std::vector<ResolvedConnection>& links, std::span<const std::size_t> group) {
  const auto in_group = [&](std::size_t member) { return std::ranges::find(group, member) != group.end(); };
  std::vector<ResolvedConnection> within;
  for (const ResolvedConnection& link : links) {
    if (!link.initial && in_group(link.from.member) && in_group(link.to.member)) within.push_back(link);
  }
  return within;
}

}  // namespace

ExplicitSteps::ExplicitSteps(const Scenario& scenario, std::span<const Member> members,
                             const std::vector<ResolvedConnection>& links, std::span<const std::size_t> group)
    : members_(members),
      schedule_(scenario, members, arrange_as_given(members)),
      wiring_(links_within(links, group), schedule_, arrange_as_given(members).group_of) {
  for (ScheduledUnit& slot : schedule_.slots) {
    if (std::ranges::find(group, slot.member) != group.end()) slots_.push_back(&slot);
  }
  for (const ResolvedConnection& link : links_within(links, group)) {
    if (!is_continuous(link)) continue;
    for (double& value : link.from.reals()) {
      if (std::ranges::find(values_, &value) != values_.end()) continue;
      values_.push_back(&value);
      magnitudes_.push_back(std::max(magnitude_of(*link.from.variable), std::abs(value)));
    }
  }
}

void ExplicitSteps::deviate() {
  for (std::size_t k = 0; k < values_.size(); ++k) *values_[k] += deviation_of(k) * magnitudes_[k];
}

bool ExplicitSteps::step(Time begin, Duration h) {
  const auto index = [&](const ScheduledUnit* slot) { return static_cast<std::size_t>(slot - schedule_.slots.data()); };
  for (ScheduledUnit* slot : slots_) slot->time = begin;
  for (auto first = slots_.begin(); first != slots_.end();) {
    const int stage = members_[(*first)->member].spec.stage;
    const auto last =
        std::find_if(first, slots_.end(), [&](const ScheduledUnit* s) { return members_[s->member].spec.stage != stage; });
    for (auto slot = first; slot != last; ++slot) wiring_.exchange(index(*slot));
    for (auto slot = first; slot != last; ++slot) wiring_.begin_ramps(schedule_.slots, index(*slot), begin + h);
    for (auto slot = first; slot != last; ++slot) {
      (*slot)->last_step = h;
      if ((*slot)->unit->step(begin, h) == StepResult::kDiscard) return false;
      (*slot)->time = begin + h;
      wiring_.end_ramps(index(*slot));
    }
    first = last;
  }
  return true;
}

}  // namespace cotwin::master
