#include "components/io/links/ethercat_drives.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <numbers>
#include <tuple>
#include <utility>

#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

namespace object = cia402::object;
using cia402::State;
using cia402::Wish;

constexpr double kLeastStep = 1e-6;     // s
constexpr double kStood = 0.1;          // s within kStandsWithin after which an axis rests
constexpr double kStandsWithin = 1e-3;  // rad
constexpr double kOvershoot = 0.01;     // rad further out of the range than where it was when it began to follow
constexpr double kMoves = 0.01;         // rad/s
constexpr int kInARow = BelievedNumbers::kInARow;

constexpr const char* kFell = "left Operation enabled by itself";
constexpr const char* kHolds = "did not follow its target any more, or left its mode";
constexpr const char* kNotHomed = "did not find its home";
constexpr const char* kFaulty = "has a fault";
constexpr const char* kNotEnabled = "was not enabled within enable_timeout (safe torque off, no mains voltage?)";
constexpr const char* kBehind = "was further from its target than following_error_max";
constexpr const char* kOutside = "stands outside of q_command_min to q_command_max";
constexpr const char* kSpeedDisagrees =
    "had a position that did not move as its speed says (one of them is damaged, or dq_scale is wrong)";
constexpr const char* kNotCompared =
    "had not given 50 positions, or those of 0.5 s, within enable_timeout, to compare with its speed";
constexpr const char* kSilent = "did not answer in time";
constexpr const char* kBusLost = "the bus was not operational";
constexpr const char* kJumped = "gave positions or speeds that no motion explains";

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

Wish EtherCatDrives::wish(bool awaits) const {
  if (!drives()) return Wish::kOff;
  if (awaits || quick_stop_) return Wish::kStop;
  return enable_ && (were_enabled_ || agrees()) ? Wish::kOn : Wish::kOff;
}

/// Whether something has happened after which drives must not move before somebody acknowledges it.
bool EtherCatDrives::has_stopped(bool operational) {
  const auto stops = [&](const Drive& d, const char* reason) {
    stopped_by_ = reason;
    stopped_drive_ = &d;
    return true;
  };
  const bool too_late = enabling_ > enable_timeout_;
  if (!operational && (were_asked_ || too_late)) {
    stopped_missing_ = missing_;
    stopped_silent_ = silent_;
    return stops(doubted_drive(), !blind_ ? kBusLost : belief_.is_held() ? kJumped : kSilent);
  }
  if (std::exchange(differed_, false)) return stops(doubted_drive(), kSpeedDisagrees);
  if (too_late && !agrees()) return stops(doubted_drive(), speeds_.differs() ? kSpeedDisagrees : kNotCompared);
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const Drive& d = drives_[k];
    const bool enabled = d.axis.state() == State::kOperationEnabled;
    if (d.axis.fell() || (were_enabled_ && !enabled)) return stops(d, kFell);
    if (too_late && !(enabled && takes_targets(d))) return stops(d, kNotEnabled);
    if (is_behind(k)) return stops(d, kBehind);
    if (leaves_range(k)) {
      describe_place(k);
      return stops(d, kOutside);
    }
    if (d.homing.has_failed()) return stops(d, kNotHomed);
    // It would jump to its target when it follows again.
    if (follows_ && !takes_targets(d)) return stops(d, kHolds);
    const bool faulty = d.axis.state() == State::kFault || d.axis.state() == State::kFaultReaction;
    if (faulty && since_acknowledged_ >= kReset) return stops(d, kFaulty);
  }
  return false;
}

/// A drive that becomes able to be enabled long after somebody wished it must not move then.
void EtherCatDrives::advance_enabling(bool on, double h) {
  were_enabled_ = on && (were_enabled_ || all_enabled());
  const auto asked = [](const Drive& d) { return d.control_word == cia402::control_of(cia402::Command::kEnableOperation); };
  were_asked_ = on && (were_asked_ || std::ranges::any_of(drives_, asked));
  const bool homes = std::ranges::any_of(drives_, [](const Drive& d) { return d.homing.runs(); });
  enabling_ = on && !follows_ && !homes ? enabling_ + h : 0;  // the change to and from the homing mode counts, too
}

/// Positions and speeds: what the target would do to an axis that is released far from it.
bool EtherCatDrives::is_behind(std::size_t k) const {
  return follows_ && mode_ != Mode::kTorque && std::abs(q_target_[k] - q_[k]) > following_error_max_[k];
}

/// Whether an axis is out of its range; with outside=return: whether a torque has moved it further out. Its position tells, not its torque, which
/// may hold a load, nor its speed, which flickers.
bool EtherCatDrives::leaves_range(std::size_t k) const {
  const Drive& d = drives_[k];
  const double margin = std::max(kOvershoot, 5 * std::abs(q_scale_[d.joint]));
  if (when_outside_ == Outside::kReturn) return follows_ && mode_ == Mode::kTorque && outside(k) > outside_[k] + margin;
  return d.known && !d.homing.is_active() && outside(k) > margin;
}

/// Sets place_outside_, without allocation.
void EtherCatDrives::describe_place(std::size_t k) {
  const Drive& d = drives_[k];
  const char* const si = d.revolute ? "rad" : "m";
  const auto limit = [](double q) { return std::abs(q) < kUnlimited ? q : std::copysign(INFINITY, q); };
  std::array<char, 160> text;
  std::snprintf(text.data(), text.size(), " stands at %.4g %s, outside of q_command_min to q_command_max (%.4g to %.4g %s)",
                q_[k], si, limit(q_command_min_[k]), limit(q_command_max_[k]), si);
  place_outside_ = "drive ";
  place_outside_.append(d.name).append(" (").append(d.joint_name).append(")").append(text.data());
}

/// The drive whose last position is furthest from the one that was used.
const EtherCatDrives::Drive& EtherCatDrives::doubted_drive() const {
  std::size_t furthest = 0;
  for (std::size_t k = 1; k < drives_.size(); ++k)
    if (std::abs(q_read_[k] - q_[k]) > std::abs(q_read_[furthest] - q_[furthest])) furthest = k;
  return drives_[furthest];
}

/// Where a drive stands that is switched on.
std::int64_t EtherCatDrives::place_of(const Drive& d) const {
  const auto& [a, b, c] = d.last_counts;
  return std::max(std::min(a, b), std::min(std::max(a, b), c));
}

double EtherCatDrives::outside(std::size_t k) const {
  return std::max({0.0, q_[k] - q_command_max_[k], q_command_min_[k] - q_[k]});
}

/// Whether an enabled drive is in the mode and follows its target.
bool EtherCatDrives::takes_targets(const Drive& d) const {
  const bool in_mode = d.mode_display.bits == 0 || d.mode_shown == static_cast<std::int32_t>(profile_mode());
  return d.known && in_mode && (d.status_word & cia402::status::kFollows) != 0;
}

/// Whether a status word and mode are used. On the way to Operation enabled they are, so that no drive waits. That a drive is
/// enabled, and what changes an enabled one, or one in its quick stop, is used with the third input in a row.
bool EtherCatDrives::is_confirmed(Drive& d, std::uint16_t status_word, std::int32_t mode) const {
  const auto decisive = [&](std::uint16_t word, std::int32_t shown) {
    const State state = cia402::state_of(word);
    const unsigned bits = d.homing.runs() ? cia402::status::kReached | cia402::status::kHomed | cia402::status::kHomingError
                                          : cia402::status::kFollows;
    return std::tuple(state, word & bits, shown);
  };
  const State state = d.axis.state();
  const bool moves = state == State::kQuickStop || state == State::kOperationEnabled ||
                     cia402::state_of(status_word) == State::kOperationEnabled;
  const bool same = decisive(status_word, mode) == decisive(d.status_word, d.mode_shown);
  if (same) d.unconfirmed += d.doubts;
  const bool used = same || !moves || ++d.doubts >= kInARow;
  if (used) d.doubts = 0;
  return used;
}

bool EtherCatDrives::all_enabled() const {
  return std::ranges::all_of(drives_,
                             [&](const Drive& d) { return d.axis.state() == State::kOperationEnabled && takes_targets(d); });
}

void EtherCatDrives::write(ethercat::Master& master, std::int64_t now, const Command& command, double h,
                           Acknowledgement& acknowledgement) {
  if (empty()) return;
  const bool operational = master.operational() && !blind_;
  for (Drive& d : drives_) operational ? d.axis.see(d.status_word, d.stood >= kStood) : d.axis.forget();
  since_acknowledged_ = std::min(since_acknowledged_ + h, kReset);
  if (awaited_ && !acknowledgement.awaits()) {
    since_acknowledged_ = 0;
    for (Drive& d : drives_) d.axis.reset_fault();
  }
  if (quick_stop_ && drives()) acknowledgement.demand();
  const bool on = drives() && enable_ && !quick_stop_ && !acknowledgement.awaits();
  advance_enabling(on, h);
  const Drive* const jumped = std::exchange(jumped_, nullptr);
  if (on && (jumped != nullptr || has_stopped(operational))) {
    ++stops_;
    if (jumped != nullptr) std::tie(stopped_drive_, stopped_by_) = std::tuple(jumped, kJumped);
    acknowledgement.demand();
  }
  if (jumped != nullptr) acknowledgement.demand();
  awaited_ = acknowledgement.awaits();
  const Wish wanted = wish(awaited_);
  advance_homing(wanted == Wish::kOn && operational, h);
  for (Drive& d : drives_) {
    d.control_word = operational          ? static_cast<std::uint16_t>(d.axis.control(wanted) | d.homing.control_bits())
                     : blind_ && drives() ? cia402::control_of(cia402::Command::kQuickStop)
                                          : 0;
  }
  const double interval = 1e-9 * static_cast<double>(master.output_interval(now));
  choose_targets(command, h, interval, wanted == Wish::kOn && !homes() && all_enabled());
  for (std::size_t k = 0; k < drives_.size(); ++k) write_targets(master, k);
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
    belief_.expect_jump();
    speeds_.forget();
  }
}

/// Targets begin where the drives are, and stay there until all of them are enabled.
void EtherCatDrives::choose_targets(const Command& command, double h, double interval, bool follows) {
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    if (d.axis.state() != State::kOperationEnabled || d.homing.is_active()) d.held = place_of(d);
    q_target_[k] = q_scale_[d.joint] * static_cast<double>(d.held) + q_offset_[d.joint];
    const double wanted = command.q[d.joint];
    q_wanted_[k] =
        std::isfinite(wanted) ? std::clamp(wanted, q_command_min_[k], std::max(q_command_min_[k], q_command_max_[k])) : wanted;
  }
  for (std::size_t k = 0; k < drives_.size(); ++k)
    outside_[k] = follows && follows_ ? std::min(outside_[k], outside(k)) : outside(k);
  if (!follows || !follows_) synchronisation_.start(q_target_);
  follows_ = follows;
  if (!follows) {
    std::ranges::fill(tau_target_, 0.0);
    return;
  }
  h = std::clamp(h, kLeastStep, std::max(cycle_, kLeastStep));  // the bus gets one target for a longer step, too
  // Two targets within a cycle of the drive would be twice the speed. Less than a hundredth of a cycle is left alone.
  if (mode_ == Mode::kPosition && interval < 0.99 * h) h = interval;
  if (h < kLeastStep) return;
  const Synchronisation::Gains gains{no_gain_, no_gain_, dq_command_max_, ddq_command_max_};
  pauses_ ? synchronisation_.pause(gains, h) : synchronisation_.command(q_wanted_, gains, h);
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    q_target_[k] = synchronisation_.last()[k];
    const double tau = command.tau[d.joint];
    tau_target_[k] = std::isfinite(tau) ? std::clamp(tau, -tau_command_max_[k], tau_command_max_[k]) : 0;
    const double counts = (q_target_[k] - q_offset_[d.joint]) / q_scale_[d.joint];
    if (mode_ == Mode::kPosition && std::abs(counts) < 9e18) d.held = std::llround(counts);
    if (mode_ != Mode::kPosition) d.held = d.counts;
  }
}

void EtherCatDrives::write_image(std::span<std::uint8_t> out, const Drive& d, std::uint16_t control, std::int64_t position,
                                 double speed, double torque) const {
  const auto write = [&](const Place& place, std::int64_t value) {
    if (place.bits != 0) write_bits(out, place.bit, place.bits, static_cast<std::uint32_t>(value));
  };
  write(d.control, control);
  write(d.mode, static_cast<std::int64_t>(d.homing.mode(profile_mode())));
  write(d.target_position, position);
  write(d.target_velocity, rounded(speed, 32));
  write(d.target_torque, rounded(torque, 16));
  for (const Constant& c : d.constants) write(c.place, c.value == kNotGiven ? 0 : c.value);
}

void EtherCatDrives::write_targets(ethercat::Master& master, std::size_t k) {
  const Drive& d = drives_[k];
  double speed = 0, torque = 0;
  if (follows_ && mode_ == Mode::kVelocity) {
    const double q = q_scale_[d.joint] * static_cast<double>(d.counts) + q_offset_[d.joint];
    const double dq = synchronisation_.speed()[k] + K_v_ * (q_target_[k] - q);
    speed = std::clamp(dq, -dq_command_max_[k], dq_command_max_[k]) / dq_scale_of(k);
  }
  if (follows_ && mode_ == Mode::kTorque) torque = synchronisation_.share() * tau_target_[k] / tau_scale_[k];
  write_image(master.outputs(d.slave), d, d.control_word, d.held, speed, torque);
  write_image(master.safe_outputs(d.slave), d, cia402::control_of(cia402::Command::kQuickStop), d.counts, 0, 0);
}

double EtherCatDrives::dq_scale_of(std::size_t k) const {
  return dq_scale_[k] != 0 ? dq_scale_[k] : q_scale_[drives_[k].joint];
}

void EtherCatDrives::wait(double h, double patience) {
  silent_ += h;
  elapsed_ += h;
  ++missing_;
  const bool before = std::exchange(blind_, silent_ > patience);
  if (blind_ && !before) {
    belief_.forget();
    speeds_.forget();
    tau_.forget();
  }
  if (blind_)
    for (Drive& d : drives_) d.axis.forget();
}

bool EtherCatDrives::read(const ethercat::Master& master) {
  if (empty()) return true;
  // A slave on its way back: what it gives first may be of the time before.
  if (std::ranges::any_of(drives_, [&](const Drive& d) { return master.status(d.slave).down; })) return false;
  const auto value = [&](const Drive& d, const Place& place) {
    return place.bits == 0 ? 0 : signed_value(read_bits(master.inputs(d.slave), place.bit, place.bits), place.bits);
  };
  const auto counts_of = [&](const Drive& d) {
    const auto raw = static_cast<std::uint32_t>(value(d, d.position));
    const auto way = static_cast<std::int32_t>(raw - static_cast<std::uint32_t>(d.reference));
    return d.known && !d.homing.runs() ? d.reference + way : static_cast<std::int32_t>(raw);
  };
  bool possible = true;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const Drive& d = drives_[k];
    q_read_[k] = q_scale_[d.joint] * static_cast<double>(counts_of(d)) + q_offset_[d.joint];
    dq_read_[k] = d.velocity.bits != 0     ? dq_scale_of(k) * value(d, d.velocity)
                  : d.known && silent_ > 0 ? (q_read_[k] - q_[k]) / silent_
                                           : 0;
    dq_given_[k] = d.velocity.bits != 0 ? dq_read_[k] : NAN;
    tau_read_[k] = tau_scale_[k] * value(d, d.torque);
    // A speed from positions is one count per cycle or more, however slow the axis is.
    possible = possible && (d.velocity.bits == 0 || belief_.allows(k, dq_read_[k]));
  }
  const Belief::Verdict verdict = belief_.add(q_read_, std::exchange(elapsed_, 0), true, possible);
  if (belief_.is_held()) return false;
  const char* const differs = speeds_.compare(q_read_, dq_given_, silent_);
  if (differs != nullptr && !were_enabled_) {
    belief_.count_implausible(differs);
    differed_ = drives();
  }
  if (const char* const why = tau_.add(tau_read_)) belief_.count_implausible(why);
  const bool moves = verdict == Belief::Verdict::kPlausible;
  const auto way = [&](std::size_t k) { return std::abs(q_read_[k] - q_[k]); };
  if (verdict == Belief::Verdict::kJump) jumped_ = &doubted_drive();
  pauses_ = false;
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    Drive& d = drives_[k];
    const auto status_word = static_cast<std::uint16_t>(value(d, d.status));
    if (const std::int32_t mode = value(d, d.mode_display); is_confirmed(d, status_word, mode)) {
      d.status_word = status_word;
      d.mode_shown = mode;
    }
    pauses_ = pauses_ || d.doubts > 0;
    d.error_code = static_cast<std::int32_t>(errors_.put(k, value(d, d.error) & 0xffff));
    const std::int64_t counts = counts_of(d);
    if (!d.known || (!moves && way(k) > Belief::kLargestJump)) d.last_counts.fill(counts);
    d.last_counts = {d.last_counts[1], d.last_counts[2], counts};
    if (!d.known || d.homing.runs()) d.reference = counts;
    if (d.known && moves) d.reference += counts - d.counts;
    d.counts = counts;
    d.known = true;
    d.speed = d.velocity.bits == 0 && !moves ? 0 : dq_read_[k];
    q_[k] = q_read_[k];
    const bool moved = std::abs(q_[k] - d.stood_at) > std::max(kStandsWithin, 2 * std::abs(q_scale_[d.joint]));
    if (moved) d.stood_at = q_[k];
    d.stood = moved ? 0 : d.stood + silent_;
  }
  last_elapsed_ = std::exchange(silent_, 0);
  missing_ = 0;
  blind_ = false;
  return fresh_ = true;
}

/// q̇ is the low-pass of the drives' speeds. Without data it is held for `patience`, and is 0 afterwards.
void EtherCatDrives::measure(Measured& measured, double dq_cutoff, double patience) {
  if (empty()) return;
  const bool fresh = std::exchange(fresh_, false);
  if (!place_outside_.empty() && !std::exchange(told_outside_, true)) measured.warn(place_outside_);
  measured.has_tau = tau_.known() && std::ranges::none_of(tau_scale_, [](double scale) { return scale == 0; });
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const Drive& d = drives_[k];
    const std::size_t j = d.joint;
    if (d.known) measured.q[j] = q_[k];
    measured.tau[j] = tau_.torque(k);
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
    master.operational() && !blind_ ? d.axis.see(d.status_word, d.stood >= kStood) : d.axis.forget();
    d.control_word = d.axis.control(Wish::kStop);
    follows_ = false;
    d.held = place_of(d);
    write_targets(master, k);
    moves = moves || d.axis.state() == State::kOperationEnabled || d.axis.state() == State::kQuickStop;
    // After a loss: the drives that answer are on the ramp of the safe outputs.
    moves = moves || (!master.operational() && d.known && std::abs(d.speed) > kMoves);
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

void EtherCatDrives::append_notes(std::vector<std::string>& sentences) const {
  belief_.append_notes(sentences, "input");
  for (const Drive& d : drives_) {
    if (d.unconfirmed > 0)
      sentences.push_back(text::counted(d.unconfirmed, "status word") + " of drive " + d.name +
                          " not used, because the next ones differed");
  }
  if (stops_ == 0) return;
  const bool outside = stopped_by_ == kOutside;
  const std::string silent =
      text::counted(stopped_missing_, "answer") + " did not come in time, for " + text::to_text(stopped_silent_, 3) + " s";
  sentences.push_back("the drives were stopped " + text::counted(stops_, "time") + ", last because " +
                      (outside                   ? place_outside_
                       : stopped_by_ == kSilent  ? silent
                       : stopped_by_ == kBusLost ? kBusLost
                                                 : "drive " + stopped_drive_->name + " " + stopped_by_) +
                      (outside && when_outside_ == Outside::kRefuse ? "; outside=return lets it move back" : ""));
}

}  // namespace cotwin::io
