#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "master/workflows/tuning/data.h"
#include "models/identification/feasible.h"

namespace cotwin::master::tuning {

/// What the bounds cost at which feasible least squares stands.
struct BoundsCost {
  std::vector<std::string> sentences;  // by kind: where, what they cost, and what widens them
  /// Where wider bounds of bodies lower the weighted RMS by 5 % or more: which, and the options that lower it, with what they
  /// reach; else empty.
  std::string alarm;
  std::string options;   // their names: "--mass-factor"
  std::string friction;  // where wider bounds of friction do: "v_R (0.001 to 0.5 rad/s)"; else empty
  /// n: RMS errors of the judged part, N.m, with the bounds of `alarm`, of `friction`, and all wider; empty where they are not
  /// active.
  Eigen::VectorXd with_bodies, with_friction, with_all;
};

/// Solves again with wider bounds, unless none is active or hooks.stop says so.
BoundsCost cost_of_bounds(const Settings& settings, const Data& data, const identification::Problem& problem,
                          const identification::FeasibleResult& solution, const Hooks& hooks);

}  // namespace cotwin::master::tuning
