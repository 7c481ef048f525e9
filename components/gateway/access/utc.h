#pragma once
#include <chrono>
#include <optional>
#include <string>
#include <string_view>

namespace cotwin::gateway {

using UtcTime = std::chrono::sys_time<std::chrono::milliseconds>;

UtcTime utc_now();
/// ISO 8601 in UTC with milliseconds: "2026-11-22T00:45:00.000Z".
std::string to_text(UtcTime time);
/// Reads an ISO 8601 date and time with "Z" or an offset such as "+01:00", years 1970 to 9999; nullopt for anything else.
std::optional<UtcTime> time_of(std::string_view text);

/// UTC that never goes back: where the system's clock was set back, it goes on from where it was, so that nothing that has ended becomes
/// valid again.
class ForwardClock {
 public:
  using Steady = std::chrono::steady_clock::time_point;

  UtcTime now() { return now(utc_now(), std::chrono::steady_clock::now()); }
  /// The same with the times of both clocks given.
  UtcTime now(UtcTime system, Steady steady);

 private:
  std::chrono::sys_time<std::chrono::nanoseconds> latest_{};
  Steady at_{};
};

}  // namespace cotwin::gateway
