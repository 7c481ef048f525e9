#include "components/io/fri/client.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "components/io/fri/finite.h"
#include "models/foundation/support/error.h"

namespace cotwin::fri {

namespace {

using C = Command;
using M = Monitoring;

constexpr double kSilentPeriods = 20;          // send periods without a message: not connected
constexpr double kJitterShare = 1.0 / 16;      // RFC 3550, 6.4.1
constexpr std::int64_t kJump = 1'000'000'000;  // ns, of a clock; time stamps of LWR are single floats

unsigned bits_of(Protocol protocol) { return protocol == Protocol::kLwr ? 16 : 32; }

bool all_usable(const Joints& values, std::size_t n) {
  return std::all_of(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n), is_usable);
}

bool all_usable(const Pose& X) {
  return std::all_of(X.R.data(), X.R.data() + X.R.size(), is_usable) && std::all_of(X.p.data(), X.p.data() + 3, is_usable);
}

bool are_torques(const Joints& values, std::size_t n) {
  constexpr double kLargestTorque = 1e4;  // N.m, a hundred times what joints of these robots have
  return std::all_of(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n),
                     [](double tau) { return std::abs(tau) <= kLargestTorque; });
}

bool is_period(double s) {
  constexpr double kRounding = 1e-6;  // of a single float
  return s >= kShortestPeriod * (1 - kRounding) && s <= kLongestPeriod * (1 + kRounding);
}

/// Whether the message has what a command can begin at.
bool has_place(const Monitoring& m) {
  const bool pose = m.has(M::kCommandMode) && m.command_mode == ClientCommandMode::kCartesianPose;
  return pose ? m.has(M::kInterpolatorPose) : m.has(M::kInterpolatorPosition) || m.has(M::kCommandedPosition);
}

void take(Joints& to, const Joints& from, std::size_t n) {
  if (all_finite(from, n)) to = from;
}
void take(Wrench& to, const Wrench& from) {
  if (from.allFinite()) to = from;
}

}  // namespace

Client::Client(const ClientSettings& settings, const std::string& place)
    : settings_(settings), statistics_(bits_of(settings.protocol)) {
  check_joints(settings.protocol, settings.joints, place);
  if (!settings.speed_limit.empty() && settings.speed_limit.size() != settings.joints) {
    throw Error(place, "speed_limit has " + std::to_string(settings.speed_limit.size()) + " values, expected " +
                           std::to_string(settings.joints) + ", one per joint");
  }
  sent_.joints = static_cast<std::uint32_t>(settings.joints);
}

Fault usability(const Monitoring& m) {
  if (!is_period(m.send_period) || !is_period(m.send_period * m.receive_multiplier)) return Fault::kValue;
  if (!m.has(M::kMeasuredPosition) || (is_commanding(m.state) && !has_place(m))) return Fault::kMissing;
  const std::size_t n = m.joints;
  const auto usable = [&](std::uint32_t field, const auto& values) { return !m.has(field) || all_usable(values, n); };
  const auto usable_torques = [&](std::uint32_t field, const Joints& values) {
    return !m.has(field) || are_torques(values, n);
  };
  const auto usable_pose = [&](std::uint32_t field, const Pose& X) { return !m.has(field) || all_usable(X); };
  const auto usable_angle = [&](std::uint32_t field, const Redundancy& r) { return !m.has(field) || is_usable(r.value); };
  const bool all = usable(M::kMeasuredPosition, m.q_measured) && usable(M::kCommandedPosition, m.q_commanded) &&
                   usable(M::kInterpolatorPosition, m.q_interpolator) && usable_torques(M::kMeasuredTorque, m.tau_measured) &&
                   usable_torques(M::kCommandedTorque, m.tau_commanded) && usable_torques(M::kExternalTorque, m.tau_external) &&
                   usable_pose(M::kMeasuredPose, m.X_measured) && usable_pose(M::kCommandedPose, m.X_commanded) &&
                   usable_pose(M::kInterpolatorPose, m.X_interpolator) &&
                   usable_angle(M::kMeasuredRedundancy, m.redundancy_measured) &&
                   usable_angle(M::kInterpolatorRedundancy, m.redundancy_interpolator) &&
                   (!m.has(M::kExternalWrench) || std::all_of(m.F_external.begin(), m.F_external.end(), is_usable));
  return all ? Fault::kNone : Fault::kNotFinite;
}

std::int64_t Client::longest_silence() const {
  const double periods = kSilentPeriods * monitoring().send_period * 1e9;
  return std::max(settings_.timeout, static_cast<std::int64_t>(periods));
}

bool Client::connected(std::int64_t now) const { return started_ && now - latest_ <= longest_silence(); }

/// Decodes a datagram into the free message and examines it.
Fault Client::fault_of(std::span<const std::uint8_t> bytes, bool stranger) {
  if (stranger) return Fault::kStranger;
  Monitoring& message = messages_[1 - newest_];
  const Fault fault = decode(settings_.protocol, bytes, settings_.joints, message);
  return fault != Fault::kNone ? fault : usability(message);
}

/// Whether a message that is `messages` after the newest one, and came `elapsed` ns later, can be of the same session. A controller
/// that has begun anew may have any counters and time stamps: more messages than there was time for, or a clock that jumps.
bool Client::continues(const Monitoring& message, std::int64_t messages, std::int64_t elapsed) const {
  const auto passed = messages * static_cast<std::int64_t>(std::min(message.send_period, monitoring().send_period) * 1e9);
  if (messages > 1 && passed > elapsed + longest_silence()) return false;
  const bool timed = message.has(M::kTime) && monitoring().has(M::kTime);
  return !timed || std::abs(message.time - monitoring().time - passed) <= kJump + elapsed;
}

/// Whether a message at `position` in the stream, newer than all before, has to wait for the next one: one that does not continue the session, or
/// came too early, and does not follow from one that waits.
bool Client::waits(const Monitoring& message, std::int64_t position, std::int64_t arrival, std::int64_t elapsed) {
  constexpr std::int64_t kMostBetween = 16;
  constexpr double kCatchUp = 1e-3;  // the clocks of both sides differ by up to 2e-4
  const double period = std::min(message.send_period, monitoring().send_period) * 1e9;
  const std::int64_t messages = position - newest_position_, since = position - waiting_;
  // A message may be late, but not earlier than those before by more than half a period.
  const double late = late_ + static_cast<double>(arrival - latest_) - static_cast<double>(messages) * period;
  const bool fits = continues(message, messages, elapsed) && (messages == 1 || late >= -period / 2);
  const auto expected = waiting_time_ + static_cast<std::int64_t>(static_cast<double>(since) * period);
  const bool timely = !message.has(M::kTime) || std::abs(message.time - expected) <= kJump;
  const bool follows = waiting_ != 0 && since > 0 && since <= kMostBetween && timely;
  waiting_ = fits || follows ? 0 : position;
  waiting_time_ = message.time;
  if (waiting_ == 0) late_ = (1 - kCatchUp) * std::max(late, 0.0);
  return waiting_ != 0;
}

Client::Reception Client::receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival,
                                  std::int64_t host) {
  const bool lost = !connected(arrival), other = !(from == controller_);
  const bool silent = started_ && host - latest_host_ > longest_silence();
  last_fault_ = statistics_.faults.add(fault_of(bytes, !settings_.controller.covers(from) || (other && !lost && !silent)));
  if (last_fault_ != Fault::kNone) return Reception::kRefused;
  const Monitoring& message = messages_[1 - newest_];
  SequenceTracker& tracker = statistics_.monitoring;
  const std::uint64_t restarts = tracker.restarts();
  if (started_ && other) tracker.forget();
  const std::int64_t elapsed = std::max(arrival - latest_, host - latest_host_), ahead = tracker.ahead(message.counter);
  const bool newer = started_ && !other && !lost && !silent && ahead > 0 && ahead <= SequenceTracker::kLargestGap;
  if (newer && waits(message, newest_position_ + ahead, arrival, elapsed)) return Reception::kRefused;
  const SequenceTracker::Arrival order = tracker.add(message.counter, silent);
  if (order == SequenceTracker::Arrival::kDuplicate || order == SequenceTracker::Arrival::kStale) return Reception::kRefused;
  position_ = tracker.position();
  arrival_ = arrival;
  answering_ = message.counter;
  if (order == SequenceTracker::Arrival::kNew) {
    const bool begun = started_ && (other || tracker.restarts() != restarts);
    const bool jumped = started_ && !begun && !continues(message, position_ - newest_position_, elapsed);
    if (jumped) tracker.begin_at_newest();
    const bool anew = begun || jumped, reopened = monitoring().state == SessionState::kIdle;
    if (!anew) note_interval(message, arrival);
    if (!anew) note_reflected(message.reflected, arrival);
    if (anew && !lost && !(jumped && reopened)) ++statistics_.restarts;
    newest_ = 1 - newest_;
    newest_position_ = position_;
    latest_ = arrival;
    latest_host_ = host;
    controller_ = from;
    if (anew || lost) begin_session();
    started_ = true;
  }
  if (message.state == SessionState::kIdle) return Reception::kNoAnswerDue;
  ++since_answer_;
  return since_answer_ >= message.receive_multiplier ? Reception::kAnswerDue : Reception::kNoAnswerDue;
}

void Client::begin_session() {
  const Monitoring& m = monitoring();
  sent_.q = m.has(M::kCommandedPosition) ? m.q_commanded : m.q_measured;
  sent_.X = m.has(M::kCommandedPose) ? m.X_commanded : m.has(M::kMeasuredPose) ? m.X_measured : m.X_interpolator;
  sent_.tau.fill(0);
  sent_.F.setZero();
  answered_ = position_ - 1;
  since_answer_ = 0;
  waiting_ = 0;
  late_ = 0;
  has_reflected_ = false;
  ++statistics_.sessions;
}

void Client::note_interval(const Monitoring& message, std::int64_t arrival) {
  if (!connected(arrival)) return;
  const double interval = static_cast<double>(arrival - latest_) * 1e-9;
  const auto messages = static_cast<double>(position_ - newest_position_);
  if (messages == 1) statistics_.interval.add(interval);
  const double deviation = std::abs(interval - messages * message.send_period);
  statistics_.jitter += (deviation - statistics_.jitter) * kJitterShare;
}

void Client::note_reflected(std::uint32_t reflected, std::int64_t arrival) {
  // How many answers ago it was sent; 1: the latest. The counter of LWR has 16 bits.
  const std::uint32_t mask = settings_.protocol == Protocol::kLwr ? 0xffff : 0xffffffff;
  const std::uint32_t age = (counter_ - reflected) & mask;
  if (age == 0 || age > sent_times_.size() || age > statistics_.answers) return;
  const std::uint32_t counter = counter_ - age;
  // Before the first command, a controller reflects 0, which may be the counter of the first answer on its way.
  if (!has_reflected_ && counter == 0 && statistics_.answers > 1) return;
  const std::uint32_t steps = counter - reflected_;
  if (has_reflected_ && (steps == 0 || steps > sent_times_.size())) return;
  if (has_reflected_) statistics_.unreflected += steps - 1;
  statistics_.round_trip.add(static_cast<double>(arrival - sent_times_[counter % sent_times_.size()]) * 1e-9);
  reflected_ = counter;
  has_reflected_ = true;
}

/// Quantities that are not finite keep their last values.
void Client::set_quantities(const Command& wanted, std::uint32_t fields) {
  const std::size_t n = settings_.joints;
  if ((fields & C::kPosition) != 0) take(sent_.q, wanted.q, n);
  if ((fields & C::kTorque) != 0) take(sent_.tau, wanted.tau, n);
  if ((fields & C::kWrench) != 0) take(sent_.F, wanted.F);
  if ((fields & C::kPose) != 0 && fri::is_finite(wanted.X)) sent_.X = wanted.X;
  if ((fields & C::kRedundancy) != 0 && std::isfinite(wanted.redundancy.value)) sent_.redundancy = wanted.redundancy;
  if ((fields & C::kJointStiffness) != 0) take(sent_.joint_stiffness, wanted.joint_stiffness, n);
  if ((fields & C::kJointDamping) != 0) take(sent_.joint_damping, wanted.joint_damping, n);
  if ((fields & C::kCartesianStiffness) != 0) take(sent_.cartesian_stiffness, wanted.cartesian_stiffness);
  if ((fields & C::kCartesianDamping) != 0) take(sent_.cartesian_damping, wanted.cartesian_damping);
}

void Client::limit_speed(const Joints& before) {
  if (settings_.speed_limit.empty()) return;
  const double time = static_cast<double>(std::max<std::int64_t>(position_ - answered_, 0)) * monitoring().send_period;
  for (std::size_t i = 0; i < settings_.joints; ++i) {
    const double step = settings_.speed_limit[i] * time;
    sent_.q[i] = before[i] + std::clamp(sent_.q[i] - before[i], -step, step);
  }
}

std::uint32_t Client::taken() const {
  const Monitoring& m = monitoring();
  if (settings_.protocol == Protocol::kLwr) return sent_.fields;  // it must not change any more
  const ClientCommandMode mode = m.has(M::kCommandMode) ? m.command_mode : ClientCommandMode::kPosition;
  switch (mode) {
    case ClientCommandMode::kCartesianPose:
      return m.has(M::kInterpolatorRedundancy) ? C::kPose | C::kRedundancy : C::kPose;
    case ClientCommandMode::kTorque:
      return C::kPosition | C::kTorque;
    case ClientCommandMode::kWrench:
      return C::kPosition | C::kWrench;
    default:
      return C::kPosition;
  }
}

void Client::compose_lwr(const Command& wanted) {
  const Monitoring& m = monitoring();
  const Joints before = sent_.q;
  const bool commanding = m.state == SessionState::kCommandingActive;
  if (!commanding) sent_.fields = wanted.fields & ~std::uint32_t{C::kRedundancy};
  set_quantities(wanted, sent_.fields);
  if (commanding) {
    limit_speed(before);
    return;
  }
  sent_.q = m.q_commanded;
  sent_.X = m.X_commanded;
  sent_.tau.fill(0);
  sent_.F.setZero();
}

void Client::compose_sunrise(const Command& wanted) {
  const Monitoring& m = monitoring();
  const bool two = settings_.protocol >= Protocol::kSunrise2_5;
  const Joints before = sent_.q;
  sent_.transformations = wanted.transformations;
  sent_.ios = wanted.ios;
  sent_.fields = 0;
  if (is_monitoring(m.state)) {
    if (m.has(M::kCommandedPosition)) sent_.q = m.q_commanded;
    if (!two && m.has(M::kCommandedPosition)) sent_.fields = C::kPosition;
    return;
  }
  sent_.fields = taken();
  const std::uint32_t given = m.state == SessionState::kCommandingActive ? wanted.fields & sent_.fields : 0;
  // What the user does not give is the interpolator's, without an overlay.
  if (m.has(M::kInterpolatorPosition) && (given & C::kPosition) == 0) sent_.q = m.q_interpolator;
  if (m.has(M::kInterpolatorPose) && (given & C::kPose) == 0) sent_.X = m.X_interpolator;
  if (m.has(M::kInterpolatorRedundancy) && (given & C::kRedundancy) == 0) sent_.redundancy = m.redundancy_interpolator;
  if ((given & C::kTorque) == 0) sent_.tau.fill(0);
  if ((given & C::kWrench) == 0) sent_.F.setZero();
  set_quantities(wanted, given);
  if ((given & C::kPosition) != 0) limit_speed(before);
}

std::span<const std::uint8_t> Client::answer(const Command& wanted, std::int64_t now) {
  const Monitoring& m = monitoring();
  if (!started_ || m.state == SessionState::kIdle) return {};
  since_answer_ = 0;
  sent_.counter = counter_;
  sent_.reflected = answering_;
  sent_.krl = wanted.krl;
  if (settings_.protocol == Protocol::kLwr) {
    compose_lwr(wanted);
  } else {
    compose_sunrise(wanted);
  }
  const std::size_t size = encode(settings_.protocol, sent_, datagram_);
  if (size == 0) return {};
  sent_times_[counter_ % sent_times_.size()] = now;
  ++counter_;
  ++statistics_.answers;
  statistics_.answer_time.add(now - arrival_);
  answered_ = std::max(answered_, position_);
  return std::span(datagram_).first(size);
}

}  // namespace cotwin::fri
