#pragma once
#include <cstdint>

namespace cotwin::master {

/// The clock of this machine, CLOCK_MONOTONIC in ns. Tests replace it by a simulated one.
class HostTime {
 public:
  virtual ~HostTime() = default;
  virtual std::int64_t now();
  /// Returns at `deadline` (at once if it is past), or earlier when a signal interrupts it.
  virtual void sleep_until(std::int64_t deadline);
  /// The one of the system.
  static HostTime& system();
};

}  // namespace cotwin::master
