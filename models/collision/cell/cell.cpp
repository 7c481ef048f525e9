#include "models/collision/cell/cell.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/robot_links.h"

namespace cotwin::collision {
namespace {

/// The names in "link_5:table", of which each may have colons itself: those that are known, otherwise those beside the first colon. The second one
/// is empty without a colon.
template <class IsKnown>
std::pair<std::string, std::string> two_names(std::string_view pair, const IsKnown& is_known) {
  std::pair<std::string, std::string> first{text::trim(pair), ""};
  for (std::size_t colon = pair.find(':'); colon != std::string_view::npos; colon = pair.find(':', colon + 1)) {
    std::pair<std::string, std::string> names{text::trim(pair.substr(0, colon)), text::trim(pair.substr(colon + 1))};
    if (is_known(names.first) && is_known(names.second)) return names;
    if (first.second.empty()) first = names;
  }
  return first;
}

int parent_of(const robot::RobotModel& model, int link) { return link < 0 ? -2 : model.joint_of(link).parent; }

/// Links that a joint connects; a tool and what is on the same link.
bool are_neighbours(const robot::RobotModel& model, const Part& a, const Part& b) {
  if (a.tool || b.tool) return a.link == b.link;
  return parent_of(model, a.link) == b.link || parent_of(model, b.link) == a.link;
}

/// The body that carries both, −1: the base.
int common_of(const robot::RobotModel& model, int a, int b) {
  const auto carries = [&](int one, int other) {
    while (other >= 0 && other != one) other = parent_of(model, other);
    return other == one;
  };
  while (a >= 0 && !carries(a, b)) a = parent_of(model, a);
  return a;
}

}  // namespace

Part& Cell::add(const std::string& name, std::span<const scene::Shape> shapes, int robot, int link) {
  try {
    return add(name, Body(shapes), robot, link);
  } catch (const Error& error) {
    throw Error("body '" + name + "'", error.what());
  }
}

Part& Cell::add(const std::string& name, Body body, int robot, int link) {
  parts.push_back({.name = name, .body = std::move(body), .robot = robot, .link = link, .X_W = {}});
  finder_.reserve(parts.back().body);
  return parts.back();
}

Part& Cell::add(const std::string& name, std::shared_ptr<const cloud::Tree> points, double ball) {
  if (std::ranges::find(parts, name, &Part::name) != parts.end())
    throw Error("scene", "has a body '" + name + "', expected another name for it: so the point cloud is called");
  return add(name, Body(std::move(points), ball), -1, -1);
}

void Cell::add(const scene::Scene& scene) {
  for (const scene::Body& body : scene.bodies) add(body);
}

Part& Cell::add(const scene::Body& body) {
  Part& part = add(body.name, body.shapes, -1, -1);
  part.moves = body.motion != scene::Motion::kStatic;
  place(part, body.X_WB);
  return part;
}

std::string Cell::add(const scene::PlacedRobot& robot, bool floats) {
  const std::string prefix = robot.name.empty() ? "" : robot.name + "/";
  const int number = static_cast<int>(robots_.size());
  robots_.push_back({&robot, parts.size(), parts.size()});
  std::string bare;
  for (std::size_t i = 0; i < robot.shapes.size(); ++i) {
    const std::string& name = i == 0 ? robot.model.base.name : robot.model.bodies[i - 1].name;
    Part& part = add(prefix + (name.empty() ? "base" : name), robot.shapes[i], number, static_cast<int>(i) - 1);
    part.moves = i > 0 || floats;
    if (part.body.empty()) text::append(bare, part.name);
  }
  robots_.back().end = parts.size();
  if (std::ranges::all_of(of(number), [](const Part& part) { return part.body.empty(); }))
    throw Error("robot '" + robot.model.name + "'",
                "has no shapes, so nothing can be said of collisions: scripts/capsules.py encloses its meshes in a file with "
                "hulls beside the URDF, or give its links <collision> and a unit robot_shapes=all");
  return bare.empty() ? "" : "no shapes of " + bare;
}

void Cell::add_tool(const std::string& name, std::span<const scene::Shape> shapes, int link) {
  Robot& robot = robots_.back();
  const std::string prefix = robot.placed->name.empty() ? "" : robot.placed->name + "/";
  Part& part = add(prefix + name, shapes, static_cast<int>(robots_.size()) - 1, link);
  part.tool = true;
  part.moves = link >= 0;
  robot.end = parts.size();
}

std::span<Part> Cell::of(int robot) {
  const Robot& own = robots_[static_cast<std::size_t>(robot)];
  return std::span(parts).subspan(own.first, own.end - own.first);
}

void Cell::find_pairs(std::span<const std::string> ignore, bool checked) {
  const auto is = [checked](const Part& part, const std::string& name) {
    return checked && part.robot >= 0 ? part.alias == name : part.name == name;
  };
  const auto is_known = [&](const std::string& name) {
    return std::ranges::any_of(parts, [&](const Part& part) { return is(part, name); });
  };
  std::vector<std::pair<std::string, std::string>> without;
  for (const std::string& item : ignore) {
    without.push_back(two_names(item, is_known));
    const auto& [one, other] = without.back();
    if (other.empty()) throw Error("ignore", "'" + item + "', expected two names as in link_5:table");
    for (const std::string& name : {one, other}) {
      if (checked || is_known(name)) continue;
      std::vector<std::string> names;
      for (const Part& part : parts) names.push_back(part.name);
      const std::string near = text::closest(name, names);
      throw Error("ignore", "'" + name + "' is no link and no body" + (near.empty() ? "" : ", did you mean '" + near + "'?"));
    }
  }
  for (std::size_t b = 0; b < parts.size(); ++b) {
    for (std::size_t a = 0; a < b && parts[b].robot >= 0; ++a) {
      const Part &one = parts[a], &other = parts[b];
      const bool self = one.robot == other.robot;
      if (one.body.empty() || other.body.empty() || (!one.moves && !other.moves)) continue;
      const auto is_named = [&](const auto& names) {
        return (is(one, names.first) && is(other, names.second)) || (is(one, names.second) && is(other, names.first));
      };
      if (std::ranges::any_of(without, is_named)) continue;
      if (self && are_neighbours(model(other.robot), one, other)) continue;
      pairs.push_back({a, b, self, self ? common_of(model(other.robot), one.link, other.link) : -1});
    }
  }
}

void Cell::place(Part& part, const Pose& X_W) {
  part.X_W = X_W;
  part.middle = X_W * part.body.middle();
}

void Cell::place(int robot, const Pose& X_WB, std::span<const Pose> X_WL) {
  for (Part& part : of(robot)) place(part, part.link < 0 ? X_WB : X_WL[static_cast<std::size_t>(part.link)]);
}

Distance Cell::distance(const Pair& pair, double most, double& bound) {
  const Part &a = parts[pair.a], &b = parts[pair.b];
  bound = (b.middle - a.middle).norm() - a.body.radius() - b.body.radius();
  if (bound > most) return {};
  const Distance found = finder_.find(a.body, a.X_W, b.body, b.X_W, most);
  bound = std::min(found.d, most);
  return found;
}

std::size_t Cell::drop_near(cloud::Cloud& cloud, double most) {
  const std::size_t before = cloud.points.size();
  const Eigen::Vector3d origin = cloud.origin;
  const auto tree = std::make_shared<const cloud::Tree>(std::move(cloud));
  const Body points(tree, 0);
  std::vector<char> near(before, 0);
  finder_.reserve(points);
  for (const Part& part : parts)
    if (part.robot >= 0 && !part.body.empty()) finder_.find_near(part.body, part.X_W, points, {}, most, near);
  cloud = {origin, {}};
  for (std::size_t k = 0; k < before; ++k)
    if (near[k] == 0) cloud.points.push_back(tree->cloud().points[k]);
  return before - cloud.points.size();
}

double Cell::travel(const Part& part, int from, std::span<const double> q, std::span<const double> moved, double& reach) const {
  const robot::RobotModel& robot = model(part.robot);
  double travel = 0;
  const auto of_body = [&](std::size_t body) {
    return std::abs(scene::rate_of(robot, body)) * moved[static_cast<std::size_t>(robot.leader_of(static_cast<int>(body)))];
  };
  reach = for_each_lever(
      robot, part.link, from, part.body.reach(),
      [&](std::size_t body, const robot::Joint&) { return std::abs(scene::position_of(robot, body, q)) + of_body(body); },
      [&](std::size_t body, const robot::Joint&, double lever) { travel += of_body(body) * lever; });
  return travel;
}

}  // namespace cotwin::collision
