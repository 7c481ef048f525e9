#include "models/identification/feasible.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/identification/problem_impl.h"
#include "models/numerics/dense.h"
#include "models/numerics/random.h"

namespace cotwin::identification {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Descent {
  VectorXd xi;
  double cost = 0;
  int iterations = 0;
  bool interrupted = false;
};

/// Levenberg–Marquardt in a box: coordinates on a face whose gradient points outwards stand still, steps are cut at the box.
/// Damping as by Nielsen (IMM-REP-1999-05).
Descent descend(const Problem& problem, VectorXd xi, const FeasibleOptions& options) {
  const VectorXd &lower = problem.lower(), &upper = problem.upper();
  VectorXd r, trial_r;
  MatrixXd J;
  problem.residuals(xi, r, &J);
  double cost = r.squaredNorm(), mu = 1e-3, growth = 2;
  int iteration = 0;
  bool fresh = true;  // J belongs to xi
  MatrixXd H;
  VectorXd g;
  while (iteration < options.iterations) {
    if (options.stop && options.stop()) return {xi, cost, iteration, true};
    ++iteration;
    if (!fresh) problem.residuals(xi, r, &J);
    if (!fresh || H.size() == 0) {
      H.noalias() = J.transpose() * J;
      g.noalias() = J.transpose() * r;
    }
    fresh = true;
    std::vector<Index> free;
    for (Index i = 0; i < xi.size(); ++i)
      if (!((xi[i] <= lower[i] && g[i] > 0) || (xi[i] >= upper[i] && g[i] < 0))) free.push_back(i);
    const auto m = static_cast<Index>(free.size());
    MatrixXd A(m, m);
    VectorXd b(m);
    const double least = 1e-9 * H.diagonal().maxCoeff();
    for (Index i = 0; i < m; ++i) {
      const Index row = free[static_cast<std::size_t>(i)];
      for (Index k = 0; k < m; ++k) A(i, k) = H(row, free[static_cast<std::size_t>(k)]);
      A(i, i) += mu * std::max(H(row, row), least);
      b[i] = -g[row];
    }
    const VectorXd step = numerics::solve_ldlt(A, b);
    VectorXd trial = xi;
    for (Index i = 0; i < m; ++i) {
      const Index row = free[static_cast<std::size_t>(i)];
      trial[row] = std::clamp(xi[row] + step[i], lower[row], upper[row]);
    }
    problem.residuals(trial, trial_r);
    const double trial_cost = trial_r.squaredNorm();
    const VectorXd taken = trial - xi;
    const double predicted = -(2 * g.dot(taken) + taken.dot(H * taken));
    if (trial_cost < cost && predicted > 0) {
      const double gain = (cost - trial_cost) / predicted;
      mu *= std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3));
      mu = std::max(mu, 1e-15);
      growth = 2;
      const bool done = cost - trial_cost <= options.tolerance * cost;
      xi = trial;
      cost = trial_cost;
      fresh = false;
      if (done) break;
    } else {
      mu *= growth;
      growth *= 2;
      if (mu > 1e15 || taken.norm() <= 1e-14 * (1 + xi.norm())) break;
    }
  }
  return {xi, cost, iteration, false};
}

}  // namespace

FeasibleResult solve_feasible(const Problem& problem, const FeasibleOptions& options) {
  if (options.starts < (options.convex ? 0 : 1))
    throw Error("starts", std::to_string(options.starts) + ", expected at least one, the convex one included");
  FeasibleResult best;
  best.xi = VectorXd::Zero(problem.dimensions());
  best.cost = problem.cost(best.xi);
  const auto take = [&](const VectorXd& xi, double cost, int start) {
    if (!(cost < best.cost)) return;
    best.xi = xi;
    best.cost = cost;
    best.start = start;
  };
  if (options.convex) {
    const VectorXd xi = convex_optimum(problem.impl(), [&] {
      best.interrupted = best.interrupted || (options.stop && options.stop());
      return best.interrupted;
    });
    take(xi, problem.cost(xi), -1);
  }
  for (int start = 0; start < options.starts && !best.interrupted; ++start) {
    VectorXd xi = VectorXd::Zero(problem.dimensions());
    for (Index i = 0; start > 0 && i < xi.size(); ++i) {
      const numerics::Key key{options.seed, 17, 0, static_cast<std::uint32_t>(start), static_cast<std::uint32_t>(i)};
      xi[i] = std::clamp(options.spread * numerics::normal(key), problem.lower()[i], problem.upper()[i]);
    }
    const Descent descent = descend(problem, xi, options);
    best.iterations += descent.iterations;
    best.interrupted = descent.interrupted;
    take(descent.xi, descent.cost, start);
  }
  best.estimate = problem.estimate(best.xi);
  best.weighted_rms = problem.weighted_rms(best.estimate);
  return best;
}

}  // namespace cotwin::identification
