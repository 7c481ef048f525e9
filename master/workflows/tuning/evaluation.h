#pragma once
#include <Eigen/Core>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "master/workflows/tuning/data.h"
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
  Eigen::VectorXd maximum;  // empty if the log was not read again
};

struct PartErrors {
  std::size_t samples = 0;
  Eigen::VectorXd torque_rms;  // n, N.m, of the smoothed torques
  Eigen::VectorXd removed;     // n, N.m: RMS of the part that the low-pass removed
  std::vector<Errors> of;      // as many as candidates
};

/// The samples that twin.ssd replays, with their errors: samples [begin, end) of the grid, counted over all segments; those
/// from `boundary` on are held out.
struct Replay {
  std::size_t begin = 0, end = 0, boundary = 0;
  double step = 0;  // s
  struct Errors {
    std::size_t samples = 0;
    Eigen::VectorXd rms, torque;  // n, N.m: RMS of smoothed minus the twin's torques; of the twin's torques
  };
  Errors training, held_out;
};

struct Evaluation {
  PartErrors training;
  std::optional<PartErrors> held_out;
  std::vector<identification::Torsion> torsion;  // n, or empty where the motors' positions were not measured
  std::optional<Replay> replay;                  // written to motion.csv
  std::size_t every = 1;                         // decimation of torques.csv
};

/// Computes RMS errors from the compressed data alone.
Evaluation evaluate(const Data& data, const std::vector<Candidate>& candidates);

/// Reads the log again, adds the largest errors and the torsion of the joints to `evaluation`, and writes into the folder `out`
///   torques.csv   t, part (training or held_out), tau[j] as measured, tau_smooth[j], tau_prior[j], tau_tuned[j] of the
///                 candidates 0 and `tuned`; at most 100 000 rows: beyond that every second, third, … sample
///   motion.csv    t from 0, q1 …, tau1 …, smoothed: the motion that twin.ssd replays (scenario.h)
/// `robot`: the tuned robot. Its gravity is the load of its friction, as in the drive train.
void predict(const Settings& settings, const Data& data, const Hooks& hooks, const std::vector<Candidate>& candidates,
             std::size_t tuned, const robot::RobotModel& robot, const std::filesystem::path& out, Evaluation& evaluation);

}  // namespace cotwin::master::tuning
