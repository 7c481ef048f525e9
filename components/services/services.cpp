#include "components/services/services.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <span>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/batch.h"
#include "models/optimisation/evaluation/quadrature.h"
#include "models/robot/drives/rigid_friction.h"
#include "models/robot/dynamics.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::services {

namespace {

using optimisation::Problem;
using optimisation::Quantity;

Problem problem_of(const robot::RobotModel& robot, const Move& move) {
  Problem p;
  p.robot = robot;
  p.ends = move.ends();
  p.loads = move.loads;
  p.degree = move.degree;
  p.drives = move.drives;
  p.bounds = optimisation::bounds_of(robot, move.bounds);
  for (const Quantity q :
       {Quantity::kTorque, Quantity::kWork, Quantity::kSharedWork, Quantity::kAcceleration, Quantity::kJerk}) {
    optimisation::CostTerm term;
    term.quantity = q;
    p.costs.push_back(term);
  }
  if (move.T != 0 && !(move.T >= kBriefest && move.T <= kLongest))
    throw Error("move", "T " + text::to_text(move.T) + " s, expected 0 or " + text::to_text(kBriefest) + " to " +
                            text::to_text(kLongest) + " s");
  if (move.searched() && !p.ends.at_rest()) throw Error("move", "begins or ends in motion without a duration, expected T");
  p.T_min = p.T_max = move.T > 0 ? move.T : 1.0;
  optimisation::check(p);
  return p;
}

std::vector<double> coefficients_of(const Problem& p, const Move& move) {
  return move.c.empty() ? std::vector<double>(p.robot.joints.size() * static_cast<std::size_t>(p.degree - 5), 0.0) : move.c;
}

/// `found`: becomes the motion, if it is possible.
bool possible(const Problem& p, const std::vector<double>& c, double T, optimisation::Solution* found = nullptr) {
  optimisation::Solution s = optimisation::assess(p, c, p.ends.q_to, T);
  const bool is = s.status == optimisation::Status::kFeasible;
  if (is && found) *found = std::move(s);
  return is;
}

/// The problem without torques, which assess() answers much sooner.
Problem without_torques(const Problem& p) {
  Problem kinematic = p;
  kinematic.bounds.tau.assign(p.robot.joints.size(), std::numeric_limits<double>::infinity());
  kinematic.costs = {{Quantity::kTime, 1, {}}};
  kinematic.samples = 8;
  return kinematic;
}

/// The largest X with |a x² + b x + c| ≤ limit for all x in [0, X]; 0 if c is outside.
double reach(double a, double b, double c, double limit) {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  if (!(std::abs(c) <= limit)) return 0;
  double least = kNever;
  for (const double end : {limit, -limit}) {
    const double rest = c - end, d = b * b - 4 * a * rest;
    if (!std::isfinite(end) || d < 0) continue;
    const double s = -0.5 * (b + std::copysign(std::sqrt(d), b));
    for (const double x : {a != 0 ? s / a : kNever, s != 0 ? rest / s : kNever}) {
      // At x = 0 on the bound: leaves it where the slope points outwards.
      if (x > 0 && x < least) least = x;
      if (rest == 0 && (end > 0 ? b > 0 || (b == 0 && a > 0) : b < 0 || (b == 0 && a < 0))) return 0;
    }
  }
  return least;
}

/// The shortest T by the torques τ = a/T² + b/T + c at the samples that assess() checks.
double shortest_by_torque(const Problem& p, const std::vector<double>& c) {
  const optimisation::Quadrature nodes = optimisation::gauss_panels(10 * ((p.samples + 7) / 8), p.loads.breaks());
  const std::size_t n = p.robot.joints.size(), count = nodes.s.size();
  const robot::LoadedDynamics dynamics(p.robot, p.loads);
  robot::LoadedDynamics::Scratch scratch(dynamics);
  constexpr std::size_t kPart = 80;  // samples whose torques are computed together
  std::vector<double> q(n * kPart), dq(q), ddq(q), all(q), rest(q), gravity(q);
  // The motion in T = 1 s is linear in both ends and the coefficients.
  const optimisation::MotionBasis basis(p.degree, true);
  const std::size_t columns = basis.columns(), K = basis.redundant();
  std::vector<double> x, tables[3];
  for (std::size_t j = 0; j < n; ++j) {
    x.insert(x.end(), {p.ends.q_from[j], p.ends.q_to[j]});
    x.insert(x.end(), c.begin() + static_cast<std::ptrdiff_t>(j * K), c.begin() + static_cast<std::ptrdiff_t>((j + 1) * K));
  }
  for (std::size_t column = 0; column < columns; ++column)
    for (const double place : nodes.s) {
      const auto values = trajectory::bernstein::evaluate(basis.points(column), place);
      for (std::size_t r = 0; r < 3; ++r) tables[r].push_back(values[r]);
    }
  const auto term = [](const std::vector<double>& values, std::size_t j) { return values.empty() ? 0.0 : values[j]; };
  double most = std::numeric_limits<double>::infinity();  // of 1/T
  for (std::size_t first = 0; first < count; first += kPart) {
    const std::size_t part = std::min(kPart, count - first);
    for (std::size_t r = 0; r < 3; ++r)
      numerics::combine(n, columns, part, x.data(), tables[r].data() + first, count, (r == 0 ? q : r == 1 ? dq : ddq).data());
    const double* const shares = nodes.s.data() + first;
    dynamics.inverse_dynamics(scratch, part, shares, q.data(), dq.data(), ddq.data(), all.data());
    dynamics.inverse_dynamics(scratch, part, shares, q.data(), rest.data(), rest.data(), gravity.data());
    for (std::size_t j = 0; j < n; ++j)
      for (std::size_t k = j * part; k < (j + 1) * part; ++k) {
        const double a = all[k] - gravity[k] + term(p.drives.B, j) * ddq[k], b = term(p.drives.sigma2, j) * dq[k];
        const double held =
            robot::rigid_friction(term(p.drives.tau_C, j), 0, term(p.drives.tau_0, j), robot::coulomb_sign(dq[k]), dq[k]);
        most = std::min(most, reach(a, b, gravity[k] + held, p.bounds.tau[j]));
      }
  }
  return 1 / most;
}

bool has_speed(const optimisation::Solution& s) {
  return std::ranges::any_of(s.peaks, [](const optimisation::Peak& peak) { return peak.bound == "dq" && peak.value != 0; });
}

/// The duration below which a bound is not met; +∞: there is none. `unlimited` becomes true if the robot moves and no bound limits the
/// duration; the result is then +∞, too. `found`: becomes the motion of the duration that was found, if that was looked at.
double shortest(const Problem& p, const std::vector<double>& c, bool* unlimited = nullptr,
                optimisation::Solution* found = nullptr) {
  constexpr double kShortest = 1e-3;  // s
  const optimisation::Solution unit = optimisation::assess(without_torques(p), c, p.ends.q_to, 1);
  double T = 0;
  const bool moves = has_speed(unit);
  for (const optimisation::Peak& peak : unit.peaks) {
    if (peak.bound == "q" && peak.share > 1 + 1e-9) return std::numeric_limits<double>::infinity();
    if (peak.bound == "dq") T = std::max(T, peak.share);
    if (peak.bound == "ddq") T = std::max(T, std::sqrt(peak.share));
    if (peak.bound == "dddq") T = std::max(T, std::cbrt(peak.share));
  }
  T = std::max(T, shortest_by_torque(p, c));
  if (moves && T == 0) {
    if (unlimited) *unlimited = true;
    return std::numeric_limits<double>::infinity();
  }
  T = std::max(T, kShortest);
  if (std::isfinite(T) && possible(p, c, T, found)) return T;
  // Rounding, and friction near rest, which the samples see at full height.
  double low = T, high = std::isfinite(T) ? T * (1 + 1e-9) : kLongest;
  while (high < kLongest && !possible(p, c, high)) low = high, high = T + 2 * (high - T);
  if (high >= kLongest && !possible(p, c, kLongest)) return std::numeric_limits<double>::infinity();
  if (!std::isfinite(low)) low = kShortest;
  while (high - low > 1e-9 * high) {
    const double middle = 0.5 * (low + high);
    (possible(p, c, middle) ? high : low) = middle;
  }
  return high;
}

/// Extreme of the parabola through (−1, a), (0, b), (1, c) with b not less than its neighbours.
std::pair<double, double> vertex(double a, double b, double c) {
  const double bend = a - 2 * b + c;
  if (!(bend < 0)) return {0, b};
  const double x = 0.5 * (a - c) / bend;
  return {x, b - 0.25 * (a - c) * x};
}

}  // namespace

optimisation::Ends Move::ends() const {
  const std::size_t n = is_path() ? path.joints() : from_q.size();
  const auto or_rest = [n](const std::vector<double>& x) { return x.empty() ? std::vector<double>(n) : x; };
  if (!is_path()) return {from_q, or_rest(dq_from), or_rest(ddq_from), to_q, or_rest(dq_to), or_rest(ddq_to)};
  optimisation::Ends ends;
  for (auto* x : {&ends.q_from, &ends.dq_from, &ends.ddq_from, &ends.q_to, &ends.dq_to, &ends.ddq_to}) x->resize(n);
  path.at(path.begin(), ends.q_from, ends.dq_from, ends.ddq_from);
  path.at(path.end(), ends.q_to, ends.dq_to, ends.ddq_to);
  return ends;
}

double shortest_duration(const robot::RobotModel& robot, const Move& move) {
  const Problem p = problem_of(robot, move);
  return shortest(p, coefficients_of(p, move));
}

bool Plan::moves() const { return has_speed(solution); }

Plan plan(const robot::RobotModel& robot, const Move& move) {
  Plan plan;
  plan.problem = problem_of(robot, move);
  if (move.is_path()) {
    plan.solution = optimisation::assess(plan.problem, move.path);
    return plan;
  }
  const std::vector<double> c = coefficients_of(plan.problem, move);
  bool unlimited = false;
  const double T = move.T > 0 ? move.T : std::min(shortest(plan.problem, c, &unlimited, &plan.solution), kLongest);
  if (plan.solution.T != T) plan.solution = optimisation::assess(plan.problem, c, plan.problem.ends.q_to, T);
  if (unlimited) {
    plan.solution.status = optimisation::Status::kInfeasible;
    plan.solution.reason = "no bound limits the duration, expected bounds of speed, acceleration, jerk or torque";
  }
  if (move.searched() && plan.solution.status == optimisation::Status::kFeasible)
    if (const std::string note = creeping(plan.problem, plan.solution); !note.empty()) plan.notes.push_back(note);
  return plan;
}

namespace {

/// At the shares `s` of the motion of `plan`.
Torques torques_at(const Plan& plan, std::span<const double> s) {
  const Problem& p = plan.problem;
  const trajectory::Path& path = plan.solution.path;
  const Eigen::Index n = p.robot.n();
  const robot::LoadedDynamics dynamics(p.robot, p.loads);
  robot::LoadedDynamics::Scratch scratch(dynamics);
  std::vector<double> q(static_cast<std::size_t>(n)), dq(q), ddq(q);
  const Eigen::Map<const Eigen::VectorXd> Q(q.data(), n), V(dq.data(), n), A(ddq.data(), n);
  Eigen::VectorXd all(n), h(n), g(n);
  Torques r;
  for (auto* x : {&r.q, &r.dq, &r.ddq, &r.inertial, &r.coriolis, &r.gravity, &r.drive, &r.external})
    x->reserve(s.size() * q.size());
  for (const double share : s) {
    r.t.push_back(path.begin() + plan.solution.T * share);
    path.at(r.t.back(), q, dq, ddq);
    const robot::Mechanism& mechanism = dynamics.mechanism(share);
    robot::inverse_dynamics(mechanism, scratch.data, Q, V, A, all);
    robot::bias(mechanism, scratch.data, Q, V, h);
    robot::gravity(mechanism, scratch.data, Q, g);
    const Eigen::VectorXd& tau_e = dynamics.wrench_torque(scratch, share, Q);
    double power = 0;
    for (Eigen::Index j = 0; j < n; ++j) {
      const std::size_t k = static_cast<std::size_t>(j);
      const double drive = optimisation::drive_torque(p.drives, k, dq[k], ddq[k]);
      r.q.push_back(q[k]);
      r.dq.push_back(dq[k]);
      r.ddq.push_back(ddq[k]);
      r.inertial.push_back(all[j] - h[j]);
      r.coriolis.push_back(h[j] - g[j]);
      r.gravity.push_back(g[j]);
      r.drive.push_back(drive);
      r.external.push_back(-tau_e[j]);
      power += (all[j] + drive - tau_e[j]) * dq[k];
    }
    r.power.push_back(power);
    if (power > r.peak_power) {
      r.peak_power = power;
      r.peak_power_t = r.t.back();
    }
  }
  return r;
}

Plan possible_plan(const robot::RobotModel& robot, const Move& move) {
  Plan p = plan(robot, move);
  if (move.searched() && p.solution.status != optimisation::Status::kFeasible)
    throw Error("torques", "no duration of the move meets the bounds, expected T or other bounds");
  return p;
}

std::vector<double> equidistant(std::size_t samples) {
  std::vector<double> s;
  for (std::size_t i = 0; i < samples; ++i) s.push_back(static_cast<double>(i) / static_cast<double>(samples - 1));
  return s;
}

}  // namespace

Torques torques(const robot::RobotModel& robot, const Move& move, std::size_t samples) {
  if (samples < 2 || samples > 1000000) throw Error("torques", std::to_string(samples) + " samples, expected 2 to 1000000");
  return torques_at(possible_plan(robot, move), equidistant(samples));
}

Torques torques_at_peaks(const robot::RobotModel& robot, const Move& move) {
  const Plan p = possible_plan(robot, move);
  return torques_at(p, optimisation::places(p.problem, p.solution.path).s);
}

PeakPower peak_power(const robot::RobotModel& robot, const Move& move) {
  const Plan p = possible_plan(robot, move);
  const std::size_t samples = std::max<std::size_t>(4001, 4 * p.solution.path.times().size());
  const std::vector<double> s = equidistant(samples), breaks = move.loads.breaks();
  const Torques t = torques_at(p, s);
  const std::size_t n = robot.joints.size();
  const auto extreme = [&](const std::vector<double>& power, double sign) {
    std::size_t at = 0;
    for (std::size_t i = 0; i < samples; ++i)
      if (sign * power[i] > sign * power[at]) at = i;
    const auto leaps = [&](double share) { return share >= s[at - 1] && share <= s[at + 1]; };
    if (at == 0 || at + 1 == samples || std::ranges::any_of(breaks, leaps)) return PeakPower::Extreme{power[at], t.t[at]};
    const auto [x, value] = vertex(sign * power[at - 1], sign * power[at], sign * power[at + 1]);
    return PeakPower::Extreme{sign * value, t.t[at] + x * (t.t[1] - t.t[0])};
  };
  PeakPower r;
  r.drawn = extreme(t.power, 1);
  r.returned = extreme(t.power, -1);
  std::vector<double> own(samples);
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = 0; i < samples; ++i) {
      const std::size_t k = i * n + j;
      own[i] = t.torque(k) * t.dq[k];
    }
    r.joint_drawn.push_back(extreme(own, 1));
    r.joint_returned.push_back(extreme(own, -1));
  }
  return r;
}

double settling_time(double M, double D, double S, double share) {
  if (!(M > 0 && D > 0 && S > 0 && share > 0 && share < 1) || !std::isfinite(M * D * S))
    throw Error("settling time", "M " + text::to_text(M) + ", D " + text::to_text(D) + ", S " + text::to_text(S) + ", share " +
                                     text::to_text(share) + ", expected M, D, S > 0 and a share between 0 and 1");
  const double omega = std::sqrt(S / M), zeta = D / (2 * std::sqrt(S * M));
  // √|ζ² − 1| without the square of a large ζ.
  const double root = zeta > 1 ? zeta * std::sqrt((1 - 1 / zeta) * (1 + 1 / zeta)) : std::sqrt((1 - zeta) * (1 + zeta));
  // Deviation from the end at x = ω t.
  const auto deviation = [&](double x) {
    if (root < 1e-7) return std::exp(-x) * (1 + x);
    if (zeta < 1) return std::exp(-zeta * x) * (std::cos(root * x) + zeta / root * std::sin(root * x));
    const double fast = zeta + root, slow = 1 / fast;  // the poles' product is 1
    return (fast * std::exp(-slow * x) - slow * std::exp(-fast * x)) / (fast - slow);
  };
  double low = 0, high = 1;
  if (zeta < 1 && root >= 1e-7) {
    // Extremes are at k π/root with the magnitude e^(−ζ k π/root); the last one outside is followed by the last crossing.
    const double last = std::floor(-std::log(share) * root / (zeta * std::numbers::pi));
    low = last * std::numbers::pi / root;
    high = low + std::numbers::pi / root;
  } else {
    while (deviation(high) > share) low = high, high *= 2;
  }
  for (int i = 0; i < 200 && high - low > 1e-15 * high; ++i) {
    const double middle = 0.5 * (low + high);
    (std::abs(deviation(middle)) > share && (zeta >= 1 || root < 1e-7 || deviation(middle) * deviation(low) > 0) ? low : high) =
        middle;
  }
  const double settled = high / omega;
  if (!std::isfinite(settled) || std::isnan(deviation(high)))
    throw Error("settling time", "damping ratio " + text::to_text(zeta) + " at " + text::to_text(omega) +
                                     " rad/s gives no finite time, expected a smaller ratio");
  return settled;
}

Throughput throughput(double T_move, double T_settle, double T_process) {
  for (const double T : {T_move, T_settle, T_process})
    if (!(T >= 0 && std::isfinite(T))) throw Error("throughput", "a time of " + text::to_text(T) + " s, expected 0 or more");
  const double cycle = T_move + T_settle + T_process;
  if (!(cycle > 0)) throw Error("throughput", "a cycle of 0 s, expected more");
  return {T_move, T_settle, T_process, cycle, 3600 / cycle};
}

}  // namespace cotwin::services
