#include "components/io/fri_controller_link.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>

#include "models/robot/dynamics.h"
#include "models/robot/robot_model.h"
#include "models/support/choice.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::io {

namespace {

using M = fri::Monitoring;

const std::string kPlace = "unit:io?link=fri_controller";
constexpr double kNoLimit = 1e9;                  // rad, N.m
constexpr double kMostSpeed = 1e3;                // rad/s
constexpr std::int64_t kSilence = 1'000'000'000;  // ns without an answer after which there is no client

double finite(double value, double otherwise) { return std::isfinite(value) ? value : otherwise; }

}  // namespace

/// Pose, Jacobian, inertia and gravity of the robot, which its controller reports.
struct FriControllerLink::Kinematics {
  explicit Kinematics(const robot::RobotModel& robot)
      : mechanism(robot),
        data(mechanism),
        tool(robot::on_body(robot.end_effector())),
        J(6, robot.n()),
        H(robot.n(), robot.n()),
        g(robot.n()),
        q(robot.n()) {}

  Pose pose(std::span<const double> position) {
    q = Eigen::Map<const Eigen::VectorXd>(position.data(), q.size());
    return robot::forward_kinematics(mechanism, data, q, tool);
  }

  robot::Mechanism mechanism;
  robot::Data data;
  robot::FrameOnBody tool;
  Eigen::MatrixXd J, H;
  Eigen::VectorXd g, q;
};

FriControllerLink::FriControllerLink(Settings& settings, std::vector<trajectory::Axis> joints)
    : protocol_(protocol_of(settings)),
      n_(joints.size()),
      q_(n_),
      tau_(n_),
      tau_e_(n_),
      q_d_(n_),
      reads_(settings.text("io_read"), fri::Io::Direction::kInput, kPlace + "&io_read"),
      address_(protocol_ == fri::Protocol::kLwr ? "127.0.0.1" : "127.0.0.2"),
      client_("127.0.0.1:" + std::to_string(default_port(protocol_))),
      port_(protocol_ == fri::Protocol::kLwr ? 0 : default_port(protocol_)),
      tau_command_max_(n_, kNoLimit),
      stiffness_(n_, 1000.0),
      damping_(n_, 0.7),
      q_command_(n_),
      dq_command_(n_),
      tau_command_(n_),
      stiffness_command_(n_),
      damping_command_(n_),
      writes_(settings.text("io_write"), fri::Io::Direction::kOutput, kPlace + "&io_write"),
      q_own_(n_) {
  fri::check_joints(protocol_, n_, kPlace);
  for (const trajectory::Axis& axis : joints) {
    q_min_.push_back(finite(axis.q_min, -kNoLimit));
    q_max_.push_back(finite(axis.q_max, kNoLimit));
    dq_max_.push_back(finite(axis.dq_max, kMostSpeed));
  }
  if (settings.robot_used() != nullptr) kinematics_ = std::make_unique<Kinematics>(*settings.robot_used());
}

FriControllerLink::~FriControllerLink() = default;

void FriControllerLink::declare(Variables& v, JointVariables& joints) {
  const bool lwr = protocol_ == fri::Protocol::kLwr;
  joints.input("q", q_, "rad", "measured joint position of the emulated robot").essential();
  joints.input("tau", tau_, "N.m", "measured joint torque of the emulated robot");
  joints.input("tau_e", tau_e_, "N.m", "external joint torque, as the emulated robot estimates it");
  joints.input("q_d", q_d_, "rad", "position of the robot's own motion, if hold is false");
  if (lwr) krl_.declare_inputs(v, "krl", "from the robot's program, $FRI_TO");
  reads_.declare_input(v, "io_value", "I/O values of the robot");

  joints.output("q_command", q_command_, "rad", "position that the robot's drives have to follow");
  joints.output("dq_command", dq_command_, "rad/s", "its rate while the robot follows the client; else 0").discrete();
  joints
      .output("tau_command", tau_command_, "N.m",
              "joint torque that the client adds; with a robot's URDF also that of the wrench that it adds")
      .discrete();
  v.output("F_command", F_command_, "1", "force and moment that the client adds at the tool, x y z each, in N and N.m")
      .discrete();
  joints
      .output("stiffness_command", stiffness_command_, "N.m/rad",
              "joint stiffness, the client's if it gives one, else that of the tunable")
      .discrete();
  v.output("damping_command", damping_command_, "1", "joint damping ratio, likewise").discrete();
  v.output("active", active_, "whether the robot follows the client");
  v.output("connected", connected_, "whether the client has answered within the last second");
  v.output("state", state_,
           "0 idle, 1 monitoring, 2 monitoring in good quality, 3 waiting for the first commands, 4 commanding");
  v.output("quality", quality_,
           "rating of the client's answers: 0 poor (unacceptable), 1 fair (bad), 2 good (OK), 3 excellent");
  v.output(
      "drop", drop_,
      "why commanding ended last: 0 not yet, 1 request, 2 quality, 3 lost commands, 4 speed, 5 position, 6 torque, 7 robot, "
      "8 other quantities, 9 closed");
  v.output("drops", drops_, "how often commanding ended for another reason than request");
  if (lwr) krl_client_.declare_outputs(v, "krl_command", "to the robot's program, $FRI_FRM");
  writes_.declare_output(v, "io_command", "I/O values that the client has written");
  counts_.declare(v);

  v.parameter("address", address_,
              "IPv4 address of this machine that messages are sent from; 127.0.0.1 and 127.0.0.2: this machine only");
  v.parameter("port", port_, "UDP port that messages are sent from; 0: the system chooses").range(0, 65535);
  v.parameter("client", client_, "IPv4 address and port of the client");
  v.parameter("period", period_, "s", "send period; Sunrise: whole milliseconds").range(1e-3, 0.1);
  v.parameter("receive_multiplier", receive_multiplier_, "Sunrise: the client answers every so many messages").range(1, 100);
  v.parameter("client_mode", client_mode_, "Sunrise: what is asked from the client: position, torque, wrench or pose");
  v.parameter("control", control_, "control that is reported: position, joint_impedance or cartesian_impedance");
  v.parameter("window", window_, "command periods over which answers are rated").range(1, 100'000);
  v.parameter("excellent", excellent_, "1", "share of answers in time for excellent quality").range(0, 1);
  v.parameter("excellent_latency", excellent_latency_, "1", "largest mean latency for excellent quality, in command periods")
      .range(0, 1);
  v.parameter("good", good_, "1", "share of answers in time for good quality, at which commanding may begin").range(0, 1);
  v.parameter("fair", fair_, "1", "share of answers in time for fair quality; commanding ends below it").range(0, 1);
  v.parameter("max_lost", max_lost_, "lost commands in a row that are extrapolated; one more stops the robot").range(0, 255);
  v.parameter("stop_time", stop_time_, "s", "time from full speed to rest when commanding ends").range(0, 10);
  v.parameter("safety_factor", safety_factor_, "1", "scales the limits of speed and torque (friStart)").range(0, 1);
  v.parameter("restart", restart_, "s", "after commanding has ended by itself, it is requested again after this time; 0: never")
      .range(0, 1e9);
  v.parameter("hold", hold_, "the robot's own motion is rest where it is at the start; false: q_d");
  joints.parameter("q_min", q_min_, "rad", "lower limit of commanded positions, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("q_max", q_max_, "rad", "upper limit of commanded positions, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("dq_max", dq_max_, "rad/s", "limit of commanded speeds, from the URDF").range(0, kMostSpeed);
  joints.parameter("tau_command_max", tau_command_max_, "N.m", "limit of added torques").range(0, kNoLimit);
  v.tunable("request", request_, "the robot's program asks the client for commands (friStart); false: it ends commanding");
  v.tunable("ready", ready_, "the drives are on and there is no safety stop");
  v.tunable("open", open_, "the session is open (friOpen); false: it ends (friClose), and nothing is sent");
  v.tunable("stiffness", stiffness_, "N.m/rad", "joint stiffness of the robot's program").range(0, 1e9);
  v.tunable("damping", damping_, "1", "joint damping ratio of the robot's program").range(0, 1);
}

fri::ControllerSettings FriControllerLink::controller_settings() const {
  fri::ControllerSettings s;
  s.protocol = protocol_;
  s.joints = n_;
  s.client = net::endpoint_of(client_, static_cast<std::uint16_t>(default_port(protocol_)), kPlace + ": client");
  s.send_period = Duration::from_seconds(period_).ns;
  s.receive_multiplier = static_cast<std::uint32_t>(receive_multiplier_);
  s.speed_limit = dq_max_;
  s.lower = q_min_;
  s.upper = q_max_;
  s.torque_limit = tau_command_max_;
  s.safety_factor = safety_factor_;
  s.rating = {static_cast<std::uint32_t>(window_), excellent_, good_, fair_, excellent_latency_};
  s.max_lost = static_cast<std::uint32_t>(max_lost_);
  s.stop_time = Duration::from_seconds(stop_time_).ns;
  s.control = text::choose<fri::ControlMode>(kPlace + ": control", control_,
                                             {{"position", fri::ControlMode::kPosition},
                                              {"joint_impedance", fri::ControlMode::kJointImpedance},
                                              {"cartesian_impedance", fri::ControlMode::kCartesianImpedance}});
  s.command_mode = text::choose<fri::ClientCommandMode>(kPlace + ": client_mode", client_mode_,
                                                        {{"position", fri::ClientCommandMode::kPosition},
                                                         {"torque", fri::ClientCommandMode::kTorque},
                                                         {"wrench", fri::ClientCommandMode::kWrench},
                                                         {"pose", fri::ClientCommandMode::kCartesianPose}});
  s.overlay =
      s.command_mode == fri::ClientCommandMode::kCartesianPose ? fri::OverlayType::kCartesian : fri::OverlayType::kJoint;
  return s;
}

void FriControllerLink::initialise(Time start, Measured&) {
  controller_.emplace(controller_settings(), kPlace);
  first_.reserve(fri::kMaxDatagram);
  net::Endpoint local = net::endpoint_of(address_, 0, kPlace + ": address");
  local.port = static_cast<std::uint16_t>(port_);
  datagrams_.open(local, kPlace + ": address, port");
  datagrams_.set_source(controller_->settings().client, protocol_ == fri::Protocol::kLwr ? 16 : 32,
                        [this](auto bytes) { return stamp(bytes); });
  datagrams_.set_period(controller_->settings().send_period * receive_multiplier_);
  q_own_ = hold_ ? q_ : q_d_;
  krl_client_ = {};
  since_drop_ = 0;
  commands_ = 0;
  host_ = monotonic_now();
  at_ = start.ns;
  opened_ = answered_ = stepped_ = false;
  take_measurements(start.ns);
  write_outputs(start.ns);
}

StepResult FriControllerLink::step(Time now, Duration h, const Command&, Measured&) {
  for (std::size_t left = datagrams_.waiting(); left > 0; --left) {
    const auto datagram = datagrams_.receive();
    controller_->receive(datagram->bytes, datagram->from, scenario_time(datagram->arrival, host_, at_, now.ns));
    if (const std::uint64_t commands = controller_->statistics().commands.received(); commands != commands_) {
      commands_ = commands;
      answered_at_ = now.ns;
    }
  }
  host_ = monotonic_now();
  at_ = now.ns;
  stepped_ = true;
  open_or_close(now.ns);
  if (!hold_) q_own_ = q_d_;
  request(h.seconds());
  take_measurements(now.ns);
  if (controller_->next() <= now.ns) datagrams_.send(controller_->cycle(now.ns), controller_->client());
  write_outputs((now + h).ns);
  return StepResult::kDone;
}

std::optional<DatagramQueue::Stamp> FriControllerLink::stamp(std::span<const std::uint8_t> bytes) {
  if (fri::decode(protocol_, bytes, n_, seen_) != fri::Fault::kNone) return std::nullopt;
  answered_ = true;
  return DatagramQueue::Stamp{seen_.reflected, controller_->settings().send_period};
}

void FriControllerLink::send_first() {
  if (!opened_) {
    const std::int64_t before = at_ - controller_->settings().send_period;
    controller_->open(before);
    take_measurements(before);
    const std::span<const std::uint8_t> message = controller_->cycle(before);
    first_.assign(message.begin(), message.end());
    opened_ = true;
  }
  datagrams_.send(first_, controller_->client());
}

void FriControllerLink::open_or_close(std::int64_t now) {
  if (open_ && !opened_) controller_->open(now);
  if (!open_ && opened_) controller_->close(now);
  opened_ = open_;
}

std::optional<Arrival> FriControllerLink::Datagrams::wait(std::int64_t deadline) {
  if (!link_.open_) return next_period();
  constexpr std::int64_t kRepeat = 20'000'000;  // ns, until the first message is sent again
  while (!link_.answered_ && !link_.stepped_) {
    link_.send_first();
    const std::int64_t until = std::min(deadline, monotonic_now() + kRepeat);
    if (const std::optional<Arrival> arrival = DatagramQueue::wait(until)) return arrival;
    if (until >= deadline) return std::nullopt;
  }
  return DatagramQueue::wait(deadline);
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

void FriControllerLink::take_measurements(std::int64_t now) {
  M& m = controller_->robot();
  m.fields = M::kMeasuredPosition | M::kMeasuredTorque | M::kCommandedTorque | M::kExternalTorque | M::kTime | M::kSafetyState |
             M::kOperationMode | M::kDriveStates | M::kDynamics;
  m.time = now;
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
  Kinematics& k = *kinematics_;
  m.X_interpolator = k.pose(q_own_);
  m.X_commanded = k.pose(q_command_);
  m.X_measured = k.pose(q_);
  m.fields |= M::kMeasuredPose | M::kCommandedPose | M::kInterpolatorPose;
  if (protocol_ != fri::Protocol::kLwr) return;
  robot::jacobian(k.mechanism, k.data, k.q, k.tool, k.J);
  robot::mass_matrix(k.mechanism, k.data, k.q, k.H);
  robot::gravity(k.mechanism, k.data, k.q, k.g);
  for (int row = 0; row < 6; ++row) {
    for (int i = 0; i < 7; ++i) m.jacobian[static_cast<std::size_t>(7 * row + i)] = k.J(row, i);
  }
  Eigen::Map<Eigen::Matrix<double, 7, 7>>(m.mass.data()) = k.H;
  Eigen::Map<Eigen::Matrix<double, 7, 1>>(m.gravity.data()) = k.g;
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
    Kinematics& k = *kinematics_;
    k.pose(q_);
    robot::jacobian(k.mechanism, k.data, k.q, k.tool, k.J);
    for (std::size_t i = 0; i < n_; ++i) tau_command_[i] += k.J.col(static_cast<Eigen::Index>(i)).dot(F);
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
  krl_client_.read(controller_->command().krl);
  writes_.read(controller_->command().ios);
}

void FriControllerLink::tell(std::vector<std::string>& sentences) const {
  const std::string client = net::to_text(controller_->client());
  sentences.push_back("client " + client + " (" + fri::to_text(protocol_) + "): " + std::to_string(counts_.sent) +
                      " messages, " + std::to_string(counts_.in_time) + " answered in time, " + std::to_string(counts_.late) +
                      " late, " + std::to_string(counts_.missing) + " not");
  if (drops_ > 0) {
    sentences.push_back("commanding ended " + std::to_string(drops_) + " times by itself, last because of " +
                        fri::to_text(controller_->drop()));
  }
}

}  // namespace cotwin::io
