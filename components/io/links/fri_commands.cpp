// What the messages of a KUKA robot are answered: fri_link.h.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/io/fri/finite.h"
#include "components/io/links/fri_link.h"

namespace cotwin::io {

namespace {

constexpr double kMostBridged = 10;  // command periods without an answer that the robot bridges by extrapolation
constexpr double kLeastNorm = 1e-6;  // of a quaternion

/// Writes values if all are usable.
template <class From, class To>
bool copy_usable(const From& from, To& to) {
  if (!std::ranges::all_of(from, fri::is_usable)) return false;
  std::ranges::copy(from, to.begin());
  return true;
}

Pose pose_of(const std::array<double, 3>& p, const std::array<double, 4>& quat) {
  const Eigen::Quaterniond Q(quat[0], quat[1], quat[2], quat[3]);
  return {Q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
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

/// Takes the inputs that are usable. Whether all are.
bool FriLink::read_inputs(const Command& command) {
  bool all = true;
  if (mode_ == Mode::kCartesianImpedance) {
    const Eigen::Map<const Eigen::Vector4d> quat(quat_command_.data());
    const bool place = std::ranges::all_of(p_command_, fri::is_usable) && std::ranges::all_of(quat_command_, fri::is_usable) &&
                       quat.norm() > kLeastNorm;
    if (place) {
      inputs_.p = p_command_;
      inputs_.quat = quat_command_;
    }
    inputs_.has_place = inputs_.has_place || place;
    all = place;
  } else {
    const bool place = copy_usable(command.q, inputs_.q);
    inputs_.has_place = inputs_.has_place || place;
    all = place;
  }
  if (mode_ == Mode::kTorque || mode_ == Mode::kJointImpedance) all = copy_usable(command.tau, inputs_.tau) && all;
  if (mode_ == Mode::kWrench || mode_ == Mode::kCartesianImpedance) all = copy_usable(F_command_, inputs_.F) && all;
  return all;
}

void FriLink::choose_command() {
  const fri::Monitoring& m = client_->monitoring();
  const std::int64_t newest = client_->statistics().monitoring.newest();
  const double cycle = m.send_period * m.receive_multiplier;
  const double since =
      answered_ >= 0 ? m.send_period * static_cast<double>(std::max<std::int64_t>(newest - answered_, 0)) : cycle;
  // The robot's controller has extrapolated the last commands meanwhile, unless it reports that its set point has not gone on.
  if (const double pause = std::min(since - cycle, kMostBridged * cycle); follows_ && pause > 0) {
    double way = 0, whole = 0;
    for (std::size_t i = 0; i < n_; ++i) {
      const double speed = synchronisation_.speed()[i];
      way += speed * (m.q_commanded[i] - set_point_before_[i] - speed * cycle);
      whole += speed * speed * pause;
    }
    if (!m.has(fri::Monitoring::kCommandedPosition) || way > whole / 4) synchronisation_.go_on(pause);
  }
  set_point_before_ = m.q_commanded;
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
  copy_usable(stiffness_, wanted_.joint_stiffness);
  copy_usable(damping_, wanted_.joint_damping);
  copy_usable(cartesian_stiffness_, wanted_.cartesian_stiffness);
  copy_usable(cartesian_damping_, wanted_.cartesian_damping);
  follow(std::min(since, cycle));
  // Outputs and variables of the robot's program stay what they are until somebody acknowledges.
  wanted_.ios.count = 0;
  if (acknowledgement_.awaits()) return;
  krl_command_.write(wanted_.krl);
  writes_.write(wanted_.ios);
}

/// What the mode commands, one of fri::Command::fields.
std::uint32_t FriLink::quantity() const {
  switch (mode_) {
    case Mode::kTorque:
      return fri::Command::kTorque;
    case Mode::kWrench:
      return fri::Command::kWrench;
    case Mode::kCartesianImpedance:
      return fri::Command::kPose;
    default:
      return fri::Command::kPosition;
  }
}

/// Whether the robot may follow the inputs in the state of the newest message.
bool FriLink::may_follow() const {
  if (!command_ || waiting_ || refuses_ || !inputs_.has_place || acknowledgement_.awaits()) return false;
  return mode_ != Mode::kCartesianImpedance || fri::is_nearly_rotation(wanted_.X.R);
}

void FriLink::follow(double elapsed) {
  fri::Monitoring& m = client_->monitoring();
  const Synchronisation::Gains gains{K_P_, K_D_, dq_command_max_, ddq_command_max_};
  const bool own = m.has(fri::Monitoring::kInterpolatorPosition) && protocol_ != fri::Protocol::kLwr;
  const fri::Joints& place = m.has(fri::Monitoring::kCommandedPosition) ? m.q_commanded : m.q_measured;
  const fri::Joints& robot = own ? m.q_interpolator : place;
  const bool ends = following_ && takes_.value != followed_, pauses = following_ && !ends && !takes_.is_sure();
  if (ends) demand_acknowledgement();
  if (pauses) {  // what was asked for stays: the answer is that to the messages before
    m.state = fri::SessionState::kCommandingActive;
    if (takes_.value > 1) m.fields |= fri::Monitoring::kCommandMode;
    m.command_mode = static_cast<fri::ClientCommandMode>(takes_.value - 1);
  }
  const bool commanding = client_->commanding() && drives() && !ends;
  const bool begins = commanding && !following_ && takes_.value != 0 && takes_.is_sure() && set_point_.moves_alike();
  bool near = true;  // what was sent last
  if (!commanding) {
    synchronisation_.start({robot.data(), n_});
    wanted_.X = m.X_commanded;
  } else if (begins_) {
    synchronisation_.start({place.data(), n_});
    wanted_.X = m.X_commanded;
  } else if (!following_) {
    // Commanding begins at the last position sent before it.
    const fri::Command& sent = client_->sent();
    const bool sends = sent.has(fri::Command::kPosition);
    for (std::size_t i = 0; i < n_ && sends; ++i) near = near && std::abs(sent.q[i] - robot[i]) <= BelievedSetPoint::kFarthest;
    synchronisation_.start({sends && near ? sent.q.data() : robot.data(), n_});
    if (sent.has(fri::Command::kPose)) wanted_.X = sent.X;
  }
  if (begins && !(near && set_point_.believed() && pose_.believed())) demand_acknowledgement();
  following_ = commanding && (following_ || begins);
  if (begins) followed_ = takes_.value;
  refuses_ = commanding && (client_->taken() & quantity()) == 0;
  follows_ = following_ && !pauses && may_follow();
  begins_ = false;
  if (!pauses || acknowledgement_.awaits()) {
    wanted_.tau = {};
    wanted_.F.setZero();
  }
  if (follows_) {
    synchronisation_.command(inputs_.q, gains, elapsed);
    synchronisation_.measure(inputs_.q, {m.q_measured.data(), n_}, gains, elapsed);
    const double share = synchronisation_.share();
    std::ranges::transform(inputs_.tau, wanted_.tau.begin(), [&](double tau) { return share * tau; });
    wanted_.F = share * Eigen::Map<const Wrench>(inputs_.F.data());
    if (mode_ == Mode::kCartesianImpedance) {
      const double time = share * elapsed;
      wanted_.X = approach(wanted_.X, pose_of(inputs_.p, inputs_.quat), v_command_max_ * time, w_command_max_ * time);
    }
  } else if (commanding) {
    pauses ? synchronisation_.pause(gains, elapsed) : synchronisation_.rest(gains, elapsed);
  }
  std::ranges::copy(synchronisation_.last(), wanted_.q.begin());
  if (!commanding) return;
  // A message that newer ones have overtaken is answered with what belongs to it: the newer command would be a step of speed there.
  const fri::SequenceTracker& messages = client_->statistics().monitoring;
  const double age = m.send_period * static_cast<double>(messages.newest() - messages.position());
  for (std::size_t i = 0; i < n_; ++i) wanted_.q[i] -= synchronisation_.speed()[i] * age;
}

}  // namespace cotwin::io
