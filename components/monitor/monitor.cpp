#include "components/monitor/monitor.h"

#include <algorithm>
#include <cmath>

#include "components/monitor/parts.h"
#include "models/distance/name_pair.h"
#include "models/foundation/support/error.h"
#include "models/mechanics/pose_values.h"
#include "models/scene/robot_links.h"

namespace cotwin::monitor {
namespace {

using Eigen::Vector3d;

Eigen::Map<const Vector3d> vector3(const std::vector<double>& v) { return Eigen::Map<const Vector3d>(v.data()); }

}  // namespace

Monitor::Monitor(Settings& settings)
    : place_(settings.unit()),
      cell_(settings.cell()),
      floating_(settings.choice("base") == "floating"),
      separates_(!settings.text("separation").empty()),
      all_(std::make_unique<Ports>()) {
  if (cell_.robots.empty()) throw Error(place_, "has no robot to watch, expected the setting robot or robots");
  const auto add_part = [&](const std::string& name, std::span<const scene::Shape> shapes) -> Part& {
    try {
      parts_.push_back(std::make_unique<Part>(name, shapes));
    } catch (const Error& error) {
      throw Error(place_ + ", body '" + name + "'", error.what());
    }
    finder_.reserve(parts_.back()->solid);
    return *parts_.back();
  };
  for (const scene::Body& body : cell_.scene.bodies) {
    auto made = std::make_unique<Body>();
    made->prefix = text::identifier(body.name) + ".";
    made->part = parts_.size();
    made->pose.p = {body.X_WB.p.x(), body.X_WB.p.y(), body.X_WB.p.z()};
    put_quaternion(body.X_WB.R, made->pose.quat);
    Part& part = add_part(body.name, body.shapes);
    part.moves = body.motion != scene::Motion::kStatic;
    if (part.solid.open()) settings.warn("body '" + body.name + "' is not closed, so that nothing counts as inside it");
    bodies_.push_back(std::move(made));
  }
  add_obstacles(settings.text("obstacles"));
  for (const scene::PlacedRobot& placed : cell_.robots) {
    auto robot = std::make_unique<Robot>(placed);
    robot->first = parts_.size();
    const std::string prefix = placed.name.empty() ? "" : placed.name + "/";
    std::string bare;
    bool has_shapes = false;
    for (std::size_t i = 0; i < placed.shapes.size(); ++i) {
      const std::string& name = i == 0 ? placed.model.base.name : placed.model.bodies[i - 1].name;
      Part& part = add_part(prefix + (name.empty() ? "base" : name), placed.shapes[i]);
      part.robot = static_cast<int>(robots_.size());
      part.link = static_cast<int>(i) - 1;
      part.moves = i > 0 || floating_;
      has_shapes = has_shapes || !part.solid.empty();
      if (part.solid.empty()) text::append(bare, part.name);
    }
    const std::string which = "robot '" + placed.model.name + "'";
    if (!has_shapes)
      throw Error(place_, which +
                              " has no shapes, so it has no distance: scripts/capsules.py encloses its meshes in a file "
                              "with hulls beside the URDF, or give its links <collision> and robot_shapes=all");
    if (!bare.empty()) settings.warn(which + ": no shapes of " + bare + ", whose distance is not watched");
    robots_.push_back(std::move(robot));
  }
  nearest_.resize(groups());
  least_.resize(groups());
  add_pairs(settings.text("ignore"));
  bounds_.resize(pairs_.size());
  if (separates_) add_separation(settings);
  constexpr std::size_t kIntervals = 256;
  intervals_.reserve(kIntervals);
}

Monitor::~Monitor() = default;

std::size_t Monitor::part(const std::string& name, const std::string& ignored) const {
  const auto found = std::ranges::find(parts_, name, [](const auto& part) -> const std::string& { return part->name; });
  if (found != parts_.end()) return static_cast<std::size_t>(found - parts_.begin());
  std::vector<std::string> names;
  for (const auto& part : parts_) names.push_back(part->name);
  const std::string near = text::closest(name, names);
  throw Error(place_, "ignore=" + ignored + ": no body '" + name + "'" +
                          (near.empty() ? "" : ", did you mean '" + near + "'?") + ", expected name:name,name:name");
}

/// The bodies of the scene that a setting names, name,name.
std::vector<Monitor::Body*> Monitor::bodies_of(const std::string& setting, const std::string& names) const {
  std::vector<Body*> bodies;
  for (const std::string_view item : text::split(names, ',')) {
    const std::string name(text::trim(item));
    if (name.empty()) continue;
    const auto found = std::ranges::find_if(bodies_, [&](const auto& body) { return parts_[body->part]->name == name; });
    if (found == bodies_.end())
      throw Error(place_, setting + "=" + names + ": '" + name + "' is no body of scene '" + cell_.scene.name + "'");
    bodies.push_back(found->get());
  }
  return bodies;
}

void Monitor::add_obstacles(const std::string& names) {
  for (Body* body : bodies_of("obstacles", names)) {
    Part& part = *parts_[body->part];
    if (part.moves && !part.comes)
      throw Error(place_, "obstacles=" + names + ": '" + part.name + "' moves by itself, expected static bodies");
    part.moves = part.comes = true;
    body->unscaled = part.solid;
  }
}

void Monitor::add_pairs(const std::string& ignored) {
  std::vector<std::pair<std::size_t, std::size_t>> without;
  for (const auto& [a, b] : cell_.scene.no_contact) without.emplace_back(std::minmax<std::size_t>(a, b));
  for (const std::string_view item : text::split(ignored, ',')) {
    if (text::trim(item).empty()) continue;
    const auto is_known = [&](const std::string& name) {
      return std::ranges::any_of(parts_, [&](const auto& part) { return part->name == name; });
    };
    const auto [one, other] = distance::two_names(item, is_known);
    if (other.empty())
      throw Error(place_, "ignore=" + ignored + ": '" + std::string(item) + "', expected two names as in link_5:link_7");
    without.emplace_back(std::minmax(part(one, ignored), part(other, ignored)));
  }
  for (std::size_t b = 0; b < parts_.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      const Part &of_a = *parts_[a], &of_b = *parts_[b];
      if (of_a.solid.empty() || of_b.solid.empty() || (!of_a.moves && !of_b.moves)) continue;
      if (of_b.robot < 0 || std::ranges::find(without, std::pair(a, b)) != without.end()) continue;
      const auto group = [](const Part& part) { return 2 * static_cast<std::size_t>(part.robot); };
      if (of_a.robot == of_b.robot) {
        const robot::RobotModel& model = robots_[static_cast<std::size_t>(of_b.robot)]->placed->model;
        const bool neighbours =
            model.joint_of(of_b.link).parent == of_a.link || (of_a.link >= 0 && model.joint_of(of_a.link).parent == of_b.link);
        if (!neighbours) pairs_.push_back({a, b, group(of_b) + 1, group(of_b) + 1, 0});
      } else {
        pairs_.push_back({a, b, of_a.robot < 0 ? group(of_b) : group(of_a), group(of_b), of_a.robot < 0 ? 1 : 2});
      }
    }
  }
}

void Monitor::check_inputs(Time now) const {
  const auto check = [&](const std::string& owner, const char* name, const Values& v) {
    for (std::size_t i = 0; i < v.size(); ++i) {
      if (std::isfinite(v[i])) continue;
      throw Error(place_ + "." + owner + name + "[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(v[i]) + " at " + text::to_text(now.seconds()) + " s, expected a finite value");
    }
  };
  const auto check_pose = [&](const std::string& owner, const PosePorts& pose) {
    check(owner, "p", pose.p);
    check(owner, "quat", pose.quat);
    check(owner, "v", pose.v);
    check(owner, "w", pose.w);
  };
  for (const auto& robot : robots_) {
    check(robot->prefix, "q", robot->q);
    check(robot->prefix, "dq", robot->dq);
    if (floating_) check_pose(robot->prefix + "base_", robot->base);
  }
  for (const auto& body : bodies_) {
    if (parts_[body->part]->moves) check_pose(body->prefix, body->pose);
  }
}

void Monitor::place_obstacle(Body& body) {
  Part& part = *parts_[body.part];
  part.present = body.present != 0;
  Pose X_WB{Eigen::Matrix3d::Identity(), vector3(body.pose.p)};
  // Somebody who sets one element after the other may come past a quaternion of zero, which does not end the run.
  if (std::ranges::any_of(body.pose.quat, [](double x) { return x != 0; }))
    X_WB = pose_of_input(place_, body.prefix, "quat", body.pose.p, body.pose.quat);
  part.jumped = X_WB != part.X_W || body.scale != body.scale_in_force;
  part.X_W = X_WB;
  if (body.scale == body.scale_in_force) return;
  if (!(body.scale >= kLeastScale && body.scale <= kMostScale))
    throw Error(place_ + "." + body.prefix + "scale", "is " + text::to_text(body.scale) + ", expected " +
                                                          text::to_text(kLeastScale) + " to " + text::to_text(kMostScale));
  part.solid.set_scaled(*body.unscaled, body.scale);
  body.scale_in_force = body.scale;
}

/// Brings all parts to the inputs.
void Monitor::place(Time now) {
  check_inputs(now);
  for (const auto& body : bodies_) {
    Part& part = *parts_[body->part];
    if (!part.moves) continue;
    if (part.comes) {
      place_obstacle(*body);
      continue;
    }
    part.X_W = pose_of_input(place_, body->prefix, "quat", body->pose.p, body->pose.quat);
    part.V_W << vector3(body->pose.v), vector3(body->pose.w);
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    if (floating_) r.X_WB = pose_of_input(place_, r.prefix, "base_quat", r.base.p, r.base.quat);
    scene::place_links(r.placed->model, r.X_WB, r.q, r.dq, r.X_WL, r.V_WL);
    const Vector3d v = vector3(r.base.v), w = vector3(r.base.w);
    for (std::size_t i = 0; i < r.placed->shapes.size(); ++i) {
      Part& part = *parts_[r.first + i];
      part.X_W = i == 0 ? r.X_WB : r.X_WL[i - 1];
      part.V_W = i == 0 ? Twist::Zero() : r.V_WL[i - 1];
      part.V_W.head<3>() += v + w.cross(part.X_W.p - r.X_WB.p);
      part.V_W.tail<3>() += w;
      part.jumped = false;
      for (std::size_t k = 0; k < r.placed->shapes[i].size(); ++k) {
        const std::string& tool = r.placed->shapes[i][k].tool;
        if (tool.empty()) continue;
        const auto at = static_cast<std::size_t>(std::ranges::find(r.tools, tool) - r.tools.begin());
        part.solid.set_present(k, r.tools_wanted[at] != 0);
        part.jumped = part.jumped || r.tools_wanted[at] != r.tools_in_force[at];
      }
    }
    r.tools_in_force = r.tools_wanted;
    r.at = -1;
  }
  for (const auto& part : parts_) part->middle = part->X_W * part->solid.middle();
}

double Monitor::inflation(const Pair& pair) const { return pair.inflated * r_; }

/// Measures a pair as far as it may be the nearest of a group.
void Monitor::measure(std::size_t k) {
  const Pair& pair = pairs_[k];
  const Part &a = *parts_[pair.a], &b = *parts_[pair.b];
  Nearest &of_a = nearest_[pair.group_a], &of_b = nearest_[pair.group_b];
  constexpr double kSlack = 1e-12;  // of rounding, so that the nearest pair does not depend on the order
  bounds_[k] = scene::kInfinity;
  if (!a.present) return;
  const double grown = inflation(pair), most = std::max(of_a.way.d, of_b.way.d) + a.motion + b.motion + kSlack;
  const double balls = (b.middle - a.middle).norm() - a.solid.radius() - b.solid.radius() - grown;
  bounds_[k] = balls;
  if (balls > most) return;
  distance::Distance way = finder_.find(a.solid, a.X_W, b.solid, b.X_W, most + grown);
  way.d -= grown;
  bounds_[k] = std::min(way.d, most);
  for (Nearest* nearest : {&of_a, &of_b}) {
    if (way.d < nearest->way.d || (way.d == nearest->way.d && k < nearest->pair)) *nearest = {way, k};
  }
}

void Monitor::measure() {
  // The pairs that were the nearest before bound all others.
  const std::size_t none = pairs_.size();
  for (Nearest& nearest : nearest_) nearest.way.d = scene::kInfinity;
  for (std::size_t g = 0; g < groups(); ++g) {
    if (nearest_[g].pair < none) measure(nearest_[g].pair);
  }
  for (std::size_t k = 0; k < none; ++k) {
    const bool known = std::ranges::any_of(
        nearest_, [&](const Nearest& nearest) { return nearest.pair == k && nearest.way.d < scene::kInfinity; });
    if (!known) measure(k);
  }
}

Vector3d Monitor::velocity(const Part& part, const Vector3d& p_W) const {
  return part.V_W.head<3>() + part.V_W.tail<3>().cross(p_W - part.X_W.p);
}

/// `robot`: the one whose point is p_a.
void Monitor::write(const Nearest& nearest, int robot, Ports& ports) const {
  if (!(nearest.way.d < scene::kInfinity)) {
    ports.distance = ports.time = kNone;
    ports.rate = 0;
    ports.p_a = ports.p_b = ports.n = {};
    ports.pair = {};
    return;
  }
  const Pair& pair = pairs_[nearest.pair];
  std::size_t a = pair.a, b = pair.b;
  Vector3d n = nearest.way.n, p_a = nearest.way.p_a, p_b = nearest.way.p_b;
  if (parts_[a]->robot != robot) {
    std::swap(a, b);
    std::swap(p_a, p_b);
    n = -n;
  }
  const double d = nearest.way.d, rate = n.dot(velocity(*parts_[b], p_b) - velocity(*parts_[a], p_a));
  p_a += r_ * n;
  p_b = p_a + d * n;
  ports.distance = d;
  ports.rate = rate;
  ports.time = d <= 0 ? 0 : rate < 0 ? std::min(-d / rate, kNone) : kNone;
  Eigen::Map<Vector3d>(ports.p_a.data()) = p_a;
  Eigen::Map<Vector3d>(ports.p_b.data()) = p_b;
  Eigen::Map<Vector3d>(ports.n.data()) = n;
  ports.pair = {static_cast<std::int32_t>(a) + 1, static_cast<std::int32_t>(b) + 1};
}

void Monitor::write_outputs() {
  std::size_t best = 0;
  all_->self = all_->least = kNone;
  for (std::size_t i = 0; i < robots_.size(); ++i) {
    Ports& ports = robots_[i]->ports;
    write(nearest_[2 * i], static_cast<int>(i), ports);
    ports.least = std::min(least_[2 * i], kNone);
    ports.self = std::min(nearest_[2 * i + 1].way.d, kNone);
    all_->least = std::min(all_->least, ports.least);
    all_->self = std::min(all_->self, ports.self);
    if (nearest_[2 * i].way.d < nearest_[2 * best].way.d) best = i;
  }
  write(nearest_[2 * best], static_cast<int>(best), *all_);
}

/// What the next step needs of this one.
void Monitor::remember() {
  const auto keep = [](const PosePorts& pose, Values& before) {
    std::ranges::copy(pose.p, before.begin());
    std::ranges::copy(pose.quat, before.begin() + 3);
  };
  for (const auto& robot : robots_) {
    std::ranges::copy(robot->q, robot->q_before.begin());
    keep(robot->base, robot->base_before);
  }
  for (const auto& body : bodies_) keep(body->pose, body->before);
}

/// Brings what does not move to its parameters, and forgets which pairs were the nearest.
void Monitor::place_static() {
  for (const auto& body : bodies_) {
    Part& part = *parts_[body->part];
    if (!part.moves) part.X_W = pose_of(place_ + "." + body->prefix + "quat0", body->pose.p, body->pose.quat);
  }
  for (const auto& robot : robots_) {
    if (!floating_) robot->X_WB = pose_of(place_ + "." + robot->prefix + "base_quat0", robot->base.p, robot->base.quat);
  }
  for (Nearest& nearest : nearest_) nearest = {{}, pairs_.size()};
  for (const auto& robot : robots_) {
    for (Robot::Kept& kept : robot->kept) kept.bound = -scene::kInfinity;
    robot->kept_first = 0;
  }
}

void Monitor::initialise(Time start) {
  place_static();
  place(start);
  for (const auto& part : parts_) part->motion = 0;
  measure();
  for (std::size_t g = 0; g < groups(); ++g) least_[g] = nearest_[g].way.d;
  remember();
  write_outputs();
  if (!separates_) return;
  events_.reset();
  for (const auto& robot : robots_) robot->separation->reset();
  keep_separation(start.seconds(), 0);
}

void Monitor::restored() { place_static(); }

StepResult Monitor::step(Time now, Duration h) {
  place(now + h);
  find_motions();
  measure();
  sweep();
  remember();
  write_outputs();
  if (separates_) keep_separation((now + h).seconds(), h.seconds());
  return StepResult::kDone;
}

}  // namespace cotwin::monitor
