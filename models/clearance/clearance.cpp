#include "models/clearance/clearance.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "models/distance/distance.h"
#include "models/distance/name_pair.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/robot_links.h"

namespace cotwin::clearance {
namespace {

using Eigen::Vector3d;

constexpr double kFinest = 1e-6;                          // m: intervals with less way are not divided
constexpr double kLeastError = 1e-4, kLeastShare = 1e-3;  // of the least distance: m, 1
constexpr int kGrid = 16;                                 // intervals at the beginning

/// The largest speed and acceleration of a joint, rad/s and rad/s² or m/s and m/s².
struct Fastest {
  double dq = 0, ddq = 0;
};

}  // namespace

struct Checker::Impl {
  struct Part {
    Part(std::string part_name, std::span<const scene::Shape> shapes) : name(std::move(part_name)), solid(shapes) {}
    std::string name;
    distance::Solid solid;
    int robot = -1, link = -1;  // −1: a body of the scene; the base
    Pose X_WB;                  // of what stands
    const Tool* tool = nullptr;
  };
  struct Pair {
    std::size_t a, b;  // a: of the first robot
    double clearance;
    bool self;  // both are
  };
  /// All poses at a time.
  struct Instant {
    double t = 0;
    std::vector<std::vector<double>> q, dq;  // by robot
    std::vector<Pose> X_W;                   // by part
    std::vector<Vector3d> middle;            // of the ball around its shapes, in W
  };
  /// A pair that is not decided in an interval, with lower bounds of the distance at its ends, less the clearance.
  struct Open {
    std::size_t pair;
    double from, to, way = 0;  // way: in the last interval
  };

  std::vector<Stand> robots;
  std::vector<std::size_t> first;  // part of the base of each robot
  std::vector<Part> parts;
  std::vector<Pair> pairs;
  std::vector<std::string> notes;
  distance::Finder finder;

  std::span<const Motion> motions;
  std::vector<std::vector<Fastest>> fastest;    // by robot and joint; empty: it rests
  std::vector<std::vector<double>> joint_ways;  // by robot and joint, in an interval, rad or m
  std::vector<double> ways;                     // by part, in an interval, m
  Nearest least;
  double least_over = scene::kInfinity;  // of d − clearance

  void add(const std::string& name, std::span<const scene::Shape> shapes, int robot, int link, const Pose& X_WB) {
    try {
      parts.emplace_back(name, shapes);
    } catch (const Error& error) {
      throw Error("'" + name + "'", error.what());
    }
    parts.back().robot = robot;
    parts.back().link = link;
    parts.back().X_WB = X_WB;
    finder.reserve(parts.back().solid);
  }

  std::size_t part(const std::string& name) const {
    const auto found = std::ranges::find(parts, name, &Part::name);
    if (found != parts.end()) return static_cast<std::size_t>(found - parts.begin());
    std::vector<std::string> names;
    for (const Part& one : parts) names.push_back(one.name);
    const std::string near = text::closest(name, names);
    throw Error("ignore", "'" + name + "' is no link and no body" + (near.empty() ? "" : ", did you mean '" + near + "'?"));
  }

  void add_pairs(const Options& options) {
    std::vector<std::pair<std::size_t, std::size_t>> without;
    for (const std::string& item : options.ignore) {
      const auto is_known = [&](const std::string& name) { return std::ranges::find(parts, name, &Part::name) != parts.end(); };
      const auto [one, other] = distance::two_names(item, is_known);
      if (other.empty()) throw Error("ignore", "'" + item + "', expected two names as in link_5:table");
      without.emplace_back(std::minmax<std::size_t>(part(one), part(other)));
    }
    const robot::RobotModel& model = robots.front().robot.model;
    for (std::size_t a = 0; a < parts.size() && parts[a].robot == 0; ++a) {
      for (std::size_t b = 0; b < parts.size(); ++b) {
        const Part &link = parts[a], &other = parts[b];
        if (link.solid.empty() || other.solid.empty()) continue;
        if (std::ranges::find(without, std::pair(std::min(a, b), std::max(a, b))) != without.end()) continue;
        if (other.robot == 0) {
          const auto parent = [&](const Part& one) { return one.link < 0 ? -2 : model.joint_of(one.link).parent; };
          const bool near = link.tool != nullptr || other.tool != nullptr
                                ? link.link == other.link
                                : parent(link) == other.link || parent(other) == link.link;
          if (options.self && a < b && !near) pairs.push_back({a, b, 0, true});
        } else if (link.link >= 0 || other.link >= 0) {
          pairs.push_back({a, b, options.clearance, false});
        }
      }
    }
  }

  /// The state of a motion at t, also of one that loops.
  static void follow(const Motion& motion, double t, std::vector<double>& q, std::vector<double>& dq,
                     std::vector<double>& ddq) {
    const double T = motion.period, begin = motion.path.end() - T;
    bool back = false;
    if (motion.loop != Motion::Loop::kNo && t > begin + T) {
      const double cycles = std::floor((t - begin) / T);
      t -= cycles * T;
      back = motion.loop == Motion::Loop::kThereAndBack && std::fmod(cycles, 2) == 1;
    }
    motion.path.at(back ? 2 * begin + T - t : t, q, dq, ddq);
    if (back)
      for (double& speed : dq) speed = -speed;
  }

  Instant at(double t) const {
    Instant now;
    now.t = t;
    now.q.resize(robots.size());
    now.dq.resize(robots.size());
    now.X_W.resize(parts.size());
    now.middle.resize(parts.size());
    std::vector<double> ddq;
    std::vector<Pose> X_WL;
    std::vector<Twist> V_WL;
    for (std::size_t r = 0; r < robots.size(); ++r) {
      const robot::RobotModel& model = robots[r].robot.model;
      const Motion& motion = motions[r];
      now.q[r] = motion.q;
      now.q[r].resize(model.joints.size());
      now.dq[r].resize(model.joints.size());
      ddq.resize(model.joints.size());
      if (motion.path.joints() > 0) follow(motion, t, now.q[r], now.dq[r], ddq);
      X_WL.resize(model.bodies.size());
      V_WL.resize(model.bodies.size());
      scene::place_links(model, robots[r].X_WB, now.q[r], now.dq[r], X_WL, V_WL);
      for (std::size_t i = 0; i < X_WL.size(); ++i) now.X_W[first[r] + 1 + i] = X_WL[i];
    }
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const Part& part = parts[i];
      now.X_W[i] = part.link < 0
                       ? part.X_WB
                       : now.X_W[first[static_cast<std::size_t>(part.robot)] + 1 + static_cast<std::size_t>(part.link)];
      now.middle[i] = now.X_W[i] * parts[i].solid.middle();
    }
    return now;
  }

  /// An upper bound of the way of the points of a link relative to the link `from` that carries it (−1: the base) in an interval: of each joint
  /// in between, its way times the longest lever that it can have.
  double way_of(const Part& part, int from, const Instant& begin) const {
    const auto r = static_cast<std::size_t>(part.robot);
    const robot::RobotModel& model = robots[r].robot.model;
    double reach = part.solid.reach(), way = 0;
    for (int link = part.link; link != from; link = model.joint_of(link).parent) {
      const robot::Joint& joint = model.joint_of(link);
      const auto body = static_cast<std::size_t>(link);
      const double moved =
          std::abs(scene::rate_of(model, body)) * joint_ways[r][static_cast<std::size_t>(model.leader_of(link))];
      const bool turns = joint.type == robot::JointType::kRevolute;
      way += moved * (turns ? reach : 1);
      reach += joint.X_PJ.p.norm();
      if (!turns) reach += std::abs(scene::position_of(model, body, begin.q[r])) + moved;
    }
    return way;
  }

  /// Upper bounds of the ways of joints and parts between two instants.
  void find_ways(const Instant& from, const Instant& to) {
    const double h = to.t - from.t;
    for (std::size_t r = 0; r < robots.size(); ++r) {
      for (std::size_t j = 0; j < fastest[r].size(); ++j) {
        // Others may begin and end in between, with a speed.
        const double change = fastest[r][j].ddq * (r == 0 ? h / 2 : h);
        const double speed = std::max(std::abs(from.dq[r][j]), std::abs(to.dq[r][j])) + change;
        joint_ways[r][j] = h * std::min(fastest[r][j].dq, speed);
      }
    }
    for (std::size_t i = 0; i < parts.size(); ++i)
      ways[i] = parts[i].link < 0 || fastest[static_cast<std::size_t>(parts[i].robot)].empty() ? 0 : way_of(parts[i], -1, from);
  }

  /// By how much the distance of a pair can change in the interval of find_ways().
  double way_of(const Pair& pair, const Instant& from) const {
    if (!pair.self) return ways[pair.a] + ways[pair.b];
    // Only the joints between the two links move them relative to each other.
    const robot::RobotModel& model = robots.front().robot.model;
    const auto carries = [&](int ancestor, int link) {
      while (link >= 0 && link != ancestor) link = model.joint_of(link).parent;
      return link == ancestor;
    };
    int common = parts[pair.a].link;
    while (common >= 0 && !carries(common, parts[pair.b].link)) common = model.joint_of(common).parent;
    return fastest.front().empty() ? 0 : way_of(parts[pair.a], common, from) + way_of(parts[pair.b], common, from);
  }

  /// Whether both are there from `from` to `to`.
  bool exists(const Pair& pair, double from, double to) const {
    return std::ranges::all_of(std::array{parts[pair.a].tool, parts[pair.b].tool},
                               [&](const Tool* tool) { return tool == nullptr || (tool->from <= from && tool->until >= to); });
  }

  /// From `begin` to `end`, between which no tool comes or goes. `again`: what stands was passed before.
  bool meets(double begin, double end, bool again) {
    std::vector<std::size_t> present;
    for (std::size_t k = 0; k < pairs.size(); ++k)
      if (exists(pairs[k], begin, end) && !(again && parts[pairs[k].b].robot <= 0)) present.push_back(k);
    if (present.empty()) return false;
    std::vector<Instant> grid;
    for (int k = 0; k <= kGrid; ++k) grid.push_back(at(begin + (end - begin) * k / kGrid));
    // A good bound of the least distance first.
    for (const Instant& now : grid)
      for (const std::size_t k : present)
        if (!pairs[k].self) (void)over(k, now, least_over);
    std::vector<Open> open;
    for (int i = 0; i < kGrid; ++i) {
      const Instant &from = grid[static_cast<std::size_t>(i)], &to = grid[static_cast<std::size_t>(i) + 1];
      find_ways(from, to);
      open.clear();
      for (const std::size_t k : present) {
        const double most = enough(pairs[k]) + way_of(pairs[k], from);
        open.push_back({k, over(k, from, most), over(k, to, most)});
      }
      if (meets(from, to, open)) return true;
    }
    return false;
  }

  Nearest nearest_of(const Pair& pair, double t, const distance::Distance& way) const {
    return {t, way.d, parts[pair.a].name, parts[pair.b].name, way.p_a, way.p_b};
  }

  /// The distance less the clearance, or a lower bound that is at least `most`.
  double over(std::size_t k, const Instant& now, double most) {
    const Pair& pair = pairs[k];
    const distance::Solid &a = parts[pair.a].solid, &b = parts[pair.b].solid;
    const double balls = (now.middle[pair.b] - now.middle[pair.a]).norm() - a.radius() - b.radius() - pair.clearance;
    if (balls > most) return balls;
    const distance::Distance way = finder.find(a, now.X_W[pair.a], b, now.X_W[pair.b], most + pair.clearance);
    if (!(way.d < scene::kInfinity)) return most;
    if (!pair.self && way.d - pair.clearance < least_over) {
      least_over = way.d - pair.clearance;
      least = nearest_of(pair, now.t, way);
    }
    return way.d - pair.clearance;
  }

  /// What is certainly enough: of the least distance, or to be clear. Links of the robot only must not touch.
  double enough(const Pair& pair) const {
    if (pair.self) return 0;
    const double error = std::max(kLeastError, kLeastShare * std::abs(least_over));
    return std::max(0.0, least_over - error);
  }

  /// Whether one of the pairs is not clear in an interval; then `least` is the first time.
  bool meets(const Instant& from, const Instant& to, const std::vector<Open>& open) {
    find_ways(from, to);
    std::vector<Open> left;
    double longest = 0;
    for (const Open& one : open) {
      const double way = way_of(pairs[one.pair], from);
      if ((one.from + one.to - way) / 2 >= enough(pairs[one.pair])) continue;
      left.push_back({one.pair, one.from, one.to, way});
      longest = std::max(longest, way);
    }
    if (left.empty()) return false;
    if (longest <= kFinest || !(to.t - from.t > 1e-12 * (1 + std::abs(to.t)))) {
      const auto nearest = std::ranges::min_element(left, {}, &Open::from);
      const Pair& pair = pairs[nearest->pair];
      least =
          nearest_of(pair, from.t, finder.find(parts[pair.a].solid, from.X_W[pair.a], parts[pair.b].solid, from.X_W[pair.b]));
      return true;
    }
    const Instant middle = at((from.t + to.t) / 2);
    std::vector<Open> before, after;
    for (const Open& one : left) {
      const double d = over(one.pair, middle, enough(pairs[one.pair]) + one.way);
      before.push_back({one.pair, one.from, d});
      after.push_back({one.pair, d, one.to});
    }
    return meets(from, middle, before) || meets(middle, to, after);
  }
};

Checker::~Checker() = default;
const std::vector<std::string>& Checker::notes() const { return impl_->notes; }

Checker::Checker(const scene::Scene& scene, std::vector<Stand> robots, const Options& options)
    : impl_(std::make_unique<Impl>()) {
  Impl& all = *impl_;
  all.robots = std::move(robots);
  std::size_t count = scene.bodies.size();
  for (const Stand& stand : all.robots) count += stand.robot.shapes.size() + stand.tools.size();
  all.parts.reserve(count);
  for (std::size_t r = 0; r < all.robots.size(); ++r) {
    const Stand& stand = all.robots[r];
    all.first.push_back(all.parts.size());
    const std::string prefix = stand.robot.name.empty() ? "" : stand.robot.name + "/";
    std::string bare;
    for (std::size_t i = 0; i < stand.robot.shapes.size(); ++i) {
      const std::string& link = i == 0 ? stand.robot.model.base.name : stand.robot.model.bodies[i - 1].name;
      const std::string name = prefix + (link.empty() ? "base" : link);
      all.add(name, stand.robot.shapes[i], static_cast<int>(r), static_cast<int>(i) - 1, stand.X_WB);
      if (all.parts.back().solid.empty()) text::append(bare, name);
    }
    const bool has_shapes = std::any_of(all.parts.begin() + static_cast<std::ptrdiff_t>(all.first.back()), all.parts.end(),
                                        [](const Impl::Part& part) { return !part.solid.empty(); });
    if (!has_shapes)
      throw Error("robot '" + stand.robot.model.name + "'",
                  "has no shapes, so nothing can be said of collisions: scripts/capsules.py encloses its meshes in a file with "
                  "hulls beside the URDF");
    for (const Tool& tool : stand.tools) {
      all.add(prefix + tool.name, tool.shapes, static_cast<int>(r), tool.link, stand.X_WB);
      all.parts.back().tool = &tool;
      if (all.parts.back().solid.empty()) text::append(bare, prefix + tool.name);
    }
    if (!bare.empty()) all.notes.push_back("no shapes of " + bare + ", which meet nothing");
  }
  std::string moving, open;
  for (const scene::Body& body : scene.bodies) {
    all.add(body.name, body.shapes, -1, -1, body.X_WB);
    if (body.motion != scene::Motion::kStatic) text::append(moving, body.name);
    if (all.parts.back().solid.open()) text::append(open, body.name);
  }
  if (!open.empty()) all.notes.push_back("not closed, so that nothing counts as inside: " + open);
  if (!moving.empty()) all.notes.push_back("taken to stand where the scene has them: " + moving);
  all.add_pairs(options);
  all.ways.resize(all.parts.size());
}

Verdict Checker::check(std::span<const Motion> motions, double until) {
  Impl& all = *impl_;
  all.motions = motions;
  all.fastest.assign(motions.size(), {});
  all.joint_ways.resize(motions.size());
  for (std::size_t r = 0; r < motions.size(); ++r) {
    all.joint_ways[r].resize(all.robots[r].robot.model.joints.size());
    const trajectory::Path& path = motions[r].path;
    for (std::size_t j = 0; j < path.joints(); ++j)
      all.fastest[r].push_back({std::abs(path.range(j, 1).largest().value), std::abs(path.range(j, 2).largest().value)});
  }
  all.least = {};
  all.least_over = scene::kInfinity;
  const trajectory::Path& own = motions.front().path;
  const double begin = own.joints() > 0 ? own.begin() : 0, once = own.joints() > 0 ? own.end() : 0;
  const std::vector<Tool>& tools = all.robots.front().tools;
  double end = motions.front().loop == Motion::Loop::kNo ? once : std::max(once, until);
  std::vector<double> times{begin, once}, comes;
  for (const Stand& stand : all.robots) {
    for (const Tool& tool : stand.tools) {
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
    const bool again = times[i] >= once && times[i] > begin && tools.empty();
    if (all.meets(times[i], times[i + 1], again)) return {false, all.least};
  }
  return {true, all.least};
}

}  // namespace cotwin::clearance
