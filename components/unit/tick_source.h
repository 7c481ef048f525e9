#pragma once
#include <cstdint>
#include <optional>

namespace cotwin {

/// A packet of a robot or bus. Both times in ns.
struct Arrival {
  /// CLOCK_MONOTONIC when the packet came, or when the source read its clock if that is known better (the middle of a round trip).
  std::int64_t host = 0;
  /// The source's clock, which begins a cycle at the multiples of its period; 0: the packet itself begins a cycle.
  std::int64_t source = 0;
};

/// The clock of a robot or bus behind a unit. The master's loop calls it between two ticks, on its own thread: no step of the
/// unit runs meanwhile.
class TickSource {
 public:
  virtual ~TickSource() = default;
  /// Returns the newest arrival not returned before, at once if there is one. Otherwise waits (in ppoll, without a polling
  /// loop) until one comes, or returns nothing at `deadline` (CLOCK_MONOTONIC, ns) or when a signal interrupts the wait. A
  /// deadline in the past asks for what has come. Packets stay readable for the next step. Allocates nothing; throws nothing.
  virtual std::optional<Arrival> wait(std::int64_t deadline) = 0;
  /// Nominal ns from one cycle of the source to the next; 0 if it is not known, which means one tick of the scenario. Valid after
  /// Unit::initialise.
  virtual std::int64_t period() const { return 0; }
  /// Tells, before ticks wait for packets, whether they wait however long it takes (silence=wait of a clock that ticks with their
  /// arrival). Throws Error if they cannot.
  virtual void set_waits(bool) {}
  /// Whether packets come only as answers to what the unit's steps have sent, as on a bus whose master the unit is. Such a source
  /// cannot begin ticks by its packets, and ticks must not wait for it while it is silent.
  virtual bool answers_only() const { return false; }
};

}  // namespace cotwin
