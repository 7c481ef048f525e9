// render=impedance: the motor torques directly, and how stiff an environment the admittance tolerates.
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>

#include "components/compliance/cartesian/cartesian_motion.h"
#include "components/compliance/contact_stiffness.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Quaterniond quaternion(const std::array<double, 4>& q) { return {q[0], q[1], q[2], q[3]}; }
std::array<double, 4> array(const Quaterniond& q) { return {q.w(), q.x(), q.y(), q.z()}; }

/// Where a frame was h seconds ago.
MovingPose earlier(const MovingPose& pose, const Twist& acceleration, double h) {
  const Twist back = -h * pose.V + h * h / 2 * acceleration;
  return {pose.p + back.head<3>(), quaternion_of(back.tail<3>()) * pose.Q, pose.V - h * acceleration};
}

}  // namespace

void CartesianMotion::start_impedance(const Measured& measured) { impedance_->start(measured.q, measured.theta); }

void CartesianMotion::impede(Links& links, const FromJoints& in, const robot::DriveParameters& drives, const Measured& measured,
                             const Joints& shaping, double h, Joints& tau_m) {
  const Motion d = desired(links, in);
  const Quaterniond Q_c = quaternion(quat_before_);
  // Measurements hold at the beginning of the step.
  ElasticFrame frame{.desired = earlier(d.pose, d.acceleration, h), .acceleration = d.acceleration};
  frame.R_BA = axes(frame.desired.Q, Q_c);
  const Matrix3d R_d = frame.desired.Q.toRotationMatrix();
  prepare(frame.R_BA, R_d, 0);
  frame.S_T = rendered_T_.S;
  frame.K_o = rendered_R_.S;
  frame.potential = potential_;
  const CartesianParameters& p = in_force_;
  const Matrix3d P_T = frame.R_BA.transpose() * P_T_ * frame.R_BA, P_R = R_d.transpose() * P_R_ * R_d;
  frame.D_T = P_T * symmetric(p.D_T, p.D_T_off) * P_T;
  frame.D_R = P_R * symmetric(p.D_R, p.D_R_off) * P_R;
  frame.zeta_T = p.zeta_T[0];
  frame.zeta_R = p.zeta_R[0];
  frame.omega_free = p.omega_free[0];
  frame.P_T = P_T;
  frame.P_R = P_R;
  impedance_->torque(links, joints_.frame(), frame, {in.q, 0, p.k_nu[0]}, drives, measured, shaping, tau_m);

  const Pose& X = impedance_->X;
  Quaterniond Q(X.R);
  if (Q.dot(Q_c) < 0) Q.coeffs() *= -1;  // ±Q without a jump
  Quaterniond Q_dc = frame.desired.Q.conjugate() * Q;
  if (Q_dc.w() < 0) Q_dc.coeffs() *= -1;
  const Twist rate = impedance_->V - frame.desired.V;
  quat_dc_ = array(Q_dc);
  w_dc_ = P_R * (R_d.transpose() * rate.tail<3>());
  Delta_ = P_T * (frame.R_BA.transpose() * (X.p - frame.desired.p));
  dDelta_ = P_T * (frame.R_BA.transpose() * rate.head<3>());
  // Half of the damping's power at one moment is a cautious estimate of its work over the step.
  tank_ = std::min(tank_ + impedance_->dissipated * h / 2, tank_max_);
  p_before_ = X.p;
  quat_before_ = array(Q);
  V_before_ = impedance_->V;
  quat_d_before_ = array(d.pose.Q);
  joints_.q = impedance_->q_bar;
  joints_.dq = impedance_->dq_r;
  joints_.ddq = impedance_->ddq_r;
  joints_.sigma_min = impedance_->sigma_min;
  joints_.lambda = 0;               // no motion of the joints is solved for
  constexpr double kSolved = 1e-6;  // rad
  if (impedance_->stiffness_ratio > ImpedanceControl::kSoftest) note(kSoftGears);
  if (impedance_->static_error > kSolved) note(kStatics);
  write_outputs(links, {X.p, Q, impedance_->V});
}

void CartesianMotion::find_contact_stiffness(Links& links, const robot::DriveParameters& drives, const Gains& gains,
                                             double bandwidth, double h) {
  // All six directions at the start, then one every kPause steps.
  constexpr std::int32_t kPause = 64;
  if (impedance_ || h <= 0) return;
  const bool first = contact_turn_ < 6, due = first || contact_turn_ % kPause == 0;
  const std::int32_t i = first ? contact_turn_ : contact_turn_ / kPause % 6;
  if (++contact_turn_ == 7 * kPause) contact_turn_ = kPause;
  if (due) find_contact_stiffness(links, drives, gains, bandwidth, h, i);
}

void CartesianMotion::find_contact_stiffness(Links& links, const robot::DriveParameters& drives, const Gains& gains,
                                             double bandwidth, double h, std::int32_t i) {
  const bool turn = i >= 3;
  const Impedance& z = turn ? rendered_R_ : rendered_T_;
  const Matrix3d& P = turn ? P_R_ : P_T_;
  const Matrix3d R_BA =
      turn ? quaternion(quat_d_before_).toRotationMatrix() : axes(quaternion(quat_d_before_), quaternion(quat_before_));
  const Vector3d axis = Vector3d::Unit(i % 3);
  const Vector3d u = R_BA * axis;
  if ((P * u).norm() < 0.5) {
    K_e_max_[static_cast<std::size_t>(i)] = 0;
    return;
  }
  const Index n = joints_.q.size();
  links.jacobian(joints_.q, joints_.frame(), J_);
  contact_.row.noalias() = J_.middleRows<3>(turn ? 3 : 0).transpose().lazyProduct(u);
  // 1/(uᵀ J A⁻¹ Jᵀ u) of joint-space matrices A.
  const auto along = [&](const Eigen::MatrixXd& A) {
    contact_.llt.compute(A);
    contact_.solved = contact_.row;
    contact_.llt.matrixL().solveInPlace(contact_.solved);
    return 1 / std::max(contact_.solved.squaredNorm(), 1e-12);
  };
  const auto along_diagonal = [&](const auto& value) {
    double sum = 0;
    for (Index k = 0; k < n; ++k) sum += contact_.row[k] * contact_.row[k] / value(static_cast<std::size_t>(k));
    return 1 / std::max(sum, 1e-12);
  };
  const bool elastic = std::ranges::any_of(drives.K, [](double K) { return K > 0; });
  constexpr double kStiff = 1e9;  // N.m/rad, of rigid joints among elastic ones
  links.mass_matrix(joints_.q, contact_.M);
  FollowingRobot robot{.bandwidth = bandwidth, .step = h};
  contact_.total = contact_.M;
  for (Index k = 0; k < n; ++k) {
    const auto j = static_cast<std::size_t>(k);
    contact_.total(k, k) += drives.B[j];
    if (drives.K[j] == 0) contact_.M(k, k) += drives.B[j];
  }
  robot.mass = along(elastic ? contact_.M : contact_.total);
  const double w = gains.passivity;
  const auto gain = [&](const auto& omega, const auto& constant) {
    contact_.gain = (1 - w) * contact_.total;
    for (Index k = 0; k < n; ++k) {
      const double scale = std::sqrt(omega(static_cast<std::size_t>(k)));
      contact_.gain.row(k) *= scale;
      contact_.gain.col(k) *= scale;
    }
    for (Index k = 0; k < n; ++k) contact_.gain(k, k) += w * constant(static_cast<std::size_t>(k)) + 1e-9;
    return along(contact_.gain);
  };
  robot.K_P = gain([&](std::size_t j) { return gains.omega[j] * gains.omega[j]; },
                   [&](std::size_t j) { return gains.K_s[j] * gains.Lambda[j]; });
  robot.K_D = gain([&](std::size_t j) { return 2 * gains.zeta[j] * gains.omega[j]; },
                   [&](std::size_t j) {
                     return gains.K_s[j] + gains.Lambda[j] * contact_.total(static_cast<Index>(j), static_cast<Index>(j));
                   });
  if (elastic) {
    robot.stiffness = along_diagonal([&](std::size_t j) { return drives.K[j] > 0 ? drives.K[j] : kStiff; });
    robot.motor = along_diagonal([&](std::size_t j) { return drives.B[j]; });
    robot.shaping = robot.motor / along_diagonal([&](std::size_t j) { return drives.B[j] / gains.shaping[j]; });
  }
  const SecondOrder along_axis{axis.dot(z.M * axis), axis.dot(z.D * axis), axis.dot(z.S * axis)};
  double bound =
      omega_t_ > 0 ? largest_contact_stiffness(along_axis, omega_t_, zeta_t_) : largest_contact_stiffness(along_axis, robot);
  K_e_max_[static_cast<std::size_t>(i)] = bound;
  if (K_e_[static_cast<std::size_t>(i)] > bound) note(kStiffContact);
}

}  // namespace cotwin::compliance
