#pragma once
#include <Eigen/Core>
#include <string>
#include <vector>

#include "master/workflows/tuning/data.h"
#include "master/workflows/tuning/evaluation.h"

namespace cotwin::master::tuning {

/// Options that read the log as its findings say it is, all together, tried on the log.
struct Repair {
  std::string options;            // "--tau-columns tau2,tau1 --tau-scale 1,-1"
  Eigen::VectorXd before, after;  // n: RMS errors of feasible least squares on the judged part, N.m, without and with them
};

struct Repairs {
  /// Those with which fewer alarms are left; two where the log does not tell whether positions or torques have the other sign.
  std::vector<Repair> found;
  bool looked = false;  // whether there was an option to try
  std::string untried;  // options that were not tried, because hooks.stop ended the trial
};

/// Options that read the log as data.truth says, not tried: "--tau-scale 1,-1 or --q-scale 1,-1"; empty: there are none.
std::string options_of(const Settings& settings, const Data& data);

/// Reads the log again with the options of data.truth, and solves. `evaluation`: without them, of `tuned`.
Repairs find_repairs(const Settings& settings, const Data& data, const Evaluation& evaluation, std::size_t tuned,
                     const Hooks& hooks);

}  // namespace cotwin::master::tuning
