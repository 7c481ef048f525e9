#include "components/services/json/answers/answers.h"

#include <algorithm>
#include <cmath>

#include "components/services/json/clear_json.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

bool feasible(const Plan& p) { return p.solution.status == optimisation::Status::kFeasible; }

/// Series of a move per joint; `terms` of the torques, and that of a wrench.
Json series_of(const robot::RobotModel& robot, const Torques& t, bool terms, bool external) {
  const JointUnits units(robot);
  const std::size_t n = robot.joints.size();
  const auto column = [&](const std::vector<double>& rows, std::size_t j) {
    std::vector<double> own;
    for (std::size_t i = j; i < rows.size(); i += n) own.push_back(rows[i]);
    return own;
  };
  Json joints = Json::array();
  for (std::size_t j = 0; j < n; ++j) {
    const auto name = [&](const char* plain, int order) { return std::string(plain) + "_" + units.of(j, order); };
    Json own{{"joint", robot.joints[j].name},
             {name("q", 0), column(t.q, j)},
             {name("dq", 1), column(t.dq, j)},
             {name("ddq", 2), column(t.ddq, j)}};
    if (terms) {
      own[name("inertial", 4)] = column(t.inertial, j);
      own[name("coriolis", 4)] = column(t.coriolis, j);
      own[name("gravity", 4)] = column(t.gravity, j);
      own[name("drive", 4)] = column(t.drive, j);
      if (external) own[name("external", 4)] = column(t.external, j);
    }
    std::vector<double> sum;
    for (std::size_t k = j; k < t.q.size(); k += n) sum.push_back(t.torque(k));
    own[name("tau", 4)] = sum;
    joints.push_back(own);
  }
  return {{"t_s", t.t}, {"joints", joints}};
}

std::size_t read_samples(Reader& r) { return static_cast<std::size_t>(r.integer("samples", 2, 100000, 101)); }

Move at(const Move& m, double T) {
  Move timed = m;
  timed.T = T;
  return timed;
}

}  // namespace

Plan plan_of(const Robot& robot, const Move& m) {
  Plan p = plan(robot.model, m);
  if (m.searched() && !feasible(p))
    throw RequestError("",
                       "no duration of the move meets the bounds (" + p.solution.reason + "), expected T_s or other bounds");
  return p;
}

Verdict verdict_of(const optimisation::Solution& s) {
  Verdict verdict;
  verdict.add(Of::kBounds, s.status == optimisation::Status::kFeasible, s.reason);
  return verdict;
}

Json answer_feasibility(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const std::size_t samples = read_samples(r);
  std::optional<ClearOf> clear = ClearOf::read(robot, r, context, m.carried);
  if (!r.finish(context)) return {};
  const Plan p = plan(robot.model, m);
  const optimisation::Solution& s = p.solution;
  const bool none = m.searched() && !feasible(p);
  Verdict verdict = verdict_of(s);
  Json found = Json::object();
  if (clear && !none) clear->judge(s.path, found, verdict);
  Json reply;
  verdict.tell(reply);
  reply["T_s"] = none ? Json(nullptr) : Json(s.T);
  reply["limiting"] = limiting_of(robot.model, s.peaks);
  reply.update(found);
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  if (detail >= Detail::kMargins) reply["joints"] = peaks_of(robot.model, s.peaks);
  if (detail >= Detail::kSeries && !none)
    reply["series"] = series_of(robot.model, torques(robot.model, at(m, s.T), samples), false, false);
  if (detail == Detail::kAll) {
    reply["torque_squared_integral"] = p.torque();
    reply["work_J"] = p.work();
    reply["shared_work_J"] = p.shared_work();
    if (!none && !m.is_path()) reply["motion"] = motion_of(robot, m, s.T);
  }
  return reply;
}

Json answer_cycle_time(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, {.duration = false});
  const Detail detail = read_detail(r);
  const double process = r.not_negative("T_process_s", 0);
  std::optional<ClearOf> clear = ClearOf::read(robot, r, context, m.carried);
  if (!r.finish(context)) return {};
  const Plan p = plan(robot.model, m);
  Verdict verdict = verdict_of(p.solution);
  Json found = Json::object();
  if (clear && feasible(p)) clear->judge(p.solution.path, found, verdict);
  const bool possible = verdict.feasible();
  const double T = p.solution.T;
  Json reply;
  verdict.tell(reply);
  reply["T_s"] = possible ? Json(T) : Json(nullptr);
  reply["T_cycle_s"] = possible ? Json(T + process) : Json(nullptr);
  reply["moves_per_hour"] = possible && p.moves() ? Json(3600 / (T + process)) : Json(nullptr);
  reply["limiting"] = limiting_of(robot.model, p.solution.peaks);
  reply.update(found);
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  if (detail >= Detail::kMargins) reply["joints"] = peaks_of(robot.model, p.solution.peaks);
  if (detail >= Detail::kSeries && possible)
    reply["series"] = series_of(robot.model, torques(robot.model, at(m, T), 101), false, false);
  if (detail == Detail::kAll && possible) reply["motion"] = motion_of(robot, m, T);
  return reply;
}

Json answer_torques(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const std::size_t samples = read_samples(r);
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  Json reply{{"T_s", p.solution.T}};
  verdict_of(p.solution).tell(reply);
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  const JointUnits units(robot.model);
  const std::size_t n = robot.model.joints.size();
  if (detail >= Detail::kMargins) {
    const Torques t = torques_at_peaks(robot.model, at(m, p.solution.T));
    Json joints = Json::array();
    for (std::size_t j = 0; j < n; ++j) {
      const auto largest = [&](const std::vector<double>& rows) {
        double most = 0;
        for (std::size_t i = j; i < rows.size(); i += n)
          if (std::abs(rows[i]) > std::abs(most)) most = rows[i];
        return most;
      };
      const std::string unit = units.of(j, 4);
      const optimisation::Peak& peak = p.solution.peaks[j * 5 + 4];
      Json own{{"joint", robot.model.joints[j].name},
               {"tau_" + unit, peak.value},
               {"t_s", peak.t},
               {"inertial_" + unit, largest(t.inertial)},
               {"coriolis_" + unit, largest(t.coriolis)},
               {"gravity_" + unit, largest(t.gravity)},
               {"drive_" + unit, largest(t.drive)}};
      if (m.loads.wrench) own["external_" + unit] = largest(t.external);
      if (std::isfinite(peak.limit)) {
        own["limit_" + unit] = peak.limit;
        own["share"] = peak.share;
      }
      joints.push_back(own);
    }
    reply["joints"] = joints;
  }
  if (detail < Detail::kSeries) return reply;
  const Torques t = torques(robot.model, at(m, p.solution.T), samples);
  reply["series"] = series_of(robot.model, t, true, m.loads.wrench.has_value());
  if (detail == Detail::kAll) {
    reply["torque_squared_integral"] = p.torque();
    reply["series"]["power_W"] = t.power;
  }
  return reply;
}

Json answer_peak_power(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const std::size_t samples = read_samples(r);
  const double bound = r.positive("power_max_W", 0, "bound for a verdict");
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  const PeakPower peak = peak_power(robot.model, at(m, p.solution.T));
  const auto extreme = [](const PeakPower::Extreme& e) { return Json{{"power_W", e.power}, {"t_s", e.t}}; };
  Verdict verdict = verdict_of(p.solution);
  if (bound > 0)
    verdict.add(Of::kPower, peak.drawn.power <= bound * (1 + 1e-9),
                "power " + text::to_text(peak.drawn.power, 6) + " W at " + text::to_text(peak.drawn.t, 4) + " s, bound " +
                    text::to_text(bound, 6) + " W");
  Json reply{{"T_s", p.solution.T}};
  verdict.tell(reply);
  reply["drawn"] = extreme(peak.drawn);
  reply["returned"] = extreme(peak.returned);
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  if (detail >= Detail::kMargins) {
    Json joints = Json::array();
    for (std::size_t j = 0; j < robot.model.joints.size(); ++j)
      joints.push_back({{"joint", robot.model.joints[j].name},
                        {"drawn", extreme(peak.joint_drawn[j])},
                        {"returned", extreme(peak.joint_returned[j])}});
    reply["joints"] = joints;
  }
  if (detail >= Detail::kSeries) {
    const Torques t = torques(robot.model, at(m, p.solution.T), samples);
    reply["series"] = {{"t_s", t.t}, {"power_W", t.power}};
  }
  return reply;
}

Json answer_jerk(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  const optimisation::Ends ends = m.ends();
  Move quintic;
  quintic.from_q = ends.q_from, quintic.dq_from = ends.dq_from, quintic.ddq_from = ends.ddq_from;
  quintic.to_q = ends.q_to, quintic.dq_to = ends.dq_to, quintic.ddq_to = ends.ddq_to;
  quintic.T = p.solution.T;
  quintic.bounds = m.bounds;
  const Plan reference = plan(robot.model, quintic);
  // Of a quintic that stands still the integrals are rounding.
  const bool stands = ends.q_from == ends.q_to && ends.at_rest();
  const bool still = stands && !m.is_path() && std::ranges::all_of(m.c, [](double c) { return c == 0; });
  const double jerk = still ? 0 : p.jerk(), acceleration = still ? 0 : p.acceleration();
  const JointUnits units(robot.model);
  Json reply{{"T_s", p.solution.T}};
  verdict_of(p.solution).tell(reply);
  const bool turns = units.all_revolute();
  reply[turns ? "jerk_squared_integral_rad2_per_s5" : "jerk_squared_integral"] = jerk;
  reply[turns ? "acceleration_squared_integral_rad2_per_s3" : "acceleration_squared_integral"] = acceleration;
  reply["share_of_quintic"] = stands || !(reference.jerk() > 0) ? Json(nullptr) : Json(jerk / reference.jerk());
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  if (detail < Detail::kMargins) return reply;
  Json joints = Json::array();
  for (std::size_t j = 0; j < robot.model.joints.size(); ++j) {
    const optimisation::Peak &peak = p.solution.peaks[j * 5 + 3], &other = reference.solution.peaks[j * 5 + 3];
    const std::string unit = units.of(j, 3);
    Json own{{"joint", robot.model.joints[j].name},
             {"dddq_" + unit, peak.value},
             {"t_s", peak.t},
             {"quintic_dddq_" + unit, std::abs(other.value)}};
    if (std::isfinite(peak.limit)) {
      own["limit_" + unit] = peak.limit;
      own["share"] = peak.share;
    }
    joints.push_back(own);
  }
  reply["joints"] = joints;
  return reply;
}

Json answer_throughput(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, {});
  const Detail detail = read_detail(r);
  const auto list = [&](const char* name, bool required, const char* what = nullptr) {
    if (r.describes()) {
      r.declare(name, {{"type", {"number", "array"}}, {"items", schemas::kNumber}, {"minItems", 1}}, required, what);
      return std::vector<double>{1};
    }
    const Json* value = r.any(name);
    if (!value) throw RequestError(r.pointer(name), "is missing, expected a number, or one per axis of the compliance");
    if (value->is_array() && value->empty())
      throw RequestError(r.pointer(name), "is empty, expected a number, or one per axis of the compliance");
    return value->is_array() ? r.numbers(name) : std::vector<double>{r.number(name)};
  };
  const std::vector<double> M = list("M_kg", true), S = list("S_N_per_m", true);
  const bool by_share = r.any("zeta") != nullptr;
  if (by_share && r.any("D_Ns_per_m")) throw RequestError("/zeta", "is given beside D_Ns_per_m, expected one of them");
  std::vector<double> D;
  if (!by_share) D = list("D_Ns_per_m", false);
  if (by_share || r.describes()) D = list("zeta", false, "in place of D_Ns_per_m");
  r.declare_one_of({"D_Ns_per_m", "zeta"});
  const double share = r.share("settled_share", 0.02), process = r.not_negative("T_process_s", 0);
  const std::size_t axes = std::max({M.size(), S.size(), D.size()});
  for (const auto& [name, values] : {std::pair{"M_kg", &M}, {"S_N_per_m", &S}, {by_share ? "zeta" : "D_Ns_per_m", &D}})
    if (values->size() != axes && values->size() != 1)
      throw RequestError(r.pointer(name),
                         "has " + std::to_string(values->size()) + " values, expected one or " + std::to_string(axes));
  const auto of = [](const std::vector<double>& values, std::size_t k) { return values[values.size() == 1 ? 0 : k]; };
  double slowest = 0;
  std::vector<double> settle;
  for (std::size_t k = 0; k < axes; ++k) {
    const double damping = by_share ? 2 * of(D, k) * std::sqrt(of(M, k) * of(S, k)) : of(D, k);
    settle.push_back(settling_time(of(M, k), damping, of(S, k), share));
    slowest = std::max(slowest, settle.back());
  }
  if (!r.finish(context)) return {};
  const Plan p = plan_of(robot, m);
  const Throughput t = throughput(p.solution.T, slowest, process);
  const auto figure = [&](double x, bool exists = true) { return feasible(p) && exists ? Json(x) : Json(nullptr); };
  Json reply;
  verdict_of(p.solution).tell(reply);
  reply["T_move_s"] = t.T_move;
  reply["T_settle_s"] = t.T_settle;
  reply["T_process_s"] = t.T_process;
  reply["T_cycle_s"] = figure(t.T_cycle);
  reply["moves_per_hour"] = figure(t.per_hour, p.moves());
  add_notes(reply, m.notes);
  add_notes(reply, p.notes);
  if (detail >= Detail::kMargins) {
    const Throughput stiff = throughput(p.solution.T, 0, process);
    reply["axes_T_settle_s"] = settle;
    reply["stiff_moves_per_hour"] = figure(stiff.per_hour, p.moves());
    reply["lost_share"] = figure(1 - t.per_hour / stiff.per_hour, p.moves());
  }
  return reply;
}

}  // namespace cotwin::services
