#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace cotwin::master {

/// Sees that exchanged values begin to diverge, from their changes alone: a few operations a tick for each value. Windows of 8, 64 and 512 ticks
/// are compared by the largest change of a value in one tick. Signals may change more and more for a while, so growth is a reason to look
/// closer; only diverges() is a verdict.
class GrowthWatch {
 public:
  /// `magnitudes`: of the values, > 0; they make values of different measures comparable.
  GrowthWatch(std::vector<const double*> values, std::vector<double> magnitudes);

  /// From here on, with the present values as the last ones; or not any more.
  void watch(bool active);
  /// Call after each tick. Returns at the end of a window whether the changes have grown in several windows in a row (not for a while after
  /// dismiss()), or whether they diverge.
  bool tick() {
    if (!active_) return false;
    double change = 0;
    for (std::size_t i = 0; i < values_.size(); ++i) {
      const double difference = (*values_[i] - last_[i]) / magnitudes_[i];
      last_[i] = *values_[i];
      change = difference > change ? difference : -difference > change ? -difference : change;
    }
    if (change > levels_[0].largest) levels_[0].largest = change;
    ++ticks_;
    return ticks_ % kWindow == 0 && end_windows();
  }
  /// What the last tick() returned at the end of a window.
  bool is_suspicious() const { return suspicious_; }
  /// Whether the changes have grown in many windows in a row by a million, to a size that no signal has: a million times its magnitude in one tick.
  bool diverges() const;
  /// Growth per tick of the changes, at its last sign.
  double factor() const;
  /// The growth was looked at and is that of a signal: the next looks wait for longer.
  void dismiss();
  /// Whether the present window has clearly larger changes than the last: not a time to take a state for good.
  bool is_rising() const { return levels_[0].largest > 1.5 * levels_[0].before; }

  std::size_t state_size() const { return last_.size() + 3 + 4 * kLevels; }
  void save(std::span<double> numbers) const;
  void restore(std::span<const double> numbers);

 private:
  static constexpr std::int64_t kWindow = 8;  // ticks; of each further level as many windows of the one before
  static constexpr std::size_t kLevels = 3;
  struct Level {
    double largest = 0, before = 0;  // change in the present window and in the last
    double run = 0;                  // windows in a row with growth
    double first = 0;                // change before the run
  };
  bool end_windows();

  std::vector<const double*> values_;
  std::vector<double> magnitudes_, last_;
  std::array<Level, kLevels> levels_;
  std::int64_t ticks_ = 0, quiet_until_ = 0, pause_ = 0;
  bool active_ = false, suspicious_ = false;
};

}  // namespace cotwin::master
