#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "master/workflows/tuning/bounds.h"
#include "master/workflows/tuning/data.h"
#include "master/workflows/tuning/evaluation.h"
#include "master/workflows/tuning/repair.h"
#include "master/workflows/tuning/resume.h"
#include "master/workflows/tuning/settings.h"
#include "models/identification/feasible.h"
#include "models/identification/swarm_search.h"

namespace cotwin::master::tuning {

/// The run of the swarm.
struct SwarmRun {
  identification::SwarmSearchProgress progress;
  std::vector<double> history;  // cost after each round
  double seconds = 0;           // of the wall clock; in no file, so that files are the same bits
};

/// The results that the report shows.
struct Result {
  bool interrupted = false;
  std::vector<Candidate> candidates;  // prior, result of the method, references, floor
  std::size_t tuned = 0;              // index of the tuned candidate
  Evaluation evaluation;
  identification::Floor floor;
  identification::Excitation excitation;
  double deviation_factor = 1;  // on the deviations of `excitation`, because filtered errors are not independent
  double prior_rms = 0, swarm_rms = 0, feasible_rms = 0, floor_rms = 0;  // weighted, on the training part
  std::optional<SwarmRun> swarm;
  std::vector<std::string> evidence;  // sentences: what is wrong with the log, or with a bound
  std::vector<std::string> verdicts;  // a sentence per joint
  std::vector<std::string> alarms;    // the evidence, a bound that matters, and verdicts that speak against the result
  Repairs repairs;                    // of the log's findings
  BoundsCost bounds;                  // at which feasible least squares stands
  std::vector<std::string> warnings;  // of robot, log, motion and result
  std::string chosen;                 // the reason if the written robot is not that of the swarm; else empty
  robot::RobotModel robot;            // tuned; the prior for Method::kLeastSquares, whose bodies are not physical
};

struct Run {
  std::filesystem::path out;  // exists
  int threads = 1;
  std::optional<Resume> resume;  // continue from there
  std::string program = {};      // for resume.json: name and version of the program
  double checkpoint = 10;        // s of wall time between two writings of resume.json; 0: none during the search
};

/// What a log tells before a solution.
struct LogCheck {
  identification::Excitation excitation;
  Eigen::VectorXd prior;              // n: RMS errors of the URDF on the training part, N.m
  std::vector<std::string> warnings;  // of robot, log and motion
  std::vector<std::string> evidence;  // sentences: what is wrong with the log, with options that were not tried
};
LogCheck check_log(const Settings& settings, const Data& data);

/// The whole tuning: writes robot.urdf, drive_train.ssv, torques.csv, motion.csv, twin.ssd, report.md, figures.json and
/// resume.json into run.out. If hooks.stop returns true during a search, the best result so far is written (without
/// torques.csv, motion.csv and twin.ssd; with a swarm, without the feasible reference) and the result is `interrupted`. Before
/// a search, Stopped is thrown and nothing is written. A resumed swarm continues; feasible least squares starts again. Throws
/// Error.
Result tune(const Settings& settings, const Run& run, const Hooks& hooks, const Data& data);

}  // namespace cotwin::master::tuning
