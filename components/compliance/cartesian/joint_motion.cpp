#include "components/compliance/cartesian/joint_motion.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "components/compliance/cartesian/rotation.h"
#include "models/robot/robot_model.h"

namespace cotwin::compliance {
namespace {

using Eigen::Index;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

/// The error of a pose [p; 2 η ε] with the rotations scaled, for the rendered directions.
void rendered(const std::vector<int>& directions, const Twist& twist, VectorXd& r) {
  for (std::size_t k = 0; k < directions.size(); ++k) {
    const int i = directions[k];
    r[static_cast<Index>(k)] = i < 3 ? twist[i] : JointMotion::kLength * twist[i];
  }
}

double least_eigenvalue(const Eigen::MatrixXd& A) {
  using Small = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 6, 6>;
  Eigen::SelfAdjointEigenSolver<Small> solver(A.rows());
  solver.compute(A, Eigen::EigenvaluesOnly);
  return solver.eigenvalues()[0];
}

MovingPose moved(const MovingPose& from, const Twist& by) {
  return {from.p + by.head<3>(), quaternion_of(by.tail<3>()) * from.Q, from.V};
}

Twist between(const MovingPose& a, const MovingPose& b) {
  Twist d;
  d << b.p - a.p, axis_angle(b.Q * a.Q.conjugate());
  return d;
}

}  // namespace

JointMotion::JointMotion(const robot::RobotModel& robot, std::vector<int> directions) : directions_(std::move(directions)) {
  const Index n = robot.n(), m = static_cast<Index>(directions_.size());
  for (VectorXd* v : {&q, &dq, &ddq, &q_mid_, &xi_, &tau_}) v->setZero(n);
  met.resize(static_cast<std::size_t>(n));
  J6_.setZero(6, n);
  J_.setZero(m, n);
  M_.setZero(n, n);
  Y_.setZero(n, m);
  A_.setZero(m, m);
  G_.setZero(m, m);
  r_.setZero(m);
  M_llt_ = Eigen::LLT<Eigen::MatrixXd>(n);
  A_llt_ = Eigen::LLT<Eigen::MatrixXd>(m);
}

void JointMotion::evaluate(Links& links, const VectorXd& at, const JointMotionGains& gains) {
  X_ = links.jacobian(at, E_, J6_);
  links.mass_matrix(at, M_);
  for (std::size_t k = 0; k < directions_.size(); ++k) {
    const int i = directions_[k];
    J_.row(static_cast<Index>(k)) = (i < 3 ? 1 : kLength) * J6_.row(i);
  }
  M_llt_.compute(M_);
  Y_ = J_.transpose();
  M_llt_.matrixL().solveInPlace(Y_);
  A_.noalias() = Y_.transpose() * Y_;
  G_.noalias() = J_ * J_.transpose();
  sigma_min = std::sqrt(std::max(least_eigenvalue(G_), 0.0));
  lambda = 0;
  if (sigma_min < gains.sigma_0) {
    const double ratio = sigma_min / gains.sigma_0;
    lambda = gains.lambda_0 * std::sqrt(1 - ratio * ratio);
    A_.diagonal().array() += lambda * lambda * A_.trace() / static_cast<double>(A_.rows());
  }
  A_llt_.compute(A_);
}

void JointMotion::start(Links& links, const VectorXd& at, const Twist& V, const JointMotionGains& gains) {
  q = at;
  evaluate(links, q, gains);
  rendered(directions_, V, r_);
  A_llt_.solveInPlace(r_);
  dq.noalias() = Y_ * r_;
  M_llt_.matrixU().solveInPlace(dq);
  ddq.setZero();
  std::ranges::fill(met, 0);
}

void JointMotion::null_space(const AtJoints& at, const JointMotionGains& gains, VectorXd& xi) { xi = -gains.k_nu * at.dq; }

void JointMotion::advance(Links& links, const MovingPose& before, const MovingPose& after, const Twist& end_acceleration,
                          std::span<const Limits> limits, const JointMotionGains& gains, double h) {
  constexpr double kShort = 0.2, kMostParts = 100;
  const int count = static_cast<int>(std::clamp(std::ceil(h * gains.omega_k / kShort), 1.0, kMostParts));
  const double length = h / count;
  const Twist mean = (after.V - before.V) / h, way = between(before, after);
  std::ranges::fill(met, 0);
  for (int k = 0; k < count; ++k) {
    const double s = static_cast<double>(k) / count;
    MovingPose from = moved(before, s * way + s * (1 - s) / 2 * h * (before.V - after.V));
    from.V = before.V + s * (after.V - before.V);
    part(links, from, mean, limits, gains, length);
  }
  // The acceleration at the end, which differs from the mean by that of the task.
  rendered(directions_, end_acceleration - mean, r_);
  A_llt_.solveInPlace(r_);
  tau_.noalias() = Y_ * r_;
  M_llt_.matrixU().solveInPlace(tau_);
  ddq += tau_;
}

// With J in the middle of the part, where q̇_c is still to come: ẋ_c − J (q̇_c + h/2 q̈_c) on both sides of the equation.
void JointMotion::part(Links& links, const MovingPose& before, const Twist& acceleration, std::span<const Limits> limits,
                       const JointMotionGains& gains, double h) {
  q_mid_ = q + h / 2 * dq;
  evaluate(links, q_mid_, gains);
  const MovingPose target = moved(before, h / 2 * before.V);
  const Quaterniond R(X_.R);
  Quaterniond E = target.Q * R.conjugate();
  Twist error, drift;
  error << target.p - X_.p, 2 * E.w() * E.vec();
  links.jacobian_dot_times_dq(q_mid_, dq, E_, drift);
  const double K_v = 2 * gains.omega_k, K_p = gains.omega_k * gains.omega_k;
  const Twist feedback = K_v * (before.V - J6_ * dq) + K_p * error - drift;
  rendered(directions_, acceleration + feedback / (1 + K_v * h / 2), r_);
  null_space({q_mid_, dq, M_, J_}, gains, xi_);
  r_.noalias() -= J_ * xi_;
  A_llt_.solveInPlace(r_);
  ddq.noalias() = Y_ * r_;
  M_llt_.matrixU().solveInPlace(ddq);
  ddq += xi_;
  bound(limits, h);
  q += h * dq + h * h / 2 * ddq;
  dq += h * ddq;
}

void JointMotion::bound(std::span<const Limits> limits, double h) {
  for (Index i = 0; i < q.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Limits& l = limits[k];
    const double middle = l.bound_position() ? (l.q_min + l.q_max) / 2 : 0;
    const Desired rest{middle, 0};
    const Deviation now{q[i] - middle, dq[i]};
    const double then = dq[i] + h * ddq[i];
    if (clear_of(l, rest, {now.x + h * (now.dx + then) / 2, then})) continue;
    const Allowed may = allowed(l, rest, now, h);
    const double bounded = std::max(std::min(then, may.dx_high), may.dx_low);
    if (bounded == then) continue;
    met[k] = static_cast<std::int32_t>(then > bounded ? may.high : may.low);
    ddq[i] = (bounded - dq[i]) / h;
  }
}

Wrench JointMotion::wrench_of(Links& links, const VectorXd& tau, const JointMotionGains& gains) {
  evaluate(links, q, gains);
  tau_ = tau;
  M_llt_.matrixL().solveInPlace(tau_);
  r_.noalias() = Y_.transpose() * tau_;
  A_llt_.solveInPlace(r_);
  Wrench w = Wrench::Zero();
  for (std::size_t k = 0; k < directions_.size(); ++k) {
    const int i = directions_[k];
    w[i] = (i < 3 ? 1 : kLength) * r_[static_cast<Index>(k)];
  }
  return w;
}

}  // namespace cotwin::compliance
