#include "components/io/emulators/kuka/controller.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "components/io/fri/finite.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fri {

namespace {

using C = Command;
using M = Monitoring;

constexpr std::int64_t kMillisecond = 1'000'000;  // ns
constexpr std::int64_t kSilence = 1'000'000'000;  // ns without a command after which another client may take over
constexpr std::uint32_t kAnswersInStep = 3;       // with the interpolator's position, until commands are applied
constexpr std::int64_t kRemembered = 256;         // messages

void check_size(const std::vector<double>& values, std::size_t n, bool required, const char* name, const std::string& place) {
  if (values.size() == n || (values.empty() && !required)) return;
  throw Error(place, std::string(name) + " has " + std::to_string(values.size()) + " values, expected " + std::to_string(n) +
                         ", one per joint");
}

void check_range(double value, double least, double most, const char* name, const std::string& place) {
  if (value >= least && value <= most) return;
  throw Error(place, std::string(name) + " is " + text::to_text(value) + ", expected " + text::to_text(least) + " to " +
                         text::to_text(most));
}

const ControllerSettings& checked(const ControllerSettings& s, const std::string& place) {
  check_joints(s.protocol, s.joints, place);
  check_size(s.speed_limit, s.joints, true, "speed_limit", place);
  check_size(s.lower, s.joints, false, "lower", place);
  check_size(s.upper, s.joints, false, "upper", place);
  check_size(s.torque_limit, s.joints, false, "torque_limit", place);
  check_range(static_cast<double>(s.send_period) * 1e-6, 1, 100, "send_period in ms", place);
  if (s.protocol != Protocol::kLwr && s.send_period % kMillisecond != 0) {
    throw Error(place, "send_period is " + std::to_string(s.send_period) + " ns, expected whole milliseconds for Sunrise");
  }
  check_range(s.receive_multiplier, 1, s.protocol == Protocol::kLwr ? 1 : 100, "receive_multiplier", place);
  check_range(s.safety_factor, 0, 1, "safety_factor", place);
  check_range(s.rating.window, 1, 10'000, "rating.window", place);
  check_range(s.rating.excellent, 0, 1, "rating.excellent", place);
  check_range(s.rating.good, 0, s.rating.excellent, "rating.good", place);
  check_range(s.rating.fair, 0, s.rating.good, "rating.fair", place);
  check_range(s.rating.excellent_latency, 0, 1, "rating.excellent_latency", place);
  check_range(s.max_lost, 0, 255, "max_lost", place);
  check_range(static_cast<double>(s.stop_time) * 1e-9, 0, 10, "stop_time in s", place);
  check_range(static_cast<double>(s.slack) * 1e-9, 0, 1, "slack in s", place);
  check_range(s.acceleration_limit, 1e-3, std::numeric_limits<double>::infinity(), "acceleration_limit", place);
  for (const double limit : s.speed_limit) check_range(limit, 0, 1e3, "speed_limit", place);
  constexpr double kAny = std::numeric_limits<double>::infinity();
  for (const double limit : s.torque_limit) check_range(limit, 0, kAny, "torque_limit", place);
  check_range(s.force_limit, 0, kAny, "force_limit", place);
  check_range(s.moment_limit, 0, kAny, "moment_limit", place);
  check_range(s.joint_stiffness_limit, 0, kAny, "joint_stiffness_limit", place);
  check_range(s.linear_stiffness_limit, 0, kAny, "linear_stiffness_limit", place);
  check_range(s.angular_stiffness_limit, 0, kAny, "angular_stiffness_limit", place);
  if (s.protocol != Protocol::kLwr && s.protocol < Protocol::kSunrise2_5 &&
      s.command_mode == ClientCommandMode::kCartesianPose) {
    throw Error(place, std::string("the client has to command poses with protocol ") + to_text(s.protocol) +
                           ", expected sunrise-2.5 or -2.7: messages of older versions have no poses");
  }
  return s;
}

InterpolatorSettings interpolation_of(const ControllerSettings& s) {
  InterpolatorSettings i{s.speed_limit,        s.lower,     s.upper, s.send_period,
                         s.receive_multiplier, s.stop_time, s.slack, 2.0 * s.max_lost + 2,
                         s.acceleration_limit};
  for (double& limit : i.speed_limit) limit *= s.safety_factor;
  return i;
}

PoseInterpolatorSettings frame_interpolation_of(const ControllerSettings& s) {
  return {s.linear_speed_limit * s.safety_factor,
          s.angular_speed_limit * s.safety_factor,
          s.send_period,
          s.receive_multiplier,
          s.stop_time,
          s.slack};
}

bool is_within(double value, double limit) { return value >= 0 && value <= limit; }

/// The control in which an LWR takes these quantities.
ControlMode control_of(std::uint32_t fields) {
  if ((fields & (C::kWrench | C::kCartesianStiffness | C::kCartesianDamping)) != 0) return ControlMode::kCartesianImpedance;
  if ((fields & (C::kTorque | C::kJointStiffness | C::kJointDamping)) != 0) return ControlMode::kJointImpedance;
  return ControlMode::kPosition;
}

}  // namespace

const char* to_text(Drop drop) {
  constexpr std::array<const char*, kDrops> kTexts{"none",      "request", "quality",     "lost",   "speed",
                                                   "position",  "torque",  "robot",       "fields", "closed",
                                                   "stiffness", "posture", "acceleration"};
  return kTexts.at(static_cast<std::size_t>(drop));
}

Controller::Controller(const ControllerSettings& settings, const std::string& place)
    : settings_(checked(settings, place)),
      statistics_(settings.protocol == Protocol::kLwr ? 16 : 32),
      rating_(settings.rating, settings.send_period * settings.receive_multiplier),
      interpolator_(interpolation_of(settings)),
      frame_(frame_interpolation_of(settings)),
      client_(settings.client) {
  robot_.joints = received_.joints = command_.joints = static_cast<std::uint32_t>(settings.joints);
  robot_.drives.fill(DriveState::kActive);
  robot_.tracking_performance = 1;
}

void Controller::open(std::int64_t now) {
  if (state_ != SessionState::kIdle) return;
  state_ = SessionState::kMonitoringWait;
  next_ = now;
  first_ = index_ + 1;
  newest_ = index_;
  rating_.clear();
  client_ = settings_.client;
  has_client_ = false;
  statistics_.commands.forget();
}

void Controller::close(std::int64_t now) {
  if (is_commanding(state_)) leave(Drop::kClosed, now);
  const bool open = state_ != SessionState::kIdle;
  state_ = SessionState::kIdle;
  next_ = open && !lwr() ? now : std::numeric_limits<std::int64_t>::max();
}

bool Controller::is_stranger(const net::Endpoint& from, std::int64_t arrival) const {
  if (state_ == SessionState::kIdle || !settings_.client.covers(from)) return true;
  // Nobody takes over while the robot follows another client.
  return has_client_ && !(from == client_) && (is_commanding(state_) || arrival - client_time_ < kSilence);
}

std::int64_t Controller::index_of(std::uint32_t reflected) const {
  const std::uint32_t mask = lwr() ? 0xffff : 0xffffffff;
  const std::int64_t age = (static_cast<std::uint32_t>(index_) - reflected) & mask;
  return age < kRemembered && index_ - age >= first_ ? index_ - age : 0;
}

Fault Controller::receive(std::span<const std::uint8_t> bytes, const net::Endpoint& from, std::int64_t arrival) {
  FaultCounts& faults = statistics_.faults;
  if (is_stranger(from, arrival)) return faults.add(Fault::kStranger);
  if (const Fault fault = decode(settings_.protocol, bytes, settings_.joints, received_); fault != Fault::kNone) {
    return faults.add(fault);
  }
  if (!is_finite()) return faults.add(Fault::kNotFinite);
  if (has_client_ && !(from == client_)) statistics_.commands.forget();
  const SequenceTracker::Arrival order = statistics_.commands.add(received_.counter);
  if (order == SequenceTracker::Arrival::kDuplicate || order == SequenceTracker::Arrival::kStale) return Fault::kNone;
  has_client_ = true;
  client_ = from;
  client_time_ = arrival;
  if (order == SequenceTracker::Arrival::kNew) reflected_ = received_.counter;
  const std::int64_t index = index_of(received_.reflected);
  if (index == 0) {
    ++statistics_.unmatched;
    return Fault::kNone;
  }
  rate(index, arrival);
  return index > newest_ ? faults.add(use(index, arrival)) : Fault::kNone;
}

void Controller::rate(std::int64_t index, std::int64_t arrival) {
  const std::int64_t latency = std::max<std::int64_t>(arrival - sent_times_[static_cast<std::size_t>(index % kRemembered)], 0);
  const std::int64_t group = group_of(index), open = group_of(index_);
  Answer& answer = answers_[static_cast<std::size_t>(group % kRemembered)];
  if (answer != Answer::kNone) return;
  const bool in_time = latency <= settings_.send_period * settings_.receive_multiplier;
  answer = in_time ? Answer::kInTime : Answer::kLate;
  ++(in_time ? statistics_.in_time : statistics_.late);
  if (group < open) {  // counted as missing when its period ended
    --statistics_.missing;
    if (in_time) rating_.correct(open - group);
  }
  rating_.add_latency(latency);
  statistics_.latency.add(static_cast<double>(latency) * 1e-9);
  statistics_.answer_time.add(latency);
}

/// All that the command claims to have: what has no flag in a packed struct may be anything.
bool Controller::is_finite() const {
  const Command& c = received_;
  const std::size_t n = settings_.joints;
  return (!c.has(C::kPosition) || all_finite(c.q, n)) && (!c.has(C::kTorque) || all_finite(c.tau, n)) &&
         (!c.has(C::kWrench) || c.F.allFinite()) && (!c.has(C::kPose) || fri::is_finite(c.X)) &&
         (!c.has(C::kRedundancy) || std::isfinite(c.redundancy.value)) &&
         (!c.has(C::kJointStiffness) || all_finite(c.joint_stiffness, n)) &&
         (!c.has(C::kJointDamping) || all_finite(c.joint_damping, n)) &&
         (!c.has(C::kCartesianStiffness) || c.cartesian_stiffness.allFinite()) &&
         (!c.has(C::kCartesianDamping) || c.cartesian_damping.allFinite()) &&
         (!lwr() || std::ranges::all_of(c.krl.real, [](float x) { return std::isfinite(x); })) &&
         std::ranges::all_of(c.ios.all(), [](const Io& io) { return std::isfinite(io.analog); }) &&
         std::ranges::all_of(c.transformations.all(), [](const Transformation& t) { return fri::is_finite(t.pose); });
}

bool Controller::has_needed_fields() const {
  const Command& c = received_;
  if (lwr()) return c.has(C::kPosition) || (settings_.control == ControlMode::kCartesianImpedance && c.has(C::kPose));
  const bool active = state_ == SessionState::kCommandingActive;
  switch (settings_.command_mode) {
    case ClientCommandMode::kNone:
      return true;
    case ClientCommandMode::kPosition:
      return c.has(C::kPosition);
    case ClientCommandMode::kWrench:
      return c.has(C::kPosition) && (!active || c.has(C::kWrench));
    case ClientCommandMode::kTorque:
      return c.has(C::kPosition) && (!active || c.has(C::kTorque));
    case ClientCommandMode::kCartesianPose:
      return c.has(C::kPose);
  }
  return false;
}

Fault Controller::use(std::int64_t index, std::int64_t arrival) {
  if (is_commanding(state_) && !has_needed_fields()) return Fault::kMissing;
  if (received_.has(C::kPose) && !fri::is_nearly_rotation(received_.X.R)) return Fault::kValue;
  if (state_ == SessionState::kCommandingActive) {
    if (const Drop drop = limit_exceeded(index); drop != Drop::kNone) {
      newest_ = index;
      leave(drop, std::max(arrival, clock_));  // the set point must not go back to the time of arrival
      return Fault::kNone;
    }
    if (received_.has(C::kPosition) || commands_pose()) interpolator_.command(received_.q, index, !commands_pose());
    if (received_.has(C::kPose)) {
      if (!has_pose_) frame_.start(received_.X, index);
      frame_.command(received_.X, index);
      has_pose_ = true;
    }
  }
  newest_ = index;
  std::swap(command_, received_);
  if (state_ == SessionState::kCommandingWait) {
    in_step_ = is_near(command_, index) ? in_step_ + 1 : 0;
  }
  return Fault::kNone;
}

bool Controller::commands_pose() const {
  if (!received_.has(C::kPose) || !settings_.posture) return false;
  return lwr() ? settings_.control == ControlMode::kCartesianImpedance || !received_.has(C::kPosition)
               : settings_.command_mode == ClientCommandMode::kCartesianPose;
}

Drop Controller::limit_exceeded(std::int64_t index) {
  Command& c = received_;
  if (lwr() && c.fields != fields_) return Drop::kFields;
  const ControlMode control = control_of(c.fields);
  if (lwr() && !settings_.control_follows && control != ControlMode::kPosition && control != settings_.control)
    return Drop::kFields;
  // Torques and wrenches in another mode than theirs are no command of this session.
  const bool torques = c.has(C::kTorque) && settings_.command_mode != ClientCommandMode::kTorque;
  const bool wrenches = c.has(C::kWrench) && settings_.command_mode != ClientCommandMode::kWrench;
  if (!lwr() && (torques || wrenches)) return Drop::kFields;
  if (c.has(C::kPose) && has_pose_ && frame_.is_jump(c.X, index)) return Drop::kSpeed;
  const bool by_pose = commands_pose();
  if (by_pose) {
    c.q = interpolator_.newest();
    if (!settings_.posture(c.X, c.has(C::kRedundancy) ? &c.redundancy : nullptr, c.q)) return Drop::kPosture;
  }
  if (by_pose || c.has(C::kPosition)) {
    if (const Drop drop = joints_exceeded(index, by_pose); drop != Drop::kNone) return drop;
  }
  const Drop stiffness = stiffness_exceeded();
  return stiffness != Drop::kNone ? stiffness : overlay_exceeded();
}

/// Poses have limits of speed alone: the joints of a path of poses may turn quickly.
Drop Controller::joints_exceeded(std::int64_t index, bool by_pose) const {
  const Joints& q = received_.q;
  for (std::size_t i = 0; i < settings_.joints; ++i) {
    if (!settings_.lower.empty() && q[i] < settings_.lower[i]) return Drop::kPosition;
    if (!settings_.upper.empty() && q[i] > settings_.upper[i]) return Drop::kPosition;
  }
  if (interpolator_.is_jump(q, index)) return Drop::kSpeed;
  return !by_pose && interpolator_.is_jerk(q, index) ? Drop::kAcceleration : Drop::kNone;
}

Drop Controller::stiffness_exceeded() const {
  const Command& c = received_;
  for (std::size_t i = 0; i < settings_.joints; ++i) {
    if (c.has(C::kJointStiffness) && !is_within(c.joint_stiffness[i], settings_.joint_stiffness_limit)) return Drop::kStiffness;
    if (c.has(C::kJointDamping) && !is_within(c.joint_damping[i], 1)) return Drop::kStiffness;
  }
  for (Eigen::Index i = 0; i < 6; ++i) {
    const double most = i < 3 ? settings_.linear_stiffness_limit : settings_.angular_stiffness_limit;
    if (c.has(C::kCartesianStiffness) && !is_within(c.cartesian_stiffness[i], most)) return Drop::kStiffness;
    if (c.has(C::kCartesianDamping) && !is_within(c.cartesian_damping[i], 1)) return Drop::kStiffness;
  }
  return Drop::kNone;
}

Drop Controller::overlay_exceeded() const {
  const Command& c = received_;
  Joints tau{};
  if (c.has(C::kWrench)) {
    if (c.F.head<3>().stableNorm() > settings_.force_limit * settings_.safety_factor) return Drop::kTorque;
    if (c.F.tail<3>().stableNorm() > settings_.moment_limit * settings_.safety_factor) return Drop::kTorque;
    if (settings_.torque_of_wrench) settings_.torque_of_wrench(c.F, tau);
  }
  for (std::size_t i = 0; i < settings_.joints && !settings_.torque_limit.empty(); ++i) {
    if (c.has(C::kTorque)) tau[i] += c.tau[i];
    if (!(std::abs(tau[i]) <= settings_.torque_limit[i] * settings_.safety_factor)) return Drop::kTorque;
  }
  return Drop::kNone;
}

/// Whether the command is where the robot is, which may have moved since message `index` was sent.
bool Controller::is_near(const Command& c, std::int64_t index) const {
  const double time = static_cast<double>((index_ - index + 1) * settings_.send_period) * 1e-9;
  for (std::size_t i = 0; i < settings_.joints && c.has(C::kPosition); ++i) {
    const double robot = robot_.q_interpolator[i] + offset_[i];
    if (!(std::abs(c.q[i] - robot) <= settings_.synchronised + settings_.speed_limit[i] * time)) return false;
  }
  if (!c.has(C::kPose) || !robot_.has(lwr() ? M::kCommandedPose : M::kInterpolatorPose)) return true;
  const Pose& X = lwr() ? robot_.X_commanded : robot_.X_interpolator;
  const double angle = Eigen::AngleAxisd(Eigen::Quaterniond(X.R.transpose() * c.X.R).normalized()).angle();
  return (c.X.p - X.p).norm() <= settings_.synchronised + settings_.linear_speed_limit * time &&
         angle <= settings_.synchronised + settings_.angular_speed_limit * time;
}

bool Controller::robot_is_ready() const {
  if (robot_.has(M::kSafetyState) && robot_.safety != SafetyState::kNormal) return false;
  if (!robot_.has(M::kDriveStates)) return true;
  return std::all_of(robot_.drives.begin(), robot_.drives.begin() + static_cast<std::ptrdiff_t>(settings_.joints),
                     [](DriveState d) { return d == DriveState::kActive; });
}

void Controller::advance_state(std::int64_t now) {
  const Quality quality = rating_.quality();
  if (is_commanding(state_)) {
    if (!requested_) return leave(Drop::kRequest, now);
    if (!robot_is_ready()) return leave(Drop::kRobot, now);
    if (quality < settings_.hold) return leave(Drop::kQuality, now);
    if (state_ == SessionState::kCommandingWait && in_step_ >= kAnswersInStep) start_commanding(now);
    return;
  }
  // Clients prepare their motion when a monitoring state begins: at least one message with it comes first.
  const SessionState told = state_;
  state_ = quality >= Quality::kGood ? SessionState::kMonitoringReady : SessionState::kMonitoringWait;
  if (state_ != told || quality < settings_.enter) return;
  if (!requested_ || !acknowledged_ || motion_ != Motion::kOwn || !robot_is_ready()) return;
  if (!lwr()) {
    state_ = SessionState::kCommandingWait;
    in_step_ = 0;
    return;
  }
  const bool recent = index_ - newest_ <= 2 && has_client_;
  const bool mirrored = is_near(command_, newest_);
  const bool complete =
      command_.has(C::kPosition) || (settings_.control == ControlMode::kCartesianImpedance && command_.has(C::kPose));
  if (recent && mirrored && complete) start_commanding(now);
}

void Controller::start_commanding(std::int64_t now) {
  state_ = SessionState::kCommandingActive;
  Joints q{}, dq{};
  total_position(now, q, dq);
  began_ = index_;
  newest_ = index_ - 1;
  interpolator_.start(q, newest_);
  motion_ = Motion::kClient;
  fields_ = command_.fields;
  // A robot that does not tell where its frame is gives the client nothing to mirror.
  has_pose_ = command_.has(C::kPose) && robot_.has(lwr() ? M::kCommandedPose : M::kInterpolatorPose);
  if (has_pose_) frame_.start(command_.X, newest_);
  setpoint_.fields = 0;
  tau_.fill(0);
  F_.setZero();
}

void Controller::leave(Drop why, std::int64_t now) {
  drop_ = why;
  ++statistics_.drops[static_cast<std::size_t>(why)];
  state_ = rating_.quality() >= Quality::kGood ? SessionState::kMonitoringReady : SessionState::kMonitoringWait;
  if (why != Drop::kRequest) acknowledged_ = false;
  if (motion_ != Motion::kClient) return;
  interpolator_.stop(now);
  frame_.stop(now);
  motion_ = Motion::kStopping;
}

/// Applies the newest command, and bridges missing ones.
void Controller::begin_command_period(std::int64_t now) {
  // The newest message that can have been answered is the one before; with a multiplier the client chooses which ones it answers.
  const std::int64_t multiplier = settings_.receive_multiplier;
  const std::int64_t lost = std::max<std::int64_t>(index_ - 1 - newest_ - (multiplier - 1), 0);
  if (lost > 0) ++statistics_.bridged;
  if (lost > settings_.max_lost * multiplier) return leave(Drop::kLost, now);
  interpolator_.begin_period(now, lost);
  frame_.begin_period(now, lost);
  if (newest_ < began_) return;
  // A quantity that is not given may hold anything, and 0 times that need not be 0.
  tau_ = command_.has(C::kTorque) ? command_.tau : Joints{};
  F_ = command_.has(C::kWrench) ? command_.F : Wrench(Wrench::Zero());
  setpoint_.fields = command_.fields;
  setpoint_.redundancy = command_.redundancy;
  setpoint_.joint_stiffness = command_.joint_stiffness;
  setpoint_.joint_damping = command_.joint_damping;
  setpoint_.cartesian_stiffness = command_.cartesian_stiffness;
  setpoint_.cartesian_damping = command_.cartesian_damping;
}

/// When the joints rest and the end of commanding was acknowledged, the robot follows its own motion from where it is.
void Controller::finish_stop(std::int64_t now) {
  if (motion_ != Motion::kStopping || !acknowledged_ || !interpolator_.at_rest(now)) return;
  Joints q{}, dq{};
  interpolator_.at(now, q, dq);
  for (std::size_t i = 0; i < settings_.joints; ++i) offset_[i] = q[i] - robot_.q_interpolator[i];
  motion_ = Motion::kOwn;
}

void Controller::total_position(std::int64_t now, Joints& q, Joints& dq) const {
  if (motion_ != Motion::kOwn) return interpolator_.at(now, q, dq);
  for (std::size_t i = 0; i < settings_.joints; ++i) q[i] = robot_.q_interpolator[i] + offset_[i];
  dq.fill(0);
}

std::span<const std::uint8_t> Controller::cycle(std::int64_t now) {
  clock_ = std::max(clock_, now);
  if (state_ == SessionState::kIdle) {  // the last message of a session, if it is due
    if (std::exchange(next_, std::numeric_limits<std::int64_t>::max()) > now) return {};
    ++index_;
    return write_message(now);
  }
  const std::int64_t skipped = std::max<std::int64_t>((now - next_) / settings_.send_period, 0);
  statistics_.skipped += static_cast<std::uint64_t>(skipped);
  next_ += (skipped + 1) * settings_.send_period;
  ++index_;
  const std::int64_t group = group_of(index_);
  const bool begins = (index_ - first_) % settings_.receive_multiplier == 0;
  if (begins && group > 0) {
    const Answer answer = answers_[static_cast<std::size_t>((group - 1) % kRemembered)];
    if (answer == Answer::kNone) ++statistics_.missing;
    rating_.close_period(answer == Answer::kInTime);
  }
  if (begins) answers_[static_cast<std::size_t>(group % kRemembered)] = Answer::kNone;
  finish_stop(now);
  advance_state(now);
  if (begins && motion_ == Motion::kClient) begin_command_period(now);
  sent_times_[static_cast<std::size_t>(index_ % kRemembered)] = now;
  return write_message(now);
}

std::span<const std::uint8_t> Controller::write_message(std::int64_t now) {
  Monitoring& m = robot_;
  const Joints own = m.q_interpolator;
  Joints dq{};
  total_position(now, m.q_commanded, dq);
  if (!lwr()) {
    for (std::size_t i = 0; i < settings_.joints; ++i) m.q_interpolator[i] += offset_[i];
  }
  m.counter = static_cast<std::uint32_t>(index_);
  m.reflected = reflected_;
  m.state = state_;
  m.quality = rating_.quality();
  m.send_period = static_cast<double>(settings_.send_period) * 1e-9;
  m.receive_multiplier = settings_.receive_multiplier;
  m.command_period = m.send_period * settings_.receive_multiplier;
  m.safety_factor = settings_.safety_factor;
  m.answer_rate = rating_.answer_rate();
  m.miss_rate = 1 - m.answer_rate;
  m.latency = rating_.latency();
  m.jitter = rating_.jitter();
  m.misses = static_cast<std::uint32_t>(statistics_.missing + statistics_.late);
  m.control = lwr() && settings_.control_follows ? control_of(command_.fields) : settings_.control;
  m.command_mode = settings_.command_mode;
  m.overlay = settings_.overlay;
  m.fields |= M::kCommandedPosition | M::kInterpolatorPosition | M::kControlMode | M::kCommandMode | M::kOverlay | M::kTracking;
  size_ = encode(settings_.protocol, m, datagram_);
  m.q_interpolator = own;
  if (size_ > 0) ++statistics_.sent;
  return message();
}

const Setpoint& Controller::setpoint(std::int64_t now) {
  clock_ = std::max(clock_, now);
  finish_stop(now);
  total_position(now, setpoint_.q, setpoint_.dq);
  setpoint_.active = motion_ == Motion::kClient;
  const double share = motion_ == Motion::kOwn ? 0 : interpolator_.share_of_speed(now);
  for (std::size_t i = 0; i < settings_.joints; ++i) setpoint_.tau[i] = share * tau_[i];
  setpoint_.F = share * F_;
  if ((setpoint_.fields & C::kPose) != 0) setpoint_.X = frame_.at(now);
  return setpoint_;
}

}  // namespace cotwin::fri
