#include "components/drive_train/floating_links.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::drive_train {
namespace {

using Eigen::Quaterniond;
using Eigen::Vector3d;
using Values = std::vector<double>;

Vector3d vector3(const Values& v) { return {v[0], v[1], v[2]}; }
void put(const Vector3d& v, Values& to) { std::copy_n(v.data(), 3, to.begin()); }

/// (w, x, y, z) with w >= 0.
void put(const Quaterniond& Q, Values& to) {
  const double sign = Q.w() < 0 ? -1 : 1;
  const double values[] = {sign * Q.w(), sign * Q.x(), sign * Q.y(), sign * Q.z()};
  std::copy_n(values, 4, to.begin());
}

/// The rotation by a vector's length about it.
Quaterniond rotation(const Vector3d& r) {
  const double angle = r.norm(), half = 0.5 * angle;
  const Vector3d v = r * (angle > 0 ? std::sin(half) / angle : 0.5);
  return {std::cos(half), v.x(), v.y(), v.z()};
}

void check_finite(const std::string& place, const char* name, const Values& v, double now) {
  for (std::size_t i = 0; i < v.size(); ++i) {
    if (std::isfinite(v[i])) continue;
    throw Error(place + "." + name + "[" + std::to_string(i + 1) + "]",
                "is " + text::to_text(v[i]) + " at " + text::to_text(now) + " s, expected a finite value");
  }
}

}  // namespace

FloatingLinks::FloatingLinks(const robot::RobotModel& robot)
    : mechanism_(robot),
      data_(mechanism_),
      inertia_(robot.n()),
      gravity_{robot.gravity.x(), robot.gravity.y(), robot.gravity.z()},
      omega_(Vector3d::Zero()),
      alpha_(Vector3d::Zero()),
      spin_rate_(Vector3d::Zero()),
      spin_B_(Vector3d::Zero()),
      W_B_(Wrench::Zero()),
      ddq_(Eigen::VectorXd::Zero(robot.n())),
      q_middle_(ddq_),
      dq_middle_(ddq_) {}

void FloatingLinks::declare(Variables& v) {
  v.input("base_f", f_, "N", "sum of the external forces on the robot, in W; those on links are also in tau_e, by J^T F");
  v.input("base_m", m_, "N.m", "their moment about the base's origin, in W");
  v.parameter("base_p0", p0_, "m", "position of the base in W at the start");
  v.parameter("base_quat0", quat0_, "1", "orientation of the base in W at the start, unit quaternion (w, x, y, z)");
  v.parameter("base_v0", v0_, "m/s", "velocity of the base's origin in W at the start");
  v.parameter("base_w0", w0_, "rad/s", "angular velocity of the base in W at the start");
  v.parameter("gravity", gravity_, "m/s2", "gravity in W");
  v.output("base_p", p_, "m", "position of the floating base in W").initially_from({});
  v.output("base_quat", quat_, "1", "its orientation in W, unit quaternion (w, x, y, z) with w >= 0").initially_from({});
  v.output("base_v", v_, "m/s", "velocity of its origin in W").initially_from({});
  v.output("base_w", w_, "rad/s", "its angular velocity in W").initially_from({});
  v.output("momentum", momentum_, "kg.m/s", "linear momentum of the robot, in W");
  v.output("spin", spin_, "kg.m2/s", "angular momentum of the robot about its centre of mass, in W").initially_from({});
  v.output("centre_of_mass", centre_, "m", "centre of mass of the robot in W");
  v.output("base_work", work_, "J", "part of work_e that base_f and base_m did");
}

void FloatingLinks::check_parameters(const std::string& place) const {
  check_finite(place, "base_p0", p0_, 0);
  check_finite(place, "base_v0", v0_, 0);
  check_finite(place, "base_w0", w0_, 0);
  check_finite(place, "gravity", gravity_, 0);
  const double length = Quaterniond(quat0_[0], quat0_[1], quat0_[2], quat0_[3]).norm();
  if (!(std::abs(length - 1) < 1e-6))
    throw Error(place + ".base_quat0", "the quaternion (w, x, y, z) has length " + text::to_text(length) + ", expected 1");
}

void FloatingLinks::check_inputs(const std::string& place, double now) const {
  check_finite(place, "base_f", f_, now);
  check_finite(place, "base_m", m_, now);
}

void FloatingLinks::initialise(const double* q, const double* dq) {
  put(Quaterniond(quat0_[0], quat0_[1], quat0_[2], quat0_[3]).normalized(), quat_);
  p_ = p0_;
  v_ = v0_;
  w_ = w0_;
  work_ = 0;
  set_velocity(q, dq);
  hold(q, dq);
  write_outputs(q, dq);
}

void FloatingLinks::set_velocity(const double* q, const double* dq) {
  const Quaterniond Q = attitude();
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  Twist V;
  V << Q.conjugate() * vector3(v_), Q.conjugate() * vector3(w_);
  const Wrench h = inertia_.momentum(V, joints(dq));
  put(Q * Vector3d(h.head<3>()), momentum_);
  put(Q * Vector3d(h.tail<3>() - inertia_.p_C.cross(h.head<3>())), spin_);
  put(vector3(p_) + Q * inertia_.p_C, centre_);
}

Vector3d FloatingLinks::angular_velocity(const Quaterniond& Q, const Vector3d& spin_W, const double* q, const double* dq) {
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  return inertia_.base_spin(Q.conjugate() * spin_W, joints(dq));
}

Vector3d FloatingLinks::moment_about_centre(const Quaterniond& Q, const Vector3d& p_C) const {
  return vector3(m_) - (Q * p_C).cross(vector3(f_));
}

void FloatingLinks::hold(const double* q, const double* dq) {
  const Quaterniond Q = attitude();
  omega_ = angular_velocity(Q, vector3(spin_), q, dq);
  spin_rate_ = moment_about_centre(Q, inertia_.p_C);
  alpha_.setZero();
  attitude_at(0);
}

void FloatingLinks::begin_step(const double* q, const double* dq, const double* ddq) {
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  alpha_ = base_acceleration(mechanism_, data_, inertia_, joints(q), joints(dq), joints(ddq), spin_B_, W_B_).tail<3>();
}

void FloatingLinks::attitude_at(double t) {
  const Quaterniond back = (attitude() * rotation(t * omega_ + 0.5 * t * t * alpha_)).conjugate();
  spin_B_ = back * (vector3(spin_) + t * spin_rate_);
  W_B_ << back * vector3(f_), back * vector3(m_);
}

void FloatingLinks::mass_matrix_and_bias(const double* q, const double* dq, double* M, double* h) {
  const Eigen::Index n = mechanism_.n();
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  Eigen::Map<Eigen::MatrixXd>(M, n, n) = inertia_.M_star;
  ddq_.setZero();
  reduced_inverse_dynamics(mechanism_, data_, inertia_, joints(q), joints(dq), ddq_, spin_B_, W_B_,
                           Eigen::Map<Eigen::VectorXd>(h, n));
}

void FloatingLinks::inverse_dynamics(const double* q, const double* dq, const double* a, double* tau) {
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  reduced_inverse_dynamics(mechanism_, data_, inertia_, joints(q), joints(dq), joints(a), spin_B_, W_B_,
                           Eigen::Map<Eigen::VectorXd>(tau, mechanism_.n()));
}

// Magnus' series of the attitude: Q exp(h/6 (ω0 + 4 ωm + ω1) + h²/12 ω0 × ω1), with the joints' motion between the ends as
// Hermite's cubic. ω1 depends on the attitude that it leads to; two rounds leave an error below that of the series.
void FloatingLinks::end_step(double h, const double* q0, const double* dq0, const double* q1, const double* dq1) {
  const Quaterniond Q = attitude();
  const Vector3d spin = vector3(spin_), f = vector3(f_), gravity = vector3(gravity_);
  const double power_0 = wrench_power();
  q_middle_ = 0.5 * (joints(q0) + joints(q1)) + h / 8 * (joints(dq0) - joints(dq1));
  if (h > 0) dq_middle_ = 1.5 / h * (joints(q1) - joints(q0)) - 0.25 * (joints(dq0) + joints(dq1));
  const Quaterniond Q_middle = Q * rotation(0.5 * h * omega_ + 0.125 * h * h * alpha_);
  const Vector3d middle = angular_velocity(Q_middle, spin + 0.5 * h * spin_rate_, q_middle_.data(), dq_middle_.data());
  const double mass = inertia_.mass;
  floating_inertia(mechanism_, data_, joints(q1), inertia_);
  Quaterniond Q_end = Q * rotation(h * omega_ + 0.5 * h * h * alpha_);
  Vector3d spin_end = spin;
  for (int round = 0; round < 2; ++round) {
    spin_end = spin + 0.5 * h * (spin_rate_ + moment_about_centre(Q_end, inertia_.p_C));
    const Vector3d last = inertia_.base_spin(Q_end.conjugate() * spin_end, joints(dq1));
    Q_end = Q * rotation(h / 6 * (omega_ + 4 * middle + last) + h * h / 12 * omega_.cross(last));
  }
  put(Q_end.normalized(), quat_);
  put(spin_end, spin_);
  const Vector3d a = gravity + f / mass, l = vector3(momentum_);
  put(vector3(centre_) + h * (l / mass + 0.5 * h * a), centre_);
  put(l + h * mass * a, momentum_);
  write_outputs(q1, dq1);
  work_ += 0.5 * h * (power_0 + power_);
}

double FloatingLinks::kinetic_energy(const double* q) {
  floating_inertia(mechanism_, data_, joints(q), inertia_);
  const Vector3d spin = attitude().conjugate() * vector3(spin_);
  return 0.5 * spin.dot(inertia_.I_C_inverse * spin) + 0.5 * vector3(momentum_).squaredNorm() / inertia_.mass;
}

double FloatingLinks::potential_energy() const { return -inertia_.mass * vector3(gravity_).dot(vector3(centre_)); }

void FloatingLinks::write_outputs(const double* q, const double* dq) {
  const Quaterniond Q = attitude();
  const Vector3d w = angular_velocity(Q, vector3(spin_), q, dq);
  Wrench h;
  const Vector3d l = Q.conjugate() * vector3(momentum_);
  h << l, Q.conjugate() * vector3(spin_) + inertia_.p_C.cross(l);
  const Twist V = inertia_.base_twist(h, joints(dq));
  put(vector3(centre_) - Q * inertia_.p_C, p_);
  put(Q * Vector3d(V.head<3>()), v_);
  put(Q * w, w_);
  power_ = wrench_power();
}

double FloatingLinks::wrench_power() const { return vector3(f_).dot(vector3(v_)) + vector3(m_).dot(vector3(w_)); }

}  // namespace cotwin::drive_train
