#include "models/optimisation/reactionless/reactionless.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "models/foundation/support/error.h"
#include "models/numerics/dense.h"
#include "models/numerics/swarm.h"
#include "models/optimisation/reactionless/integrator.h"

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr int kGridCorrections = 10;  // of the coefficients on a finer grid
// Weights of residuals against the speeds in units of their limits, per rad and m: of what is left to the goal and (kLimit as much) of
// what exceeds a limit of position less a margin, for the swarm and for the last steps; of the base's turn at the end and on the way.
constexpr double kGoal = 1e3, kExactGoal = 1e5, kLimit = 0.3, kTurn = 300, kWayTurn = 10;
constexpr double kMargin = 0.01;  // rad, m
// Of the bounds of speed and acceleration, and of jerk, since differences of steps are not exact; by how much they may be exceeded.
constexpr double kRateShare = 0.92, kJerkShare = 0.85, kRateTolerance = 0.06;

}  // namespace

struct ReactionlessMotion::Impl {
  Impl(const ReactionlessProblem& problem, const ReactionlessOptions& o, numerics::Threads* t)
      : p(problem), options(o), threads(t ? t : &alone), n(p.robot.n()), coarse(table_of(kSteps)) {
    for (const auto* x : {&p.q_from, &p.bounds.q_min, &p.bounds.q_max, &p.bounds.dq, &p.bounds.ddq, &p.bounds.dddq, &p.q_to}) {
      const bool pose = x == &p.q_to && x->empty();
      if (!pose && x->size() != p.robot.joints.size())
        throw Error("reactionless", "has " + std::to_string(x->size()) + " values for " + std::to_string(n) +
                                        " joints, expected one per joint");
    }
    for (int first = 0; first < o.particles; first += static_cast<int>(numerics::kSwarmBlock))
      integrators.push_back(std::make_unique<Integrator>(p));
    goals = integrators.front()->left(integrators.front()->start(), Quaterniond::Identity()).size();
    if (keep_attitude() && search()) return;
    turns = true;
    columns = n;
    for (auto& i : integrators) i->allow_turn();
    search();
  }

  /// Stays within null(Z), or returns false with the obstacle.
  bool keep_attitude() {
    const std::optional<MatrixXd> basis = attitude_keeping(*integrators.front(), n, obstacle);
    if (!basis) return false;
    columns = basis->cols();
    for (auto& i : integrators) i->keep_attitude(*basis);
    return true;
  }

  /// The coefficients of those of many grown motions that end nearest to the goal.
  std::vector<VectorXd> nearest_grown() const {
    constexpr std::size_t kGrown = 2048, kKept = 6;
    std::vector<std::pair<double, std::uint32_t>> all(kGrown);
    threads->run(integrators.size(), [&](std::size_t worker) {
      VectorXd r;
      for (std::size_t k = worker; k < kGrown; k += integrators.size()) {
        const auto number = static_cast<std::uint32_t>(k);
        residuals(*integrators[worker], drawn(columns, options.seed, number), kGoal, r);
        all[k] = {r.squaredNorm(), number};
      }
    });
    std::ranges::partial_sort(all, all.begin() + kKept);
    std::vector<VectorXd> nearest;
    for (std::size_t k = 0; k < kKept; ++k) nearest.push_back(drawn(columns, options.seed, all[k].second));
    return nearest;
  }
  /// Searches c; true if the motion reaches the goal within the limits.
  bool search() {
    const auto size = static_cast<std::size_t>(columns * kTerms);
    const auto cost = [&](std::size_t block, std::size_t count, const double* x, std::size_t stride, double* costs) {
      VectorXd one(columns * kTerms), r;
      for (std::size_t k = 0; k < count; ++k) {
        for (std::size_t i = 0; i < size; ++i) one[static_cast<Index>(i)] = x[i * stride + k];
        residuals(*integrators[block], one, kGoal, r);
        costs[k] = r.squaredNorm();
      }
    };
    double best = std::numeric_limits<double>::infinity();
    const auto reaches = [&](const VectorXd& start) {
      VectorXd x = start;
      improve(x, kGoal);
      const double found = improve(x, kExactGoal);
      if (!(found < best)) return false;
      best = found;
      c = x;
      (void)sampled(coarse);
      if (reached() && within) heed_rates(start);
      return reached() && within;
    };
    for (int attempt = 0; attempt < options.attempts; ++attempt) {
      numerics::SwarmOptions o;
      o.particles = options.particles;
      o.rounds = options.rounds;
      o.seed = options.seed + static_cast<std::uint64_t>(attempt);
      numerics::Swarm swarm(std::vector<double>(size, -kLargest), std::vector<double>(size, kLargest),
                            std::vector<double>(size), std::vector<double>(size, 0.25 * kLargest), cost, o);
      swarm.run(threads);
      VectorXd x(columns * kTerms);
      swarm.best({x.data(), size});
      if (reaches(x)) return true;
      if (attempt > 0 || turns) continue;
      for (const VectorXd& near : nearest_grown())
        if (reaches(near)) return true;
    }
    if (!turns)
      obstacle =
          std::string("no motion without reaction was found ") + (reached() ? "within the limits of position" : "to the goal");
    return false;
  }
  /// In a given time, improves a motion that exceeds bounds of speed, acceleration or jerk, if it can: from itself, and from where its
  /// search began.
  void heed_rates(const VectorXd& start) {
    const auto largest_excess = [&] {
      MatrixXd rates(n, kSteps + 1);
      integrators.front()->run(c, coarse,
                               [&](Index k, const VectorXd&, const VectorXd& dq, const Quaterniond&) { rates.col(k) = dq; });
      return excess(rates).maxCoeff();
    };
    if (p.T == 0) return;
    VectorXd kept = c;
    double least = largest_excess();
    for (const VectorXd& from : {VectorXd(c), start}) {
      if (least < kRateTolerance) break;
      c = from;
      heeds = true;
      improve(c, kGoal);
      improve(c, kExactGoal);
      heeds = false;
      (void)sampled(coarse);
      const double found = largest_excess();
      if (!reached() || !within || !(found < least)) continue;
      least = found;
      kept = c;
    }
    c = kept;
    (void)sampled(coarse);
  }
  bool reached() const { return std::max(distance, angle) <= 1e-6; }

  /// All residuals of a motion; the first `goals` are those of the goal.
  void residuals(Integrator& i, const VectorXd& x, double goal_weight, VectorXd& r) const {
    const Index row = n * (kSteps + 1), of_turn = turns ? 3 * (kSteps + 1) : 0;
    const double mean = 1 / std::sqrt(static_cast<double>(kSteps));
    r.resize(goals + 2 * row + of_turn + (heeds ? row : 0));
    MatrixXd rates(n, heeds ? kSteps + 1 : 0);
    i.run(x, coarse, [&](Index k, const VectorXd& q, const VectorXd& dq, const Quaterniond& Q) {
      for (Index j = 0; j < n; ++j) {
        const auto joint = static_cast<std::size_t>(j);
        const double speed = std::isfinite(p.bounds.dq[joint]) ? p.bounds.dq[joint] : 1;
        r[goals + k * n + j] = kLimit * goal_weight *
                               std::max({p.bounds.q_min[joint] + kMargin - q[j], q[j] - p.bounds.q_max[joint] + kMargin, 0.0});
        r[goals + row + k * n + j] = mean * dq[j] / speed;
      }
      if (heeds) rates.col(k) = dq;
      if (turns)
        r.segment<3>(goals + 2 * row + 3 * k) = (k == kSteps ? kTurn : kWayTurn * mean) * 2 * (Q.w() < 0 ? -1 : 1) * Q.vec();
      if (k == kSteps) r.head(goals) = goal_weight * i.left(q, Q);
    });
    if (heeds) r.tail(row) = kLimit * kGoal * excess(rates).reshaped();
    if (!r.allFinite()) r.setConstant(1e9);
  }

  /// By how much speed, acceleration or jerk exceeds its bound in the time T, relative, of each joint at each step, from dq/ds.
  MatrixXd excess(const MatrixXd& rates) const {
    MatrixXd beyond(n, kSteps + 1);
    beyond.setZero();
    each_rate(rates, [&](Index k, Index j, double dq, double ddq, double dddq) {
      const auto joint = static_cast<std::size_t>(j);
      beyond(j, k) = std::max({dq / p.T / p.bounds.dq[joint] - kRateShare, ddq / (p.T * p.T) / p.bounds.ddq[joint] - kRateShare,
                               dddq / (p.T * p.T * p.T) / p.bounds.dddq[joint] - kJerkShare, 0.0});
    });
    return beyond;
  }

  /// ∂r/∂c by differences.
  MatrixXd jacobian(const VectorXd& x, double goal_weight, const VectorXd& r) const {
    MatrixXd J(r.size(), x.size());
    const auto columns_of = [&](std::size_t worker) {
      VectorXd shifted = x, s;
      for (auto j = static_cast<Index>(worker); j < x.size(); j += static_cast<Index>(integrators.size())) {
        shifted[j] = x[j] + kDifference;
        residuals(*integrators[worker], shifted, goal_weight, s);
        J.col(j) = (s - r) / kDifference;
        shifted[j] = x[j];
      }
    };
    threads->run(integrators.size(), columns_of);
    return J;
  }

  /// Levenberg–Marquardt steps; returns the sum of squares.
  double improve(VectorXd& x, double goal_weight) const {
    constexpr double kLargestDamping = 1e9;
    VectorXd r, s;
    residuals(*integrators.front(), x, goal_weight, r);
    double lambda = 1e-3;
    for (int step = 0; step < 50; ++step) {
      const MatrixXd J = jacobian(x, goal_weight, r), A = J.transpose() * J;
      const VectorXd gradient = J.transpose() * r;
      const double before = r.squaredNorm();
      for (; lambda < kLargestDamping; lambda *= 4) {
        MatrixXd damped = A;
        damped.diagonal() += lambda * (A.diagonal().array() + 1e-9).matrix();
        const VectorXd y = x - numerics::solve_ldlt(damped, gradient);
        residuals(*integrators.front(), y, goal_weight, s);
        if (!(s.squaredNorm() < before)) continue;
        x = y;
        r = s;
        lambda = std::max(0.2 * lambda, 1e-12);
        break;
      }
      if (!(r.squaredNorm() < before * (1 - 1e-6))) break;
    }
    return r.squaredNorm();
  }

  /// Postures on a grid, n per step; before that c is corrected so that the end meets the goal, in steps of least length with the
  /// derivative on the grid of the search. Sets distance, angle and within.
  std::vector<double> sampled(const MatrixXd& phi) {
    Integrator& first = *integrators.front();
    VectorXd r, left;
    residuals(first, c, 1, r);
    const MatrixXd G = jacobian(c, 1, r).topRows(goals);
    MatrixXd GG = G * G.transpose();
    GG.diagonal().array() += 1e-9 * GG.trace();
    std::vector<double> q;
    const auto integrate = [&] {
      q.clear();
      within = true;
      first.run(c, phi, [&](Index k, const VectorXd& at, const VectorXd&, const Quaterniond& Q) {
        q.insert(q.end(), at.begin(), at.end());
        for (std::size_t j = 0; j < p.bounds.q_min.size(); ++j) {
          const double x = at[static_cast<Index>(j)];
          within = within && x >= p.bounds.q_min[j] && x <= p.bounds.q_max[j];
        }
        if (2 * k + 1 == phi.cols()) left = first.left(at, Q);
      });
    };
    integrate();
    for (int i = 0; i < kGridCorrections && left.norm() > 1e-10; ++i) {
      const VectorXd before = c;
      const double size = left.norm();
      c -= G.transpose() * numerics::solve_ldlt(GG, left);
      integrate();
      if (left.norm() < size) continue;
      c = before;
      integrate();
      break;
    }
    distance = angle = 0;
    for (Index i = 0, row = 0; row < goals; ++i) {
      const auto k = static_cast<std::size_t>(i);
      if (p.q_to.empty() && !p.directions.used[k]) continue;
      const bool turned = p.q_to.empty() ? i >= 3 : p.robot.joints[k].type == robot::JointType::kRevolute;
      double& worst = turned ? angle : distance;
      worst = std::max(worst, std::abs(left[row++]));
    }
    return q;
  }

  ReactionlessProblem p;
  ReactionlessOptions options;
  numerics::Threads alone{1};
  numerics::Threads* threads;
  Index n, goals = 0, columns = 0;
  bool turns = false, within = false, heeds = false;
  MatrixXd coarse;                                       // table_of(kSteps)
  std::vector<std::unique_ptr<Integrator>> integrators;  // one per block of the swarm
  VectorXd c;
  std::string obstacle;
  double distance = 0, angle = 0;
};

ReactionlessMotion::ReactionlessMotion(const ReactionlessProblem& problem, const ReactionlessOptions& options,
                                       numerics::Threads* threads)
    : impl_(std::make_unique<Impl>(problem, options, threads)) {}
ReactionlessMotion::~ReactionlessMotion() = default;
const std::string& ReactionlessMotion::obstacle() const { return impl_->obstacle; }
double ReactionlessMotion::distance() const { return impl_->distance; }
double ReactionlessMotion::angle() const { return impl_->angle; }
bool ReactionlessMotion::reached() const { return impl_->reached(); }

trajectory::Series ReactionlessMotion::sample(double T, int steps) {
  trajectory::Series s;
  s.width = impl_->p.q_from.size();
  for (int k = 0; k <= steps; ++k) s.t.push_back(T * k / steps);
  s.x = impl_->sampled(table_of(steps));
  return s;
}

}  // namespace cotwin::optimisation
