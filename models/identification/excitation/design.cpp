#include "models/identification/excitation/design.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/identification/torque_data/torque_data.h"
#include "models/numerics/dense.h"
#include "models/numerics/swarm.h"
#include "models/robot/dynamics.h"

namespace cotwin::excitation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

struct Limits {
  double q_min, q_max, dq, ddq, tau;
};

std::vector<Limits> limits_of(const robot::RobotModel& robot, const DesignOptions& options) {
  const std::size_t n = robot.joints.size();
  for (const auto* given : {&options.q_min, &options.q_max}) {
    if (!given->empty() && given->size() != n)
      throw Error("excitation", std::to_string(given->size()) + " position limits, expected " + std::to_string(n));
  }
  std::vector<Limits> limits;
  for (std::size_t j = 0; j < n; ++j) {
    const robot::Joint& joint = robot.joints[j];
    if (joint.passive)
      throw Error("excitation: " + joint.name, "is passive, expected a motor at every joint: the motion is prescribed");
    constexpr double kTurn = 3.14;  // rad; range to either side of a joint without limits
    Limits l{joint.q_min, joint.q_max, std::min(joint.dq_max, options.dq_max), std::min(joint.ddq_max, options.ddq_max),
             joint.tau_max};
    if (!std::isfinite(l.q_min)) l.q_min = -kTurn;
    if (!std::isfinite(l.q_max)) l.q_max = kTurn;
    if (!options.q_min.empty()) l.q_min = std::max(l.q_min, options.q_min[j]);
    if (!options.q_max.empty()) l.q_max = std::min(l.q_max, options.q_max[j]);
    if (!(l.q_max - l.q_min > 1e-6))
      throw Error("excitation: " + joint.name, "may move from " + text::to_text(l.q_min, 4) + " to " +
                                                   text::to_text(l.q_max, 4) + ", expected room between them");
    limits.push_back(l);
  }
  return limits;
}

void check(const DesignOptions& o) {
  const auto within = [](const char* name, double value, double least, double most) {
    if (!(value >= least && value <= most))
      throw Error("excitation", std::string(name) + " " + text::to_text(value) + ", expected " + text::to_text(least) + " to " +
                                    text::to_text(most));
  };
  within("period", o.period, 0.1, 1e4);
  within("harmonics", o.harmonics, 3, 50);  // two are used for rest at the ends
  within("share", o.share, 0.01, 1);
  within("acceleration limit", o.ddq_max, 1e-6, 1e6);
  within("speed limit", o.dq_max, 1e-6, std::numeric_limits<double>::infinity());
  within("rounds", o.rounds, 1, 1e6);
  within("particles", o.particles, 4, 1e5);
}

/// The quantities computed of a motion, with the memory of one thread.
struct Scratch {
  explicit Scratch(const robot::Mechanism& mechanism, Index n, Index base)
      : data(mechanism), Y(n, 10 * mechanism.body_count()), information(base, base), q(n), dq(n), ddq(n), tau(n) {}
  robot::Data data;
  MatrixXd Y, information;
  VectorXd q, dq, ddq, tau;
};

struct Quality {
  double condition = std::numeric_limits<double>::infinity();
  double log_determinant = -std::numeric_limits<double>::infinity();
  int rank = 0;
};

/// A particle is a motion: per joint 2 · harmonics coefficients for the shape of the velocity, its size (relative to the
/// largest that the limits allow), and its place in the remaining range.
class Designer {
 public:
  Designer(const robot::RobotModel& robot, const DesignOptions& options)
      : options_(options),
        limits_((check(options), limits_of(robot, options))),
        mechanism_(robot),
        base_(identification::base_parameters(robot)),
        n_(robot.joints.size()),
        L_(static_cast<std::size_t>(options.harmonics)),
        samples_(20 * L_) {}

  std::size_t dimensions() const { return n_ * (2 * L_ + 2); }
  Index base() const { return static_cast<Index>(base_.columns.size()); }
  const robot::Mechanism& mechanism() const { return mechanism_; }
  std::unique_ptr<Scratch> scratch() const { return std::make_unique<Scratch>(mechanism_, static_cast<Index>(n_), base()); }

  /// Computes the motion of a particle, whose coordinates are in [−1, 1] and `stride` apart.
  FourierSeries series(const double* x, std::size_t stride) const {
    FourierSeries series{
        n_, L_, options_.period, std::vector<double>(n_ * L_), std::vector<double>(n_ * L_), std::vector<double>(n_)};
    for (std::size_t j = 0; j < n_; ++j) {
      const double* own = x + j * (2 * L_ + 2) * stride;
      const std::span<double> a = std::span(series.a).subspan(j * L_, L_), b = std::span(series.b).subspan(j * L_, L_);
      for (std::size_t l = 0; l < L_; ++l) {
        a[l] = own[2 * l * stride];
        b[l] = own[(2 * l + 1) * stride];
      }
      bring_to_rest(a, b);
      fit(series, j, own[2 * L_ * stride], own[(2 * L_ + 1) * stride]);
    }
    return series;
  }

  /// The cost of a particle: the criterion, plus a penalty for torques beyond their limits.
  double cost(const FourierSeries& series, Scratch& s) const {
    const double torque = collect(series, s, samples_);
    const double beyond = std::max(0.0, torque / options_.share - 1);
    const Quality quality = quality_of(s.information);
    // log10 of the condition number, or minus log10 of the determinant per parameter: both of order 1.
    const double value = options_.criterion == Criterion::kCondition
                             ? std::log10(std::min(quality.condition, 1e12))
                             : -std::max(quality.log_determinant, -1e3) / std::log(10.0) / static_cast<double>(base());
    return value + 20 + 10 * beyond + (beyond > 0 ? 1 : 0);  // 20 makes costs positive
  }

  Design report(const FourierSeries& series) const {
    Design design;
    design.series = series;
    const auto s = scratch();
    collect(series, *s, 4 * samples_);
    const Quality quality = quality_of(s->information);
    design.condition = quality.condition;
    design.log_determinant = quality.log_determinant;
    design.rank = quality.rank;
    design.base = static_cast<int>(base());
    for (std::size_t j = 0; j < n_; ++j) design.margins.push_back(margins(series, j, *s));
    return design;
  }
  double share() const { return options_.share; }

 private:
  /// Scales joint j of the series to `size` of the largest allowed motion and shifts it to `place` in its range.
  void fit(FourierSeries& series, std::size_t j, double size, double place) const {
    const Limits& limits = limits_[j];
    series.q_start[j] = 0;
    double least = 0, most = 0, speed = 0, acceleration = 0;
    const std::size_t N = 40 * L_;
    for (std::size_t k = 0; k < N; ++k) {
      const FourierSeries::State at = series.at(j, options_.period * static_cast<double>(k) / static_cast<double>(N));
      least = std::min(least, at.q);
      most = std::max(most, at.q);
      speed = std::max(speed, std::abs(at.dq));
      acceleration = std::max(acceleration, std::abs(at.ddq));
    }
    // Between two of 40 samples a period of the highest harmonic an extreme rises by 0.3 % at most: 1 − cos(π/40).
    constexpr double kBetween = 1.0031;
    const double room = options_.share * (limits.q_max - limits.q_min);
    double scale = std::numeric_limits<double>::infinity();
    const auto allow = [&](double value, double limit) {
      if (value > 0) scale = std::min(scale, limit / (kBetween * value));
    };
    allow(most - least, room);
    allow(speed, options_.share * limits.dq);
    allow(acceleration, options_.share * limits.ddq);
    if (!std::isfinite(scale)) scale = 0;
    scale *= 0.1 + 0.9 * 0.5 * (size + 1);
    for (std::size_t l = 0; l < L_; ++l) {
      series.a[j * L_ + l] *= scale;
      series.b[j * L_ + l] *= scale;
    }
    const double middle = 0.5 * (limits.q_min + limits.q_max),
                 slack = 0.5 * std::max(0.0, room - kBetween * scale * (most - least));
    series.q_start[j] = middle + place * slack - 0.5 * scale * (most + least);
  }

  /// Computes the information matrix of the base parameters over one period, with rows divided by the torque limits; returns
  /// the largest torque relative to its limit.
  double collect(const FourierSeries& series, Scratch& s, std::size_t samples) const {
    s.information.setZero();
    double most = 0;
    MatrixXd Yb(static_cast<Index>(n_), base());
    for (std::size_t k = 0; k < samples; ++k) {
      state(series, options_.period * static_cast<double>(k) / static_cast<double>(samples), s);
      robot::regressor(mechanism_, s.data, s.q, s.dq, s.ddq, s.Y);
      robot::inverse_dynamics(mechanism_, s.data, s.q, s.dq, s.ddq, s.tau);
      for (std::size_t j = 0; j < n_; ++j) {
        const Index row = static_cast<Index>(j);
        const double unit = std::isfinite(limits_[j].tau) ? limits_[j].tau : 1;
        for (Index c = 0; c < base(); ++c) Yb(row, c) = s.Y(row, base_.columns[static_cast<std::size_t>(c)]) / unit;
        most = std::max(most, std::abs(s.tau[row]) / limits_[j].tau);
      }
      s.information.selfadjointView<Eigen::Lower>().rankUpdate(Yb.transpose());
    }
    s.information /= static_cast<double>(samples);
    return most;
  }

  void state(const FourierSeries& series, double t, Scratch& s) const {
    for (std::size_t j = 0; j < n_; ++j) {
      const FourierSeries::State at = series.at(j, t);
      const Index row = static_cast<Index>(j);
      s.q[row] = at.q;
      s.dq[row] = at.dq;
      s.ddq[row] = at.ddq;
    }
  }

  Quality quality_of(const MatrixXd& information) const {
    const Index b = base();
    const VectorXd scale = information.diagonal().cwiseSqrt();
    if (!(scale.minCoeff() > 0)) return {};
    MatrixXd scaled = information.selfadjointView<Eigen::Lower>();
    scaled = scale.cwiseInverse().asDiagonal() * scaled * scale.cwiseInverse().asDiagonal();
    const VectorXd values = numerics::symmetric_eigenvalues(scaled);
    Quality quality;
    const double largest = values[b - 1];
    for (Index i = 0; i < b; ++i) quality.rank += values[i] > 1e-12 * largest ? 1 : 0;
    if (quality.rank < b) return quality;
    quality.condition = std::sqrt(largest / values[0]);
    quality.log_determinant = values.array().log().sum() + 2 * scale.array().log().sum();
    return quality;
  }

  Margins margins(const FourierSeries& series, std::size_t j, Scratch& s) const {
    const Limits& limits = limits_[j];
    const double middle = 0.5 * (limits.q_min + limits.q_max), half = 0.5 * (limits.q_max - limits.q_min);
    Margins m;
    const std::size_t N = 400 * L_;
    for (std::size_t k = 0; k < N; ++k) {
      state(series, options_.period * static_cast<double>(k) / static_cast<double>(N), s);
      robot::inverse_dynamics(mechanism_, s.data, s.q, s.dq, s.ddq, s.tau);
      const Index row = static_cast<Index>(j);
      m.q = std::max(m.q, std::abs(s.q[row] - middle) / half);
      m.dq = std::max(m.dq, std::abs(s.dq[row]) / limits.dq);
      m.ddq = std::max(m.ddq, std::abs(s.ddq[row]) / limits.ddq);
      m.tau = std::max(m.tau, std::abs(s.tau[row]) / limits.tau);
    }
    return m;
  }

  const DesignOptions& options_;
  std::vector<Limits> limits_;
  robot::Mechanism mechanism_;
  identification::BaseParameters base_;
  std::size_t n_, L_;
  std::size_t samples_;  // per period at which motions are evaluated
};

}  // namespace

Design design_excitation(const robot::RobotModel& robot, const DesignOptions& options, numerics::Threads* threads,
                         const std::function<bool(int round)>& progress) {
  if (robot.joints.empty()) throw Error("excitation", "the robot has no movable joint, expected at least one");
  const Designer designer(robot, options);
  numerics::SwarmOptions swarm_options;
  swarm_options.particles = options.particles;
  swarm_options.rounds = options.rounds;
  swarm_options.seed = options.seed;

  const std::size_t d = designer.dimensions();
  const std::size_t blocks = (static_cast<std::size_t>(options.particles) + numerics::kSwarmBlock - 1) / numerics::kSwarmBlock;
  std::vector<std::unique_ptr<Scratch>> scratch;
  for (std::size_t i = 0; i < blocks; ++i) scratch.push_back(designer.scratch());
  numerics::Swarm swarm(
      std::vector<double>(d, -1.0), std::vector<double>(d, 1.0),
      [&](std::size_t block, std::size_t count, const double* x, std::size_t stride, double* cost) {
        for (std::size_t k = 0; k < count; ++k) cost[k] = designer.cost(designer.series(x + k, stride), *scratch[block]);
      },
      swarm_options);
  int round = 0;
  while (swarm.round(threads) == numerics::SwarmStatus::kRunning) {
    if (progress && !progress(++round)) break;
  }
  std::vector<double> best(d);
  swarm.best(best);
  Design design = designer.report(designer.series(best.data(), 1));
  design.cost_history = swarm.state().history;
  for (std::size_t j = 0; j < robot.joints.size(); ++j) {
    if (design.margins[j].tau <= 1) continue;
    throw Error("excitation: " + robot.joints[j].name,
                "would need " + text::to_text(100 * design.margins[j].tau, 4) +
                    " % of its torque, expected less; a longer period, smaller limits or more rounds would do");
  }
  return design;
}

}  // namespace cotwin::excitation
