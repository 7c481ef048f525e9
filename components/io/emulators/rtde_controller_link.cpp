#include "components/io/emulators/rtde_controller_link.h"

#include <algorithm>
#include <cmath>

#include "components/io/link/finite.h"
#include "components/io/link/fri_values.h"
#include "components/io/rtde/pose.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::io {

namespace {

const std::string kRtdeControllerPlace = "unit:io?link=rtde_controller";
constexpr double kNoLimit = 1e9;    // rad
constexpr double kMostSpeed = 1e3;  // rad/s

std::array<double, 6> six(const Eigen::Matrix<double, 6, 1>& x) { return {x[0], x[1], x[2], x[3], x[4], x[5]}; }

rtde::Joints joints_of(const std::vector<double>& x) {
  rtde::Joints joints{};
  std::ranges::copy(x, joints.begin());
  return joints;
}

}  // namespace

RtdeControllerLink::RtdeControllerLink(Settings& settings, const std::vector<trajectory::Axis>& joints)
    : q_(rtde::kJoints),
      dq_(rtde::kJoints),
      tau_(rtde::kJoints),
      tau_e_(rtde::kJoints),
      q_d_(rtde::kJoints),
      torque_per_current_(rtde::kJoints, 10.0),
      q_command_(rtde::kJoints),
      dq_command_(rtde::kJoints) {
  if (joints.size() != rtde::kJoints) {
    throw Error(kRtdeControllerPlace, std::to_string(joints.size()) + " joints, expected 6, as RTDE has them");
  }
  for (const trajectory::Axis& axis : joints) {
    q_min_.push_back(finite(axis.q_min, -kNoLimit));
    q_max_.push_back(finite(axis.q_max, kNoLimit));
    dq_max_.push_back(finite(axis.dq_max, kMostSpeed));
  }
  if (settings.robot_used() != nullptr) kinematics_.emplace(*settings.robot_used());
}

void RtdeControllerLink::declare(Variables& v, JointVariables& joints) {
  joints.input("q", q_, "rad", "measured joint position of the emulated robot").essential();
  joints.input("dq", dq_, "rad/s", "measured joint velocity of the emulated robot");
  joints.input("tau", tau_, "N.m", "measured joint torque of the emulated robot: actual_current_as_torque, target_moment");
  joints.input("tau_e", tau_e_, "N.m",
               "external joint torque of the emulated robot; with a robot's URDF, actual_TCP_force is the force at the flange "
               "that exerts it");
  joints.input("q_d", q_d_, "rad", "position of the robot's own motion, if hold is false and the program does not run");
  v.input("digital_in", digital_in_, "digital inputs: bits 0 to 7 standard, 8 to 15 configurable, 16 and 17 tool");
  v.input("analog_in", analog_in_, "1", "analog inputs 0 and 1, in V or A by their type");
  v.input("double_out", double_out_, "1", "output double registers 0 to 47 of the robot's program");
  v.input("int_out", int_out_,
          "output int registers 0 to 47 of the robot's program; 24 and 25 are those of the following program");

  joints.output("q_command", q_command_, "rad", "position that the robot's drives have to follow");
  joints.output("dq_command", dq_command_, "rad/s", "its rate").discrete();
  v.output("active", active_, "whether the robot follows a client");
  v.output("state", state_,
           "of the program that follows registers: 0 off, 1 waiting, 2 following, 3 stopped after a loss of commands, 4 "
           "commands too far, 5 waiting for the end of a request from before");
  v.output("losses", losses_, "how often the robot stopped because of lost commands");
  v.output("clients", clients_, "clients that are started");
  v.output("listening_port", listening_port_, "TCP port of the controller");
  v.output("digital_out", digital_out_, "digital outputs, as clients have set them, bits as digital_in");
  v.output("analog_out", analog_out_, "1", "analog outputs 0 and 1, in V or A by the type that clients have set").discrete();
  v.output("speed_fraction", speed_fraction_, "1", "speed slider, which scales the speed limit while following").discrete();
  v.output("double_in", double_in_, "1", "input double registers 0 to 47").discrete();
  v.output("int_in", int_in_, "input int registers 0 to 47");
  v.output("sent", sent_, "data packages for clients");
  v.output("dropped", dropped_, "data packages that were left out because a client had not read the last one");
  v.output("received", received_, "input packages of clients");
  v.output("rejected", rejected_,
           "input packages with a wrong size, an unknown recipe, a number that is not finite, or before the start");
  v.output("faults", faults_, "other packages that could not be read");
  v.output("refused", refused_, "connections beyond four at once");

  v.parameter("address", address_,
              "IPv4 address of this machine that clients connect to; 127.0.0.1: from this machine only; 0.0.0.0: any");
  v.parameter("port", port_, "TCP port that clients connect to; 0: the system chooses").range(0, 65535);
  v.parameter("frequency", frequency_, "Hz",
              "control cycles and fastest data packages: 500 e-Series, 125 CB3; below 200 version and force are those of a CB3")
      .range(1, 1000);
  joints.parameter("q_min", q_min_, "rad", "lower limit of the motion, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("q_max", q_max_, "rad", "upper limit of the motion, from the URDF").range(-kNoLimit, kNoLimit);
  joints.parameter("dq_max", dq_max_, "rad/s", "speed limit of the motion, from the URDF").range(0, kMostSpeed);
  v.parameter("ddq_max", acceleration_, "rad/s2", "limit of acceleration while following").range(1e-3, 1e6);
  v.parameter("lookahead", lookahead_, "s", "time constant of the smoothing of commands").range(0, 10);
  v.parameter("loss_time", loss_time_, "s", "without a new command for this time, the robot stops").range(0, 3600);
  v.parameter("stop_time", stop_time_, "s", "time from full speed to rest").range(0, 10);
  v.parameter("near", near_, "rad", "largest distance of the first command from the robot").range(0, 100);
  v.parameter("torque_per_current", torque_per_current_, "N.m/A",
              "joint torque per motor current, for the currents that are reported (assumed)")
      .range(1e-6, 1e6);
  v.parameter("tcp_offset", tcp_offset_, "1", "pose of the TCP in the flange: x y z in m and the rotation vector in rad");
  v.parameter("hold", hold_, "without a client the robot rests; false: it moves to q_d while the program does not run");
  v.tunable("ready", ready_, "the robot runs; false: protective stop");
  v.tunable("program", program_, "the program that follows registers runs");
}

void RtdeControllerLink::check_start() const {
  constexpr double kRounding = 1e-9;  // rad
  for (std::size_t i = 0; i < rtde::kJoints; ++i) {
    if (q_min_[i] - kRounding <= q_[i] && q_[i] <= q_max_[i] + kRounding) continue;
    throw Error(kRtdeControllerPlace + ": q", "joint " + std::to_string(i + 1) + " begins at " + text::to_text(q_[i]) +
                                                  " rad, expected a position within q_min and q_max, " +
                                                  text::to_text(q_min_[i]) + " to " + text::to_text(q_max_[i]) + " rad");
  }
}

void RtdeControllerLink::initialise(Time start, Measured&) {
  check_start();
  const std::string wanted = address_ + ":" + std::to_string(port_);
  if (!listener_ || listens_at_ != wanted) {
    listener_.reset();
    net::Endpoint local = net::endpoint_of(address_, 0, kRtdeControllerPlace + ": address");
    local.port = static_cast<std::uint16_t>(port_);
    listener_.emplace(local, kRtdeControllerPlace + ": address, port");
    listens_at_ = wanted;
  }
  listening_port_ = listener_->local().port;
  for (net::TcpStream& stream : streams_) stream.close();
  rtde::ControllerSettings settings;
  settings.frequency = frequency_;
  if (is_cb3()) settings.version = {3, 15, 0, 0};
  controller_.emplace(settings);
  rtde::FollowerSettings follower;
  follower.lower = joints_of(q_min_);
  follower.upper = joints_of(q_max_);
  follower.speed = joints_of(dq_max_);
  follower.acceleration = acceleration_;
  follower.lookahead = lookahead_;
  follower.loss_time = loss_time_;
  follower.stop_time = stop_time_;
  follower.near = near_;
  follower_.emplace(follower);
  follower_->start(joints_of(q_), *controller_);
  before_ = follower_->q();
  start_ = start;
  cycles_ = 0;
  // What the emulation keeps constant. Other quantities that it does not compute are 0.
  rtde::Controller& c = *controller_;
  c.at("target_speed_fraction") = 1;
  c.at("actual_main_voltage") = c.at("actual_robot_voltage") = 48;
  c.at("safety_status") = c.at("safety_mode") = 1;
  c.at("time_scale_source") = -1;
  constexpr std::array<double, 6> kJointRunning{253, 253, 253, 253, 253, 253}, kCelsius{25, 25, 25, 25, 25, 25},
      kVolts{48, 48, 48, 48, 48, 48};
  set("joint_mode", kJointRunning);
  set("joint_temperatures", kCelsius);
  set("actual_joint_voltage", kVolts);
  c.at("tool_temperature") = 25;
  c.at("tool_mode") = 255;  // idle
  set("tcp_offset", tcp_offset_);
  measure();
  write_outputs(start);
}

void RtdeControllerLink::set(std::string_view name, std::span<const double> values) {
  std::ranges::copy(values, &controller_->at(name));
}

std::array<double, 6> RtdeControllerLink::tcp_speed(std::span<const double> q, std::span<const double> dq) {
  const Pose X_BE = kinematics_->pose(q);
  const Eigen::Vector3d p = X_BE * rtde::from_ur_pose(tcp_offset_).p;
  kinematics_->jacobian(q);
  Twist V = kinematics_->twist(dq);
  V.head<3>() += V.tail<3>().cross(p - X_BE.p);
  return six(V);
}

StepResult RtdeControllerLink::step(Time now, Duration h, const Command&, Measured&) {
  receive();
  measure();
  const double period = 1e9 / frequency_;  // ns
  while (static_cast<double>(cycles_) * period < static_cast<double>((now + h - start_).ns)) {
    cycle(start_ + Duration{std::llround(static_cast<double>(cycles_) * period)});
    ++cycles_;
  }
  write_outputs(now + h);
  return StepResult::kDone;
}

void RtdeControllerLink::receive() {
  while (std::optional<net::TcpStream> stream = listener_->accept()) {
    if (const int client = controller_->connect(); client >= 0) streams_[static_cast<std::size_t>(client)] = std::move(*stream);
  }
  for (std::size_t i = 0; i < streams_.size(); ++i) {
    if (!controller_->connected(i)) continue;
    // A bound, so that a client that sends without end does not hold the robot up.
    for (int pieces = 0; pieces < 8; ++pieces) {
      const std::size_t size = streams_[i].receive(controller_->space(i));
      if (size == 0) break;
      controller_->received(i, size);
      flush(i);
      if (controller_->broken(i)) break;
    }
    flush(i);
    if (controller_->broken(i) || streams_[i].state() == net::TcpStream::State::kClosed) drop(i);
  }
}

void RtdeControllerLink::flush(std::size_t client) {
  controller_->sent(client, streams_[client].send(controller_->waiting(client)));
}

void RtdeControllerLink::drop(std::size_t client) {
  controller_->disconnect(client);
  streams_[client].close();
}

void RtdeControllerLink::measure() {
  rtde::Controller& c = *controller_;
  set("actual_q", q_);
  set("actual_qd", dq_);
  set("actual_current_as_torque", tau_);
  set("target_moment", tau_);
  for (std::size_t i = 0; i < rtde::kJoints; ++i) {
    const double current = tau_[i] / torque_per_current_[i];
    c.at("actual_current", i) = c.at("target_current", i) = c.at("joint_control_output", i) = current;
  }
  c.at("actual_digital_input_bits") = static_cast<double>(static_cast<std::uint32_t>(digital_in_) & 0x3ffffu);
  c.at("actual_configurable_digital_input_bits") = static_cast<double>(static_cast<std::uint32_t>(digital_in_) >> 8 & 0xffu);
  c.at("standard_analog_input0") = analog_in_[0];
  c.at("standard_analog_input1") = analog_in_[1];
  set("output_double_register_0", double_out_);
  std::ranges::copy(int_out_, &c.at("output_int_register_0"));
  c.at("output_int_register_24") = c.at("input_int_register_24");
  c.at("output_int_register_25") = static_cast<double>(follower_->state());
  c.at("robot_mode") = 7;                                        // running
  c.at("safety_mode") = c.at("safety_status") = ready_ ? 1 : 3;  // normal, protective stop
  c.at("safety_status_bits") = ready_ ? 1 : 1 << 2 | 1 << 10;
  c.at("runtime_state") = program_ && ready_ ? 2 : 1;  // playing, stopped
  c.at("robot_status_bits") = program_ && ready_ ? 3 : 1;
  c.at("speed_scaling") = ready_ ? c.at("target_speed_fraction") : 0;
  if (!kinematics_) return;
  const Pose X_BE = kinematics_->pose(q_), X = X_BE * rtde::from_ur_pose(tcp_offset_);
  const Wrench at_flange = kinematics_->wrench_of(tau_e_, q_);
  const Wrench F = is_cb3() ? moved(at_flange, X_BE.p, X.p) : at_flange;
  set("actual_TCP_pose", rtde::to_ur_pose(X));
  set("actual_TCP_speed", tcp_speed(q_, dq_));
  set("actual_TCP_force", six(F));
  set("ft_raw_wrench", six(at_flange));
  c.at("tcp_force_scalar") = F.head<3>().norm();
}

void RtdeControllerLink::cycle(Time at) {
  rtde::Controller& c = *controller_;
  before_ = follower_->q();
  const rtde::Joints dq_before = follower_->dq(), own = joints_of(q_d_);
  follower_->cycle(c, 1 / frequency_, ready_ && program_, hold_ ? nullptr : &own);
  c.at("timestamp") = (at - start_).seconds();
  set("target_q", follower_->q());
  set("target_qd", follower_->dq());
  for (std::size_t i = 0; i < rtde::kJoints; ++i) c.at("target_qdd", i) = (follower_->dq()[i] - dq_before[i]) * frequency_;
  if (kinematics_) {
    const Pose X = kinematics_->pose(follower_->q()) * rtde::from_ur_pose(tcp_offset_);
    set("target_TCP_pose", rtde::to_ur_pose(X));
    set("target_TCP_speed", tcp_speed(follower_->q(), follower_->dq()));
  }
  c.cycle();
  for (std::size_t i = 0; i < streams_.size(); ++i) {
    if (c.connected(i)) flush(i);
  }
}

void RtdeControllerLink::write_outputs(Time at) {
  rtde::Controller& c = *controller_;
  // The last cycle's set point holds one cycle after its begin.
  const double since = (at - start_).seconds() * frequency_ - static_cast<double>(cycles_ - 1);
  const double share = std::clamp(cycles_ > 0 ? since : 1.0, 0.0, 1.0);
  for (std::size_t i = 0; i < rtde::kJoints; ++i) {
    q_command_[i] = before_[i] + share * (follower_->q()[i] - before_[i]);
    dq_command_[i] = follower_->dq()[i];
  }
  state_ = static_cast<std::int32_t>(follower_->state());
  active_ = follower_->state() == rtde::FollowState::kFollowing;
  losses_ = saturated(follower_->losses());
  clients_ = static_cast<std::int32_t>(c.started());
  digital_out_ = static_cast<std::int32_t>(c.at("actual_digital_output_bits"));
  analog_out_ = {c.at("standard_analog_output0"), c.at("standard_analog_output1")};
  speed_fraction_ = c.at("target_speed_fraction");
  std::copy_n(&c.at("input_double_register_0"), kRegisters, double_in_.begin());
  std::transform(&c.at("input_int_register_0"), &c.at("input_int_register_0") + kRegisters, int_in_.begin(),
                 [](double x) { return static_cast<std::int32_t>(x); });
  const rtde::ControllerStatistics& s = c.statistics();
  sent_ = saturated(s.sent);
  dropped_ = saturated(s.dropped);
  received_ = saturated(s.received);
  rejected_ = saturated(s.rejected);
  faults_ = saturated(s.faults);
  refused_ = saturated(s.refused);
}

void RtdeControllerLink::append_notes(std::vector<std::string>& sentences) const {
  if (!controller_) return;
  const rtde::ControllerStatistics& s = controller_->statistics();
  sentences.push_back("RTDE at " + net::to_text(listener_->local()) + ": " +
                      text::counted(static_cast<std::int64_t>(s.clients), "client") + ", " +
                      text::counted(static_cast<std::int64_t>(s.sent), "data package") + " sent, " + std::to_string(s.dropped) +
                      " left out, " + text::counted(static_cast<std::int64_t>(s.received), "input package") + ", " +
                      text::counted(static_cast<std::int64_t>(s.rejected + s.faults), "package") + " refused");
  if (losses_ > 0) sentences.push_back("the robot stopped " + text::counted(losses_, "time") + " because of lost commands");
}

}  // namespace cotwin::io
