#include "components/services/json/compliance_json.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "components/services/services.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

using optimisation::ComplianceValues;

/// A number, or [least, most].
void read_range(Reader& r, const char* name, double& least, double& most) {
  const Json* given = r.any(name);
  if (!given) throw RequestError(r.pointer(name), "is missing, expected a number or [least, most]");
  const std::vector<double> range = given->is_array() ? r.numbers(name) : std::vector<double>(2, r.number(name));
  if (range.size() != 2)
    throw RequestError(r.pointer(name), "has " + std::to_string(range.size()) + " values, expected a number or [least, most]");
  if (!(range[0] > 0 && range[0] <= range[1]))
    throw RequestError(r.pointer(name), "is " + given->dump() + ", expected 0 < least <= most");
  least = range[0];
  most = range[1];
}

double zeta_of(const ComplianceValues& v) { return v.D / (2 * std::sqrt(v.M * v.S)); }
double omega_of(const ComplianceValues& v) { return std::sqrt(v.S / v.M); }

/// By how much the conditions are missed, relative; 0 or less: met.
double violation(const ComplianceRequest& request, const ComplianceValues& v) {
  constexpr double kRounding = 1e-9;
  double beyond = 0;
  if (request.zeta_min > 0) beyond += std::max(0.0, 1 - zeta_of(v) / request.zeta_min - kRounding);
  if (request.omega_max > 0) beyond += std::max(0.0, omega_of(v) / request.omega_max - 1 - kRounding);
  return beyond;
}

/// With the member "axes".
optimisation::CompliantFrame read_frame(Reader& r, const robot::RobotModel& robot) {
  optimisation::CompliantFrame frame;
  const std::string name = r.text("frame", "");
  try {
    frame.frame = name.empty() ? robot.end_effector() : robot.frame(name);
  } catch (const Error& e) {
    throw RequestError(r.pointer("frame"), e.what());
  }
  const Json& axes = *r.any("axes");
  if (!axes.is_array() || axes.empty() || axes.size() > 3)
    throw RequestError(r.pointer("axes"), "expected an array of one to three axes");
  for (std::size_t k = 0; k < axes.size(); ++k) {
    Reader one(axes[k], r.pointer("axes") + "/" + std::to_string(k));
    optimisation::CompliantFrame::Axis axis;
    const std::vector<double> u = one.numbers("direction");
    if (u.size() != 3 || !(Eigen::Vector3d(u[0], u[1], u[2]).norm() > 0))
      throw RequestError(one.pointer("direction"), "expected three numbers in the axes of the base, not all 0");
    axis.u = Eigen::Vector3d(u[0], u[1], u[2]).stableNormalized();
    read_range(one, "M_kg", axis.least.M, axis.most.M);
    read_range(one, "D_Ns_per_m", axis.least.D, axis.most.D);
    read_range(one, "S_N_per_m", axis.least.S, axis.most.S);
    one.finish();
    frame.axes.push_back(axis);
  }
  frame.load = r.positive("load_kg");
  frame.settled = r.positive("settled_m");
  if (r.has("deflection_max_m")) frame.deflection_max = r.positive("deflection_max_m");
  if (r.has("zeta_min")) frame.zeta_min = r.positive("zeta_min");
  if (r.has("omega_max_rad_per_s")) frame.omega_max = r.positive("omega_max_rad_per_s");
  frame.T_process = r.number("T_process_s", 0);
  if (frame.T_process < 0) throw RequestError(r.pointer("T_process_s"), "is negative, expected 0 or more");
  r.finish();
  return frame;
}

}  // namespace

std::optional<ComplianceRequest> read_compliance(Reader& request, optimisation::Problem& problem) {
  const Json* given = request.any("compliance");
  if (!given) return {};
  Reader r(*given, request.pointer("compliance"));
  if (r.any("axes")) {
    problem.compliant = read_frame(r, problem.robot);
    return {};
  }
  ComplianceRequest c;
  read_range(r, "M_kg", c.least.M, c.most.M);
  read_range(r, "D_Ns_per_m", c.least.D, c.most.D);
  read_range(r, "S_N_per_m", c.least.S, c.most.S);
  if (r.has("zeta_min")) c.zeta_min = r.positive("zeta_min");
  if (r.has("omega_max_rad_per_s")) c.omega_max = r.positive("omega_max_rad_per_s");
  c.settled_share = r.positive("settled_share", 0.02);
  if (c.settled_share >= 1) throw RequestError(r.pointer("settled_share"), "is 1 or more, expected less than 1");
  c.T_process = r.number("T_process_s", 0);
  if (c.T_process < 0) throw RequestError(r.pointer("T_process_s"), "is negative, expected 0 or more");
  r.finish();
  return c;
}

Json compliance_json(const ComplianceRequest& request, double T_move, std::uint64_t seed) {
  optimisation::ComplianceProblem problem;
  problem.least = request.least;
  problem.most = request.most;
  problem.seed = seed;
  problem.cost = [&](const ComplianceValues& v) {
    try {
      return settling_time(v.M, v.D, v.S, request.settled_share);
    } catch (const Error&) {  // a damping ratio for which it is not finite
      return std::numeric_limits<double>::quiet_NaN();
    }
  };
  problem.violation = [&](const ComplianceValues& v) { return violation(request, v); };
  const optimisation::ComplianceSolution s = optimisation::minimise_compliance(problem);
  const bool feasible = s.feasible && std::isfinite(s.cost);
  const auto figure = [&](double x) { return feasible ? Json(x) : Json(nullptr); };
  std::string reason;
  if (!feasible)
    reason = "no parameters within the ranges meet the conditions; the closest ones have the damping ratio " +
             text::to_text(zeta_of(s.values), 4) + " and the natural frequency " + text::to_text(omega_of(s.values), 4) +
             " rad/s";
  const double T_cycle = T_move + s.cost + request.T_process;
  return {{"feasible", feasible},
          {"reason", reason},
          {"M_kg", figure(s.values.M)},
          {"D_Ns_per_m", figure(s.values.D)},
          {"S_N_per_m", figure(s.values.S)},
          {"zeta", figure(zeta_of(s.values))},
          {"omega_rad_per_s", figure(omega_of(s.values))},
          {"T_settle_s", figure(s.cost)},
          {"T_cycle_s", figure(T_cycle)},
          {"moves_per_hour", figure(3600 / T_cycle)}};
}

Json axes_json(const optimisation::Problem& problem, const std::vector<ComplianceValues>& values) {
  Json axes = Json::array();
  for (std::size_t k = 0; k < values.size(); ++k) {
    const Eigen::Vector3d& u = problem.compliant->axes[k].u;
    axes.push_back(
        {{"direction", {u.x(), u.y(), u.z()}}, {"M_kg", values[k].M}, {"D_Ns_per_m", values[k].D}, {"S_N_per_m", values[k].S}});
  }
  return axes;
}

Json compliance_json(const optimisation::Problem& problem, const optimisation::Solution& found) {
  const bool feasible = !found.reason.starts_with("compliance:");
  Json reply{{"feasible", feasible}, {"reason", feasible ? "" : found.reason}};
  const auto figure = [&](double x) { return feasible ? Json(x) : Json(nullptr); };
  Json axes = axes_json(problem, found.compliance);
  double settle = 0;
  for (std::size_t k = 0; k < axes.size(); ++k) {
    const auto& [T_settle, deflection] = found.responses[k];
    settle = std::max(settle, T_settle);
    axes[k]["zeta"] = optimisation::damping_ratio(found.compliance[k], problem.compliant->load);
    axes[k]["omega_rad_per_s"] = optimisation::natural_frequency(found.compliance[k], problem.compliant->load);
    axes[k]["T_settle_s"] = T_settle;
    axes[k]["deflection_m"] = deflection;
  }
  const double T_cycle = found.T + settle + problem.compliant->T_process;
  reply["axes"] = feasible ? axes : Json::array();
  reply["T_settle_s"] = figure(settle);
  reply["T_cycle_s"] = figure(T_cycle);
  reply["moves_per_hour"] = figure(3600 / T_cycle);
  return reply;
}

}  // namespace cotwin::services
