#include "components/io/emulators/ethercat/slave_clock.h"

#include <algorithm>
#include <cmath>

#include "models/numerics/random.h"

namespace cotwin::ethercat {

namespace {

constexpr int kDeepest = 15;                       // of both filters, 4 bits
constexpr std::uint16_t kSlowestStart = 0x80;      // the speed counter needs start > 0x7F
constexpr double kMostSlew = 0.1;                  // 9 or 11 ns instead of 10 ns
constexpr double kShortest = 1e3, kLongest = 1e9;  // ns: interval of received times that the loop assumes

double deviation_of(double d, double start) { return d / (5 * (start + 2 + d) * (start + 2 - d)); }

/// The inverse of deviation_of.
double speed_of(double deviation, double start) {
  const double s = start + 2;
  return 10 * deviation * s * s / (1 + std::sqrt(1 + 100 * deviation * deviation * s * s));
}

}  // namespace

void SlaveClock::reset(std::int64_t now) {
  const std::uint64_t draws = draws_;
  *this = SlaveClock(options_, now);
  draws_ = draws;
}

double SlaveClock::rate() const {
  const double deviation = deviation_of(speed_, std::max(speed_start_, kSlowestStart));
  return options_.drift + deviation + options_.drift * deviation;
}

std::uint64_t SlaveClock::local(std::int64_t now) const {
  const std::int64_t elapsed = now - base_;
  return base_local_ + static_cast<std::uint64_t>(elapsed) +
         static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(fraction_ + static_cast<double>(elapsed) * rate())));
}

std::uint64_t SlaveClock::stamp(std::int64_t now) {
  if (options_.jitter == 0) return local(now);
  const double u = numerics::uniform({.seed = options_.seed,
                                      .stream = 0x4543,
                                      .round = static_cast<std::uint32_t>(draws_ >> 32),
                                      .particle = static_cast<std::uint32_t>(draws_),
                                      .draw = 0});
  ++draws_;
  return local(now) + static_cast<std::uint64_t>(std::llround(options_.jitter * (2 * u - 1)));
}

void SlaveClock::rebase(std::int64_t now) {
  const std::uint64_t here = local(now);
  const double exact = fraction_ + static_cast<double>(now - base_) * rate();
  base_local_ = here;
  fraction_ = exact - std::floor(exact);
  base_ = now;
}

void SlaveClock::receive(std::uint64_t received, int bits, std::uint64_t stamp, std::int64_t now) {
  rebase(now);
  const std::uint64_t difference = read(stamp) - received;
  const double e = bits == 32 ? static_cast<double>(static_cast<std::int32_t>(difference))
                              : static_cast<double>(static_cast<std::int64_t>(difference));
  const double elapsed = static_cast<double>(now - received_at_);
  received_at_ = now;
  if (first_) {
    first_ = false;
    mean_ = e;
    return;
  }
  mean_ += std::ldexp(e - mean_, -difference_depth_);
  const double g = std::ldexp(1.0, -std::max(speed_depth_ - 4, difference_depth_ + 4));
  const double most = kMostSlew * elapsed;
  const double before = mean_;
  const double move = std::clamp(-g * before, -most, most);
  fraction_ += move;
  mean_ += move;
  if (std::abs(move) >= most) return;  // the phase is not reached yet: it says nothing about the speed
  const double start = std::max(speed_start_, kSlowestStart), largest = start - 0x7f;
  const double limit = deviation_of(largest, start);
  const double integral = 1 - std::sqrt(1 - g);
  deviation_ = std::clamp(deviation_ - integral * integral * before / std::clamp(elapsed, kShortest, kLongest), -limit, limit);
  speed_ = static_cast<std::int16_t>(std::clamp(std::round(speed_of(deviation_, start)), -largest, largest));
}

std::uint32_t SlaveClock::difference() const {
  const double magnitude = std::min(std::round(std::abs(mean_)), 2147483647.0);
  return static_cast<std::uint32_t>(magnitude) | (mean_ < 0 ? 0x80000000u : 0u);
}

void SlaveClock::set_speed_start(std::uint16_t start, std::int64_t now) {
  rebase(now);
  speed_start_ = start;
  speed_ = 0;
  mean_ = deviation_ = 0;
  first_ = true;
}

void SlaveClock::set_filters(std::uint8_t difference_depth, std::uint8_t speed_depth) {
  difference_depth_ = difference_depth & kDeepest;
  speed_depth_ = speed_depth & kDeepest;
}

void SlaveClock::activate_sync(std::uint8_t activation, std::uint64_t start, std::uint32_t cycle0, std::uint32_t cycle1,
                               std::int64_t now) {
  const bool active = (activation & 3) == 3;
  if (active && !sync0_active_) {
    next_sync0_ = start;
    cycle0_ = cycle0;
    cycle1_ = cycle1;
    sync0_count_ = 0;
  }
  sync0_active_ = active && (sync0_active_ || static_cast<std::int64_t>(start - system_time(now)) >= 0);
}

void SlaveClock::advance(std::int64_t now) {
  if (!sync0_active_) return;
  const auto late = static_cast<std::int64_t>(system_time(now) - next_sync0_);
  if (late < 0) return;
  if (cycle0_ == 0) {  // a single pulse
    ++sync0_count_;
    sync0_active_ = false;
    return;
  }
  const std::uint64_t pulses = static_cast<std::uint64_t>(late) / cycle0_ + 1;
  sync0_count_ += pulses;
  next_sync0_ += pulses * cycle0_;
}

std::optional<std::int64_t> SlaveClock::next_sync0_at(std::int64_t now) const {
  if (!sync0_active_) return std::nullopt;
  const auto left = static_cast<double>(static_cast<std::int64_t>(next_sync0_ - system_time(now)));
  return now + static_cast<std::int64_t>(std::ceil(left / (1 + rate())));
}

}  // namespace cotwin::ethercat
