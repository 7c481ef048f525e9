#include "master/workflows/tuning/repair.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

#include "master/workflows/tuning/evidence.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/feasible.h"

namespace cotwin::master::tuning {
namespace {

using measurement::JointSurvey;
using Order = std::vector<int>;

/// Settings that read the log otherwise, and the options that say so.
struct Reading {
  Settings settings;
  std::string options;

  void add(const std::string& option, const std::string& list) {
    text::append(options, option + " " + text::for_a_shell(list), " ");
  }
  /// The columns of the survey in another order.
  void set_columns(const char* option, std::string& columns, const Data& data, const Order& order,
                   std::string JointSurvey::*column) {
    if (std::ranges::is_sorted(order)) return;
    std::vector<std::string> names;
    for (const int j : order) names.push_back(data.survey.joints[static_cast<std::size_t>(j)].*column);
    columns = text::joined(names, ",");
    add(option, columns);
  }
  /// A list of numbers per joint, of columns in another order, times a sign.
  void set_numbers(const char* option, std::vector<double>& values, const Order& order, const std::vector<double>& sign,
                   double neutral, double unit = 1) {
    std::vector<double> now = values;
    now.resize(order.size(), neutral);
    std::vector<double> next;
    for (std::size_t j = 0; j < order.size(); ++j) next.push_back(sign[j] * now[static_cast<std::size_t>(order[j])] + 0.0);
    if (next == now) return;
    values = next;
    std::string list;
    for (const double x : next) text::append(list, text::to_text(x / unit), ",");
    add(option, list);
  }
};

/// `positions`: where a sign is wrong, it is that of the position. `scales`: the scales of the settings go with the columns that are exchanged, otherwise they
/// stay with the joints.
Reading reading_of(const Settings& settings, const Data& data, bool positions, bool scales) {
  const identification::Hypothesis& truth = data.truth;
  Reading r{settings, ""};
  trajectory::RecordingFormat& format = r.settings.format;
  const std::vector<double> ones(truth.sign.size(), 1.0), &signs = truth.sign;
  const bool order = !std::ranges::is_sorted(truth.joint);
  Order own(truth.joint.size());
  std::iota(own.begin(), own.end(), 0);
  const Order &of_q = scales ? truth.joint : own, &of_tau = scales ? truth.column : own;
  if (order && !format.theta_columns.empty()) return r;  // whose names the survey does not have
  r.set_columns("--q-columns", format.q_columns, data, truth.joint, &JointSurvey::q_column);
  if (order && data.survey.has_speeds) r.add("--dq-columns", format.dq_columns = "none");
  r.set_columns("--tau-columns", format.tau_columns, data, truth.column, &JointSurvey::tau_column);
  r.set_numbers("--q-scale", format.q_scale, of_q, positions ? signs : ones, 1);
  r.set_numbers("--q-offset", format.q_offset, of_q, positions ? signs : ones, 0, format.angle_unit);
  r.set_numbers("--tau-scale", format.tau_scale, of_tau, positions ? ones : signs, 1);
  if (truth.rate != 1) {
    format.rate = std::stod(text::to_text(data.survey.rate() * truth.rate, 4));
    r.add("--rate", text::to_text(format.rate));
  }
  return r;
}

/// Those with options.
std::vector<Reading> readings_of(const Settings& settings, const Data& data) {
  std::vector<Reading> all;
  for (const bool scales : {true, false})
    for (const bool positions : {false, true}) {
      Reading reading = reading_of(settings, data, positions, scales);
      if (!reading.options.empty() && std::ranges::find(all, reading.options, &Reading::options) == all.end())
        all.push_back(std::move(reading));
    }
  return all;
}

struct Trial {
  Repair repair;
  std::size_t alarms = 0;
  double training = 0, judged = 0;  // Σ ln of the errors, on the training part and on the held-out part, if there is one
};

/// nullopt: the log cannot be read so, or no robot fits it.
std::optional<Trial> try_out(const Reading& reading, const Hooks& hooks) {
  try {
    const Data data = load_data(reading.settings, hooks);
    const identification::Problem problem(data.training->data, data.robot, problem_options(reading.settings));
    identification::FeasibleOptions options;
    options.stop = hooks.stop;
    const identification::FeasibleResult found = identification::solve_feasible(problem, options);
    if (found.interrupted) throw Stopped{};
    const Evaluation evaluation = evaluate(data, {{"prior", identification::estimate_of(data.robot, true)},
                                                  {"feasible", found.estimate},
                                                  {"floor", problem.floor_estimate()}});
    Trial trial{{reading.options, {}, (evaluation.held_out ? *evaluation.held_out : evaluation.training).of[1].rms},
                count_alarms(data, evaluation, 1)};
    for (const double error : evaluation.training.of[1].rms) trial.training += std::log(std::max(error, 1e-300));
    for (const double error : trial.repair.after) trial.judged += std::log(std::max(error, 1e-300));
    return trial;
  } catch (const Error&) {
    return std::nullopt;
  }
}

}  // namespace

std::string options_of(const Settings& settings, const Data& data) {
  std::string options;
  for (const Reading& reading : readings_of(settings, data)) text::append(options, reading.options, " or ");
  return options;
}

Repairs find_repairs(const Settings& settings, const Data& data, const Evaluation& evaluation, std::size_t tuned,
                     const Hooks& hooks) {
  constexpr double kTells = 0.05;  // of Σ ln of the errors
  Repairs repairs;
  const std::size_t alarms = count_alarms(data, evaluation, tuned);
  std::vector<Trial> trials;
  try {
    for (const Reading& reading : readings_of(settings, data)) {
      repairs.looked = true;
      std::optional<Trial> trial = try_out(reading, hooks);
      if (trial && trial->alarms < alarms) trials.push_back(std::move(*trial));
    }
  } catch (const Stopped&) {
    repairs.untried = options_of(settings, data);
    return repairs;
  }
  if (!trials.empty()) {
    const double best = std::ranges::min(trials, {}, &Trial::training).training;
    std::erase_if(trials, [&](const Trial& trial) { return trial.training - best >= kTells; });
  }
  std::ranges::stable_sort(trials, {}, &Trial::judged);
  if (trials.size() > 2) trials.resize(2);
  for (Trial& trial : trials) {
    trial.repair.before = (evaluation.held_out ? *evaluation.held_out : evaluation.training).of[tuned].rms;
    repairs.found.push_back(std::move(trial.repair));
  }
  return repairs;
}

}  // namespace cotwin::master::tuning
