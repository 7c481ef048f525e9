#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "components/io/emulators/ethercat/slave_clock.h"
#include "components/io/ethercat/frame.h"
#include "components/io/ethercat/registers.h"

namespace cotwin::ethercat {

enum class ClockUnit : std::uint8_t { kNone, kReceiveTimes, kFull };

inline constexpr int kPorts = 4;
inline constexpr std::uint8_t kMostFmmus = 16, kMostSyncManagers = 16;

struct EscOptions {
  std::uint8_t type = 0x11, revision = 0;
  std::uint16_t build = 1;
  std::uint8_t fmmus = 8;          // at most 16
  std::uint8_t sync_managers = 8;  // at most 16
  std::uint8_t ram_kib = 8;        // process RAM from 0x1000, at most 60
  std::uint8_t ports = 0x0a;       // register 0x0007: 2 bits per port; 0x0a: ports 0 and 1 are EBUS
  std::uint16_t features = 0x01cc;
  ClockUnit clock_unit = ClockUnit::kFull;
  ClockOptions clock;
  std::int64_t sii_time = 0;   // ns that the controller is busy with an access to the SII
  std::int64_t load_time = 0;  // ns after power-on for which it refuses commands, because it loads the SII itself
};

/// An emulated EtherCAT slave controller: memory of 64 KiB with registers, sync managers, FMMUs, SII access, process-data watchdog,
/// error counters and distributed clock, as in ETG.1000.4 and the data sheet of the ET1100. The bus calls process() for each frame; the
/// application of the slave (slave.h) calls the functions of the process data interface (PDI). `now` is the simulated time in ns and
/// must not decrease. Allocates only in the constructor.
///
/// Working counter: a read counts 1, a write 1 (2 in …RW commands), at most once per datagram, if at least one byte is accessible.
/// Not accessible: addresses without register or RAM, read-only registers, a sync manager with the other direction, a mailbox that is
/// full (write) or empty (read), a buffer whose access did not begin at its first byte.
class Esc {
 public:
  /// `sii`: image of the EEPROM, at least 16 bytes; else Error.
  Esc(const EscOptions& options, std::vector<std::uint8_t> sii);

  // ------------------------------------------------------------------------------------------------------------- the bus
  /// Switched on: registers at their initial values, the SII loaded.
  void reset(std::int64_t now);
  /// A frame passes the processing unit. Executes its datagrams in place. False if the frame is to be dropped: not EtherCAT, and
  /// forwarding of such frames is off.
  bool process(std::span<std::uint8_t> frame, std::int64_t now);
  /// The frame that process() saw last comes back at a port.
  void frame_returned(int port, std::int64_t now);
  /// A frame with a wrong check sequence arrives at port 0. `first`: it was damaged on the cable before this slave.
  void count_damaged(bool first);
  /// A cable with a powered neighbour is plugged in or lost.
  void set_link(int port, bool link);
  /// Whether frames leave at the port; otherwise they are turned around inside.
  bool port_open(int port) const;
  /// Watchdog and pulses until `now`.
  void advance(std::int64_t now);

  // ------------------------------------------------------------------------------------------------- the application (PDI)
  std::uint16_t al_control() const { return word(reg::kAlControl); }
  /// Whether AL control was written since the last call.
  bool pop_al_request();
  void set_al_status(std::uint16_t status, AlCode code);
  std::uint16_t al_status() const { return word(reg::kAlStatus); }
  bool watchdog_expired() const { return watchdog_expired_; }
  /// When outputs with the watchdog were written last, ns.
  std::int64_t outputs_at() const { return triggered_; }

  struct SyncManager {
    std::uint16_t start = 0, length = 0;
    std::uint8_t control = 0;
    bool enabled = false;
    bool open = false;          // the master is in the middle of an access
    bool written = false;       // the master has written the buffer since the application read it
    bool ever_written = false;  // since it was enabled

    bool mailbox() const { return (control & sync_manager::kModeBits) == sync_manager::kMailbox; }
    bool master_writes() const { return (control & sync_manager::kDirectionBits) == sync_manager::kMasterWrites; }
    std::size_t end() const { return std::size_t{start} + length; }
  };
  int sync_manager_count() const { return options_.sync_managers; }
  const SyncManager& sync_manager(int n) const { return sync_managers_[static_cast<std::size_t>(n)]; }
  /// What the master wrote last into buffer n; empty if the sync manager is off or for the other direction.
  std::span<const std::uint8_t> outputs(int n) const;
  /// Sets what the master reads next from buffer n. Returns false if the sync manager is off, for the other direction or not
  /// data.size() long.
  bool set_inputs(int n, std::span<const std::uint8_t> data);
  /// The mail in mailbox n that the master wrote, and makes room for the next; empty: none. Valid until the next frame.
  std::span<const std::uint8_t> read_mail(int n);
  /// Puts a mail into mailbox n for the master. Returns false if it is full, off or too short.
  bool put_mail(int n, std::span<const std::uint8_t> mail);
  /// Whether the master requests the last mail of mailbox n again. put_mail() answers it.
  bool repeat_requested(int n) const;
  void acknowledge_repeat(int n);

  SlaveClock& clock() { return clock_; }
  const SlaveClock& clock() const { return clock_; }
  std::span<const std::uint8_t> sii() const { return sii_; }
  std::uint16_t word(std::uint16_t address) const;

 private:
  using Byte = std::uint8_t;
  struct Fmmu {
    std::uint32_t begin = 0;           // first logical byte
    std::uint64_t first = 0, end = 0;  // logical bits [first, end)
    std::uint64_t physical = 0;        // bit
    bool reads = false, writes = false;
  };

  // esc.cpp: datagrams
  void execute(std::span<Byte> frame, const Datagram& d, std::int64_t now);
  int physical(std::span<Byte> data, std::size_t address, bool reads, bool writes, bool combine);
  int logical(std::span<Byte> data, std::uint32_t address, bool reads, bool writes);
  bool read_mapped(const Fmmu& f, std::span<Byte> data, std::uint64_t begin);
  bool write_mapped(const Fmmu& f, std::span<const Byte> data, std::uint64_t begin);

  // esc_memory.cpp: memory and registers
  bool read(std::size_t address, std::span<Byte> to);
  bool write(std::size_t address, std::span<const Byte> from);
  SyncManager* covering(std::size_t address, std::size_t& border);
  bool begin_read(int n, std::size_t at);
  void end_read(int n);
  bool begin_write(int n, std::size_t at);
  void end_write(int n);
  bool read_registers(std::size_t address, std::span<Byte> to);
  bool write_registers(std::size_t address, std::span<const Byte> from);
  void refresh(std::size_t address, std::size_t end);
  void apply(std::size_t address, std::size_t end, const Byte* from);
  void write_sync_manager(int n, std::size_t address, std::span<const Byte> from);
  void decode_fmmu(int n);
  void command_sii();
  void load_sii();
  void map_registers();
  void set_word(std::uint16_t address, std::uint16_t value);
  void set_status(int n, std::uint8_t set, std::uint8_t clear);
  void update_links();
  std::uint16_t events() const;
  int index_of(const SyncManager& s) const { return static_cast<int>(&s - sync_managers_.data()); }
  template <class T>
  T get(std::size_t address) const;
  template <class T>
  void put(std::size_t address, T value);

  EscOptions options_;
  std::vector<Byte> sii_;
  std::vector<Byte> memory_;  // 64 KiB, as the master sees it
  std::vector<Byte> pdi_;     // 64 KiB, buffers as the application sees them
  std::vector<Byte> access_;  // 4 KiB: bit 0 the register can be read, bit 1 written
  std::vector<Byte> scratch_, before_;
  std::array<SyncManager, kMostSyncManagers> sync_managers_;
  std::array<Fmmu, kMostFmmus> fmmus_;
  SlaveClock clock_;
  std::int64_t now_ = 0;
  std::uint64_t stamp_ = 0;  // local time of the frame
  bool latch_ = false;       // the frame latches the receive times of the ports
  std::array<bool, kPorts> link_{};
  std::uint16_t event_ = 0;
  bool al_request_ = false;
  std::int64_t triggered_ = 0;  // the watchdog
  bool watchdog_runs_ = false, watchdog_expired_ = false;
  std::uint16_t sii_errors_ = 0;   // bits of the SII status
  std::uint16_t sii_running_ = 0;  // the command that the controller is busy with
  std::int64_t sii_done_ = 0;      // when it is not busy any more
  std::int64_t loaded_at_ = 0;     // when it takes commands
};

}  // namespace cotwin::ethercat
