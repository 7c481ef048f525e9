#pragma once
#include <cstdint>
#include <optional>
#include <span>

#include "components/io/link/belief.h"

namespace cotwin::io {

/// The counter of an EL5101 in the process data of a cyclic master: a position without wrapping, and the command that sets it.
class EtherCatEncoder {
 public:
  /// The fastest signal that the terminal counts, counts per s: 1 MHz, four counts per period.
  static constexpr double kFastest = 4e6;

  /// `wide`: counters of 32 bits (PDOs 0x1603, 0x1a04), otherwise 16 (0x1600, 0x1a00).
  explicit EtherCatEncoder(bool wide) : wide_(wide) {}

  // Ports.
  bool set = false;  // a rising edge sets the counter to set_value
  std::int32_t set_value = 0;
  bool latch_c = false, latch_rising = false, latch_falling = false;  // enable latches
  std::int32_t count = 0;                                             // counts since the start, or as set, modulo 2^32
  std::int32_t latch = 0;                                             // counter at the last latch
  bool latched = false;                                               // a latch was taken since it was enabled
  bool set_done = false;                                              // set since the last rising edge of `set`
  bool uncertain = false;  // since the start or the last setting, movements may have been missed

  /// The position at the start of a run is 0. `fastest`: the largest speed that is believed, counts per s.
  void reset(double fastest = kFastest);
  /// Sets the output process data of the next cycle. `operational`: they reach the terminal. A command is repeated until the terminal
  /// confirms it, and never afterwards. It is cancelled if `set` falls while the bus is not operational.
  void write(std::span<std::uint8_t> out, bool operational);
  /// Time passes, s, up to the next read().
  void advance(double h) { unread_ += h; }
  /// Takes input process data. `restarted`: the terminal was switched off and on since the last ones, so that it has forgotten its
  /// counter. `patience`: s without data after which a counter of 16 bits may have wrapped. A counter that the last speed does not explain to
  /// kSurprise counts and half of the way is used only when the next one confirms it: the frame may be damaged. One that is faster than
  /// `fastest` is never used; after Belief::kMostHeld in a row that follow from one another, or `patience` of such counters, the position
  /// continues from the last one as after a restart.
  void read(std::span<const std::uint8_t> in, bool restarted, double patience);

  std::int64_t counts() const { return counts_; }
  /// Mean speed in counts per s between the last two calls of read(), and its duration in s. Nothing if there is none: the first
  /// data, a counter that was set, a terminal that restarted.
  struct Speed {
    double value = 0, duration = 0;
  };
  std::optional<Speed> pop_speed();
  /// s since the last read().
  double unread() const { return unread_; }
  /// Whether the last counter was not used, for at most `patience` s.
  bool is_held(double patience) const { return in_a_row_ > 0 && unread_ <= patience; }
  bool was_restarted() const { return was_restarted_; }
  bool may_have_wrapped() const { return may_have_wrapped_; }
  /// Counters that no motion explains, and that were not used.
  std::int32_t implausible() const { return implausible_; }
  /// How often the position was lost by such counters.
  int jumps() const { return jumps_; }

 private:
  enum class Phase : std::uint8_t {
    kIdle,
    kClear,
    kRequest
  };  // of the command: none; until an old confirmation is gone; until confirmed

  static constexpr double kSurprise = 3;

  std::int64_t signed_counts(std::uint32_t difference) const;
  bool is_possible(std::uint32_t counter, std::uint32_t from, double unread) const;
  enum class Doubt : std::uint8_t { kNone, kHeld, kElsewhere, kLost };
  Doubt doubt(std::uint32_t counter, double unread, double patience);
  bool is_explained(std::uint32_t counter, double unread);

  bool wide_;
  Phase phase_ = Phase::kIdle;
  bool set_before_ = false, confirms_ = false;  // the terminal confirms a setting
  std::int32_t target_ = 0;
  bool read_since_write_ = true;
  int held_ = 0;            // > 0: data that are not used, because the counter may have been set without a confirmation
  std::uint32_t last_ = 0;  // counter of the terminal
  bool known_ = false;      // `last_` is valid
  bool alone_ = false;      // it was the first one
  std::int64_t counts_ = 0;
  double unread_ = 0;
  std::optional<Speed> speed_;
  double way_ = 0;                         // counts per s, the speed that the last two data had
  std::optional<std::uint32_t> doubtful_;  // counter that awaits its confirmation
  double doubtful_unread_ = 0;             // s, before it
  std::uint32_t held_counter_ = 0;         // the last one that was not used, if in_a_row_ > 0
  double held_unread_ = 0;                 // s, before it
  double fastest_ = kFastest;              // counts per s
  std::int32_t implausible_ = 0;
  int in_a_row_ = 0, agreeing_ = 0, jumps_ = 0;  // counters that were not used, those of them that follow from one another
  bool was_restarted_ = false, may_have_wrapped_ = false;
};

}  // namespace cotwin::io
