#pragma once
#include <cstdint>
#include <functional>

#include "models/identification/problem.h"

namespace cotwin::identification {

struct FeasibleOptions {
  bool convex = true;       // Newton's method with a decreasing barrier
  int starts = 0;           // additional starts of Levenberg–Marquardt: the prior, and random points about it
  double spread = 0.3;      // standard deviation of the random starts
  int iterations = 300;     // of each start, at most
  double tolerance = 1e-9;  // relative decrease of the cost per iteration at which a start ends
  std::uint64_t seed = 1;
  std::function<bool()> stop = {};  // called before each iteration; true: end with the best so far
};

struct FeasibleResult {
  Eigen::VectorXd xi;
  Estimate estimate;
  double cost = 0;  // f(ξ)
  double weighted_rms = 0;
  int iterations = 0;        // of all starts of Levenberg–Marquardt
  int start = 0;             // the best one; -1: the convex one
  bool interrupted = false;  // by `stop`: the best so far, at worst the prior
};

/// Physically feasible least squares on the box and cost of the swarm. For a given shape of friction, f is a linear
/// least-squares problem in (π, φ) on the cone P ≥ 0, φ ≥ 0. It is solved by Newton's method with a decreasing barrier (Boyd,
/// Vandenberghe, Convex Optimization, ch. 11; for robots: Sousa, Cortesão, IJRR 33(6), 2014); the shape of friction is included
/// at the end. In (π, φ) the cost has no curved valleys, in which Levenberg–Marquardt on ξ (Moré 1978; a second opinion) is
/// slow. The pull to the prior decides what the data leave open, to 1e-9 of f, so the result does not depend on rounding.
/// Deterministic.
FeasibleResult solve_feasible(const Problem& problem, const FeasibleOptions& options = {});

}  // namespace cotwin::identification
