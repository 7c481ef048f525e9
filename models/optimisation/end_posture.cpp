#include "models/optimisation/end_posture.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/dense.h"
#include "models/optimisation/budget.h"

namespace cotwin::optimisation {

namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kReached = 1e-10;  // m, rad
constexpr double kSingular = 1e-4;  // least singular value of J, m/rad
constexpr int kCorrections = 20;

class Tracer {
 public:
  Tracer(robot::InverseKinematics& kinematics, const robot::PoseTarget& target)
      : kinematics_(kinematics), target_(target), e_(kinematics.rows()), J_(kinematics.rows(), kinematics.n()) {}

  /// Moves q to the pose by the least |Δq|; false if this fails. Then `null` has the directions that keep the pose.
  bool correct(VectorXd& q) {
    for (int step = 0; step < kCorrections; ++step) {
      kinematics_.linearise(target_, q, e_, J_);
      svd_ = numerics::svd(J_);
      const VectorXd& sigma = svd_.values;
      if (!e_.allFinite() || sigma[sigma.size() - 1] < kSingular) return false;
      if (e_.cwiseAbs().maxCoeff() < kReached) return true;
      const VectorXd change =
          svd_.V.leftCols(sigma.size()) * (svd_.U.leftCols(sigma.size()).transpose() * e_).cwiseQuotient(sigma);
      if (change.norm() > 1) return false;
      q += change;
    }
    return false;
  }
  VectorXd null() const { return svd_.V.col(kinematics_.n() - 1); }

 private:
  robot::InverseKinematics& kinematics_;
  const robot::PoseTarget& target_;
  VectorXd e_;
  MatrixXd J_;
  numerics::Svd svd_;
};

std::vector<double> list(const VectorXd& q) { return {q.data(), q.data() + q.size()}; }

}  // namespace

std::vector<std::vector<double>> self_motion(const robot::RobotModel& robot, robot::InverseKinematics& kinematics,
                                             const robot::PoseTarget& target, const std::vector<double>& q,
                                             const SelfMotionOptions& options) {
  const auto fail = [](const std::string& what) { throw Error("self-motion", what); };
  const int n = kinematics.n(), free = n - kinematics.rows();
  if (q.size() != static_cast<std::size_t>(n))
    fail("a posture of " + std::to_string(q.size()) + " joints, expected " + std::to_string(n));
  if (free > 1)
    fail("has " + std::to_string(free) + " dimensions, expected at most one: prescribe more directions of the pose");
  if (!(options.step > 0 && std::isfinite(options.step)) || options.most < 1)
    fail("step " + text::to_text(options.step) + " and " + std::to_string(options.most) + " postures, expected more than 0");
  Tracer tracer(kinematics, target);
  VectorXd start = Eigen::Map<const VectorXd>(q.data(), n);
  if (!tracer.correct(start)) fail("the posture does not lead to the pose, expected one close to it");
  const auto allowed = [&](const VectorXd& x) {
    for (Index j = 0; j < n; ++j) {
      const robot::Joint& joint = robot.joints[static_cast<std::size_t>(j)];
      if (!(x[j] >= joint.q_min && x[j] <= joint.q_max)) return false;
    }
    return true;
  };
  if (!allowed(start)) fail("the posture at the pose exceeds the joint limits");
  if (free <= 0) return {list(start)};
  const VectorXd first = tracer.null();
  std::vector<std::vector<double>> all{list(start)};
  bool closed = false;
  for (const double side : {1.0, -1.0}) {
    if (closed) break;
    std::vector<std::vector<double>> branch;
    VectorXd x = start, direction = side * first;
    while (all.size() + branch.size() < options.most) {
      VectorXd next = x + options.step * direction;
      if (!tracer.correct(next) || !allowed(next) || (next - x).norm() > 2 * options.step) break;
      VectorXd turned = tracer.null();
      if (turned.dot(direction) < 0) turned = -turned;
      if (turned.dot(direction) < 0.5) break;  // another branch
      branch.push_back(list(next));
      closed = branch.size() > 2 && (next - start).norm() < 0.9 * options.step;
      if (closed) break;
      x = next;
      direction = turned;
    }
    if (side < 0) std::reverse(branch.begin(), branch.end());
    all.insert(side > 0 ? all.end() : all.begin(), branch.begin(), branch.end());
  }
  return all;
}

namespace {

/// The problems of a motion to a pose, and what their searches together have used of the options' limits.
class ToPose {
 public:
  ToPose(const Problem& problem, robot::InverseKinematics& kinematics, const robot::PoseTarget& target,
         const SelfMotionOptions& self, const SearchOptions& options)
      : tracer_(kinematics, target), given_((check(problem), problem)), budget_(options) {
    robot::RobotModel bounded = problem.robot;
    for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
      bounded.joints[j].q_min = problem.bounds.q_min[j];
      bounded.joints[j].q_max = problem.bounds.q_max[j];
    }
    postures_ = self_motion(bounded, kinematics, target, problem.ends.q_to, self);
    given_.end_postures.clear();
    given_.ends.q_to = exact(problem.ends.q_to);
  }

  /// The given end, moved to the pose.
  const Problem& given() const { return given_; }
  bool has_freedom() const { return postures_.size() > 1; }
  /// Any end on the self-motion.
  Problem free() const {
    Problem p = given_;
    p.end_postures = postures_;
    p.ends.q_to = postures_.front();
    return p;
  }
  Problem ending_at(const std::vector<double>& q_to) const {
    Problem p = given_;
    p.ends.q_to = q_to;
    return p;
  }
  /// The posture at the pose close to q.
  std::vector<double> exact(const std::vector<double>& q) {
    VectorXd end = Eigen::Map<const VectorXd>(q.data(), static_cast<Index>(q.size()));
    if (!tracer_.correct(end)) throw Error("self-motion", "the end between two postures does not lead to the pose");
    return list(end);
  }

  SearchOptions left() const { return budget_.left(); }
  const Solution& count(const Solution& s) {
    budget_.spend(s.evaluations);
    complete_ = complete_ && s.complete;
    evaluations_ += s.evaluations;
    pruned_ += s.pruned;
    return s;
  }
  bool complete() const { return complete_; }
  Solution total(Solution best) const {
    best.evaluations = evaluations_;
    best.pruned = pruned_;
    best.complete = complete_;
    return best;
  }

 private:
  Tracer tracer_;
  Problem given_;
  std::vector<std::vector<double>> postures_;
  Budget budget_;
  bool complete_ = true;
  std::uint64_t evaluations_ = 0, pruned_ = 0;
};

int rank(const Solution& s) { return static_cast<int>(s.status); }

/// Whether a keeps to the order of costs better than b: to the least optimum of each of the two within the tolerance, the first cost in
/// which only one of them does decides, else the last cost.
bool better_in_order(const Solution& a, const Solution& b, double tolerance) {
  if (rank(a) != rank(b)) return rank(a) < rank(b);
  for (std::size_t i = 0; i + 1 < std::min(a.optima.size(), b.optima.size()); ++i) {
    const double least = std::min(a.optima[i], b.optima[i]), most = least + tolerance * std::abs(least);
    if ((a.costs[i] <= most) != (b.costs[i] <= most)) return a.costs[i] <= most;
  }
  return a.cost < b.cost;
}

}  // namespace

Solution minimise_to_pose(const Problem& problem, robot::InverseKinematics& kinematics, const robot::PoseTarget& target,
                          const SearchOptions& options, numerics::Threads* threads, const SelfMotionOptions& self) {
  ToPose goal(problem, kinematics, target, self, options);
  // The given end may be in the valley of a better local optimum than the one that the swarm chooses.
  Solution best = goal.count(minimise(goal.given(), goal.left(), threads));
  const auto improved = [&](const Solution& found) {
    const Problem own = goal.ending_at(goal.exact(found.q_to));
    Solution exact = assess(own, found.c, own.ends.q_to, found.T, found.compliance);
    exact.history = found.history;
    if (exact.status != Status::kFeasible && found.status == Status::kFeasible && goal.complete())
      exact = goal.count(minimise(own, goal.left(), threads));
    const bool better = rank(exact) < rank(best) || (rank(exact) == rank(best) && exact.cost < best.cost);
    if (better) best = std::move(exact);
    return better;
  };
  if (goal.has_freedom() && goal.complete() && !improved(goal.count(minimise(goal.free(), goal.left(), threads))) &&
      goal.complete() && best.status == Status::kFeasible)
    improved(goal.count(minimise_from(goal.free(), best, goal.left(), threads)));
  return goal.total(std::move(best));
}

Solution minimise_in_order_to_pose(const Problem& problem, double tolerance, robot::InverseKinematics& kinematics,
                                   const robot::PoseTarget& target, const SearchOptions& options, numerics::Threads* threads,
                                   const SelfMotionOptions& self) {
  ToPose goal(problem, kinematics, target, self, options);
  Solution best = goal.count(minimise_in_order(goal.given(), tolerance, goal.left(), threads));
  if (goal.has_freedom() && goal.complete()) {
    const Solution found = goal.count(minimise_in_order(goal.free(), tolerance, goal.left(), threads));
    if (goal.complete()) {
      // Between two postures a motion misses the pose, and the bounds of the earlier costs leave no room to move it there.
      const Problem own = goal.ending_at(goal.exact(found.q_to));
      Solution exact = goal.count(minimise_in_order(own, tolerance, goal.left(), threads));
      if (better_in_order(exact, best, tolerance)) best = std::move(exact);
    }
  }
  return goal.total(std::move(best));
}

std::vector<Round::Particle> pareto_front_to_pose(const Problem& problem, int directions, robot::InverseKinematics& kinematics,
                                                  const robot::PoseTarget& target, const SearchOptions& options,
                                                  numerics::Threads* threads, bool* complete, const SelfMotionOptions& self) {
  ToPose goal(problem, kinematics, target, self, options);
  Archive archive;
  bool all = true;
  Solution used;
  for (const bool free : {false, true}) {
    if (free && !(goal.has_freedom() && all)) break;
    const Problem p = free ? goal.free() : goal.given();
    bool done = true;
    for (const Round::Particle& member : pareto_front(p, directions, goal.left(), threads, &done, &used.evaluations)) {
      const Solution s =
          assess(goal.given(), member.c, free ? goal.exact(member.q_to) : member.q_to, member.T, member.compliance);
      if (s.status == Status::kFeasible) archive.add({s.c, s.q_to, s.T, s.costs, 0, 0, s.compliance});
    }
    used.complete = done;
    goal.count(used);
    all = all && done;
  }
  if (complete) *complete = all;
  return archive.members();
}

}  // namespace cotwin::optimisation
