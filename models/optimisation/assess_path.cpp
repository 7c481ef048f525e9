#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/optimisation/search.h"

namespace cotwin::optimisation {

namespace {

/// What the costs of a motion are made of: integrals over its shares.
struct Integrals {
  double torque = 0, work = 0, shared_work = 0, acceleration = 0, jerk = 0;
  double of(Quantity quantity) const {
    switch (quantity) {
      case Quantity::kTime:
        return 1;
      case Quantity::kTorque:
        return torque;
      case Quantity::kWork:
        return work;
      case Quantity::kSharedWork:
        return shared_work;
      case Quantity::kAcceleration:
        return acceleration;
      case Quantity::kJerk:
        return jerk;
      default:
        throw Error("optimisation",
                    std::string("the cost '") + to_text(quantity) + "' is given for a path, expected a polynomial");
    }
  }
};

}  // namespace

Quadrature places(const Problem& problem, const trajectory::Path& path) {
  std::vector<double> cuts = problem.loads.breaks();
  const double T = path.end() - path.begin();
  for (const double t : path.times()) cuts.push_back((t - path.begin()) / T);
  std::erase_if(cuts, [](double s) { return !(s > 0 && s < 1); });
  std::ranges::sort(cuts);
  cuts.erase(std::unique(cuts.begin(), cuts.end()), cuts.end());
  return gauss_panels(10 * ((problem.samples + 7) / 8), cuts);
}

Solution assess(const Problem& problem, const trajectory::Path& path) {
  check(problem);
  const Quadrature nodes = places(problem, path);
  const std::size_t n = path.joints();
  constexpr std::size_t kPart = 64;
  std::vector<double> q(n), dq(n), ddq(n), dddq(n);
  std::vector<double> Q(n * kPart), V(Q), A(Q), tau(Q);
  const robot::LoadedDynamics dynamics(problem.robot, problem.loads);
  robot::LoadedDynamics::Scratch scratch(dynamics);
  Solution solution;
  solution.T = path.end() - path.begin();
  solution.path = path;
  std::vector<trajectory::Peak> torques(n);
  Integrals sum;
  for (std::size_t first = 0; first < nodes.s.size(); first += kPart) {
    const std::size_t count = std::min(kPart, nodes.s.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      path.at(path.begin() + nodes.s[first + i] * solution.T, q, dq, ddq, dddq);
      for (std::size_t j = 0; j < n; ++j) {
        Q[j * count + i] = q[j];
        V[j * count + i] = dq[j];
        A[j * count + i] = ddq[j];
        sum.acceleration += nodes.w[first + i] * ddq[j] * ddq[j];
        sum.jerk += nodes.w[first + i] * dddq[j] * dddq[j];
      }
    }
    dynamics.inverse_dynamics(scratch, count, nodes.s.data() + first, Q.data(), V.data(), A.data(), tau.data());
    for (std::size_t i = 0; i < count; ++i) {
      const double w = nodes.w[first + i];
      double power = 0;
      for (std::size_t j = 0; j < n; ++j) {
        const std::size_t at = j * count + i;
        const double torque = tau[at] + drive_torque(problem.drives, j, V[at], A[at]);
        if (!(std::abs(torque) < std::abs(torques[j].value)))
          torques[j] = {torque, path.begin() + nodes.s[first + i] * solution.T};
        sum.torque += w * torque * torque;
        sum.work += w * std::max(torque * V[at], 0.0);
        power += torque * V[at];
      }
      sum.shared_work += w * std::max(power, 0.0);
    }
  }
  for (const CostTerm& term : problem.costs) {
    solution.costs.push_back(solution.T * sum.of(term.quantity));
    solution.cost += term.weight * solution.costs.back();
  }
  Judgement judgement = judge(problem.robot, problem.bounds, path, torques);
  solution.peaks = std::move(judgement.peaks);
  solution.reason = std::move(judgement.reason);
  solution.q_to = problem.ends.q_to;
  solution.status = solution.reason.empty()  ? Status::kFeasible
                    : judgement.worst < 1.01 ? Status::kBestEffort
                                             : Status::kInfeasible;
  return solution;
}

}  // namespace cotwin::optimisation
