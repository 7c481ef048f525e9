#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "master/tuning/data.h"
#include "models/identification/problem.h"
#include "models/identification/stiffness.h"

namespace cotwin::master::tuning {

/// A set of parameters that the report compares: "prior", "swarm", "feasible", "floor".
struct Candidate {
  std::string name;
  identification::Estimate estimate;
};

/// Errors of one candidate on one part of the data, n each, N.m.
struct Errors {
  Eigen::VectorXd rms;
  Eigen::VectorXd maximum;  // empty where the log was not read again
};

struct PartErrors {
  std::size_t samples = 0;
  Eigen::VectorXd torque_rms;  // n, N.m, of the smoothed torques
  Eigen::VectorXd removed;     // n, N.m: RMS of what the low-pass took away
  std::vector<Errors> of;      // as many as candidates
};

struct Evaluation {
  PartErrors training;
  std::optional<PartErrors> held_out;
  std::vector<identification::Torsion> torsion;  // n, or empty where the motors' positions were not measured
  std::size_t every = 1;                         // of the samples, so many apart, are in torques.csv
};

/// RMS from the compressed data: no sample is looked at.
Evaluation evaluate(const Data& data, const std::vector<Candidate>& candidates);

/// Reads the log again: adds the largest discrepancies and the joints' torsion, and writes torques.csv with the columns t, part
/// (training or held_out), tau[j] as measured, tau_smooth[j], tau_prior[j], tau_tuned[j] of the candidates 0 and `tuned`.
/// At most 100 000 rows: beyond that every second, third, … sample.
void predict(const Settings& settings, const Data& data, const Hooks& hooks, const std::vector<Candidate>& candidates,
             std::size_t tuned, const std::filesystem::path& csv, Evaluation& evaluation);

}  // namespace cotwin::master::tuning
