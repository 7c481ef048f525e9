#pragma once
#include <string>
#include <vector>

#include "master/workflows/tuning/data.h"
#include "master/workflows/tuning/evaluation.h"
#include "models/identification/feasible.h"

namespace cotwin::master::tuning {

/// One sentence for each damage of the log's torques and each of data.findings: what fits better, by how much at which joints,
/// and the option or file that mends it.
std::vector<std::string> evidence(const Settings& settings, const Data& data);

struct Verdict {
  bool alarm = false;
  std::string sentence;
};
/// How well the torque of the joint is predicted, and on what this rests. An alarm where it is held-out torques that are
/// predicted worse than by no model or by the prior, by more than rounding and chance, or where both parts have errors above 1.5
/// times those of unconstrained least squares, the last candidate.
Verdict verdict_of(const Data& data, const Evaluation& evaluation, std::size_t candidate, std::size_t joint);

/// The bounds at which the solution stands, by kind: where, what they cost, and the option that widens them.
std::vector<std::string> bounds_of(const Settings& settings, const Data& data, const identification::Problem& problem,
                                   const identification::FeasibleResult& solution, const Hooks& hooks);

/// The sentence for moving masses that are not those of the URDF, by the first moments about the axes; empty where they are
/// within 1.5 times. No log tells the cause.
std::string moving_mass(const Data& data, const identification::Floor& floor);

}  // namespace cotwin::master::tuning
