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
void read_range(Reader& r, const char* name, double& least, double& most, bool required = true) {
  if (r.describes()) {
    const Json type{{"type", {"number", "array"}},
                    {"items", schemas::positive()},
                    {"exclusiveMinimum", 0},
                    {"minItems", 2},
                    {"maxItems", 2}};
    return r.declare(name, type, required, "a number, or least and most");
  }
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

optimisation::CompliantFrame::Axis read_axis(Reader& r) {
  optimisation::CompliantFrame::Axis axis;
  const std::vector<double> u = r.vector("direction", 3, false);
  if (!r.describes()) axis.u = Eigen::Vector3d(u[0], u[1], u[2]);
  if (!(axis.u.norm() > 0))
    throw RequestError(r.pointer("direction"), "expected three numbers in the axes of the base, not all 0");
  axis.u = axis.u.stableNormalized();
  read_range(r, "M_kg", axis.least.M, axis.most.M);
  read_range(r, "D_Ns_per_m", axis.least.D, axis.most.D);
  read_range(r, "S_N_per_m", axis.least.S, axis.most.S);
  r.finish();
  return axis;
}

std::vector<optimisation::CompliantFrame::Axis> read_axes(Reader& r) {
  if (r.describes())
    r.declare("axes", {{"type", "array"}, {"items", Reader::schema_of(read_axis)}, {"minItems", 1}, {"maxItems", 3}}, false,
              "searched together with the motion; M_kg, D_Ns_per_m and S_N_per_m are then those of the axes, and load_kg and "
              "settled_m are required");
  std::vector<optimisation::CompliantFrame::Axis> all;
  const Json* axes = r.any("axes");
  if (!axes) return all;
  if (!axes->is_array() || axes->empty() || axes->size() > 3)
    throw RequestError(r.pointer("axes"), "expected an array of one to three axes");
  for (std::size_t k = 0; k < axes->size(); ++k) {
    Reader one((*axes)[k], r.pointer("axes") + "/" + std::to_string(k));
    all.push_back(read_axis(one));
  }
  return all;
}

/// The member compliance: the frame with axes, or without axes the request. The schema has the members of both.
void read_members(Reader& r, const robot::RobotModel& robot, ComplianceRequest& c, optimisation::CompliantFrame& frame) {
  const bool with_axes = r.any("axes") != nullptr;
  if (!with_axes) {
    read_range(r, "M_kg", c.least.M, c.most.M, false);
    read_range(r, "D_Ns_per_m", c.least.D, c.most.D, false);
    read_range(r, "S_N_per_m", c.least.S, c.most.S, false);
  }
  frame.axes = read_axes(r);
  if (with_axes || r.describes()) {
    const std::string name = r.text("frame", "", "with axes: of the URDF; without it the end effector");
    if (!r.describes()) {
      try {
        frame.frame = name.empty() ? robot.end_effector() : robot.frame(name);
      } catch (const Error& e) {
        throw RequestError(r.pointer("frame"), e.what());
      }
    }
    const std::optional<double> required = r.describes() ? std::optional<double>(0) : std::nullopt;
    frame.load = r.positive("load_kg", required, "with axes: mass at the frame, whose inertia deflects it");
    frame.settled = r.positive("settled_m", required, "with axes: deflection that counts as settled");
    frame.deflection_max =
        r.positive("deflection_max_m", frame.deflection_max, "with axes: bound of the deflection during the motion");
  }
  c.zeta_min = frame.zeta_min = r.positive("zeta_min", 0, "least damping ratio D/(2 sqrt(M S))");
  const double omega_max = r.positive("omega_max_rad_per_s", 0, "largest natural frequency sqrt(S/M)");
  if (omega_max > 0) c.omega_max = frame.omega_max = omega_max;
  if (!with_axes) c.settled_share = r.share("settled_share", 0.02);
  c.T_process = frame.T_process = r.not_negative("T_process_s", 0);
}

}  // namespace

std::optional<ComplianceRequest> read_compliance(Reader& request, optimisation::Problem& problem) {
  ComplianceRequest c;
  optimisation::CompliantFrame frame;
  const auto read = [&](Reader& r) { read_members(r, problem.robot, c, frame); };
  if (request.describes())
    request.declare("compliance", Reader::schema_of(read), false,
                    "parameters of M x'' + D x' + S x of least settling time after the move");
  const Json* given = request.any("compliance");
  if (!given) return {};
  Reader r(*given, request.pointer("compliance"));
  read(r);
  r.finish();
  if (frame.axes.empty()) return c;
  problem.compliant = frame;
  return {};
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
