#include "master/workflows/tuning/tuning.h"

#include <chrono>
#include <cmath>
#include <sstream>

#include "master/workflows/tuning/evidence.h"
#include "master/workflows/tuning/files.h"
#include "master/workflows/tuning/report.h"
#include "master/workflows/tuning/scenario.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master::tuning {

namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

identification::SwarmSearchOptions swarm_options(const Settings& settings) {
  identification::SwarmSearchOptions options;
  options.swarm.particles = settings.particles;
  options.swarm.rounds = settings.rounds;
  options.swarm.threshold = settings.threshold;
  options.swarm.seed = settings.seed;
  return options;
}

Resume resume_of(const Settings& settings, const Run& run, std::string swarm) {
  return {settings, file_sizes(settings), std::move(swarm), run.program, file_hashes(settings)};
}

/// Runs feasible least squares until it ends or the user stops it.
identification::FeasibleResult run_feasible(const Settings& settings, const Hooks& hooks,
                                            const identification::Problem& problem) {
  hooks.tell("feasible least squares", 1);
  identification::FeasibleOptions options;
  options.seed = settings.seed;
  options.stop = hooks.stop;
  return identification::solve_feasible(problem, options);
}

/// Runs the swarm until it ends or the user stops it. Saves its state at the start, every run.checkpoint seconds and at the
/// end.
SwarmRun run_swarm(const Settings& settings, const Run& run, const Hooks& hooks, identification::SwarmSearch& tuning) {
  numerics::Threads threads(run.threads);
  const fs::path file = run.out / "resume.json";
  const Clock::time_point begin = Clock::now();
  Clock::time_point saved = begin;
  Resume resume = resume_of(settings, run, tuning.save());
  const auto save = [&] {
    resume.swarm = tuning.save();
    save_resume(file, resume);
  };
  save();
  SwarmRun result;
  result.progress = tuning.progress();
  while (result.progress.status == numerics::SwarmStatus::kRunning && !hooks.stopped()) {
    result.progress = tuning.round(&threads);
    hooks.tell("round " + std::to_string(result.progress.round) + " of " + std::to_string(settings.rounds) + ", RMS " +
                   text::to_text(result.progress.weighted_rms, 5) + " of the floor",
               static_cast<double>(result.progress.round) / settings.rounds);
    if (run.checkpoint > 0 && Clock::now() - saved > std::chrono::duration<double>(run.checkpoint)) {
      save();
      saved = Clock::now();
    }
  }
  save();
  result.history = tuning.history();
  result.seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  return result;
}

/// Chooses the tuned robot by the training part: the result of the method, or feasible least squares where the swarm is far from
/// it.
void choose_tuned(const Settings& settings, Result& result) {
  constexpr double kNear = 1.02;  // of the weighted RMS
  result.tuned = 1;               // the result of the method follows the prior
  if (settings.method != Method::kSwarm || !(result.feasible_rms > 0) || result.swarm_rms <= kNear * result.feasible_rms)
    return;
  result.tuned = 2;
  result.chosen = "feasible least squares fits the training data better (weighted RMS " +
                  text::to_text(result.feasible_rms, 5) + ", the swarm's " + text::to_text(result.swarm_rms, 5) +
                  "): it is the robot that is written";
}

std::vector<std::string> warnings_of(const Data& data, const identification::Excitation& excitation,
                                     const identification::Floor& floor) {
  std::vector<std::string> warnings = data.warnings;
  warnings.insert(warnings.end(), excitation.warnings.begin(), excitation.warnings.end());
  if (const std::string sentence = moving_mass(data, floor); !sentence.empty()) warnings.push_back(sentence);
  return warnings;
}

/// Evidence, verdicts, alarms and warnings.
void judge(const Settings& settings, const Data& data, const Hooks& hooks, Result& result) {
  if (result.interrupted)
    result.repairs.untried = options_of(settings, data);
  else if (!data.findings.empty())
    result.repairs = find_repairs(settings, data, result.evaluation, result.tuned, hooks);
  result.evidence = evidence(settings, data, result.repairs);
  if (!result.bounds.alarm.empty()) result.evidence.push_back(result.bounds.alarm);
  result.alarms = result.evidence;
  for (std::size_t j = 0; j < data.robot.joints.size(); ++j) {
    const Verdict verdict = verdict_of(data, result.evaluation, result.bounds, result.tuned, j);
    result.verdicts.push_back(verdict.sentence);
    if (verdict.alarm) result.alarms.push_back(verdict.sentence);
  }
  result.warnings = warnings_of(data, result.excitation, result.floor);
}

void write_files(const Settings& settings, const Data& data, const Run& run, const Result& result) {
  const Candidate& tuned = result.candidates[result.tuned];
  const std::string how = "cotwin tune: " + tuned.name + ", seed " + std::to_string(settings.seed) + ", " +
                          std::to_string(result.evaluation.training.samples) + " samples of " + settings.data.front().string();
  if (settings.method != Method::kLeastSquares)
    write_file(run.out / "robot.urdf", tuned_urdf(settings.robot, result.robot, how));
  std::ostringstream ssv;
  write_parameter_set(
      ssv, drive_parameters("drive_train_" + data.robot.name, data.robot, tuned.estimate, settings, result.evaluation.torsion));
  write_file(run.out / "drive_train.ssv", ssv.str());
  if (result.evaluation.replay)
    write_file(run.out / "twin.ssd", twin_scenario(data.robot.name, settings, *result.evaluation.replay));
  write_file(run.out / "figures.json", figures_json(settings, data, result));
  write_file(run.out / "report.md", report_markdown(settings, data, result));
}

}  // namespace

LogCheck check_log(const Settings& settings, const Data& data) {
  const identification::Problem problem(data.training->data, data.robot, problem_options(settings));
  Repairs repairs;
  repairs.untried = options_of(settings, data);
  return {problem.excitation(), data.training->data.rms(identification::estimate_of(data.robot, true)),
          warnings_of(data, problem.excitation(), problem.floor()), evidence(settings, data, repairs)};
}

Result tune(const Settings& settings, const Run& run, const Hooks& hooks, const Data& data) {
  // Phases: the problem; the solvers; errors from the compressed data; errors sample by sample; files.
  hooks.tell("least squares", 0);
  const identification::Problem problem(data.training->data, data.robot, problem_options(settings));
  Result result;
  result.floor = problem.floor();
  result.excitation = problem.excitation();
  result.deviation_factor = std::sqrt(std::max(1.0, 1 / (2 * data.smoothing.cutoff * data.smoothing.step)));
  result.candidates.push_back({"prior", identification::estimate_of(data.robot, true)});

  if (settings.method == Method::kSwarm) {
    identification::SwarmSearch tuning = run.resume
                                             ? identification::SwarmSearch(problem, swarm_options(settings), run.resume->swarm)
                                             : identification::SwarmSearch(problem, swarm_options(settings));
    result.swarm = run_swarm(settings, run, hooks, tuning);
    result.interrupted = result.swarm->progress.status == numerics::SwarmStatus::kRunning;
    result.candidates.push_back({"swarm", tuning.estimate()});
    result.swarm_rms = problem.weighted_rms(result.candidates.back().estimate);
  }
  if (settings.method == Method::kFeasible) save_resume(run.out / "resume.json", resume_of(settings, run, {}));
  if (settings.method != Method::kLeastSquares && !result.interrupted) {
    const identification::FeasibleResult feasible = run_feasible(settings, hooks, problem);
    result.interrupted = feasible.interrupted;
    // An interrupted reference solution is discarded; an interrupted result is the best so far.
    if (!feasible.interrupted || settings.method == Method::kFeasible) {
      result.candidates.push_back({"feasible", feasible.estimate});
      result.feasible_rms = feasible.weighted_rms;
      if (!feasible.interrupted) result.bounds = cost_of_bounds(settings, data, problem, feasible, hooks);
    }
  }
  result.candidates.push_back({"floor", problem.floor_estimate()});
  result.floor_rms = problem.weighted_rms(result.candidates.back().estimate);
  result.prior_rms = problem.weighted_rms(result.candidates.front().estimate);
  result.evaluation = evaluate(data, result.candidates);
  choose_tuned(settings, result);
  judge(settings, data, hooks, result);

  const identification::Estimate& tuned = result.candidates[result.tuned].estimate;
  result.robot = settings.method == Method::kLeastSquares
                     ? data.robot
                     : tuned_robot(data.robot, tuned, "cotwin tune, " + result.candidates[result.tuned].name);
  if (!result.interrupted) {
    try {
      predict(settings, data, hooks, result.candidates, result.tuned, result.robot, run.out, result.evaluation);
    } catch (const Stopped&) {
      result.interrupted = true;
      result.evaluation = evaluate(data, result.candidates);
    }
  }
  write_files(settings, data, run, result);
  return result;
}

}  // namespace cotwin::master::tuning
