#include "master/workflows/tuning/cross_validation.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "models/foundation/support/text.h"
#include "models/foundation/support/threads.h"
#include "models/identification/feasible.h"

namespace cotwin::master::tuning {

namespace {

using Eigen::VectorXd;
using identification::TorqueData;

/// Samples of a contiguous part of the training part, with the torques as measured.
using Folds = std::vector<TorqueData>;

class Trials {
 public:
  Trials(const Settings& settings, const Open& open, int threads, const Hooks& hooks)
      : hooks_(hooks),
        threads_(threads),
        data_(survey_log(training_of(settings), hooks)),
        cutoffs_(open.cutoff ? candidates() : std::vector<double>{smoothing_of(settings, data_.survey).cutoff}) {
    margin_ = settings.margin >= 0 ? settings.margin : 1 / cutoffs_.front();
    count_ = 2 * static_cast<double>(cutoffs_.size()) + 6;  // load and five prior weights
  }

  const std::vector<double>& cutoffs() const { return cutoffs_; }

  Folds compress(const Settings& tried) {
    Settings settings = training_of(tried);
    settings.margin = margin_;
    data_.smoothing = smoothing_of(settings, data_.survey);
    split(settings, data_);
    // The slowest filter depends on samples up to 1/cutoff away.
    const auto reach = static_cast<std::size_t>(std::ceil(1 / (cutoffs_.front() * data_.smoothing.step)));
    const std::size_t all = data_.split > reach ? data_.split - reach : 0, n = data_.robot.joints.size();
    Folds folds(kFolds, TorqueData(data_.robot, model_of(settings, data_.survey)));
    std::size_t before = 0;
    for_each_block(settings, data_, hooks_, "cross-validation", [&](const measurement::Block& block, Part) {
      for (std::size_t k = 0; k < block.count && before < all; ++k, ++before) {
        if (!block.measured[k]) continue;
        const std::size_t row = k * n;
        const bool motors = !block.theta.empty();
        folds[before * kFolds / all].add(&block.q[row], &block.dq[row], &block.ddq[row], &block.tau_measured[row],
                                         motors ? &block.dtheta[row] : nullptr, motors ? &block.ddtheta[row] : nullptr);
      }
    });
    for (TorqueData& fold : folds) fold.flush();
    return folds;
  }

  /// Σ errors² per joint over all folds.
  VectorXd errors(const Settings& settings, const Folds& folds) {
    const identification::ProblemOptions options = problem_options(settings);
    std::vector<VectorXd> of_fold(kFolds);
    threads_.run(kFolds, [&](std::size_t k) {
      TorqueData others(data_.robot, model_of(settings, data_.survey));
      for (std::size_t i = 0; i < kFolds; ++i)
        if (i != k) others.merge(folds[i]);
      const identification::Problem problem(others, data_.robot, options);
      identification::FeasibleOptions feasible;
      feasible.stop = hooks_.stop;
      const identification::FeasibleResult result = identification::solve_feasible(problem, feasible);
      if (result.interrupted) throw Stopped{};
      of_fold[k] = folds[k].squared_errors(result.estimate);
    });
    hooks_.tell("cross-validation", std::min(1.0, ++done_ / count_));
    VectorXd sum = VectorXd::Zero(data_.robot.n());
    for (const VectorXd& fold : of_fold) sum += fold;
    return sum;
  }

  /// Relative to the first trial.
  double score(const VectorXd& errors) {
    if (reference_.size() == 0) reference_ = errors;
    return errors.cwiseQuotient(reference_).mean();
  }

 private:
  /// The settings without logs that are only predicted.
  static Settings training_of(Settings settings) {
    if (!settings.held_out.empty()) settings.split = 1;
    settings.held_out.clear();
    return settings;
  }

  /// Cutoffs in ascending order, from an eighth to three times Survey::cutoff(); not so low that the margins at both ends take
  /// a tenth of the log, and not above a fifth of its rate.
  std::vector<double> candidates() const {
    std::vector<double> all;
    const double slowest = 20 / data_.survey.duration, fastest = data_.survey.rate() / 5;
    for (const double factor : {0.125, 0.2, 0.3, 0.5, 0.7, 1.0, 1.7, 3.0}) {
      const double cutoff = std::clamp(factor * data_.survey.cutoff(), std::min(slowest, fastest), fastest);
      if (all.empty() || cutoff > all.back()) all.push_back(cutoff);
    }
    return all;
  }

  const Hooks& hooks_;
  numerics::Threads threads_;
  Data data_;
  std::vector<double> cutoffs_;
  double margin_ = 0, done_ = 0, count_ = 1;
  VectorXd reference_;
};

}  // namespace

Settings cross_validate(Settings settings, const Open& open, int threads, const Hooks& hooks) {
  Trials trials(settings, open, threads, hooks);
  settings.chosen.clear();
  Folds folds;
  double best = 0;

  /// Evaluates the settings after `change`, and keeps them if they predict better than all before.
  const auto attempt = [&](const std::string& what, bool compresses, const std::function<void(Settings&)>& change) {
    Settings tried = settings;
    change(tried);
    Folds with = compresses ? trials.compress(tried) : Folds{};
    const double score = trials.score(trials.errors(tried, compresses ? with : folds));
    settings.chosen.push_back(what + ": " + text::to_text(score, 5));
    if (best > 0 && !(score < best)) return;
    best = score;
    const std::vector<std::string> sentences = settings.chosen;
    settings = tried;
    settings.chosen = sentences;
    if (compresses) folds = std::move(with);
  };

  const auto try_cutoffs = [&] {
    for (const double cutoff : trials.cutoffs()) {
      if (cutoff == settings.cutoff && best > 0) continue;  // already evaluated
      attempt("low-pass at " + text::to_text(cutoff, 4) + " Hz", true, [&](Settings& s) { s.cutoff = cutoff; });
    }
  };
  try_cutoffs();
  if (open.load && !settings.model.load)
    attempt("friction that grows with the load", true, [](Settings& s) { s.model.load = true; });
  if (open.prior_weight) {
    for (const double weight : {1e-2, 0.1, 1.0, 10.0, 100.0})
      attempt("prior weight " + text::to_text(weight), false, [&](Settings& s) { s.prior_weight = weight; });
  }
  if (open.load || open.prior_weight) try_cutoffs();  // with the chosen model
  settings.chosen.push_back("taken: low-pass at " + text::to_text(settings.cutoff, 4) + " Hz, friction " +
                            (settings.model.load ? "with" : "without") + " the load, prior weight " +
                            text::to_text(settings.prior_weight));
  return settings;
}

}  // namespace cotwin::master::tuning
