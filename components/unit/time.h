#pragma once
#include <compare>
#include <cstdint>

namespace cotwin {

/// A span of time in integer nanoseconds. Seconds appear only at ports and inside equations.
struct Duration {
  std::int64_t ns = 0;
  static auto fields(auto& d, auto each) { return each(d.ns); }

  /// The nearest double. (A product with 1e-9 is not the nearest: 7 ms would be 0.007000000000000001 s.)
  constexpr double seconds() const { return static_cast<double>(ns) / 1e9; }
  /// The nearest whole nanosecond.
  static constexpr Duration from_seconds(double s) { return {static_cast<std::int64_t>(s * 1e9 + (s < 0 ? -0.5 : 0.5))}; }
  friend constexpr auto operator<=>(Duration, Duration) = default;
  friend constexpr Duration operator+(Duration a, Duration b) { return {a.ns + b.ns}; }
  friend constexpr Duration operator-(Duration a, Duration b) { return {a.ns - b.ns}; }
  friend constexpr Duration operator*(std::int64_t n, Duration d) { return {n * d.ns}; }
};

/// An instant: nanoseconds since the start of the scenario.
struct Time {
  std::int64_t ns = 0;
  static auto fields(auto& t, auto each) { return each(t.ns); }

  constexpr double seconds() const { return static_cast<double>(ns) / 1e9; }
  static constexpr Time from_seconds(double s) { return {Duration::from_seconds(s).ns}; }
  friend constexpr auto operator<=>(Time, Time) = default;
  friend constexpr Time operator+(Time t, Duration d) { return {t.ns + d.ns}; }
  friend constexpr Duration operator-(Time a, Time b) { return {a.ns - b.ns}; }
};

}  // namespace cotwin
