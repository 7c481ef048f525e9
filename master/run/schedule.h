#pragma once
#include <cstddef>
#include <cstdint>
#include <vector>

#include "components/unit/time.h"
#include "master/run/members.h"

/// Who steps when. Time is cut into ticks; tick n lasts from start + n·tick to start + (n+1)·tick (or to the stop time, if that
/// comes first). Within a tick the stages run in the order of their numbers; within a stage all inputs are copied first, then
/// all due units step. A unit with a period of p ticks is due in the tick that ends its period and then steps over all of it,
/// so that no output is ever ahead of the time at which it is read, and the last tick ends everyone's last step at the stop
/// time.
namespace cotwin::master {

/// One unit in the order of stepping: by stage, then as the scenario lists them.
struct Slot {
  Unit* unit = nullptr;
  std::size_t member = 0;
  std::int64_t period = 1;
  bool threads = true;

  Time time;           // where its last step ended
  Duration last_step;  // how long that was; 0 before the first
};

/// Slots [first, last) that step between two exchanges.
struct Stage {
  std::size_t first = 0, last = 0;
  bool every_tick = true;  // all of them have period 1
};

class Schedule {
 public:
  /// Throws Error for a tick, a period or a stop time that makes no sense.
  Schedule(const Scenario& scenario, std::span<const Member> members);

  /// start + n·tick, and never beyond the stop time.
  Time time(std::int64_t tick) const { return tick < ticks_ ? start_ + tick * tick_ : stop_; }
  /// The same where the tick is known not to be the last, at whose end is the stop time.
  Time time_before_the_last(std::int64_t tick) const { return start_ + tick * tick_; }
  /// The first tick that begins at or after that time, 0 if all do; none before it does.
  std::int64_t first_tick_from(Time time) const;
  Time stop() const { return stop_; }
  std::int64_t ticks() const { return ticks_; }
  bool due(const Slot& slot, std::int64_t tick) const {
    return slot.period == 1 || (tick + 1) % slot.period == 0 || tick + 1 == ticks_;
  }

  std::vector<Slot> slots;
  std::vector<Stage> stages;
  std::vector<std::size_t> slot_of;  // member → slot

 private:
  Time start_, stop_;
  Duration tick_;
  std::int64_t ticks_ = 0;
};

/// The end of part `part` (from 0) of [begin, end] cut into `parts`.
inline Time cut(Time begin, Time end, int part, int parts) {
  return part + 1 == parts ? end : begin + Duration{(end - begin).ns / parts * (part + 1)};
}

}  // namespace cotwin::master
