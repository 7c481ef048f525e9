#include <system_error>

#include "master/api/cotwin.h"
#include "master/scenario/folders.h"
#include "master/workflows/tuning/cross_validation.h"
#include "master/workflows/tuning/files.h"
#include "master/workflows/tuning/tuning.h"

namespace cotwin {

namespace {

master::tuning::Settings settings_of(const TuneOptions& options) {
  master::tuning::Settings s;
  s.robot = master::urdf_of(options.robot);
  s.data = options.data;
  s.held_out = options.held_out;
  s.method = master::tuning::method_of(options.method);
  s.model.friction = identification::friction_law(options.friction);
  s.model.motor_inertia = options.motor_torques;
  s.split = options.split;
  s.cutoff = options.cutoff;
  if (options.prior_weight) s.prior_weight = *options.prior_weight;
  s.seed = options.seed;
  s.rounds = options.rounds;
  if (!options.q_columns.empty()) s.format.q_columns = options.q_columns;
  if (!options.dq_columns.empty()) s.format.dq_columns = options.dq_columns;
  if (!options.tau_columns.empty()) s.format.tau_columns = options.tau_columns;
  master::tuning::check(s);
  return s;
}

std::vector<double> plain(const Eigen::VectorXd& values) { return {values.data(), values.data() + values.size()}; }

}  // namespace

TuneResult tune(const TuneOptions& options) {
  namespace tuning = master::tuning;
  if (options.out.empty()) throw Error("out", "is empty, expected a folder for the results");
  if (options.threads < 1) throw Error("threads", "expected at least 1");
  tuning::Settings settings = settings_of(options);
  const tuning::Hooks hooks{options.progress, options.stop};
  const auto before_the_search = [](const auto& call) {
    try {
      return call();
    } catch (const tuning::Stopped&) {
      throw Error("tune", "was stopped before the search; nothing was written");
    }
  };
  if (options.cross_validate) {
    settings = before_the_search([&] {
      return tuning::cross_validate(settings, {options.cutoff == 0, true, !options.prior_weight}, options.threads, hooks);
    });
  }
  const tuning::Data data = before_the_search([&] { return tuning::load_data(settings, hooks); });
  std::error_code error;
  std::filesystem::create_directories(options.out, error);
  if (error) throw Error(options.out.string(), "cannot be made: " + error.message());
  tuning::Run run;
  run.out = options.out;
  run.threads = options.threads;
  run.checkpoint = 0;
  run.program = "cotwin " + version();
  const tuning::Result found = before_the_search([&] { return tuning::tune(settings, run, hooks, data); });

  TuneResult result;
  result.robot = options.out / "robot.urdf";
  result.drive_train = options.out / "drive_train.ssv";
  result.report = options.out / "report.md";
  const ParameterSet set = load_parameter_set(result.drive_train);
  for (const ParameterValue& value : set.values) {
    if (const auto* real = std::get_if<double>(&value.value)) result.parameters.push_back({value.name, *real, value.unit});
  }
  const tuning::Evaluation& evaluation = found.evaluation;
  result.training_rms = plain(evaluation.training.of[found.tuned].rms);
  if (evaluation.held_out) {
    result.held_out_rms = plain(evaluation.held_out->of[found.tuned].rms);
    result.prior_held_out_rms = plain(evaluation.held_out->of[0].rms);
  }
  result.warnings = found.warnings;
  result.verdicts = found.verdicts;
  result.alarms = found.alarms;
  result.interrupted = found.interrupted;
  return result;
}

}  // namespace cotwin
