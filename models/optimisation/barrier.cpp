#include "models/optimisation/barrier.h"
#include "models/numerics/dense.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kGrid = 128;  // parts of the kinematic bounds, shorter towards the ends
constexpr double kStep = 1e-4, kHessianStep = 1e-3;

/// 0 at the ends of the motion, which it leaves with s³, and 1 from s = 0.15 to 0.85 on.
double away_from_ends(double s) { return std::min(1.0, 512 * std::pow(s * (1 - s), 3)); }

}  // namespace

Barrier::Barrier(const Evaluator& evaluator, Evaluator::Scratch& scratch, std::vector<BarrierBox> boxes, std::size_t variables,
                 const std::vector<double>& margins, Decode decode)
    : evaluator_(evaluator),
      scratch_(scratch),
      boxes_(std::move(boxes)),
      variables_(variables),
      decode_(std::move(decode)),
      motions_(evaluator.motions()),
      values_(evaluator.values()) {
  std::vector<double> s, low, high, scale;
  for (std::size_t i = 0; i <= kGrid; ++i)
    s.push_back(0.5 - 0.5 * std::cos(std::numbers::pi * static_cast<double>(i) / static_cast<double>(kGrid)));
  const Bounds& b = evaluator.problem().bounds;
  for (int r = 0; r < 4; ++r) {
    // At the ends only the jerk depends on the variables.
    const auto own = r == 3 ? std::span(s) : std::span(s).subspan(1, kGrid - 1);
    grid_[static_cast<std::size_t>(r)] = evaluator.basis().table(own, r);
    points_[static_cast<std::size_t>(r)] = own.size();
    for (std::size_t j = 0; j < evaluator.joints(); ++j) {
      const double most = (r == 0 ? b.q_max : r == 1 ? b.dq : r == 2 ? b.ddq : b.dddq)[j];
      const double least = r == 0 ? b.q_min[j] : -most;
      if (!std::isfinite(most) && !std::isfinite(least)) continue;
      const double range = r > 0 ? most : std::isfinite(most - least) && most > least ? most - least : 1.0;
      const double margin = margins[5 * j + static_cast<std::size_t>(r)];
      blocks_.push_back({j, r});
      for (const double place : own) {
        // Towards an end that is at a bound no motion has more room than this.
        constexpr double kLeast = 1e-9;
        const double away = away_from_ends(place);
        const double room = r > 0 ? -margin * most : (kLeast - margin * away) * range;
        low.push_back(least - room);
        high.push_back(most + room);
        scale.push_back(r > 0 ? range : (kLeast + away) * range);
      }
    }
  }
  for (std::size_t j = 0; j < evaluator.joints(); ++j) {
    const double most = b.tau[j] * (1 - margins[5 * j + 4]);
    if (!std::isfinite(most)) continue;
    torque_joints_.push_back(j);
    low.insert(low.end(), evaluator.samples(), -most);
    high.insert(high.end(), evaluator.samples(), most);
    scale.insert(scale.end(), evaluator.samples(), most);
  }
  for (const BarrierBox& box : boxes_) {
    low.push_back(box.low);
    high.push_back(box.high);
    scale.push_back(std::isfinite(box.high - box.low) ? box.high - box.low : std::max(std::abs(box.high), 1e-300));
  }
  scale_ = Eigen::Map<VectorXd>(scale.data(), static_cast<Index>(scale.size()));
  low_ = Eigen::Map<VectorXd>(low.data(), static_cast<Index>(low.size()));
  high_ = Eigen::Map<VectorXd>(high.data(), static_cast<Index>(high.size()));
  rows_.resize(grid_[3].room());
}

void Barrier::evaluate(const std::vector<VectorXd>& points, std::vector<Sample>& samples, bool with_values) {
  samples.resize(points.size());
  const std::size_t S = evaluator_.samples();
  std::size_t torque_rows = 0;
  for (const Block& block : blocks_) torque_rows += points_[static_cast<std::size_t>(block.derivative)];
  for (std::size_t first = 0; first < points.size(); first += kLanes) {
    const std::size_t count = std::min(kLanes, points.size() - first);
    for (std::size_t k = 0; k < kLanes; ++k) decode_(points[first + std::min(k, count - 1)], k, motions_);
    if (with_values)
      for (std::size_t k = 0; k < count; ++k) samples[first + k].values.resize(low_.size());
    motions_.count = count;
    Evaluator::Visit visit;
    if (with_values)
      visit = [&](std::size_t lane, std::size_t begin, std::size_t part, const double* tau, const double*) {
        for (std::size_t i = 0; i < torque_joints_.size(); ++i)
          std::copy_n(tau + torque_joints_[i] * part, part, samples[first + lane].values.data() + torque_rows + i * S + begin);
      };
    evaluator_.evaluate(motions_, scratch_, values_, true, visit);
    evaluations_ += count;
    std::size_t at = 0;
    for (const Block& block : blocks_) {
      if (!with_values) break;
      const std::size_t r = static_cast<std::size_t>(block.derivative);
      grid_[r].times(evaluator_.coordinates(scratch_, block.derivative, block.joint), kLanes, rows_.data());
      for (std::size_t row = 0; row < points_[r]; ++row, ++at)
        for (std::size_t k = 0; k < count; ++k) samples[first + k].values[static_cast<Index>(at)] = rows_[row * kLanes + k];
    }
    const auto& costs = evaluator_.problem().costs;
    for (std::size_t k = 0; k < count; ++k) {
      Sample& sample = samples[first + k];
      sample.cost = 0;
      for (std::size_t i = 0; i < costs.size(); ++i)
        if (costs[i].weight != 0) sample.cost += costs[i].weight * values_.costs[i * kLanes + k];
      for (std::size_t i = 0; with_values && i < boxes_.size(); ++i) {
        const std::size_t index = boxes_[i].index;
        sample.values[static_cast<Index>(torque_rows + torque_joints_.size() * S + i)] =
            index < variables_ ? points[first + k][static_cast<Index>(index)]
                               : values_.costs[(index - variables_) * kLanes + k];
      }
    }
  }
}

double Barrier::barrier(const Sample& sample) const {
  double sum = 0, product = 1;  // logarithms of products are fewer than those of single slacks
  const auto add = [&](double slack) {
    product *= slack;
    if (product > 1e-100 && product < 1e100) return;
    sum -= std::log(product);
    product = 1;
  };
  for (Index i = 0; i < low_.size(); ++i) {
    const double v = sample.values[i], above = high_[i] - v, below = v - low_[i];
    if (!(above > 0 && below > 0)) return std::numeric_limits<double>::infinity();
    if (std::isfinite(above)) add(above);
    if (std::isfinite(below)) add(below);
  }
  return sum - std::log(product);
}

void Barrier::derivatives(const VectorXd& y) {
  const Index n = static_cast<Index>(variables_);
  std::vector<VectorXd> points;
  for (Index i = 0; i < n; ++i)
    for (const double step : {kStep, -kStep}) {
      points.push_back(y);
      points.back()[i] += step;
    }
  std::vector<Sample> samples;
  evaluate(points, samples);
  J_.resize(low_.size(), n);
  gradient_.resize(n);
  for (Index i = 0; i < n; ++i) {
    const Sample &plus = samples[static_cast<std::size_t>(2 * i)], &minus = samples[static_cast<std::size_t>(2 * i + 1)];
    J_.col(i) = (plus.values - minus.values) / (2 * kStep);
    gradient_[i] = (plus.cost - minus.cost) / (2 * kStep);
  }
}

void Barrier::cost_hessian(const VectorXd& y) {
  const Index n = static_cast<Index>(variables_);
  hessian_at_ = y;
  const auto& costs = evaluator_.problem().costs;
  if (std::all_of(costs.begin(), costs.end(),
                  [](const CostTerm& t) { return t.weight == 0 || t.quantity == Quantity::kTime; })) {
    H_ = MatrixXd::Zero(n, n);  // the duration is convex in its own coordinate alone
    return;
  }
  std::vector<VectorXd> points{y};
  for (Index i = 0; i < n; ++i) {
    points.push_back(y);
    points.back()[i] += kHessianStep;
  }
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k <= i; ++k) {
      points.push_back(y);
      points.back()[i] += kHessianStep;
      points.back()[k] += kHessianStep;
    }
  std::vector<Sample> samples;
  evaluate(points, samples, false);
  H_.resize(n, n);
  std::size_t at = static_cast<std::size_t>(n) + 1;
  for (Index i = 0; i < n; ++i)
    for (Index k = 0; k <= i; ++k)
      H_(i, k) = H_(k, i) = (samples[at++].cost - samples[static_cast<std::size_t>(i) + 1].cost -
                             samples[static_cast<std::size_t>(k) + 1].cost + samples[0].cost) /
                            (kHessianStep * kHessianStep);
  const numerics::SymmetricEigen<Eigen::Dynamic> eigen = numerics::symmetric_eigen(H_);
  const double floor = 1e-8 * std::max(eigen.values.cwiseAbs().maxCoeff(), 1e-12);
  H_ = eigen.vectors * eigen.values.cwiseAbs().cwiseMax(floor).asDiagonal() * eigen.vectors.transpose();
}

double Barrier::excess(const Sample& sample) const {
  double worst = -std::numeric_limits<double>::infinity();
  for (Index i = 0; i < low_.size(); ++i) {
    const double v = sample.values[i];
    worst = std::max(worst, std::max(v - high_[i], low_[i] - v) / scale_[i]);
    if (std::isnan(v)) return std::numeric_limits<double>::infinity();
  }
  return worst;
}

/// One step of Newton's method with a search for its length among sixteen; false if there is none that improves.
bool Barrier::newton(VectorXd& y, Sample& here, double mu, bool with_cost) {
  derivatives(y);
  VectorXd slope(low_.size()), weight(low_.size());
  for (Index i = 0; i < low_.size(); ++i) {
    const double above = 1 / (high_[i] - here.values[i]), below = 1 / (here.values[i] - low_[i]);
    slope[i] = above - below;
    weight[i] = std::sqrt(above * above + below * below);
  }
  VectorXd g = mu * (J_.transpose() * slope);
  MatrixXd N = MatrixXd::Zero(g.size(), g.size());
  if (with_cost) {
    g += gradient_;
    N = H_;
  }
  const MatrixXd scaled = weight.asDiagonal() * J_;
  N.selfadjointView<Eigen::Lower>().rankUpdate(scaled.transpose(), mu);
  N.diagonal().array() += 1e-12 * N.diagonal().maxCoeff() + 1e-300;
  const VectorXd change = -numerics::solve_ldlt(MatrixXd(N.selfadjointView<Eigen::Lower>()), g);
  const double descent = g.dot(change);
  if (!(descent < 0) || !change.allFinite()) return false;
  constexpr double kShorter = 0.6;
  std::vector<VectorXd> trials;
  double length = 1;
  for (std::size_t k = 0; k < 2 * kLanes; ++k, length *= kShorter) trials.push_back(y + length * change);
  std::vector<Sample> samples;
  evaluate(trials, samples);
  double least = (with_cost ? here.cost : 0) + mu * barrier(here);
  std::size_t best = trials.size();
  for (std::size_t k = 0; k < trials.size(); ++k) {
    const double merit = (with_cost ? samples[k].cost : 0) + mu * barrier(samples[k]);
    if (merit < least) {
      least = merit;
      best = k;
    }
  }
  if (best == trials.size()) return false;
  y = trials[best];
  here = samples[best];
  return -descent > 1e-3 * mu;
}

bool Barrier::enter(VectorXd& y, Sample& here) {
  const VectorXd low = low_, high = high_;
  double wide = excess(here);
  for (int round = 0; round < 30 && wide > -1e-6 && going(); ++round) {
    if (!std::isfinite(wide)) return false;
    const double room = wide + 0.1 * std::abs(wide) + 1e-4;
    low_ = low - room * scale_;
    high_ = high + room * scale_;
    for (int step = 0; step < 5 && going() && newton(y, here, 1, false); ++step) {
    }
    low_ = low;
    high_ = high;
    const double next = excess(here);
    if (!(next < wide - 1e-3 * std::abs(wide))) return next < 0;
    wide = next;
  }
  return wide < 0;
}

VectorXd Barrier::minimise() {
  VectorXd y = VectorXd::Zero(static_cast<Index>(variables_));
  std::vector<Sample> first;
  evaluate({y}, first);
  Sample here = first[0];
  if (!std::isfinite(here.cost)) return y;
  if (!(excess(here) < 0) && !enter(y, here)) return y;
  const VectorXd start = y;
  const double start_cost = here.cost;
  constexpr int kSteps = 25;       // for each μ
  constexpr double kMoved = 0.03;  // by which the Hessian of the cost may be out of date; the bounds' is not
  for (double mu = 1e-2 * std::abs(start_cost); mu > 1e-8 * std::abs(start_cost) && going(); mu *= 0.1) {
    if (hessian_at_.size() == 0 || (y - hessian_at_).norm() > kMoved) cost_hessian(y);
    for (int step = 0; step < kSteps && going() && newton(y, here, mu, true); ++step) {
    }
  }
  return here.cost <= start_cost ? y : start;
}

}  // namespace cotwin::optimisation
