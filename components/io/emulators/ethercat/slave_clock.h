#pragma once
#include <cstdint>
#include <optional>

/// The distributed clock of an emulated slave (section 9 of the ET1100 data sheet). Times are ns; `now` is the simulated time and must
/// not decrease. Nothing here allocates.
namespace cotwin::ethercat {

struct ClockOptions {
  double drift = 0;         // of the oscillator, relative: 50e-6 gains 50 µs per second
  double jitter = 0;        // ns: time stamps deviate by a uniform random number in [-jitter, jitter]
  std::uint64_t start = 0;  // local time when the slave is switched on
  std::uint64_t seed = 0;   // of the jitter
};

/// Local time, its copy of the system time and the loop that follows a reference:
///   d local/dt = (1 + drift) (1 + deviation),   copy = local + offset − delay,   e = copy − received;
/// e passes a low-pass of depth 0x0934. With g = 1/N each received time moves the phase by −g e (at most a tenth of the elapsed time, as
/// the real increments of 9 or 11 instead of 10 ns allow) and the deviation by −(1 − √(1 − g))² e / interval, which puts both poles of the
/// loop at √(1 − g). N = 2^(0x0935 − 4) ≥ 16 · 2^(0x0934): 256 for the defaults of the registers. The deviation is rounded to what the
/// speed counter d (0x0932) and its start s (0x0930) can represent: d / (5 (s + 2 + d) (s + 2 − d)).
/// The real loop is not published beyond its registers; g is our choice, so that it converges within the 10 000 to 15 000 frames that
/// masters send.
class SlaveClock {
 public:
  explicit SlaveClock(const ClockOptions& options, std::int64_t now = 0)
      : options_(options), base_(now), base_local_(options.start) {}

  /// Switched on: local time `start`, registers at their initial values.
  void reset(std::int64_t now);

  std::uint64_t local(std::int64_t now) const;
  /// Local time as a frame at `now` is stamped: with jitter.
  std::uint64_t stamp(std::int64_t now);
  /// Local copy of the system time, as events and the slave's application see it.
  std::uint64_t system_time(std::int64_t now) const { return local(now) + offset_; }
  /// What a frame stamped `stamp` reads at 0x0910: the system time when it passed the reference clock.
  std::uint64_t read(std::uint64_t stamp) const { return stamp + offset_ - delay_; }

  /// A frame stamped `stamp` brings the system time; with `bits` = 32 only its low half.
  void receive(std::uint64_t received, int bits, std::uint64_t stamp, std::int64_t now);

  std::uint64_t offset() const { return offset_; }  // 0x0920
  void set_offset(std::uint64_t offset) { offset_ = offset; }
  std::uint32_t delay() const { return delay_; }  // 0x0928
  void set_delay(std::uint32_t delay) { delay_ = delay; }
  std::uint32_t difference() const;                                           // 0x092C
  void set_speed_start(std::uint16_t start, std::int64_t now);                // 0x0930: restarts the loop
  std::int16_t speed_difference() const { return speed_; }                    // 0x0932
  void set_filters(std::uint8_t difference_depth, std::uint8_t speed_depth);  // 0x0934, 0x0935

  /// 0x0981, 0x0990, 0x09A0, 0x09A4. SYNC0 begins when the system time reaches `start`; a start in the past never comes.
  void activate_sync(std::uint8_t activation, std::uint64_t start, std::uint32_t cycle0, std::uint32_t cycle1,
                     std::int64_t now);
  /// Counts the pulses until `now`.
  void advance(std::int64_t now);
  /// System time of the next SYNC0; what was set if it is not active.
  std::uint64_t next_sync0() const { return next_sync0_; }
  /// Simulated time of the next SYNC0 if the clock keeps its speed; none if SYNC0 is not active or its start has passed.
  std::optional<std::int64_t> next_sync0_at(std::int64_t now) const;
  bool sync0_active() const { return sync0_active_; }
  std::uint64_t sync0_count() const { return sync0_count_; }
  /// Whether the first SYNC0 is still to come (0x0984).
  bool sync0_pending() const { return sync0_active_ && sync0_count_ == 0; }

 private:
  void rebase(std::int64_t now);
  double rate() const;

  ClockOptions options_;
  std::uint64_t draws_ = 0;
  // local = base_local_ + (now − base_) + fraction_ + (now − base_) rate()
  std::int64_t base_;
  std::uint64_t base_local_;
  double fraction_ = 0;  // ns
  std::uint64_t offset_ = 0;
  std::uint32_t delay_ = 0;
  double mean_ = 0;       // ns, low-pass of e
  double deviation_ = 0;  // integral part of the loop, before rounding
  bool first_ = true;     // no time was received since the loop was restarted
  std::int64_t received_at_ = 0;
  std::uint16_t speed_start_ = 0x1000;
  std::int16_t speed_ = 0;
  std::uint8_t difference_depth_ = 4, speed_depth_ = 12;
  bool sync0_active_ = false;
  std::uint32_t cycle0_ = 0, cycle1_ = 0;
  std::uint64_t next_sync0_ = 0, sync0_count_ = 0;
};

}  // namespace cotwin::ethercat
