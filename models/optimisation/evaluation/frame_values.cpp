#include "models/optimisation/evaluation/frame_values.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace cotwin::optimisation {

using numerics::advance;
using numerics::Deviation;
using numerics::SecondOrder;

namespace {

constexpr double kResting = 1e-9;  // m/s; below, a velocity has no direction

/// The time between low and high at which |x| falls to `band`; |x| is monotone there.
double crossing(const SecondOrder& system, const Deviation& start, double low, double high, double band) {
  for (int i = 0; i < 60 && high - low > 1e-14 * high; ++i) {
    const double middle = 0.5 * (low + high);
    const double x = advance(system, start, 0, 0, middle).x;
    // A negative product is a zero that was passed.
    (std::abs(x) > band && x * start.x > 0 ? low : high) = middle;
  }
  return high;
}

SecondOrder with_load(const ComplianceValues& v, double load) { return {v.M + load, v.D, v.S}; }

double largest_of(const std::vector<double>& values, double norm) {
  const double most = *std::max_element(values.begin(), values.end());
  if (norm == 0 || !(most > 0) || !std::isfinite(most)) return most;
  double sum = 0;
  for (const double x : values) sum += std::pow(x / most, norm);
  return most * std::pow(sum / static_cast<double>(values.size()), 1 / norm);
}

void take(std::size_t i, std::size_t count, const double* from, Eigen::VectorXd& to) {
  for (Eigen::Index j = 0; j < to.size(); ++j) to[j] = from[static_cast<std::size_t>(j) * count + i];
}

}  // namespace

double settled_after(const SecondOrder& system, const Deviation& start, double band) {
  const double omega = std::sqrt(system.S / system.M), zeta = system.D / (2 * std::sqrt(system.S * system.M));
  const double root = std::sqrt(std::abs((zeta - 1) * (zeta + 1)));
  const auto outside = [&](const Deviation& at) { return std::abs(at.x) > band; };
  if (zeta < 1 && root > 1e-7) {
    // Extremes are half a period apart, and each is smaller than the one before by the same factor.
    const double half = std::numbers::pi / (omega * root);
    double first = std::atan2(start.dx * root * omega, zeta * omega * start.dx + omega * omega * start.x) / (omega * root);
    if (first < 0) first += half;
    const Deviation extreme = advance(system, start, 0, 0, first);
    if (!outside(extreme)) return outside(start) ? crossing(system, start, 0, first, band) : 0;
    const double decay = zeta / root * std::numbers::pi;  // −ln of the factor
    const double last = std::floor(std::log(std::abs(extreme.x) / band) / decay);
    const double at = last * half;
    const Deviation from{extreme.x * std::exp(-decay * last), 0};
    return first + at + crossing(system, from, 0, half, band);
  }
  const double fast = omega * (zeta + (zeta < 1 ? 0 : root)), slow = omega * omega / fast;
  const double apart = fast - slow, ratio = start.dx / (slow * (start.dx + fast * start.x));
  double extreme = 0;  // s
  if (apart * ratio > -1) extreme = apart > 1e-9 * slow ? std::log1p(apart * ratio) / apart : ratio;
  Deviation from = start;
  if (extreme > 0 && std::isfinite(extreme)) {
    const Deviation there = advance(system, start, 0, 0, extreme);
    if (outside(there))
      from = there;
    else if (outside(start))
      return crossing(system, start, 0, extreme, band);
    else
      return 0;
  } else {
    extreme = 0;
  }
  if (!outside(from)) return 0;
  double high = 1 / slow;
  while (std::isfinite(high) && outside(advance(system, from, 0, 0, high))) high *= 2;
  return extreme + crossing(system, from, 0, high, band);
}

double damping_ratio(const ComplianceValues& v, double load) { return v.D / (2 * std::sqrt((v.M + load) * v.S)); }
double natural_frequency(const ComplianceValues& v, double load) { return std::sqrt(v.S / (v.M + load)); }

CompliantMotion::CompliantMotion(const robot::RobotModel& robot, const CompliantFrame& frame)
    : frame_(frame), kinematics_(robot, frame.frame), q_(robot.n()), dq_(robot.n()), ddq_(robot.n()) {}

void CompliantMotion::set(std::size_t count, double T, const double* q, const double* dq, const double* ddq) {
  count_ = count;
  step_ = T / static_cast<double>(count - 1);
  acceleration_.resize(frame_.axes.size() * count);
  for (std::size_t i = 0; i < count; ++i) {
    take(i, count, q, q_);
    take(i, count, dq, dq_);
    take(i, count, ddq, ddq_);
    const Eigen::Vector3d a = kinematics_.at(q_, dq_, ddq_).dV.head<3>();
    for (std::size_t k = 0; k < frame_.axes.size(); ++k) acceleration_[k * count + i] = frame_.axes[k].u.dot(a);
  }
}

AxisResponse CompliantMotion::respond(std::size_t axis, const ComplianceValues& values) const {
  const SecondOrder system = with_load(values, frame_.load);
  const double* a = acceleration_.data() + axis * count_;
  // The state after a step is linear in the state before it and in the accelerations at both ends.
  const double by = frame_.load, slope = frame_.load / step_;
  const Deviation of_x = advance(system, {1, 0}, 0, 0, step_), of_dx = advance(system, {0, 1}, 0, 0, step_);
  const Deviation of_first = advance(system, {}, -by, slope, step_), of_second = advance(system, {}, 0, -slope, step_);
  Deviation at;
  AxisResponse response;
  for (std::size_t i = 0; i + 1 < count_; ++i) {
    at = {of_x.x * at.x + of_dx.x * at.dx + of_first.x * a[i] + of_second.x * a[i + 1],
          of_x.dx * at.x + of_dx.dx * at.dx + of_first.dx * a[i] + of_second.dx * a[i + 1]};
    response.deflection = std::max(response.deflection, std::abs(at.x));
  }
  response.settle = settled_after(system, at, frame_.settled);
  return response;
}

double CompliantMotion::violation(std::span<const ComplianceValues> values, std::span<const AxisResponse> responses) const {
  constexpr double kRounding = 1e-9;
  double beyond = 0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    if (frame_.zeta_min > 0) beyond += std::max(0.0, 1 - damping_ratio(values[k], frame_.load) / frame_.zeta_min - kRounding);
    beyond += std::max(0.0, natural_frequency(values[k], frame_.load) / frame_.omega_max - 1 - kRounding);
    beyond += std::max(0.0, responses[k].deflection / frame_.deflection_max - 1 - kRounding);
  }
  return beyond;
}

ContactMotion::ContactMotion(const robot::RobotModel& robot, const ContactFrame& frame)
    : frame_(frame),
      mechanism_(robot),
      data_(mechanism_),
      B_(Eigen::Map<const Eigen::VectorXd>(frame.B.data(), static_cast<Eigen::Index>(frame.B.size()))),
      inertia_(robot.n()),
      q_(robot.n()),
      dq_(robot.n()),
      ddq_(robot.n()) {}

ContactMotion::Largest ContactMotion::largest(std::size_t count, const double* q, const double* dq, const double* ddq,
                                              double norm) {
  mass_.assign(count, 0.0);
  share_.assign(count, 0.0);
  for (std::size_t i = 0; i < count; ++i) {
    take(i, count, q, q_);
    take(i, count, dq, dq_);
    take(i, count, ddq, ddq_);
    robot::frame_inertia(mechanism_, data_, q_, B_, frame_.frame, inertia_);
    const Eigen::Vector3d v = inertia_.J.topRows<3>() * dq_;
    // At rest along the acceleration, into which the velocity turns.
    const Eigen::Vector3d towards = v.norm() > kResting ? v : Eigen::Vector3d(inertia_.J.topRows<3>() * ddq_);
    const Eigen::Vector3d u = frame_.u             ? *frame_.u
                              : towards.norm() > 0 ? Eigen::Vector3d(towards.stableNormalized())
                                                   : Eigen::Vector3d::UnitX();
    mass_[i] = robot::effective_mass(inertia_, u, frame_.load);
    const double mass = std::max(mass_[i], frame_.least_mass);
    const double speed = std::abs(u.dot(v));
    for (const robot::BodyPart& part : frame_.parts) {
      const double force = (frame_.transient ? part.transient : part.quasi_static).on(frame_.area);
      if (speed > 0)
        share_[i] = std::max(share_[i],
                             speed / robot::speed_limit_of_force(force, part.stiffness, robot::reduced_mass(mass, part.mass)));
    }
  }
  return {largest_of(mass_, norm), largest_of(share_, norm)};
}

}  // namespace cotwin::optimisation
