#include "models/optimisation/search.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/numerics/swarm.h"
#include "models/optimisation/barrier.h"
#include "models/optimisation/budget.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kEnough = 1e-3;                               // relative improvement below which the refinement ends
constexpr double kNorm = 40;                                   // of the maxima in the refinement
constexpr double kTorqueTier = 1e100, kKinematicTier = 1e200;  // Deb's rules as one number: costs are far below

/// A bound of a cost from an earlier search of minimise_in_order. The swarm and the barrier see the cost at fewer samples than the
/// final check, so that they have a bound of their own.
struct CostBound {
  std::size_t term = 0;
  double most = 0;        // of the cost as assess() sees it
  double at_samples = 0;  // of that at the samples of the search
};

/// Keeps the swarm inside the bounds, so that the barrier starts with slack. A motion without free coefficients has none to lose.
Problem tightened(Problem problem) {
  if (problem.degree == 5) return problem;
  constexpr double kShare = 1 - 2e-3;
  for (auto* bounds : {&problem.bounds.dq, &problem.bounds.ddq, &problem.bounds.dddq, &problem.bounds.tau})
    for (double& bound : *bounds) bound *= kShare;
  return problem;
}

std::chrono::steady_clock::time_point end_of_time(double limit) {
  using Clock = std::chrono::steady_clock;
  constexpr double kYear = 3.15e7;
  if (!(limit < kYear)) return Clock::time_point::max();
  return Clock::now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(limit));
}

struct Point {
  VectorXd c;
  double u = 1, z = 0.5;  // of ln T and of the end postures, in [0, 1]
  std::vector<ComplianceValues> compliance;
};

/// The geometric means of the ranges.
std::vector<ComplianceValues> middle_compliance(const Problem& p) {
  std::vector<ComplianceValues> all;
  if (!p.compliant) return all;
  for (const auto& [u, least, most] : p.compliant->axes)
    all.push_back({std::sqrt(least.M * most.M), std::sqrt(least.D * most.D), std::sqrt(least.S * most.S)});
  return all;
}

class Search {
 public:
  Search(const Problem& problem, const SearchOptions& options, std::vector<CostBound> bounds, numerics::Threads* threads)
      : options_(options), bounds_(std::move(bounds)), threads_(threads), problem_(problem), evaluator_(tightened(problem)) {
    const std::size_t blocks =
        (static_cast<std::size_t>(std::max(options.particles, 1)) + numerics::kSwarmBlock - 1) / numerics::kSwarmBlock;
    for (std::size_t i = 0; i < blocks; ++i) {
      scratch_.push_back(evaluator_.scratch());
      motions_.push_back(evaluator_.motions());
      values_.push_back(evaluator_.values());
      decoded_.emplace_back(evaluator_.joints() * evaluator_.basis().redundant() * kLanes + 8 * kLanes);
    }
    if (options.device == DeviceUse::kGpu || (options.device == DeviceUse::kAuto && options.particles >= kForDevice))
      try_device([&] {
        judged_ = std::make_unique<JudgedBlocks>(evaluator_, blocks, device_for(options.device));
        if (options_.on_device) options_.on_device(judged_->judge().device(), judged_->judge().rounding(), "");
      });
  }

  const Problem& problem() const { return problem_; }

  Solution run(const std::optional<Point>& start) {
    const std::size_t d = evaluator_.joints() * evaluator_.basis().redundant();
    Point best = start ? *start : Point{VectorXd::Zero(static_cast<Index>(d)), 1, 0.5, middle_compliance(problem())};
    if (!start && !problem().end_postures.empty()) best.z = nearest_posture(problem().ends.q_from);
    // Each stage: its share of the rounds, the size of the swarm in the metric, and the number of coefficients per joint. A swarm
    // of few dimensions finds the region, because φ_k are the same for all degrees.
    struct Stage {
      double share, spread;
      std::size_t terms;
    };
    constexpr Stage kStages[] = {{0.3, 0.5, 2}, {0.3, 0.1, 4}, {0.2, 0.05, 10}, {0.2, 0.01, 26}};
    int left = options_.rounds;
    for (std::size_t i = 0; i < std::size(kStages) && going_; ++i) {
      const bool last = i + 1 == std::size(kStages);
      const int rounds = last ? left : std::min(left, static_cast<int>(kStages[i].share * options_.rounds));
      if (rounds > 0) best = stage(static_cast<int>(i), rounds, kStages[i].spread, kStages[i].terms, best);
      left -= rounds;
    }
    if (still_going() && options_.refine) best = refined(best);
    if (problem().compliant) best = with_best_compliance(best);
    Solution solution = check(best);
    if (start) {  // it meets the bounds of the earlier costs
      Solution first = check(*start);
      if (first.status == Status::kFeasible && (solution.status != Status::kFeasible || first.cost < solution.cost)) {
        solution = std::move(first);
        best = *start;
      }
    }
    best_ = best;
    solution.history = history_;
    solution.evaluations = evaluations_;
    solution.pruned = pruned_;
    solution.complete = going_;
    return solution;
  }
  const Point& best() const { return best_; }
  /// A motion that was found, with the end posture nearest to its own.
  Point point_of(const Solution& s) const {
    const Problem& p = problem();
    const std::size_t n = evaluator_.joints(), d = n * evaluator_.basis().redundant(), axes = middle_compliance(p).size();
    if (s.c.size() != d || s.q_to.size() != n || s.compliance.size() != axes || !(s.T > 0)) {
      throw Error("optimisation", "a search from a motion of " + std::to_string(s.q_to.size()) + " joints, " +
                                      std::to_string(s.c.size()) + " coefficients, " + std::to_string(s.compliance.size()) +
                                      " compliant axes and " + text::to_text(s.T) + " s, expected " + std::to_string(n) + ", " +
                                      std::to_string(d) + ", " + std::to_string(axes) + " and a duration above 0");
    }
    const double u = p.T_min == p.T_max ? 1 : std::clamp(std::log(s.T / p.T_min) / std::log(p.T_max / p.T_min), 0.0, 1.0);
    return {Eigen::Map<const VectorXd>(s.c.data(), static_cast<Index>(s.c.size())), u, nearest_posture(s.q_to), s.compliance};
  }
  /// A cost of a motion at the samples of the search.
  double cost_at_samples(const Point& p, std::size_t term) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) set_lane(motions_[0], lane, p);
    evaluator_.evaluate(motions_[0], *scratch_[0], values_[0], true);
    return values_[0].costs[term * kLanes];
  }

 private:
  static constexpr int kForDevice = 10000;  // particles

  /// Does without the device if it fails.
  template <class Work>
  void try_device(Work work) {
    try {
      work();
    } catch (const numerics::DeviceError& error) {
      if (options_.device == DeviceUse::kGpu) throw;
      judged_.reset();
      if (options_.on_device) options_.on_device("", 0, error.what());
    }
  }

  bool still_going(std::uint64_t further = 0) {
    if (evaluations_ + further >= options_.evaluations || std::chrono::steady_clock::now() >= end_) going_ = false;
    return going_;
  }

  double duration(double u) const {
    const Problem& p = problem();
    return p.T_min == p.T_max ? p.T_min : std::clamp(p.T_min * std::pow(p.T_max / p.T_min, u), p.T_min, p.T_max);
  }

  std::vector<double> end_of(double z) const {
    const auto& postures = problem().end_postures;
    if (postures.empty()) return problem().ends.q_to;
    if (postures.size() == 1) return postures.front();
    const double at = z * static_cast<double>(postures.size() - 1);
    const std::size_t k = std::min(static_cast<std::size_t>(at), postures.size() - 2);
    const double share = at - static_cast<double>(k);
    std::vector<double> q(evaluator_.joints());
    for (std::size_t j = 0; j < q.size(); ++j) q[j] = (1 - share) * postures[k][j] + share * postures[k + 1][j];
    return q;
  }

  /// The place of the end posture nearest to q.
  double nearest_posture(const std::vector<double>& q) const {
    const auto& postures = problem().end_postures;
    std::size_t nearest = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0; k < postures.size(); ++k) {
      double distance = 0;
      for (std::size_t j = 0; j < evaluator_.joints(); ++j) distance += (postures[k][j] - q[j]) * (postures[k][j] - q[j]);
      if (distance < least) {
        least = distance;
        nearest = k;
      }
    }
    return postures.size() < 2 ? 0.5 : static_cast<double>(nearest) / static_cast<double>(postures.size() - 1);
  }

  void set_lane(Motions& m, std::size_t lane, const Point& p) const {
    for (Index i = 0; i < p.c.size(); ++i) m.c[static_cast<std::size_t>(i) * kLanes + lane] = p.c[i];
    const std::vector<double> q = end_of(p.z);
    for (std::size_t j = 0; j < q.size(); ++j) m.q_to[j * kLanes + lane] = q[j];
    m.T[lane] = duration(p.u);
    for (std::size_t k = 0; k < p.compliance.size(); ++k) {
      const ComplianceValues& v = p.compliance[k];
      std::size_t at = 3 * k * kLanes + lane;
      for (const double x : {v.M, v.D, v.S}) {
        m.compliance[at] = x;
        at += kLanes;
      }
    }
  }

  /// The point with the parameters of compliance that are best for its motion, if they are better.
  Point with_best_compliance(const Point& p) const {
    Point own = p;
    own.compliance = best_compliance(problem(), {p.c.data(), static_cast<std::size_t>(p.c.size())}, end_of(p.z), duration(p.u),
                                     p.compliance, options_.seed);
    const Solution before = check(p), after = check(own);
    const bool same = before.status == after.status;
    if (!same) return after.status < before.status ? own : p;
    if (after.cost != before.cost) return after.cost < before.cost ? own : p;
    return settle_of(after) <= settle_of(before) ? own : p;
  }
  static double settle_of(const Solution& s) {
    double longest = 0;
    for (const AxisResponse& r : s.responses) longest = std::max(longest, r.settle);
    return longest;
  }

  /// The Hessian of ½ ∫ Σ τ² dt by c at a point (Gauss–Newton: derivatives of τ by differences), with a small share of that of
  /// ∫ Σ q̈² dt, which alone is the metric of a problem without torques. `size`: √ of the integral at the point.
  MatrixXd metric(const Point& at, double& size) {
    const std::size_t n = evaluator_.joints(), K = evaluator_.basis().redundant(), d = n * K;
    const Index D = static_cast<Index>(d);
    const double T = duration(at.u);
    const Quadrature rule = gauss_legendre(static_cast<std::size_t>(evaluator_.basis().degree()));
    MatrixXd bending = MatrixXd::Zero(D, D);
    MatrixXd curvature(static_cast<Index>(rule.s.size()), static_cast<Index>(K));
    for (std::size_t i = 0; i < rule.s.size(); ++i)
      for (std::size_t k = 0; k < K; ++k)
        curvature(static_cast<Index>(i), static_cast<Index>(k)) =
            std::sqrt(rule.w[i]) *
            trajectory::bernstein::evaluate(evaluator_.basis().points(evaluator_.basis().boundary_columns() + k), rule.s[i])[2];
    const MatrixXd gram = curvature.transpose() * curvature / (T * T * T);
    for (std::size_t j = 0; j < n; ++j) {
      const Index first = static_cast<Index>(j * K);
      bending.block(first, first, static_cast<Index>(K), static_cast<Index>(K)) = gram;
    }
    const bool torques =
        std::any_of(problem().costs.begin(), problem().costs.end(),
                    [](const CostTerm& t) { return needs_torques(t.quantity); }) ||
        std::any_of(problem().bounds.tau.begin(), problem().bounds.tau.end(), [](double x) { return std::isfinite(x); });
    Motions& m = motions_[0];
    const std::size_t samples = evaluator_.samples();
    const Index rows = static_cast<Index>(samples * n);
    size = 0;
    const auto from = problem().ends.q_from;
    const std::vector<double> to = end_of(at.z);
    for (std::size_t j = 0; j < n; ++j) size += 120.0 / 7 * (to[j] - from[j]) * (to[j] - from[j]) / (T * T * T);
    size = std::sqrt(size);
    if (!torques) return bending;
    const double step = 1e-5;
    MatrixXd J(rows, D);
    VectorXd tau_0(rows);
    for (std::size_t first = 0; first < d; first += kLanes - 1) {
      const std::size_t count = std::min(kLanes - 1, d - first);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        Point moved = at;
        if (lane > 0 && lane <= count) moved.c[static_cast<Index>(first + lane - 1)] += step;
        set_lane(m, lane, moved);
      }
      m.count = count + 1;
      std::array<std::vector<double>, kLanes> tau;
      evaluator_.evaluate(m, *scratch_[0], values_[0], true,
                          [&](std::size_t lane, std::size_t begin, std::size_t part, const double* values, const double*) {
                            tau[lane].resize(static_cast<std::size_t>(rows));
                            for (std::size_t j = 0; j < n; ++j)
                              for (std::size_t s = 0; s < part; ++s)
                                tau[lane][j * samples + begin + s] =
                                    std::sqrt(evaluator_.weights()[begin + s] * T) * values[j * part + s];
                          });
      m.count = kLanes;
      tau_0 = Eigen::Map<const VectorXd>(tau[0].data(), rows);
      for (std::size_t k = 0; k < count; ++k)
        J.col(static_cast<Index>(first + k)) = (Eigen::Map<const VectorXd>(tau[k + 1].data(), rows) - tau_0) / step;
    }
    MatrixXd H = J.transpose() * J;
    if (!H.allFinite() || !(H.trace() > 0)) return bending;
    size = tau_0.norm();
    return H + 1e-4 * H.trace() / bending.trace() * bending;
  }

  double deb(const Values& v, std::size_t lane) const {
    if (v.kinematic[lane] > 0) return kKinematicTier * v.kinematic[lane];
    double beyond = v.torque[lane];
    for (const CostBound& bound : bounds_)
      beyond += std::max(
          0.0, (v.costs[bound.term * kLanes + lane] - bound.at_samples) / std::max(std::abs(bound.at_samples), 1e-300));
    if (beyond > 0) return kTorqueTier * beyond;
    double cost = 0;
    for (std::size_t i = 0; i < problem().costs.size(); ++i)
      if (problem().costs[i].weight != 0) cost += problem().costs[i].weight * v.costs[i * kLanes + lane];
    return cost;
  }

  /// Newton's method on the logarithmic barrier with ever more coefficients per joint: φ_k are the same for all degrees, so each
  /// result is the start of the next one and a higher degree is not slower than a lower one. (With all of them at once it often
  /// stalls at degree 13 and 15.)
  Point refined(const Point& from) {
    const std::size_t K = evaluator_.basis().redundant();
    Problem smooth = problem();
    smooth.smooth_maxima = kNorm;
    const Evaluator exact(smooth);
    const auto scratch = exact.scratch();
    constexpr std::size_t kFirst = 4;
    constexpr double kMargin = 1e-4;
    // The swarm may end in the valley of a worse local optimum: the first coefficients are also refined from the quintic and from
    // half way to it.
    Refinement state;
    for (const double share : {1.0, 0.0, 0.5}) {
      if (share < 1 && (from.c.isZero() || !still_going())) break;
      Refinement own;
      own.best = own.current = from;
      own.current.c *= share;
      own.margins.assign(5 * evaluator_.joints(), kMargin);
      if (const Solution first = check(own.current); first.status == Status::kFeasible) {
        own.best = own.current;
        own.least = first.cost;
      }
      refine(own, exact, *scratch, std::min(K, kFirst), false);
      if (share == 1 || own.least < state.least) state = std::move(own);
    }
    if (!(state.least < kNone) && still_going()) {
      if (const std::optional<Point> quick = quickest(from)) {
        Refinement own;
        own.best = own.current = *quick;
        own.margins.assign(5 * evaluator_.joints(), kMargin);
        own.least = check(*quick).cost;
        refine(own, exact, *scratch, std::min(K, kFirst), false);
        state = std::move(own);
      }
    }
    for (std::size_t terms = std::min(K, kFirst); terms < K && going_; terms += std::max<std::size_t>(2, terms / 3))
      refine(state, exact, *scratch, terms, false);
    refine(state, exact, *scratch, K, true);
    return state.best;
  }

  static constexpr double kNone = std::numeric_limits<double>::infinity();
  struct Refinement {
    Point best, current;
    double least = kNone;         // cost of `best`, ∞ if it is not feasible
    std::vector<double> margins;  // of the barrier's bounds
  };

  /// A motion that keeps all bounds, where neither the swarm nor Newton's method has found one: the fastest one that is found when it may
  /// be much slower, if it is fast enough.
  std::optional<Point> quickest(const Point& from) {
    if (!bounds_.empty() || seeks_quickest_) return std::nullopt;
    constexpr double kLonger = 16, kShorter = 4;
    Problem slow = problem();
    slow.T_max *= kLonger;
    slow.T_min = std::min(slow.T_min, problem().T_max / kShorter);
    slow.costs = {{Quantity::kTime, 1, {}}};
    SearchOptions options = options_;
    options.rounds = 0;
    options.evaluations -= evaluations_;
    options.limit = std::chrono::duration<double>(end_ - std::chrono::steady_clock::now()).count();
    Search search(slow, options, {}, threads_);
    search.seeks_quickest_ = true;
    Point start = from;
    start.c.setZero();
    start.u = 1;
    const Solution found = search.run(start);
    evaluations_ += found.evaluations;
    going_ = going_ && found.complete;
    if (found.status != Status::kFeasible || found.T > problem().T_max) return std::nullopt;
    Point point = from;
    point.c = Eigen::Map<const VectorXd>(found.c.data(), static_cast<Index>(found.c.size()));
    point.z = search.best().z;
    const double room = std::log(problem().T_max / problem().T_min), above = std::log(found.T / problem().T_min);
    point.u = room > 0 ? std::clamp(above / room, 0.0, 1.0) : 1;
    return check(point).status == Status::kFeasible ? std::optional(point) : std::nullopt;
  }

  Solution check(const Point& p) const {
    Solution s =
        assess(problem(), {p.c.data(), static_cast<std::size_t>(p.c.size())}, end_of(p.z), duration(p.u), p.compliance);
    for (const CostBound& bound : bounds_) {
      if (s.status != Status::kFeasible || s.costs[bound.term] <= bound.most) continue;
      s.status = Status::kBestEffort;
      s.reason = std::string("the cost ") + to_text(problem().costs[bound.term].quantity) + " is " +
                 text::to_text(s.costs[bound.term]) + ", bound " + text::to_text(bound.most) +
                 " by its optimum and the tolerance";
    }
    return s;
  }

  /// Repeats the barrier from its results as long as they improve. Each bound that the barrier's samples miss is tightened by what its
  /// exact peak exceeds.
  void refine(Refinement& state, const Evaluator& exact, Evaluator::Scratch& scratch, std::size_t terms, bool to_the_end) {
    constexpr int kFew = 2, kAttempts = 8;
    const int attempts = to_the_end ? kAttempts : kFew;
    const bool free_T = problem().T_min<problem().T_max, free_end = problem().end_postures.size()> 1;
    if (state.least < kNone) state.current = state.best;
    for (int attempt = 0; attempt < attempts && still_going(); ++attempt) {
      const Point current = state.current;
      const MatrixXd map = coordinates(current, terms);
      const std::size_t d = static_cast<std::size_t>(map.cols());
      const std::size_t variables = d + (free_T ? 1 : 0) + (free_end ? 1 : 0);
      if (variables == 0) return;
      const auto point = [&](const VectorXd& y) {
        Point p = current;
        if (d > 0) p.c += map * y.head(static_cast<Index>(d));
        if (free_T) p.u += y[static_cast<Index>(d)];
        if (free_end) p.z = std::clamp(p.z + y[static_cast<Index>(variables) - 1], 0.0, 1.0);
        return p;
      };
      std::vector<BarrierBox> boxes;
      if (free_T) boxes.push_back({d, -1e-9 - current.u, 1 + 1e-9 - current.u});
      if (free_end) boxes.push_back({variables - 1, -1e-9 - current.z, 1 + 1e-9 - current.z});
      for (const CostBound& bound : bounds_)
        boxes.push_back({variables + bound.term, -std::numeric_limits<double>::infinity(), bound.at_samples});
      Barrier barrier(exact, scratch, boxes, variables, state.margins,
                      [&](const VectorXd& y, std::size_t lane, Motions& m) { set_lane(m, lane, point(y)); });
      barrier.set_going([this](std::uint64_t further) {
        if (still_going(further) && options_.on_step) going_ = options_.on_step();
        return going_;
      });
      state.current = point(barrier.minimise());
      evaluations_ += barrier.evaluations();
      if (problem().compliant) state.current = with_best_compliance(state.current);
      const Solution found = check(state.current);
      if (found.status == Status::kFeasible) {
        const bool enough = !(found.cost < state.least - kEnough * std::abs(state.least));
        if (found.cost < state.least) {
          state.least = found.cost;
          state.best = state.current;
        }
        if (enough || !to_the_end) return;
      } else {
        for (std::size_t i = 0; i < found.peaks.size(); ++i)
          if (const double beyond = found.peaks[i].share - 1; beyond > 0) state.margins[i] += 1.5 * std::min(beyond, 0.01);
      }
    }
  }

  /// c = centre + map · y with the first `terms` coefficients of each joint: y has the metric of ∫ Σ τ² dt, and |y| = 1 the size
  /// of the integral at the centre.
  MatrixXd coordinates(const Point& centre, std::size_t terms) {
    const std::size_t n = evaluator_.joints(), K = evaluator_.basis().redundant();
    std::vector<Index> chosen;
    for (std::size_t j = 0; j < n; ++j)
      for (std::size_t k = 0; k < std::min(terms, K); ++k) chosen.push_back(static_cast<Index>(j * K + k));
    const Index m = static_cast<Index>(chosen.size());
    MatrixXd map = MatrixXd::Zero(centre.c.size(), m);
    if (m == 0) return map;
    double size = 0;
    const MatrixXd H = metric(centre, size);
    const MatrixXd own = H(chosen, chosen);
    const auto inverse = numerics::inverse_root(own);
    if (!inverse) throw Error("optimisation", "the metric of the motion is not positive definite");
    // A motion without displacement still may move by 0.1 rad.
    const double radius = std::max(size, 0.1 * std::sqrt(own.diagonal().maxCoeff()));
    map(chosen, Eigen::all) = radius * *inverse;
    return map;
  }

  Point stage(int number, int rounds, double spread, std::size_t terms, const Point& centre) {
    const MatrixXd map = coordinates(centre, terms);
    const std::size_t all = static_cast<std::size_t>(map.rows()), d = static_cast<std::size_t>(map.cols());
    const bool free_T = problem().T_min<problem().T_max, free_end = problem().end_postures.size()> 1;
    std::vector<double> flat(all * d);
    for (std::size_t r = 0; r < all; ++r)
      for (std::size_t c = 0; c < d; ++c) flat[r * d + c] = map(static_cast<Index>(r), static_cast<Index>(c));
    const numerics::BatchMatrix decode(all, d, flat.data());
    // Coordinates: d of c, then u and z.
    std::vector<double> lower(d, -4.0), upper(d, 4.0), start(d, 0.0), width(d, spread / std::sqrt(static_cast<double>(d + 1)));
    const auto add = [&](double value) {
      lower.push_back(0);
      upper.push_back(1);
      start.push_back(value);
      width.push_back(0.5 * spread);
    };
    add(free_T ? centre.u : 1);
    add(free_end ? centre.z : 0);
    if (!free_T) lower[d] = 1, width[d] = 0;
    if (!free_end) upper[d + 1] = 0, width[d + 1] = 0;
    const double fixed_z = centre.z;
    // Then ln M, ln D and ln S of each axis of the compliant frame.
    for (std::size_t k = 0; k < centre.compliance.size(); ++k) {
      const CompliantFrame::Axis& axis = problem().compliant->axes[k];
      for (const auto part : {&ComplianceValues::M, &ComplianceValues::D, &ComplianceValues::S}) {
        lower.push_back(std::log(axis.least.*part));
        upper.push_back(std::log(axis.most.*part));
        start.push_back(std::clamp(std::log(centre.compliance[k].*part), lower.back(), upper.back()));
        width.push_back(spread * (upper.back() - lower.back()));
      }
    }
    const auto compliance_of = [&](std::size_t i, double x) {
      const CompliantFrame::Axis& axis = problem().compliant->axes[i / 3];
      const auto part = i % 3 == 0 ? &ComplianceValues::M : i % 3 == 1 ? &ComplianceValues::D : &ComplianceValues::S;
      return std::clamp(std::exp(x), axis.least.*part, axis.most.*part);
    };
    const std::size_t parameters = 3 * centre.compliance.size();

    const auto set_motions = [&](std::size_t block, const double* x, std::size_t stride) {
      Motions& m = motions_[block];
      std::vector<double>& c = decoded_[block];
      decode.times(x, stride, c.data());
      for (std::size_t i = 0; i < all; ++i)
        for (std::size_t k = 0; k < kLanes; ++k) m.c[i * kLanes + k] = c[i * kLanes + k] + centre.c[static_cast<Index>(i)];
      for (std::size_t k = 0; k < kLanes; ++k) m.T[k] = duration(x[d * stride + k]);
      if (free_end || number == 0) {
        for (std::size_t k = 0; k < kLanes; ++k) {
          const std::vector<double> q = end_of(free_end ? x[(d + 1) * stride + k] : fixed_z);
          for (std::size_t j = 0; j < q.size(); ++j) m.q_to[j * kLanes + k] = q[j];
        }
      }
      for (std::size_t i = 0; i < parameters; ++i)
        for (std::size_t k = 0; k < kLanes; ++k) m.compliance[i * kLanes + k] = compliance_of(i, x[(d + 2 + i) * stride + k]);
    };
    const auto cost = [&](std::size_t block, std::size_t count, const double* x, std::size_t stride, double* result) {
      if (judged_) {
        judged_->take(block, motions_[block], *scratch_[block], values_[block]);
      } else {
        set_motions(block, x, stride);
        evaluator_.evaluate(motions_[block], *scratch_[block], values_[block]);
      }
      for (std::size_t k = 0; k < count; ++k) result[k] = deb(values_[block], k);
    };
    numerics::SwarmOptions swarm_options;
    swarm_options.particles = options_.particles;
    swarm_options.rounds = rounds;
    swarm_options.seed = options_.seed + 0x9E3779B97F4A7C15ULL * static_cast<std::uint64_t>(number);
    swarm_options.threshold = -std::numeric_limits<double>::infinity();
    swarm_options.stagnation_rounds = 0;
    numerics::Swarm swarm(lower, upper, start, width, cost, swarm_options);
    if (judged_)
      swarm.set_together(
          [&](std::size_t block, const double* x, std::size_t stride) {
            set_motions(block, x, stride);
            if (judged_) judged_->put(block, motions_[block]);
          },
          [&] {
            if (judged_) try_device([&] { judged_->run(); });
          });
    bool more = true;
    for (int round = 0; more && going_; ++round) {
      more = swarm.round(threads_) == numerics::SwarmStatus::kRunning;
      evaluations_ += swarm.state().particles;
      for (const Values& v : values_) pruned_ += static_cast<std::uint64_t>(std::count(v.pruned.begin(), v.pruned.end(), true));
      history_.push_back(swarm.best_cost());
      if (options_.on_round) going_ = options_.on_round(particles(number, round));
      still_going();
    }
    std::vector<double> y(d + 2 + parameters);
    swarm.best(y);
    Point best = centre;
    for (std::size_t i = 0; i < all; ++i)
      for (std::size_t k = 0; k < d; ++k) best.c[static_cast<Index>(i)] += flat[i * d + k] * y[k];
    if (free_T) best.u = y[d];
    if (free_end) best.z = y[d + 1];
    for (std::size_t k = 0; k < centre.compliance.size(); ++k)
      best.compliance[k] = {compliance_of(3 * k, y[d + 2 + 3 * k]), compliance_of(3 * k + 1, y[d + 3 + 3 * k]),
                            compliance_of(3 * k + 2, y[d + 4 + 3 * k])};
    return best;
  }

  Round particles(int stage, int round) const {
    Round all{stage, round, {}};
    const std::size_t n = evaluator_.joints(), d = n * evaluator_.basis().redundant();
    for (std::size_t block = 0; block < motions_.size(); ++block)
      for (std::size_t k = 0; k < kLanes; ++k) {
        const Motions& m = motions_[block];
        const Values& v = values_[block];
        Round::Particle p;
        for (std::size_t i = 0; i < d; ++i) p.c.push_back(m.c[i * kLanes + k]);
        for (std::size_t j = 0; j < n; ++j) p.q_to.push_back(m.q_to[j * kLanes + k]);
        p.T = m.T[k];
        for (std::size_t i = 0; i < problem().costs.size(); ++i)
          p.costs.push_back(v.pruned[k] ? std::numeric_limits<double>::quiet_NaN() : v.costs[i * kLanes + k]);
        for (std::size_t i = 0; i < m.compliance.size(); i += 3 * kLanes)
          p.compliance.push_back({m.compliance[i + k], m.compliance[i + kLanes + k], m.compliance[i + 2 * kLanes + k]});
        p.kinematic = v.kinematic[k];
        p.torque = v.torque[k];
        all.particles.push_back(std::move(p));
      }
    return all;
  }

  SearchOptions options_;
  std::vector<CostBound> bounds_;
  numerics::Threads* threads_;
  Problem problem_;
  Evaluator evaluator_;
  std::unique_ptr<JudgedBlocks> judged_;
  std::vector<std::unique_ptr<Evaluator::Scratch>> scratch_;
  std::vector<Motions> motions_;
  std::vector<Values> values_;
  std::vector<std::vector<double>> decoded_;
  std::vector<double> history_;
  std::uint64_t evaluations_ = 0, pruned_ = 0;
  bool going_ = true, seeks_quickest_ = false;
  const std::chrono::steady_clock::time_point end_ = end_of_time(options_.limit);
  Point best_;
};

}  // namespace

std::vector<ComplianceValues> best_compliance(const Problem& p, std::span<const double> c, std::span<const double> q_to,
                                              double T, std::span<const ComplianceValues> start, std::uint64_t seed) {
  const CompliantFrame& frame = p.compliant.value();
  const std::size_t axes = frame.axes.size();
  Problem kinematic = p;  // the path alone
  kinematic.costs = {{Quantity::kTime, 1, {}}};
  kinematic.bounds.tau.assign(p.robot.joints.size(), std::numeric_limits<double>::infinity());
  const trajectory::Path path = assess(kinematic, c, q_to, T).path;
  constexpr std::size_t kPlaces = 1000;
  const std::size_t n = p.robot.joints.size();
  std::vector<double> q(n * kPlaces), dq(q), ddq(q), x(n), v(n), a(n);
  for (std::size_t i = 0; i < kPlaces; ++i) {
    path.at(T * static_cast<double>(i) / (kPlaces - 1), x, v, a);
    for (std::size_t j = 0; j < n; ++j) {
      q[j * kPlaces + i] = x[j];
      dq[j * kPlaces + i] = v[j];
      ddq[j * kPlaces + i] = a[j];
    }
  }
  CompliantMotion motion(p.robot, frame);
  motion.set(kPlaces, T, q.data(), dq.data(), ddq.data());
  double per_settle = 0, per_stiffness = 0;
  for (const CostTerm& term : p.costs) {
    if (term.quantity == Quantity::kCycle) per_settle += term.weight;
    if (term.quantity == Quantity::kStiffness) per_stiffness += term.weight;
  }
  if (per_settle == 0 && per_stiffness == 0) per_settle = 1;
  const auto part = [](std::size_t i) {
    return i % 3 == 0 ? &ComplianceValues::M : i % 3 == 1 ? &ComplianceValues::D : &ComplianceValues::S;
  };
  std::vector<double> lower, upper, best;
  for (std::size_t i = 0; i < 3 * axes; ++i) {
    const CompliantFrame::Axis& axis = frame.axes[i / 3];
    lower.push_back(std::log(axis.least.*part(i)));
    upper.push_back(std::log(axis.most.*part(i)));
    best.push_back(start.empty() ? 0.5 * (lower[i] + upper[i])
                                 : std::clamp(std::log(start[i / 3].*part(i)), lower[i], upper[i]));
  }
  std::vector<ComplianceValues> values(axes);
  const auto decode = [&](const double* from, std::size_t stride) {
    for (std::size_t i = 0; i < 3 * axes; ++i)
      values[i / 3].*part(i) =
          std::clamp(std::exp(from[i * stride]), frame.axes[i / 3].least.*part(i), frame.axes[i / 3].most.*part(i));
  };
  std::vector<AxisResponse> responses(axes);
  const auto cost = [&](std::size_t, std::size_t count, const double* from, std::size_t stride, double* result) {
    for (std::size_t k = 0; k < count; ++k) {
      decode(from + k, stride);
      double settle = 0, sum = 0, stiffness = 0;
      for (std::size_t i = 0; i < axes; ++i) {
        responses[i] = motion.respond(i, values[i]);
        settle = std::max(settle, responses[i].settle);
        sum += responses[i].settle;
        stiffness += values[i].S;
      }
      constexpr double kOthers = 1e-6;  // the axes that settle before the last one
      const double beyond = motion.violation(values, responses);
      result[k] = beyond > 0 ? kTorqueTier * beyond : per_settle * (settle + kOthers * sum) + per_stiffness * stiffness;
    }
  };
  constexpr int kStages = 4;
  double width = 0.3;
  for (int stage = 0; stage < kStages; ++stage, width *= 0.15) {
    numerics::SwarmOptions options;
    options.particles = 32;
    options.rounds = 40;
    options.seed = seed + static_cast<std::uint64_t>(stage);
    options.threshold = -std::numeric_limits<double>::infinity();
    options.stagnation_rounds = 0;
    std::vector<double> spread(3 * axes);
    for (std::size_t i = 0; i < spread.size(); ++i) spread[i] = width * (upper[i] - lower[i]);
    numerics::Swarm swarm(lower, upper, best, spread, cost, options);
    swarm.run();
    swarm.best(best);
  }
  decode(best.data(), 1);
  return values;
}

Solution minimise(const Problem& problem, const SearchOptions& options, numerics::Threads* threads) {
  return Search(problem, options, {}, threads).run({});
}

Solution minimise_from(const Problem& problem, const Solution& start, const SearchOptions& options,
                       numerics::Threads* threads) {
  Search search(problem, options, {}, threads);
  return search.run(search.point_of(start));
}

Solution minimise_in_order(const Problem& problem, double tolerance, const SearchOptions& options, numerics::Threads* threads) {
  if (!(tolerance >= 0)) throw Error("optimisation", "tolerance " + text::to_text(tolerance) + ", expected 0 or more");
  Problem own = problem;
  std::vector<CostBound> bounds;
  std::optional<Point> start;
  Solution solution;
  Budget budget(options);
  for (std::size_t i = 0; i < own.costs.size(); ++i) {
    for (std::size_t k = 0; k < own.costs.size(); ++k) own.costs[k].weight = k == i ? 1 : 0;
    Search search(own, budget.left(), bounds, threads);
    Solution next = search.run(start);
    budget.spend(next.evaluations);
    next.complete = next.complete && solution.complete;
    next.optima = solution.optima;
    next.optima.push_back(next.costs[i]);
    next.evaluations += solution.evaluations;
    next.pruned += solution.pruned;
    next.history.insert(next.history.begin(), solution.history.begin(), solution.history.end());
    solution = std::move(next);
    start = search.best();
    constexpr double kOfTolerance = 0.99;  // the samples of the search and those of the final check may differ a little
    const double at_samples = search.cost_at_samples(*start, i);
    bounds.push_back({i, solution.costs[i] + tolerance * std::abs(solution.costs[i]),
                      at_samples + kOfTolerance * tolerance * std::abs(at_samples)});
  }
  return solution;
}

}  // namespace cotwin::optimisation
