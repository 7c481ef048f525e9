#include "components/io/links/ethercat_link.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <numbers>
#include <thread>
#include <utility>

#include "components/io/ethercat/master/raw_wire.h"
#include "components/unit/tick_source.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

using Kind = SlaveChoice::Kind;

const std::string kEtherCatPlace = "unit:io?link=ethercat";
constexpr std::int64_t kEpoch = 946'684'800'000'000'000;  // ns from 1970 to 2000, with which EtherCAT's time begins
constexpr const char* kNotOperational = "the bus was not operational at some time: its outputs were off and its inputs held";
constexpr const char* kRestarted =
    "an encoder terminal was switched off and on: its position continues from the last known one, movements meanwhile are "
    "unknown";
constexpr const char* kWrapped =
    "an encoder's counter of 16 bits was not read for longer than timeout: its position may be off by multiples of 65536 "
    "counts "
    "(encoder_bits=32 has room for hours)";
constexpr const char* kWithheld = "after a loss, a jump or a stop outputs are off or drives stand until acknowledge rises";
constexpr const char* kNotStopped =
    "not all slaves answered at the end of the run that they are in INIT: their outputs are off when their watchdogs expire";
constexpr std::int64_t kLongestQuickStop = 500'000'000;  // ns, of the drives at the end of a run
constexpr double kHalfACycle = -1;                       // value of sync0_shift

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
  bool answers_only() const override { return true; }

 private:
  EtherCatLink& link_;
  std::int64_t told_ = 0;
};

/// The ports of one slave.
struct EtherCatLink::Device {
  std::array<bool, 16> channels{};                  // EL1809, EL2809
  std::unique_ptr<bool[]> input_bits, output_bits;  // of slaves whose channels are bits
  std::vector<std::int32_t> inputs, outputs;        // other channels of the SII's PDOs
  std::optional<EtherCatEncoder> encoder;           // EL5101
  int restarts = 0;                                 // that the encoder has taken into account
  std::size_t numbers = 0;                          // in EtherCatLink::numbers_, of its inputs
};

EtherCatLink::EtherCatLink(Settings& settings, const std::vector<trajectory::Axis>& joints)
    : interface_(settings.text("interface")),
      clocks_(settings.boolean("clocks")),
      slaves_(read_slaves(settings, kEtherCatPlace)),
      devices_(slaves_.size()),
      joint_of_(joints_of(slaves_, joints.size(), kEtherCatPlace)),
      n_(joints.size()),
      axes_(joints),
      drives_(slaves_, joint_of_, joints, settings.robot_used().get(), kEtherCatPlace),
      q_scale_(n_, 1.0),
      q_offset_(n_),
      state_(slaves_.size()),
      al_code_(slaves_.size()) {
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const SlaveChoice& s = slaves_[i];
    if (s.kind == Kind::kDigitalInputs || s.kind == Kind::kImage) {
      const bool terminal = s.kind == Kind::kDigitalInputs, bits = terminal || s.is_digital(false);
      devices_[i].numbers = numbers_.add(bits ? BelievedNumbers::Kind::kState : BelievedNumbers::Kind::kNumber,
                                         terminal ? devices_[i].channels.size() : s.setup.inputs.size());
    }
    if (s.kind != Kind::kEncoder) continue;
    encoders_.push_back(i);
    devices_[i].encoder.emplace(settings.integer("encoder_bits") == 32);
  }
  read_start_up_file(settings, slaves_, kEtherCatPlace);
  if (interface_ == "emulated") field_.emplace(slaves_, n_);
}

EtherCatLink::~EtherCatLink() { end(); }

void EtherCatLink::end() noexcept {
  if (!master_ || std::exchange(ended_, true)) return;
  stop_drives();
  stopped_ = master_->stop(*wire_);
  if (!field_) return;
  field_->apply(wire_->now());
  field_->exchange();
}

/// A quick stop before the voltage goes, with which the axes would coast.
void EtherCatLink::stop_drives() noexcept {
  const std::int64_t end = wire_->now() + kLongestQuickStop;
  while (drives_.stop(*master_) && wire_->now() < end) {
    const std::int64_t due = wire_->now() + nanoseconds(cycle_);
    master_->cycle(*wire_);
    drives_.wait(cycle_, patience());
    if (master_->fresh()) drives_.read(*master_);
    if (field_) {
      static_cast<ethercat::EmulatedWire&>(*wire_).advance_to(due);
      field_->apply(due);
      continue;
    }
    master_->collect(*wire_, due);
    std::this_thread::sleep_until(std::chrono::steady_clock::time_point(std::chrono::nanoseconds(due)));
  }
  if (field_) field_->exchange();
}

TickSource* EtherCatLink::tick_source() {
  if (field_ || !clocks_) return nullptr;
  if (!source_) source_ = std::make_unique<Source>(*this);
  return source_.get();
}

void EtherCatLink::declare(Variables& v, JointVariables& joints) {
  for (std::size_t i = 0; i < slaves_.size(); ++i) declare_device(v, i);
  v.output("operational", operational_, "whether all slaves are in OP and the last two cycles were not silent");
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
  v.output("implausible", implausible_,
           "inputs of encoders and drives that no motion explains, which were not used; 5 in a row are a loss");
  v.output("clock_difference", clock_difference_, "s",
           "largest deviation from the reference clock that the slaves report; 0 without clocks")
      .discrete();
  v.parameter("cycle", cycle_, "s", "cycle of the bus, of SYNC0 and of the clock that the bus is for the run").range(1e-5, 1);
  v.parameter("timeout", timeout_, "s",
              "time without an answer after which the bus is lost; at most the 0.1 s after which slaves switch off")
      .range(0, 10);
  v.parameter("wait", wait_, "s", "time for which a silent bus is waited for at the start").range(0, 3600);
  v.parameter("sii_folder", sii_folder_,
              "folder to which the SII images of all slaves are written at the start, for devices that are described by them");
  v.parameter("sync0", sync0_, "whether the EL5101 and the drives work with SYNC0 of the distributed clocks");
  v.parameter(
       "sync0_shift", sync0_shift_, "s",
       "of SYNC0 against the multiples of the cycle, at which ticks begin that follow the bus; -1: half of the cycle, so that "
       "the terminals act when the frames of the cycle have passed")
      .range(-1, 1);
  v.parameter("dq_cutoff", dq_cutoff_, "Hz", "cut-off frequency of the low-pass of dq; 0: none").range(0, 1e6);
  joints.parameter("q_scale", q_scale_, "rad", "joint position per count of the encoder or drive");
  joints.parameter("q_offset", q_offset_, "rad", "joint position at the start of the run; of a drive: where its position is 0");
  if (field_) field_->declare(v, joints);
  for (const std::size_t i : encoders_) {
    v.output(
        slaves_[i].name + "_uncertain", devices_[i].encoder->uncertain,
        "whether movements may have been missed since the start or the last setting: the terminal was off, or a counter of "
        "16 bits was not read for longer than timeout");
  }
  v.output("clock_steps", clock_steps_,
           "times at which the reference clock went on elsewhere without a restart (the host was suspended), and was followed");
  acknowledgement_.declare(v, "outputs are off", "the bus is operational");
  drives_.declare(v, joints);
}

void EtherCatLink::declare_device(Variables& v, std::size_t i) {
  const SlaveChoice& s = slaves_[i];
  Device& d = devices_[i];
  if (s.kind == Kind::kDigitalInputs) {
    v.output(s.name, d.channels, "channels of the " + s.device);
  } else if (s.kind == Kind::kDigitalOutputs) {
    v.input(s.name, d.channels, "channels of the " + s.device + "; off while the bus is not operational");
  } else if (s.kind == Kind::kEncoder) {
    EtherCatEncoder& e = *d.encoder;
    v.output(s.name + "_count", e.count, "counts of the " + s.device + " since the start (4 per line), modulo 2^32");
    v.output(s.name + "_latch", e.latch, "counter of the terminal at the last latch");
    v.output(s.name + "_latched", e.latched, "whether a latch was taken since it was enabled");
    v.output(s.name + "_set_done", e.set_done, "whether the counter was set since the last rising edge of " + s.name + "_set");
    v.input(s.name + "_set", e.set, "a rising edge sets the counter of the terminal, and count, to " + s.name + "_set_value");
    v.input(s.name + "_set_value", e.set_value, "the counter after setting");
    v.input(s.name + "_latch_C", e.latch_c, "enables the latch by the encoder's zero pulse");
    v.input(s.name + "_latch_rising", e.latch_rising, "enables the latch by a rising edge of the external input");
    v.input(s.name + "_latch_falling", e.latch_falling, "enables the latch by a falling edge of the external input");
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
          throw Error(kEtherCatPlace,
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
  end();
  acknowledgement_.begin(kEtherCatPlace);
  measured.warning.reserve(1024);
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
    wire_ = std::make_unique<ethercat::RawWire>(interface_, kEtherCatPlace);
    options.system_time = time_since_2000();
  }
  options.host_time = wire_->now();
  ethercat::Exchange exchange(*wire_);
  const double shift = sync0_shift_ == kHalfACycle ? cycle_ / 2 : sync0_shift_;
  numbers_.forget();
  drives_.initialise(cycle_, q_scale_, q_offset_, acknowledgement_);
  std::vector<ethercat::ExpectedSlave> expected = expected_slaves(slaves_, sync0_, shift);
  drives_.add_start_up(expected);
  ethercat::BusSetup bus = ethercat::set_up_bus(exchange, expected, options);
  master_ = std::make_unique<ethercat::Master>(std::move(bus), options.cycle,
                                               std::min(nanoseconds(timeout_), ethercat::kOutputWatchdog),
                                               ethercat::BusTime{0, options.system_time, options.host_time});
  zero_ = wire_->now() - start.ns;
  for (std::size_t i = 0; i < devices_.size(); ++i) {
    Device& d = devices_[i];
    const std::size_t j = joint_of_[i];
    if (d.encoder) d.encoder->reset(std::min(EtherCatEncoder::kFastest, largest_speed(axes_[j]) / std::abs(q_scale_[j])));
    d.restarts = 0;
  }
  measured.q = q_offset_;
  std::fill(measured.dq.begin(), measured.dq.end(), 0.0);
  std::fill(measured.ddq.begin(), measured.ddq.end(), 0.0);
  measured.fresh = false;
  last_h_ = Duration{nanoseconds(cycle_)};
  failed_ = was_operational_ = ended_ = stepped_ = bus_lost_ = in_op_ = false;
  jumps_ = 0;
  stopped_ = true;
  write_statistics();
}

/// A clock at another cycle than that of the steps would give SYNC0 and the ticks different rates. Later steps may be longer, where
/// ticks are left out.
void EtherCatLink::check_cycle(Duration h) {
  if (std::exchange(stepped_, true) || h.ns == nanoseconds(cycle_)) return;
  const auto milliseconds = [](double ns) { return text::to_text(1e-6 * ns, 6) + " ms"; };
  throw Error(kEtherCatPlace, "cycle is " + milliseconds(1e9 * cycle_) + ", but a step lasts " +
                                  milliseconds(static_cast<double>(h.ns)) +
                                  ", expected the same (parameter cycle, or the tick of the scenario)");
}

/// A step that covers ticks that were left out is made at the last one of them: its frame is sent one cycle before its end.
StepResult EtherCatLink::step(Time now, Duration h, const Command& command, Measured& measured) {
  check_cycle(h);
  if (field_) {
    field_->exchange();
    auto& wire = static_cast<ethercat::EmulatedWire&>(*wire_);
    wire.advance_to(zero_ + std::max(now.ns, (now + h).ns - nanoseconds(cycle_)));
    field_->apply(wire.now());
  }
  acknowledgement_.decide(operational_, !is_held() && drives_.agrees(), h.seconds());
  bus_lost_ = bus_lost_ && acknowledgement_.awaits();
  master_->hold_outputs(bus_lost_);
  write_devices();
  master_->collect(*wire_, 0);
  drives_.write(*master_, wire_->now(), command, h.seconds(), acknowledgement_);
  master_->cycle(*wire_);
  if (field_) {
    static_cast<ethercat::EmulatedWire&>(*wire_).advance_to(zero_ + (now + h).ns);
    field_->apply(wire_->now());
    field_->exchange();
  }
  measured.fresh = master_->fresh();
  // The answers are those to the frame of the step before, whose time ended one cycle before that of this step.
  const double between = std::exchange(last_h_, h).seconds();
  for (const std::size_t i : encoders_) devices_[i].encoder->advance(between);
  drives_.wait(between, patience());
  if (measured.fresh) {
    measured.fresh = drives_.read(*master_);
    // While nothing is commanded a stop gets through.
    if (measured.fresh || drives_.is_blind()) read_devices();
  }
  measure(measured);
  drives_.measure(measured, dq_cutoff_, patience());
  write_statistics();
  const bool before = std::exchange(in_op_, master_->operational());
  failed_ = failed_ || (before && !in_op_);
  const int jumps_before = std::exchange(jumps_, encoder_jumps());
  if ((before && !in_op_) || jumps_ > jumps_before) {
    bus_lost_ = true;
    acknowledgement_.demand();
  }
  was_operational_ = was_operational_ || operational_;
  if (acknowledgement_.awaits()) measured.warn(kWithheld);
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
      d.encoder->write(out, master_->operational() && !bus_lost_);
    } else if (s.kind == Kind::kImage) {
      for (std::size_t c = 0; c < s.setup.outputs.size(); ++c) {
        const ethercat::Channel& channel = s.setup.outputs[c];
        const std::uint32_t value = d.output_bits ? (d.output_bits[c] ? 1u : 0u) : static_cast<std::uint32_t>(d.outputs[c]);
        write_bits(out, channel.bit, channel.bits, value);
      }
    }
  }
}

/// Whether the last inputs have a position that was not used.
bool EtherCatLink::is_held() const {
  return drives_.is_held() ||
         std::ranges::any_of(encoders_, [&](std::size_t i) { return devices_[i].encoder->is_held(patience()); });
}

void EtherCatLink::read_devices() {
  // A slave on its way back: what it gives first may be of the time before.
  for (const std::size_t i : encoders_) {
    const int restarts = master_->status(i).restarts;
    if (master_->status(i).down) continue;
    devices_[i].encoder->read(master_->inputs(i), restarts != std::exchange(devices_[i].restarts, restarts), timeout_);
  }
  if (is_held() && !drives_.is_blind()) return;
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const SlaveChoice& s = slaves_[i];
    Device& d = devices_[i];
    if (master_->status(i).down) continue;
    const std::span<const std::uint8_t> in = master_->inputs(i);
    if (s.kind == Kind::kDigitalInputs) {
      for (std::size_t c = 0; c < d.channels.size(); ++c) d.channels[c] = numbers_.put(d.numbers + c, read_bits(in, c, 1)) != 0;
    } else if (s.kind == Kind::kImage) {
      for (std::size_t c = 0; c < s.setup.inputs.size(); ++c) {
        const ethercat::Channel& channel = s.setup.inputs[c];
        const auto value = static_cast<std::int32_t>(read_bits(in, channel.bit, channel.bits));
        const double used = numbers_.put(d.numbers + c, value);
        if (d.input_bits) d.input_bits[c] = used != 0;
        if (!d.input_bits) d.inputs[c] = static_cast<std::int32_t>(used);
      }
    }
  }
}

/// q̇ is the low-pass of the mean speed since the last data. Without data it is held for `timeout`, and is 0 afterwards.
void EtherCatLink::measure(Measured& measured) {
  for (const std::size_t i : encoders_) {
    EtherCatEncoder& e = *devices_[i].encoder;
    const std::size_t j = joint_of_[i];
    measured.q[j] = q_scale_[j] * static_cast<double>(e.counts()) + q_offset_[j];
    measured.ddq[j] = 0;
    const std::optional<EtherCatEncoder::Speed> speed = e.pop_speed();
    if (e.unread() > patience() || (speed && speed->duration > patience())) {
      measured.dq[j] = 0;
    } else if (speed) {
      const double share = dq_cutoff_ > 0 ? -std::expm1(-2 * std::numbers::pi * dq_cutoff_ * speed->duration) : 1;
      const double change = share * (q_scale_[j] * speed->value - measured.dq[j]);
      measured.dq[j] += change;
      measured.ddq[j] = change / speed->duration;
    }
  }
}

int EtherCatLink::encoder_jumps() const {
  int jumps = 0;
  for (const std::size_t i : encoders_) jumps += devices_[i].encoder->jumps();
  return jumps;
}

void EtherCatLink::write_statistics() {
  const ethercat::Master::Counters& c = master_->counters();
  const auto narrow = [](std::int64_t value) {
    return static_cast<std::int32_t>(std::min<std::int64_t>(value, std::numeric_limits<std::int32_t>::max()));
  };
  operational_ = master_->operational() && master_->present() > 0;
  answering_ = master_->present();
  for (std::size_t i = 0; i < slaves_.size(); ++i) {
    const ethercat::Master::SlaveStatus& s = master_->status(i);
    state_[i] = master_->present(i) ? static_cast<std::int32_t>(s.state) : 0;
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
  clock_steps_ = narrow(c.clock_steps);
  implausible_ = drives_.implausible();
  for (const std::size_t i : encoders_) implausible_ += devices_[i].encoder->implausible();
  clock_difference_ = 1e-9 * static_cast<double>(master_->clock_difference());
}

void EtherCatLink::append_notes(std::vector<std::string>& sentences) const {
  if (failed_) sentences.emplace_back(kNotOperational);
  if (!was_operational_) {
    std::string states;
    for (std::size_t i = 0; i < slaves_.size(); ++i) {
      text::append(states, slaves_[i].device + " " + std::to_string(state_[i]));
      if (al_code_[i] != 0) states += " (AL status code 0x" + hex4(static_cast<unsigned>(al_code_[i])) + ")";
    }
    sentences.push_back("the bus was never operational, expected state 8 (OP) of all slaves: " + states);
  }
  const auto any = [&](bool (EtherCatEncoder::*what)() const) {
    return std::any_of(encoders_.begin(), encoders_.end(), [&](std::size_t i) { return (*devices_[i].encoder.*what)(); });
  };
  if (any(&EtherCatEncoder::was_restarted)) sentences.emplace_back(kRestarted);
  if (any(&EtherCatEncoder::may_have_wrapped)) sentences.emplace_back(kWrapped);
  if (implausible_ > drives_.implausible()) {
    sentences.push_back(text::counted(implausible_ - drives_.implausible(), "counter") +
                        " of encoder terminals not used, which no motion explains (damaged, or beyond twice the limit of speed "
                        "that the URDF gives the joint)");
  }
  if (jumps_ > 0) {
    sentences.push_back("encoder terminals gave such counters " + text::counted(jumps_, "time") +
                        " in a row: positions stayed and are uncertain since then");
  }
  drives_.append_notes(sentences);
  if (!stopped_) sentences.emplace_back(kNotStopped);
}

}  // namespace cotwin::io
