#pragma once
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "components/unit/time.h"
#include "master/run/members.h"
#include "models/support/error.h"

namespace cotwin {
class ByteReader;
class ByteWriter;
}  // namespace cotwin

/// What the scenario changes while it runs: what-ifs, overrides, disturbances.
namespace cotwin::master {

/// Jumps and ramps of inputs that nothing feeds and of tunables. An event takes effect in the first (part of a) tick that
/// begins at or after its time. A ramp runs from the value found then and ends at time + duration exactly; an input with a rate
/// (Variable::rate) follows it without stairs. A later event on the same variable ends an earlier ramp.
class Events {
 public:
  /// A ramp under way, and the value that it began with.
  struct Ramp {
    std::size_t change = 0;
    double begin = 0;
  };
  /// What must be kept to come back to an instant.
  struct Bookmark {
    std::size_t changes = 0;  // that there are in all
    std::size_t next = 0;     // the first that is still to come
    std::vector<Ramp> ramps;

    void write(ByteWriter& out) const;
    /// What was read has to be held against the events, by fits().
    void read(ByteReader& in);
  };
  /// Hears of an event that is not right, in the place of an exception.
  using Complain = std::function<void(const Error&)>;

  /// Throws Error at the event's place for a variable that is fed, of another role, a value that does not fit or is out of
  /// range; or, where `complain` is given, calls it and leaves the event out.
  Events(const Scenario& scenario, std::span<const Member> members, std::span<const Signal> fed,
         const Complain& complain = nullptr);

  /// To be called at the beginning of every step, `h` its length.
  void apply(Time now, Duration h) {
    if (now >= next_time_) apply_due(now, h);
  }
  /// When apply() has something to do next.
  Time next_time() const { return next_time_; }

  void mark(Bookmark& bookmark) const;
  void back_to(const Bookmark& bookmark);
  /// Whether there is such an instant: of the ramps each is one, has begun, and stands once.
  bool fits(const Bookmark& bookmark) const;

 private:
  /// One element of a real variable, or a whole variable of another kind.
  struct Change {
    Time time;
    Duration ramp;
    double* value = nullptr;  // nullptr: see `other`
    double* rate = nullptr;
    double target = 0;
    std::size_t other = 0;       // into others_
    std::size_t before = kNone;  // the change of the same value before this one
  };
  struct Other {
    Variable variable;  // its storage narrowed to the elements that change
    std::vector<std::int32_t> integers;
    std::unique_ptr<bool[]> booleans;
    std::vector<std::string> strings;
  };

  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  void add(const EventSpec& spec, const Signal& signal);
  void link_changes();
  void find_next_time();
  void apply_due(Time now, Duration h);
  void begin(std::size_t change);
  bool follow(const Ramp& ramp, Time now, Duration h);

  std::vector<Change> changes_;  // by time, then as the scenario lists them
  std::vector<Other> others_;
  std::size_t next_ = 0;              // the first that has not begun
  Time next_time_;                    // at which it begins; the beginning of time while a ramp is under way
  std::vector<Ramp> ramps_;           // under way, in the order in which they began; some may be over: see active_
  std::vector<std::uint8_t> active_;  // of each change: whether its ramp is under way
};

}  // namespace cotwin::master
