#include "models/optimisation/reactionless/reactionless.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "models/foundation/support/error.h"
#include "models/numerics/dense.h"
#include "models/numerics/random.h"
#include "models/numerics/swarm.h"
#include "models/robot/floating_base.h"
#include "models/trajectory/bernstein.h"
#include "models/trajectory/polynomial.h"

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Eigen::VectorXd;

constexpr std::uint32_t kGrownStream = 1;
constexpr int kTerms = 8;             // of each α_j
constexpr int kSteps = 50;            // of the search
constexpr int kGridCorrections = 10;  // of the coefficients on a finer grid
constexpr double kLargest = 4;        // of a coefficient in the swarm, rad or m
constexpr double kLost = 1e-3;        // of the largest singular value: below it a direction of Z counts as lost
constexpr double kDifference = 1e-6;  // of finite differences
// Weights of residuals against the speeds in units of their limits, per rad and m: of what is left to the goal and (kLimit as much) of
// what exceeds a limit of position less a margin, for the swarm and for the last steps; of the base's turn at the end and on the way.
constexpr double kGoal = 1e3, kExactGoal = 1e5, kLimit = 0.3, kTurn = 300, kWayTurn = 10;
constexpr double kMargin = 0.01;     // rad, m
// Of the bounds of speed and acceleration, and of jerk, since differences of steps are not exact.
constexpr double kRateShare = 0.97, kJerkShare = 0.9;

/// φ_k at the times of RK4's stages: one column per half step.
MatrixXd table_of(int steps) {
  const trajectory::RedundantTerms terms(5 + kTerms);
  MatrixXd phi(kTerms, 2 * steps + 1);
  for (int i = 0; i <= 2 * steps; ++i)
    for (int k = 0; k < kTerms; ++k)
      phi(k, i) = trajectory::bernstein::evaluate(terms.term(static_cast<std::size_t>(k)), 0.5 * i / steps)[0];
  return phi;
}

/// Coefficients of motion `number` of those that are grown: r · largest · u, r uniform in [0, 1], each u in [−1, 1].
VectorXd drawn(Index columns, std::uint64_t seed, std::uint32_t number, double largest) {
  VectorXd x(columns * kTerms);
  const auto uniform = [&](Index draw) {
    return numerics::uniform({seed, kGrownStream, 0, number, static_cast<std::uint32_t>(draw)});
  };
  for (Index i = 0; i < x.size(); ++i) x[i] = uniform(x.size()) * largest * (2 * uniform(i) - 1);
  return x;
}

/// Integrates motions; one per thread.
class Integrator {
 public:
  explicit Integrator(const ReactionlessProblem& p)
      : p_(p),
        mechanism_(p.robot),
        data_(mechanism_),
        inertia_(p.robot.n()),
        start_(Eigen::Map<const VectorXd>(p.q_from.data(), p.robot.n())) {
    if (p.q_to.empty()) kinematics_ = std::make_unique<robot::InverseKinematics>(p.robot, p.frame, p.directions);
    at(start_);
    centre_ = inertia_.p_C;
  }

  /// Z at q.
  MatrixXd Z(const VectorXd& q) {
    at(q);
    return inertia_.Z();
  }
  const VectorXd& start() const { return start_; }

  /// Within null(Z), of dimension b.cols(), from the basis b at the start.
  void keep_attitude(MatrixXd b) {
    basis_ = std::move(b);
    rank_ = std::min<Index>(3, basis_.rows() - basis_.cols());
    turns_ = false;
  }
  /// With all joints.
  void allow_turn() {
    basis_ = MatrixXd::Identity(start_.size(), start_.size());
    turns_ = true;
  }

  /// The motion with the coefficients c (columns of b × kTerms); visits q, dq/ds and the base's attitude at each step.
  template <class Visit>
  void run(const VectorXd& c, const MatrixXd& phi, Visit visit) {
    const Eigen::Map<const MatrixXd> C(c.data(), basis_.cols(), kTerms);
    const Index steps = (phi.cols() - 1) / 2;
    const double h = 1.0 / static_cast<double>(steps);
    State y{start_, basis_, Eigen::Vector4d::UnitW()}, mid = y;
    for (Index k = 0;; ++k) {
      rate(y, C * phi.col(2 * k), k1_);
      visit(k, y.q, k1_.q, Quaterniond(y.Q));
      if (k == steps) break;
      const VectorXd middle = C * phi.col(2 * k + 1);
      moved(y, 0.5 * h, k1_, mid);
      rate(mid, middle, k2_);
      moved(y, 0.5 * h, k2_, mid);
      rate(mid, middle, k3_);
      moved(y, h, k3_, mid);
      rate(mid, C * phi.col(2 * k + 2), k4_);
      moved(y, h / 6, k1_, y);
      moved(y, h / 3, k2_, y);
      moved(y, h / 3, k3_, y);
      moved(y, h / 6, k4_, y);
      y.Q.normalize();
    }
  }

  /// What is left to the goal: a posture, or of a pose positions, then twice the vector part of the rotation's quaternion.
  VectorXd left(const VectorXd& q, const Quaterniond& Q) {
    if (!kinematics_) return Eigen::Map<const VectorXd>(p_.q_to.data(), start_.size()) - q;
    at(q);
    const Vector3d p_B = centre_ - Q * inertia_.p_C;
    const robot::PoseTarget seen{Q.conjugate() * (p_.target.p - p_B), Q.conjugate() * p_.target.Q};
    VectorXd e(kinematics_->rows());
    MatrixXd J(kinematics_->rows(), start_.size());
    kinematics_->linearise(seen, q, e, J);
    return e;
  }

 private:
  struct State {
    VectorXd q;
    MatrixXd b;
    Eigen::Vector4d Q;  // x, y, z, w
  };

  void at(const VectorXd& q) { robot::floating_inertia(mechanism_, data_, q, inertia_); }

  /// y + h k.
  void moved(const State& y, double h, const State& k, State& to) {
    to.q = y.q + h * k.q;
    if (turns_)
      to.Q = y.Q + h * k.Q;
    else
      to.b = y.b + h * k.b;
  }

  /// An orthonormal basis of the rows of Z at q.
  void row_space(const VectorXd& q, Eigen::MatrixX3d& V) {
    at(q);
    V = inertia_.Z().transpose();
    for (Index i = 0; i < rank_; ++i) {
      Index largest = 0;
      V.rightCols(3 - i).colwise().squaredNorm().maxCoeff(&largest);
      if (largest > 0) V.col(i).swap(V.col(i + largest));
      for (Index j = 0; j < i; ++j) V.col(i) -= V.col(j).dot(V.col(i)) * V.col(j);  // once more, for rounding
      V.col(i).normalize();
      for (Index j = i + 1; j < 3; ++j) V.col(j) -= V.col(i).dot(V.col(j)) * V.col(i);
    }
  }
  template <class X>
  X projected(const Eigen::MatrixX3d& V, const X& x) const {
    return x - V.leftCols(rank_) * (V.leftCols(rank_).transpose() * x);
  }

  void rate(const State& y, const VectorXd& alpha, State& k) {
    k.q = y.b * alpha;
    if (turns_) {
      at(y.q);
      const Vector3d w = inertia_.Z() * k.q;
      k.Q = 0.5 * (Quaterniond(y.Q) * Quaterniond(0, w.x(), w.y(), w.z())).coeffs();
      return;
    }
    row_space(y.q, V_);
    k.q = projected(V_, k.q);
    const double length = k.q.norm();
    k.b.setZero(y.b.rows(), y.b.cols());
    if (length == 0) return;
    row_space(y.q + kDifference / length * k.q, ahead_);
    const MatrixXd b = projected(V_, y.b);
    k.b = (length / kDifference) * (projected(ahead_, b) - b);
  }

  const ReactionlessProblem& p_;
  robot::FloatingMechanism mechanism_;
  robot::FloatingData data_;
  robot::FloatingInertia inertia_;
  std::unique_ptr<robot::InverseKinematics> kinematics_;
  VectorXd start_;
  Vector3d centre_;  // of mass in B0
  MatrixXd basis_;
  Index rank_ = 3;
  bool turns_ = false;
  Eigen::MatrixX3d V_, ahead_;
  State k1_, k2_, k3_, k4_;
};

}  // namespace

struct ReactionlessMotion::Impl {
  Impl(const ReactionlessProblem& problem, const ReactionlessOptions& o, numerics::Threads* t)
      : p(problem), options(o), threads(t), n(p.robot.n()), coarse(table_of(kSteps)) {
    for (const auto* x : {&p.q_from, &p.q_min, &p.q_max, &p.dq_max, &p.ddq_max, &p.dddq_max, &p.q_to}) {
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

  /// Chooses null(Z), or returns false with the obstacle.
  bool keep_attitude() {
    Integrator& first = *integrators.front();
    const auto rank_at = [&](const VectorXd& q, double threshold) {
      const VectorXd s = numerics::singular_values(first.Z(q));
      return static_cast<Index>((s.array() > threshold * s.maxCoeff()).count());
    };
    Index rank = 0;  // that of nearly all postures
    for (std::uint32_t k = 0; k < 8; ++k) {
      VectorXd q = first.start();
      for (Index j = 0; j < n; ++j)
        q[j] += numerics::uniform({.seed = 1, .particle = k, .draw = static_cast<std::uint32_t>(j)}) - 0.5;
      rank = std::max(rank, rank_at(q, 1e-9));
    }
    columns = n - rank;
    if (columns == 0) {
      obstacle = n == 1 ? "the robot has one joint, which turns the base"
                        : "every motion of the robot's " + std::to_string(n) + " joints turns the base";
      return false;
    }
    if (rank_at(first.start(), kLost) < rank) {
      obstacle = "the first posture is singular: its joints turn the base about " +
                 std::to_string(rank_at(first.start(), kLost)) + " axes, those of its neighbours about " + std::to_string(rank);
      return false;
    }
    const MatrixXd basis = numerics::svd(first.Z(first.start())).V.rightCols(columns);
    for (auto& i : integrators) i->keep_attitude(basis);
    return true;
  }

  /// The coefficients of those of many grown motions that end nearest to the goal.
  std::vector<VectorXd> nearest_grown() const {
    constexpr std::size_t kGrown = 2048, kKept = 6;
    std::vector<std::pair<double, std::uint32_t>> all(kGrown);
    run(integrators.size(), [&](std::size_t worker) {
      VectorXd r;
      for (std::size_t k = worker; k < kGrown; k += integrators.size()) {
        const auto number = static_cast<std::uint32_t>(k);
        residuals(*integrators[worker], drawn(columns, options.seed, number, kLargest), kGoal, r);
        all[k] = {r.squaredNorm(), number};
      }
    });
    std::ranges::partial_sort(all, all.begin() + kKept);
    std::vector<VectorXd> nearest;
    for (std::size_t k = 0; k < kKept; ++k) nearest.push_back(drawn(columns, options.seed, all[k].second, kLargest));
    return nearest;
  }
  void run(std::size_t blocks, const std::function<void(std::size_t)>& work) const {
    if (threads)
      threads->run(blocks, work);
    else
      for (std::size_t block = 0; block < blocks; ++block) work(block);
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
    std::optional<VectorXd> too_fast;  // reaches the goal, but not in the time T
    const auto reaches = [&](VectorXd x) {
      improve(x, kGoal);
      const double found = improve(x, kExactGoal);
      if (!(found < best)) return false;
      best = found;
      c = x;
      (void)sampled(coarse);
      if (!reached() || !within) return false;
      if (keeps_rates()) return true;
      too_fast = c;
      return false;
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
    if (too_fast) {
      c = *too_fast;
      (void)sampled(coarse);
      return true;
    }
    if (!turns)
      obstacle =
          std::string("no motion without reaction was found ") + (reached() ? "within the limits of position" : "to the goal");
    return false;
  }
  /// Whether speed, acceleration and jerk keep their bounds in the time T.
  bool keeps_rates() const {
    if (p.T == 0) return true;
    VectorXd r;
    residuals(*integrators.front(), c, 1, r);
    return r.tail(n * (kSteps + 1)).maxCoeff() <= kLimit * (1 - kRateShare);
  }
  bool reached() const { return std::max(distance, angle) <= 1e-6; }

  /// All residuals of a motion; the first `goals` are those of the goal.
  void residuals(Integrator& i, const VectorXd& x, double goal_weight, VectorXd& r) const {
    const Index row = n * (kSteps + 1), of_turn = turns ? 3 * (kSteps + 1) : 0;
    const double mean = 1 / std::sqrt(static_cast<double>(kSteps));
    r.resize(goals + 2 * row + of_turn + (p.T > 0 ? row : 0));
    MatrixXd rates(n, p.T > 0 ? kSteps + 1 : 0);
    i.run(x, coarse, [&](Index k, const VectorXd& q, const VectorXd& dq, const Quaterniond& Q) {
      for (Index j = 0; j < n; ++j) {
        const auto joint = static_cast<std::size_t>(j);
        const double speed = std::isfinite(p.dq_max[joint]) ? p.dq_max[joint] : 1;
        r[goals + k * n + j] =
            kLimit * goal_weight * std::max({p.q_min[joint] + kMargin - q[j], q[j] - p.q_max[joint] + kMargin, 0.0});
        r[goals + row + k * n + j] = mean * dq[j] / speed;
      }
      if (p.T > 0) rates.col(k) = dq;
      if (turns)
        r.segment<3>(goals + 2 * row + 3 * k) = (k == kSteps ? kTurn : kWayTurn * mean) * 2 * (Q.w() < 0 ? -1 : 1) * Q.vec();
      if (k == kSteps) r.head(goals) = goal_weight * i.left(q, Q);
    });
    if (p.T > 0) r.tail(row) = kLimit * goal_weight * excess(rates).reshaped();
    if (!r.allFinite()) r.setConstant(1e9);
  }

  /// By how much speed, acceleration or jerk exceeds its bound in the time T, relative, of each joint at each step, from dq/ds.
  MatrixXd excess(const MatrixXd& rates) const {
    MatrixXd beyond = MatrixXd::Zero(n, kSteps + 1);
    for (Index k = 1; k < kSteps; ++k)
      for (Index j = 0; j < n; ++j) {
        const auto joint = static_cast<std::size_t>(j);
        const double before = rates(j, k - 1), now = rates(j, k), after = rates(j, k + 1), h = p.T / kSteps;
        beyond(j, k) = std::max({std::abs(now) / p.T / p.dq_max[joint] - kRateShare,
                                 std::abs(after - before) / (2 * h * p.T) / p.ddq_max[joint] - kRateShare,
                                 std::abs(after - 2 * now + before) / (h * h * p.T) / p.dddq_max[joint] - kJerkShare, 0.0});
      }
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
    run(integrators.size(), columns_of);
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
        for (std::size_t j = 0; j < p.q_min.size(); ++j) {
          const double x = at[static_cast<Index>(j)];
          within = within && x >= p.q_min[j] && x <= p.q_max[j];
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
  numerics::Threads* threads;
  Index n, goals = 0, columns = 0;
  bool turns = false, within = false;
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
