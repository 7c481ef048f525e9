#pragma once
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "master/program/tuning/data.h"
#include "master/program/tuning/evaluation.h"
#include "master/program/tuning/resume.h"
#include "master/program/tuning/settings.h"
#include "models/identification/feasible.h"
#include "models/identification/swarm_search.h"

namespace cotwin::master::tuning {

/// What the swarm did.
struct SwarmRun {
  identification::SwarmSearchProgress progress;
  std::vector<double> history;  // cost after each round
  double seconds = 0;           // of the wall clock; in no file, so that files are the same bits
};

/// Everything that a report tells.
struct Result {
  bool interrupted = false;
  std::vector<Candidate> candidates;  // prior, then what the method gives and its references, the floor last
  std::size_t tuned = 0;              // of them
  Evaluation evaluation;
  identification::Floor floor;
  identification::Excitation excitation;
  double deviation_factor = 1;  // of `excitation`: filtered errors are not independent of one another
  double prior_rms = 0, swarm_rms = 0, feasible_rms = 0, floor_rms = 0;  // weighted, on the training part
  std::optional<SwarmRun> swarm;
  std::vector<std::string> alarms;  // sentences: joints of which the held-out torques are predicted worse than by no model or
                                    // by the prior
  std::string chosen;               // why the robot that is written is not the swarm's; empty where it is
  robot::RobotModel robot;          // tuned; as it was for Method::kLeastSquares, whose bodies are none
};

struct Run {
  std::filesystem::path out;  // exists
  int threads = 1;
  std::optional<Resume> resume;  // goes on from there
  std::string program = {};      // for resume.json: which program this is
  double checkpoint = 10;        // s of wall time between two writings of resume.json; 0: none during the search
};

/// The whole run: reads, tunes, writes robot.urdf, drive_train.ssv, torques.csv, motion.csv, twin.ssd, report.md, figures.json
/// and resume.json into run.out. When hooks.stop says so in a search, the best so far is written (without torques.csv,
/// motion.csv and twin.ssd; beside a swarm, without the feasible reference) and the result is `interrupted`; before, Stopped is
/// thrown and nothing is written. Resumed, the swarm goes on where it was; feasible least squares begins anew. Throws Error.
Result tune(const Settings& settings, const Run& run, const Hooks& hooks, const Data& data);

}  // namespace cotwin::master::tuning
