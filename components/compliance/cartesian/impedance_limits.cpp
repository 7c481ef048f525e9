#include "components/compliance/cartesian/impedance_limits.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::compliance {
namespace {

using Eigen::Index;

/// Steps of the sampled torque in the time constant of a wall's damper.
constexpr double kSamples = 4;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// The share of a limited speed from which on a row counts: nothing accelerates across the rest within a step.
constexpr double kNear = 0.5;

/// How far a wall is pressed in, rad (m). It gives way further on: a limit that is moved to the other side of the robot becomes a wall
/// that is this deep in it, pushes it back by this and stays there.
constexpr double kDeepest = 0.02;

/// How far a wall is behind its limit, for a motion at `depth` behind that limit.
double follow(double beyond, double depth) { return std::max(std::min(beyond, std::max(depth, 0.0)), depth - kDeepest); }

/// The time constant T of a wall of joint k with the inertia m: four of its damper, which a torque held for h must not make unstable where
/// it moves the light motor of an elastic joint alone.
double time_constant(double h, double m, const robot::DriveParameters& drives, const Joints& shaping, std::size_t k) {
  const double of_motor = drives.K[k] > 0 && drives.B[k] > 0 ? shaping[k] / drives.B[k] : 0.0;
  return 4 * h * std::max(kSamples, 2 * of_motor * m);
}

}  // namespace

Approach approach(double s, double speed, double braking, double T) {
  const double linear = braking * T * T;
  const double w = s < linear ? s / T : std::sqrt(2 * braking * (s - linear / 2));
  const double slope = s < linear ? 1 / T : braking / w;  // dw/ds
  return {w, 4 / T * (w - speed) - slope * speed};
}

ImpedanceLimits::ImpedanceLimits(Index n)
    : beyond_high(Eigen::VectorXd::Zero(n)),
      beyond_low(beyond_high),
      met(static_cast<std::size_t>(n)),
      ddq_(beyond_high),
      g_(beyond_high) {
  rows_.resize(static_cast<std::size_t>(2 * n));
  Y_.setZero(n, 2 * n);
  A_.setZero(2 * n, 2 * n);
  lambda_.setZero(2 * n);
  a_.setZero(2 * n);
}

void ImpedanceLimits::start(const Eigen::VectorXd& q, std::span<const Limits> joints) {
  for (Index i = 0; i < q.size(); ++i) {
    const Limits& l = joints[static_cast<std::size_t>(i)];
    beyond_high[i] = std::max(q[i] - l.q_max, 0.0);
    beyond_low[i] = std::max(l.q_min - q[i], 0.0);
  }
}

void ImpedanceLimits::take(const Robot& robot, std::span<const Limits> joints) {
  count_ = 0;
  for (Index i = 0; i < robot.q.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    const Limits& l = joints[k];
    const double highest = std::max(robot.q[i], robot.q_measured[k]), lowest = std::min(robot.q[i], robot.q_measured[k]);
    met[k] = 0;
    if (l.bound_position()) {
      beyond_high[i] = follow(beyond_high[i], highest - l.q_max);
      beyond_low[i] = follow(beyond_low[i], l.q_min - lowest);
    }
    const double T = time_constant(robot.h, robot.M(i, i), robot.drives, robot.shaping, k);
    for (const int side : {1, -1}) {
      const double outward = side * robot.dq[i];
      Approach may{kInfinity, kInfinity};
      Limit limit = Limit::kNone;
      if (l.bound_position()) {
        const double s = side > 0 ? l.q_max + beyond_high[i] - highest : lowest - l.q_min + beyond_low[i];
        may = approach(s, outward, l.braking, T);
        limit = Limit::kPosition;
      }
      if (l.bound_speed() && l.dq_max < std::abs(may.speed)) {
        const double w = std::copysign(l.dq_max, may.speed);  // back, from deep in a wall, no faster than that either
        may = {w, 4 / T * (w - outward)};
        if (w > 0) limit = Limit::kSpeed;
      }
      if (limit == Limit::kNone || outward < kNear * may.speed - l.braking * T) continue;
      rows_[static_cast<std::size_t>(count_++)] = {may.acceleration, static_cast<int>(i), side, limit};
    }
  }
}

/// The λ_i by sweeps over the rows, which are few.
void ImpedanceLimits::solve() {
  constexpr int kMost = 200;
  constexpr double kExact = 1e-12;
  for (int sweep = 0; sweep < kMost; ++sweep) {
    double change = 0, largest = 0;
    for (Index i = 0; i < count_; ++i) {
      if (!(A_(i, i) > 0)) continue;
      const double next = std::min(lambda_[i] - a_[i] / A_(i, i), 0.0), step = next - lambda_[i];
      lambda_[i] = next;
      for (Index j = 0; j < count_; ++j) a_[j] += A_(j, i) * step;
      change = std::max(change, std::abs(step) * A_(i, i));
      largest = std::max(largest, std::abs(next) * A_(i, i));
    }
    if (change <= kExact * largest) return;
  }
}

void ImpedanceLimits::confine(LinkDynamics& links, const Robot& robot, std::span<const Limits> joints, Eigen::VectorXd& u) {
  take(robot, joints);
  if (count_ == 0) return;
  // The accelerations of the joints without limits.
  ddq_.setZero();
  links.inverse_dynamics(robot.q, robot.dq, ddq_, g_);
  for (Index i = 0; i < u.size(); ++i) {
    const auto k = static_cast<std::size_t>(i);
    ddq_[i] = u[i] + robot.tau_e[k] - g_[i] - robot::spring(robot.drives, k).at(robot.q[i]).torque;
  }
  robot.M_llt.solveInPlace(ddq_);
  for (Index i = 0; i < count_; ++i) {
    const Row& row = rows_[static_cast<std::size_t>(i)];
    a_[i] = row.side * ddq_[row.joint] - row.acceleration;
    g_.setZero();
    g_[row.joint] = row.side;
    robot.M_llt.matrixL().solveInPlace(g_);
    Y_.col(i) = g_;
    for (Index j = 0; j <= i; ++j) A_(i, j) = A_(j, i) = Y_.col(j).dot(g_);
    lambda_[i] = 0;
  }
  solve();
  for (Index i = 0; i < count_; ++i) {
    if (lambda_[i] == 0) continue;
    const Row& row = rows_[static_cast<std::size_t>(i)];
    u[row.joint] += row.side * lambda_[i];
    met[static_cast<std::size_t>(row.joint)] = static_cast<std::int32_t>(row.limit);
  }
}

}  // namespace cotwin::compliance
