// render=impedance: the motor torques directly, and how stiff an environment the admittance tolerates.
#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string_view>

#include "components/compliance/cartesian/cartesian_motion.h"
#include "components/compliance/cartesian/frame/contact_stiffness.h"
#include "components/compliance/joints/views.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

/// Where a frame was h seconds ago.
MovingPose earlier(const MovingPose& pose, const Twist& acceleration, double h) {
  const Twist back = -h * pose.V + h * h / 2 * acceleration;
  return {pose.p + back.head<3>(), quaternion_of(back.tail<3>()) * pose.Q, pose.V - h * acceleration};
}

/// The share of a parameter, 1 of which is not stable, up to which all less shares that are looked at are stable, to 1 %; 0: none.
template <class Stable>
double stable_share(Stable stable) {
  constexpr int kParts = 8;
  constexpr double kExact = 0.01, kLeast = 0.01;
  double low = 0, high = 1;
  // Stability need not be lost once and for all: the first loss counts.
  for (int k = 0; k < kParts; ++k) {
    const double share = std::max(static_cast<double>(k) / kParts, kLeast);
    if (!stable(share)) {
      high = share;
      break;
    }
    low = share;
  }
  if (low == 0) return 0;
  while (high - low > kExact * high) {
    const double middle = (low + high) / 2;
    (stable(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace

void CartesianMotion::start_impedance(const Measured& measured, std::span<const Limits> limits) {
  impedance_->start(measured.q, measured.theta);
  q_scratch_ = map(measured.q);
  impedance_limits_->start(q_scratch_, limits);
}

void CartesianMotion::impede(LinkDynamics& links, const FromJoints& in, const robot::DriveParameters& drives,
                             const Measured& measured, const Joints& shaping, std::span<const Limits> limits,
                             const Joints& tau_e, double h, Joints& tau_m) {
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
  frame.P_R = P_R;
  frame.turns_with_tool = axes_ == Axes::kTool;
  if (desired_joints_) {
    dq_scratch_ = map(in.dq_d) - h * map(in.ddq_d);
    q_scratch_ = map(in.q_d) - h / 2 * (map(in.dq_d) + dq_scratch_);
    ddq_scratch_ = map(in.ddq_d);
  }
  const Posture posture{q_scratch_, dq_scratch_, ddq_scratch_};
  const ElasticLimits elastic{*impedance_limits_, limits, tau_e, h};
  const ElasticPosture null_space{.q_0 = in.q,
                                  .self_motion = impedance_self_motion_.get(),
                                  .gains = gains(),
                                  .desired = desired_joints_ ? &posture : nullptr};
  impedance_->torque(links, joints_.frame(), frame, null_space, drives, measured, shaping, h > 0 ? &elastic : nullptr, tau_m);

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
  joints_.met = impedance_limits_->met;
  joints_.lambda = 0;               // no motion of the joints is solved for
  constexpr double kSolved = 1e-6;  // rad
  if (impedance_->stiffness_ratio > ImpedanceControl::kSoftest) note(kSoftGears);
  if (impedance_->stiffness_ratio > ImpedanceControl::kSwinging) note(kSwings);
  if (impedance_->static_error > kSolved) note(kStatics);
  write_outputs(links, {X.p, Q, impedance_->V});
  if (needs_check(h)) check_sampling(links, frame, null_space, drives, shaping, h);
}

/// Whether the robot may vibrate with a step of h in spite of the last check. A step that is a little longer than that of the check, as of a loop that
/// was late, is not worth the time.
bool CartesianMotion::needs_check(double h) const { return checked_step_ > 0 ? h >= 2 * checked_step_ : h > 0; }

/// Borders, which take much longer than the check, are sought only in the first step.
void CartesianMotion::check_sampling(LinkDynamics& links, const ElasticFrame& frame, const ElasticPosture& posture,
                                     const robot::DriveParameters& drives, const Joints& shaping, double h) {
  if ((met_ & kSampling) != 0) return;               // it is told with its borders, which are those of that step
  const double ratio = impedance_->stiffness_ratio;  // an output, which linearise() changes
  const bool first = checked_step_ == 0;
  checked_step_ = sampled_.step = h;
  const auto stable = [&](double of_delay, double of_shaping, double of_stiffness) {
    ElasticFrame changed = frame;
    changed.S_T *= of_stiffness;
    changed.K_o *= of_stiffness;
    for (std::size_t i = 0; i < shaping.size(); ++i) shaping_scratch_[i] = 1 + of_shaping * (shaping[i] - 1);
    impedance_->linearise(links, changed, posture, drives, shaping_scratch_, sampled_);
    sampled_.delay = of_delay * delay_;
    return sampled_loop_.growth(sampled_) < SampledLoop::kNone;
  };
  if (!stable(1, 1, 1)) {
    gears_undamped_ = (sampled_.K.array() > 0 && sampled_.D.array() == 0).any() ? 1 : 0;
    if (first) {
      const double most = *std::ranges::max_element(shaping);
      delay_border_ = delay_ > 0 ? delay_ * stable_share([&](double share) { return stable(share, 1, 1); }) : 0;
      const double share = most > 1 ? stable_share([&](double part) { return stable(1, part, 1); }) : 0;
      shaping_border_ = share > 0 ? 1 + share * (most - 1) : 0;
      stiffness_border_ = stable_share([&](double part) { return stable(1, 1, part); });
    }
    note(kSampling);
  }
  impedance_->stiffness_ratio = ratio;
}

void CartesianMotion::append_sampling(std::string& warning) const {
  const auto append = [&](double value, std::string_view after) {
    char digits[32];
    warning.append(digits, std::to_chars(digits, digits + sizeof digits, value, std::chars_format::general, 3).ptr);
    warning += after;
  };
  warning += "the torques of render=impedance, held for a step of ";
  append(1e3 * checked_step_, " ms");
  if (delay_ > 0) {
    warning += " and from measurements that are ";
    append(1e3 * delay_, " ms old (delay)");
  }
  warning += ", make the robot vibrate: expected a shorter step";
  if (delay_ > 0) warning += ", less delay";
  if (gears_undamped_ != 0) warning += ", D of the gears if they are damped (0 is given)";
  if (delay_border_ > 0) warning += ", delay <= ", append(1e3 * delay_border_, " ms");
  if (shaping_border_ > 0) warning += ", shaping <= ", append(shaping_border_, "");
  if (stiffness_border_ > 0) warning += ", S_T and K_o <= ", append(stiffness_border_, " of their values");
}

void CartesianMotion::find_contact_stiffness(LinkDynamics& links, const robot::DriveParameters& drives, const Gains& gains,
                                             double bandwidth, bool feeds_wrench_forward, const Joints& tau_max, double h) {
  // One frequency a step for the first result, then one every kPause steps.
  constexpr std::int32_t kPause = 16;
  if (impedance_ || h <= 0) return;
  if (contact_turn_ < kPause) contact_turn_ = 0;  // nothing is known yet
  const bool due = contact_turn_ % kPause == 0;
  if (contact_turn_ >= kPause && ++contact_turn_ == 2 * kPause) contact_turn_ = kPause;
  if (!due) return;
  const Eigen::Matrix3d R_T = axes(quaternion(quat_d_before_), quaternion(quat_before_)),
                        R_R = quaternion(quat_d_before_).toRotationMatrix();
  if (omega_t_ > 0) {
    const auto bound = [&](const Impedance& z, int i) {
      return largest_contact_stiffness({z.M(i, i), z.D(i, i), z.S(i, i)}, omega_t_, zeta_t_, delay_);
    };
    for (int k = 0; k < 3; ++k) {
      const auto i = static_cast<std::size_t>(k);
      contact_.K_e_max[i] = (P_T_ * R_T.col(k)).norm() < 0.5 ? 0 : bound(rendered_T_, k);
      contact_.K_e_max[i + 3] = (P_R_ * R_R.col(k)).norm() < 0.5 ? 0 : bound(rendered_R_, k);
    }
    contact_turn_ = std::max(contact_turn_, kPause);
  } else {
    update_robot_in_contact(links, drives, gains, R_T, R_R);
    following_.bandwidth = bandwidth;
    following_.feeds_wrench_forward = feeds_wrench_forward;
    links.gravity(joints_.q, tau_scratch_);
    for (Index i = 0; i < tau_scratch_.size(); ++i) {
      const double most = tau_max[static_cast<std::size_t>(i)];
      constexpr double kNone = 1e300;
      following_.tau[i] = most > 0 ? std::max(most - std::abs(tau_scratch_[i]), 0.0) : kNone;
    }
    following_.step = h;
    following_.delay = delay_;
    if (needs_check(h)) check_following(drives, h);
    if (!contact_.advance(following_)) return;
    contact_turn_ = std::max(contact_turn_, kPause);
    if (follower_vibrates_ != 0) check_following(drives, h);  // gains may have been changed
    if (follower_vibrates_ != 0) contact_.K_e_max.fill(0);
    if (contact_.gain() >= 2 || follower_vibrates_ != 0) note(kGains);
  }
  for (std::size_t k = 0; k < 6; ++k) {
    if (contact_.K_e_max[k] > 0 && K_e_[k] > contact_.K_e_max[k]) note(kStiffContact);
  }
}

/// Whether the motors vibrate without a contact. After update_robot_in_contact().
void CartesianMotion::check_following(const robot::DriveParameters& drives, double h) {
  const FollowingRobot& r = following_;
  sampled_.M = r.M;
  if ((r.K.array() == 0).all()) sampled_.M.diagonal() -= r.B;
  for (Index i = 0; i < r.D.size(); ++i) sampled_.D[i] = drives.D[static_cast<std::size_t>(i)];
  sampled_.B = r.B;
  sampled_.K = r.K;
  sampled_.shaping = r.shaping;
  sampled_.H = r.K_P;
  sampled_.R = r.K_D;
  sampled_.relief = 0;
  checked_step_ = sampled_.step = h;
  sampled_.delay = delay_;
  // Of undamped gears there is always some that grows in hours.
  constexpr double kSlow = 1e-4;
  follower_vibrates_ = sampled_loop_.growth(sampled_) < kSlow ? 0 : 1;
}

/// R_T, R_R: axes of translation and rotation in B.
void CartesianMotion::update_robot_in_contact(LinkDynamics& links, const robot::DriveParameters& drives, const Gains& gains,
                                              const Matrix3d& R_T, const Matrix3d& R_R) {
  FollowingRobot& r = following_;
  const Index n = joints_.q.size();
  links.jacobian(joints_.q, joints_.frame(), J_);
  for (Index k = 0; k < 6; ++k) {
    const bool turn = k >= 3;
    const Vector3d u = (turn ? P_R_ * R_R : P_T_ * R_T).col(k % 3);
    r.J.row(k).noalias() = u.transpose() * J_.middleRows<3>(turn ? 3 : 0);
    if (u.norm() < 0.5) r.J.row(k).setZero();
    Twist a = Twist::Zero();
    a.segment<3>(turn ? 3 : 0) = u;
    joints_.accelerations_of(a, r.J_bar.col(k));
  }
  r.translation = rendered_T_;
  r.rotation = rendered_R_;
  links.mass_matrix(joints_.q, r.M);
  const double p = gains.passivity;
  bool elastic = false;
  for (Index i = 0; i < n; ++i) {
    const auto k = static_cast<std::size_t>(i);
    r.B[i] = drives.B[k];
    r.K[i] = drives.K[k];
    r.D[i] = drives.D[k];
    r.shaping[i] = drives.K[k] > 0 ? gains.shaping[k] : 1.0;
    elastic = elastic || drives.K[k] > 0;
  }
  // tracking.h
  contact_total_ = r.M;
  contact_total_.diagonal() += r.B;
  for (Index i = 0; i < n; ++i) {
    const auto a = static_cast<std::size_t>(i);
    for (Index j = 0; j < n; ++j) {
      const auto b = static_cast<std::size_t>(j);
      const double m = contact_total_(i, j), w = gains.omega[b], left = elastic ? gains.omega[a] : w;
      const double zw = gains.zeta[b] * w, left_zw = elastic ? gains.zeta[a] * gains.omega[a] : zw;
      const double Lambda = gains.Lambda[b], left_Lambda = elastic ? gains.Lambda[a] : Lambda;
      r.K_P(i, j) = (1 - p) * left * m * w;
      r.K_D(i, j) = (1 - p) * 2 * std::sqrt(left_zw * zw) * m + p * std::sqrt(left_Lambda * Lambda) * m;
    }
    r.K_P(i, i) += p * gains.K_s[a] * gains.Lambda[a];
    r.K_D(i, i) += p * gains.K_s[a];
  }
  if (!elastic) r.M = contact_total_;
}

}  // namespace cotwin::compliance
