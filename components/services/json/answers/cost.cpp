#include <algorithm>
#include <cmath>
#include <numeric>

#include "components/services/assumptions.h"
#include "components/services/energy_service.h"
#include "components/services/json/answers/answers.h"
#include "components/services/json/contact_json.h"
#include "models/foundation/support/text.h"

namespace cotwin::services {

namespace {

/// +∞ has no number in JSON: null.
Json finite(double x) { return std::isinf(x) ? Json(nullptr) : Json(x); }

Json all_finite(const std::vector<double>& values) {
  Json all = Json::array();
  for (const double x : values) all.push_back(finite(x));
  return all;
}

double sum(const std::vector<double>& x) { return std::accumulate(x.begin(), x.end(), 0.0); }

EnergyOptions read_energy_options(Reader& r) {
  EnergyOptions o;
  o.bus = read_bus(r, "DC link: shared, split (none), or regenerating (grid)");
  o.cycle = r.duration("cycle_s", 0, "time for the move and the wait after it");
  for (auto [name, rate] : {std::pair{"price_per_kWh", &o.price_per_kWh}, {"co2_kg_per_kWh", &o.co2_per_kWh}})
    if (r.has(name)) *rate = r.not_negative(name, 0);
  o.best = r.boolean("best", false, "also the duration of least energy");
  o.T_longest = r.duration("T_max_s", 0, "longest duration for that");
  return o;
}

ContactOptions read_contact_options(const Robot& robot, Reader& r) {
  ContactOptions o = read_contact_frame(robot, r, "of the URDF; without it the end effector",
                                        "in the axes of the base; without it along the velocity of the frame",
                                        "free: a blow; held: slower motions, the motors' inertias count");
  o.samples = static_cast<std::size_t>(r.integer("samples", 2, 100000, 401));
  return o;
}

/// The move with its duration, and the plan's verdict, also as the first members of the reply. An error where no duration is possible.
Move planned(const Robot& robot, const MoveRequest& request, Json& reply, Verdict& verdict) {
  Move m = request;
  const Plan p = plan(robot.model, m);
  const optimisation::Solution& s = p.solution;
  verdict = verdict_of(s);
  if (m.searched() && !verdict.feasible())
    throw RequestError("", "no duration of the move can be given (" + s.reason + "), expected T_s or other bounds");
  m.T = s.T;
  verdict.tell(reply);
  add_notes(reply, request.notes);
  add_notes(reply, p.notes);
  return m;
}

Json place(const MassAt& at) { return {{"mass_kg", finite(at.mass)}, {"speed_m_per_s", at.speed}, {"t_s", at.t}}; }

Json series_of(const PathMasses& m) {
  return {{"t_s", m.t}, {"mass_kg", all_finite(m.mass)}, {"inertia_kgm2", all_finite(m.inertia)}, {"speed_m_per_s", m.speed}};
}

Json risk_json(const MassRisk& m) {
  return {
      {"share", finite(m.share)},         {"t_s", m.t},           {"speed_m_per_s", m.speed}, {"mass_kg", finite(m.mass)},
      {"limit_m_per_s", finite(m.limit)}, {"energy_J", m.energy}, {"energy_t_s", m.t_energy}, {"T_safe_s", finite(m.T_safe)}};
}

/// "0.9 m/s at chest, limit 2.2 m/s by the effective mass of 0.6 kg, 0.5 m/s by M/2 + load = 14.5 kg (ISO/TS 15066, A.3.4)"
std::string too_fast(const PartRisk& p) {
  const auto number = [](double x) { return text::to_text(x, 3); };
  return number(p.decisive.speed) + " m/s at " + p.name + ", limit " + number(p.effective.limit) +
         " m/s by the effective mass of " + number(p.effective.mass) + " kg, " + number(p.simple.limit) +
         " m/s by M/2 + load = " + number(p.simple.mass) + " kg (ISO/TS 15066, A.3.4)";
}

const PartRisk& worst_of(const PathSafety& s) {
  return *std::ranges::max_element(s.parts, {}, [](const PartRisk& p) { return p.decisive.share; });
}

}  // namespace

void judge_persons(const Robot& robot, const PathSafety& s, Verdict& verdict) {
  const PartRisk& worst = worst_of(s);
  const MassRisk& m = worst.decisive;
  const auto number = [](double x) { return text::to_text(x, 3); };
  const std::string unknown = unknown_motors(robot);
  if (s.safe && unknown.empty()) return verdict.add(Of::kPersons, Says::kYes);
  if (s.safe) return verdict.add(Of::kPersons, Says::kUnknown, "slow enough beside a person as far as is known: " + unknown);
  const std::string at = "the " + words_of_part(worst.name);
  if (!(m.limit > 0))
    return verdict.add(Of::kPersons, Says::kNo,
                       "not slow enough beside a person at any speed: contact with " + at + " is not permitted");
  const std::string other = std::isfinite(m.T_safe) ? ", the limits ask for " + number(m.T_safe) + " s" : "";
  verdict.add(Of::kPersons, Says::kNo,
              "not slow enough beside a person" + other + ": " + number(m.speed) + " m/s at " + at + ", " + number(m.limit) +
                  " allowed");
}

void add_safety(const Robot& robot, const Move& m, const ContactOptions& o, const PathSafety& s, Json& reply,
                Verdict& verdict) {
  judge_persons(robot, s, verdict);
  double load = o.load;
  for (const robot::Payload& payload : m.loads.payloads) load += payload.part.inertia.mass;
  const PartRisk& worst = worst_of(s);
  const std::string unknown = unknown_motors(robot);
  reply.update(Json{{"safe", unknown.empty() ? Json(s.safe) : Json(nullptr)},
                    {"safe_reason", unknown.empty() && s.safe ? "" : too_fast(worst) + (unknown.empty() ? "" : ": " + unknown)},
                    {"T_s", s.T},
                    {"T_safe_s", finite(worst.decisive.T_safe)},
                    {"worst_part", worst.name},
                    {"mass", o.only_effective ? "effective" : "larger"},
                    {"load_kg", load},
                    {"effective", risk_json(worst.effective)},
                    {"iso_ts_15066", risk_json(worst.simple)}});
}

Json answer_energy(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const EnergyOptions options = read_energy_options(r);
  for (const char* name : {"bus", "price_per_kWh", "co2_kg_per_kWh"})
    r.only_if(robot.energy.has_value(), name, "an energy.ssv beside the URDF");
  r.only_if(options.best, "T_max_s", "best");
  if (!r.finish(context)) return {};
  if (options.best && (m.is_path() || !m.ends().at_rest()))
    throw RequestError("/best",
                       "is true, but the motion is a path, or begins or ends in motion, expected one from rest to rest");
  if (options.best && !robot.energy)
    throw RequestError(
        "/best", "is true, but the robot has no energy.ssv beside its URDF, expected one: work alone has no best duration");
  if (options.cycle > 0 && !robot.energy)
    throw RequestError("/cycle_s",
                       "is given, but the robot has no energy.ssv beside its URDF, expected one with its stand-by power");
  const MotionCost c = energy_of(robot, m, options);
  const energetics::EnergyBooks& b = c.energy.books;
  const optimisation::Solution& s = c.plan.solution;
  Json reply{{"T_s", s.T}};
  verdict_of(s).tell(reply);
  reply["boundary"] = c.with_drives ? "mains" : "joints";
  reply["energy_J"] = c.with_drives ? c.total() : sum(b.mechanical_positive);
  if (options.cycle > 0) {
    reply["cycle_s"] = options.cycle;
    reply["move_J"] = c.total() - c.waiting_energy;
  }
  add_notes(reply, m.notes);
  add_notes(reply, c.plan.notes);
  if (c.with_drives) {
    // 0 in energy.ssv means that the rate is unknown.
    const energetics::Supply& supply = robot.energy->supply;
    reply["price"] = options.price_per_kWh || supply.price_per_kWh > 0 ? Json(c.price) : Json(nullptr);
    reply["co2_kg"] = options.co2_per_kWh || supply.co2_per_kWh > 0 ? Json(c.co2) : Json(nullptr);
    reply["assumed"] = c.assumed;
  }
  if (c.best) {
    reply["best"] = {{"T_s", c.best->T},
                     {"energy_J", c.best->energy},
                     {"saved_J", c.best->energy_here - c.best->energy},
                     {"at_shortest", c.best->at_shortest},
                     {"at_longest", c.best->at_longest},
                     {"brakes_close", c.best->brakes_close}};
  }
  if (detail < Detail::kMargins) return reply;
  reply["work_positive_J"] = sum(b.mechanical_positive);
  reply["work_negative_J"] = sum(b.mechanical_negative);
  reply["friction_J"] = c.energy.friction;
  reply["kinetic_J"] = c.energy.kinetic;
  reply["potential_J"] = c.energy.potential;
  if (m.loads.wrench) reply["wrench_J"] = c.energy.external;
  if (c.with_drives) {
    reply["copper_J"] = sum(b.copper);
    reply["converter_J"] = sum(b.converter);
    reply["iron_J"] = sum(b.iron);
    reply["idle_J"] = b.idle;
    reply["regenerable_J"] = b.regenerable;
    reply["supplied_J"] = b.link.supplied;
    reply["returned_J"] = b.link.returned;
    reply["chopped_J"] = b.link.chopped;
    reply["stored_J"] = b.stored;
    reply["supply_losses_J"] = b.supply_losses;
    reply["controller_J"] = b.controller;
    reply["drawn_J"] = b.drawn;
    reply["peak_power_W"] = b.peak_power;
    reply["peak_power_t_s"] = c.energy.t_peak;
    if (options.cycle > 0)
      reply["waiting"] = {{"T_s", options.cycle - s.T}, {"energy_J", c.waiting_energy}, {"brakes_close", c.waiting.closes}};
  }
  Json joints = Json::array();
  for (std::size_t j = 0; j < robot.model.joints.size(); ++j) {
    Json own{{"joint", robot.model.joints[j].name},
             {"work_positive_J", b.mechanical_positive[j]},
             {"work_negative_J", b.mechanical_negative[j]}};
    if (c.with_drives) {
      own["copper_J"] = b.copper[j];
      own["converter_J"] = b.converter[j];
      own["iron_J"] = b.iron[j];
    }
    joints.push_back(own);
  }
  reply["joints"] = joints;
  if (detail < Detail::kSeries) return reply;
  Move timed = m;
  timed.T = s.T;
  const Torques t = torques(robot.model, timed, 201);
  reply["series"] = {{"t_s", t.t}, {"mechanical_power_W", t.power}};
  if (detail == Detail::kAll) reply["residual_J"] = c.energy.residual();
  return reply;
}

Json answer_effective_mass(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  const ContactOptions o = read_contact_options(robot, r);
  if (!r.finish(context)) return {};
  Json reply = Json::object();
  Verdict verdict;
  const PathMasses masses = masses_along(robot.model, planned(robot, m, reply, verdict), o);
  reply.update(Json{{"T_s", masses.T}, {"lightest", place(masses.lightest)}, {"heaviest", place(masses.heaviest)}});
  if (detail >= Detail::kMargins) {
    reply["fastest"] = place(masses.fastest);
    reply["start"] = place(masses.start);
    reply["end"] = place(masses.end);
  }
  if (detail >= Detail::kSeries) reply["series"] = series_of(masses);
  return reply;
}

Json answer_safety(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, kAnyMotion);
  const Detail detail = read_detail(r);
  ContactOptions o = read_contact_options(robot, r);
  read_body_parts(robot, r, o, "body parts or regions");
  const bool safe_pace = r.word("pace", {"bounds", "safe"},
                                "without T_s: the shortest duration within the bounds, or one that is also slow enough "
                                "beside a person") == "safe";
  for (const char* own : {"T_s", "series", "waypoints"})
    if (safe_pace && r.gives(own))
      throw RequestError("/pace", std::string("is safe beside ") + own + ", expected one of them: safe asks for a duration");
  if (!r.finish(context)) return {};
  Json reply = Json::object();
  Verdict verdict;
  Move timed = planned(robot, m, reply, verdict);
  PathSafety s = safety_along(robot.model, timed, o);
  if (safe_pace) {
    if (const double T = worst_of(s).decisive.T_safe * (1 + 1e-12); T > s.T && T <= kLongest) {
      timed.T = T;
      verdict = verdict_of(plan(robot.model, timed).solution);
      s = safety_along(robot.model, timed, o);
    }
    if (s.safe) reply["pace"] = "safe";
  }
  add_safety(robot, timed, o, s, reply, verdict);
  verdict.tell(reply);
  if (detail >= Detail::kMargins) {
    Json parts = Json::array();
    for (const PartRisk& p : s.parts) {
      Json own{{"part", p.name}};
      own.update(risk_json(p.decisive));
      own["effective"] = risk_json(p.effective);
      own["iso_ts_15066"] = risk_json(p.simple);
      parts.push_back(own);
    }
    reply["parts"] = parts;
    reply["heaviest"] = place(s.masses.heaviest);
    reply["fastest"] = place(s.masses.fastest);
  }
  if (detail >= Detail::kSeries) reply["series"] = series_of(s.masses);
  return reply;
}

}  // namespace cotwin::services
