#include "components/io/links/ethercat_drives.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include "components/io/link/finite.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

namespace object = cia402::object;
using cia402::State;
using cia402::Wish;

constexpr double kNoLimit = 1e9;     // rad, N.m
constexpr double kReset = 0.5;       // s that a drive has to leave its fault after acknowledge has risen
constexpr double kMostGain = 0.2;    // of K_v · cycle: three cycles of delay leave a phase margin of more than 45 degrees
constexpr double kLeastStep = 1e-4;  // s

constexpr const char* kFell = "left Operation enabled by itself";
constexpr const char* kHolds = "did not follow its target any more, or left its mode";
constexpr const char* kNotHomed = "did not find its home";
constexpr const char* kFaulty = "has a fault";
constexpr const char* kJumped = "gave a position that no motion explains";

std::int32_t signed_value(std::uint32_t value, std::size_t bits) {
  if (bits >= 32) return static_cast<std::int32_t>(value);
  const std::uint32_t sign = 1u << (bits - 1);
  return static_cast<std::int32_t>((value ^ sign) - sign);
}

/// Rounded, and within what `bits` bits hold.
std::int32_t rounded(double value, std::size_t bits) {
  const double most = std::ldexp(1.0, static_cast<int>(bits) - 1) - 1;
  return static_cast<std::int32_t>(std::llround(std::clamp(value, -most, most)));
}

}  // namespace

EtherCatDrives::Place EtherCatDrives::find(const std::vector<ethercat::Channel>& channels, std::uint16_t object) {
  const auto found =
      std::ranges::find_if(channels, [&](const ethercat::Channel& c) { return c.index == object && c.subindex == 0; });
  return found == channels.end() ? Place{} : Place{found->bit, found->bits};
}

EtherCatDrives::EtherCatDrives(const std::vector<SlaveChoice>& slaves, const std::vector<std::size_t>& joint_of,
                               const std::vector<trajectory::Axis>& joints, const std::string& place)
    : place_(place), synchronisation_(0), jumps_(0) {
  for (std::size_t i = 0; i < slaves.size(); ++i) {
    const SlaveChoice& s = slaves[i];
    if (s.kind != SlaveChoice::Kind::kDrive) continue;
    Drive d;
    d.slave = i;
    d.joint = joint_of[i];
    d.name = s.name;
    const auto &out = s.setup.outputs, &in = s.setup.inputs;
    d.control = find(out, object::kControlWord);
    d.mode = find(out, object::kMode);
    d.target_position = find(out, object::kTargetPosition);
    d.target_velocity = find(out, object::kTargetVelocity);
    d.target_torque = find(out, object::kTargetTorque);
    d.status = find(in, object::kStatusWord);
    d.mode_display = find(in, object::kModeDisplay);
    d.position = find(in, object::kPosition);
    d.velocity = find(in, object::kVelocity);
    d.torque = find(in, object::kTorque);
    d.error = find(in, object::kErrorCode);
    const char* const lacks = d.control.bits != 16    ? "0x6040 (control word, 16 bits) in its outputs"
                              : d.status.bits != 16   ? "0x6041 (status word, 16 bits) in its inputs"
                              : d.position.bits != 32 ? "0x6064 (position, 32 bits) in its inputs"
                                                      : nullptr;
    if (lacks != nullptr) {
      throw Error(place_ + ": slave " + s.name,
                  "the process data of the " + s.device + " have no object " + lacks + ", expected a drive with it");
    }
    const trajectory::Axis& axis = joints[d.joint];
    dq_command_max_.push_back(std::min(kSafeSpeed, finite(axis.dq_max, kSafeSpeed)));
    q_command_min_.push_back(finite(axis.q_min, -kNoLimit));
    q_command_max_.push_back(finite(axis.q_max, kNoLimit));
    drives_.push_back(std::move(d));
  }
  const std::size_t n = drives_.size();
  synchronisation_ = Synchronisation(n);
  jumps_ = JumpDetector(n);
  for (std::vector<double>* values : {&q_, &q_wanted_, &q_target_, &tau_target_, &no_gain_, &dq_scale_, &tau_scale_})
    values->resize(n);
  tau_command_max_.resize(n, kNoLimit);
  home_ = std::make_unique<bool[]>(n);
  homed_ = std::make_unique<bool[]>(n);
  home_before_.resize(n);
  for (std::vector<std::int32_t>* values : {&state_, &error_, &warning_}) values->resize(n);
}

Link::Needs EtherCatDrives::needs() const {
  return {mode_text_ == "position" || mode_text_ == "velocity", mode_text_ == "torque"};
}

void EtherCatDrives::declare(Variables& v, JointVariables& joints) {
  if (empty()) return;
  v.parameter("drive_mode", mode_text_,
              "what the drives (CiA 402) do: monitor (they stay off), position (csp), velocity (csv) or torque (cst)");
  v.input("enable", enable_, "the drives are enabled with drive_mode other than monitor; false: they are shut down");
  v.input("quick_stop", quick_stop_, "stops all drives at once; they are enabled again when it is false and acknowledge rises");
  v.input(
      "home", std::span<bool>(home_.get(), drives_.size()),
      "of each drive: a rising edge while all drives are enabled and stand makes it find its home (objects 0x6098, 0x6099)");
  v.output("homed", std::span<bool>(homed_.get(), drives_.size()), "of each drive: it has found its home since the start");
  v.output("drives_enabled", enabled_, "whether all drives are enabled and follow the commands");
  v.output("drive_state", state_,
           "state of each drive: 0 not ready, 1 switch on disabled, 2 ready to switch on, 3 switched on, 4 operation enabled, "
           "5 quick stop, 6 fault reaction, 7 fault");
  v.output("drive_error", error_, "error code of each drive (object 0x603F); 0: none, or not in its process data");
  v.output("drive_limits", warning_, "of each drive: 1 a limit within the drive acts, 2 it warns, 3 both");
  joints
      .parameter("dq_command_max", dq_command_max_, "rad/s",
                 "of each drive: speed limit of commands, at first the URDF's, but at most 0.5 rad/s")
      .range(1e-6, 1e9);
  joints.parameter("q_command_min", q_command_min_, "rad", "of each drive: lower limit of commanded positions, from the URDF")
      .range(-kNoLimit, kNoLimit);
  joints.parameter("q_command_max", q_command_max_, "rad", "of each drive: upper limit of commanded positions, from the URDF")
      .range(-kNoLimit, kNoLimit);
  joints.parameter("tau_command_max", tau_command_max_, "N.m", "of each drive: limit of commanded torques").range(0, kNoLimit);
  joints
      .parameter("dq_scale", dq_scale_, "rad/s",
                 "of each drive: joint speed per unit of its velocity; 0: q_scale, for counts/s")
      .range(-kNoLimit, kNoLimit);
  joints
      .parameter("tau_scale", tau_scale_, "N.m",
                 "of each drive: joint torque per unit of its torque, 1/1000 of the rated torque; 0: not known")
      .range(-kNoLimit, kNoLimit);
  v.parameter("ddq_command_max", ddq_command_max_, "rad/s2", "limit of the acceleration of commands").range(1e-3, 1e9);
  v.parameter("K_v", K_v_, "1/s", "drive_mode=velocity: gain of the position").range(0, 1e4);
}

cia402::Mode EtherCatDrives::profile_mode() const {
  switch (mode_) {
    case Mode::kPosition:
      return cia402::Mode::kPosition;
    case Mode::kVelocity:
      return cia402::Mode::kVelocity;
    case Mode::kTorque:
      return cia402::Mode::kTorque;
    case Mode::kMonitor:
      break;
  }
  return cia402::Mode::kNone;
}

/// The object that the mode needs and the outputs of the drive lack; nullptr: none.
const char* EtherCatDrives::missing(const Drive& d) const {
  if (mode_ == Mode::kPosition && d.target_position.bits != 32) return "0x607A (target position, 32 bits)";
  if (mode_ == Mode::kVelocity && d.target_velocity.bits != 32) return "0x60FF (target velocity, 32 bits)";
  if (mode_ == Mode::kTorque && d.target_torque.bits != 16) return "0x6071 (target torque, 16 bits)";
  return nullptr;
}

void EtherCatDrives::initialise(double cycle, std::span<const double> q_scale, std::span<const double> q_offset,
                                const Acknowledgement& acknowledgement) {
  mode_ = text::choose<Mode>(
      place_ + ": drive_mode", mode_text_,
      {{"monitor", Mode::kMonitor}, {"position", Mode::kPosition}, {"velocity", Mode::kVelocity}, {"torque", Mode::kTorque}});
  if (drives() && acknowledgement.is_automatic()) {
    throw Error(place_ + ": restart", "automatic with drive_mode=" + mode_text_ +
                                          ", expected acknowledged: after a loss or a fault no drive may move by itself");
  }
  if (mode_ == Mode::kVelocity && K_v_ * cycle > kMostGain) {
    throw Error(place_ + ": K_v", text::to_text(K_v_) + " with a cycle of " + text::to_text(cycle) + " s, expected at most " +
                                      text::to_text(kMostGain / cycle, 4) + ": the loop over the bus would swing");
  }
  q_scale_ = q_scale;
  q_offset_ = q_offset;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    const std::string place = place_ + ": slave " + d.name;
    if (q_scale_[d.joint] == 0) throw Error(place, "q_scale of its joint is 0, expected the joint position per count");
    if (const char* const lacks = missing(d); lacks != nullptr) {
      throw Error(place, "its outputs have no object " + std::string(lacks) + ", which drive_mode=" + mode_text_ + " needs");
    }
    if (mode_ == Mode::kTorque && tau_scale_[k] == 0) {
      throw Error(place, "tau_scale is 0, expected the joint torque per unit of its torque for drive_mode=torque");
    }
    d.axis.forget();
    d.homing = {};
    home_before_[k] = true;  // an input that is on at the start has not risen
    homed_[k] = false;
    d.status_word = 0;
    d.known = false;
    d.error_code = d.mode_shown = 0;
    d.speed = d.torque_units = 0;
  }
  awaited_ = follows_ = jumped_ = fresh_ = false;
  since_acknowledged_ = kReset;
  silent_ = elapsed_ = 0;
  stops_ = 0;
  stopped_by_ = "";
  jumps_.forget();
  write_outputs();
}

void EtherCatDrives::add_start_up(std::vector<ethercat::ExpectedSlave>& expected) const {
  if (!drives()) return;
  for (const Drive& d : drives_) {
    std::vector<ethercat::StartUpValue>& values = expected[d.slave].start_up;
    const bool given = std::ranges::any_of(values, [](const auto& value) { return value.index == object::kMode; });
    if (d.mode.bits != 0 || given) continue;
    values.push_back({object::kMode, 0, {static_cast<std::uint8_t>(profile_mode())}, false, "drive_mode=" + mode_text_});
  }
}

Wish EtherCatDrives::wish(bool awaits) const {
  if (!drives() || !enable_) return Wish::kOff;
  return awaits || quick_stop_ ? Wish::kStop : Wish::kOn;
}

/// Whether something has happened after which drives must not move before somebody acknowledges it.
bool EtherCatDrives::has_stopped() {
  const auto stops = [&](const Drive& d, const char* reason) {
    stopped_by_ = reason;
    stopped_drive_ = &d;
    return true;
  };
  if (std::exchange(jumped_, false)) return stops(drives_.front(), kJumped);
  for (const Drive& d : drives_) {
    if (d.axis.fell()) return stops(d, kFell);
    if (d.homing.has_failed()) return stops(d, kNotHomed);
    // It would jump to its target when it follows again.
    if (follows_ && !takes_targets(d)) return stops(d, kHolds);
    const bool faulty = d.axis.state() == State::kFault || d.axis.state() == State::kFaultReaction;
    if (faulty && since_acknowledged_ >= kReset) return stops(d, kFaulty);
  }
  return false;
}

/// Whether an enabled drive is in the mode and follows its target.
bool EtherCatDrives::takes_targets(const Drive& d) const {
  const bool in_mode = d.mode_display.bits == 0 || d.mode_shown == static_cast<std::int32_t>(profile_mode());
  return d.known && in_mode && (d.status_word & cia402::status::kFollows) != 0;
}

bool EtherCatDrives::all_enabled() const {
  return std::ranges::all_of(drives_,
                             [&](const Drive& d) { return d.axis.state() == State::kOperationEnabled && takes_targets(d); });
}

void EtherCatDrives::write(ethercat::Master& master, const Command& command, double h, Acknowledgement& acknowledgement) {
  if (empty()) return;
  const bool operational = master.operational();
  for (Drive& d : drives_) operational ? d.axis.see(d.status_word) : d.axis.forget();
  since_acknowledged_ = std::min(since_acknowledged_ + h, kReset);
  if (awaited_ && !acknowledgement.awaits()) {
    since_acknowledged_ = 0;
    for (Drive& d : drives_) d.axis.reset_fault();
  }
  if (quick_stop_ && drives()) acknowledgement.demand();
  if (wish(acknowledgement.awaits()) == Wish::kOn && has_stopped()) {
    ++stops_;
    acknowledgement.demand();
  }
  awaited_ = acknowledgement.awaits();
  const Wish wanted = wish(awaited_);
  advance_homing(wanted == Wish::kOn && operational, h);
  for (Drive& d : drives_) {
    d.control_word = operational ? static_cast<std::uint16_t>(d.axis.control(wanted) | d.homing.control_bits()) : 0;
  }
  choose_targets(command, h, wanted == Wish::kOn && !homes() && all_enabled());
  for (std::size_t k = 0; k < drives_.size(); ++k) write_targets(master.outputs(drives_[k].slave), k);
  write_outputs();
}

bool EtherCatDrives::homes() const {
  return std::ranges::any_of(drives_, [](const Drive& d) { return d.homing.is_active(); });
}

void EtherCatDrives::advance_homing(bool may_home, double h) {
  constexpr double kStands = 1e-6;  // rad/s
  const bool stand =
      follows_ && std::ranges::all_of(synchronisation_.speed(), [](double dq) { return std::abs(dq) < kStands; });
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    const bool before = home_before_[k];
    home_before_[k] = home_[k];
    if (!may_home || d.axis.state() != State::kOperationEnabled) {
      d.homing = {};
      continue;
    }
    if (home_[k] && !before && stand && d.mode.bits != 0 && d.mode_display.bits != 0) {
      homed_[k] = false;
      d.homing.start();
    }
    if (!d.homing.is_active()) continue;
    d.homing.advance(static_cast<cia402::Mode>(d.mode_shown), d.status_word, profile_mode(), h);
    homed_[k] = d.homing.is_done();
    jumps_.forget();
  }
}

/// Targets begin where the drives are, and stay there until all of them are enabled.
void EtherCatDrives::choose_targets(const Command& command, double h, bool follows) {
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    if (d.axis.state() != State::kOperationEnabled || d.homing.is_active()) d.held = d.counts;
    q_target_[k] = q_scale_[d.joint] * static_cast<double>(d.held) + q_offset_[d.joint];
    const double wanted = command.q[d.joint];
    q_wanted_[k] =
        std::isfinite(wanted) ? std::clamp(wanted, q_command_min_[k], std::max(q_command_min_[k], q_command_max_[k])) : wanted;
  }
  if (!follows || !follows_) synchronisation_.start(q_target_);
  follows_ = follows;
  if (!follows) return;
  synchronisation_.command(q_wanted_, {no_gain_, no_gain_, dq_command_max_, ddq_command_max_}, std::max(h, kLeastStep));
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    q_target_[k] = synchronisation_.last()[k];
    const double tau = command.tau[d.joint];
    if (std::isfinite(tau)) tau_target_[k] = std::clamp(tau, -tau_command_max_[k], tau_command_max_[k]);
    const double counts = (q_target_[k] - q_offset_[d.joint]) / q_scale_[d.joint];
    if (mode_ == Mode::kPosition && std::abs(counts) < 9e18) d.held = std::llround(counts);
    if (mode_ != Mode::kPosition) d.held = d.counts;
  }
}

void EtherCatDrives::write_targets(std::span<std::uint8_t> out, std::size_t k) {
  const Drive& d = drives_[k];
  const auto write = [&](const Place& place, std::int64_t value) {
    if (place.bits != 0) write_bits(out, place.bit, place.bits, static_cast<std::uint32_t>(value));
  };
  double speed = 0, torque = 0;
  if (follows_ && mode_ == Mode::kVelocity) {
    const double q = q_scale_[d.joint] * static_cast<double>(d.counts) + q_offset_[d.joint];
    const double dq = synchronisation_.speed()[k] + K_v_ * (q_target_[k] - q);
    speed = std::clamp(dq, -dq_command_max_[k], dq_command_max_[k]) / dq_scale_of(k);
  }
  if (follows_ && mode_ == Mode::kTorque) torque = synchronisation_.share() * tau_target_[k] / tau_scale_[k];
  write(d.control, d.control_word);
  write(d.mode, static_cast<std::int64_t>(d.homing.mode(profile_mode())));
  write(d.target_position, d.held);
  write(d.target_velocity, rounded(speed, 32));
  write(d.target_torque, rounded(torque, 16));
}

double EtherCatDrives::dq_scale_of(std::size_t k) const {
  return dq_scale_[k] != 0 ? dq_scale_[k] : q_scale_[drives_[k].joint];
}

void EtherCatDrives::wait(double h, double patience) {
  silent_ += h;
  elapsed_ += h;
  if (silent_ <= patience) return;
  jumps_.forget();
  for (Drive& d : drives_) d.axis.forget();
}

void EtherCatDrives::read(const ethercat::Master& master) {
  if (empty()) return;
  // A slave on its way back: what it gives first may be of the time before.
  if (std::ranges::any_of(drives_, [&](const Drive& d) { return master.status(d.slave).down; })) return;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    const std::span<const std::uint8_t> in = master.inputs(d.slave);
    const auto value = [&](const Place& place) {
      return place.bits == 0 ? 0 : signed_value(read_bits(in, place.bit, place.bits), place.bits);
    };
    d.status_word = static_cast<std::uint16_t>(value(d.status));
    d.mode_shown = value(d.mode_display);
    d.error_code = value(d.error) & 0xffff;
    d.torque_units = value(d.torque);
    const std::int32_t raw = value(d.position);
    const std::int32_t way = static_cast<std::int32_t>(static_cast<std::uint32_t>(raw) - static_cast<std::uint32_t>(d.raw));
    d.speed = d.velocity.bits != 0      ? dq_scale_of(k) * value(d.velocity)
              : d.known && elapsed_ > 0 ? q_scale_[d.joint] * way / elapsed_
                                        : 0;
    d.counts = d.known ? d.counts + way : raw;
    d.raw = raw;
    d.known = true;
    q_[k] = q_scale_[d.joint] * static_cast<double>(d.counts) + q_offset_[d.joint];
  }
  jumped_ = jumps_.add(q_, elapsed_) || jumped_;
  last_elapsed_ = elapsed_;
  silent_ = elapsed_ = 0;
  fresh_ = true;
}

/// q̇ is the low-pass of the drives' speeds. Without data it is held for `patience`, and is 0 afterwards.
void EtherCatDrives::measure(Measured& measured, double dq_cutoff, double patience) {
  if (empty()) return;
  const bool fresh = std::exchange(fresh_, false);
  measured.has_tau = std::ranges::none_of(tau_scale_, [](double scale) { return scale == 0; });
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const Drive& d = drives_[k];
    const std::size_t j = d.joint;
    if (d.known) measured.q[j] = q_[k];
    measured.tau[j] = tau_scale_[k] * d.torque_units;
    if (silent_ > patience) {
      measured.dq[j] = measured.ddq[j] = 0;
    } else if (fresh && last_elapsed_ > 0) {
      const double share = dq_cutoff > 0 ? -std::expm1(-2 * std::numbers::pi * dq_cutoff * last_elapsed_) : 1;
      const double change = share * (d.speed - measured.dq[j]);
      measured.dq[j] += change;
      measured.ddq[j] = change / last_elapsed_;
    }
  }
}

bool EtherCatDrives::stop(ethercat::Master& master) {
  bool moves = false;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    master.operational() ? d.axis.see(d.status_word) : d.axis.forget();
    d.control_word = d.axis.control(Wish::kStop);
    follows_ = false;
    d.held = d.counts;
    write_targets(master.outputs(d.slave), k);
    moves = moves || d.axis.state() == State::kOperationEnabled || d.axis.state() == State::kQuickStop;
  }
  return moves;
}

void EtherCatDrives::write_outputs() {
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const Drive& d = drives_[k];
    state_[k] = static_cast<std::int32_t>(d.axis.state());
    error_[k] = d.error_code;
    const bool known = d.axis.state() != State::kNotReady;
    warning_[k] = known ? ((d.status_word & cia402::status::kLimit) != 0 ? 1 : 0) +
                              ((d.status_word & cia402::status::kWarning) != 0 ? 2 : 0)
                        : 0;
  }
  enabled_ = follows_;
}

void EtherCatDrives::tell(std::vector<std::string>& sentences) const {
  if (stops_ == 0) return;
  sentences.push_back("the drives were stopped " + std::to_string(stops_) + " times, last because drive " +
                      stopped_drive_->name + " " + stopped_by_);
}

}  // namespace cotwin::io
