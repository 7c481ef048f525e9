#pragma once
#include <algorithm>
#include <cmath>
#include <vector>

#include "models/robot/dynamics.h"
#include "models/trajectory/trajectory.h"

/// The shortest time along a given path within bounds of speed and torque, from rest to rest: the bound that no motion on the
/// same path can beat. Backward and forward recursion over x = ṡ² on a grid of the arc length s (Pham and Pham 2018), with
///   τ = a ṡ² ′/2 + b ṡ² + g,   a = M q′,   b = M q″ + C(q, q′) q′.
/// Shares no code with the optimiser but inverse dynamics.
namespace cotwin::optimisation::testing {

inline double time_optimal(const robot::RobotModel& robot, const trajectory::Path& path, const std::vector<double>& dq_max,
                           const std::vector<double>& tau_max, std::size_t parts = 2000) {
  using Eigen::VectorXd;
  const Eigen::Index n = robot.n();
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  const std::size_t fine = 20 * parts;
  std::vector<double> q(static_cast<std::size_t>(n)), dq(q), ddq(q), length(fine + 1, 0.0);
  const auto time_of = [&](double u) { return path.begin() + u * (path.end() - path.begin()); };
  const auto speed = [&](double u) {
    path.at(time_of(u), q, dq, ddq);
    return Eigen::Map<VectorXd>(dq.data(), n).norm() * (path.end() - path.begin());
  };
  for (std::size_t i = 0; i < fine; ++i)
    length[i + 1] = length[i] + speed((static_cast<double>(i) + 0.5) / static_cast<double>(fine)) / static_cast<double>(fine);
  struct Row {
    VectorXd a, b, g, direction;
  };
  std::vector<Row> rows;
  const double ds = length[fine] / static_cast<double>(parts);
  std::size_t at = 0;
  for (std::size_t i = 0; i <= parts; ++i) {
    const double s = std::clamp(ds * static_cast<double>(i), 1e-4 * ds, length[fine] - 1e-4 * ds);
    while (at + 2 < length.size() && length[at + 1] < s) ++at;
    const double u = (static_cast<double>(at) + (s - length[at]) / (length[at + 1] - length[at])) / static_cast<double>(fine);
    path.at(time_of(u), q, dq, ddq);
    const Eigen::Map<VectorXd> Q(q.data(), n), V(dq.data(), n), A(ddq.data(), n);
    const VectorXd direction = V / V.norm();
    const VectorXd bend = A / V.squaredNorm() - V * (V.dot(A) / (V.squaredNorm() * V.squaredNorm()));
    Row row{VectorXd(n), VectorXd(n), VectorXd(n), direction};
    robot::gravity(mechanism, data, Q, row.g);
    const VectorXd zero = VectorXd::Zero(n);
    robot::inverse_dynamics(mechanism, data, Q, zero, direction, row.a);
    robot::inverse_dynamics(mechanism, data, Q, direction, bend, row.b);
    row.a -= row.g;
    row.b -= row.g;
    rows.push_back(row);
  }
  // Accelerations u within the torques at x.
  const auto accelerations = [&](const Row& row, double x, double& low, double& high) {
    low = -1e30, high = 1e30;
    for (Eigen::Index j = 0; j < n; ++j) {
      const double limit = tau_max[static_cast<std::size_t>(j)], rest = row.b[j] * x + row.g[j];
      if (std::abs(row.a[j]) < 1e-14) continue;
      const double one = (limit - rest) / row.a[j], other = (-limit - rest) / row.a[j];
      low = std::max(low, std::min(one, other));
      high = std::min(high, std::max(one, other));
    }
    return low <= high;
  };
  std::vector<double> most(parts + 1, 0.0);
  for (std::size_t i = parts; i-- > 0;) {
    double limit = 1e30;
    for (Eigen::Index j = 0; j < n; ++j)
      limit = std::min(limit, std::pow(dq_max[static_cast<std::size_t>(j)] / std::abs(rows[i].direction[j]), 2));
    limit = std::min(limit, 1e8);
    const auto possible = [&](double x) {
      double low, high;
      return accelerations(rows[i], x, low, high) && x + 2 * ds * low <= most[i + 1] && x + 2 * ds * high >= 0;
    };
    double low = 0, high = limit;
    if (possible(limit)) low = limit;
    for (int k = 0; k < 100 && high - low > 1e-14 * high; ++k) {
      const double middle = 0.5 * (low + high);
      (possible(middle) ? low : high) = middle;
    }
    most[i] = low;
  }
  double x = 0, time = 0;
  for (std::size_t i = 0; i < parts; ++i) {
    double low, high;
    accelerations(rows[i], x, low, high);
    const double next = std::clamp(x + 2 * ds * high, 0.0, most[i + 1]);
    if (x + next > 0) time += 2 * ds / (std::sqrt(x) + std::sqrt(next));
    x = next;
  }
  return time;
}

}  // namespace cotwin::optimisation::testing
