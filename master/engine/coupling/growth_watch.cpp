#include "master/engine/coupling/growth_watch.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::master {

namespace {

// Growth from window to window, and the windows in a row that are suspicious. Slow growth is looked for in long windows.
constexpr double kWindowGrowth[] = {2, 1.25, 1.25};
constexpr double kSuspicious[] = {2, 3, 3};
constexpr double kManyWindows = 4;   // in a row
constexpr double kImpossible = 1e6;  // change of a value in a tick relative to its magnitude, and growth up to it
constexpr std::int64_t kFirstPause = 64, kLongestPause = 65'536;  // ticks

}  // namespace

GrowthWatch::GrowthWatch(std::vector<const double*> values, std::vector<double> magnitudes)
    : values_(std::move(values)), magnitudes_(std::move(magnitudes)), last_(values_.size()) {}

void GrowthWatch::watch(bool active) {
  active_ = active;
  suspicious_ = false;
  for (std::size_t i = 0; i < values_.size(); ++i) last_[i] = *values_[i];
  levels_ = {};
  ticks_ = quiet_until_ = 0;
  pause_ = kFirstPause;
}

bool GrowthWatch::end_windows() {
  bool suspicious = false;
  std::int64_t window = kWindow;
  for (std::size_t i = 0; i < kLevels && ticks_ % window == 0; ++i, window *= kWindow) {
    Level& level = levels_[i];
    if (i + 1 < kLevels) levels_[i + 1].largest = std::max(levels_[i + 1].largest, level.largest);
    const bool grown = level.before > 0 && level.largest > kWindowGrowth[i] * level.before;
    if (grown && level.run == 0) level.first = level.before;
    level.run = grown ? level.run + 1 : 0;
    level.before = std::exchange(level.largest, 0);
    suspicious = suspicious || level.run >= kSuspicious[i];
  }
  suspicious_ = (suspicious && ticks_ >= quiet_until_) || diverges();
  return suspicious_;
}

bool GrowthWatch::diverges() const {
  return std::ranges::any_of(levels_, [](const Level& level) {
    return level.run >= kManyWindows && level.before > kImpossible && level.before > kImpossible * level.first;
  });
}

double GrowthWatch::factor() const {
  double factor = 1, window = kWindow;
  for (const Level& level : levels_) {
    if (level.run > 0) factor = std::max(factor, std::pow(level.before / level.first, 1 / (window * level.run)));
    window *= kWindow;
  }
  return factor;
}

void GrowthWatch::dismiss() {
  quiet_until_ = ticks_ + pause_;
  pause_ = std::min(kLongestPause, 2 * pause_);
  suspicious_ = false;
}

void GrowthWatch::save(std::span<double> numbers) const {
  double* to = std::ranges::copy(last_, numbers.data()).out;
  for (const Level& level : levels_) {
    for (const double number : {level.largest, level.before, level.run, level.first}) *to++ = number;
  }
  for (const std::int64_t number : {ticks_, quiet_until_, pause_}) *to++ = static_cast<double>(number);
}

void GrowthWatch::restore(std::span<const double> numbers) {
  const double* from = numbers.data();
  for (double& value : last_) value = *from++;
  for (Level& level : levels_) {
    for (double* number : {&level.largest, &level.before, &level.run, &level.first}) *number = *from++;
  }
  // A damaged checkpoint may have any number.
  const auto count = [&] {
    const double number = *from++;
    return number >= 0 && number < 1e15 ? static_cast<std::int64_t>(number) : 0;
  };
  ticks_ = count();
  quiet_until_ = count();
  pause_ = std::max(kFirstPause, count());
}

}  // namespace cotwin::master
