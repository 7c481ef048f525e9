#include "components/services/energy_service.h"

#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

constexpr double kJoulePerKilowattHour = 3.6e6;

energetics::RigidRobot rigid(const Robot& robot, const Move& move) {
  energetics::RigidRobot r(robot.model, move.loads);
  const auto take = [](std::vector<double>& values, const std::vector<double>& given) {
    if (!given.empty()) values = given;
  };
  take(r.B, move.drives.B);
  take(r.sigma, move.drives.sigma2);
  take(r.tau_C, move.drives.tau_C);
  take(r.tau_0, move.drives.tau_0);
  return r;
}

/// Motors and a supply without losses: the books then have mechanical work alone.
EnergyData lossless(std::size_t joints) {
  EnergyData e;
  e.losses = energetics::DriveLosses(joints);
  std::ranges::fill(e.losses.k_t, 1.0);
  for (auto* loss : {&e.losses.R, &e.losses.V_0, &e.losses.k_h, &e.losses.k_e}) std::ranges::fill(*loss, 0.0);
  return e;
}

}  // namespace

optimisation::DriveTerms drive_terms(const Robot& robot) {
  optimisation::DriveTerms d;
  if (!robot.drives) {
    const auto& joints = robot.model.joints;
    if (std::ranges::none_of(joints, [](const robot::Joint& j) { return j.damping != 0 || j.friction != 0; })) return d;
    for (const robot::Joint& joint : joints) {
      d.sigma2.push_back(joint.damping);
      d.tau_C.push_back(joint.friction);
    }
    return d;
  }
  const energetics::RigidRobot r(robot.model, *robot.drives);
  d.B = r.B;
  d.sigma2 = r.sigma;
  d.tau_C = r.tau_C;
  d.tau_0 = r.tau_0;
  return d;
}

MotionCost energy_of(const Robot& robot, const Move& move, const EnergyOptions& o) {
  MotionCost cost;
  cost.plan = plan(robot.model, move);
  const optimisation::Solution& s = cost.plan.solution;
  if (move.searched() && s.status != optimisation::Status::kFeasible)
    throw Error("energy", "no duration of the move meets the bounds (" + s.reason + "), expected T or other bounds");
  const std::size_t n = robot.model.joints.size();
  cost.with_drives = robot.energy.has_value();
  EnergyData data = cost.with_drives ? *robot.energy : lossless(n);
  if (o.price_per_kWh) data.supply.price_per_kWh = *o.price_per_kWh;
  if (o.co2_per_kWh) data.supply.co2_per_kWh = *o.co2_per_kWh;
  const energetics::RigidRobot body = rigid(robot, move);
  energetics::Accountant accountant(n, o.bus);
  accountant.losses = data.losses;
  accountant.current = data.current;
  accountant.link = data.link;
  accountant.supply = data.supply;
  constexpr std::size_t kIntervals = 1024;  // at least that many of a motion with many knots
  const std::size_t per_knot = kIntervals / (s.path.times().size() - 1) + 1;
  const energetics::MotionGrid grid{.intervals =
                                        static_cast<int>(std::min<std::size_t>(per_knot, energetics::MotionGrid{}.intervals))};
  cost.energy = energetics::energy_of_motion(body, s.path, accountant, data.standby, 1, 0, grid);
  cost.energy.t_peak += s.path.begin();
  cost.assumed = data.assumed;
  if (o.cycle > 0 && o.cycle < s.T * (1 - 1e-12))
    throw Error("cycle", text::to_text(o.cycle) + " s, expected at least the move's " + text::to_text(s.T) + " s");

  // Torques that hold the robot at the end, with what it then carries; friction does not help.
  robot::LoadedDynamics::Scratch scratch(body.dynamics);
  const auto N = static_cast<Eigen::Index>(n);
  Eigen::VectorXd hold(N);
  robot::gravity(body.dynamics.mechanism(1), scratch.data,
                 Eigen::Map<const Eigen::VectorXd>(cost.plan.problem.ends.q_to.data(), N), hold);
  const double P_hold = accountant.holding_power({hold.data(), n});
  const auto wait = [&](double T) { return energetics::wait(data.standby, P_hold, std::max(o.cycle - T, 0.0)); };
  const auto from_mains = [&](const energetics::Waiting& w, double T) {
    return w.energy / data.supply.efficiency + data.standby.controller * std::max(o.cycle - T, 0.0);
  };
  if (cost.with_drives && o.cycle > 0) {
    cost.waiting = wait(s.T);
    cost.waiting_energy = from_mains(cost.waiting, s.T);
  }
  cost.price = cost.total() / kJoulePerKilowattHour * data.supply.price_per_kWh;
  cost.co2 = cost.total() / kJoulePerKilowattHour * data.supply.co2_per_kWh;
  if (!o.best || !cost.with_drives) return cost;
  if (move.is_path() || !cost.plan.problem.ends.at_rest())
    throw Error(
        "energy",
        "the best duration is asked for of a motion that is not from rest to rest by a polynomial, expected one that is");

  Move shortest = move;
  shortest.T = 0;
  const double low = shortest_duration(robot.model, shortest);
  if (!std::isfinite(low))
    throw Error("energy", "no duration of the move meets the bounds, expected other bounds for the best one");
  double high = 10 * low;
  if (o.T_longest > 0) high = o.T_longest;
  if (o.cycle > 0) high = o.T_longest > 0 ? std::min(o.T_longest, o.cycle) : o.cycle;
  if (high < low * (1 - 1e-12))
    throw Error("energy", "the shortest duration within the bounds is " + text::to_text(low) +
                              " s, expected at least that for " + (o.cycle > 0 && high == o.cycle ? "the cycle" : "T_max") +
                              ", which is " + text::to_text(high) + " s");
  high = std::max(low, high);
  // By the books, which know converters and the link: first on a grid, then about its least value.
  const auto at = [&](double T, bool* closes = nullptr) {
    const energetics::MotionEnergy e =
        energetics::energy_of_motion(body, s.path, accountant, data.standby, T / s.T, 0, {.intervals = 16});
    if (!(o.cycle > 0)) return e.books.drawn;
    const energetics::Waiting w = wait(T);
    if (closes) *closes = w.closes;
    return e.books.drawn + from_mains(w, T);
  };
  constexpr int kPoints = 48;
  const double ratio = std::pow(high / low, 1.0 / kPoints);
  int least = 0;
  std::vector<double> T(kPoints + 1), E(kPoints + 1);
  for (int i = 0; i <= kPoints; ++i) {
    const auto k = static_cast<std::size_t>(i);
    T[k] = i == kPoints ? high : low * std::pow(ratio, i);
    E[k] = at(T[k]);
    if (E[k] < E[static_cast<std::size_t>(least)]) least = i;
  }
  double a = T[static_cast<std::size_t>(std::max(least - 1, 0))], b = T[static_cast<std::size_t>(std::min(least + 1, kPoints))];
  constexpr double kGolden = 0.6180339887498949;
  double x = b - kGolden * (b - a), y = a + kGolden * (b - a), Ex = at(x), Ey = at(y);
  while (b - a > 1e-7 * b) {
    if (Ex < Ey) {
      b = y, y = x, Ey = Ex;
      x = b - kGolden * (b - a), Ex = at(x);
    } else {
      a = x, x = y, Ex = Ey;
      y = a + kGolden * (b - a), Ey = at(y);
    }
  }
  MotionCost::Best best;
  best.T = 0.5 * (a + b);
  best.energy = at(best.T, &best.brakes_close);
  for (const double end : {low, high})
    if (const double E_end = at(end); E_end <= best.energy) best.T = end, best.energy = at(end, &best.brakes_close);
  best.at_shortest = best.T == low;
  best.at_longest = best.T == high;
  best.energy_here = cost.total();
  cost.best = best;
  return cost;
}

}  // namespace cotwin::services
