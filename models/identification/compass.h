#pragma once
#include <Eigen/Core>
#include <algorithm>

namespace cotwin::identification {

/// The best point of a grid over the box, faces included, with `points` per axis (one or two axes).
template <class Cost>
Eigen::VectorXd scan(const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, int points, Cost cost) {
  Eigen::VectorXd best = lower, x = lower;
  double least = cost(best);
  const int count = x.size() == 2 ? points * points : points;
  for (int k = 1; k < count; ++k) {
    for (Eigen::Index i = 0, rest = k; i < x.size(); ++i, rest /= points)
      x[i] = lower[i] + (upper[i] - lower[i]) * static_cast<double>(rest % points) / (points - 1);
    const double c = cost(x);
    if (!(c < least)) continue;
    least = c;
    best = x;
  }
  return best;
}

/// Compass search (Hooke and Jeeves 1961): moves to the best neighbour along the axes, or halves the step, which is relative to
/// the box, until it is below `least`.
template <class Cost>
Eigen::VectorXd compass(Eigen::VectorXd x, const Eigen::VectorXd& lower, const Eigen::VectorXd& upper, double step,
                        double least, Cost cost) {
  double best = cost(x);
  while (step > least) {
    bool moved = false;
    for (Eigen::Index i = 0; i < x.size(); ++i)
      for (const double sign : {-1.0, 1.0}) {
        Eigen::VectorXd y = x;
        y[i] = std::clamp(x[i] + sign * step * (upper[i] - lower[i]), lower[i], upper[i]);
        const double c = cost(y);
        if (!(c < best)) continue;
        best = c;
        x = y;
        moved = true;
      }
    if (!moved) step /= 2;
  }
  return x;
}

}  // namespace cotwin::identification
