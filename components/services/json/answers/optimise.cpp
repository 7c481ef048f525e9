#include <algorithm>
#include <chrono>
#include <cmath>
#include <functional>
#include <iterator>
#include <map>
#include <memory>
#include <optional>

#include "components/services/energy_service.h"
#include "components/services/json/answers/answers.h"
#include "components/services/json/clear_json.h"
#include "components/services/json/compliance_json.h"
#include "components/services/json/contact_json.h"
#include "components/services/json/end_pose_json.h"
#include "components/services/json/problem_json.h"
#include "models/foundation/support/text.h"
#include "models/optimisation/particle_table.h"

namespace cotwin::services {

namespace {

using optimisation::CostTerm;
using optimisation::Problem;
using optimisation::Quantity;
using optimisation::SearchOptions;
using optimisation::Solution;
using optimisation::Status;

/// The frame of the costs effective_mass and safety; of the latter what judges a motion.
std::optional<ContactOptions> read_contact(const Robot& robot, Reader& r, Problem& p) {
  const bool safety = has_cost(p, Quantity::kSafety);
  const bool contact = safety || has_cost(p, Quantity::kMass);
  for (const char* name : {"frame", "direction", "motors"}) r.only_if(contact, name, "the cost effective_mass or safety");
  for (const char* name : {"parts", "contact", "contact_area_m2", "load_kg", "mass"})
    r.only_if(safety, name, "the cost safety");
  if (!contact && !r.describes()) return {};
  ContactOptions o =
      read_contact_frame(robot, r, "of the costs effective_mass and safety; without it the end effector",
                         "in the axes of the base; without it along the velocity", "whether the inertias of the motors count");
  if (safety || r.describes()) read_body_parts(robot, r, o, "of the cost safety");
  if (r.describes()) return {};
  for (const robot::BodyPart& part : o.parts)
    if (!((o.transient ? part.transient : part.quasi_static).on(o.area) > 0))
      throw RequestError(r.pointer("parts"),
                         "has " + part.name + ", with which this contact is not permitted, expected others");
  optimisation::ContactFrame frame;
  frame.frame = robot::on_body(o.frame.empty() ? robot.model.end_effector() : robot.model.frame(o.frame));
  if (o.u) frame.u = o.u->stableNormalized();
  if (o.motors_held) frame.B = o.B;
  frame.parts = o.parts;
  frame.transient = o.transient;
  frame.area = o.area;
  frame.load = o.load;
  double load = o.load;
  for (const robot::Payload& payload : p.loads.payloads) load += payload.part.inertia.mass;
  if (safety && !o.only_effective) frame.least_mass = robot::simple_effective_mass(robot::moving_mass(robot.model), load);
  p.contact = frame;
  o.samples = 2;  // of the series, which nobody reads
  return safety ? std::optional(o) : std::nullopt;
}

/// Progress in steps of one percent: the rounds of all searches up to `most` of the work, finish() the rest.
class Progress {
 public:
  Progress(const Context& context, long long rounds, double most)
      : context_(context), percent_per_round_(100 * most / static_cast<double>(rounds)), most_(100 * most) {}
  std::function<bool(const optimisation::Round&)> on_round() {
    if (!context_.progress) return {};
    return [this](const optimisation::Round&) {
      ++round_;
      tell(std::floor(std::min(most_, percent_per_round_ * static_cast<double>(round_) + 1e-9)),
           "round " + std::to_string(round_));
      return true;
    };
  }
  void finish() {
    if (context_.progress) tell(100, "done");
  }

 private:
  void tell(double percent, const std::string& message) {
    if (percent <= told_) return;
    told_ = percent;
    context_.progress(0.01 * percent, message);
  }

  const Context& context_;
  double percent_per_round_, most_, told_ = 0;
  long long round_ = 0;
};

/// The quintic that a motion is compared with: that of least cost where the duration is searched and the search has left some of its
/// `options`, otherwise, and with a compliant frame, that of the same duration.
Solution quintic_of(Problem p, const Solution& s, const std::optional<double>& tolerance, const SearchOptions& options) {
  p.degree = 5;
  p.end_postures.clear();
  if (tolerance)  // cost is the last one, as in the search
    for (CostTerm& term : p.costs) term.weight = &term == &p.costs.back() ? 1 : 0;
  const Solution same = optimisation::assess(p, {}, p.ends.q_to, s.T, s.compliance);
  const bool spent = s.evaluations >= options.evaluations || !(options.limit > 0);
  if (p.T_min == p.T_max || p.compliant || spent) return same;
  SearchOptions few;
  few.particles = 32;
  few.rounds = 40;
  few.seed = options.seed;
  few.evaluations = options.evaluations - s.evaluations;
  few.limit = options.limit;
  const Solution best = tolerance ? optimisation::minimise_in_order(p, *tolerance, few) : optimisation::minimise(p, few);
  return best.status == Status::kFeasible ? best : same;
}

/// By how much a cost is below that of the quintic, relative; null where the quintic keeps no bounds or costs nothing.
Json share_of(double cost, double of_quintic, const Solution& quintic) {
  return quintic.status == Status::kFeasible && of_quintic > 0 ? Json(1 - cost / of_quintic) : Json(nullptr);
}

Json shares_of(const Problem& p, const Solution& s, const Solution& quintic) {
  Json all = Json::object();
  for (std::size_t i = 0; i < p.costs.size(); ++i)
    all[unit_of(p.costs[i].quantity)] = share_of(s.costs[i], quintic.costs[i], quintic);
  return all;
}

/// Refuses members that have no effect with the rule and without a verification.
void refuse_unused(const Robot& robot, Reader& r, const std::string& rule, bool verify) {
  r.only_if(rule == "lexicographic", "tolerance", "the rule lexicographic");
  r.only_if(rule == "pareto", "directions", "the rule pareto");
  for (const std::string& name : {std::string("settle_s"), JointUnits(robot.model).name("tracking_max", 0)})
    r.only_if(verify, name.c_str(), "verify");
}

/// Motions within the bounds that a search tried, for one that touches nothing: of those whose costs differ by less than a share the cheapest, since
/// those of a search that has converged are all alike.
class Candidates {
 public:
  explicit Candidates(const Problem& problem) : problem_(problem) {}
  std::function<bool(const optimisation::Round&)> on_round(std::function<bool(const optimisation::Round&)> further) {
    return [this, further = std::move(further)](const optimisation::Round& round) {
      for (const auto& particle : round.particles)
        if (particle.feasible()) add(particle);
      return !further || further(round);
    };
  }
  struct Candidate {
    double cost;
    optimisation::Round::Particle particle;
  };
  const std::map<double, Candidate>& by_cost() const { return kept_; }

 private:
  void add(const optimisation::Round::Particle& particle) {
    constexpr std::size_t kMost = 500;
    constexpr double kShare = 1e-3;
    double cost = 0;
    for (std::size_t i = 0; i < problem_.costs.size(); ++i) cost += problem_.costs[i].weight * particle.costs[i];
    if (!std::isfinite(cost)) return;
    const double place = std::copysign(std::floor(std::log1p(std::abs(cost)) / kShare), cost);
    const auto [at, is_new] = kept_.try_emplace(place, Candidate{cost, particle});
    if (!is_new && cost < at->second.cost) at->second = {cost, particle};
    if (kept_.size() > kMost) kept_.erase(std::prev(kept_.end()));
  }
  const Problem& problem_;
  std::map<double, Candidate> kept_;
};

/// Replaces a motion that is not clear by the cheapest clear one of the candidates, if there is one. Returns what to tell.
std::string make_clear(ClearOf& clear, const Problem& p, const Candidates& candidates, Solution& s) {
  const collision::Verdict verdict = clear.check(s.path);
  if (verdict.clear) return "";
  int touching = 1;
  for (const auto& [place, candidate] : candidates.by_cost()) {
    const optimisation::Round::Particle& particle = candidate.particle;
    Solution other = optimisation::assess(p, particle.c, particle.q_to, particle.T, particle.compliance);
    if (other.status != Status::kFeasible) continue;
    if (!clear.check(other.path).clear) {
      ++touching;
      continue;
    }
    other.history = s.history;
    other.evaluations = s.evaluations;
    other.pruned = s.pruned;
    other.complete = s.complete;
    s = std::move(other);
    return std::to_string(touching) +
           " cheaper motions that were found are not clear (the cheapest one: " + clear.reason(verdict) +
           "); this one was not refined";
  }
  if (s.status == Status::kFeasible) s.reason = clear.reason(verdict);
  s.status = Status::kInfeasible;
  return "none of " + std::to_string(touching) + " motions that were found is clear";
}

/// Of a motion that keeps its bounds the reason may be a condition of its compliance.
bool of_compliance(const Solution& s) { return s.reason.starts_with("compliance:"); }

/// A search that has ended early and found nothing does not know.
void add_search(bool complete, Verdict& verdict) {
  if (complete) return verdict.add(Of::kSearch, Says::kYes);
  const bool found = verdict.feasible();
  verdict.add(Of::kSearch, found ? Says::kYes : Says::kUnknown,
              std::string("the search has ended early") + (found ? ", a better motion may exist" : ", a motion may exist"));
}

/// `touching`: motions that are left out, because they are not clear; of less than 0 nothing was to be kept clear of.
Json front_of(const Robot& robot, const Move& m, const Problem& p, const std::vector<optimisation::Round::Particle>& particles,
              const std::optional<ContactOptions>& contact, std::ptrdiff_t touching, bool complete, Detail detail) {
  Json front = Json::array();
  std::optional<Verdict> best;
  for (const auto& particle : particles) {
    Move found = m;
    found.degree = p.degree;
    found.c = particle.c;
    found.to_q = particle.q_to;
    found.T = particle.T;
    Json one{{"T_s", particle.T}, {"costs", costs_json(p, particle.costs)}};
    const Solution s = optimisation::assess(p, particle.c, particle.q_to, particle.T, particle.compliance);
    Verdict verdict;
    verdict.add(Of::kBounds, s.status == Status::kFeasible || of_compliance(s), s.reason);
    if (touching >= 0) verdict.add(Of::kClearOf, Says::kYes);
    if (p.compliant) verdict.add(Of::kCompliance, !of_compliance(s), s.reason);
    if (contact) judge_persons(robot, safety_along(robot.model, found, *contact), verdict);
    verdict.tell_findings(one);
    if (!best || verdict.light(false) < best->light(false)) best = verdict;
    if (p.compliant) one["compliance"] = axes_json(p, particle.compliance);
    if (detail >= Detail::kMargins) one["motion"] = motion_of(robot, found, particle.T);
    front.push_back(one);
  }
  const bool some = !front.empty();
  Verdict verdict;
  if (!some) {
    verdict.add(p.compliant ? Of::kCompliance : Of::kBounds, touching > 0,
                "no motion within the bounds was found" +
                    std::string(p.compliant ? ", whose compliance meets its conditions" : "") +
                    ", expected a longer T_max_s or other bounds");
    if (touching > 0)
      verdict.add(Of::kClearOf, Says::kNo, "none of " + std::to_string(touching) + " motions that were found is clear");
  } else {
    for (const Finding& f : best->findings())
      verdict.add(f.of, f.says,
                  f.of == Of::kPersons && f.says == Says::kNo
                      ? "none of " + text::counted(std::ssize(front), "motion") + " is slow enough beside a person"
                      : f.why);
  }
  add_search(complete, verdict);
  Json reply{{"status", some ? "feasible" : "infeasible"}};
  verdict.tell(reply);
  reply["complete"] = complete;
  reply["front"] = std::move(front);
  return reply;
}

}  // namespace

Json answer_optimise(const Robot& robot, Reader& r, const Context& context) {
  const MoveRequest m = read_move(robot, r, context, {.duration = false, .in_motion = true});
  const Detail detail = read_detail(r);
  std::vector<std::string> notes = m.notes;
  std::string weight;
  Problem p = read_problem(robot, m, r, {{Quantity::kTorque, 1, {}}}, weight, notes);
  const std::string rule = r.word("rule", {"weighted", "lexicographic", "pareto"});
  const bool pareto = rule == "pareto", lexicographic = rule == "lexicographic";
  if (rule != "weighted" && !weight.empty())
    throw RequestError(weight, "is given, but has no effect without the rule weighted, expected it only with that");
  const double tolerance =
      r.not_negative("tolerance", 0.01, "lexicographic: by which an earlier cost may exceed its optimum, relative");
  const int directions = r.integer("directions", 2, 1000, 11, "pareto: searches with different weights");
  SearchOptions options;
  options.particles = r.integer("particles", 8, 100000, 200);
  options.rounds = r.integer("rounds", 1, 100000, 500);
  options.seed = static_cast<std::uint64_t>(r.integer("seed", 0, 2147483647, 1));
  options.device = read_device(r, "auto: a GPU for 10000 particles and more, if there is one");
  options.refine = r.boolean("refine", true, "Newton's method after the swarm");
  options.evaluations = static_cast<std::uint64_t>(
      r.integer("evaluations_max", 1, 1000000000, 10000000, "motions that are tried before the search ends early"));
  options.limit =
      r.positive("limit_s", options.limit, "real time before the search ends early; the reply then depends on the machine");
  const bool verify = r.boolean("verify", false, "also a co-simulation of the twin");
  const VerificationOptions verification = read_verification(robot, r);
  std::optional<EndPose> end = read_end_pose(r, p);
  const std::optional<ComplianceRequest> compliance = read_compliance(r, p);
  if (!p.compliant &&
      std::ranges::any_of(p.costs, [](const CostTerm& t) { return optimisation::needs_compliance(t.quantity); }))
    throw RequestError("/cost", "is cycle_time or stiffness, but no compliance is searched, expected compliance with axes");
  const std::optional<ContactOptions> contact = read_contact(robot, r, p);
  refuse_unused(robot, r, rule, verify);
  r.only_if(r.describes() || p.ends.at_rest_at_end(), "settle_s", "a move that ends at rest");
  std::optional<ClearOf> clear = ClearOf::read(robot, r, context, m.carried);
  if (r.describes()) return {};
  if (clear && lexicographic) throw RequestError("/rule", "is lexicographic beside clear_of, expected weighted or pareto");
  const JointUnits units(robot.model);
  if (!m.c.empty())
    throw RequestError("/" + units.name("c_r", 0), "is given, expected it only for a move that is not optimised");
  if (pareto && p.costs.size() < 2) throw RequestError("/cost", "has one cost, expected two or more for a Pareto front");
  if (pareto && (verify || compliance))
    throw RequestError(verify ? "/verify" : "/compliance", std::string("is ") + (verify ? "true" : "given") +
                                                               " with the rule pareto, expected it with one motion: the rule "
                                                               "weighted or lexicographic" +
                                                               (verify ? "" : ", or compliance with axes"));
  optimisation::check(p);
  if (!r.finish(context)) return {};
  const long long costs = static_cast<long long>(p.costs.size());
  constexpr int kSearchesToPose = 3;
  const long long searches = pareto          ? (costs + directions - 2) * (end ? 2 : 1)
                             : lexicographic ? costs * (end ? kSearchesToPose : 1)
                             : end           ? kSearchesToPose
                                             : 1;
  std::string device, not_device;  // of the last search
  double rounding = 0;
  options.on_device = [&](const std::string& name, double by, const std::string& reason) {
    if (!name.empty()) device = name;
    rounding = std::max(rounding, by);
    not_device = reason;
  };
  const auto tell = [&](Json& reply) {
    if (!device.empty() || !not_device.empty()) tell_device(reply, device, rounding, not_device);
  };
  Progress progress(context, searches * options.rounds, options.refine || verify ? 0.9 : 1);
  options.on_round = progress.on_round();
  std::optional<optimisation::ParticleTable> table;
  Candidates candidates(p);
  if (clear && !pareto) options.on_round = candidates.on_round(options.on_round);
  if (context.particles) options.on_round = table.emplace(*context.particles, p).on_round(options.on_round);

  if (pareto) {
    bool complete = true;
    auto particles = end ? optimisation::pareto_front_to_pose(p, directions, *end->kinematics, end->target, options,
                                                              context.threads, &complete)
                         : optimisation::pareto_front(p, directions, options, context.threads, &complete);
    progress.finish();
    std::ptrdiff_t touching = clear ? 0 : -1;
    if (clear) {
      touching = std::ssize(particles);
      std::erase_if(particles, [&](const optimisation::Round::Particle& one) {
        return !clear->check(optimisation::assess(p, one.c, one.q_to, one.T, one.compliance).path).clear;
      });
      touching -= std::ssize(particles);
      if (touching > 0)
        notes.push_back(std::to_string(touching) + " motions of the front are left out, because they are not clear");
    }
    Json reply = front_of(robot, m, p, particles, contact, touching, complete, detail);
    add_notes(reply, notes);
    tell(reply);
    return reply;
  }

  const auto begun = std::chrono::steady_clock::now();
  Solution s = lexicographic && end ? optimisation::minimise_in_order_to_pose(p, tolerance, *end->kinematics, end->target,
                                                                              options, context.threads)
               : lexicographic      ? optimisation::minimise_in_order(p, tolerance, options, context.threads)
               : end                ? optimisation::minimise_to_pose(p, *end->kinematics, end->target, options, context.threads)
                                    : optimisation::minimise(p, options, context.threads);
  options.limit -= std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count();
  bool within = s.status == Status::kFeasible || of_compliance(s);
  const std::string beyond = s.reason;
  std::string dropped;
  if (clear) dropped = make_clear(*clear, p, candidates, s);
  Solution quintic = quintic_of(p, s, lexicographic ? std::optional(tolerance) : std::nullopt, options);
  const std::uint64_t evaluations = s.evaluations + quintic.evaluations;
  if (const std::string touches = clear ? clear->reason(clear->check(quintic.path)) : ""; !touches.empty()) {
    quintic.status = Status::kInfeasible;
    quintic.reason = touches;
  }
  const bool quintic_is_better =
      quintic.status == Status::kFeasible && (s.status != Status::kFeasible || (!lexicographic && quintic.cost < s.cost));
  if (quintic_is_better) {  // where the search had no time to find it
    const bool complete = s.complete;
    s = quintic;
    s.complete = complete;
    within = true;
  }
  Verdict verdict;
  verdict.add(Of::kBounds, within, beyond);
  Move found = m;
  found.degree = s.degree;
  found.c = s.c;
  found.to_q = s.q_to;
  Json reply{{"status", optimisation::to_text(s.status)}};
  verdict.tell(reply);
  reply.update(Json{{"complete", s.complete},
                    {"T_s", s.T},
                    {"cost", s.cost},
                    {"costs", costs_json(p, s.costs)},
                    {"quintic",
                     {{"T_s", quintic.T},
                      {"feasible", quintic.status == Status::kFeasible},
                      {"reason", quintic.reason},
                      {"cost", quintic.cost},
                      {"costs", costs_json(p, quintic.costs)}}},
                    {"saved_share", share_of(s.cost, quintic.cost, quintic)},
                    {"saved_shares", shares_of(p, s, quintic)},
                    {"limiting", limiting_of(robot.model, s.peaks)},
                    {"motion", motion_of(robot, found, s.T)}});
  if (clear) clear->judge(s.path, reply, verdict);
  if (!dropped.empty()) notes.push_back(dropped);
  add_notes(reply, notes);
  tell(reply);
  if (p.T_min < p.T_max)
    if (const std::string note = creeping(p, s); !note.empty()) add_notes(reply, {note});
  if (end && !end->has_freedom) add_notes(reply, {"to_pose leaves the joints no freedom: the end posture is the given one"});
  if (p.compliant) {
    reply["compliance"] = compliance_json(p, s);
    verdict.add(Of::kCompliance, !of_compliance(s), s.reason);
  }
  if (compliance) {
    const Json own = reply["compliance"] = compliance_json(*compliance, s.T, options.seed);
    verdict.add(Of::kCompliance, own["feasible"] == true, "compliance: " + own["reason"].get<std::string>());
  }
  if (detail >= Detail::kMargins) {
    reply["evaluations"] = evaluations;
    reply["pruned"] = s.pruned;
    reply["joints"] = peaks_of(robot.model, s.peaks);
  }
  if (detail == Detail::kAll) reply["history"] = s.history;
  if (verify) {
    Json twin = verification_json(robot, found, s.T, verification, context, detail);
    add_notes(reply, twin.value("notes", std::vector<std::string>{}));
    twin.erase("notes");
    add_twin(twin, verdict);
    reply["verification"] = std::move(twin);
  }
  if (!verdict.feasible() && reply.contains("compliance"))
    for (const char* figure : {"T_cycle_s", "moves_per_hour"}) reply["compliance"][figure] = nullptr;
  if (contact) {
    found.T = s.T;
    add_safety(robot, found, *contact, safety_along(robot.model, found, *contact), reply, verdict);
  }
  add_search(s.complete, verdict);
  verdict.tell(reply);
  progress.finish();
  return reply;
}

}  // namespace cotwin::services
