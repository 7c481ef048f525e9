#include "components/compliance/joints/tracking.h"
#include "components/compliance/joints/views.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::compliance {
namespace {

struct Followed {
  double x, dx;
};

/// x after h seconds on its way to `target`: ẍ = w² (target − x) − 2 w ẋ, exactly, as long as |ẍ| ≤ `most`. Beyond, ẋ goes to
/// √(1.5 most |target − x|), which 3/4 of `most` can brake, so x does not overshoot. `left` is e^(−w h).
Followed follow(const Followed& from, double target, double w, double most, double h, double left) {
  const double d = target - from.x;
  const double v = left * (from.dx * (1 - w * h) + w * w * h * d);
  if (std::abs(d) * w * w <= 6 * most && std::abs(v - from.dx) <= most * h) {
    return {target - left * (d * (1 + w * h) - h * from.dx), v};
  }
  const double towards = std::copysign(std::min(w / 2 * std::abs(d), std::sqrt(1.5 * most * std::abs(d))), d);
  const double change = std::clamp((towards - from.dx) * (1 - left * left), -most * h, most * h);
  return {from.x + h * (from.dx + change / 2), from.dx + change};
}

}  // namespace

Tracking::Tracking(const robot::RobotModel& robot)
    : n_(static_cast<std::size_t>(robot.n())),
      states_(robot.n()),
      M_(robot.n(), robot.n()),
      C_(robot.n(), robot.n()),
      q_(robot.n()),
      dq_(robot.n()),
      v_(robot.n()),
      s_(robot.n()),
      tau_(robot.n()),
      g_(robot.n()),
      g_c_(robot.n()) {
  for (Joints* one : {&theta_c, &dtheta_c, &tau_w, &dtau_w, &tau_c, &e_, &de_, &tau_w_before_, &tau_w_mean_, &a_theta_})
    one->resize(n_);
}

void Tracking::start(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives) {
  refer(links, reference, load, drives, {0, tau_w}, 0);
}

void Tracking::refer(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives,
                     const WindingUp& winding_up, double h) {
  const auto q_c = map(reference.q_c), dq_c = map(reference.dq_c), a = map(reference.mean_ddq_c);
  theta_c = reference.q_c;
  dtheta_c = reference.dq_c;
  a_theta_ = reference.mean_ddq_c;
  elastic_ = std::ranges::any_of(drives.K, [](double K) { return K > 0; });
  if (!elastic_) {
    links.inverse_dynamics(q_c, dq_c, map(reference.ddq_c), map(tau_c));
    map(tau_c) += map(load.end);
    return;
  }

  // The torque of the reference in the middle of the step is its mean over the step.
  q_ = q_c - h / 2 * dq_c + h * h / 8 * a;
  dq_ = dq_c - h / 2 * a;
  v_ = a;
  sprung_ = std::ranges::any_of(drives.spring_sin, [](double amplitude) { return amplitude != 0; }) ||
            std::ranges::any_of(drives.spring_cos, [](double amplitude) { return amplitude != 0; });
  update_loads(links, reference, drives);
  map(tau_c) += map(load.end);
  links.mass_matrix(q_, M_);
  tau_ += map(load.mean);
  M_.diagonal() += map(drives.B);
  const double left = std::exp(-winding_up.bandwidth * h);
  for (std::size_t i = 0; i < n_; ++i) wind_up(i, tau_[static_cast<Eigen::Index>(i)], drives, winding_up, h, left);
}

void Tracking::add_springs(const robot::DriveParameters& drives, const Eigen::VectorXd& at, Eigen::VectorXd& torque) const {
  if (!sprung_) return;
  for (std::size_t i = 0; i < n_; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    torque[k] += robot::spring(drives, i).at(at[k]).torque;
  }
}

/// Inverse dynamics of the reference at the end of the step and, into tau_, of (q_, dq_, v_) in its middle; g there and at q_ − e_.
void Tracking::update_loads(LinkDynamics& links, const Reference& reference, const robot::DriveParameters& drives) {
  const auto e = map(e_);
  if (links.has_batch()) {
    states_.q.row(0) = map(reference.q_c);
    states_.dq.row(0) = map(reference.dq_c);
    states_.a.row(0) = map(reference.ddq_c);
    states_.q.row(1) = states_.q.row(2) = q_;
    states_.dq.row(1) = dq_;
    states_.a.row(1) = v_;
    v_ = q_ - e;
    states_.q.row(3) = v_;
    links.inverse_dynamics(states_.q, states_.dq, states_.a, states_.tau);
    map(tau_c) = states_.tau.row(0);
    tau_ = states_.tau.row(1);
    g_c_ = states_.tau.row(2);
    g_ = states_.tau.row(3);
  } else {
    links.inverse_dynamics(map(reference.q_c), map(reference.dq_c), map(reference.ddq_c), map(tau_c));
    links.inverse_dynamics(q_, dq_, v_, tau_);
    links.gravity(q_, g_c_);
    v_ = q_ - e;
    links.gravity(v_, g_);
  }
  add_springs(drives, q_, g_c_);
  add_springs(drives, v_, g_);
  at_error_ = true;
}

void Tracking::wind_up(std::size_t i, double tau, const robot::DriveParameters& drives, const WindingUp& winding_up, double h,
                       double left) {
  const double K = drives.K[i], B = drives.B[i];
  tau_w_mean_[i] = tau;
  if (K == 0) return;
  // θ_c needs two derivatives of τ_J,c, which jumps with τ_e and q̈_c. Winding up a spring at once would need an unbounded
  // torque: B τ̈_w/K of the motor is bounded.
  if (h == 0) {
    tau_w[i] = tau;
    dtau_w[i] = 0;
  }
  tau_w_before_[i] = tau_w[i];
  if (h > 0) {
    const double most =
        winding_up.torque[i] > 0 && B > 0 ? winding_up.torque[i] * K / B : std::numeric_limits<double>::infinity();
    const Followed at = follow({tau_w[i], dtau_w[i]}, tau, winding_up.bandwidth, most, h, left);
    a_theta_[i] += (at.dx - dtau_w[i]) / (h * K);
    tau_w[i] = at.x;
    dtau_w[i] = at.dx;
  }
  tau_w_mean_[i] = (tau_w_before_[i] + tau_w[i]) / 2;
  theta_c[i] += robot::Torsion{.K = K}.under(tau_w[i]);  // (2c)
  dtheta_c[i] += dtau_w[i] / K;
}

void Tracking::update_error(const Measured& measured, const robot::DriveParameters& drives) {
  for (std::size_t i = 0; i < n_; ++i) {
    const bool elastic = drives.K[i] > 0;
    e_[i] = theta_c[i] - (elastic ? measured.theta[i] : measured.q[i]);
    de_[i] = dtheta_c[i] - (elastic ? measured.dtheta[i] : measured.dq[i]);
  }
  at_error_ = false;
}

void Tracking::torque(LinkDynamics& links, const Reference& reference, const Load& load, const robot::DriveParameters& drives,
                      const Measured& measured, const Gains& gains, double h, Joints& tau_m) {
  if (elastic_) {
    torque_of_elastic(links, drives, measured, gains, tau_m);
  } else {
    torque_of_rigid(links, reference, load, drives, measured, gains, h, tau_m);
  }
}

void Tracking::torque_of_rigid(LinkDynamics& links, const Reference& reference, const Load& load,
                               const robot::DriveParameters& drives, const Measured& measured, const Gains& gains, double h,
                               Joints& tau_m) {
  const double p = gains.passivity;
  for (std::size_t i = 0; i < n_; ++i) {
    // The acceleration that the feedback adds to the reference's.
    const double computed_torque = 2 * gains.zeta[i] * gains.omega[i] * de_[i] + gains.omega[i] * gains.omega[i] * e_[i];
    const double feedback = computed_torque + p * (gains.Lambda[i] * de_[i] - computed_torque);
    v_[static_cast<Eigen::Index>(i)] = reference.mean_ddq_c[i] + feedback;
  }
  // The torque is held over the step: the dynamics in the middle of the step are their mean over it.
  dq_ = map(measured.dq) + h / 2 * v_;
  q_ = map(measured.q) + h / 2 * map(measured.dq);
  links.inverse_dynamics(q_, dq_, v_, tau_);  // M q̈_r + C q̇ + g
  if (p > 0) {
    s_ = map(de_) + map(gains.Lambda).cwiseProduct(map(e_));
    links.coriolis_matrix(q_, dq_, C_);
    tau_.noalias() += p * (C_ * s_);  // C q̇_r = C q̇ + C s
    tau_ += p * map(gains.K_s).cwiseProduct(s_);
  }
  map(tau_m) = tau_ + map(drives.B).cwiseProduct(v_) + map(load.mean);
}

void Tracking::torque_of_elastic(LinkDynamics& links, const robot::DriveParameters& drives, const Measured& measured,
                                 const Gains& gains, Joints& tau_m) {
  // g(q̄) − g(q_c), with K (θ − q̄) = τ_w + g(q̄) − g(q_c). Feedback of g at the measured links would not be symmetric, and g at
  // q_c would need gains larger than the gradient of gravity. q̄ is found by one fixed-point correction of twice the usual size;
  // the remaining error then stabilises for any gains (docs/equations.md).
  const auto e = map(e_), de = map(de_);
  v_ = q_ - e;       // q_: the reference in the middle of the step, by refer()
  if (!at_error_) {  // the error was taken after refer(): at the start
    links.gravity(v_, g_);
    add_springs(drives, v_, g_);
  }
  for (std::size_t i = 0; i < n_; ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    if (drives.K[i] > 0) v_[k] -= 2 * (g_[k] - g_c_[k]) / drives.K[i];
  }
  links.gravity(v_, g_);
  add_springs(drives, v_, g_);
  at_error_ = false;
  tau_ = g_ - g_c_;

  // K_P e + K_D ė
  const double p = gains.passivity;
  if (p < 1) {
    const auto omega = map(gains.omega).array(), zeta = map(gains.zeta).array();
    s_ = (omega * e.array()).matrix();
    v_.noalias() = M_.lazyProduct(s_);
    tau_.array() += (1 - p) * omega * v_.array();
    s_ = ((omega * zeta).sqrt() * de.array()).matrix();
    v_.noalias() = M_.lazyProduct(s_);
    tau_.array() += (1 - p) * 2 * (omega * zeta).sqrt() * v_.array();
  }
  if (p > 0) {
    const auto Lambda = map(gains.Lambda).array(), K_s = map(gains.K_s).array();
    s_ = (Lambda.sqrt() * de.array()).matrix();
    v_.noalias() = M_.lazyProduct(s_);
    tau_.array() += p * (Lambda.sqrt() * v_.array() + K_s * (de.array() + Lambda * e.array()));
  }

  for (std::size_t i = 0; i < n_; ++i) {
    const double feedback = tau_[static_cast<Eigen::Index>(i)];
    tau_m[i] = drives.B[i] * a_theta_[i] + tau_w_mean_[i] + feedback;
    if (drives.K[i] == 0) continue;
    // r u − (r − 1) τ_J, both at the beginning of the step.
    const double tau_J = robot::Torsion{.K = drives.K[i]}.at(measured.theta[i] - measured.q[i]).torque;  // (2c)
    tau_m[i] += (gains.shaping[i] - 1) * (feedback + tau_w_before_[i] - tau_J);
  }
}

}  // namespace cotwin::compliance
