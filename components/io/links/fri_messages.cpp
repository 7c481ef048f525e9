// What is used of the messages of a KUKA robot: fri_link.h.
#include <Eigen/Geometry>
#include <utility>

#include "components/io/fri/finite.h"
#include "components/io/links/fri_link.h"

namespace cotwin::io {

namespace {

/// Keeps what there is if the matrix is no rotation.
void write(const Pose& X, std::array<double, 3>& p, std::array<double, 4>& quat) {
  if (!fri::is_nearly_rotation(X.R)) return;
  const Eigen::Quaterniond Q = Eigen::Quaterniond(X.R).normalized();
  p = {X.p.x(), X.p.y(), X.p.z()};
  quat = {Q.w(), Q.x(), Q.y(), Q.z()};
}

std::array<double, 12> numbers_of(const Pose& X) {
  std::array<double, 12> x;
  Eigen::Map<Eigen::Matrix3d>(x.data()) = X.R;
  Eigen::Map<Eigen::Vector3d>(x.data() + 9) = X.p;
  return x;
}
Pose pose_of(const std::array<double, 12>& x) {
  return {Eigen::Map<const Eigen::Matrix3d>(x.data()), Eigen::Map<const Eigen::Vector3d>(x.data() + 9)};
}

}  // namespace

void FriLink::add_numbers() {
  numbers_.add(BelievedNumbers::Kind::kState, kPose);
  numbers_.add(BelievedNumbers::Kind::kNumber, kBoolean - kPose);
  numbers_.add(BelievedNumbers::Kind::kBits);
}

/// Whether a motion explains the position of the newest message; otherwise it counts as lost. A robot that jumps is somewhere else than the
/// command: it is followed there.
bool FriLink::is_believed() {
  const fri::Monitoring& m = client_->monitoring();
  const std::int64_t newest = client_->statistics().monitoring.newest();
  if (newest == position_ || newest == offered_) return newest == position_;
  const bool same_period = position_ < 0 || m.send_period == period_;
  const bool possible = offered_ < 0 || position_ >= 0 || m.send_period == offered_period_;
  offered_period_ = m.send_period;
  const double period = position_ < 0 ? m.send_period : period_;
  const double elapsed = offered_ >= 0 ? period * static_cast<double>(newest - offered_) : 0;
  offered_ = newest;
  const Belief::Verdict verdict = belief_.add({m.q_measured.data(), n_}, elapsed, same_period, possible);
  if (verdict == Belief::Verdict::kJump) {
    demand_acknowledgement();
    begins_ = true;
    position_ = -1;  // no speed leads there
    if (!yields_) set_point_.forget();
  }
  // While nothing is commanded a stop gets through.
  if (!belief_.is_held() || position_ < 0) {
    read_torques();
    read_others();
  }
  examine_set_point(elapsed);
  return !belief_.is_held();
}

void FriLink::read_torques() {
  const fri::Monitoring& m = client_->monitoring();
  const std::span<const double> tau{m.tau_measured.data(), n_}, tau_external{m.tau_external.data(), n_};
  const char* why = m.has(fri::Monitoring::kMeasuredTorque) ? tau_.add(tau) : nullptr;
  if (m.has(fri::Monitoring::kExternalTorque)) {
    if (const char* const external = tau_external_.add(tau_external)) why = external;
  }
  if (m.has(fri::Monitoring::kExternalWrench)) {
    const std::span<const double> F{m.F_external.data(), 6};
    fri::Joints of_F{};
    if (kinematics_) kinematics_->torques_of(m.F_external, {m.q_measured.data(), n_}, {of_F.data(), n_});
    const char* const force = F_external_.add(kinematics_ ? std::span<const double>(of_F.data(), n_) : F, F);
    if (force != nullptr) why = force;
    for (std::size_t i = 0; i < 6; ++i) F_e_[i] = F_external_.along(i);
  }
  if (why != nullptr) belief_.count_implausible(why);
}

/// States, the pose, variables of the robot's program, I/O values.
void FriLink::read_others() {
  fri::Monitoring m = client_->monitoring();
  numbers_.put(kState, static_cast<int>(m.state));
  numbers_.put(kQuality, static_cast<int>(m.quality));
  numbers_.put(kSafety, static_cast<int>(m.safety));
  numbers_.put(kCommandMode, static_cast<int>(m.command_mode));
  const auto control = static_cast<fri::ControlMode>(numbers_.put(kControl, static_cast<int>(m.control)));
  yields_ = m.has(fri::Monitoring::kControlMode) &&
            (control == fri::ControlMode::kCartesianImpedance || control == fri::ControlMode::kJointImpedance);
  const int mode = m.has(fri::Monitoring::kCommandMode) ? static_cast<int>(m.command_mode) : 0;
  takes_.see(client_->commanding() && drives() ? 1 + mode : 0);
  if (m.has(fri::Monitoring::kMeasuredPose)) {
    std::array<double, 12> x = numbers_of(m.X_measured);
    for (std::size_t i = 0; i < x.size(); ++i) x[i] = numbers_.put(kPose + i, x[i]);
    write(pose_of(x), p_, quat_);
  }
  for (std::size_t i = 0; i < krl_.real.size(); ++i) {
    m.krl.real[i] = static_cast<float>(numbers_.put(kReal + i, static_cast<double>(m.krl.real[i])));
    m.krl.integer[i] = static_cast<std::int32_t>(numbers_.put(kInteger + i, m.krl.integer[i]));
  }
  m.krl.boolean = static_cast<std::uint16_t>(numbers_.put(kBoolean, m.krl.boolean));
  krl_.read(m.krl);
  reads_.read(m.ios);
}

/// Where a command would begin: in the newest message it is replaced by what is believed.
void FriLink::examine_set_point(double elapsed) {
  fri::Monitoring& m = client_->monitoring();
  const bool measured = !belief_.is_held();
  const bool goes_on = client_->commanding() && drives() && (following_ || begins_);
  const bool own = m.has(fri::Monitoring::kInterpolatorPosition) && protocol_ != fri::Protocol::kLwr && !goes_on;
  const bool commanded = m.has(fri::Monitoring::kCommandedPosition);
  // The own motion, or the measured position, may be elsewhere than the commanded one.
  if (own != std::exchange(own_, own)) set_point_.forget();
  fri::Joints q = own ? m.q_interpolator : commanded ? m.q_commanded : m.q_measured;
  const char* const why = set_point_.take({q.data(), n_}, {m.q_measured.data(), n_}, elapsed, measured, yields_, following_);
  if (why != nullptr) belief_.count_implausible(why);
  if (own || commanded) (own ? m.q_interpolator : m.q_commanded) = q;
  Pose& X = protocol_ == fri::Protocol::kLwr ? m.X_commanded : m.X_interpolator;
  if (!m.has(protocol_ == fri::Protocol::kLwr ? fri::Monitoring::kCommandedPose : fri::Monitoring::kInterpolatorPose)) return;
  const Pose& beside = m.has(fri::Monitoring::kMeasuredPose) ? m.X_measured : X;
  std::array<double, 12> x = numbers_of(X);
  pose_.take(x, numbers_of(beside), elapsed, measured, true, following_);
  X = pose_of(x);
}

}  // namespace cotwin::io
