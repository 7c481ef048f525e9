#include "components/io/fri/client.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "models/support/error.h"

namespace cotwin::fri {

namespace {

using C = Command;
using M = Monitoring;

constexpr double kSilentPeriods = 20;      // send periods without a message: not connected
constexpr double kJitterShare = 1.0 / 16;  // RFC 3550, 6.4.1

unsigned bits_of(Protocol protocol) { return protocol == Protocol::kLwr ? 16 : 32; }

bool all_finite(const Joints& values, std::size_t n) {
  return std::all_of(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(n),
                     [](double x) { return std::isfinite(x); });
}

bool is_finite(const Pose& X) { return X.R.allFinite() && X.p.allFinite(); }

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

bool Client::connected(std::int64_t now) const {
  const double periods = kSilentPeriods * monitoring().send_period * 1e9;
  const auto silence = std::max(settings_.timeout, periods > 0 && periods < 1e12 ? static_cast<std::int64_t>(periods) : 0);
  return started_ && now - latest_ <= silence;
}

bool Client::is_stranger(const net::Endpoint& from, std::int64_t arrival) const {
  return !settings_.controller.covers(from) || (connected(arrival) && !(from == controller_));
}

bool Client::is_finite(const Monitoring& m) const {
  const std::size_t n = settings_.joints;
  return (!m.has(M::kMeasuredPosition) || all_finite(m.q_measured, n)) &&
         (!m.has(M::kCommandedPosition) || all_finite(m.q_commanded, n)) &&
         (!m.has(M::kInterpolatorPosition) || all_finite(m.q_interpolator, n)) &&
         (!m.has(M::kMeasuredTorque) || all_finite(m.tau_measured, n)) &&
         (!m.has(M::kExternalTorque) || all_finite(m.tau_external, n)) && std::isfinite(m.send_period);
}

Client::Reception Client::receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival) {
  FaultCounts& faults = statistics_.faults;
  if (is_stranger(from, arrival)) {
    faults.add(Fault::kStranger);
    return Reception::kRefused;
  }
  Monitoring& message = messages_[1 - newest_];
  if (faults.add(decode(settings_.protocol, bytes, settings_.joints, message)) != Fault::kNone) return Reception::kRefused;
  if (!is_finite(message)) {
    faults.add(Fault::kNotFinite);
    return Reception::kRefused;
  }
  if (started_ && !(from == controller_)) statistics_.monitoring.forget();
  const SequenceTracker::Arrival order = statistics_.monitoring.add(message.counter);
  if (order == SequenceTracker::Arrival::kDuplicate || order == SequenceTracker::Arrival::kStale) return Reception::kRefused;
  position_ = statistics_.monitoring.position();
  arrival_ = arrival;
  answering_ = message.counter;
  if (order == SequenceTracker::Arrival::kNew) {
    note_interval(message, arrival);
    note_reflected(message.reflected, arrival);
    newest_ = 1 - newest_;
    newest_position_ = position_;
    latest_ = arrival;
    controller_ = from;
    started_ = true;
  }
  if (message.state == SessionState::kIdle) return Reception::kNoAnswerDue;
  ++since_answer_;
  return since_answer_ >= message.receive_multiplier ? Reception::kAnswerDue : Reception::kNoAnswerDue;
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
void Client::take_quantities(const Command& wanted, std::uint32_t fields) {
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

void Client::compose_lwr(const Command& wanted) {
  const Monitoring& m = monitoring();
  const Joints before = sent_.q;
  const bool commanding = m.state == SessionState::kCommandingActive;
  if (!commanding) sent_.fields = wanted.fields & ~std::uint32_t{C::kRedundancy};
  take_quantities(wanted, sent_.fields);
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
  const bool pose = m.command_mode == ClientCommandMode::kCartesianPose && m.has(M::kCommandMode);
  sent_.fields = pose ? C::kPose : C::kPosition;
  if (pose && m.has(M::kInterpolatorRedundancy)) sent_.fields |= C::kRedundancy;
  if (m.has(M::kCommandMode) && m.command_mode == ClientCommandMode::kTorque) sent_.fields |= C::kTorque;
  if (m.has(M::kCommandMode) && m.command_mode == ClientCommandMode::kWrench) sent_.fields |= C::kWrench;
  const std::uint32_t given = m.state == SessionState::kCommandingActive ? wanted.fields & sent_.fields : 0;
  // What the user does not give is the interpolator's, without an overlay.
  if (m.has(M::kInterpolatorPosition) && (given & C::kPosition) == 0) sent_.q = m.q_interpolator;
  if (m.has(M::kInterpolatorPose) && (given & C::kPose) == 0) sent_.X = m.X_interpolator;
  if (m.has(M::kInterpolatorRedundancy) && (given & C::kRedundancy) == 0) sent_.redundancy = m.redundancy_interpolator;
  if ((given & C::kTorque) == 0) sent_.tau.fill(0);
  if ((given & C::kWrench) == 0) sent_.F.setZero();
  take_quantities(wanted, given);
  if ((given & C::kPosition) != 0) limit_speed(before);
}

std::span<const std::uint8_t> Client::answer(const Command& wanted, std::int64_t now) {
  const Monitoring& m = monitoring();
  if (!started_ || m.state == SessionState::kIdle) return {};
  if (statistics_.answers == 0) {  // a robot that is in a commanding state already
    sent_.q = m.has(M::kCommandedPosition) ? m.q_commanded : m.has(M::kInterpolatorPosition) ? m.q_interpolator : m.q_measured;
  }
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
