#include "components/io/emulators/ethercat/esc.h"

#include <algorithm>

#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

bool reads(Command c) {
  switch (c) {
    case Command::kAprd:
    case Command::kAprw:
    case Command::kFprd:
    case Command::kFprw:
    case Command::kBrd:
    case Command::kBrw:
    case Command::kLrd:
    case Command::kLrw:
      return true;
    default:
      return false;
  }
}

bool writes(Command c) {
  switch (c) {
    case Command::kApwr:
    case Command::kAprw:
    case Command::kFpwr:
    case Command::kFprw:
    case Command::kBwr:
    case Command::kBrw:
    case Command::kLwr:
    case Command::kLrw:
      return true;
    default:
      return false;
  }
}

bool by_position(Command c) { return (c >= Command::kAprd && c <= Command::kAprw) || c == Command::kArmw; }
bool by_station(Command c) { return (c >= Command::kFprd && c <= Command::kFprw) || c == Command::kFrmw; }
bool broadcast(Command c) { return c >= Command::kBrd && c <= Command::kBrw; }
bool read_multiple_write(Command c) { return c == Command::kArmw || c == Command::kFrmw; }

bool bit(std::span<const std::uint8_t> bytes, std::uint64_t n) { return (bytes[n / 8] >> (n % 8) & 1) != 0; }

void set_bit(std::span<std::uint8_t> bytes, std::uint64_t n, bool value) {
  const auto mask = static_cast<std::uint8_t>(1u << (n % 8));
  bytes[n / 8] = static_cast<std::uint8_t>(value ? bytes[n / 8] | mask : bytes[n / 8] & ~mask);
}

}  // namespace

bool Esc::process(std::span<std::uint8_t> frame, std::int64_t now) {
  advance(now);
  latch_ = false;
  FrameReader reader(frame, FrameReader::Reserved::kIgnored);
  if (reader.fault() == FrameFault::kNotEtherCat) return (memory_[reg::kDlControl] & 1) == 0;
  frame[6] |= 2;  // locally administered source address
  if (reader.fault() != FrameFault::kNone) {
    Byte& errors = memory_[reg::kProcessingErrors];
    if (errors != 0xff) ++errors;
    return true;
  }
  stamp_ = clock_.stamp(now);
  Datagram d;
  while (reader.next(d)) execute(frame, d, now);
  return true;
}

void Esc::execute(std::span<Byte> frame, const Datagram& d, std::int64_t now) {
  now_ = now;
  Byte* const header = frame.data() + d.data - kDatagramHeader;
  const std::span<Byte> data = frame.subspan(d.data, d.length);
  bool hit = is_logical(d.command);
  if (by_position(d.command)) {
    hit = d.station() == 0;
  } else if (by_station(d.command)) {
    hit = d.station() == word(reg::kStation) || ((memory_[reg::kAliasControl] & 1) && d.station() == word(reg::kAlias));
  } else if (broadcast(d.command)) {
    hit = true;
  }
  if (by_position(d.command) || broadcast(d.command)) {
    store(header + kAddressField, static_cast<std::uint16_t>(d.station() + 1));
  }
  int count = 0;
  if (is_logical(d.command)) {
    const bool both = d.command == Command::kLrw;
    if (!both || !(options_.features & feature::kNoLrw)) count = logical(data, d.address, reads(d.command), writes(d.command));
  } else if (read_multiple_write(d.command)) {
    count = physical(data, d.offset(), hit, !hit, false);
  } else if (hit) {
    const bool both = reads(d.command) && writes(d.command);
    if (!both || !(options_.features & feature::kNoReadWrite)) {
      count = physical(data, d.offset(), reads(d.command), writes(d.command), broadcast(d.command));
    }
  }
  store(header + kIrqField, static_cast<std::uint16_t>(d.irq | (events() & word(reg::kEventMask))));
  store(data.data() + data.size(), static_cast<std::uint16_t>(d.working_counter + count));
}

int Esc::physical(std::span<Byte> data, std::size_t address, bool do_read, bool do_write, bool combine) {
  const std::span<Byte> received = std::span(before_).first(data.size());
  if (do_write) std::copy(data.begin(), data.end(), received.begin());
  int count = 0;
  if (do_read) {
    const std::span<Byte> stored = std::span(scratch_).first(data.size());
    if (read(address, stored)) {
      count += 1;
      for (std::size_t i = 0; i < data.size(); ++i) data[i] = static_cast<Byte>(combine ? data[i] | stored[i] : stored[i]);
    }
  }
  if (do_write && write(address, received)) count += do_read ? 2 : 1;
  return count;
}

int Esc::logical(std::span<Byte> data, std::uint32_t address, bool do_read, bool do_write) {
  const std::span<Byte> received = std::span(before_).first(data.size());
  const std::uint64_t begin = std::uint64_t{address} * 8, end = begin + data.size() * 8;
  bool copied = false, was_read = false, was_written = false;
  for (int n = 0; n < options_.fmmus; ++n) {
    const Fmmu& f = fmmus_[static_cast<std::size_t>(n)];
    if (f.end <= begin || f.first >= end) continue;
    if (!copied) std::copy(data.begin(), data.end(), received.begin());
    copied = true;
    if (do_read && f.reads) was_read |= read_mapped(f, data, begin);
  }
  if (!copied || !do_write) return was_read ? 1 : 0;
  for (int n = 0; n < options_.fmmus; ++n) {
    const Fmmu& f = fmmus_[static_cast<std::size_t>(n)];
    if (f.end > begin && f.first < end && f.writes) was_written |= write_mapped(f, received, begin);
  }
  return (was_read ? 1 : 0) + (was_written ? do_read ? 2 : 1 : 0);
}

bool Esc::read_mapped(const Fmmu& f, std::span<Byte> data, std::uint64_t begin) {
  const std::uint64_t first = std::max(f.first, begin), last = std::min(f.end, begin + data.size() * 8);
  const std::uint64_t source = f.physical + (first - f.first), source_end = source + (last - first);
  const std::size_t address = source / 8, size = (source_end + 7) / 8 - address;
  const std::span<Byte> stored = std::span(scratch_).first(size);
  if (!read(address, stored)) return false;
  if (first % 8 == 0 && last % 8 == 0 && source % 8 == 0) {
    std::copy(stored.begin(), stored.end(), data.begin() + static_cast<std::ptrdiff_t>((first - begin) / 8));
    return true;
  }
  for (std::uint64_t n = 0; n < last - first; ++n) set_bit(data, first - begin + n, bit(stored, source % 8 + n));
  return true;
}

bool Esc::write_mapped(const Fmmu& f, std::span<const Byte> data, std::uint64_t begin) {
  const std::uint64_t first = std::max(f.first, begin), last = std::min(f.end, begin + data.size() * 8);
  const std::uint64_t target = f.physical + (first - f.first), target_end = target + (last - first);
  const std::size_t address = target / 8, size = (target_end + 7) / 8 - address;
  if (first % 8 == 0 && last % 8 == 0 && target % 8 == 0) return write(address, data.subspan((first - begin) / 8, size));
  // The other bits of the first and last byte keep their value.
  const std::span<Byte> merged = std::span(scratch_).first(size);
  if (address + size > memory_.size()) return false;
  std::copy_n(memory_.begin() + static_cast<std::ptrdiff_t>(address), size, merged.begin());
  for (std::uint64_t n = 0; n < last - first; ++n) set_bit(merged, target % 8 + n, bit(data, first - begin + n));
  return write(address, merged);
}

void Esc::frame_returned(int port, std::int64_t now) {
  if (latch_) put(reg::kReceiveTimes + 4 * static_cast<std::size_t>(port), static_cast<std::uint32_t>(clock_.stamp(now)));
}

void Esc::count_damaged(bool first) {
  Byte& counter = memory_[first ? reg::kErrorCounters : reg::kForwardedErrors];
  if (counter != 0xff) ++counter;
}

void Esc::set_link(int port, bool link) {
  bool& old = link_[static_cast<std::size_t>(port)];
  if (old == link) return;
  old = link;
  Byte& lost = memory_[reg::kLostLinks + static_cast<std::size_t>(port)];
  if (!link && lost != 0xff) ++lost;
  event_ |= event::kDlStatus;
  update_links();
}

bool Esc::port_open(int port) const {
  const int control = memory_[reg::kPortControl] >> (2 * port) & 3;
  return control == 2 || (control != 3 && link_[static_cast<std::size_t>(port)]);
}

void Esc::advance(std::int64_t now) {
  now_ = std::max(now_, now);
  clock_.advance(now_);
  const std::int64_t period = (std::int64_t{word(reg::kWatchdogDivider)} + 2) * 40 * word(reg::kProcessDataWatchdog);
  if (!watchdog_runs_ || period == 0 || now_ - triggered_ <= period) return;
  watchdog_runs_ = false;
  watchdog_expired_ = true;
  Byte& counter = memory_[reg::kWatchdogCounter];
  if (counter != 0xff) ++counter;
}

bool Esc::pop_al_request() {
  const bool request = al_request_;
  al_request_ = false;
  return request;
}

void Esc::set_al_status(std::uint16_t status, AlCode code) {
  if (status != al_status()) event_ |= event::kAlStatus;
  set_word(reg::kAlStatus, status);
  set_word(reg::kAlStatusCode, static_cast<std::uint16_t>(code));
}

std::span<const std::uint8_t> Esc::outputs(int n) const {
  const SyncManager& s = sync_manager(n);
  if (!s.enabled || s.mailbox() || !s.master_writes()) return {};
  return std::span(pdi_).subspan(s.start, s.length);
}

bool Esc::set_inputs(int n, std::span<const std::uint8_t> data) {
  const SyncManager& s = sync_manager(n);
  if (!s.enabled || s.mailbox() || s.master_writes() || data.size() != s.length) return false;
  std::copy(data.begin(), data.end(), pdi_.begin() + s.start);
  return true;
}

std::span<const std::uint8_t> Esc::read_mail(int n) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  if (!s.enabled || !s.mailbox() || !s.master_writes() || !s.written) return {};
  s.written = false;
  set_status(n, sync_manager::kReadEvent, sync_manager::kFull | sync_manager::kWriteEvent);
  std::copy_n(memory_.begin() + s.start, s.length, pdi_.begin() + s.start);
  return std::span<const Byte>(pdi_).subspan(s.start, s.length);
}

bool Esc::put_mail(int n, std::span<const std::uint8_t> mail) {
  SyncManager& s = sync_managers_[static_cast<std::size_t>(n)];
  if (!s.enabled || !s.mailbox() || s.master_writes() || mail.size() > s.length) return false;
  if (memory_[reg::kSyncManager + 8 * static_cast<std::size_t>(n) + 5] & sync_manager::kFull) return false;
  const auto rest = std::copy(mail.begin(), mail.end(), memory_.begin() + s.start);
  std::fill(rest, memory_.begin() + static_cast<std::ptrdiff_t>(s.end()), Byte{0});
  s.open = false;
  set_status(n, sync_manager::kFull | sync_manager::kWriteEvent, sync_manager::kReadEvent);
  return true;
}

bool Esc::repeat_requested(int n) const {
  const Byte* const s = memory_.data() + reg::kSyncManager + 8 * n;
  return sync_manager(n).enabled && ((s[6] ^ s[7]) & sync_manager::kRepeat) != 0;
}

void Esc::acknowledge_repeat(int n) {
  Byte* const s = memory_.data() + reg::kSyncManager + 8 * n;
  s[7] = static_cast<Byte>((s[7] & ~sync_manager::kRepeat) | (s[6] & sync_manager::kRepeat));
}

}  // namespace cotwin::ethercat
