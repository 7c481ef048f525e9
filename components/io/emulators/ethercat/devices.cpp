#include "components/io/emulators/ethercat/devices.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "components/io/emulators/ethercat/coe_server.h"
#include "components/io/ethercat/little_endian.h"

namespace cotwin::ethercat {

namespace {

Sii beckhoff(const char* order, const char* name, std::uint32_t product, std::uint32_t revision) {
  Sii s;
  s.vendor = kBeckhoff;
  s.product = product;
  s.revision = revision;
  s.size_kibit = 16;
  s.general.order = order;
  s.general.name = name;
  return s;
}

/// 16 PDOs of one bit, from `pdo` on, with objects `object` + 0x10 i. The first `split` are in sync manager 0, the others in 1.
std::vector<Pdo> channels(std::uint16_t pdo, std::uint16_t object, const std::string& entry, int split) {
  std::vector<Pdo> list;
  for (int i = 0; i < 16; ++i) {
    const auto index = static_cast<std::uint16_t>(object + 0x10 * i);
    list.push_back({static_cast<std::uint16_t>(pdo + i),
                    static_cast<std::uint8_t>(i < split ? 0 : 1),
                    0,
                    "Channel " + std::to_string(i + 1),
                    0,
                    {{index, 1, entry, object_type::kBool, 1, 0}}});
  }
  return list;
}

/// Bits with consecutive subindices, from 1 on.
std::vector<PdoEntry> flags(std::uint16_t index, std::initializer_list<const char*> names) {
  std::vector<PdoEntry> list;
  for (const char* const name : names)
    list.push_back({index, static_cast<std::uint8_t>(list.size() + 1), name, object_type::kBool, 1, 0});
  return list;
}

std::vector<PdoEntry> joined(std::vector<PdoEntry> a, const std::vector<PdoEntry>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

}  // namespace

Sii ek1100_sii() {
  Sii s = beckhoff("EK1100", "EK1100 EtherCAT coupler", kEk1100, 0x00120000);
  s.pdi_control = 0x0d00;
  s.general.ebus_current = -2000;
  s.general.physical_ports = 0x0131;
  return s;
}

Sii el1809_sii() {
  Sii s = beckhoff("EL1809", "EL1809 16 digital inputs 24 V, 3 ms", kEl1809, 0x00110000);
  s.pdi_control = 0x0104;
  s.general.ebus_current = 100;
  s.general.physical_ports = 0x0033;
  s.fmmus = {2};
  s.sync_managers = {{0x1000, 2, 0x00, 0, 1, SyncManagerType::kInputs}};
  s.tx_pdos = channels(0x1a00, 0x6000, "Input", 16);
  return s;
}

Sii el2809_sii() {
  Sii s = beckhoff("EL2809", "EL2809 16 digital outputs 24 V, 0.5 A", kEl2809, 0x00110000);
  s.pdi_control = 0x0104;
  s.pdi_config2 = 0x00ff;
  s.general.ebus_current = 140;
  s.general.physical_ports = 0x0033;
  s.fmmus = {1, 1};
  s.sync_managers = {{0x0f00, 1, 0x44, 0, 9, SyncManagerType::kOutputs}, {0x0f01, 1, 0x44, 0, 9, SyncManagerType::kOutputs}};
  s.rx_pdos = channels(0x1600, 0x7000, "Output", 8);
  return s;
}

Sii el5101_sii() {
  Sii s = beckhoff("EL5101", "EL5101 incremental encoder 5 V", kEl5101, 0x03f90000);
  s.pdi_control = 0x0005;
  s.general.ebus_current = 130;
  s.general.physical_ports = 0x0033;
  s.general.coe = 0x07;  // SDO, SDO information, PDO assignment
  s.mailbox = {0x1800, 246, 0x18f6, 246};
  s.bootstrap = s.mailbox;
  s.protocols = mailbox_protocol::kCoE;
  s.fmmus = {1, 2};
  s.sync_managers = {{0x1800, 246, 0x26, 0, 1, SyncManagerType::kMailboxOut},
                     {0x18f6, 246, 0x22, 0, 1, SyncManagerType::kMailboxIn},
                     {0x1000, 3, 0x64, 0, 1, SyncManagerType::kOutputs},
                     {0x1100, 5, 0x20, 0, 1, SyncManagerType::kInputs}};
  s.rx_pdos = {
      {0x1600,
       2,
       0,
       "Outputs",
       0,
       {{0x7000, 1, "Control", object_type::kU8, 8, 0}, {0x7000, 2, "Set counter value", object_type::kU16, 16, 0}}},
      {0x1603, kNotAssigned, 0, "Control 32 bit", 0,
       joined(flags(0x7010, {"Enable latch C", "Enable latch extern on positive edge", "Set counter",
                             "Enable latch extern on negative edge"}),
              {{0, 0, "", 0, 4, 0}, {0, 0, "", 0, 8, 0}, {0x7010, 0x11, "Set counter value", object_type::kU32, 32, 0}})},
  };
  const auto status = flags(0x6010, {"Latch C valid", "Latch extern valid", "Set counter done", "Counter underflow",
                                     "Counter overflow", "Status of input status", "Open circuit", "Extrapolation stall",
                                     "Status of input A", "Status of input B", "Status of input C", "Status of input gate",
                                     "Status of extern latch", "Sync error", "TxPDO state", "TxPDO toggle"});
  s.tx_pdos = {
      {0x1a00,
       3,
       0,
       "Inputs",
       0,
       {{0x6000, 1, "Status", object_type::kU8, 8, 0},
        {0x6000, 2, "Counter value", object_type::kU16, 16, 0},
        {0x6000, 3, "Latch value", object_type::kU16, 16, 0}}},
      {0x1a02,
       kNotAssigned,
       0,
       "Frequency and period",
       0,
       {{0x6000, 4, "Frequency value", object_type::kU32, 32, 0},
        {0x6000, 5, "Period value", object_type::kU16, 16, 0},
        {0x6000, 6, "Window value", object_type::kU16, 16, 0}}},
      {0x1a03, kNotAssigned, 0, "Status compact", 0,
       joined(status, {{0x6010, 0x11, "Counter value", object_type::kU16, 16, 0},
                       {0x6010, 0x12, "Latch value", object_type::kU16, 16, 0}})},
      {0x1a04, kNotAssigned, 0, "Status 32 bit", 0,
       joined(status, {{0x6010, 0x11, "Counter value", object_type::kU32, 32, 0},
                       {0x6010, 0x12, "Latch value", object_type::kU32, 32, 0}})},
  };
  s.clock_modes = {{0, 0, 0, 0, 0x0000, 0, "Free run", "no synchronisation"}, {0, 0, 0, 0, 0x0320, 1, "DC", "SYNC0"}};
  return s;
}

SlaveOptions ek1100_options(const ClockOptions& clock) {
  SlaveOptions options = terminal_options(clock);
  options.esc.ports = 0x3b;  // ports 0 and 2 MII, port 1 EBUS
  return options;
}

SlaveOptions terminal_options(const ClockOptions& clock) {
  SlaveOptions options;
  options.esc.fmmus = 3;
  options.esc.sync_managers = 4;
  options.esc.features = 0x00fc;
  options.esc.clock = clock;
  return options;
}

Ek1100::Ek1100(const SlaveOptions& options) : Slave(write_sii(ek1100_sii()), options) {}

El1809::El1809(const SlaveOptions& options) : Slave(write_sii(el1809_sii()), options) {}

void El1809::set_channels(std::uint16_t channels, std::int64_t now) {
  update(now);
  const int changes = channels ^ raw_;
  raw_ = channels;
  for (std::size_t i = 0; i < changed_.size(); ++i) {
    if (changes >> i & 1) changed_[i] = now;
  }
}

void El1809::update(std::int64_t now) {
  const int different = raw_ ^ filtered_;
  for (std::size_t i = 0; different != 0 && i < changed_.size(); ++i) {
    if ((different >> i & 1) && now - changed_[i] >= kFilter) filtered_ = static_cast<std::uint16_t>(filtered_ ^ 1 << i);
  }
  store(inputs().data(), filtered_);
}

El2809::El2809(const SlaveOptions& options) : Slave(write_sii(el2809_sii()), options) {}

std::uint16_t El2809::channels() const { return load<std::uint16_t>(outputs().data()); }

El5101::El5101(const SlaveOptions& options) : Slave(write_sii(el5101_sii()), options) {}

void El5101::restart() {
  offset_ = 0;
  latched_ = 0;
  valid_c_ = valid_extern_ = set_before_ = set_done_ = underflow_ = overflow_ = false;
  pulses_ = 0;
}

std::int64_t El5101::range() const { return place_of(0x1a04) ? std::int64_t{1} << 32 : std::int64_t{1} << 16; }

El5101::Control El5101::control() const {
  if (const auto at = place_of(0x1603)) {
    const std::uint8_t* const from = outputs().data() + *at / 8;
    return {(from[0] & 1) != 0, (from[0] & 2) != 0, (from[0] & 8) != 0, (from[0] & 4) != 0, load<std::uint32_t>(from + 2)};
  }
  if (const auto at = place_of(0x1600)) {
    const std::uint8_t* const from = outputs().data() + *at / 8;
    return {(from[0] & 1) != 0, (from[0] & 2) != 0, (from[0] & 8) != 0, (from[0] & 4) != 0, load<std::uint16_t>(from + 1)};
  }
  return {};
}

void El5101::set_position(std::int64_t counts, std::int64_t now) {
  const std::int64_t before = position_, turn = counts_per_turn_;
  const auto floor_of = [](std::int64_t a, std::int64_t b) { return a / b - (a % b < 0 ? 1 : 0); };
  if (turn > 0 && counts != before && control().latch_c && !valid_c_) {
    // The first multiple of `turn` on the way, which excludes its beginning.
    const std::int64_t pulse = counts > before ? (floor_of(before, turn) + 1) * turn : (floor_of(before - 1, turn)) * turn;
    if (counts > before ? pulse <= counts : pulse >= counts) {
      latched_ = static_cast<std::uint32_t>(pulse + offset_);
      valid_c_ = true;
    }
  }
  position_ = counts;
  const std::int64_t r = range(), old_round = floor_of(before + offset_, r), round = floor_of(counts + offset_, r);
  if (round > old_round) overflow_ = !(underflow_ = false);
  if (round < old_round) underflow_ = !(overflow_ = false);
  const std::int64_t value = counts + offset_ - round * r;
  if (round == old_round && value > r / 3) overflow_ = false;
  if (round == old_round && value < r - r / 3) underflow_ = false;
  if (now > moved_at_) speed_ = static_cast<double>(counts - before) / (1e-9 * static_cast<double>(now - moved_at_));
  moved_at_ = now;
  update(now);
}

void El5101::set_latch_input(bool on) {
  const Control c = control();
  if (on != input_ && !valid_extern_ && (on ? c.latch_rising : c.latch_falling)) {
    latched_ = counter();
    valid_extern_ = true;
  }
  input_ = on;
}

void El5101::update(std::int64_t) {
  const Control c = control();
  valid_c_ = valid_c_ && c.latch_c;
  valid_extern_ = valid_extern_ && (c.latch_rising || c.latch_falling);
  if (c.set && !set_before_) {
    offset_ = static_cast<std::int64_t>(c.value) - position_;
    overflow_ = underflow_ = false;
  }
  set_before_ = set_done_ = c.set;
  if (esc().clock().sync0_active()) {  // inputs are sampled at SYNC0
    if (esc().clock().sync0_count() == pulses_) return;
    pulses_ = esc().clock().sync0_count();
  }
  write_inputs();
}

void El5101::write_inputs() {
  const int flags = valid_c_ | valid_extern_ << 1 | set_done_ << 2 | underflow_ << 3 | overflow_ << 4;
  const std::span<std::uint8_t> to = inputs();
  const auto position = static_cast<std::uint64_t>(position_);
  // Quadrature signals: A leads B.
  const int a = (position & 3) == 1 || (position & 3) == 2, b = (position & 3) >= 2;
  const int c = counts_per_turn_ > 0 && position_ % counts_per_turn_ == 0;
  const auto wide = static_cast<std::uint16_t>(flags | a << 8 | b << 9 | c << 10 | input_ << 12);
  if (const auto at = place_of(0x1a00)) {
    std::uint8_t* const p = to.data() + *at / 8;
    p[0] = static_cast<std::uint8_t>(flags | input_ << 5);
    store(p + 1, static_cast<std::uint16_t>(counter()));
    store(p + 3, static_cast<std::uint16_t>(latched_));
  }
  if (const auto at = place_of(0x1a02)) {
    std::uint8_t* const p = to.data() + *at / 8;
    const double hertz = std::abs(speed_) / 4;  // of the signal period
    store(p, static_cast<std::uint32_t>(std::min(100 * hertz, 4294967295.0)));
    store(p + 4, static_cast<std::uint16_t>(hertz > 0 ? std::min(2e6 / hertz, 65535.0) : 0));
    store(p + 6, std::uint16_t{0});
  }
  if (const auto at = place_of(0x1a03)) {
    std::uint8_t* const p = to.data() + *at / 8;
    store(p, wide);
    store(p + 2, static_cast<std::uint16_t>(counter()));
    store(p + 4, static_cast<std::uint16_t>(latched_));
  }
  if (const auto at = place_of(0x1a04)) {
    std::uint8_t* const p = to.data() + *at / 8;
    store(p, wide);
    store(p + 2, counter());
    store(p + 6, latched_);
  }
}

}  // namespace cotwin::ethercat
