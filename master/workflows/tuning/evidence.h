#pragma once
#include <string>
#include <vector>

#include "master/workflows/tuning/bounds.h"
#include "master/workflows/tuning/data.h"
#include "master/workflows/tuning/evaluation.h"
#include "master/workflows/tuning/repair.h"

namespace cotwin::master::tuning {

/// One sentence for each damage of the log's torques, and one for all findings that matter: what fits better, by how much at
/// which joints, and the options that mend it. The lag of one joint whose error does not matter (verdict_of) is left to its
/// verdict.
std::vector<std::string> evidence(const Settings& settings, const Data& data, const Repairs& repairs);

/// Damage, findings that matter, and verdicts against the candidate.
std::size_t count_alarms(const Data& data, const Evaluation& evaluation, std::size_t candidate);

struct Verdict {
  bool alarm = false;
  std::string sentence;
};
/// How well the torque of the joint is predicted, and on what this rests. An alarm where it is held-out torques that are
/// predicted worse than by no model or by the prior, by more than rounding and chance, or where both parts have errors above 1.5
/// times those of unconstrained least squares, the last candidate, that matter. Not "good" where a bound costs 5 % or more.
/// Errors matter above 2 % of the joint's torque limit; where that is none, or a placeholder (above 30 times the largest torque
/// of the log), above 10 % of the joint's torque.
Verdict verdict_of(const Data& data, const Evaluation& evaluation, const BoundsCost& bounds, std::size_t candidate,
                   std::size_t joint);

/// The sentence for moving masses that are not those of the URDF, by the first moments about the axes; empty where they are
/// within 1.5 times. No log tells the cause.
std::string moving_mass(const Data& data, const identification::Floor& floor);

}  // namespace cotwin::master::tuning
