#include "components/compliance/compliance.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <string_view>

#include "components/compliance/second_order.h"
#include "models/robot/body_parameters.h"
#include "models/robot/dynamics.h"
#include "models/robot/friction.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

constexpr const char* kSaturatedWarning =
    "motor torques reached tau_max and were cut (outputs saturated, tau_excess): too much is asked, or the loop is unstable";

Eigen::Map<Eigen::VectorXd> map(std::vector<double>& v) { return {v.data(), static_cast<Eigen::Index>(v.size())}; }

}  // namespace

struct Compliance::Dynamics {
  explicit Dynamics(const robot::RobotModel& robot)
      : mechanism(robot),
        data(mechanism),
        bodies(robot),
        C(robot.n(), robot.n()),
        q(robot.n()),
        dq(robot.n()),
        v(robot.n()),
        s(robot.n()),
        tau(robot.n()) {}

  robot::Mechanism mechanism;
  robot::Data data;
  robot::BodyParameters bodies;
  Eigen::MatrixXd C;
  Eigen::VectorXd q, dq, v, s, tau;
};

void Compliance::declare_settings(SettingList& s) {
  s.robot("a name in models/robots, or a path to a URDF file", true).required();
}

Compliance::Compliance(Settings& settings) {
  const robot::RobotModel robot = settings.robot();
  n_ = static_cast<std::size_t>(robot.n());
  dynamics_ = std::make_unique<Dynamics>(robot);
  for (Joints* input : {&q_d_, &dq_d_, &ddq_d_, &q_, &dq_, &theta_, &dtheta_, &tau_e_, &tau_e_rate_}) input->resize(n_);
  for (Joints* drive :
       {&K_, &tau_max_, &sigma0_, &sigma1_, &link_A_, &link_alpha_, &link_s_, &link_k_, &link_tau_S_, &link_load_})
    drive->resize(n_);
  for (Joints* springs : {&spring_sin_, &spring_cos_}) springs->resize(n_ * robot::Harmonics::kMost);
  for (Joints* state :
       {&tau_fl_before_, &tau_fm_before_, &Delta_, &dDelta_, &ddq_d_before_, &tau_w_, &dtau_w_, &z_, &theta_c_, &dtheta_c_})
    state->resize(n_);
  for (Joints* output : {&q_c_, &dq_c_, &ddq_c_, &tau_m_, &tau_id_, &tau_f_, &tau_excess_}) output->resize(n_);
  for (Joints* scratch : {&e_, &de_, &a_q_, &a_theta_, &tau_fl_, &tau_fm_, &tau_fl_mean_, &tau_fm_mean_, &tau_unwound_, &load_})
    scratch->resize(n_);
  for (std::size_t i = 0; i < n_; ++i) {
    const double limit = robot.joints[i].tau_max;
    tau_max_[i] = std::isfinite(limit) ? limit : 0.0;
  }
  // A drive of which nothing is known, as the drive train takes it: an elastic joint that is held for a rigid one is unstable.
  K_.assign(n_, 1e4);
  delta_.assign(n_, 2.0);
  link_v_S_.assign(n_, 0.1);
  link_delta_.assign(n_, 2.0);
  link_v_load_.assign(n_, 0.01);
  for (Joints* one : wanted_.all()) one->assign(n_, 0.0);
  wanted_.passivity.assign(1, 0.0);
  const auto fill = [](Joints& values, double value) { std::ranges::fill(values, value); };
  for (Joints* of_one : {&wanted_.B, &wanted_.M_a, &wanted_.zeta_a, &wanted_.zeta, &wanted_.shaping}) fill(*of_one, 1);
  fill(wanted_.S_a, 200);
  fill(wanted_.omega, 30);
  fill(wanted_.Lambda, 30);
  fill(wanted_.K_s, 20);
  fill(wanted_.v_R, 0.01);
  fill(wanted_.v_S, 0.1);
  fill(wanted_.link_v_R, 0.01);
  in_force_ = wanted_;
}

Compliance::~Compliance() = default;

void Compliance::initialise(Time) {
  check();
  in_force_ = wanted_;
  dynamics_->bodies.take("compliance", dynamics_->mechanism);
  warning_.clear();
  warning_.reserve(std::string_view(kSaturatedWarning).size());  // a step allocates nothing
  for (std::size_t i = 0; i < n_; ++i) Delta_[i] = dDelta_[i] = z_[i] = 0;
  ddq_d_before_ = ddq_d_;
  q_c_ = q_d_;
  dq_c_ = dq_d_;
  ddq_c_ = a_q_ = a_theta_ = ddq_d_;
  refer_to_motors(0);
  take_error();
  track(0);
}

// A step:
//   1. the tracking error at its beginning, where the last step's reference and the measurements meet
//   2. parameters and gains move towards the tunables
//   3. q_c, q̇_c, q̈_c at its end
//   4. inverse dynamics of that motion, and θ_c, θ̇_c
//   5. the motor torque over the step
StepResult Compliance::step(Time, Duration h) {
  const double seconds = h.seconds();
  check();
  take_error();
  follow_tunables(seconds);
  move_compliantly(seconds);
  refer_to_motors(seconds);
  track(seconds);
  return StepResult::kDone;
}

void Compliance::take_error() {
  for (std::size_t i = 0; i < n_; ++i) {
    const bool elastic = K_[i] > 0;
    e_[i] = theta_c_[i] - (elastic ? theta_[i] : q_[i]);
    de_[i] = dtheta_c_[i] - (elastic ? dtheta_[i] : dq_[i]);
  }
}

void Compliance::follow_tunables(double h) {
  const double remaining = transition_ > 0 ? std::exp(-h / transition_) : 0.0;
  const auto targets = wanted_.all();
  const auto values = in_force_.all();
  for (std::size_t k = 0; k < targets.size(); ++k) {
    for (std::size_t i = 0; i < targets[k]->size(); ++i) {
      double& value = (*values[k])[i];
      const double target = (*targets[k])[i];
      value = target + (value - target) * remaining;
    }
  }
  dynamics_->bodies.follow("compliance", remaining, dynamics_->mechanism);
}

void Compliance::restored() { dynamics_->bodies.restored(dynamics_->mechanism); }

void Compliance::declare_bodies(Variables& v) {
  robot::BodyParameters& b = dynamics_->bodies;
  v.tunable("mass", b.mass, "kg", "mass of each body of the robot, as its model has it at the start");
  v.tunable("first_moment", b.first_moment, "kg.m", "mass times centre of mass of body after body, in its frame (x, y, z)");
  v.tunable("inertia", b.inertia, "kg.m2", "inertia of body after body about its frame's origin: xx, xy, xz, yy, yz, zz");
  v.state("bodies", b.in_force, "1", "the ten inertial parameters in force of body after body");
}

void Compliance::move_compliantly(double h) {
  for (std::size_t i = 0; i < n_; ++i) {
    // (3a) prints Δx = x_d − x_c: a force would then pull against its own direction. x_c − x_d is meant, which yields to it.
    const double M = in_force_.M_a[i];
    const double S = in_force_.S_a[i];
    const SecondOrder admittance{M, in_force_.D_a[i] + 2 * in_force_.zeta_a[i] * std::sqrt(S * M), S};
    const double dDelta_before = dDelta_[i];
    const Deviation Delta = advance(admittance, {Delta_[i], dDelta_before}, tau_e_[i], tau_e_rate_[i], h);
    Delta_[i] = Delta.x;
    dDelta_[i] = Delta.dx;

    q_c_[i] = q_d_[i] + Delta.x;
    dq_c_[i] = dq_d_[i] + Delta.dx;
    ddq_c_[i] = ddq_d_[i] + acceleration(admittance, Delta, tau_e_[i] + tau_e_rate_[i] * h);
    a_q_[i] = (ddq_d_before_[i] + ddq_d_[i]) / 2 + (Delta.dx - dDelta_before) / h;
    ddq_d_before_[i] = ddq_d_[i];
  }
}

// Of the motor as the reference moves it, over a step at whose end it has the speed θ̇_c.
double Compliance::motor_friction(std::size_t i, double h) {
  const double v = dtheta_c_[i];
  const Tunables& p = in_force_;
  if (sigma0_[i] == 0) {
    return robot::CoulombViscous{p.tau_C[i], p.sigma2[i], p.tau_0[i], p.v_R[i], p.tau_S[i], p.v_S[i], delta_[i]}.at(v).torque;
  }
  const robot::Bristle bristle{sigma0_[i], sigma1_[i], p.sigma2[i], p.tau_C[i], std::max(p.tau_C[i], p.tau_S[i]),
                               p.v_S[i],   delta_[i]};
  if (h > 0) z_[i] = robot::lugre_after(bristle, v, z_[i], h);
  return robot::lugre(bristle, v, z_[i]).torque + p.tau_0[i];
}

double Compliance::link_friction(std::size_t i) const {
  const Tunables& p = in_force_;
  const robot::CoulombViscous sliding{p.link_tau_C[i], p.link_sigma2[i], p.link_tau_0[i], p.link_v_R[i],
                                      link_tau_S_[i],  link_v_S_[i],     link_delta_[i]};
  const robot::Sigmoid sigmoid{link_A_[i], link_alpha_[i], link_s_[i], link_k_[i]};
  const robot::CoulombViscous loaded{.tau_C = load_[i], .v_R = link_v_load_[i]};
  robot::Harmonics springs;
  for (std::size_t k = 0; k < robot::Harmonics::kMost; ++k) {
    springs.a[k] = spring_sin_[i * robot::Harmonics::kMost + k];
    springs.b[k] = spring_cos_[i * robot::Harmonics::kMost + k];
  }
  return sliding.at(dq_c_[i]).torque + sigmoid.at(dq_c_[i]).torque + loaded.at(dq_c_[i]).torque + springs.at(q_c_[i]).torque;
}

void Compliance::take_loads() {
  std::ranges::fill(load_, 0.0);
  if (std::ranges::all_of(link_load_, [](double load) { return load == 0; })) return;
  robot::gravity(dynamics_->mechanism, dynamics_->data, map(q_c_), dynamics_->s);
  for (std::size_t i = 0; i < n_; ++i) load_[i] = link_load_[i] * std::abs(dynamics_->s[static_cast<Eigen::Index>(i)]);
}

void Compliance::refer_to_motors(double h) {
  robot::inverse_dynamics(dynamics_->mechanism, dynamics_->data, map(q_c_), map(dq_c_), map(ddq_c_), map(tau_id_));
  take_loads();
  for (std::size_t i = 0; i < n_; ++i) {
    tau_fl_[i] = link_friction(i);
    double tau_Jc = tau_id_[i] + tau_fl_[i];  // (2a)
    if (tau_e_acts_on_robot_) tau_Jc -= tau_e_[i] + tau_e_rate_[i] * h;
    wind_up(i, tau_Jc, h);
    tau_fm_[i] = motor_friction(i, h);
    tau_f_[i] = tau_fl_[i] + tau_fm_[i];
    tau_id_[i] = tau_Jc + tau_fm_[i];
    tau_fl_mean_[i] = h > 0 ? (tau_fl_before_[i] + tau_fl_[i]) / 2 : tau_fl_[i];
    tau_fm_mean_[i] = h > 0 ? (tau_fm_before_[i] + tau_fm_[i]) / 2 : tau_fm_[i];
    tau_fl_before_[i] = tau_fl_[i];
    tau_fm_before_[i] = tau_fm_[i];
  }
}

void Compliance::wind_up(std::size_t i, double tau_Jc, double h) {
  theta_c_[i] = q_c_[i];
  dtheta_c_[i] = dq_c_[i];
  a_theta_[i] = a_q_[i];
  tau_unwound_[i] = 0;
  if (K_[i] == 0) return;
  // θ_c needs two derivatives of τ_J,c, which jumps when τ_e does: take them from a critically damped follower of it.
  if (h == 0) {
    tau_w_[i] = tau_Jc;
    dtau_w_[i] = 0;
  } else {
    const double w = elastic_bandwidth_;
    const double dtau_before = dtau_w_[i];
    const Deviation tau_w = advance({1, 2 * w, w * w}, {tau_w_[i], dtau_before}, w * w * tau_Jc, 0, h);
    tau_w_[i] = tau_w.x;
    dtau_w_[i] = tau_w.dx;
    a_theta_[i] += (tau_w.dx - dtau_before) / (h * K_[i]);
  }
  tau_unwound_[i] = tau_Jc - tau_w_[i];
  theta_c_[i] += tau_w_[i] / K_[i];  // (2c)
  dtheta_c_[i] += dtau_w_[i] / K_[i];
}

void Compliance::track(double h) {
  Dynamics& d = *dynamics_;
  const double passivity = in_force_.passivity[0];
  // The acceleration that the feedback adds to the reference's.
  const auto feedback = [&](std::size_t i) {
    const double omega = in_force_.omega[i];
    const double computed_torque = 2 * in_force_.zeta[i] * omega * de_[i] + omega * omega * e_[i];
    const double slotine_li = in_force_.Lambda[i] * de_[i];
    return computed_torque + passivity * (slotine_li - computed_torque);
  };
  // The torque is held over the step: the dynamics of its middle are the mean of those it has to follow.
  for (std::size_t i = 0; i < n_; ++i) d.v[static_cast<Eigen::Index>(i)] = a_q_[i] + feedback(i);
  d.dq = map(dq_) + h / 2 * d.v;
  d.q = map(q_) + h / 2 * map(dq_);
  robot::inverse_dynamics(d.mechanism, d.data, d.q, d.dq, d.v, d.tau);  // M q̈_r + C q̇ + g
  if (passivity > 0) {
    d.s = map(de_) + map(in_force_.Lambda).cwiseProduct(map(e_));
    robot::coriolis_matrix(d.mechanism, d.data, d.q, d.dq, d.C);
    d.tau.noalias() += passivity * (d.C * d.s);  // C q̇_r = C q̇ + C s
    d.tau += passivity * map(in_force_.K_s).cwiseProduct(d.s);
  }
  saturated_ = false;
  for (std::size_t i = 0; i < n_; ++i) {
    const double shaping = K_[i] > 0 ? in_force_.shaping[i] : 1;
    double u = d.tau[static_cast<Eigen::Index>(i)] + in_force_.B[i] * (a_theta_[i] / shaping + feedback(i)) + tau_fl_mean_[i];
    if (tau_e_acts_on_robot_) u -= tau_e_[i] + tau_e_rate_[i] * h / 2;
    // τ_m = u gives B θ̈ + τ_J = u, and τ_m = r u − (r − 1) τ_J gives (B/r) θ̈ + τ_J = u; but what jumps in u is not amplified.
    const double tau_J = K_[i] * (theta_[i] - q_[i]);
    const double tau = u + (shaping - 1) * (u - tau_unwound_[i] - tau_J) + tau_fm_mean_[i];
    tau_m_[i] = tau_max_[i] > 0 ? std::clamp(tau, -tau_max_[i], tau_max_[i]) : tau;
    tau_excess_[i] = tau - tau_m_[i];
    saturated_ = saturated_ || tau_excess_[i] != 0;
  }
  if (saturated_) warning_ = kSaturatedWarning;
}

}  // namespace cotwin::compliance
