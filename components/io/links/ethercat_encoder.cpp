#include "components/io/links/ethercat_encoder.h"

#include <cmath>
#include <utility>

#include "components/io/emulators/ethercat_slaves.h"

namespace cotwin::io {

namespace {

constexpr int kHeld = 20;  // data for which a confirmation is waited for

}  // namespace

void EtherCatEncoder::reset(double fastest) {
  fastest_ = fastest;
  phase_ = Phase::kIdle;
  set_before_ = confirms_ = set_done = latched = uncertain = false;
  count = latch = target_ = 0;
  read_since_write_ = true;
  held_ = 0;
  last_ = 0;
  known_ = alone_ = false;
  counts_ = 0;
  unread_ = 0;
  speed_.reset();
  was_restarted_ = may_have_wrapped_ = false;
  implausible_ = in_a_row_ = jumps_ = 0;
  way_ = 0;
  doubtful_.reset();
}

/// Whether the axis can be at the counter `unread` seconds after it was at `from`.
bool EtherCatEncoder::is_possible(std::uint32_t counter, std::uint32_t from, double unread) const {
  return std::abs(static_cast<double>(signed_counts(counter - from))) <= kSurprise + fastest_ * unread;
}

/// What a counter that nothing explains means: kHeld, it may be damaged; kElsewhere, it and more than kMostHeld before it follow from one
/// another; kLost, there were as many, but they do not, and patience has ended.
EtherCatEncoder::Doubt EtherCatEncoder::doubt(std::uint32_t counter, double unread, double patience) {
  const bool follows = in_a_row_ > 0 && is_possible(counter, held_counter_, unread - held_unread_);
  agreeing_ = follows ? agreeing_ + 1 : 1;
  ++in_a_row_;
  held_counter_ = counter;
  held_unread_ = unread;
  if (agreeing_ > Belief::kMostHeld) return Doubt::kElsewhere;
  return in_a_row_ > Belief::kMostHeld && unread > patience ? Doubt::kLost : Doubt::kHeld;
}

/// Whether the counter is near the last one or, if the one before was doubted, goes on from that one.
bool EtherCatEncoder::is_explained(std::uint32_t counter, double unread) {
  if (!is_possible(counter, last_, unread)) {
    ++implausible_;
    return false;
  }
  const auto moved = static_cast<double>(signed_counts(counter - last_)), expected = way_ * unread;
  const bool near = std::abs(moved - expected) <= kSurprise + std::abs(expected) / 2;
  bool confirmed = false;
  if (!near && doubtful_) {
    const auto since = static_cast<double>(signed_counts(counter - *doubtful_));
    const double way = static_cast<double>(signed_counts(*doubtful_ - last_)) / doubtful_unread_ * (unread - doubtful_unread_);
    confirmed = std::abs(since) <= kSurprise + 2 * std::abs(way);
  }
  if (near || confirmed) {
    if (near && doubtful_) ++implausible_;
    doubtful_.reset();
    return true;
  }
  if (doubtful_) ++implausible_;
  doubtful_ = counter;
  doubtful_unread_ = unread;
  return false;
}

std::int64_t EtherCatEncoder::signed_counts(std::uint32_t difference) const {
  return wide_ ? static_cast<std::int32_t>(difference) : static_cast<std::int16_t>(difference);
}

void EtherCatEncoder::write(std::span<std::uint8_t> out, bool operational) {
  if (set && !set_before_) {
    target_ = set_value;
    set_done = false;
    held_ = 0;
    phase_ = confirms_ ? Phase::kClear : Phase::kRequest;
  } else if (phase_ == Phase::kRequest && !read_since_write_) {
    // The terminal may have set its counter and then have seen outputs that are off.
    held_ = kHeld;
  }
  set_before_ = set;
  if (!set && !operational && phase_ != Phase::kIdle) {
    uncertain = uncertain || held_ > 0;
    phase_ = Phase::kIdle;
    held_ = 0;
  }
  read_since_write_ = false;
  // The first four bits of the control byte are the same in both layouts; the value follows after one or two bytes.
  write_bits(out, 0, 1, latch_c ? 1 : 0);
  write_bits(out, 1, 1, latch_rising ? 1 : 0);
  write_bits(out, 2, 1, phase_ == Phase::kRequest ? 1 : 0);
  write_bits(out, 3, 1, latch_falling ? 1 : 0);
  write_bits(out, wide_ ? 16 : 8, wide_ ? 32 : 16, static_cast<std::uint32_t>(target_));
}

void EtherCatEncoder::read(std::span<const std::uint8_t> in, bool restarted, double patience) {
  const std::size_t bits = wide_ ? 32 : 16, at = wide_ ? 16 : 8;
  const std::uint32_t counter = read_bits(in, at, bits);
  read_since_write_ = true;
  latched = read_bits(in, 0, 2) != 0;
  latch = static_cast<std::int32_t>(signed_counts(read_bits(in, at + bits, bits)));
  confirms_ = read_bits(in, 2, 1) != 0;
  if (phase_ == Phase::kClear && !confirms_) phase_ = Phase::kRequest;
  const double unread = std::exchange(unread_, 0);
  if (phase_ == Phase::kRequest && confirms_) {
    // What it has moved since then counts.
    counts_ = target_ + signed_counts(counter - static_cast<std::uint32_t>(target_));
    phase_ = Phase::kIdle;
    held_ = 0;
    set_done = true;
    uncertain = false;
    way_ = 0;
    doubtful_.reset();
  } else if (restarted || !known_ || (alone_ && !is_possible(counter, last_, unread))) {
    // The position continues from the last one. Of two first counters that do not follow from one another either may be damaged.
    if (restarted && known_) was_restarted_ = uncertain = true;
    if (!restarted && known_) ++implausible_;
    alone_ = true;
    way_ = 0;
    doubtful_.reset();
  } else if (held_ > 0 && phase_ == Phase::kRequest && --held_ > 0) {
    unread_ = unread;
    return;
  } else if (const Doubt doubts =
                 unread > 0 && !is_explained(counter, unread) ? doubt(counter, unread, patience) : Doubt::kNone;
             doubts == Doubt::kHeld) {
    unread_ = unread;
    return;
  } else if (doubts == Doubt::kLost || (doubts == Doubt::kElsewhere && !is_possible(counter, last_, unread))) {
    // Where the axis is, is not known any more: it stays.
    ++jumps_;
    uncertain = true;
    way_ = 0;
    doubtful_.reset();
  } else {
    const std::int64_t moved = signed_counts(counter - last_);
    counts_ += moved;
    alone_ = false;
    if (unread > patience && unread * kFastest > std::ldexp(1.0, static_cast<int>(bits) - 1))
      may_have_wrapped_ = uncertain = true;
    if (unread > 0) {
      speed_ = Speed{static_cast<double>(moved) / unread, unread};
      way_ = speed_->value;
    }
  }
  in_a_row_ = 0;
  known_ = true;
  last_ = counter;
  count = static_cast<std::int32_t>(static_cast<std::uint32_t>(counts_));
}

std::optional<EtherCatEncoder::Speed> EtherCatEncoder::pop_speed() { return std::exchange(speed_, std::nullopt); }

}  // namespace cotwin::io
