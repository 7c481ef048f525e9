#include <algorithm>
#include <cmath>
#include <limits>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/optimisation/search.h"

namespace cotwin::optimisation {

namespace {

constexpr const char* kRevolute[] = {"rad", "rad/s", "rad/s^2", "rad/s^3", "N m"};
constexpr const char* kPrismatic[] = {"m", "m/s", "m/s^2", "m/s^3", "N"};
constexpr const char* kNames[] = {"q", "dq", "ddq", "dddq", "tau"};

/// The peak of a range: the end that uses more of its bound.
Peak peak_of(const trajectory::Path::Range& range, double low, double high) {
  const double middle = std::isfinite(low + high) ? 0.5 * (low + high) : 0;
  const auto share = [&](double value) {
    const double bound = value > middle ? high : low;
    return !std::isfinite(bound) ? 0.0
                                 : (bound == middle ? (value == middle ? 1.0 : 2.0) : (value - middle) / (bound - middle));
  };
  const double of_max = share(range.max.value), of_min = share(range.min.value);
  const bool max = of_max != of_min ? of_max > of_min : range.max.value >= -range.min.value;
  const trajectory::Peak& at = max ? range.max : range.min;
  Peak peak;
  peak.value = at.value;
  peak.t = at.t;
  peak.limit = at.value > middle ? high : low;
  peak.share = std::max(of_max, of_min);
  return peak;
}

/// The condition of the compliant frame that is violated.
std::string reason_of(const CompliantFrame& frame, const Solution& s) {
  for (std::size_t k = 0; k < s.compliance.size(); ++k) {
    const double zeta = damping_ratio(s.compliance[k], frame.load), omega = natural_frequency(s.compliance[k], frame.load);
    const double deflection = s.responses[k].deflection;
    const std::string axis = "compliance: axis " + std::to_string(k + 1) + ": ";
    if (deflection > frame.deflection_max)
      return axis + "deflection " + text::to_text(deflection, 4) + " m, bound " + text::to_text(frame.deflection_max, 4) + " m";
    if (zeta < frame.zeta_min * (1 - 1e-9))
      return axis + "damping ratio " + text::to_text(zeta, 4) + ", bound " + text::to_text(frame.zeta_min, 4);
    if (omega > frame.omega_max * (1 + 1e-9))
      return axis + "natural frequency " + text::to_text(omega, 4) + " rad/s, bound " + text::to_text(frame.omega_max, 4) +
             " rad/s";
  }
  return "";
}

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

const char* to_text(Status status) {
  return status == Status::kFeasible ? "feasible" : status == Status::kBestEffort ? "best-effort" : "infeasible";
}

Judgement judge(const robot::RobotModel& robot, const Bounds& b, const trajectory::Path& path,
                std::span<const trajectory::Peak> torques) {
  Judgement judgement;
  judgement.worst = 1 + 1e-9;
  for (std::size_t j = 0; j < torques.size(); ++j) {
    for (int r = 0; r < 5; ++r) {
      const double high = (r == 0 ? b.q_max : r == 1 ? b.dq : r == 2 ? b.ddq : r == 3 ? b.dddq : b.tau)[j];
      Peak peak;
      if (r < 4) {
        peak = peak_of(path.range(j, r), r == 0 ? b.q_min[j] : -high, high);
      } else {
        peak.value = torques[j].value;
        peak.t = torques[j].t;
        peak.limit = std::copysign(high, peak.value);
        peak.share = std::abs(peak.value) / high;
      }
      peak.bound = kNames[r];
      peak.joint = j;
      judgement.peaks.push_back(peak);
      const bool finite = std::isfinite(peak.value) && !std::isnan(peak.share);
      if (std::isinf(judgement.worst) || (finite && peak.share <= judgement.worst)) continue;
      judgement.worst = finite ? peak.share : std::numeric_limits<double>::infinity();
      const robot::Joint& joint = robot.joints[j];
      const char* unit = (joint.type == robot::JointType::kRevolute ? kRevolute : kPrismatic)[r];
      judgement.reason = "joint " + joint.name + ": " + peak.bound + " = " + text::to_text(peak.value, 6) + " " + unit +
                         " at " + text::to_text(peak.t, 4) + " s, bound " + text::to_text(peak.limit, 6) + " " + unit;
    }
  }
  return judgement;
}

Solution assess(const Problem& problem, std::span<const double> c, std::span<const double> q_to, double T,
                std::span<const ComplianceValues> compliance) {
  Problem dense = problem;
  dense.smooth_maxima = 0;
  dense.samples = 10 * problem.samples;
  dense.torque_margin = 0;
  const Evaluator evaluator(dense);
  const std::size_t n = evaluator.joints(), K = evaluator.basis().redundant();
  if (c.size() != n * K || q_to.size() != n)
    throw Error("optimisation", std::to_string(c.size()) + " coefficients and an end of " + std::to_string(q_to.size()) +
                                    " joints, expected " + std::to_string(n * K) + " and " + std::to_string(n));
  if (!(T > 0 && std::isfinite(T))) throw Error("optimisation", "duration " + text::to_text(T) + " s, expected > 0");
  Motions motions = evaluator.motions();
  motions.count = 1;
  for (std::size_t i = 0; i < c.size(); ++i) motions.c[i * kLanes] = c[i];
  for (std::size_t j = 0; j < n; ++j) motions.q_to[j * kLanes] = q_to[j];
  motions.T[0] = T;
  if (!compliance.empty() && 3 * compliance.size() * kLanes != motions.compliance.size())
    throw Error("optimisation", "compliance of " + std::to_string(compliance.size()) + " axes, expected " +
                                    std::to_string(motions.compliance.size() / (3 * kLanes)));
  for (std::size_t k = 0; k < compliance.size(); ++k) {
    const double own[] = {compliance[k].M, compliance[k].D, compliance[k].S};
    for (std::size_t i = 0; i < 3; ++i) motions.compliance[(3 * k + i) * kLanes] = own[i];
  }
  std::vector<trajectory::Peak> torques(n);
  const auto scratch = evaluator.scratch();
  Values values = evaluator.values();
  evaluator.evaluate(motions, *scratch, values, true,
                     [&](std::size_t, std::size_t first, std::size_t count, const double* tau, const double*) {
                       for (std::size_t j = 0; j < n; ++j)
                         for (std::size_t s = 0; s < count; ++s) {
                           const double torque = tau[j * count + s];
                           if (!(std::abs(torque) < std::abs(torques[j].value))) {
                             torques[j].value = torque;
                             torques[j].t = evaluator.nodes()[first + s] * T;
                           }
                         }
                     });

  Solution solution;
  solution.T = T;
  solution.degree = problem.degree;
  solution.c.assign(c.begin(), c.end());
  solution.q_to.assign(q_to.begin(), q_to.end());
  for (std::size_t i = 0; i < dense.costs.size(); ++i) {
    solution.costs.push_back(values.costs[i * kLanes]);
    solution.cost += dense.costs[i].weight * values.costs[i * kLanes];
  }
  if (problem.compliant) {
    const auto [parameters, responses] = evaluator.compliance(*scratch);
    solution.compliance = parameters;
    solution.responses = responses;
  }
  std::vector<double> control;
  for (std::size_t j = 0; j < n; ++j) {
    const std::vector<double> own = evaluator.control_points(motions, 0, j);
    control.insert(control.end(), own.begin(), own.end());
  }
  solution.path = trajectory::Path(n, {0, T}, problem.degree, std::move(control));

  Judgement judgement = judge(problem.robot, problem.bounds, solution.path, torques);
  double worst = judgement.worst;
  solution.peaks = std::move(judgement.peaks);
  solution.reason = std::move(judgement.reason);
  if (!std::isfinite(solution.cost) && std::isfinite(worst)) {
    worst = std::numeric_limits<double>::infinity();
    solution.reason = "the cost " + text::to_text(solution.cost) + " is not finite";
  }
  if (worst <= 1 + 1e-9 && values.torque[0] > 0 && problem.compliant) {
    CompliantMotion conditions(problem.robot, *problem.compliant);
    const double beyond = conditions.violation(solution.compliance, solution.responses);
    if (beyond > 0) {
      worst = 1 + beyond;
      solution.reason = reason_of(*problem.compliant, solution);
    }
  }
  solution.status = worst <= 1 + 1e-9 ? Status::kFeasible : worst < 1.01 ? Status::kBestEffort : Status::kInfeasible;
  return solution;
}

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
