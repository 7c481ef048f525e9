#pragma once
#include <array>
#include <cstdint>
#include <vector>

#include "components/io/emulators/ethercat/slave.h"

/// Emulated Beckhoff devices. Their SII images are made here from the object numbers of the device descriptions.
namespace cotwin::ethercat {

inline constexpr std::uint32_t kBeckhoff = 0x00000002;
inline constexpr std::uint32_t kEk1100 = 0x044c2c52, kEl1809 = 0x07113052, kEl2809 = 0x0af93052, kEl5101 = 0x13ed3052;

Sii ek1100_sii();
Sii el1809_sii();
Sii el2809_sii();
Sii el5101_sii();

/// Options of a controller as these devices have it: ports, FMMUs, sync managers, distributed clock with `clock`.
SlaveOptions ek1100_options(const ClockOptions& clock = {});
SlaveOptions terminal_options(const ClockOptions& clock = {});

/// EK1100: coupler from Ethernet to the terminals. No process data; often the reference clock.
class Ek1100 final : public Slave {
 public:
  explicit Ek1100(const SlaveOptions& options = ek1100_options());
};

/// EL1809: 16 digital inputs with a filter of 3 ms.
class El1809 final : public Slave {
 public:
  static constexpr std::int64_t kFilter = 3'000'000;  // ns

  explicit El1809(const SlaveOptions& options = terminal_options());
  /// Bit i is channel i + 1. A change is seen by the master when the channel has been constant for 3 ms.
  void set_channels(std::uint16_t channels, std::int64_t now);

 private:
  void update(std::int64_t now) override;

  std::uint16_t raw_ = 0, filtered_ = 0;
  std::array<std::int64_t, 16> changed_{};
};

/// EL2809: 16 digital outputs. They are off unless the state is OP and the process-data watchdog is satisfied.
class El2809 final : public Slave {
 public:
  explicit El2809(const SlaveOptions& options = terminal_options());
  /// Bit i is channel i + 1.
  std::uint16_t channels() const;
};

/// EL5101: incremental encoder, 4-fold evaluation. Process data of 16 bit (RxPDO 0x1600, TxPDO 0x1A00, optional frequency and
/// period of the signal 0x1A02) or 32 bit (0x1603, 0x1A04;
/// 0x1A03 with 16-bit counter and latch), selected by the PDO assignment.
class El5101 final : public Slave {
 public:
  explicit El5101(const SlaveOptions& options = terminal_options());

  /// Pulses C per `counts`, at its multiples; 0: no pulse C.
  void set_counts_per_turn(std::int64_t counts) { counts_per_turn_ = counts; }
  /// Position of the encoder at `now` in counts (4 per line). The way from the last position is passed in one direction.
  void set_position(std::int64_t counts, std::int64_t now);
  /// Input "latch extern".
  void set_latch_input(bool on);
  /// The counter as the terminal has it, modulo 2^32.
  std::uint32_t counter() const { return static_cast<std::uint32_t>(position_ + offset_); }

 private:
  struct Control {
    bool latch_c, latch_rising, latch_falling, set;
    std::uint32_t value;
  };
  void restart() override;
  void update(std::int64_t now) override;
  Control control() const;
  void write_inputs();
  std::int64_t range() const;  // of the counter

  std::int64_t counts_per_turn_ = 0;
  std::int64_t position_ = 0, offset_ = 0;
  bool input_ = false;
  std::uint32_t latched_ = 0;
  bool valid_c_ = false, valid_extern_ = false;
  bool set_before_ = false, set_done_ = false;
  bool underflow_ = false, overflow_ = false;
  double speed_ = 0;  // counts per second
  std::int64_t moved_at_ = 0;
  std::uint64_t pulses_ = 0;  // of SYNC0 that were served
};

}  // namespace cotwin::ethercat
