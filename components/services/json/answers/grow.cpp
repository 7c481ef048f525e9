// grow: very many motions between postures, and what they cost.
#include <algorithm>
#include <cmath>
#include <tuple>

#include "components/services/json/answers/answers.h"
#include "components/services/json/contact_json.h"
#include "components/services/json/end_pose_json.h"
#include "components/services/json/problem_json.h"
#include "models/foundation/support/text.h"
#include "models/optimisation/growth/growth.h"

namespace cotwin::services {

namespace {

using optimisation::PostureSet;
using optimisation::Problem;
using optimisation::Quantity;
using Particle = optimisation::Round::Particle;

constexpr std::size_t kMostPostures = 100000;  // of a list or grid

std::vector<double> read_posture(const Robot& robot, Reader& r, const char* plain, const char* what) {
  const JointUnits units(robot.model);
  std::vector<double> q = units.read(r, plain, 0, false, what);
  if (!r.describes() && q.size() != robot.model.joints.size())
    throw RequestError(r.pointer(units.name(plain, 0).c_str()), "has " + std::to_string(q.size()) + " values, expected " +
                                                                    std::to_string(robot.model.joints.size()) +
                                                                    ", one per joint");
  return q;
}

PostureSet read_box(const Robot& robot, Reader& r) {
  PostureSet set;
  set.low = read_posture(robot, r, "least_q", "lower corner");
  set.high = read_posture(robot, r, "most_q", "upper corner");
  r.finish();
  for (std::size_t j = 0; j < set.low.size(); ++j)
    if (!(set.low[j] <= set.high[j]))
      throw RequestError(r.pointer(JointUnits(robot.model).name("most_q", 0).c_str()) + "/" + std::to_string(j),
                         "is " + text::to_text(set.high[j]) + ", expected at least " + text::to_text(set.low[j]) +
                             ", that of the lower corner");
  return set;
}

/// The postures of one end, "from" or "to": of `one` if it is given, of a list or of a box.
std::optional<PostureSet> read_set(const Robot& robot, Reader& r, const std::string& end, const std::vector<double>& one) {
  const std::string list = end + "_postures", box = end + "_box";
  const auto in_list = [&](Reader& own) { return read_posture(robot, own, "q", "a posture"); };
  if (r.describes()) {
    r.declare(list, schemas::array_of(Reader::schema_of(in_list)), false, "in place of one posture: motions take them in turn");
    r.declare(box, Reader::schema_of([&](Reader& own) { (void)read_box(robot, own); }), false,
              "in place of one posture: motions take any posture in it");
  }
  std::optional<PostureSet> set;
  std::string found;
  const auto is_given = [&](const std::string& name) {
    if (!found.empty()) throw RequestError(r.pointer(name.c_str()), "is given beside " + found + ", expected one of them");
    found = name;
  };
  if (!one.empty()) {
    is_given(JointUnits(robot.model).name(end + "_q", 0));
    set = {{one}, {}, {}};
  }
  if (const Json* const given = r.any(list.c_str())) {
    is_given(list);
    if (!given->is_array() || given->empty() || given->size() > kMostPostures)
      throw RequestError(r.pointer(list.c_str()), "is no array of 1 to " + std::to_string(kMostPostures) + " postures");
    set.emplace();
    for (std::size_t k = 0; k < given->size(); ++k) {
      Reader own((*given)[k], r.pointer(list.c_str()) + "/" + std::to_string(k));
      set->list.push_back(in_list(own));
      own.finish();
    }
  }
  if (const Json* const given = r.any(box.c_str())) {
    is_given(box);
    Reader own(*given, r.pointer(box.c_str()));
    set = read_box(robot, own);
  }
  return set;
}

/// Places of a frame, x first, as goals.
struct Grid {
  PoseGoal goal;
  std::vector<robot::PoseTarget> places;
  std::vector<int> goal_at;  // of each place, the posture in the list of goals, −1: none reaches it
};

void read_grid(const Robot& robot, Reader& r, Grid& grid) {
  const robot::Frame frame = read_frame(robot, r, "of the URDF; without it the end effector");
  const std::vector<double> least = r.vector("least_m", 3, false, "x, y, z in the base"),
                            most = r.vector("most_m", 3, false, "the opposite corner"),
                            counts = r.vector("counts", 3, false, "places along x, y, z, with both corners"),
                            Q = r.vector("quaternion_wxyz", 4, true, "of the frame in the base; without it any");
  r.finish();
  if (r.describes()) return;
  grid.goal.frame = frame;
  if (Q.empty()) grid.goal.directions = robot::task_directions("x,y,z");
  const Eigen::Quaterniond q = Q.empty() ? Eigen::Quaterniond::Identity() : Eigen::Quaterniond(Q[0], Q[1], Q[2], Q[3]);
  if (!(std::abs(q.norm() - 1) < 1e-3))
    throw RequestError(r.pointer("quaternion_wxyz"), "has the norm " + text::to_text(q.norm()) + ", expected 1");
  double all = 1;
  for (std::size_t i = 0; i < 3; ++i) {
    const std::string at = "/" + std::to_string(i);
    if (!(counts[i] >= 1 && counts[i] <= kMostPostures && counts[i] == std::floor(counts[i])))
      throw RequestError(r.pointer("counts") + at, "is " + text::to_text(counts[i]) + ", expected a whole number from 1 to " +
                                                       std::to_string(kMostPostures));
    if (!(std::max(std::abs(least[i]), std::abs(most[i])) <= 1e6 && least[i] <= most[i]))
      throw RequestError(r.pointer("most_m") + at, "is " + text::to_text(most[i]) + ", expected at least " +
                                                       text::to_text(least[i]) + ", and at most 1000000");
    if (counts[i] == 1 && least[i] != most[i])
      throw RequestError(r.pointer("counts") + at, "is 1 between different corners, expected at least 2");
    all *= counts[i];
  }
  if (all > kMostPostures)
    throw RequestError(r.pointer("counts"), "has " + std::to_string(static_cast<std::uint64_t>(all)) +
                                                " places, expected at most " + std::to_string(kMostPostures));
  for (std::size_t k = 0; k < static_cast<std::size_t>(all); ++k) {
    std::size_t rest = k;
    Eigen::Vector3d p;
    for (std::size_t i = 0; i < 3; ++i) {
      const auto count = static_cast<std::size_t>(counts[i]);
      const double share = count == 1 ? 0 : static_cast<double>(rest % count) / static_cast<double>(count - 1);
      p[static_cast<Eigen::Index>(i)] = least[i] + share * (most[i] - least[i]);
      rest /= count;
    }
    grid.places.push_back({p, q.normalized()});
  }
}

/// The postures that reach the grid's places within the bounds, each the closest to `reference` that is found.
PostureSet goals_of(Grid& grid, const Problem& p, const std::vector<double>& reference, const Context& context) {
  constexpr std::size_t kBatch = 64;
  robot::RobotModel bounded = p.robot;
  for (std::size_t j = 0; j < bounded.joints.size(); ++j) {
    bounded.joints[j].q_min = p.bounds.q_min[j];
    bounded.joints[j].q_max = p.bounds.q_max[j];
  }
  const Eigen::Map<const Eigen::VectorXd> q(reference.data(), static_cast<Eigen::Index>(reference.size()));
  numerics::Threads alone(1);
  numerics::Threads& threads = context.threads ? *context.threads : alone;
  PostureSet set;
  for (std::size_t first = 0; first < grid.places.size(); first += kBatch) {
    std::vector<robot::Posture> found(std::min(kBatch, grid.places.size() - first));
    threads.run(found.size(), [&](std::size_t k) {
      robot::InverseKinematics kinematics(bounded, grid.goal.frame, grid.goal.directions);
      found[k] = kinematics.solve(grid.places[first + k], q);
    });
    for (const robot::Posture& posture : found) {
      grid.goal_at.push_back(posture.reached ? static_cast<int>(set.list.size()) : -1);
      if (posture.reached) set.list.emplace_back(posture.q.begin(), posture.q.end());
    }
    if (context.progress)
      context.progress(0,
                       "posture of place " + std::to_string(grid.goal_at.size()) + " of " + std::to_string(grid.places.size()));
  }
  return set;
}

/// What limits the coefficients of each joint without c_r_max: a tenth of its largest displacement.
std::vector<double> standard_ranges(const PostureSet& from, const PostureSet& to, std::size_t n) {
  constexpr double kShare = 0.1, kLeast = 0.02;
  std::vector<double> ranges;
  for (std::size_t j = 0; j < n; ++j) {
    const auto span = [&](const PostureSet& set) {
      if (set.list.empty()) return std::pair(set.low[j], set.high[j]);
      const auto [low, high] = std::ranges::minmax(set.list, {}, [&](const auto& q) { return q[j]; });
      return std::pair(low[j], high[j]);
    };
    const auto [a, b] = span(from);
    const auto [c, d] = span(to);
    ranges.push_back(std::max(kShare * std::max(d - a, b - c), kLeast));
  }
  return ranges;
}

Json motions_json(const Robot& robot, const Problem& p, const std::vector<Particle>& particles) {
  Json all = Json::array();
  Verdict verdict;  // only feasible ones are told
  verdict.add(Of::kBounds, Says::kYes);
  for (const Particle& particle : particles) {
    Move move;
    move.from_q = particle.q_from;
    move.to_q = particle.q_to;
    move.degree = p.degree;
    move.c = particle.c;
    all.push_back({{"number", particle.number},
                   {"T_s", particle.T},
                   {"costs", costs_json(p, particle.costs)},
                   {"motion", motion_of(robot, move, particle.T)}});
    verdict.tell_findings(all.back());
  }
  return all;
}

/// Of each goal, arrays: its place, whether it is reached, its posture, the share of its motions that is feasible, the least of each cost.
Json goals_json(const Robot& robot, const Problem& p, const PostureSet& to, const optimisation::Harvest& h, const Grid& grid,
                Detail detail) {
  Json all;
  const std::size_t none = to.list.size(), count = grid.places.empty() ? none : grid.places.size();
  for (std::size_t k = 0; k < count; ++k) {
    std::size_t goal = k;
    if (!grid.places.empty()) {
      for (int i = 0; i < 3; ++i) all[std::string{"xyz"[i]} + "_m"].push_back(grid.places[k].p[i]);
      all["reached"].push_back(grid.goal_at[k] >= 0);
      goal = grid.goal_at[k] < 0 ? none : static_cast<std::size_t>(grid.goal_at[k]);
    }
    if (detail == Detail::kAll)
      all[JointUnits(robot.model).name("q", 0)].push_back(goal < none ? Json(to.list[goal]) : Json(nullptr));
    // Motions take the goals in turn.
    const bool tried = goal < none && goal < h.motions;
    const double motions = tried ? static_cast<double>((h.motions - goal - 1) / none + 1) : 0;
    all["feasible_share"].push_back(tried ? Json(h.goals[goal].feasible / motions) : Json(nullptr));
    for (std::size_t term = 0; term < p.costs.size(); ++term) {
      const bool some = tried && h.goals[goal].feasible > 0;
      all[unit_of(p.costs[term].quantity)].push_back(some ? Json(h.goals[goal].least[term]) : Json(nullptr));
    }
  }
  return all;
}

/// Tells all motions to a sink.
class Rows {
 public:
  Rows(RowSink& sink, const Problem& p, std::size_t motions) : sink_(sink) {
    std::vector<std::string> names{"number", "T", "feasible", "kinematic", "torque"};
    for (const auto& cost : p.costs) names.emplace_back(unit_of(cost.quantity));
    const std::size_t n = p.robot.joints.size(), K = static_cast<std::size_t>(p.degree - 5);
    for (const char* q : {"q_from", "q_to"})
      for (std::size_t j = 1; j <= n; ++j) names.push_back(std::string(q) + "[" + std::to_string(j) + "]");
    for (std::size_t j = 1; j <= n; ++j)
      for (std::size_t k = 1; k <= K; ++k) names.push_back("c_r[" + std::to_string(j) + ";" + std::to_string(k) + "]");
    sink.begin(names, motions);
  }
  void add(const optimisation::Round& batch) {
    for (const Particle& p : batch.particles) {
      row_ = {static_cast<double>(p.number), p.T, p.feasible() ? 1.0 : 0.0, p.kinematic, p.torque};
      for (const auto* list : {&p.costs, &p.q_from, &p.q_to, &p.c}) row_.insert(row_.end(), list->begin(), list->end());
      sink_.row(row_);
    }
  }

 private:
  RowSink& sink_;
  std::vector<double> row_;
};

std::vector<optimisation::CostTerm> standard_costs(const Robot& robot) {
  std::vector<optimisation::CostTerm> terms;
  for (const Quantity q : {Quantity::kTime, Quantity::kTorque, Quantity::kWork, Quantity::kJerk}) terms.push_back({q, 1, {}});
  if (robot.energy) terms.push_back({Quantity::kEnergy, 1, {}});
  return terms;
}

}  // namespace

Json answer_grow(const Robot& robot, Reader& r, const Context& context) {
  const bool keeps_base = r.word("constraint", {"none", "base"}, "base: motions that do not turn a free base") == "base";
  if (keeps_base) return answer_grow_reactionless(robot, r, context);
  for (const char* name : {"base", "frame"}) r.only_if(r.describes(), name, "the constraint base");
  MoveRequest m = read_goal(robot, r, context, {.duration = false, .start = false}, false);
  const Detail detail = read_detail(r);
  std::vector<std::string> notes = m.notes;
  std::string weight;
  m.degree = r.integer("degree", 5, 31, 9, "of the polynomials");
  if (r.describes()) {
    (void)answer_grow_reactionless(robot, r, context);
    r.declare_one_of({"from_q_rad", "from_q_deg", "from_q", "from_postures", "from_box"});
    r.or_instead({"constraint"});
  }
  Problem p = read_problem(robot, m, r, standard_costs(robot), weight, notes);
  p.samples = static_cast<std::size_t>(r.integer("samples", 8, 1000, 50, "of the torques of a motion"));
  optimisation::GrowthOptions o;
  std::tie(o.motions, o.seed) = read_draws(r);
  o.device = read_device(r, "auto: a GPU for a million motions and more, if there is one");
  o.best = static_cast<std::size_t>(r.integer("best", 1, 1000, 3, "motions that are told of each cost"));
  const JointUnits units(robot.model);
  o.c_max = units.read(r, "c_r_max", 0, true,
                       "largest redundant coefficient, without it a tenth of the joint's largest displacement");
  std::optional<PostureSet> from = read_set(robot, r, "from", m.from_q), to = read_set(robot, r, "to", m.to_q);
  Grid grid;
  if (r.describes()) {
    r.declare("to_grid", Reader::schema_of([&](Reader& own) { read_grid(robot, own, grid); }), false,
              "in place of one posture: a grid of places that a frame reaches, as goals in turn");
    r.declare_one_of({"to_q_rad", "to_q_deg", "to_q", "to_postures", "to_box", "to_grid"});
    return {};
  }
  if (const Json* const given = r.any("to_grid")) {
    if (to) throw RequestError(r.pointer("to_grid"), "is given beside another goal, expected one of them");
    Reader own(*given, r.pointer("to_grid"));
    read_grid(robot, own, grid);
    to.emplace();
  }
  for (const auto& [end, set] : {std::pair{"from_q", &from}, {"to_q", &to}})
    if (!*set)
      throw RequestError(r.pointer(units.name(end, 0).c_str()),
                         "is missing, expected a posture, a list, a box or a grid of goals");
  if (!weight.empty()) throw RequestError(weight, "is given, but grow tells each cost for itself, expected no weights");
  for (const optimisation::CostTerm& term : p.costs)
    if (term.quantity == Quantity::kMass || term.quantity == Quantity::kSafety || optimisation::needs_compliance(term.quantity))
      throw RequestError("/cost", std::string("has ") + optimisation::to_text(term.quantity) +
                                      ", expected time, torque, work, shared_work, acceleration, jerk or energy");
  if (!r.gives("T_min_s")) throw RequestError("/T_min_s", "is missing, expected the shortest duration that is drawn");
  const std::size_t n = robot.model.joints.size();
  if (!o.c_max.empty() && o.c_max.size() != n)
    throw RequestError(r.pointer(units.name("c_r_max", 0).c_str()),
                       "has " + std::to_string(o.c_max.size()) + " values, expected " + std::to_string(n) + ", one per joint");
  for (std::size_t j = 0; j < o.c_max.size(); ++j)
    if (!(o.c_max[j] >= 0))
      throw RequestError(r.pointer(units.name("c_r_max", 0).c_str()) + "/" + std::to_string(j),
                         "is negative, expected 0 or more");
  std::vector<double> start(n);  // a posture of the beginning
  for (std::size_t j = 0; j < n; ++j)
    start[j] = from->list.empty() ? 0.5 * (from->low[j] + from->high[j]) : from->list.front()[j];
  const std::vector<double> rest(n);
  p.ends = {start, rest, rest, start, rest, rest};
  optimisation::check(p);
  if (!r.finish(context)) return {};

  if (!grid.places.empty()) to = goals_of(grid, p, start, context);
  const bool none = !grid.places.empty() && to->list.empty();
  if (none) o.motions = 0;
  std::optional<Rows> rows;
  if (context.rows) {
    rows.emplace(*context.rows, p, o.motions);
    o.on_batch = [&](const optimisation::Round& batch) { rows->add(batch); };
  }
  o.on_progress = percent_of(context, o.motions);
  if (o.c_max.empty() && !none) o.c_max = standard_ranges(*from, *to, n);
  o.from = std::move(*from);
  o.to = std::move(*to);
  optimisation::Harvest h;
  if (none) {
    h.costs.resize(p.costs.size());
    h.best.resize(p.costs.size());
  } else {
    h = optimisation::grow(p, o, context.threads);
  }
  const Json forbidden = forbidden_json(robot.model, h.forbidden, h.motions);
  std::string reason = "no place of the grid is reached within the bounds of position";
  if (h.feasible == 0 && !none) {
    const Json& most = forbidden[0];
    reason = "none of " + std::to_string(h.motions) + " motions keeps the bounds; " + most["bound"].get<std::string>() +
             " of joint " + most["joint"].get<std::string>() + " forbids " + most["motions"].dump();
  }
  Verdict verdict;
  verdict.add(none ? Of::kPoses : Of::kBounds, h.feasible > 0, reason);
  Json reply;
  verdict.tell(reply);
  reply["motions"] = h.motions;
  reply["feasible_motions"] = h.feasible;
  reply["forbidden"] = forbidden;
  for (std::size_t term = 0; term < p.costs.size(); ++term) {
    Json own = distribution_json(h.costs[term], detail);
    if (detail >= Detail::kMargins && !own.is_null()) own["best"] = motions_json(robot, p, h.best[term]);
    reply["costs"][unit_of(p.costs[term].quantity)] = own;
  }
  if (detail >= Detail::kMargins) {
    if (p.costs.size() > 1) reply["front"] = motions_json(robot, p, h.front);
    if (!grid.places.empty() || h.goals.size() > 1) reply["goals"] = goals_json(robot, p, o.to, h, grid, detail);
  }
  add_notes(reply, notes);
  tell_device(reply, h.device, h.rounding, h.not_device);
  return reply;
}

}  // namespace cotwin::services
