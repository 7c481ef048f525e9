#include "components/io/ethercat_link.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <thread>

#include "components/io/ethercat/master/raw_wire.h"
#include "components/unit/tick_source.h"
#include "models/support/error.h"

namespace cotwin::io {

namespace {

using Kind = SlaveChoice::Kind;

const std::string kPlace = "unit:io?link=ethercat";
constexpr std::int64_t kEpoch = 946'684'800'000'000'000;  // ns from 1970 to 2000, with which EtherCAT's time begins
constexpr const char* kNotOperational = "the bus was not operational at some time: its outputs were off and its inputs held";

constexpr const char* kRestarted =
    "an encoder terminal was switched off and on: its position continues from the last known one, movements meanwhile are "
    "unknown";

std::int64_t nanoseconds(double seconds) { return std::llround(seconds * 1e9); }

std::int64_t time_since_2000() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(now).count() - kEpoch;
}

std::string hex4(unsigned value) {
  static constexpr char kDigits[] = "0123456789abcdef";
  std::string text;
  for (int shift = 12; shift >= 0; shift -= 4) text += kDigits[value >> shift & 15];
  return text;
}

}  // namespace

/// The clock of the bus: one arrival per cycle, with the time of the reference clock.
class EtherCatLink::Source final : public TickSource {
 public:
  explicit Source(EtherCatLink& link) : link_(link) {}

  std::optional<Arrival> wait(std::int64_t deadline) override {
    if (!link_.master_) return std::nullopt;
    if (link_.master_->system_time_at() == 0) told_ = 0;
    link_.master_->collect(*link_.wire_, std::max<std::int64_t>(deadline, 1));
    if (link_.master_->system_time_at() == told_) {
      // Nothing more comes in this cycle.
      std::this_thread::sleep_until(std::chrono::steady_clock::time_point(std::chrono::nanoseconds(deadline)));
      return std::nullopt;
    }
    told_ = link_.master_->system_time_at();
    return Arrival{told_, link_.master_->system_time()};
  }
  std::int64_t period() const override { return nanoseconds(link_.cycle_); }

 private:
  EtherCatLink& link_;
  std::int64_t told_ = 0;
};

/// The ports of one slave.
struct EtherCatLink::Device {
  std::array<bool, 16> channels{};                  // EL1809, EL2809
  std::unique_ptr<bool[]> input_bits, output_bits;  // of slaves whose channels are bits
  std::vector<std::int32_t> inputs, outputs;        // other channels of the SII's PDOs
  // EL5101
  std::int32_t count = 0, latch = 0, set_value = 0;
  bool set = false, set_done = false, latch_c = false, latch_rising = false, latch_falling = false, latched = false;
  std::uint32_t last = 0;          // counter of the terminal
  std::int64_t counts = 0;         // since the start
  std::int64_t counts_before = 0;  // one step ago
  bool known = false;              // `last` is valid
  int restarts = 0;
};

EtherCatLink::EtherCatLink(Settings& settings, std::size_t joints)
    : interface_(settings.text("interface")),
      clocks_(settings.boolean("clocks")),
      wide_(settings.integer("encoder_bits") == 32),
      slaves_(read_slaves(settings, kPlace)),
      devices_(slaves_.size()),
      n_(joints),
      q_scale_(joints, 1.0),
      q_offset_(joints),
      state_(slaves_.size()),
      al_code_(slaves_.size()) {
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    if (slaves_[i].kind == Kind::kEncoder) encoders_.push_back(i);
  }
  check_encoders(slaves_, n_, kPlace);
  if (interface_ == "emulated") field_.emplace(slaves_, n_);
}

EtherCatLink::~EtherCatLink() {
  if (master_) master_->stop(*wire_);
}

TickSource* EtherCatLink::tick_source() {
  if (field_ || !clocks_) return nullptr;
  if (!source_) source_ = std::make_unique<Source>(*this);
  return source_.get();
}

void EtherCatLink::declare(Variables& v, JointVariables& joints) {
  for (std::size_t i = 0; i < slaves_.size(); ++i) declare_device(v, i);
  v.output("operational", operational_, "whether all slaves are in OP and exchange data");
  v.output("answering", answering_, "number of slaves that answer");
  v.output("state", state_, "state of each slave: 1 INIT, 2 PREOP, 4 SAFEOP, 8 OP; 0: it does not answer");
  v.output("al_code", al_code_, "AL status code of each slave's last error (ETG.1000.6); 0: none");
  v.output("cycles", cycles_, "cycles sent");
  v.output("lost", lost_, "cycles without all answers");
  v.output("late", late_, "answers after the next cycle began, which are not used");
  v.output("foreign", foreign_, "frames that are no answers to this master");
  v.output("unsent", unsent_, "frames that the interface did not take");
  v.output("working_counter_errors", working_counter_errors_, "cycles with a wrong working counter, whose inputs are not used");
  v.output("slaves_lost", slaves_lost_, "times at which a slave stopped answering");
  v.output("slave_faults", slave_faults_, "times at which a slave left OP by itself");
  v.output("wrong_slaves", wrong_slaves_, "times at which another device was found in the place of a slave");
  v.output("unexpected_slaves", unexpected_slaves_, "times at which more slaves answered than there should be");
  v.output("recovered", recovered_, "slaves that were brought back to OP");
  v.output("clock_difference", clock_difference_, "s",
           "largest deviation from the reference clock that the slaves report; 0 without clocks")
      .discrete();
  v.parameter("cycle", cycle_, "s", "cycle of the bus, of SYNC0 and of the clock that the bus is for the run").range(1e-5, 1);
  v.parameter("timeout", timeout_, "s", "time without an answer after which the bus is not operational").range(0, 10);
  v.parameter("wait", wait_, "s", "time for which a silent bus is waited for at the start").range(0, 3600);
  v.parameter("sii_folder", sii_folder_,
              "folder to which the SII images of all slaves are written at the start, for devices that are described by them");
  v.parameter("sync0", sync0_, "whether the EL5101 work with SYNC0 of the distributed clocks");
  v.parameter("sync0_shift", sync0_shift_, "s", "of SYNC0 against the multiples of the cycle").range(-1, 1);
  v.parameter("dq_cutoff", dq_cutoff_, "Hz", "cut-off frequency of the low-pass of dq; 0: none").range(0, 1e6);
  joints.parameter("q_scale", q_scale_, "rad", "joint position per count of the encoder");
  joints.parameter("q_offset", q_offset_, "rad", "joint position at the start of the run");
  if (field_) field_->declare(v, joints);
}

void EtherCatLink::declare_device(Variables& v, std::size_t i) {
  const SlaveChoice& s = slaves_[i];
  Device& d = devices_[i];
  if (s.kind == Kind::kDigitalInputs) {
    v.output(s.name, d.channels, "channels of the " + s.device);
  } else if (s.kind == Kind::kDigitalOutputs) {
    v.input(s.name, d.channels, "channels of the " + s.device + "; off while the bus is not operational");
  } else if (s.kind == Kind::kEncoder) {
    v.output(s.name + "_count", d.count, "counts of the " + s.device + " since the start (4 per line), modulo 2^32");
    v.output(s.name + "_latch", d.latch, "counter of the terminal at the last latch");
    v.output(s.name + "_latched", d.latched, "whether a latch was taken since it was enabled");
    v.output(s.name + "_set_done", d.set_done, "whether the counter was set since the last rising edge of " + s.name + "_set");
    v.input(s.name + "_set", d.set, "a rising edge sets the counter of the terminal, and count, to " + s.name + "_set_value");
    v.input(s.name + "_set_value", d.set_value, "the counter after setting");
    v.input(s.name + "_latch_C", d.latch_c, "enables the latch by the encoder's zero pulse");
    v.input(s.name + "_latch_rising", d.latch_rising, "enables the latch by a rising edge of the external input");
    v.input(s.name + "_latch_falling", d.latch_falling, "enables the latch by a falling edge of the external input");
  } else if (s.kind == Kind::kImage) {
    for (const bool outputs : {true, false}) {
      const std::vector<ethercat::Channel>& channels = outputs ? s.setup.outputs : s.setup.inputs;
      const bool both = !s.setup.outputs.empty() && !s.setup.inputs.empty();
      if (s.is_digital(outputs)) {
        std::unique_ptr<bool[]>& bits = outputs ? d.output_bits : d.input_bits;
        bits = std::make_unique<bool[]>(channels.size());
        const std::span<bool> view(bits.get(), channels.size());
        const std::string name = s.name + (both && outputs ? "_out" : "");
        if (outputs) {
          v.input(name, view, "channels of the " + s.device + "; off while the bus is not operational");
        } else {
          v.output(name, view, "channels of the " + s.device);
        }
        continue;
      }
      std::vector<std::int32_t>& values = outputs ? d.outputs : d.inputs;
      values.resize(channels.size());
      for (std::size_t c = 0; c < channels.size(); ++c) {
        const ethercat::Channel& channel = channels[c];
        if (channel.bits > 32) {
          throw Error(kPlace,
                      s.device + ": '" + channel.name + "' has " + std::to_string(channel.bits) + " bits, expected at most 32");
        }
        const std::string name =
            s.name + "_" +
            (channel.index == 0 ? std::to_string(c) : hex4(channel.index) + "_" + std::to_string(channel.subindex));
        const std::string meaning = (channel.name.empty() ? "value" : channel.name) + " of the " + s.device + ", " +
                                    std::to_string(channel.bits) + " bits, without sign unless it has 32";
        if (outputs) {
          v.input(name, values[c], meaning);
        } else {
          v.output(name, values[c], meaning);
        }
      }
    }
  }
}

void EtherCatLink::initialise(Time start, Measured& measured) {
  master_.reset();
  wire_.reset();
  ethercat::SetupOptions options;
  options.place = field_ ? "emulated bus" : "interface " + interface_;
  options.cycle = nanoseconds(cycle_);
  options.clocks = clocks_;
  options.wait = nanoseconds(wait_);
  options.sii_folder = sii_folder_;
  if (field_) {
    field_->initialise(0);
    wire_ = std::make_unique<ethercat::EmulatedWire>(field_->bus());
    field_->apply(0);
  } else {
    wire_ = std::make_unique<ethercat::RawWire>(interface_, kPlace);
    options.system_time = time_since_2000();
  }
  options.host_time = wire_->now();
  ethercat::Exchange exchange(*wire_);
  ethercat::BusSetup bus = ethercat::set_up_bus(exchange, expected_slaves(slaves_, sync0_, sync0_shift_), options);
  master_ = std::make_unique<ethercat::Master>(std::move(bus), options.cycle, nanoseconds(timeout_),
                                               ethercat::BusTime{0, options.system_time, options.host_time});
  zero_ = wire_->now() - start.ns;
  for (Device& d : devices_) {
    d.counts = d.counts_before = 0;
    d.known = false;
    d.restarts = 0;
  }
  measured.q = q_offset_;
  std::fill(measured.dq.begin(), measured.dq.end(), 0.0);
  std::fill(measured.ddq.begin(), measured.ddq.end(), 0.0);
  measured.fresh = false;
  failed_ = restarted_ = was_operational_ = false;
  write_statistics();
}

StepResult EtherCatLink::step(Time now, Duration h, const Command&, Measured& measured) {
  if (field_) {
    field_->exchange();
    auto& wire = static_cast<ethercat::EmulatedWire&>(*wire_);
    wire.advance_to(zero_ + now.ns);
    field_->apply(wire.now());
  }
  write_devices();
  master_->cycle(*wire_);
  if (field_) {
    static_cast<ethercat::EmulatedWire&>(*wire_).advance_to(zero_ + (now + h).ns);
    field_->apply(wire_->now());
    field_->exchange();
  }
  measured.fresh = master_->fresh();
  if (measured.fresh) read_devices();
  measure(h.seconds(), measured);
  const bool before = operational_;
  write_statistics();
  failed_ = failed_ || (before && !operational_);
  was_operational_ = was_operational_ || operational_;
  return {};
}

void EtherCatLink::write_devices() {
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const SlaveChoice& s = slaves_[i];
    Device& d = devices_[i];
    const std::span<std::uint8_t> out = master_->outputs(i);
    if (s.kind == Kind::kDigitalOutputs) {
      for (std::size_t c = 0; c < d.channels.size(); ++c) write_bits(out, c, 1, d.channels[c] ? 1 : 0);
    } else if (s.kind == Kind::kEncoder) {
      // The first four bits of the control byte are the same in both layouts; the value follows after one or two bytes.
      write_bits(out, 0, 1, d.latch_c ? 1 : 0);
      write_bits(out, 1, 1, d.latch_rising ? 1 : 0);
      write_bits(out, 2, 1, d.set ? 1 : 0);
      write_bits(out, 3, 1, d.latch_falling ? 1 : 0);
      write_bits(out, wide_ ? 16 : 8, wide_ ? 32 : 16, static_cast<std::uint32_t>(d.set_value));
    } else if (s.kind == Kind::kImage) {
      for (std::size_t c = 0; c < s.setup.outputs.size(); ++c) {
        const ethercat::Channel& channel = s.setup.outputs[c];
        const std::uint32_t value = d.output_bits ? (d.output_bits[c] ? 1u : 0u) : static_cast<std::uint32_t>(d.outputs[c]);
        write_bits(out, channel.bit, channel.bits, value);
      }
    }
  }
}

void EtherCatLink::read_devices() {
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const SlaveChoice& s = slaves_[i];
    Device& d = devices_[i];
    if (master_->status(i).down) continue;  // a slave on its way back: what it gives first may be of the time before
    const std::span<const std::uint8_t> in = master_->inputs(i);
    if (s.kind == Kind::kDigitalInputs) {
      for (std::size_t c = 0; c < d.channels.size(); ++c) d.channels[c] = read_bits(in, c, 1) != 0;
    } else if (s.kind == Kind::kEncoder) {
      read_counter(i, in);
    } else if (s.kind == Kind::kImage) {
      for (std::size_t c = 0; c < s.setup.inputs.size(); ++c) {
        const ethercat::Channel& channel = s.setup.inputs[c];
        const std::uint32_t value = read_bits(in, channel.bit, channel.bits);
        if (d.input_bits) {
          d.input_bits[c] = value != 0;
        } else {
          d.inputs[c] = static_cast<std::int32_t>(value);
        }
      }
    }
  }
}

void EtherCatLink::read_counter(std::size_t i, std::span<const std::uint8_t> in) {
  Device& d = devices_[i];
  const int restarts = master_->status(i).restarts;
  // A terminal that was switched off has forgotten its counter: the position continues from the last one.
  if (restarts != d.restarts && d.known) {
    d.known = false;
    restarted_ = true;
  }
  d.restarts = restarts;
  const std::size_t bits = wide_ ? 32 : 16;
  const std::uint32_t counter = read_bits(in, wide_ ? 16 : 8, bits);
  const bool done = read_bits(in, 2, 1) != 0;
  d.latched = read_bits(in, 0, 2) != 0;
  const std::uint32_t latch = read_bits(in, (wide_ ? 16 : 8) + bits, bits);
  d.latch = wide_ ? static_cast<std::int32_t>(latch) : static_cast<std::int16_t>(latch);
  if (!d.known) {
    d.known = true;
  } else if (done && !d.set_done) {
    // The counter jumped because it was set: count continues there.
    d.counts = d.set_value;
    d.counts_before = d.counts;
  } else {
    const std::uint32_t moved = counter - d.last;
    d.counts += wide_ ? static_cast<std::int32_t>(moved) : static_cast<std::int16_t>(moved);
  }
  d.last = counter;
  d.set_done = done;
  d.count = static_cast<std::int32_t>(static_cast<std::uint32_t>(d.counts));
}

void EtherCatLink::measure(double h, Measured& measured) {
  const double share = dq_cutoff_ > 0 ? -std::expm1(-2 * std::numbers::pi * dq_cutoff_ * h) : 1;
  for (std::size_t j = 0; j < encoders_.size(); ++j) {
    Device& d = devices_[encoders_[j]];
    measured.q[j] = q_scale_[j] * static_cast<double>(d.counts) + q_offset_[j];
    const double speed = h > 0 ? q_scale_[j] * static_cast<double>(d.counts - d.counts_before) / h : 0;
    d.counts_before = d.counts;
    const double before = measured.dq[j];
    measured.dq[j] += share * (speed - measured.dq[j]);
    measured.ddq[j] = h > 0 ? (measured.dq[j] - before) / h : 0;
  }
}

void EtherCatLink::write_statistics() {
  const ethercat::Master::Counters& c = master_->counters();
  const auto narrow = [](std::int64_t value) {
    return static_cast<std::int32_t>(std::min<std::int64_t>(value, std::numeric_limits<std::int32_t>::max()));
  };
  operational_ = master_->operational();
  answering_ = master_->present();
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const ethercat::Master::SlaveStatus& s = master_->status(i);
    state_[i] = s.present ? static_cast<std::int32_t>(s.state) : 0;
    al_code_[i] = static_cast<std::int32_t>(s.code);
  }
  cycles_ = narrow(c.cycles);
  lost_ = narrow(c.lost);
  late_ = narrow(c.late);
  foreign_ = narrow(c.foreign);
  unsent_ = narrow(c.unsent);
  working_counter_errors_ = narrow(c.working_counter);
  slaves_lost_ = narrow(c.slave_lost);
  slave_faults_ = narrow(c.slave_fault);
  wrong_slaves_ = narrow(c.wrong_slave);
  unexpected_slaves_ = narrow(c.unexpected);
  recovered_ = narrow(c.recovered);
  clock_difference_ = 1e-9 * static_cast<double>(master_->clock_difference());
}

void EtherCatLink::tell(std::vector<std::string>& sentences) const {
  if (failed_) sentences.emplace_back(kNotOperational);
  if (!was_operational_) {
    std::string states;
    for (std::size_t i = 0; i < slaves_.size(); ++i) {
      states += (states.empty() ? "" : ", ") + slaves_[i].device + " " + std::to_string(state_[i]);
      if (al_code_[i] != 0) states += " (AL status code 0x" + hex4(static_cast<unsigned>(al_code_[i])) + ")";
    }
    sentences.push_back("the bus was never operational, expected state 8 (OP) of all slaves: " + states);
  }
  if (restarted_) sentences.emplace_back(kRestarted);
}

}  // namespace cotwin::io
