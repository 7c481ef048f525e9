#include "components/io/emulators/fri_controller_link.h"

#include <Eigen/Core>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <utility>

#include "components/io/link/finite.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"

namespace cotwin::io {

namespace {

using M = fri::Monitoring;

const std::string kFriControllerPlace = "unit:io?link=fri_controller";
constexpr std::int64_t kSilence = 1'000'000'000;  // ns without an answer after which there is no client
constexpr std::int64_t kRepeatMessage =
    20'000'000;                                 // ns without an answer after which a waiting controller repeats its message
constexpr std::int64_t kLong = 10'000'000'000;  // ns without any answer after which there is a warning
constexpr const char* kNobody = "no client answered for 10 s";
constexpr std::size_t kThird = 2;  // the joint whose position is the redundancy E1 of a robot of seven joints
constexpr const char* kNamedController =
    "a client that was started with the address of a controller accepts messages from that address and port only (parameters "
    "address and port)";
constexpr const char* kUnsent =
    "a message could not be sent to the client: there is no way to its address, or the network is down (output unsent)";
constexpr const char* kNoCommands =
    "datagrams of the client were no commands of the protocol of this controller (outputs rejected, last_fault)";

/// Exact for times since 1970 that are: a double of so many nanoseconds is not.
std::int64_t nanoseconds_of(double s) {
  const double whole = std::floor(s);
  return static_cast<std::int64_t>(whole) * 1'000'000'000 + std::llround((s - whole) * 1e9);
}

/// ns since 1970.
std::int64_t utc() {
  const auto since_1970 = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::nanoseconds>(since_1970).count();
}

/// Only robots of seven joints have the angle E1.
fri::Redundancy redundancy_of(std::span<const double> q) {
  constexpr std::int32_t kE1 = 0, kNone = 4;
  return q.size() == 7 ? fri::Redundancy{kE1, q[kThird]} : fri::Redundancy{kNone, 0};
}

}  // namespace

FriControllerLink::FriControllerLink(Settings& settings, std::vector<trajectory::Axis> joints)
    : protocol_(protocol_of(settings)),
      n_(joints.size()),
      q_(n_),
      tau_(n_),
      tau_e_(n_),
      q_d_(n_),
      reads_(settings.text("io_read"), fri::Io::Direction::kInput, kFriControllerPlace + "&io_read"),
      address_("127.0.0.1"),
      client_("127.0.0.1:" + std::to_string(default_port(protocol_))),
      tau_command_max_(n_, kNoLimit),
      stiffness_(n_, 1000.0),
      damping_(n_, 0.7),
      q_command_(n_),
      dq_command_(n_),
      tau_command_(n_),
      stiffness_command_(n_),
      damping_command_(n_),
      writes_(settings.text("io_write"), fri::Io::Direction::kOutput, kFriControllerPlace + "&io_write"),
      q_own_(n_),
      q_total_(n_),
      tau_F_(n_) {
  fri::check_joints(protocol_, n_, kFriControllerPlace);
  for (const trajectory::Axis& axis : joints) {
    q_min_.push_back(finite(axis.q_min, -kNoLimit));
    q_max_.push_back(finite(axis.q_max, kNoLimit));
    dq_max_.push_back(finite(axis.dq_max, kMostSpeed));
  }
  if (settings.robot_used() == nullptr) return;
  const robot::RobotModel& robot = *settings.robot_used();
  kinematics_.emplace(robot);
  for (std::size_t i = 0; i < n_; ++i) tau_command_max_[i] = std::min(robot.joints[i].tau_max, kNoLimit);
}

FriControllerLink::~FriControllerLink() = default;

/// As KUKA's robots do: torques are added in joint impedance control, wrenches in Cartesian impedance control.
fri::ControlMode FriControllerLink::control_of(fri::ClientCommandMode mode) const {
  using Control = fri::ControlMode;
  const std::string place = kFriControllerPlace + ": control";
  const bool sunrise = protocol_ != fri::Protocol::kLwr;
  const Control needed = sunrise && mode == fri::ClientCommandMode::kTorque   ? Control::kJointImpedance
                         : sunrise && mode == fri::ClientCommandMode::kWrench ? Control::kCartesianImpedance
                                                                              : Control::kPosition;
  if (control_.empty()) return needed;
  const Control given = text::choose<Control>(place, control_,
                                              {{"position", Control::kPosition},
                                               {"joint_impedance", Control::kJointImpedance},
                                               {"cartesian_impedance", Control::kCartesianImpedance}});
  if (needed != Control::kPosition && given != needed) {
    throw Error(place, "'" + control_ + "' with client_mode=" + client_mode_ + ", expected " +
                           (needed == Control::kJointImpedance ? "joint_impedance" : "cartesian_impedance"));
  }
  return given;
}

/// The names of the parameter, as a robot application requests them from the client.
void FriControllerLink::request_transformations() {
  auto& requested = controller_->robot().transformations;
  requested.count = 0;
  if (transformations_.empty()) return;
  const std::string place = kFriControllerPlace + ": transformations";
  if (protocol_ == fri::Protocol::kLwr) throw Error(place, "given with protocol lwr, expected them only with sunrise");
  for (const std::string_view word : text::split(transformations_, ',')) {
    const std::string_view name = text::trim(word);
    fri::Transformation* const t = requested.add();
    if (t == nullptr)
      throw Error(place, "more than " + std::to_string(fri::kMaxTransformations) + " names, expected at most so many");
    *t = {};
    if (name.empty() || !t->name.assign(name))
      throw Error(place, "'" + std::string(name) + "', expected a name of 1 to 63 characters");
  }
}

fri::ControllerSettings FriControllerLink::controller_settings() {
  fri::ControllerSettings s;
  s.protocol = protocol_;
  s.joints = n_;
  s.client = net::endpoint_of(client_, static_cast<std::uint16_t>(default_port(protocol_)), kFriControllerPlace + ": client");
  if (s.client.address == 0 || s.client.port == 0) {
    throw Error(kFriControllerPlace + ": client",
                "is " + client_ + ", expected the address and the port that messages are sent to");
  }
  s.send_period = Duration::from_seconds(period_).ns;
  s.receive_multiplier = static_cast<std::uint32_t>(receive_multiplier_);
  s.speed_limit = dq_max_;
  s.acceleration_limit = ddq_max_;
  s.lower = q_min_;
  s.upper = q_max_;
  s.torque_limit = tau_command_max_;
  s.force_limit = force_max_;
  s.moment_limit = moment_max_;
  s.joint_stiffness_limit = stiffness_max_;
  s.linear_stiffness_limit = translational_stiffness_max_;
  s.angular_stiffness_limit = rotational_stiffness_max_;
  s.linear_speed_limit = v_command_max_;
  s.angular_speed_limit = w_command_max_;
  s.safety_factor = safety_factor_;
  s.rating = {static_cast<std::uint32_t>(window_), excellent_, good_, fair_, excellent_latency_};
  s.max_lost = static_cast<std::uint32_t>(max_lost_);
  s.stop_time = Duration::from_seconds(stop_time_).ns;
  s.command_mode = text::choose<fri::ClientCommandMode>(kFriControllerPlace + ": client_mode", client_mode_,
                                                        {{"position", fri::ClientCommandMode::kPosition},
                                                         {"torque", fri::ClientCommandMode::kTorque},
                                                         {"wrench", fri::ClientCommandMode::kWrench},
                                                         {"pose", fri::ClientCommandMode::kCartesianPose}});
  s.control = control_of(s.command_mode);
  s.control_follows = protocol_ == fri::Protocol::kLwr && control_.empty();
  s.overlay =
      s.command_mode == fri::ClientCommandMode::kCartesianPose ? fri::OverlayType::kCartesian : fri::OverlayType::kJoint;
  if (!kinematics_) {
    const bool poses = protocol_ == fri::Protocol::kLwr ? s.control == fri::ControlMode::kCartesianImpedance
                                                        : s.command_mode == fri::ClientCommandMode::kCartesianPose;
    if (poses)
      throw Error(kFriControllerPlace, "poses are to be commanded to a robot without a URDF, expected the setting robot");
    return s;
  }
  s.posture = [this](const Pose& X, const fri::Redundancy* redundancy, fri::Joints& q) {
    const bool third = redundancy != nullptr && redundancy->strategy == 0 && n_ == 7;
    return kinematics_->reach(X, third ? std::optional(redundancy->value) : std::nullopt, std::span(q).first(n_));
  };
  s.torque_of_wrench = [this](const Wrench& F, fri::Joints& tau) { kinematics_->torques_of(F, q_, std::span(tau).first(n_)); };
  return s;
}

/// Sunrise controllers send from port 30200. On the client's machine this port stays free for the client: KUKA's bind it at all
/// addresses, which they cannot while any other program has it.
std::uint16_t FriControllerLink::local_port(const net::Endpoint& local) const {
  if (port_ >= 0) return static_cast<std::uint16_t>(port_);
  return static_cast<std::uint16_t>(protocol_ == fri::Protocol::kLwr || local.is_loopback() ? 0 : default_port(protocol_));
}

void FriControllerLink::initialise(Time start, Measured&) {
  controller_.emplace(controller_settings(), kFriControllerPlace);
  request_transformations();
  stepped_ = false;
  epoch_ = protocol_ == fri::Protocol::kLwr ? 0 : start_time_ < 0 ? utc() - start.ns : nanoseconds_of(start_time_);
  net::Endpoint local = net::endpoint_of(address_, 0, kFriControllerPlace + ": address");
  local.port = local_port(local);
  datagrams_.open(local, kFriControllerPlace + ": address, port");
  datagrams_.set_source(controller_->settings().client, protocol_ == fri::Protocol::kLwr ? 16 : 32,
                        [this](auto bytes) { return stamp(bytes); });
  datagrams_.keep_only(controller_->settings().client);
  datagrams_.set_period(controller_->settings().send_period * receive_multiplier_);
  q_own_ = hold_ ? q_ : q_d_;
  krl_client_ = {};
  since_drop_ = 0;
  commands_ = 0;
  host_ = monotonic_now();
  at_ = next_at_ = start.ns;
  closed_at_ = host_;
  opened_ = waited_ = false;
  opened_at_ = start.ns;
  sent_at_ = 0;
  unsent_ = last_fault_ = 0;
  latency_median_ = latency_99_ = latency_max_ = 0;
  latencies_ = 0;
  warning_.clear();
  warning_.reserve(512);
  rejected_.clear();
  rejected_.reserve(fri::kMaxDatagram + 1);
  read_measurements(start.ns);
  write_outputs(start.ns);
}

StepResult FriControllerLink::step(Time now, Duration h, const Command&, Measured&) {
  for (std::size_t left = datagrams_.waiting(); left > 0; --left) receive(*datagrams_.receive(), now.ns);
  host_ = monotonic_now();
  at_ = now.ns;
  next_at_ = (now + h).ns;
  // A run may begin long after its initialisation.
  if (!std::exchange(stepped_, true) && start_time_ < 0 && protocol_ != fri::Protocol::kLwr) epoch_ = utc() - now.ns;
  open_or_close(now.ns);
  if (!hold_) q_own_ = q_d_;
  request(h.seconds());
  read_measurements(now.ns);
  // Steps that catch up are too fast for the client: its missing answers would count as lost commands.
  const bool spaced = spacing_ == 0 || host_ - sent_at_ >= Duration::from_seconds(spacing_).ns;
  if (controller_->next() <= now.ns && spaced) send(controller_->cycle(now.ns));
  write_outputs((now + h).ns);
  return StepResult::kDone;
}

std::optional<DatagramQueue::Stamp> FriControllerLink::stamp(std::span<const std::uint8_t> bytes) {
  if (fri::decode(protocol_, bytes, n_, seen_) != fri::Fault::kNone) return std::nullopt;
  // A twin may still repeat its answer to a robot that was here before.
  constexpr std::uint32_t kRemembered = 256;
  const std::uint32_t mask = protocol_ == fri::Protocol::kLwr ? 0xffff : 0xffffffff;
  const std::uint32_t age = (controller_->robot().counter - seen_.reflected) & mask;
  if (age >= kRemembered || age >= controller_->statistics().sent) return std::nullopt;
  return DatagramQueue::Stamp{seen_.reflected, controller_->settings().send_period};
}

void FriControllerLink::receive(const DatagramQueue::Datagram& datagram, std::int64_t now) {
  const fri::Fault fault =
      controller_->receive(datagram.bytes, datagram.from, scenario_time(datagram.arrival, host_, at_, now));
  if (const std::uint64_t commands = controller_->statistics().commands.received(); commands != commands_) {
    commands_ = commands;
    answered_at_ = now;
  }
  if (fault == fri::Fault::kNone) return;
  last_fault_ = static_cast<std::int32_t>(fault);
  if (fault == fri::Fault::kStranger) return;
  const std::span<const std::uint8_t> kept = datagram.bytes.first(std::min(datagram.bytes.size(), rejected_.capacity()));
  rejected_.assign(kept.begin(), kept.end());
  constexpr std::uint64_t kSeveral = 10;
  if (commands_ == 0 && controller_->statistics().faults.total() == kSeveral) warn(kNoCommands);
}

void FriControllerLink::send(std::span<const std::uint8_t> message) {
  if (message.empty()) return;
  sent_at_ = monotonic_now();
  if (datagrams_.send(message, controller_->client())) return;
  if (unsent_ == 0) warn(kUnsent);
  unsent_ = saturated(static_cast<std::uint64_t>(unsent_) + 1);
}

void FriControllerLink::warn(const char* sentence) {
  if (!warning_.empty()) warning_ += "; ";
  warning_ += sentence;
}

/// The last message, or the first one of the session.
void FriControllerLink::send_again() {
  if (!opened_) {
    const std::int64_t before = next_at_ - controller_->settings().send_period;
    datagrams_.skip_numbers();
    controller_->open(before);
    opened_at_ = before;
    read_measurements(before);
    controller_->cycle(before);
    opened_ = true;
  }
  send(controller_->message());
}

void FriControllerLink::open_or_close(std::int64_t now) {
  if (open_ && !opened_) {
    controller_->open(now);
    opened_at_ = now;
    datagrams_.skip_numbers();
  }
  if (opened_ && commands_ == 0 && !waited_ && now - opened_at_ >= kLong) {
    warn(kNobody);
    waited_ = true;
  }
  if (!open_ && opened_) controller_->close(now);
  opened_ = open_;
}

void FriControllerLink::Datagrams::set_waits(bool waits) {
  waits_ = waits;
  if (!waits || link_.receive_multiplier_ == 1) return;
  throw Error(
      kFriControllerPlace + ": receive_multiplier",
      std::to_string(link_.receive_multiplier_) +
          ", with a clock whose ticks wait for the answer to each message (silence=\"wait\"), expected 1, or another clock");
}

/// A period of the wall clock, or at once if ticks wait for the client.
std::optional<Arrival> FriControllerLink::Datagrams::wait_closed(std::int64_t deadline) {
  const std::int64_t due = std::max(link_.closed_at_, link_.sent_at_) + period();
  while (!waits_ && monotonic_now() < due) {
    if (const std::optional<Arrival> late = DatagramQueue::wait(std::min(deadline, due)); !late && monotonic_now() < due)
      return std::nullopt;
  }
  link_.closed_at_ = std::max(due, monotonic_now() - period());
  return next_period(link_.receive_multiplier_);
}

std::optional<Arrival> FriControllerLink::Datagrams::wait(std::int64_t deadline) {
  if (!link_.open_) return wait_closed(deadline);
  for (;;) {
    const std::int64_t repeat = link_.sent_at_ + kRepeatMessage;
    if (const std::optional<Arrival> arrival = DatagramQueue::wait(std::min(deadline, repeat))) return arrival;
    if (monotonic_now() < repeat) return std::nullopt;  // the deadline, or a signal
    link_.send_again();
    if (monotonic_now() >= deadline) return std::nullopt;
  }
}

/// What the robot's program does: friStart, friStop, and after a drop friStart once more.
void FriControllerLink::request(double h) {
  const bool dropped = controller_->drop() != fri::Drop::kNone && controller_->drop() != fri::Drop::kRequest &&
                       !fri::is_commanding(controller_->state());
  since_drop_ = dropped && restart_ > 0 ? since_drop_ + h : 0;
  const bool again = since_drop_ >= restart_ && restart_ > 0;
  if (again) since_drop_ = 0;
  controller_->request(request_ && !again);
}

void FriControllerLink::read_measurements(std::int64_t now) {
  M& m = controller_->robot();
  m.fields = M::kMeasuredPosition | M::kMeasuredTorque | M::kCommandedTorque | M::kExternalTorque | M::kTime | M::kSafetyState |
             M::kOperationMode | M::kDriveStates | M::kDynamics;
  m.time = epoch_ + now;
  for (std::uint32_t i = 0; i < m.transformations.count; ++i) m.transformations.values[i].time = m.time;
  m.safety = ready_ ? fri::SafetyState::kNormal : fri::SafetyState::kStopLevel1;
  m.operation = fri::OperationMode::kAutomatic;
  m.drives.fill(ready_ ? fri::DriveState::kActive : fri::DriveState::kOff);
  std::ranges::copy(q_, m.q_measured.begin());
  std::ranges::copy(q_own_, m.q_interpolator.begin());
  std::ranges::copy(tau_, m.tau_measured.begin());
  std::ranges::copy(tau_, m.tau_commanded.begin());
  std::ranges::copy(tau_e_, m.tau_external.begin());
  krl_.write(m.krl);
  reads_.write(m.ios);
  if (!kinematics_) return;
  RobotKinematics& k = *kinematics_;
  const bool lwr = protocol_ == fri::Protocol::kLwr;
  for (std::size_t i = 0; i < n_; ++i) q_total_[i] = q_own_[i] + (lwr ? 0 : controller_->offset()[i]);
  m.X_interpolator = k.pose(q_total_);
  m.X_commanded = k.pose(q_command_);
  m.X_measured = k.pose(q_);
  if (lwr || protocol_ == fri::Protocol::kSunrise2_7) m.F_external = k.wrench_of(tau_e_, q_);
  m.redundancy_measured = redundancy_of(q_);
  m.redundancy_interpolator = redundancy_of(q_total_);
  m.fields |= M::kMeasuredPose | M::kCommandedPose | M::kInterpolatorPose | M::kExternalWrench | M::kMeasuredRedundancy |
              M::kInterpolatorRedundancy;
  if (!lwr) return;
  const Eigen::MatrixXd& J = k.jacobian(q_);
  for (int row = 0; row < 6; ++row) {
    for (int i = 0; i < 7; ++i) m.jacobian[static_cast<std::size_t>(7 * row + i)] = J(row, i);
  }
  Eigen::Map<Eigen::Matrix<double, 7, 7>>(m.mass.data()) = k.mass_matrix(q_);
  Eigen::Map<Eigen::Matrix<double, 7, 1>>(m.gravity.data()) = k.gravity(q_);
}

void FriControllerLink::write_outputs(std::int64_t now) {
  const fri::Setpoint& s = controller_->setpoint(now);
  const auto has = [&](std::uint32_t field) { return s.active && (s.fields & field) != 0; };
  const bool stiffness = has(fri::Command::kJointStiffness), damping = has(fri::Command::kJointDamping);
  for (std::size_t i = 0; i < n_; ++i) {
    q_command_[i] = s.q[i];
    dq_command_[i] = s.dq[i];
    tau_command_[i] = s.tau[i];
    stiffness_command_[i] = stiffness ? s.joint_stiffness[i] : stiffness_[i];
    damping_command_[i] = damping ? s.joint_damping[i] : damping_[i];
  }
  Eigen::Map<Wrench> F(F_command_.data());
  F = s.F;
  if (kinematics_ && !F.isZero(0)) {
    kinematics_->torques_of(F, q_, tau_F_);
    for (std::size_t i = 0; i < n_; ++i) tau_command_[i] += tau_F_[i];
  }
  active_ = s.active;
  connected_ = commands_ > 0 && at_ - answered_at_ < kSilence;
  const fri::ControllerStatistics& statistics = controller_->statistics();
  state_ = static_cast<std::int32_t>(controller_->state());
  quality_ = static_cast<std::int32_t>(controller_->quality());
  drop_ = static_cast<std::int32_t>(controller_->drop());
  std::uint64_t drops = 0;
  for (std::size_t i = static_cast<std::size_t>(fri::Drop::kRequest) + 1; i < fri::kDrops; ++i) drops += statistics.drops[i];
  drops_ = saturated(drops);
  counts_.read(statistics);
  const std::uint64_t strangers = datagrams_.strangers();
  counts_.strangers = saturated(static_cast<std::uint64_t>(counts_.strangers) + strangers);
  counts_.rejected = saturated(static_cast<std::uint64_t>(counts_.rejected) + strangers);
  unmatched_ = saturated(statistics.unmatched);
  displaced_ = saturated(datagrams_.displaced());
  if (const std::uint64_t latencies = statistics.latency.count(); latencies != latencies_) {
    latencies_ = latencies;
    latency_max_ = statistics.latency.maximum();
    latency_median_ = std::min(statistics.answer_time.quantile(0.5), latency_max_);
    latency_99_ = std::min(statistics.answer_time.quantile(0.99), latency_max_);
  }
  krl_client_.read(controller_->command().krl);
  writes_.read(controller_->command().ios);
}

std::string FriControllerLink::what_was_rejected() const {
  const fri::FaultCounts& faults = controller_->statistics().faults;
  std::string text;
  for (std::size_t i = 1; i < fri::kFaults; ++i) {
    const auto fault = static_cast<fri::Fault>(i);
    if (fault == fri::Fault::kStranger || faults.of(fault) == 0) continue;
    text::append(text, std::to_string(faults.of(fault)) + " because of " + fri::to_text(fault));
  }
  const auto is_command_of = [&](fri::Protocol p) {
    fri::Command command;
    return fri::decode(p, rejected_, p == fri::Protocol::kLwr ? 7 : n_, command) == fri::Fault::kNone;
  };
  if (rejected_.empty() || is_command_of(protocol_)) return text;
  const auto other = std::ranges::find_if(fri::kProtocols, is_command_of);
  return other == fri::kProtocols.end() ? text : text + "; the last one is a command of " + fri::to_text(*other);
}

void FriControllerLink::append_notes(std::vector<std::string>& sentences) const {
  const std::string client = net::to_text(controller_->client());
  const auto milliseconds = [](double s) { return text::to_text(1e3 * s, 4) + " ms"; };
  if (commands_ == 0) {
    sentences.push_back("no client at " + client + " answered the " + text::counted(counts_.sent, "message") + " (" +
                        fri::to_text(protocol_) + ", from " + net::to_text(datagrams_.local()) + ")");
    if (port_ < 0 && datagrams_.local().is_loopback() && protocol_ != fri::Protocol::kLwr)
      sentences.emplace_back(kNamedController);
  } else {
    sentences.push_back("client " + client + " (" + fri::to_text(protocol_) + "): " + text::counted(counts_.sent, "message") +
                        ", " + std::to_string(counts_.in_time) + " answered in time, " + std::to_string(counts_.late) +
                        " late, " + std::to_string(counts_.missing) + " not");
  }
  if (latencies_ > 0) {
    sentences.push_back("answers took " + milliseconds(latency_median_) + " (median), " + milliseconds(latency_99_) +
                        " (99 %), " + milliseconds(latency_max_) + " (longest)");
  }
  if (const std::string rejected = what_was_rejected(); !rejected.empty()) {
    sentences.push_back("datagrams of the client were rejected: " + rejected);
  }
  if (counts_.strangers > 0) {
    sentences.push_back(text::counted(counts_.strangers, "datagram") + " of other senders ignored");
  }
  if (unmatched_ > 0) {
    sentences.push_back(text::counted(unmatched_, "command") + " not used: none of the last 256 messages reflected");
  }
  if (drops_ > 0) {
    sentences.push_back("commanding ended " + text::counted(drops_, "time") + " by itself, last because of " +
                        fri::to_text(controller_->drop()));
  }
}

}  // namespace cotwin::io
