#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "master/engine/wiring/members.h"
#include "models/foundation/support/error.h"

/// Changes of values during a run that the scenario asks for: what-ifs, overrides, disturbances.
namespace cotwin::master {

/// Jumps and ramps of tunables and of inputs without a connection. An event takes effect in the first tick, or part of a tick,
/// that begins at or after its time. A ramp begins at the value at that instant and ends exactly at time + duration; an input
/// with a rate (Variable::rate) follows it linearly within a step. A later event on the same variable ends an earlier ramp.
class Events {
 public:
  /// An active ramp and its first value.
  struct Ramp {
    std::size_t change = 0;
    double begin = 0;

    static auto fields(auto& r, auto each) { return each(r.change, r.begin); }
  };
  /// The state of the events at an instant. One that was read is checked with is_valid().
  struct State {
    std::size_t changes = 0;  // total number
    std::size_t next = 0;     // the first that has not begun
    std::vector<Ramp> ramps;

    static auto fields(auto& s, auto each) { return each(s.changes, s.next, s.ramps); }
  };
  /// A jump of one real value, beside the events of the scenario.
  struct Jump {
    Time time;
    double* value = nullptr;
    double target = 0;
  };
  using Report = std::function<void(const Error&)>;

  /// Throws Error at the event's place for a variable with a connection or of another role, and for a value of another kind or
  /// out of range. With `report`, calls it with each such error instead and leaves the event out.
  Events(const Scenario& scenario, std::span<const Member> members, std::span<const Signal> fed,
         const Report& report = nullptr);

  /// Adds jumps, before the first apply(). At the same time they follow the scenario's events and one another.
  void add(std::span<const Jump> jumps);
  /// Replaces the targets of the jumps, which must be as many as were added and in the same order.
  void retarget(std::span<const Jump> jumps);

  /// Call at the beginning of every step. `h`: its length.
  void apply(Time now, Duration h) {
    if (now >= next_time_) apply_due(now, h);
  }

  /// Ends a ramp of this value, which was set from outside. Allocates nothing.
  void end_ramp(const double* value);

  /// The first time after `now` at which an event happens or a ramp ends; the largest time if there is none.
  Time next_after(Time now) const;

  /// Allocates only the first time.
  void save(State& state) const;
  void restore(const State& state);
  /// Whether the state belongs to these events: its ramps exist, have begun and occur once each.
  bool is_valid(const State& state) const;

 private:
  /// One element of a real variable, or a whole variable of another kind.
  struct Change {
    Time time;
    Duration ramp;
    double* value = nullptr;  // nullptr: see `other`
    double* rate = nullptr;
    double target = 0;
    std::size_t other = 0;       // into others_
    std::size_t before = kNone;  // the previous change of the same value
    std::size_t jump = kNone;    // of those of add()
  };
  struct Other {
    Variable variable;  // with storage for the changing elements only
    std::vector<std::int32_t> integers;
    std::unique_ptr<bool[]> booleans;
    std::vector<std::string> strings;
  };

  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  void add(const EventSpec& spec, const Signal& signal);
  void arrange();
  void link_changes();
  void find_next_time();
  void apply_due(Time now, Duration h);
  void begin(std::size_t change);
  bool follow(const Ramp& ramp, Time now, Duration h);

  std::vector<Change> changes_;  // by time, then as in the scenario
  std::vector<Other> others_;
  std::size_t next_ = 0;              // the first that has not begun
  Time next_time_;                    // of its begin; the smallest time while a ramp is active
  std::vector<Ramp> ramps_;           // in the order of their begins; some may have ended: see active_
  std::vector<std::uint8_t> active_;  // per change: whether its ramp is active
};

}  // namespace cotwin::master
