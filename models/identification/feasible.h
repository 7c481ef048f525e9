#pragma once
#include <cstdint>
#include <functional>

#include "models/identification/problem.h"

namespace cotwin::identification {

struct FeasibleOptions {
  bool convex = true;       // Newton's method on a falling barrier
  int starts = 0;           // of Levenberg–Marquardt beside it: the prior, and random ones about it
  double spread = 0.3;      // standard deviation of those
  int iterations = 300;     // of each start, at most
  double tolerance = 1e-9;  // relative fall of the cost in an iteration that ends a start
  std::uint64_t seed = 1;
  std::function<bool()> stop = {};  // asked before each iteration; true: end with the best so far
};

struct FeasibleResult {
  Eigen::VectorXd xi;
  Estimate estimate;
  double cost = 0;  // f(ξ)
  double weighted_rms = 0;
  int iterations = 0;        // of all starts of Levenberg–Marquardt
  int start = 0;             // the one that won; -1: the convex one
  bool interrupted = false;  // `stop` said so: the best so far, at worst the prior
};

/// Physically feasible least squares on the same box and cost as the swarm. With friction's shape given, f is a linear
/// least-squares problem in (π, φ) on the cone P ≥ 0, φ ≥ 0, and Newton's method on a falling barrier goes to its minimum in
/// the box (Boyd, Vandenberghe, Convex Optimization, ch. 11; for robots: Sousa, Cortesão, IJRR 33(6), 2014), friction's shape
/// with it at the end. Among (π, φ) there are none of the bent valleys that data make among ξ, where Levenberg–Marquardt (Moré
/// 1978) creeps: it is there as a second opinion. What the data leave open is decided by the pull to the prior, to 1e-9 of f:
/// so the robot found does not depend on rounding. Deterministic.
FeasibleResult solve_feasible(const Problem& problem, const FeasibleOptions& options = {});

}  // namespace cotwin::identification
