#include "components/drive_train/equations.h"

#include <algorithm>
#include <cmath>

#include "components/drive_train/floating_links.h"
#include "components/drive_train/ldlt.h"
#include "models/robot/dynamics.h"

namespace cotwin::drive_train {
namespace {

using ConstMap = Eigen::Map<const Eigen::VectorXd>;
using Map = Eigen::Map<Eigen::VectorXd>;
using MatrixMap = Eigen::Map<Eigen::MatrixXd>;

Eigen::Index index(std::size_t n) { return static_cast<Eigen::Index>(n); }

constexpr double kSlowestImpact = 1e-3;  // rad/s: slower ones are damped like this one

}  // namespace

Parameters::Parameters(std::size_t joints) : robot::DriveParameters(joints) {
  write_start_values(*this, kStopParameters, joints);
}

Course::Course(std::size_t n) : tau_m(n), dtau_m(n), tau_e(n), dtau_e(n), link(4 * n) {}

TorqueTerms::TorqueTerms(std::size_t n) : inertia(n), coriolis(n), gravity(n), link(n) {}

Modes::Modes(std::size_t n) : slip(n), stop(n), impact(n) {}

void Modes::clear() {
  std::fill(slip.begin(), slip.end(), 0);
  std::fill(stop.begin(), stop.end(), 0);
  std::fill(impact.begin(), impact.end(), 0.0);
}

Point::Point(std::size_t n) : M(n * n) {
  for (auto* v : {&tau_J, &tau_f, &force, &motor_force, &dz, &kappa, &f_w, &f_z, &z_w, &z_z, &d_l, &k_l, &gravity, &h})
    v->resize(n);
}

struct Equations::Dynamics {
  explicit Dynamics(const robot::RobotModel& robot)
      : mechanism(robot), data(mechanism), bodies(robot), rest(Eigen::VectorXd::Zero(robot.n())) {}
  robot::Mechanism mechanism;
  robot::Data data;
  robot::BodyParameters bodies;
  Eigen::VectorXd rest;  // zeros
};

robot::BodyParameters& Equations::bodies() { return dynamics_->bodies; }
void Equations::update_bodies(const std::string& place) {
  dynamics_->bodies.take(place, dynamics_->mechanism);
  if (floating_) floating_->update(dynamics_->bodies.robot());
}
bool Equations::follow_bodies(const std::string& place, double remaining) {
  if (!dynamics_->bodies.follow(place, remaining, dynamics_->mechanism)) return false;
  if (floating_) floating_->update(dynamics_->bodies.robot());
  return true;
}
void Equations::restored_bodies() {
  dynamics_->bodies.restored(dynamics_->mechanism);
  if (floating_) floating_->update(dynamics_->bodies.robot());
}

void Equations::begin_base(const double* x) {
  floating_->hold(x, x + n_);
  evaluate(x, *base_point_);
  acceleration(0, *base_point_, base_point_->dz.data());
  floating_->begin_step(x, x + n_, base_point_->dz.data());
}

void Equations::end_base(double h, const double* x0, const double* x1) { floating_->end_step(h, x0, x0 + n_, x1, x1 + n_); }

Equations::Equations(const robot::RobotModel* robot, std::size_t n, LinkSide link, Transmission transmission, Friction friction,
                     Base base)
    : n_(n),
      link_(link),
      transmission_(transmission),
      friction_(friction),
      parameters_(n),
      modes_(n),
      course_(n),
      passive_(n),
      torsion_(n),
      bristle_(n),
      motor_friction_(n),
      link_side_(n),
      L_(n * n),
      scratch_(n * n) {
  for (auto* v : {&stop_damping_, &z_most_, &kappa_, &ratio_, &P_inverse_, &f_z_, &z_w_, &z_inverse_, &k_l_}) v->resize(n);
  if (inside()) {
    dynamics_ = std::make_unique<Dynamics>(*robot);
    load_.resize(n * n);
  }
  for (std::size_t i = 0; i < n_ && robot != nullptr; ++i) passive_[i] = robot->joints[i].passive;
  if (base == Base::kFloating) {
    floating_ = std::make_unique<FloatingLinks>(*robot);
    base_point_ = std::make_unique<Point>(n);
  }
}

Equations::~Equations() = default;

void Equations::adopt_parameters() {
  const Parameters& p = parameters_;
  has_stops_ = has_load_ = false;
  for (std::size_t i = 0; i < n_; ++i) {
    torsion_[i] = robot::torsion(p, i);
    bristle_[i] = robot::bristle(p, i);
    motor_friction_[i] = robot::motor_friction(p, i);
    link_side_[i] = robot::link_side(p, i);
    z_most_[i] = bristle_[i].present() ? p.tau_S[i] / p.sigma0[i] : 0;
    stop_damping_[i] = robot::stop_damping(p.stop_restitution[i]);
    has_stops_ |= inside() && p.stop_stiffness[i] > 0;
    has_load_ |= inside() && p.link_load[i] != 0;
  }
}

void Equations::prescribe(double t, double* x) const {
  if (floating_) floating_->set_time(t);
  if (inside()) return;
  const double* c = course_.link.data();
  for (std::size_t i = 0; i < n_; ++i) {
    x[i] = c[i] + t * (c[n_ + i] + t * (c[2 * n_ + i] + t * c[3 * n_ + i]));
    x[n_ + i] = c[n_ + i] + t * (2 * c[2 * n_ + i] + t * 3 * c[3 * n_ + i]);
  }
}

void Equations::confine_bristles(double* x) const {
  double* z = x + 4 * n_;
  for (std::size_t i = 0; i < n_; ++i) z[i] = std::clamp(z[i], -z_most_[i], z_most_[i]);
}

void Equations::evaluate(const double* x, Point& p) {
  if (floating_) {
    floating_->mass_matrix_and_bias(x, x + n_, p.M.data(), p.h.data());
  } else if (inside()) {
    robot::mass_matrix_and_bias(dynamics_->mechanism, dynamics_->data, ConstMap(x, index(n_)), ConstMap(x + n_, index(n_)),
                                MatrixMap(p.M.data(), index(n_), index(n_)), Map(p.h.data(), index(n_)));
  }
  if (inside() && !flexible()) {
    for (std::size_t i = 0; i < n_; ++i) p.M[i * n_ + i] += parameters_.B[i];
  }
  for (std::size_t k = 0; loaded_ && k < load_.size(); ++k) p.M[k] += load_[k];
  evaluate_joints(x, p);
}

void Equations::evaluate_joints(const double* x, Point& p) const {
  const double *q = x, *dq = x + n_, *theta = x + 2 * n_, *dtheta = x + 3 * n_, *z = x + 4 * n_;
  for (std::size_t i = 0; i < n_; ++i) {
    const double w = flexible() ? dtheta[i] : dq[i];
    double tau_f = 0;
    if (friction_ == Friction::kCoulomb) {
      if (modes_.slip[i] != 0) {
        const auto slipping = robot::StickSlip::slipping(bristle_[i], w, modes_.slip[i]);
        tau_f = slipping.torque + parameters_.tau_0[i];
        p.f_w[i] = slipping.slope;
      }
    } else if (friction_ == Friction::kSmooth) {
      const auto f = motor_friction_[i].at(w);
      tau_f = f.torque;
      p.f_w[i] = f.slope;
    } else {
      const auto f =
          friction_ == Friction::kLugre ? robot::lugre(bristle_[i], w, z[i]) : robot::elasto_plastic(bristle_[i], w, z[i]);
      tau_f = f.torque + parameters_.tau_0[i];
      p.dz[i] = f.dz;
      p.f_w[i] = f.torque_by_v;
      p.f_z[i] = f.torque_by_z;
      p.z_w[i] = f.dz_by_v;
      p.z_z[i] = f.dz_by_z;
    }
    p.tau_f[i] = tau_f;
    if (flexible()) {
      const auto tau_J = joint_torque(i, theta[i] - q[i], dtheta[i] - dq[i]);
      p.kappa[i] = tau_J.slope;
      p.tau_J[i] = tau_J.torque;
      p.motor_force[i] = -p.tau_J[i] - tau_f;
      p.force[i] = p.tau_J[i];
    } else {
      p.force[i] = -tau_f;
    }
  }
  if (!inside()) return;
  if (has_load_ && !floating_) {  // in free fall gravity is no load
    robot::gravity(dynamics_->mechanism, dynamics_->data, ConstMap(q, index(n_)), Map(p.gravity.data(), index(n_)));
  }
  for (std::size_t i = 0; i < n_; ++i) {
    const robot::LinkTorque tau_l = link_side_[i].at(q[i], dq[i], p.gravity[i]);
    p.force[i] -= tau_l.torque;
    p.d_l[i] = tau_l.by_speed;
    p.k_l[i] = tau_l.by_angle;
  }
  if (!has_stops_) return;
  for (std::size_t i = 0; i < n_; ++i) {
    const auto s = stop(i, q[i], dq[i]);
    p.force[i] -= modes_.stop[i] * s.torque;
    p.d_l[i] += s.by_speed;
    p.k_l[i] += s.by_depth;
  }
}

void Equations::load_derivatives(const double* x, const Point& p, double* by_q, double* scratch) {
  Dynamics& d = *dynamics_;
  robot::inverse_dynamics_derivatives(d.mechanism, d.data, ConstMap(x, index(n_)), d.rest, d.rest,
                                      MatrixMap(by_q, index(n_), index(n_)), MatrixMap(scratch, index(n_), index(n_)));
  for (std::size_t i = 0; i < n_; ++i) {
    const double sign = p.gravity[i] < 0 ? -1 : p.gravity[i] > 0 ? 1 : 0;
    const double slope = sign * link_side_[i].load * std::tanh(x[n_ + i] / link_side_[i].v_load);
    for (std::size_t j = 0; j < n_; ++j) by_q[j * n_ + i] *= slope;
  }
}

double Equations::stop_depth(std::size_t i, double q) const {
  return modes_.stop[i] > 0 ? q - parameters_.q_max[i] : parameters_.q_min[i] - q;
}

robot::StopTorque Equations::stop(std::size_t i, double q, double dq) const {
  const int side = modes_.stop[i];
  if (side == 0) return {};
  return robot::stop_torque(parameters_.stop_stiffness[i], stop_damping_[i], std::max(modes_.impact[i], kSlowestImpact),
                            stop_depth(i, q), side * dq);
}

void Equations::inverse_dynamics(const double* x, const double* a, double* tau) {
  if (floating_) {
    floating_->inverse_dynamics(x, x + n_, a, tau);
  } else {
    robot::inverse_dynamics(dynamics_->mechanism, dynamics_->data, ConstMap(x, index(n_)), ConstMap(x + n_, index(n_)),
                            ConstMap(a, index(n_)), Map(tau, index(n_)));
  }
  if (!flexible()) {
    for (std::size_t i = 0; i < n_; ++i) tau[i] += parameters_.B[i] * a[i];
  }
  if (!loaded_) return;
  for (std::size_t j = 0; j < n_; ++j) {
    for (std::size_t i = 0; i < n_; ++i) tau[i] += load_[j * n_ + i] * a[j];
  }
}

void Equations::set_load(std::span<const double> factor) {
  const bool was_loaded = loaded_;
  loaded_ = std::ranges::any_of(factor, [](double value) { return value != 0; });
  if (!was_loaded && !loaded_) return;
  const Eigen::Map<const Eigen::MatrixXd> transposed(factor.data(), index(n_), index(n_));
  MatrixMap L(load_.data(), index(n_), index(n_));
  L.setZero();
  if (loaded_) L.selfadjointView<Eigen::Lower>().rankUpdate(transposed);
  if (loaded_) L.triangularView<Eigen::StrictlyUpper>() = L.transpose();
}

double Equations::load_energy(const double* dq) const {
  double energy = 0;
  for (std::size_t k = 0; loaded_ && k < load_.size(); ++k) energy += 0.5 * dq[k / n_] * load_[k] * dq[k % n_];
  return energy;
}

void Equations::inverse_dynamics_derivatives(const double* x, const double* a, double* by_q, double* by_dq) {
  robot::inverse_dynamics_derivatives(dynamics_->mechanism, dynamics_->data, ConstMap(x, index(n_)),
                                      ConstMap(x + n_, index(n_)), ConstMap(a, index(n_)),
                                      MatrixMap(by_q, index(n_), index(n_)), MatrixMap(by_dq, index(n_), index(n_)));
}

void Equations::energy_gradients(const double* x, double* kinetic_by_q, double* potential_by_q) {
  const ConstMap q(x, index(n_)), dq(x + n_, index(n_));
  robot::coriolis_matrix(dynamics_->mechanism, dynamics_->data, q, dq, MatrixMap(scratch_.data(), index(n_), index(n_)));
  for (std::size_t j = 0; j < n_; ++j) {
    kinetic_by_q[j] = 0;
    for (std::size_t i = 0; i < n_; ++i) kinetic_by_q[j] += scratch_[j * n_ + i] * x[n_ + i];
  }
  robot::gravity(dynamics_->mechanism, dynamics_->data, q, Map(potential_by_q, index(n_)));
}

void Equations::acceleration(double t, const Point& p, double* ddq) {
  std::copy(p.M.begin(), p.M.end(), scratch_.begin());
  ldlt(scratch_.data(), n_);
  for (std::size_t i = 0; i < n_; ++i) ddq[i] = link_balance(p, i, t, p.h[i]);  // (2a)
  solve_ldlt(scratch_.data(), n_, ddq);
}

void Equations::torque_terms(const double* x, const Point& p, const double* ddq, TorqueTerms& terms) {
  times_M(p.M.data(), ddq, terms.inertia.data());
  if (floating_) {
    std::fill(terms.gravity.begin(), terms.gravity.end(), 0.0);  // in free fall
  } else {
    robot::gravity(dynamics_->mechanism, dynamics_->data, ConstMap(x, index(n_)), Map(terms.gravity.data(), index(n_)));
  }
  times_M(load_.data(), ddq, scratch_.data());
  for (std::size_t i = 0; i < n_; ++i) {
    terms.inertia[i] -= scratch_[i];
    if (!flexible()) terms.inertia[i] -= parameters_.B[i] * ddq[i];  // p.M has B on its diagonal
    terms.coriolis[i] = p.h[i] - terms.gravity[i];
    terms.link[i] = (flexible() ? p.tau_J[i] : -p.tau_f[i]) - p.force[i];
  }
}

void Equations::derivative(double t, const double* x, const Point& p, double* dx) {
  if (inside()) {
    std::copy(x + n_, x + 2 * n_, dx);
    acceleration(t, p, dx + n_);
  } else {
    std::fill(dx, dx + 2 * n_, 0.0);
  }
  for (std::size_t i = 0; i < n_; ++i) {
    const bool moves = flexible() && !stuck(i);
    dx[2 * n_ + i] = moves ? x[3 * n_ + i] : 0;
    dx[3 * n_ + i] = moves ? motor_balance(p, i, motor_torque(i, t)) / parameters_.B[i] : 0;  // (2b)
    dx[4 * n_ + i] = p.dz[i];
  }
}

void Equations::factorise(const Point& p, double gamma) {
  gamma_ = gamma;
  L_ = p.M;
  for (std::size_t i = 0; i < n_; ++i) {
    z_inverse_[i] = 1 / (1 - gamma * std::min(p.z_z[i], 0.0));
    const double d_f = std::max(p.f_w[i] + gamma * p.f_z[i] * p.z_w[i] * z_inverse_[i], 0.0);
    const double k_l = std::max(p.k_l[i], 0.0), rest = gamma * (std::max(p.d_l[i], 0.0) + gamma * k_l);
    f_z_[i] = p.f_z[i];
    z_w_[i] = p.z_w[i];
    k_l_[i] = k_l;
    kappa_[i] = p.kappa[i];
    if (flexible()) {
      const double coupling = gamma * (parameters_.D[i] + gamma * p.kappa[i]);  // γ e
      const double own = parameters_.B[i] + gamma * d_f;
      P_inverse_[i] = stuck(i) ? 0 : 1 / (own + coupling);
      ratio_[i] = coupling * P_inverse_[i];
      L_[i * n_ + i] += rest + (stuck(i) ? coupling : own * ratio_[i]);
    } else {
      L_[i * n_ + i] += rest + gamma * d_f;
    }
  }
  if (inside()) ldlt(L_.data(), n_);
}

void Equations::solve(const double* b, double* k) const {
  const double* bq = b;
  const double *bv = b + n_, *btheta = b + 2 * n_, *bw = b + 3 * n_, *bz = b + 4 * n_;
  double *kq = k, *kv = k + n_, *ktheta = k + 2 * n_, *kw = k + 3 * n_, *kz = k + 4 * n_;
  const double gamma = gamma_;
  if (!flexible()) {
    for (std::size_t i = 0; i < n_; ++i) kv[i] = bv[i] - gamma * (k_l_[i] * bq[i] + f_z_[i] * bz[i] * z_inverse_[i]);
    solve_ldlt(L_.data(), n_, kv);
    for (std::size_t i = 0; i < n_; ++i) {
      kq[i] = bq[i] + gamma * kv[i];
      kz[i] = (bz[i] + gamma * z_w_[i] * kv[i]) * z_inverse_[i];
      ktheta[i] = kw[i] = 0;
    }
    return;
  }
  for (std::size_t i = 0; i < n_; ++i) {
    const double bz_i = bz[i] * z_inverse_[i];
    const double stretch = gamma * kappa_[i] * (btheta[i] - bq[i]);
    const double R = bw[i] - stretch - gamma * f_z_[i] * bz_i;
    kv[i] = bv[i] + stretch - gamma * k_l_[i] * bq[i] + ratio_[i] * R;
    kw[i] = R * P_inverse_[i];
    kz[i] = bz_i;
  }
  if (inside()) {
    solve_ldlt(L_.data(), n_, kv);
  } else {
    std::fill(kv, kv + n_, 0.0);
  }
  for (std::size_t i = 0; i < n_; ++i) {
    kw[i] += ratio_[i] * kv[i];
    kq[i] = bq[i] + gamma * kv[i];
    ktheta[i] = btheta[i] + gamma * kw[i];
    kz[i] += gamma * z_w_[i] * z_inverse_[i] * kw[i];
  }
}

void Equations::times_M(const double* M, const double* x, double* y) const {
  std::fill(y, y + n_, 0.0);
  for (std::size_t j = 0; j < n_; ++j) {
    for (std::size_t i = 0; i < n_; ++i) y[i] += M[j * n_ + i] * x[j];
  }
}

double Equations::dissipation(const double* x, const Point& p) const {
  const double *q = x, *dq = x + n_, *dtheta = x + 3 * n_, *z = x + 4 * n_;
  double power = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    const double w = flexible() ? dtheta[i] : dq[i];
    // The energy that the bristle stores and the work of the constant part are not lost.
    power += (p.tau_f[i] - (stuck(i) ? 0 : parameters_.tau_0[i])) * w - parameters_.sigma0[i] * z[i] * p.dz[i];
    if (flexible()) power += parameters_.D[i] * (w - dq[i]) * (w - dq[i]);
    if (!inside()) continue;
    power += link_side_[i].loss(dq[i], p.gravity[i]);
    if (has_stops_ && modes_.stop[i] != 0) {
      const auto s = stop(i, q[i], dq[i]);
      power += (s.torque - stop_spring(i, q[i])) * modes_.stop[i] * dq[i];
    }
  }
  return power;
}

double Equations::work_of_constant_friction(const double* from, const double* to) const {
  double work = 0;
  for (std::size_t i = 0; i < n_; ++i) {
    const double dq = to[i] - from[i], motor = flexible() ? to[2 * n_ + i] - from[2 * n_ + i] : dq;
    work += parameters_.tau_0[i] * motor;
    if (inside()) work += link_side_[i].constant() * dq;
  }
  return work;
}

double Equations::stop_spring(std::size_t i, double q) const {
  if (modes_.stop[i] == 0) return 0;
  return parameters_.stop_stiffness[i] * std::max(stop_depth(i, q), 0.0);
}

Energies Equations::energies(const double* x, const Point& p) {
  const double *q = x, *dq = x + n_, *theta = x + 2 * n_, *dtheta = x + 3 * n_, *z = x + 4 * n_;
  Energies e;
  if (inside()) {
    times_M(p.M.data(), dq, scratch_.data());
    for (std::size_t i = 0; i < n_; ++i) e.kinetic += 0.5 * dq[i] * scratch_[i];
    e.kinetic -= load_energy(dq);
    if (floating_) {
      e.kinetic += floating_->kinetic_energy(q);
      e.potential = floating_->potential_energy();
    } else {
      e.potential = robot::potential_energy(dynamics_->mechanism, dynamics_->data, ConstMap(q, index(n_)));
    }
  }
  for (std::size_t i = 0; i < n_; ++i) {
    if (flexible()) {
      e.kinetic += 0.5 * parameters_.B[i] * dtheta[i] * dtheta[i];
      e.elastic += torsion_[i].energy(theta[i] - q[i]);
    }
    e.elastic += 0.5 * parameters_.sigma0[i] * z[i] * z[i];
    if (!link_side_[i].viscous_only) e.elastic += link_side_[i].spring.energy(q[i]);
    if (has_stops_ && modes_.stop[i] != 0) {
      const double spring = stop_spring(i, q[i]);
      e.elastic += 0.5 * spring * spring / parameters_.stop_stiffness[i];
    }
  }
  return e;
}

}  // namespace cotwin::drive_train
