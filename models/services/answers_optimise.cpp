#include <algorithm>
#include <cmath>
#include <memory>

#include "models/optimisation/particle_table.h"
#include "models/services/answers.h"
#include "models/services/energy_service.h"

namespace cotwin::services {

namespace {

using optimisation::CostTerm;
using optimisation::Problem;
using optimisation::Solution;
using optimisation::Status;

/// Names of costs with their units.
const char* unit_of(optimisation::Quantity q) {
  using Q = optimisation::Quantity;
  switch (q) {
    case Q::kTime:
      return "time_s";
    case Q::kTorque:
      return "torque_squared_integral";
    case Q::kWork:
      return "work_J";
    case Q::kSharedWork:
      return "shared_work_J";
    case Q::kAcceleration:
      return "acceleration_squared_integral";
    case Q::kJerk:
      return "jerk_squared_integral";
    default:
      return "energy_J";
  }
}

CostTerm term_of(const std::string& name, double weight, const std::string& pointer) {
  CostTerm term;
  try {
    term.quantity = optimisation::quantity_of(name);
  } catch (const Error& e) {
    throw RequestError(pointer, e.what());
  }
  if (term.quantity == optimisation::Quantity::kPower)
    throw RequestError(pointer, "is power, which is a function in C++, expected another cost");
  term.weight = weight;
  return term;
}

std::vector<CostTerm> read_costs(Reader& r) {
  const Json* given = r.any("cost");
  if (!given) return {term_of("torque", 1, "/cost")};
  if (given->is_string()) return {term_of(given->get<std::string>(), 1, r.pointer("cost"))};
  if (!given->is_array() || given->empty())
    throw RequestError(r.pointer("cost"), "expected the name of a cost, or an array of {\"name\", \"weight\"}");
  std::vector<CostTerm> terms;
  for (std::size_t i = 0; i < given->size(); ++i) {
    Reader one((*given)[i], r.pointer("cost") + "/" + std::to_string(i));
    const std::string name = one.text("name");
    const double weight = one.number("weight", 1);
    one.finish();
    if (weight < 0) throw RequestError(one.pointer("weight"), "is negative, expected 0 or more");
    terms.push_back(term_of(name, weight, one.pointer("name")));
  }
  return terms;
}

Json costs_of(const Problem& p, const std::vector<double>& costs) {
  Json all = Json::object();
  for (std::size_t i = 0; i < p.costs.size(); ++i) all[unit_of(p.costs[i].quantity)] = costs[i];
  return all;
}

Problem problem_of(const Robot& robot, const Move& m, Reader& r) {
  Problem p;
  p.robot = robot.model;
  const std::vector<double> zero(robot.model.joints.size(), 0.0);
  p.ends = {m.from_q, zero, zero, m.to_q, zero, zero};
  p.degree = r.has("degree") ? m.degree : 9;
  p.drives = m.drives;
  p.bounds = optimisation::bounds_of(robot.model);
  const auto take = [](std::vector<double>& bound, const std::vector<double>& own) {
    if (!own.empty()) bound = own;
  };
  take(p.bounds.q_min, m.bounds.q_min);
  take(p.bounds.q_max, m.bounds.q_max);
  take(p.bounds.dq, m.bounds.dq);
  take(p.bounds.ddq, m.bounds.ddq);
  take(p.bounds.dddq, m.bounds.dddq);
  take(p.bounds.tau, m.bounds.tau);
  p.T_min = r.positive("T_min_s");
  p.T_max = r.has("T_max_s") ? r.positive("T_max_s") : p.T_min;
  if (p.T_max < p.T_min) throw RequestError("/T_max_s", "is less than T_min_s, expected at least that");
  p.costs = read_costs(r);
  const std::string bus = r.word("bus", {"shared", "none", "grid"});
  for (const CostTerm& term : p.costs) {
    if (term.quantity != optimisation::Quantity::kEnergy) continue;
    if (!robot.energy)
      throw RequestError("/cost", "is energy, but the robot has no energy.ssv beside its URDF, expected one, or the cost work");
    const EnergyData& e = *robot.energy;
    p.electrical = optimisation::Electrical{e.losses, e.current, bus_of(bus), e.link, e.supply, e.standby};
  }
  return p;
}

/// Progress in steps of one percent over all searches. Copies of the function count together.
std::function<bool(const optimisation::Round&)> progress_of(const Context& context, long long rounds) {
  if (!context.progress) return {};
  struct Count {
    long long round = 0, told = 0;
  };
  return [&context, rounds, count = std::make_shared<Count>()](const optimisation::Round&) {
    const long long percent = std::min(100LL, 100 * ++count->round / rounds);
    if (percent > count->told) context.progress(0.01 * static_cast<double>(percent), "round " + std::to_string(count->round));
    count->told = std::max(count->told, percent);
    return true;
  };
}

/// By how much each cost is below that of the quintic, relative.
Json shares_of(const Problem& p, const std::vector<double>& costs, const std::vector<double>& quintic) {
  Json all = Json::object();
  for (std::size_t i = 0; i < p.costs.size(); ++i)
    all[unit_of(p.costs[i].quantity)] = quintic[i] > 0 ? Json(1 - costs[i] / quintic[i]) : Json(nullptr);
  return all;
}

VerificationOptions read_verification(const Robot& robot, Reader& r) {
  VerificationOptions o;
  if (r.has("settle_s")) o.settle = r.positive("settle_s");
  if (o.settle > 60) throw RequestError("/settle_s", "is more than 60, expected at most that");
  const std::string name = JointUnits(robot.model).name("tracking_max", 0);
  if (r.has(name.c_str())) o.tracking_max = r.positive(name.c_str());
  return o;
}

Json verification_json(const Robot& robot, const Move& m, double T, const VerificationOptions& options, const Context& context,
                       Detail detail) {
  if (!context.verify)
    throw RequestError("/verify", "needs a co-simulation, which this program does not have, expected cotwin ask");
  const Verification v = context.verify(robot, m, T, options);
  const JointUnits units(robot.model);
  Json reply{{"feasible", v.feasible},
             {"reason", v.reason},
             {"T_s", v.T},
             {"settle_s", v.settle},
             {"tracking_error_max", *std::ranges::max_element(v.tracking)},
             {"work_J", v.work},
             {"rigid_work_J", v.work_rigid},
             {"friction_J", v.friction}};
  if (v.with_drives) {
    reply["drawn_J"] = v.drawn;
    reply["rigid_drawn_J"] = v.drawn_rigid;
  }
  if (detail < Detail::kMargins) return reply;
  Json joints = Json::array();
  for (std::size_t j = 0; j < robot.model.joints.size(); ++j) {
    Json own{{"joint", robot.model.joints[j].name},
             {std::string("tracking_error_") + units.of(j, 0), v.tracking[j]},
             {std::string("end_error_") + units.of(j, 0), v.end_error[j]},
             {std::string("dq_") + units.of(j, 1), v.dq[j]},
             {std::string("tau_") + units.of(j, 4), v.tau[j]},
             {std::string("rigid_tau_") + units.of(j, 4), v.tau_rigid[j]}};
    if (std::isfinite(v.tau_limit[j])) {
      own[std::string("limit_") + units.of(j, 4)] = v.tau_limit[j];
      own["share"] = v.tau[j] / v.tau_limit[j];
    }
    joints.push_back(own);
  }
  reply["joints"] = joints;
  return reply;
}

}  // namespace

Json answer_optimise(const Robot& robot, Reader& r, const Context& context) {
  const Move m = read_move(robot, r, false);
  Problem p = problem_of(robot, m, r);
  optimisation::SearchOptions options;
  options.particles = r.integer("particles", 8, 100000, 200);
  options.rounds = r.integer("rounds", 1, 100000, 500);
  options.seed = static_cast<std::uint64_t>(r.integer("seed", 0, 2147483647, 1));
  options.refine = r.boolean("refine", true);
  options.evaluations = static_cast<std::uint64_t>(r.integer("evaluations_max", 1, 1000000000, 10000000));
  if (r.has("limit_s")) options.limit = r.positive("limit_s");
  const std::string rule = r.word("rule", {"weighted", "lexicographic", "pareto"});
  const double tolerance = r.number("tolerance", 0.01);
  const int directions = r.integer("directions", 2, 1000, 11);
  const bool verify = r.boolean("verify", false);
  const VerificationOptions verification = read_verification(robot, r);
  const Detail detail = read_detail(r);
  r.finish();
  const JointUnits units(robot.model);
  if (!m.c.empty())
    throw RequestError("/" + units.name("c_r", 0), "is given, expected it only for a move that is not optimised");
  if (!(tolerance >= 0)) throw RequestError("/tolerance", "is negative, expected 0 or more");
  const bool pareto = rule == "pareto";
  if (pareto && p.costs.size() < 2) throw RequestError("/cost", "has one cost, expected two or more for a Pareto front");
  if (pareto && verify)
    throw RequestError("/verify",
                       "is true with the rule pareto, expected it with one motion: the rule weighted or lexicographic");
  const long long costs = static_cast<long long>(p.costs.size());
  const long long searches = pareto ? costs + directions - 2 : rule == "lexicographic" ? costs : 1;
  options.on_round = progress_of(context, searches * options.rounds);
  std::optional<optimisation::ParticleTable> table;
  if (context.particles) options.on_round = table.emplace(*context.particles, p).on_round(options.on_round);

  if (pareto) {
    Json front = Json::array();
    bool complete = true;
    for (const auto& particle : optimisation::pareto_front(p, directions, options, context.threads, &complete)) {
      Move found = m;
      found.degree = p.degree;
      found.c = particle.c;
      Json one{{"T_s", particle.T}, {"costs", costs_of(p, particle.costs)}};
      if (detail >= Detail::kMargins) one["motion"] = motion_of(robot, found, particle.T);
      front.push_back(one);
    }
    const bool some = !front.empty();
    return {{"status", some ? "feasible" : "infeasible"},
            {"reason", some ? "" : "no motion within the bounds was found, expected a longer T_max_s or other bounds"},
            {"complete", complete},
            {"front", front}};
  }

  const Solution s = rule == "lexicographic" ? optimisation::minimise_in_order(p, tolerance, options, context.threads)
                                             : optimisation::minimise(p, options, context.threads);
  Move found = m;
  found.degree = s.degree;
  found.c = s.c;
  found.to_q = s.q_to;
  Problem quintic = p;
  quintic.degree = 5;
  if (rule == "lexicographic")  // cost is the last one, as in the search
    for (CostTerm& term : quintic.costs) term.weight = &term == &quintic.costs.back() ? 1 : 0;
  const Solution reference = optimisation::assess(quintic, {}, p.ends.q_to, s.T);
  Json reply{{"status", optimisation::to_text(s.status)},
             {"feasible", s.status == Status::kFeasible},
             {"reason", s.reason},
             {"complete", s.complete},
             {"T_s", s.T},
             {"cost", s.cost},
             {"costs", costs_of(p, s.costs)},
             {"quintic",
              {{"T_s", reference.T},
               {"feasible", reference.status == Status::kFeasible},
               {"reason", reference.reason},
               {"cost", reference.cost},
               {"costs", costs_of(p, reference.costs)}}},
             {"saved_share", reference.cost > 0 ? Json(1 - s.cost / reference.cost) : Json(nullptr)},
             {"saved_shares", shares_of(p, s.costs, reference.costs)},
             {"limiting", limiting_of(robot.model, s.peaks)},
             {"motion", motion_of(robot, found, s.T)}};
  if (detail >= Detail::kMargins) {
    reply["evaluations"] = s.evaluations;
    reply["pruned"] = s.pruned;
    reply["joints"] = peaks_of(robot.model, s.peaks);
  }
  if (detail == Detail::kAll) reply["history"] = s.history;
  if (verify) reply["verification"] = verification_json(robot, found, s.T, verification, context, detail);
  return reply;
}

Json answer_verify(const Robot& robot, Reader& r, const Context& context) {
  const Move m = read_move(robot, r, true);
  const VerificationOptions options = read_verification(robot, r);
  const Detail detail = read_detail(r);
  r.finish();
  const Plan p = plan(robot.model, m);
  if (m.T == 0 && p.solution.status != Status::kFeasible)
    throw RequestError("",
                       "no duration of the move meets the bounds (" + p.solution.reason + "), expected T_s or other bounds");
  return verification_json(robot, m, p.solution.T, options, context, detail);
}

}  // namespace cotwin::services
