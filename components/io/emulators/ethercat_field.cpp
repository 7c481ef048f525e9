#include "components/io/emulators/ethercat_field.h"

#include <cmath>
#include <limits>

#include "components/io/emulators/ethercat/devices.h"
#include "components/io/emulators/ethercat/servo_drive.h"

namespace cotwin::io {

namespace {

using Kind = SlaveChoice::Kind;

bool is_emulated_drive(const SlaveChoice& s) { return s.kind == Kind::kDrive && s.image.empty(); }

constexpr double kDelayPerMetre = 5.3;  // ns, of a frame on copper

}  // namespace

EtherCatField::EtherCatField(const std::vector<SlaveChoice>& slaves, std::size_t joints)
    : slaves_(slaves),
      terminals_(slaves.size()),
      q_(joints),
      counts_per_q_(joints, 1.0),
      drift_(slaves.size()),
      cable_(slaves.size(), 2.0),
      states_(slaves.size()) {}

void EtherCatField::declare(Variables& v, JointVariables& joints) {
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const SlaveChoice& s = slaves_[i];
    if (s.kind == Kind::kDigitalInputs) {
      v.input(s.name + "_field", terminals_[i].channels, "what is wired to the channels of the " + s.device);
    } else if (s.kind == Kind::kDigitalOutputs) {
      v.output(s.name + "_field", terminals_[i].channels, "what the channels of the " + s.device + " switch");
    } else if (is_emulated_drive(s)) {
      v.output(s.name + "_field", terminals_[i].position, "1", "position of the axis of the " + s.device + ", counts");
      v.parameter(s.name + "_start", terminals_[i].start,
                  "position of the axis when the " + s.device + " is switched on, counts");
      v.input(s.name + "_fault", terminals_[i].fault, "whether the " + s.device + " has a fault of the outside (code 0x9000)");
      v.input(s.name + "_torque_off", terminals_[i].torque_off,
              "whether the safe torque off or the mains contactor of the " + s.device +
                  " is open: no fault, but it cannot be enabled");
    }
  }
  joints.input("q_field", q_, "rad", "position of the axis at each encoder, in the order of the bus");
  v.parameter("counts_per_q", counts_per_q_, "1", "counts of each encoder (4 per line) per rad or m of its axis");
  v.output("bus_state", states_, "state of each emulated slave: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; 0: switched off");
  v.parameter("drift", drift_, "1", "of each emulated slave's clock, relative: 5e-5 gains 50 us per second").range(-1e-3, 1e-3);
  v.parameter("cable", cable_, "m", "length of the cable before each emulated slave").range(0, 1000);
  v.tunable("cut", cut_, "number of the slave, from 0, before which the cable is cut; -1: none").range(-1, 65535);
  v.tunable("off", off_, "number of the slave, from 0, that is switched off; -1: none").range(-1, 65535);
}

void EtherCatField::initialise(std::int64_t now) {
  bus_ = ethercat::Bus();
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    ethercat::ClockOptions clock;
    clock.drift = drift_[i];
    clock.seed = i;
    clock.start = 1'000'000'000 * (i + 1);  // clocks that were switched on at different times
    ethercat::Connection connection;
    connection.parent = i == 0 ? 0 : i - 1;
    connection.cable = std::llround(cable_[i] * kDelayPerMetre);
    ethercat::Slave& slave = bus_.append(make_slave(slaves_[i], clock), connection);
    if (is_emulated_drive(slaves_[i])) {
      static_cast<ethercat::ServoDrive&>(slave).set_start(terminals_[i].start);
      terminals_[i].axis = terminals_[i].start;
    }
    slave.power_on(now);
  }
  cut_now_ = off_now_ = -1;
  exchange();
}

void EtherCatField::exchange() {
  std::size_t encoder = 0;
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    Terminal& t = terminals_[i];
    if (slaves_[i].kind == Kind::kDigitalInputs) {
      std::uint32_t bits = 0;
      for (std::size_t c = 0; c < t.channels.size(); ++c) bits |= t.channels[c] ? 1u << c : 0u;
      t.bits.store(bits, std::memory_order_relaxed);
    } else if (slaves_[i].kind == Kind::kDigitalOutputs) {
      const std::uint32_t bits = t.bits.load(std::memory_order_relaxed);
      for (std::size_t c = 0; c < t.channels.size(); ++c) t.channels[c] = (bits >> c & 1u) != 0;
    } else if (slaves_[i].kind == Kind::kEncoder) {
      const double counts = std::floor(q_[encoder] * counts_per_q_[encoder]);
      ++encoder;
      if (std::abs(counts) < 9e18) t.counts.store(static_cast<std::int64_t>(counts), std::memory_order_relaxed);
    } else if (is_emulated_drive(slaves_[i])) {
      t.position = t.axis.load(std::memory_order_relaxed);
      t.cause.store(t.fault, std::memory_order_relaxed);
      t.is_off.store(t.torque_off, std::memory_order_relaxed);
    }
    states_[i] = t.state.load(std::memory_order_relaxed);
  }
  cut_wanted_.store(cut_, std::memory_order_relaxed);
  off_wanted_.store(off_, std::memory_order_relaxed);
}

void EtherCatField::apply(std::int64_t now) {
  const auto slaves = static_cast<std::int32_t>(slaves_.size());
  const auto change = [slaves](std::atomic<std::int32_t>& wanted, std::int32_t& present, auto act) {
    const std::int32_t next = wanted.load(std::memory_order_relaxed);
    if (next == present) return;
    if (present >= 0 && present < slaves) act(static_cast<std::size_t>(present), false);
    present = next;
    if (present >= 0 && present < slaves) act(static_cast<std::size_t>(present), true);
  };
  change(cut_wanted_, cut_now_, [&](std::size_t n, bool cut) { bus_.cut(n, cut); });
  change(off_wanted_, off_now_, [&](std::size_t n, bool off) { bus_.power(n, !off, now); });
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    Terminal& t = terminals_[i];
    ethercat::Slave& slave = bus_.slave(i);
    if (slaves_[i].kind == Kind::kDigitalInputs) {
      static_cast<ethercat::El1809&>(slave).set_channels(static_cast<std::uint16_t>(t.bits.load(std::memory_order_relaxed)),
                                                         now);
    } else if (slaves_[i].kind == Kind::kDigitalOutputs) {
      t.bits.store(static_cast<ethercat::El2809&>(slave).channels(), std::memory_order_relaxed);
    } else if (slaves_[i].kind == Kind::kEncoder) {
      static_cast<ethercat::El5101&>(slave).set_position(t.counts.load(std::memory_order_relaxed), now);
    } else if (is_emulated_drive(slaves_[i])) {
      auto& drive = static_cast<ethercat::ServoDrive&>(slave);
      drive.set_fault_cause(t.cause.load(std::memory_order_relaxed));
      drive.set_torque_off(t.is_off.load(std::memory_order_relaxed));
      if (off_now_ != static_cast<std::int32_t>(i)) drive.advance(now);
      t.axis.store(drive.position(), std::memory_order_relaxed);
    }
    const bool off = off_now_ == static_cast<std::int32_t>(i);
    t.state.store(off ? 0 : static_cast<std::int32_t>(slave.state()), std::memory_order_relaxed);
  }
}

}  // namespace cotwin::io
