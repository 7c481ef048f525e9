#include "components/io/fri_link.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "models/support/choice.h"
#include "models/support/error.h"
#include "models/support/text.h"

namespace cotwin::io {

namespace {

const std::string kPlace = "unit:io?link=fri";
constexpr const char* kSilent =
    "the robot was silent for longer than timeout: its last positions were held and its external torques set to 0";

Pose pose_of(const std::array<double, 3>& p, const std::array<double, 4>& quat) {
  Eigen::Quaterniond Q(quat[0], quat[1], quat[2], quat[3]);
  const double norm = Q.norm();
  if (!(norm > 1e-6)) Q = Eigen::Quaterniond::Identity();
  return {Q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
}

void write(const Pose& X, std::array<double, 3>& p, std::array<double, 4>& quat) {
  const Eigen::Quaterniond Q(X.R);
  p = {X.p.x(), X.p.y(), X.p.z()};
  quat = {Q.w(), Q.x(), Q.y(), Q.z()};
}

/// The pose on the way from `from` to `to` that is at most `distance` (m) and `angle` (rad) away.
Pose approach(const Pose& from, const Pose& to, double distance, double angle) {
  Pose X = to;
  const Eigen::Vector3d way = to.p - from.p;
  if (const double length = way.norm(); length > distance) X.p = from.p + way * (distance / length);
  const Eigen::AngleAxisd turn(Eigen::Matrix3d(from.R.transpose() * to.R));
  if (turn.angle() > angle) X.R = from.R * Eigen::AngleAxisd(angle, turn.axis()).toRotationMatrix();
  return X;
}

}  // namespace

FriLink::FriLink(Settings& settings, std::vector<trajectory::Axis> joints)
    : protocol_(protocol_of(settings)),
      n_(joints.size()),
      synchronisation_(n_),
      port_(default_port(protocol_)),
      dq_command_max_(n_),
      writes_(settings.text("io_write"), fri::Io::Direction::kOutput, kPlace + "&io_write"),
      K_P_(n_),
      K_D_(n_),
      stiffness_(n_, 1000.0),
      damping_(n_, 0.7),
      cartesian_stiffness_{2000, 2000, 2000, 200, 200, 200},
      cartesian_damping_{0.7, 0.7, 0.7, 0.7, 0.7, 0.7},
      q_robot_(n_),
      q_own_(n_),
      q_sent_(n_),
      e_(n_),
      reads_(settings.text("io_read"), fri::Io::Direction::kInput, kPlace + "&io_read") {
  fri::check_joints(protocol_, n_, kPlace);
  for (std::size_t i = 0; i < n_; ++i) {
    if (std::isfinite(joints[i].dq_max)) dq_command_max_[i] = joints[i].dq_max;
  }
}

void FriLink::declare(Variables& v, JointVariables& joints) {
  v.input("F_command", F_command_, "1",
          "mode=wrench, cartesian_impedance: force and moment added at the tool, x y z each, in N and N.m");
  v.input("p_command", p_command_, "m", "mode=cartesian_impedance: commanded position of the tool in the robot's base");
  v.input("quat_command", quat_command_, "1", "mode=cartesian_impedance: commanded orientation of the tool, (w, x, y, z)");
  if (protocol_ == fri::Protocol::kLwr) krl_command_.declare_inputs(v, "krl_command", "to the robot's program, $FRI_FRM");
  writes_.declare_input(v, "io_command", "I/O values to be written");

  v.output("connected", connected_, "whether messages of the robot come");
  v.output("state", state_,
           "0 idle, 1 monitoring, 2 monitoring in good quality, 3 waiting for the first commands, 4 commanding");
  v.output("quality", quality_,
           "the robot's rating of the answers: 0 poor (unacceptable), 1 fair (bad), 2 good (OK), 3 excellent");
  v.output("commanding", commanding_, "whether the robot follows the commands of this unit");
  v.output("client_mode", command_mode_, "Sunrise: what the robot asks for, 0 none, 1 position, 2 wrench, 3 torque, 4 pose");
  v.output("t_robot", t_robot_, "s", "time of the robot's clock").discrete();
  v.output("period", period_, "s", "send period of the robot's messages").discrete();
  joints.output("q_robot", q_robot_, "rad", "position that the robot commands, with what it takes from this unit").discrete();
  joints.output("q_own", q_own_, "rad", "position of the robot's own motion, without this unit").discrete();
  joints.output("q_sent", q_sent_, "rad", "commanded position that was sent last, with the synchronisation").discrete();
  joints.output("e", e_, "rad", "discrepancy between q_command and the robot, from which the synchronisation corrects")
      .discrete();
  v.output("F_e", F_e_, "1", "external force and moment at the tool, as reported, x y z each, in N and N.m; else 0").discrete();
  v.output("p", p_, "m", "position of the tool, as reported").discrete();
  v.output("quat", quat_, "1", "orientation of the tool, as reported, (w, x, y, z)").discrete();
  if (protocol_ == fri::Protocol::kLwr) krl_.declare_outputs(v, "krl", "from the robot's program, $FRI_TO");
  reads_.declare_output(v, "io_value", "I/O values of the robot");
  counts_.declare(v);
  v.output("losses", losses_, "how often the connection was lost");

  v.parameter("address", address_, "IPv4 address of this machine that messages come to; 0.0.0.0: any");
  v.parameter("port", port_, "UDP port that messages come to; 0: the system chooses").range(0, 65535);
  v.parameter(
      "controller", controller_,
      "IPv4 address of the robot's controller, perhaps with :port; messages of others are rejected; empty: the first sender's");
  v.parameter("mode", mode_text_,
              "what is commanded: monitor (nothing), position, torque, wrench (added to positions), joint_impedance or "
              "cartesian_impedance (LWR: with stiffness and damping)");
  v.parameter("timeout", timeout_, "s",
              "without a message for this time, or twenty send periods if that is longer, the robot is not connected")
      .range(1e-3, 3600);
  v.parameter("wait", wait_, "s", "initialisation waits so long for the first message of the robot; 0: not").range(0, 3600);
  v.parameter("dq_cutoff", dq_cutoff_, "Hz", "cutoff frequency of the first-order low-pass of dq; 0: no filter").range(0, 1e6);
  joints
      .parameter("dq_command_max", dq_command_max_, "rad/s",
                 "speed limit of commanded positions, from the URDF; a twin that is elsewhere is approached with it; 0: none")
      .range(0, 1e9);
  v.parameter("v_command_max", v_command_max_, "m/s", "mode=cartesian_impedance: speed limit of p_command").range(1e-6, 1e9);
  v.parameter("w_command_max", w_command_max_, "rad/s", "mode=cartesian_impedance: speed limit of quat_command")
      .range(1e-6, 1e9);
  v.tunable("command", command_, "q_command and the rest are followed; false: the last commanded position is held");
  v.tunable("K_P", K_P_, "1", "proportional gain of the synchronisation of robot and twin").range(-0.999, 1e3);
  v.tunable("K_D", K_D_, "s", "derivative gain of the synchronisation").range(-1e3, 1e3);
  v.tunable("stiffness", stiffness_, "N.m/rad", "mode=joint_impedance: stiffness of the robot's joints").range(0, 1e9);
  v.tunable("damping", damping_, "1", "mode=joint_impedance: damping ratio of the robot's joints").range(0, 1);
  v.tunable("cartesian_stiffness", cartesian_stiffness_, "1",
            "mode=cartesian_impedance: stiffness x y z in N/m, about x y z in N.m/rad")
      .range(0, 1e9);
  v.tunable("cartesian_damping", cartesian_damping_, "1", "mode=cartesian_impedance: damping ratios").range(0, 1);
  v.tunable("tau_e_gated", tau_e_gated_,
            "tau_e is given only while the robot follows commands, else 0: a guided twin does not move away from a robot that "
            "does not follow");
}

void FriLink::open() {
  mode_ = text::choose<Mode>(kPlace + ": mode", mode_text_,
                             {{"monitor", Mode::kMonitor},
                              {"position", Mode::kPosition},
                              {"torque", Mode::kTorque},
                              {"wrench", Mode::kWrench},
                              {"joint_impedance", Mode::kJointImpedance},
                              {"cartesian_impedance", Mode::kCartesianImpedance}});
  if (mode_ >= Mode::kJointImpedance && protocol_ != fri::Protocol::kLwr) {
    throw Error(kPlace + ": mode", "'" + mode_text_ + "' with protocol " + fri::to_text(protocol_) +
                                       ", expected it only with lwr: Sunrise's robot program sets the impedance");
  }
  fri::ClientSettings settings;
  settings.protocol = protocol_;
  settings.joints = n_;
  if (!controller_.empty()) settings.controller = net::endpoint_of(controller_, 0, kPlace + ": controller");
  settings.timeout = Duration::from_seconds(timeout_).ns;
  client_.emplace(settings, kPlace);
  net::Endpoint local = net::endpoint_of(address_, 0, kPlace + ": address");
  local.port = static_cast<std::uint16_t>(port_);
  datagrams_.open(local, kPlace + ": address, port");
  datagrams_.set_source(settings.controller, protocol_ == fri::Protocol::kLwr ? 16 : 32,
                        [this](auto bytes) { return stamp(bytes); });
  datagrams_.set_period(0);
}

std::optional<DatagramQueue::Stamp> FriLink::stamp(std::span<const std::uint8_t> bytes) {
  if (fri::decode(protocol_, bytes, n_, seen_) != fri::Fault::kNone) return std::nullopt;
  constexpr double kMicroseconds = 1e6;  // of a period that is a single float
  return DatagramQueue::Stamp{seen_.counter, std::llround(seen_.send_period * kMicroseconds) * 1000};
}

void FriLink::initialise(Time start, Measured& measured) {
  open();
  measured.warning.reserve(256);
  for (std::vector<double>* values :
       {&measured.q, &measured.dq, &measured.ddq, &measured.tau, &measured.tau_e, &q_robot_, &q_own_, &q_sent_, &e_}) {
    std::ranges::fill(*values, 0);
  }
  measured.has_tau = measured.has_tau_e = true;
  measured.fresh = measured.done = false;
  connected_ = commanding_ = following_ = was_connected_ = false;
  state_ = quality_ = command_mode_ = losses_ = 0;
  t_robot_ = period_ = lost_time_ = 0;
  F_e_ = {};
  p_ = {};
  quat_ = {1, 0, 0, 0};
  counts_ = {};
  position_ = answered_ = -1;
  host_ = monotonic_now();
  at_ = start.ns;
  waiting_ = false;
  if (wait_ <= 0) return;
  const Command nothing(n_);  // the robot's position is held
  waiting_ = true;
  const std::int64_t deadline = host_ + Duration::from_seconds(wait_).ns;
  while (!measured.fresh) {
    if (!datagrams_.wait_for_any(deadline)) {
      throw Error("unit:io.wait", "no message of a robot came to " + net::to_text(datagrams_.local()) + " within " +
                                      text::to_text(wait_) + " s, expected a controller with protocol " +
                                      fri::to_text(protocol_) + " that sends there");
    }
    while (const auto datagram = datagrams_.receive()) {
      if (take(*datagram, start.ns, start.ns, nothing)) measure(measured);
    }
  }
  waiting_ = false;
  datagrams_.set_period(std::llround(period_ * 1e6) * 1000);
  host_ = monotonic_now();
  write_outputs(start.ns);
}

StepResult FriLink::step(Time now, Duration h, const Command& command, Measured& measured) {
  measured.fresh = false;
  for (std::size_t left = datagrams_.waiting(); left > 0; --left) {
    const auto datagram = datagrams_.receive();
    const std::int64_t arrival = scenario_time(datagram->arrival, host_, at_, now.ns);
    if (take(*datagram, arrival, now.ns, command)) measure(measured);
  }
  host_ = monotonic_now();
  at_ = now.ns;
  if (connected_ && !client_->connected(now.ns)) note_loss(measured);
  write_outputs(now.ns);
  if (was_connected_ && !connected_) lost_time_ += h.seconds();
  return StepResult::kDone;
}

/// Whether there is a new message; it is answered.
bool FriLink::take(const DatagramQueue::Datagram& datagram, std::int64_t arrival, std::int64_t now, const Command& command) {
  const auto reception = client_->receive(datagram.bytes, datagram.from, arrival);
  if (reception == fri::Client::Reception::kRefused) return false;
  if (reception == fri::Client::Reception::kAnswerDue) {
    choose_command(command);
    datagrams_.send(client_->answer(wanted_, now), client_->controller());
  }
  return client_->statistics().monitoring.newest() != position_;
}

void FriLink::choose_command(const Command& command) {
  const fri::Monitoring& m = client_->monitoring();
  const std::int64_t newest = client_->statistics().monitoring.newest();
  const double elapsed =
      m.send_period * static_cast<double>(answered_ >= 0 ? std::max<std::int64_t>(newest - answered_, 0) : 1);
  answered_ = newest;
  wanted_.joints = static_cast<std::uint32_t>(n_);
  wanted_.fields = fri::Command::kPosition;
  if (mode_ == Mode::kTorque || mode_ == Mode::kJointImpedance) wanted_.fields |= fri::Command::kTorque;
  if (mode_ == Mode::kWrench) wanted_.fields |= fri::Command::kWrench;
  if (mode_ == Mode::kJointImpedance) wanted_.fields |= fri::Command::kJointStiffness | fri::Command::kJointDamping;
  if (mode_ == Mode::kCartesianImpedance) {
    wanted_.fields =
        fri::Command::kPose | fri::Command::kWrench | fri::Command::kCartesianStiffness | fri::Command::kCartesianDamping;
  }
  std::ranges::copy(stiffness_, wanted_.joint_stiffness.begin());
  std::ranges::copy(damping_, wanted_.joint_damping.begin());
  for (int i = 0; i < 6; ++i) {
    const auto k = static_cast<std::size_t>(i);
    wanted_.cartesian_stiffness[i] = cartesian_stiffness_[k];
    wanted_.cartesian_damping[i] = cartesian_damping_[k];
  }
  krl_command_.write(wanted_.krl);
  writes_.write(wanted_.ios);
  follow(command, elapsed);
}

void FriLink::follow(const Command& command, double elapsed) {
  const fri::Monitoring& m = client_->monitoring();
  const Synchronisation::Gains gains{K_P_, K_D_, dq_command_max_};
  const fri::Joints& robot = m.has(fri::Monitoring::kInterpolatorPosition) && protocol_ != fri::Protocol::kLwr
                                 ? m.q_interpolator
                             : m.has(fri::Monitoring::kCommandedPosition) ? m.q_commanded
                                                                          : m.q_measured;
  const bool commanding = client_->commanding() && mode_ != Mode::kMonitor;
  const bool follows = commanding && command_ && !waiting_;
  if (!commanding) {
    synchronisation_.start({robot.data(), n_});
    wanted_.X = m.X_commanded;
  } else if (!following_) {
    // Commanding begins at the last position sent before it.
    const fri::Command& sent = client_->sent();
    synchronisation_.start({sent.has(fri::Command::kPosition) ? sent.q.data() : robot.data(), n_});
    if (sent.has(fri::Command::kPose)) wanted_.X = sent.X;
  } else if (!follows) {
    std::copy_n(synchronisation_.last().begin(), n_, q_sent_.begin());
    synchronisation_.start(q_sent_);
  }
  following_ = commanding;
  wanted_.tau = {};
  wanted_.F.setZero();
  if (follows) {
    synchronisation_.command(command.q, gains, elapsed);
    synchronisation_.measure(command.q, {m.q_measured.data(), n_}, gains, elapsed);
    std::ranges::copy(command.tau, wanted_.tau.begin());
    for (int i = 0; i < 6; ++i) wanted_.F[i] = F_command_[static_cast<std::size_t>(i)];
    wanted_.X = approach(wanted_.X, pose_of(p_command_, quat_command_), v_command_max_ * elapsed, w_command_max_ * elapsed);
  }
  std::ranges::copy(synchronisation_.last(), wanted_.q.begin());
}

void FriLink::measure(Measured& measured) {
  const fri::Monitoring& m = client_->monitoring();
  const std::int64_t newest = client_->statistics().monitoring.newest();
  const double elapsed = position_ >= 0 ? m.send_period * static_cast<double>(newest - position_) : 0;
  position_ = newest;
  const double old = dq_cutoff_ > 0 ? std::exp(-2 * std::numbers::pi * dq_cutoff_ * elapsed) : 0;
  measured.has_tau = m.has(fri::Monitoring::kMeasuredTorque);
  measured.has_tau_e = m.has(fri::Monitoring::kExternalTorque);
  const bool gives_tau_e = measured.has_tau_e && (!tau_e_gated_ || (following_ && command_));
  for (std::size_t i = 0; i < n_; ++i) {
    if (elapsed > 0) {
      const double raw = (m.q_measured[i] - measured.q[i]) / elapsed;
      const double dq = raw + old * (measured.dq[i] - raw);
      measured.ddq[i] = (dq - measured.dq[i]) / elapsed;
      measured.dq[i] = dq;
    }
    measured.q[i] = m.q_measured[i];
    measured.tau[i] = measured.has_tau ? m.tau_measured[i] : 0;
    measured.tau_e[i] = gives_tau_e ? m.tau_external[i] : 0;
    if (m.has(fri::Monitoring::kCommandedPosition)) q_robot_[i] = m.q_commanded[i];
    if (m.has(fri::Monitoring::kInterpolatorPosition)) q_own_[i] = m.q_interpolator[i];
  }
  measured.fresh = true;
  period_ = m.send_period;
  if (m.has(fri::Monitoring::kTime)) t_robot_ = static_cast<double>(m.time) / 1e9;
  if (m.has(fri::Monitoring::kMeasuredPose)) write(m.X_measured, p_, quat_);
  if (m.has(fri::Monitoring::kExternalWrench)) Eigen::Map<Wrench>(F_e_.data()) = m.F_external;
  krl_.read(m.krl);
  reads_.read(m.ios);
}

void FriLink::note_loss(Measured& measured) {
  ++losses_;
  position_ = answered_ = -1;
  following_ = false;
  std::ranges::fill(measured.dq, 0);
  std::ranges::fill(measured.ddq, 0);
  std::ranges::fill(measured.tau_e, 0);
  F_e_ = {};
  measured.warning.assign(kSilent);
}

void FriLink::write_outputs(std::int64_t now) {
  connected_ = client_->connected(now);
  was_connected_ = was_connected_ || connected_;
  state_ = static_cast<std::int32_t>(client_->state(now));
  quality_ = connected_ ? static_cast<std::int32_t>(client_->monitoring().quality) : 0;
  commanding_ = connected_ && following_ && command_;
  command_mode_ = static_cast<std::int32_t>(client_->monitoring().command_mode);
  std::copy_n(client_->sent().q.begin(), n_, q_sent_.begin());
  std::ranges::copy(synchronisation_.discrepancy(), e_.begin());
  counts_.read(client_->statistics());
}

void FriLink::tell(std::vector<std::string>& sentences) const {
  if (!was_connected_) {
    sentences.push_back("no message of a robot came to " + net::to_text(datagrams_.local()) + " (" + fri::to_text(protocol_) +
                        ")");
    return;
  }
  sentences.push_back("robot: " + std::to_string(counts_.received) + " messages, " + std::to_string(counts_.lost) + " lost, " +
                      std::to_string(counts_.answers) + " answers");
  if (losses_ > 0) {
    sentences.push_back("the robot was silent " + std::to_string(losses_) + " times, for " + text::to_text(lost_time_, 3) +
                        " s beyond timeout");
  }
}

}  // namespace cotwin::io
