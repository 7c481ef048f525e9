#include "models/collision/meeting/meeting.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "models/collision/cell/cell.h"
#include "models/collision/meeting/sweep.h"
#include "models/foundation/support/text.h"
#include "models/scene/robot_links.h"

namespace cotwin::collision {
namespace {

constexpr double kFinest = 1e-6;                          // m
constexpr double kLeastError = 1e-4, kLeastShare = 1e-3;  // of the least distance: m, 1
constexpr int kGrid = 16;                                 // intervals at the beginning

}  // namespace

struct Checker::Impl {
  /// One robot in motion.
  struct Mover {
    const robot::RobotModel* model = nullptr;
    Pose X_WB;
    const Motion* motion = nullptr;
    bool first = false;                                    // of the robots
    std::vector<double> dq_max, ddq_max;                   // by joint; empty: it rests
    double at = std::numeric_limits<double>::quiet_NaN();  // s, at which its parts are
    std::vector<Pose> X_WL;
    std::vector<Twist> V_WL;
    double from = at, to = at;  // s, of `moved`
    std::vector<double> q, dq, dq_from, ddq, moved;

    void follow(const Motion& given);
    bool rests() const { return dq_max.empty(); }
    void find(double t);
    void find_moved(double from, double to);
  };

  PlacedCell given;
  double clearance;
  std::vector<std::string> notes;
  Cell cell;
  std::vector<const Tool*> tools;  // by part
  std::vector<Mover> movers;
  std::vector<Interval> stack;
  Nearest least;
  double least_over = scene::kInfinity;  // of the distance less the clearance

  /// Whether both are there from `from` to `to`.
  bool exists(const Pair& pair, double from, double to) const {
    return std::ranges::all_of(std::array{tools[pair.a], tools[pair.b]},
                               [&](const Tool* tool) { return tool == nullptr || (tool->from <= from && tool->until >= to); });
  }

  void place(const Pair& pair, double t) {
    for (const std::size_t k : {pair.a, pair.b}) {
      if (cell.parts[k].robot < 0) continue;
      Mover& mover = movers[static_cast<std::size_t>(cell.parts[k].robot)];
      if (mover.at == t || (mover.rests() && !std::isnan(mover.at))) continue;
      mover.from = mover.to = std::numeric_limits<double>::quiet_NaN();
      mover.find(mover.at = t);
      scene::place_links(*mover.model, mover.X_WB, mover.q, mover.dq, mover.X_WL, mover.V_WL);
      cell.place(cell.parts[k].robot, mover.X_WB, mover.X_WL);
    }
  }

  /// By how much the distance of a pair can change.
  double travel(const Pair& pair, double from, double to) {
    double travel = 0, reach = 0;
    for (const std::size_t k : {pair.a, pair.b}) {
      const Part& part = cell.parts[k];
      if (part.robot < 0) continue;
      Mover& mover = movers[static_cast<std::size_t>(part.robot)];
      mover.find_moved(from, to);
      if (!mover.rests()) travel += cell.travel(part, pair.common, mover.q, mover.moved, reach);
    }
    return travel;
  }

  double inflation(const Pair& pair) const { return pair.self ? 0 : given.r * (cell.parts[pair.a].robot < 0 ? 1 : 2); }

  Nearest nearest_of(const Pair& pair, double t, const Distance& found) const {
    const Part &a = cell.parts[pair.a], &b = cell.parts[pair.b];
    const double d = found.d - inflation(pair);
    const std::string& own = given.robots.front().robot.name;
    const auto name = [&](const Part& part) {
      return part.robot == 0 && !own.empty() ? part.name.substr(own.size() + 1) : part.name;
    };
    return a.robot == 0 ? Nearest{t, d, name(a), name(b), found.p_a, found.p_b}
                        : Nearest{t, d, name(b), name(a), found.p_b, found.p_a};
  }

  /// The distance at t less the clearance, or a lower bound that is at least `most`.
  double over(const Pair& pair, double t, double most) {
    const double needed = pair.self ? 0 : clearance + inflation(pair);
    place(pair, t);
    double bound = 0;
    const Distance found = cell.distance(pair, most + needed, bound);
    if (!pair.self && found.d - needed < least_over) {
      least_over = found.d - needed;
      least = nearest_of(pair, t, found);
    }
    return bound < most + needed ? bound - needed : std::max(bound - needed, most);  // which may be less by rounding
  }

  /// What is certainly enough: of the least distance, or to be clear. Links of the robot only must not touch.
  double enough(const Pair& pair) const {
    return pair.self ? 0 : std::max(0.0, least_over - std::max(kLeastError, kLeastShare * std::abs(least_over)));
  }

  bool meets(double begin, double end, bool again);
};

void Checker::Impl::Mover::follow(const Motion& given) {
  motion = &given;
  at = from = to = std::numeric_limits<double>::quiet_NaN();
  const std::size_t n = model->joints.size();
  q = given.q;
  for (auto* values : {&q, &dq, &dq_from, &ddq, &moved}) values->resize(n);
  std::ranges::fill(dq, 0.0);
  X_WL.resize(model->bodies.size());
  V_WL.resize(model->bodies.size());
  dq_max.clear();
  ddq_max.clear();
  for (std::size_t j = 0; j < given.path.joints(); ++j) {
    dq_max.push_back(std::abs(given.path.range(j, 1).largest().value));
    ddq_max.push_back(std::abs(given.path.range(j, 2).largest().value));
  }
}

/// q and dq at t, also of a motion that loops.
void Checker::Impl::Mover::find(double t) {
  if (rests()) return;
  const double T = motion->period, begin = motion->path.end() - T;
  bool back = false;
  if (motion->loop != Motion::Loop::kNo && t > begin + T) {
    const double cycles = std::floor((t - begin) / T);
    t -= cycles * T;
    back = motion->loop == Motion::Loop::kThereAndBack && std::fmod(cycles, 2) == 1;
  }
  motion->path.at(back ? 2 * begin + T - t : t, q, dq, ddq);
  for (double& speed : dq) speed = back ? -speed : speed;
}

/// Upper bounds of how far the joints move between two times, in `moved`; then q is that at the first one.
void Checker::Impl::Mover::find_moved(double begin, double end) {
  if (rests() || (from == begin && to == end)) return;
  from = begin;
  to = end;
  const double h = end - begin;
  find(end);
  dq_from.swap(dq);
  find(begin);
  for (std::size_t j = 0; j < moved.size(); ++j) {
    // Others may begin and end in between, with a speed.
    const double change = ddq_max[j] * (first ? h / 2 : h);
    moved[j] = h * std::min(dq_max[j], std::max(std::abs(dq[j]), std::abs(dq_from[j])) + change);
  }
}

/// From `begin` to `end`, between which no tool comes or goes; then `least` is the first time. `again`: what stands was passed before.
bool Checker::Impl::meets(double begin, double end, bool again) {
  std::vector<const Pair*> present;
  for (const Pair& pair : cell.pairs) {
    const bool stands = cell.parts[pair.a].robot < 0 || pair.self;
    if (exists(pair, begin, end) && !(again && stands)) present.push_back(&pair);
  }
  const auto time = [&](int k) { return begin + (end - begin) * k / kGrid; };
  // A good bound of the least distance first.
  for (int k = 0; k <= kGrid; ++k)
    for (const Pair* pair : present)
      if (!pair->self) (void)over(*pair, time(k), least_over);
  constexpr SweepLimits kLimits{kFinest, std::numeric_limits<int>::max(), true};
  std::vector<double> travels(present.size()), d_from(present.size());
  for (int k = 0; k < kGrid; ++k) {
    const double from = time(k), to = time(k + 1);
    for (std::size_t i = 0; i < present.size(); ++i) travels[i] = travel(*present[i], from, to);
    for (std::size_t i = 0; i < present.size(); ++i) d_from[i] = over(*present[i], from, enough(*present[i]) + travels[i]);
    double first = scene::kInfinity, deepest = 0;
    const Pair* meeting = nullptr;
    for (std::size_t i = 0; i < present.size(); ++i) {
      const Pair& pair = *present[i];
      const Interval whole{from, to, d_from[i], over(pair, to, enough(pair) + travels[i])};
      if ((whole.d_from + whole.d_to - travels[i]) / 2 >= enough(pair)) continue;
      const Least found = least_distance(
          whole, kLimits, stack, [&](double t, double enough) { return over(pair, t, enough); },
          [&](double t_from, double t_to) { return travel(pair, t_from, t_to); }, [&](double) { return enough(pair); });
      if (!found.meets || found.t > first || (found.t == first && found.d >= deepest)) continue;
      first = found.t;
      deepest = found.d;
      meeting = &pair;
    }
    if (meeting == nullptr) continue;
    place(*meeting, first);
    double unused = 0;
    least = nearest_of(*meeting, first, cell.distance(*meeting, scene::kInfinity, unused));
    return true;
  }
  return false;
}

Checker::~Checker() = default;
const std::vector<std::string>& Checker::notes() const { return impl_->notes; }

Checker::Checker(PlacedCell given, const Options& options) : impl_(std::make_unique<Impl>()) {
  Impl& all = *impl_;
  all.given = std::move(given);
  all.clearance = options.clearance;
  std::vector<std::string> moving, open, absent;
  for (const PlacedCell::Body& body : all.given.bodies) {
    Part& part = all.cell.add(body.body);
    if (body.scale != 1) {
      const Body unscaled = part.body;
      part.body.set_scaled(unscaled, body.scale);
      all.cell.place(part, body.body.X_WB);
    }
    part.present = body.present;
    if (part.moves || body.moves) moving.push_back(part.name);
    if (part.body.open()) open.push_back(part.name);
    if (!part.present) absent.push_back(part.name);
    part.moves = body.moves;
  }
  for (const PlacedCell::Cloud& cloud : all.given.clouds)
    all.cell.place(all.cell.add(cloud.name, cloud.points, cloud.radius), cloud.X_WC);
  for (const PlacedCell::Robot& robot : all.given.robots) {
    std::string without = all.cell.add(robot.robot, false);
    all.tools.resize(all.cell.parts.size());
    for (const Tool& tool : robot.tools) {
      all.cell.add_tool(tool.name, tool.shapes, tool.link);
      all.tools.push_back(&tool);
      const Part& part = all.cell.parts.back();
      if (part.body.empty()) without += (without.empty() ? "no shapes of " : ", ") + part.name;
    }
    const std::span<Part> parts = all.cell.of(static_cast<int>(all.movers.size()));
    const std::size_t prefix = robot.robot.name.empty() ? 0 : robot.robot.name.size() + 1;
    for (Part& part : parts)
      if (robot.alias) part.alias = *robot.alias + parts[static_cast<std::size_t>(part.link + 1)].name.substr(prefix);
    if (!without.empty()) all.notes.push_back(without + ", which meet nothing");
    if (robot.floats) moving.push_back("the base of " + robot.robot.name);
    Impl::Mover& mover = all.movers.emplace_back();
    mover.model = &robot.robot.model;
    mover.X_WB = robot.X_WB;
    mover.first = all.movers.size() == 1;
  }
  if (!open.empty()) all.notes.push_back("not closed, so that nothing counts as inside: " + text::joined(open));
  if (!absent.empty()) all.notes.push_back("not there at the start, so that nothing meets it: " + text::joined(absent));
  if (!moving.empty()) all.notes.push_back("may move in the run, and are taken where they start: " + text::joined(moving));
  all.cell.find_pairs(all.given.ignore, all.given.ignore_checked);
  std::erase_if(all.cell.pairs, [&](const Pair& pair) {
    const bool own = all.cell.parts[pair.a].robot == 0 || all.cell.parts[pair.b].robot == 0;
    return !own || (pair.self && !options.self) || !all.cell.parts[pair.a].present;
  });
}

Verdict Checker::check(std::span<const Motion> motions, double until) {
  Impl& all = *impl_;
  for (std::size_t r = 0; r < motions.size(); ++r) all.movers[r].follow(motions[r]);
  all.least = {};
  all.least_over = scene::kInfinity;
  const trajectory::Path& own = motions.front().path;
  const double begin = own.joints() > 0 ? own.begin() : 0, once = own.joints() > 0 ? own.end() : 0;
  double end = motions.front().loop == Motion::Loop::kNo ? once : std::max(once, until);
  std::vector<double> times{begin, once}, comes;
  for (const PlacedCell::Robot& robot : all.given.robots) {
    for (const Tool& tool : robot.tools) {
      if (tool.from < scene::kInfinity) end = std::max(end, tool.from);
      times.insert(times.end(), {tool.from, tool.until});
      comes.push_back(tool.from);
    }
  }
  std::erase_if(times, [&](double t) { return t < begin || t > end; });
  times.push_back(end);
  std::ranges::sort(times);
  times.erase(std::unique(times.begin(), times.end()), times.end());
  const bool comes_last = std::ranges::find(comes, end) != comes.end();
  if (times.size() == 1 || comes_last) times.push_back(end);  // a moment of its own
  for (std::size_t i = 0; i + 1 < times.size(); ++i) {
    const bool again = times[i] >= once && times[i] > begin && all.given.robots.front().tools.empty();
    if (all.meets(times[i], times[i + 1], again)) return {false, all.least};
  }
  return {true, all.least};
}

}  // namespace cotwin::collision
