#include "models/optimisation/end_posture.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>

#include "models/optimisation/budget.h"
#include "models/support/error.h"
#include "models/support/text.h"

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
      svd_.compute(J_, Eigen::ComputeThinU | Eigen::ComputeFullV);
      const auto& sigma = svd_.singularValues();
      if (!e_.allFinite() || sigma[sigma.size() - 1] < kSingular) return false;
      if (e_.cwiseAbs().maxCoeff() < kReached) return true;
      const VectorXd change = svd_.matrixV().leftCols(sigma.size()) * (svd_.matrixU().transpose() * e_).cwiseQuotient(sigma);
      if (change.norm() > 1) return false;
      q += change;
    }
    return false;
  }
  VectorXd null() const { return svd_.matrixV().col(kinematics_.n() - 1); }

 private:
  robot::InverseKinematics& kinematics_;
  const robot::PoseTarget& target_;
  VectorXd e_;
  MatrixXd J_;
  Eigen::JacobiSVD<MatrixXd> svd_;
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

Solution minimise_to_pose(const Problem& problem, robot::InverseKinematics& kinematics, const robot::PoseTarget& target,
                          const SearchOptions& options, numerics::Threads* threads, const SelfMotionOptions& self) {
  check(problem);
  Problem own = problem;
  robot::RobotModel bounded = problem.robot;
  for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
    bounded.joints[j].q_min = problem.bounds.q_min[j];
    bounded.joints[j].q_max = problem.bounds.q_max[j];
  }
  own.end_postures = self_motion(bounded, kinematics, target, problem.ends.q_to, self);
  Tracer tracer(kinematics, target);
  VectorXd end = Eigen::Map<const VectorXd>(problem.ends.q_to.data(), kinematics.n());
  tracer.correct(end);
  Budget budget(options);
  bool complete = true;
  std::uint64_t evaluations = 0, pruned = 0;
  const auto search = [&](const Problem& p) {
    Solution s = minimise(p, budget.left(), threads);
    budget.spend(s.evaluations);
    complete = complete && s.complete;
    evaluations += s.evaluations;
    pruned += s.pruned;
    return s;
  };
  // The given end may be in the valley of a better local optimum than the one that the swarm chooses.
  Problem given = problem;
  given.end_postures.clear();
  given.ends.q_to = list(end);
  Solution best = search(given);
  if (own.end_postures.size() > 1 && complete) {
    own.ends.q_to = own.end_postures.front();
    const Solution found = search(own);
    end = Eigen::Map<const VectorXd>(found.q_to.data(), kinematics.n());
    if (!tracer.correct(end)) throw Error("self-motion", "the end between two postures does not lead to the pose");
    own.end_postures.clear();
    own.ends.q_to = list(end);
    Solution exact = assess(own, found.c, own.ends.q_to, found.T);
    exact.history = found.history;
    if (exact.status != Status::kFeasible && found.status == Status::kFeasible && complete) exact = search(own);
    const auto rank = [](const Solution& s) { return static_cast<int>(s.status); };
    if (rank(exact) < rank(best) || (rank(exact) == rank(best) && exact.cost < best.cost)) best = std::move(exact);
  }
  best.evaluations = evaluations;
  best.pruned = pruned;
  best.complete = complete;
  return best;
}

}  // namespace cotwin::optimisation
