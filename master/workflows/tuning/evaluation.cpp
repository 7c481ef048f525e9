#include "master/workflows/tuning/evaluation.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <utility>

#include "master/workflows/tuning/files.h"
#include "master/workflows/tuning/scenario.h"
#include "models/foundation/formats/csv.h"
#include "models/robot/dynamics.h"

namespace cotwin::master::tuning {

namespace {

using Eigen::Index;
using Eigen::VectorXd;

PartErrors errors_of(const CompressedPart& part, const std::vector<Candidate>& candidates) {
  PartErrors errors;
  errors.samples = part.samples;
  errors.removed = part.removed;
  for (const Candidate& candidate : candidates) errors.of.push_back({part.data.rms(candidate.estimate), {}});
  const std::size_t n = part.data.robot().joints.size();
  errors.torque_rms.resize(static_cast<Index>(n));
  identification::Estimate nothing = candidates.front().estimate;
  nothing.pi.setZero();
  nothing.drive.assign(n, {});
  errors.torque_rms = part.data.rms(nothing);
  return errors;
}

identification::Samples samples_of(const measurement::Block& block, std::size_t n) {
  return {n, block.t, block.q, block.dq, block.ddq, block.tau, block.dtheta, block.ddtheta};
}

/// The part of a measured torque that does not twist the gear: inertia and friction of the motor for torques of the motor,
/// nothing for a sensor behind the gear. Harmonics are springs at the link.
std::vector<identification::JointDrive> before_the_gears(const identification::ModelOptions& model,
                                                         std::vector<identification::JointDrive> drives) {
  if (!model.motor_inertia) drives.assign(drives.size(), {});
  for (identification::JointDrive& drive : drives) drive.harmonics.clear();
  return drives;
}

std::vector<std::string> column_names(std::size_t n) {
  std::vector<std::string> names = {"t", "part"};
  for (const char* what : {"tau", "tau_smooth", "tau_prior", "tau_tuned"}) {
    for (std::size_t j = 0; j < n; ++j) names.push_back(std::string(what) + "[" + std::to_string(j + 1) + "]");
  }
  return names;
}

/// Writes motion.csv and accumulates the errors of the twin on the same motion.
class ReplayWriter {
 public:
  ReplayWriter(const std::filesystem::path& place, Replay replay, std::size_t n)
      : replay_(std::move(replay)), n_(n), file_(place), writer_(file_.stream(), names(n)) {
    motion_.width = 2 * n;
    for (Replay::Errors* errors : {&replay_.training, &replay_.held_out})
      errors->rms = errors->torque = VectorXd::Zero(static_cast<Index>(n));
  }
  /// Sample number `at` of the grid: q, smoothed torques, those of the twin.
  void add(std::size_t at, const double* q, const double* tau, const double* twin) {
    if (at < replay_.begin || at >= replay_.end) return;
    motion_.t.push_back(static_cast<double>(at - replay_.begin) * replay_.step);
    motion_.x.insert(motion_.x.end(), q, q + n_);
    motion_.x.insert(motion_.x.end(), tau, tau + n_);
    Replay::Errors& errors = at < replay_.boundary ? replay_.training : replay_.held_out;
    ++errors.samples;
    for (std::size_t j = 0; j < n_; ++j) {
      const Index i = static_cast<Index>(j);
      errors.rms[i] += (tau[j] - twin[j]) * (tau[j] - twin[j]);
      errors.torque[i] += twin[j] * twin[j];
    }
  }
  Replay finish() {
    write();
    file_.commit();
    for (Replay::Errors* errors : {&replay_.training, &replay_.held_out}) {
      const double samples = static_cast<double>(std::max<std::size_t>(1, errors->samples));
      errors->rms = (errors->rms / samples).cwiseSqrt();
      errors->torque = (errors->torque / samples).cwiseSqrt();
    }
    return std::move(replay_);
  }

 private:
  void write() {
    const std::size_t between = points_between(replay_.step);
    const trajectory::Path path = trajectory::interpolate(motion_);
    std::vector<double> x(motion_.width), dx(x.size()), ddx(x.size());
    for (std::size_t k = 0; k <= (motion_.t.size() - 1) * between; ++k) {
      const double t = static_cast<double>(k) * replay_.step / static_cast<double>(between);
      path.at(std::min(t, motion_.t.back()), x, dx, ddx);
      writer_.cell(t);
      for (const double value : x) writer_.cell(value);
      writer_.end_row();
    }
  }
  static std::vector<std::string> names(std::size_t n) {
    std::vector<std::string> all = {"t"};
    for (const std::string what : {"q", "tau"})
      for (std::size_t j = 0; j < n; ++j) all.push_back(what + std::to_string(j + 1));
    return all;
  }
  Replay replay_;
  trajectory::Series motion_;  // q and τ
  std::size_t n_;
  AtomicFile file_;
  csv::Writer writer_;
};

}  // namespace

Evaluation evaluate(const Data& data, const std::vector<Candidate>& candidates) {
  Evaluation evaluation;
  evaluation.training = errors_of(*data.training, candidates);
  if (data.held_out) evaluation.held_out = errors_of(*data.held_out, candidates);
  return evaluation;
}

void predict(const Settings& settings, const Data& data, const Hooks& hooks, const std::vector<Candidate>& candidates,
             std::size_t tuned, const robot::RobotModel& robot, const std::filesystem::path& out, Evaluation& evaluation) {
  const std::size_t n = data.robot.joints.size();
  constexpr std::size_t kRows = 100000;
  const std::size_t all = evaluation.training.samples + (evaluation.held_out ? evaluation.held_out->samples : 0);
  evaluation.every = (all + kRows - 1) / kRows;
  for (PartErrors* part : {&evaluation.training, evaluation.held_out ? &*evaluation.held_out : nullptr}) {
    if (part == nullptr) continue;
    for (Errors& errors : part->of) errors.maximum = VectorXd::Zero(static_cast<Index>(n));
  }
  AtomicFile file(out / "torques.csv");
  csv::Writer writer(file.stream(), column_names(n));
  std::vector<identification::TorsionFit> torsion(n);
  const std::vector<identification::JointDrive> lost = before_the_gears(settings.model, candidates[tuned].estimate.drive);
  const bool exists = settings.method != Method::kLeastSquares;
  std::optional<ReplayWriter> replay;
  if (std::optional<Replay> chosen = exists ? choose_replay(settings, data) : std::nullopt)
    replay.emplace(out / "motion.csv", *chosen, n);
  const robot::Mechanism mechanism(data.load_robot);
  robot::Data scratch(mechanism);
  VectorXd gravity = VectorXd::Zero(static_cast<Index>(n));
  std::vector<std::vector<double>> tau(candidates.size());
  std::size_t before = 0;
  for_each_block(settings, data, hooks, "predicting the torques", [&](const measurement::Block& block, Part of_file) {
    const identification::Samples samples = samples_of(block, n);
    for (std::size_t c = 0; c < candidates.size(); ++c)
      tau[c] = identification::torques(exists && c == tuned ? robot : data.load_robot, candidates[c].estimate, samples);
    for (std::size_t k = 0; k < block.count; ++k, ++before) {
      if (replay) replay->add(before, &block.q[k * n], &block.tau[k * n], &tau[tuned][k * n]);
      if (!block.measured[k]) continue;
      const bool train = of_file == Part::kTraining && before < data.split;
      const bool of_gears = !block.theta.empty() && train;
      if (of_gears && settings.model.motor_inertia && settings.model.load)
        robot::gravity(mechanism, scratch, Eigen::Map<const VectorXd>(&block.q[k * n], static_cast<Index>(n)), gravity);
      PartErrors& part = train ? evaluation.training : *evaluation.held_out;
      for (std::size_t j = 0; j < n; ++j) {
        const std::size_t at = k * n + j;
        const Index joint = static_cast<Index>(j);
        for (std::size_t c = 0; c < candidates.size(); ++c)
          part.of[c].maximum[joint] = std::max(part.of[c].maximum[joint], std::abs(block.tau[at] - tau[c][at]));
        if (of_gears) {
          const double tau_J = block.tau[at] - lost[j].torque(block.q[at], block.dtheta[at], block.ddtheta[at], gravity[joint]);
          torsion[j].add(tau_J, block.dq[at], block.theta[at] - block.q[at]);
        }
      }
      if (before % evaluation.every != 0) continue;
      writer.cell(block.t[k]);
      writer.cell(train ? "training" : "held_out");
      for (const std::vector<double>& values : {std::cref(block.tau_measured), std::cref(block.tau),
                                                std::cref(std::as_const(tau[0])), std::cref(std::as_const(tau[tuned]))}) {
        for (std::size_t j = 0; j < n; ++j) writer.cell(values[k * n + j]);
      }
      writer.end_row();
    }
  });
  file.commit();
  if (replay) evaluation.replay = replay->finish();
  if (settings.format.theta_columns.empty()) return;
  const double independent = 2 * data.smoothing.cutoff * data.smoothing.step * static_cast<double>(evaluation.training.samples);
  for (const identification::TorsionFit& fit : torsion) evaluation.torsion.push_back(fit.solve(independent));
}

}  // namespace cotwin::master::tuning
