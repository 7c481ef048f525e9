#pragma once
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/wiring/members.h"

/// Which unit steps when. Tick n lasts from start + n·tick to start + (n+1)·tick, or to the stop time if that is earlier.
/// Within a tick the stages run in the order of their numbers; within a stage all inputs are copied first, then all due units
/// step. A unit with a period of p ticks is due in the tick that ends its period and then steps over the whole period, so that
/// no output is ahead of the time at which it is read. In the last tick all units are due and step to the stop time.
namespace cotwin::master {

inline constexpr std::size_t kNoGroup = static_cast<std::size_t>(-1);

struct Tick {
  std::int64_t index = 0;
  Time begin, end;
  std::int64_t skipped = 0;  // ticks before this one that were left out: it also covers their time
};

/// One unit. Slots are in the order of stepping: by stage and group, then as in the scenario.
struct ScheduledUnit {
  Unit* unit = nullptr;
  std::size_t member = 0;
  std::int64_t period = 1;
  bool threads = true;

  Time time;            // end of its last step
  Duration last_step;   // its length; 0 before the first
  Time interval_begin;  // in a tick of several parts: begin of the first part

  bool once = false;     // cannot be restored: steps over whole ticks, also where others make shorter steps
  bool stepped = false;  // … and has done so in the present tick
  bool metered = false;  // has a side of a power bond
};

/// Slots [first, last) that step one after the other with the same exchange before: the units that step explicitly, or a solved
/// group.
struct Stage {
  std::size_t first = 0, last = 0;
  int exchange = 0;  // stages of equal numbers get their inputs before the first of them steps
  std::size_t group = kNoGroup;
  bool every_tick = true;  // all of them have period 1
};

/// Order and groups of the members of a scenario (arrangement.h).
struct Arrangement {
  std::vector<int> stage;             // per member; with it, its inputs are exchanged
  std::vector<std::size_t> group_of;  // per member: its solved group, or kNoGroup
};

class Schedule {
 public:
  /// Throws Error for a tick <= 0, a period < 1, a stop time that is not after the start, or one that is more than 2⁶³ − 1 ns
  /// (292 years) after it.
  Schedule(const Scenario& scenario, std::span<const Member> members, const Arrangement& arrangement);

  /// start + n·tick, at most the stop time.
  Time time(std::int64_t tick) const { return tick < ticks_ ? start_ + tick * tick_ : stop_; }
  Tick tick(std::int64_t n) const { return {n, time(n), time(n + 1)}; }
  Time stop() const { return stop_; }
  std::int64_t ticks() const { return ticks_; }
  bool due(const ScheduledUnit& slot, const Tick& tick) const {
    const std::int64_t after = tick.index + 1, before = tick.index - tick.skipped;
    return slot.period == 1 || after / slot.period > before / slot.period || after == ticks_;
  }
  /// The tick `n` in which `more` ticks after it are left out. At most those before the last one and before `event` are.
  Tick long_tick(std::int64_t n, std::int64_t more, Time event) const;

  std::vector<ScheduledUnit> slots;
  std::vector<Stage> stages;
  std::vector<std::size_t> slot_of;  // member → slot

 private:
  Time start_, stop_;
  Duration tick_;
  std::int64_t ticks_ = 0;
};

__extension__ typedef __int128 WideInteger;  // for products of nanoseconds

/// The end of part `part` (from 0) of [begin, end] cut into `parts`, rounded down to whole nanoseconds. No part is empty if the
/// interval has at least as many nanoseconds as parts.
inline Time cut(Time begin, Time end, std::int64_t part, std::int64_t parts) {
  return begin + Duration{static_cast<std::int64_t>(WideInteger{(end - begin).ns} * (part + 1) / parts)};
}

/// The part (from 0) of [begin, end] cut into `parts` in which `t` lies, also where end − begin exceeds a Duration; the last one
/// at t = end.
inline std::int64_t part_at(Time begin, Time end, Time t, std::int64_t parts) {
  const WideInteger since = WideInteger{t.ns} - begin.ns, length = WideInteger{end.ns} - begin.ns;
  return std::min(parts - 1, static_cast<std::int64_t>(since * parts / length));
}

}  // namespace cotwin::master
