// Memory of the emulated slave controller as the master sees it: registers with their access rules and effects, sync managers, SII.
#include <algorithm>

#include "components/io/emulators/ethercat/esc.h"
#include "components/io/ethercat/little_endian.h"
#include "components/io/ethercat/sii.h"
#include "models/foundation/support/error.h"

namespace cotwin::ethercat {

namespace {

constexpr std::size_t kMemory = 0x10000, kRegisters = 0x1000;
constexpr std::uint8_t kReadable = 1, kWritable = 2;
constexpr std::size_t kSmSize = reg::kSyncManagerSize, kFmmuSize = reg::kFmmuSize;

struct Range {
  std::uint16_t begin, size;
  std::uint8_t access;
};

constexpr std::uint8_t kBoth = kReadable | kWritable;

/// Registers of all controllers.
constexpr Range kCommon[] = {
    {reg::kType, 10, kReadable},
    {reg::kStation, 2, kBoth},
    {reg::kAlias, 2, kReadable},
    {reg::kDlControl, 4, kBoth},
    {reg::kDlStatus, 2, kReadable},
    {reg::kAlControl, 2, kBoth},
    {reg::kAlStatus, 2, kReadable},
    {reg::kAlStatusCode, 2, kReadable},
    {reg::kPdiControl, 4, kReadable},
    {0x0150, 4, kReadable},
    {reg::kEventMask, 2, kBoth},
    {reg::kEventRequest, 2, kReadable},
    {0x0204, 4, kReadable},
    {0x0220, 4, kReadable},
    {reg::kErrorCounters, 14, kBoth},
    {reg::kLostLinks, 4, kBoth},
    {reg::kWatchdogDivider, 2, kBoth},
    {reg::kPdiWatchdog, 2, kBoth},
    {reg::kProcessDataWatchdog, 2, kBoth},
    {reg::kWatchdogStatus, 2, kReadable},
    {reg::kWatchdogCounter, 2, kBoth},
    {reg::kSiiConfig, 16, kBoth},
    {reg::kDigitalOutputs, 4, kBoth},
    {0x0f10, 8, kBoth},
    {0x0f80, 0x80, kBoth},
};

/// Registers of the distributed clock.
constexpr Range kClockRegisters[] = {
    {reg::kSystemTime, 8, kBoth},
    {reg::kReceiveTime, 8, kReadable},
    {reg::kSystemTimeOffset, 8, kBoth},
    {reg::kSystemTimeDelay, 4, kBoth},
    {reg::kSystemTimeDifference, 4, kReadable},
    {reg::kSpeedCounterStart, 2, kBoth},
    {reg::kSpeedCounterDifference, 2, kReadable},
    {reg::kDifferenceFilter, 2, kBoth},
    {reg::kCyclicControl, 2, kBoth},
    {reg::kPulseLength, 2, kReadable},
    {reg::kActivationStatus, 1, kReadable},
    {reg::kSync0Status, 2, kReadable},
    {reg::kStartTime, 8, kBoth},
    {reg::kNextSync1, 8, kReadable},
    {reg::kSync0Cycle, 8, kBoth},
    {0x09a8, 2, kBoth},
    {0x09ae, 2, kReadable},
    {0x09b0, 32, kReadable},
};

bool overlaps(std::size_t begin, std::size_t end, std::uint16_t reg, std::size_t size) {
  return begin < reg + size && end > reg;
}

}  // namespace

template <class T>
T Esc::get(std::size_t address) const {
  return load<T>(memory_.data() + address);
}

template <class T>
void Esc::put(std::size_t address, T value) {
  store(memory_.data() + address, value);
}

template void Esc::put(std::size_t, std::uint32_t);

std::uint16_t Esc::word(std::uint16_t address) const { return get<std::uint16_t>(address); }

void Esc::set_word(std::uint16_t address, std::uint16_t value) { put(address, value); }

Esc::Esc(const EscOptions& options, std::vector<std::uint8_t> sii)
    : options_(options),
      sii_(std::move(sii)),
      memory_(kMemory),
      pdi_(kMemory),
      access_(kRegisters),
      scratch_(kLongestFrame),
      before_(kLongestFrame),
      clock_(options.clock) {
  if (sii_.size() < 16)
    throw Error("emulated slave", "the SII image has " + std::to_string(sii_.size()) + " bytes, expected at least 16");
  if (options.fmmus > kMostFmmus || options.sync_managers > kMostSyncManagers || options.ram_kib > 60) {
    throw Error("emulated slave", std::to_string(options.fmmus) + " FMMUs, " + std::to_string(options.sync_managers) +
                                      " sync managers and " + std::to_string(options.ram_kib) +
                                      " KiB of RAM, expected at most 16, 16 and 60");
  }
  map_registers();
  reset(0);
}

void Esc::map_registers() {
  const auto map = [&](const Range& r) { std::fill_n(access_.begin() + r.begin, r.size, r.access); };
  for (const Range& r : kCommon) map(r);
  map({reg::kFmmu, static_cast<std::uint16_t>(kFmmuSize * options_.fmmus), kBoth});
  map({reg::kSyncManager, static_cast<std::uint16_t>(kSmSize * options_.sync_managers), kBoth});
  if (options_.clock_unit != ClockUnit::kNone) map({reg::kReceiveTimes, 16, kBoth});
  if (options_.clock_unit == ClockUnit::kFull) {
    for (const Range& r : kClockRegisters) map(r);
  }
}

void Esc::reset(std::int64_t now) {
  std::fill(memory_.begin(), memory_.end(), Byte{0});
  std::fill(pdi_.begin(), pdi_.end(), Byte{0});
  memory_[reg::kType] = options_.type;
  memory_[reg::kType + 1] = options_.revision;
  set_word(reg::kType + 2, options_.build);
  memory_[reg::kFmmuCount] = options_.fmmus;
  memory_[reg::kSyncManagerCount] = options_.sync_managers;
  memory_[reg::kRamSize] = options_.ram_kib;
  memory_[reg::kPorts] = options_.ports;
  set_word(reg::kFeatures, options_.features);
  memory_[reg::kDlControl] = 1;
  set_word(reg::kAlControl, static_cast<std::uint16_t>(State::kInit));
  set_word(reg::kAlStatus, static_cast<std::uint16_t>(State::kInit));
  set_word(reg::kWatchdogDivider, 0x09c2);
  set_word(reg::kPdiWatchdog, 0x03e8);
  set_word(reg::kProcessDataWatchdog, 0x03e8);
  set_word(reg::kSpeedCounterStart, 0x1000);
  set_word(reg::kDifferenceFilter, 0x0c04);
  sync_managers_.fill({});
  fmmus_.fill({});
  now_ = now;
  clock_.reset(now);
  event_ = 0;
  al_request_ = watchdog_runs_ = watchdog_expired_ = latch_ = false;
  sii_running_ = 0;
  loaded_at_ = now + options_.load_time;
  load_sii();
  update_links();
}

void Esc::load_sii() {
  sii_errors_ = sii_[14] == sii_checksum(sii_) ? 0 : sii_control::kChecksumError | sii_control::kNotLoaded;
  if (sii_errors_) return;
  set_word(reg::kPdiControl, load<std::uint16_t>(&sii_[0]));
  set_word(0x0150, load<std::uint16_t>(&sii_[2]));
  set_word(reg::kPulseLength, load<std::uint16_t>(&sii_[4]));
  set_word(reg::kAlias, load<std::uint16_t>(&sii_[8]));
}

void Esc::update_links() {
  std::uint16_t status = sii_errors_ ? 0 : 1;
  if (memory_[reg::kPdiControl] != 0) status |= 2;
  for (int p = 0; p < kPorts; ++p) {
    const bool link = link_[static_cast<std::size_t>(p)], open = port_open(p);
    status = static_cast<std::uint16_t>(status | link << (4 + p) | !open << (8 + 2 * p) | (link && open) << (9 + 2 * p));
  }
  set_word(reg::kDlStatus, status);
}

// ------------------------------------------------------------------------------------------------------------------ memory

/// The sync manager in whose buffer the address is; else nullptr. `border` is lowered to where that changes.
Esc::SyncManager* Esc::covering(std::size_t address, std::size_t& border) {
  SyncManager* found = nullptr;
  for (int n = 0; n < options_.sync_managers; ++n) {
    SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
    if (!s.enabled || s.length == 0) continue;
    if (address >= s.start && address < s.end()) {
      if (!found) found = &s;
      border = std::min(border, s.end());
    } else if (s.start > address) {
      border = std::min<std::size_t>(border, s.start);
    }
  }
  return found;
}

bool Esc::read(std::size_t address, std::span<Byte> to) {
  std::fill(to.begin(), to.end(), Byte{0});
  const std::size_t end = std::min(address + to.size(), kMemory);
  bool any = false;
  for (std::size_t at = address; at < end;) {
    std::size_t border = end;
    SyncManager* const s = covering(at, border);
    const std::span<Byte> part = to.subspan(at - address, border - at);
    if (s) {
      if (begin_read(index_of(*s), at)) {
        std::copy_n(memory_.begin() + static_cast<std::ptrdiff_t>(at), part.size(), part.begin());
        if (border == s->end()) end_read(index_of(*s));
        any = true;
      }
    } else if (at < kRegisters) {
      border = std::min(border, kRegisters);
      any |= read_registers(at, part.first(border - at));
    } else if (const std::size_t limit = kRegisters + 1024u * options_.ram_kib; at < limit) {
      border = std::min(border, limit);
      std::copy_n(memory_.begin() + static_cast<std::ptrdiff_t>(at), border - at, part.begin());
      any = true;
    }
    at = border;
  }
  return any;
}

bool Esc::write(std::size_t address, std::span<const Byte> from) {
  const std::size_t end = std::min(address + from.size(), kMemory);
  bool any = false;
  for (std::size_t at = address; at < end;) {
    std::size_t border = end;
    SyncManager* const s = covering(at, border);
    const std::span<const Byte> part = from.subspan(at - address, border - at);
    if (s) {
      if (begin_write(index_of(*s), at)) {
        std::copy(part.begin(), part.end(), memory_.begin() + static_cast<std::ptrdiff_t>(at));
        if (border == s->end()) end_write(index_of(*s));
        any = true;
      }
    } else if (at < kRegisters) {
      border = std::min(border, kRegisters);
      any |= write_registers(at, part.first(border - at));
    } else if (const std::size_t limit = kRegisters + 1024u * options_.ram_kib; at < limit) {
      border = std::min(border, limit);
      std::copy_n(part.begin(), border - at, memory_.begin() + static_cast<std::ptrdiff_t>(at));
      any = true;
    }
    at = border;
  }
  return any;
}

bool Esc::begin_read(int n, std::size_t at) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  if (s.master_writes()) return false;
  if (s.mailbox()) {
    if (!(memory_[reg::kSyncManager + kSmSize * static_cast<std::size_t>(n) + 5] & sync_manager::kFull)) return false;
  } else if (at == s.start) {
    std::copy_n(pdi_.begin() + s.start, s.length, memory_.begin() + s.start);
  }
  if (at == s.start) s.open = true;
  return s.open;
}

void Esc::end_read(int n) {
  sync_managers_[static_cast<std::size_t>(n)].open = false;
  set_status(n, sync_manager::kReadEvent, sync_manager::kFull | sync_manager::kWriteEvent);
}

bool Esc::begin_write(int n, std::size_t at) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  if (!s.master_writes() || (s.mailbox() && s.written)) return false;
  if (at == s.start) s.open = true;
  return s.open;
}

void Esc::end_write(int n) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  s.open = false;
  s.written = s.ever_written = true;
  set_status(n, static_cast<std::uint8_t>(sync_manager::kWriteEvent | (s.mailbox() ? sync_manager::kFull : 0)),
             sync_manager::kReadEvent);
  if (!s.mailbox()) std::copy_n(memory_.begin() + s.start, s.length, pdi_.begin() + s.start);
  if (!(s.control & sync_manager::kWatchdog)) return;
  triggered_ = now_;
  watchdog_runs_ = word(reg::kProcessDataWatchdog) != 0;
  watchdog_expired_ = false;
}

void Esc::set_status(int n, std::uint8_t set, std::uint8_t clear) {
  Byte& status = memory_[reg::kSyncManager + kSmSize * static_cast<std::size_t>(n) + 5];
  status = static_cast<Byte>((status & ~clear) | set);
}

// --------------------------------------------------------------------------------------------------------------- registers

std::uint16_t Esc::events() const {
  auto events = static_cast<std::uint16_t>(event_);
  for (int n = 0; n < std::min<int>(options_.sync_managers, 8); ++n) {
    const SyncManager& s = sync_manager(n);
    if (!s.enabled || !(s.control & sync_manager::kMasterEvent)) continue;
    const Byte status = memory_[reg::kSyncManager + kSmSize * static_cast<std::size_t>(n) + 5];
    const Byte flag = s.master_writes() ? sync_manager::kReadEvent : sync_manager::kWriteEvent;
    if (status & flag) events = static_cast<std::uint16_t>(events | event::kSyncManager0 << n);
  }
  return events;
}

bool Esc::read_registers(std::size_t address, std::span<Byte> to) {
  const std::size_t end = address + to.size();
  refresh(address, end);
  bool any = false;
  for (std::size_t i = 0; i < to.size(); ++i) {
    if (!(access_[address + i] & kReadable)) continue;
    to[i] = memory_[address + i];
    any = true;
  }
  if (overlaps(address, end, reg::kDlStatus, 2)) event_ &= static_cast<std::uint16_t>(~event::kDlStatus);
  if (overlaps(address, end, reg::kAlStatus, 2)) event_ &= static_cast<std::uint16_t>(~event::kAlStatus);
  return any;
}

/// Brings registers in [address, end) up to date that follow from the controller's state.
void Esc::refresh(std::size_t address, std::size_t end) {
  if (overlaps(address, end, reg::kEventRequest, 2)) set_word(reg::kEventRequest, events());
  if (overlaps(address, end, reg::kWatchdogStatus, 2)) set_word(reg::kWatchdogStatus, watchdog_expired_ ? 0 : 1);
  if (overlaps(address, end, reg::kSiiControl, 2)) {
    const bool busy = now_ < sii_done_ && sii_running_ != 0;
    if (!busy) sii_running_ = 0;
    set_word(reg::kSiiControl, static_cast<std::uint16_t>(sii_control::kReads8Bytes | sii_errors_ |
                                                          (busy ? sii_control::kBusy | sii_running_ : 0)));
  }
  if (options_.clock_unit != ClockUnit::kFull || end <= reg::kSystemTime || address > reg::kNextSync1) return;
  put(reg::kSystemTime, clock_.read(stamp_));
  put(reg::kSystemTimeOffset, clock_.offset());
  put(reg::kSystemTimeDelay, clock_.delay());
  put(reg::kSystemTimeDifference, clock_.difference());
  put(reg::kSpeedCounterDifference, clock_.speed_difference());
  memory_[reg::kActivationStatus] = clock_.sync0_pending() ? 1 : 0;
  if (clock_.sync0_active()) put(reg::kStartTime, clock_.next_sync0());
}

bool Esc::write_registers(std::size_t address, std::span<const Byte> from) {
  const std::size_t end = address + from.size();
  bool any = false;
  for (std::size_t i = 0; i < from.size(); ++i) any |= (access_[address + i] & kWritable) != 0;
  if (!any) return false;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const std::size_t at = address + i;
    const bool computed = overlaps(at, at + 1, reg::kErrorCounters, 14) || overlaps(at, at + 1, reg::kLostLinks, 4) ||
                          overlaps(at, at + 1, reg::kWatchdogCounter, 2) || overlaps(at, at + 1, reg::kReceiveTimes, 16) ||
                          overlaps(at, at + 1, reg::kSyncManager, kSmSize * kMostSyncManagers);
    if ((access_[at] & kWritable) && !computed) memory_[at] = from[i];
  }
  apply(address, end, from.data());
  return true;
}

/// The effects of a write to the registers [address, end).
void Esc::apply(std::size_t address, std::size_t end, const Byte* from) {
  const auto clear = [&](std::uint16_t begin, std::size_t size) {
    if (overlaps(address, end, begin, size)) std::fill_n(memory_.begin() + begin, size, Byte{0});
  };
  const auto wrote = [&](std::uint16_t begin, std::size_t size) { return overlaps(address, end, begin, size); };
  if (end <= reg::kFmmu) {
    if (wrote(reg::kDlControl, 4)) update_links();
    if (wrote(reg::kAlControl, 1)) al_request_ = true;
    clear(reg::kErrorCounters, 12);
    clear(reg::kProcessingErrors, 1);
    clear(reg::kPdiErrors, 1);
    clear(reg::kLostLinks, 4);
    clear(reg::kWatchdogCounter, 2);
    if (wrote(reg::kProcessDataWatchdog, 2) && word(reg::kProcessDataWatchdog) == 0) watchdog_runs_ = watchdog_expired_ = false;
    if (wrote(reg::kSiiControl + 1, 1)) command_sii();
    return;
  }
  for (int n = 0; n < options_.fmmus; ++n) {
    if (wrote(static_cast<std::uint16_t>(reg::kFmmu + kFmmuSize * static_cast<std::size_t>(n)), kFmmuSize)) decode_fmmu(n);
  }
  for (int n = 0; n < options_.sync_managers; ++n) {
    if (wrote(static_cast<std::uint16_t>(reg::kSyncManager + kSmSize * static_cast<std::size_t>(n)), kSmSize)) {
      write_sync_manager(n, address, {from, end - address});
    }
  }
  if (options_.clock_unit == ClockUnit::kNone) return;
  if (wrote(reg::kReceiveTimes, 4)) {
    latch_ = true;
    put(reg::kReceiveTimes, static_cast<std::uint32_t>(stamp_));
    if (options_.clock_unit == ClockUnit::kFull) put(reg::kReceiveTime, stamp_);
  }
  if (options_.clock_unit != ClockUnit::kFull) return;
  if (wrote(reg::kSystemTime, 1)) {
    const int bits = wrote(reg::kSystemTime + 4, 4) ? 64 : 32;
    clock_.receive(get<std::uint64_t>(reg::kSystemTime), bits, stamp_, now_);
  }
  if (wrote(reg::kSystemTimeOffset, 8)) clock_.set_offset(get<std::uint64_t>(reg::kSystemTimeOffset));
  if (wrote(reg::kSystemTimeDelay, 4)) clock_.set_delay(get<std::uint32_t>(reg::kSystemTimeDelay));
  if (wrote(reg::kSpeedCounterStart, 2)) clock_.set_speed_start(word(reg::kSpeedCounterStart), now_);
  if (wrote(reg::kDifferenceFilter, 2)) clock_.set_filters(memory_[reg::kDifferenceFilter], memory_[reg::kSpeedFilter]);
  if (wrote(reg::kActivation, 1)) {
    clock_.activate_sync(memory_[reg::kActivation], get<std::uint64_t>(reg::kStartTime), get<std::uint32_t>(reg::kSync0Cycle),
                         get<std::uint32_t>(reg::kSync1Cycle), now_);
  }
}

void Esc::decode_fmmu(int n) {
  const Byte* const r = memory_.data() + reg::kFmmu + kFmmuSize * static_cast<std::size_t>(n);
  Fmmu& f = fmmus_[static_cast<std::size_t>(n)];
  f = {};
  const auto length = load<std::uint16_t>(r + 4);
  if (!(r[12] & 1) || length == 0) return;
  f.begin = load<std::uint32_t>(r);
  f.first = std::uint64_t{f.begin} * 8 + (r[6] & 7);
  f.end = (std::uint64_t{f.begin} + length - 1) * 8 + (r[7] & 7) + 1;
  if (f.end <= f.first) {
    f = {};
    return;
  }
  f.physical = std::uint64_t{load<std::uint16_t>(r + 8)} * 8 + (r[10] & 7);
  f.reads = (r[11] & fmmu::kRead) != 0;
  f.writes = (r[11] & fmmu::kWrite) != 0;
}

/// Start, length and control can be written while the sync manager is off.
void Esc::write_sync_manager(int n, std::size_t address, std::span<const Byte> from) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  const std::size_t base = reg::kSyncManager + kSmSize * static_cast<std::size_t>(n);
  for (std::size_t i = 0; i < kSmSize; ++i) {
    if (base + i < address || base + i >= address + from.size()) continue;
    if ((i < 5 && !s.enabled) || i == 6) memory_[base + i] = from[base + i - address];
  }
  const bool enabled = (memory_[base + 6] & sync_manager::kEnabled) != 0;
  if (enabled == s.enabled) return;
  s = {};
  s.enabled = enabled;
  memory_[base + 5] = 0;
  if (!enabled) {
    watchdog_runs_ = false;
    return;
  }
  s.start = get<std::uint16_t>(base);
  s.length = static_cast<std::uint16_t>(std::min<std::size_t>(get<std::uint16_t>(base + 2), kMemory - s.start));
  s.control = memory_[base + 4];
  std::fill_n(pdi_.begin() + s.start, s.length, Byte{0});
}

void Esc::command_sii() {
  const std::uint16_t value = word(reg::kSiiControl);
  const std::uint16_t command = value & sii_control::kCommands;
  const std::size_t at = 2 * std::size_t{get<std::uint32_t>(reg::kSiiAddress)};
  sii_errors_ &= sii_control::kChecksumError | sii_control::kNotLoaded;
  if (command == 0) return;
  if ((memory_[reg::kSiiConfig] & 1) || now_ < loaded_at_) {  // the application or the controller itself has the SII
    sii_errors_ |= sii_control::kCommandError;
    return;
  }
  sii_running_ = command;
  sii_done_ = now_ + options_.sii_time;
  const bool inside = at + 2 <= sii_.size();
  if (command == sii_control::kRead && inside) {
    for (std::size_t i = 0; i < 8; ++i) memory_[reg::kSiiData + i] = at + i < sii_.size() ? sii_[at + i] : Byte{0xff};
  } else if (command == sii_control::kWrite && inside) {
    if (value & sii_control::kWriteEnable) {
      std::copy_n(memory_.begin() + reg::kSiiData, 2, sii_.begin() + static_cast<std::ptrdiff_t>(at));
    } else {
      sii_errors_ |= sii_control::kWriteError;
    }
  } else if (command == sii_control::kReload || command == (sii_control::kRead | sii_control::kWrite)) {
    load_sii();
    update_links();
  } else {
    sii_errors_ |= sii_control::kCommandError;
  }
}

}  // namespace cotwin::ethercat
