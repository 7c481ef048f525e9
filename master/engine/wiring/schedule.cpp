#include "master/engine/wiring/schedule.h"

#include <algorithm>
#include <limits>
#include <numeric>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

Schedule::Schedule(const Scenario& scenario, std::span<const Member> members, const Arrangement& arrangement)
    : start_(scenario.start), stop_(scenario.stop), tick_(scenario.tick) {
  const std::string place = scenario.file.filename().string();
  if (tick_.ns <= 0) fail(place, "tick " + text::to_text(tick_.seconds()) + " s, expected > 0");
  if (stop_ <= start_) {
    fail(place, "the run would stop at " + text::to_text(stop_.seconds()) + " s, expected a stop time after " +
                    text::to_text(start_.seconds()) + " s: give --stop SECONDS");
  }
  const std::uint64_t span = static_cast<std::uint64_t>(stop_.ns) - static_cast<std::uint64_t>(start_.ns);
  constexpr Duration kLongest{std::numeric_limits<std::int64_t>::max()};
  if (span > static_cast<std::uint64_t>(kLongest.ns)) {
    fail(place, "the run would last from " + text::to_text(start_.seconds(), 12) + " s to " +
                    text::to_text(stop_.seconds(), 12) + " s, " + text::to_text(static_cast<double>(span) / 1e9, 12) +
                    " s, expected at most " + text::to_text(kLongest.seconds(), 12) + " s");
  }
  ticks_ = ((stop_ - start_).ns - 1) / tick_.ns + 1;

  std::vector<std::size_t> order(members.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  // Units that step explicitly, with group number −1 + 1 = 0, come first in their stage.
  const auto key = [&](std::size_t m) { return std::pair(arrangement.stage[m], arrangement.group_of[m] + 1); };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  slot_of.resize(members.size());
  for (const std::size_t m : order) {
    const ComponentSpec& spec = members[m].spec;
    if (spec.period < 1)
      fail(spec.place, "component '" + spec.name + "': period " + std::to_string(spec.period) + ", expected >= 1 ticks");
    const bool opens_stage = slots.empty() || key(slots.back().member) != key(m);
    if (opens_stage) stages.push_back({slots.size(), slots.size(), arrangement.stage[m], arrangement.group_of[m], true});
    slot_of[m] = slots.size();
    slots.push_back({members[m].instance.unit.get(), m, spec.period, spec.threads, start_, {}, {}});
    slots.back().once = !members[m].instance.unit->restorable();
    stages.back().last = slots.size();
    stages.back().every_tick = stages.back().every_tick && spec.period == 1;
  }
}

Tick Schedule::long_tick(std::int64_t n, std::int64_t more, Time event) const {
  const Time begin = time(n);
  if (event > begin && event < stop_) more = std::min(more, (event.ns - begin.ns - 1) / tick_.ns);
  more = std::clamp<std::int64_t>(more, 0, ticks_ - 1 - n);
  return {n + more, begin, time(n + more + 1), more};
}

}  // namespace cotwin::master
