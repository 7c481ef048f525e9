#include "components/monitor/monitor.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file_store.h"
#include "models/foundation/support/text.h"
#include "models/mechanics/pose_values.h"

namespace cotwin::monitor {
namespace {

using Eigen::Vector3d;
using surroundings::check_finite;

Eigen::Map<const Vector3d> vector3(const Values& v) { return Eigen::Map<const Vector3d>(v.data()); }

}  // namespace

Monitor::Monitor(Settings& settings)
    : place_(settings.unit()),
      given_(settings.cell()),
      floating_(settings.choice("base") == "floating"),
      separates_(!settings.text("separation").empty()) {
  if (given_.robots.empty()) throw Error(place_, "has no robot to watch, expected the setting robot or robots");
  try {
    add_parts(settings);
    if (separates_) add_separation(settings);
  } catch (const Error& error) {
    throw Error(place_, error.what());
  }
  intervals_.reserve(static_cast<std::size_t>(collision::SweepLimits{}.most_measured) + 2);
}

void Monitor::add_parts(Settings& settings) {
  cell_.add(given_.scene);
  for (const scene::Body& body : given_.scene.bodies) {
    if (cell_.parts[bodies_.size()].body.open())
      settings.warn("body '" + body.name + "' is not closed, so that nothing counts as inside it");
    bodies_.push_back(std::make_unique<Body>(body));
  }
  add_obstacles(settings.text("obstacles"));
  if (!settings.text("cloud").empty()) add_cloud(settings);
  for (const scene::PlacedRobot& placed : given_.robots) {
    robots_.push_back(std::make_unique<Robot>(placed));
    const std::string bare = robots_.back()->add_to(cell_, floating_);
    if (!bare.empty()) settings.warn("robot '" + placed.model.name + "': " + bare + ", whose distance is not watched");
  }
  const std::string ignored = settings.text("ignore");
  std::vector<std::string> ignore;
  for (const std::string_view item : text::split(ignored, ','))
    if (!text::trim(item).empty()) ignore.emplace_back(item);
  cell_.find_pairs(ignore);
  nearest_.resize(groups());
  nearest_pairs_.resize(groups());
  least_.resize(groups());
  bounds_.resize(cell_.pairs.size());
  motions_.resize(cell_.parts.size());
  jumped_.resize(cell_.parts.size());
}

/// The bodies of the scene that a setting names, name,name.
std::vector<std::size_t> Monitor::bodies_of(const std::string& setting, const std::string& names) const {
  std::vector<std::size_t> bodies;
  const std::span all = std::span(cell_.parts).first(bodies_.size());
  for (const std::string_view item : text::split(names, ',')) {
    const std::string name(text::trim(item));
    if (name.empty()) continue;
    const auto found = std::ranges::find(all, name, &collision::Part::name);
    if (found == all.end())
      throw Error(setting + "=" + names, "'" + name + "' is no body of scene '" + given_.scene.name + "'");
    bodies.push_back(static_cast<std::size_t>(found - all.begin()));
  }
  return bodies;
}

void Monitor::add_obstacles(const std::string& names) {
  for (const std::size_t k : bodies_of("obstacles", names)) {
    collision::Part& part = cell_.parts[k];
    if (part.moves && !bodies_[k]->comes)
      throw Error("obstacles=" + names, "'" + part.name + "' moves by itself, expected static bodies");
    part.moves = bodies_[k]->comes = true;
    bodies_[k]->unscaled = part.body;
  }
}

/// As the last of the bodies.
void Monitor::add_cloud(Settings& settings) {
  const std::filesystem::path file = settings.data_file(settings.text("cloud"));
  obstacle_ = read_once<cloud::Obstacle>(settings.models(), cloud::kCloudKey + file.string(),
                                         [&] { return cloud::load_obstacle(file); });
  for (const std::string& remark : obstacle_->remarks) settings.warn(file.string() + ": " + remark);
  cloud_r_ = obstacle_->touching();
  cloud_ = bodies_.size();
  cell_.add("cloud", obstacle_->points, cloud_r_);
  bodies_.push_back(std::make_unique<Body>());
  bodies_.back()->prefix = "cloud.";
}

void Monitor::check_inputs(Time now) const {
  for (const auto& robot : robots_) {
    check_finite(place_, robot->prefix, "q", robot->q, now);
    check_finite(place_, robot->prefix, "dq", robot->dq, now);
    if (floating_) check_finite(place_, robot->base_prefix, robot->base, now);
  }
  for (std::size_t k = 0; k < bodies_.size(); ++k)
    if (cell_.parts[k].moves && !bodies_[k]->kept) check_finite(place_, bodies_[k]->prefix, bodies_[k]->pose, now);
}

void Monitor::place_obstacle(std::size_t k) {
  Body& body = *bodies_[k];
  collision::Part& part = cell_.parts[k];
  part.present = body.present != 0;
  Pose X_WB{Eigen::Matrix3d::Identity(), vector3(body.pose.p)};
  // Somebody who sets one element after the other may come past a quaternion of zero, which does not end the run.
  if (std::ranges::any_of(body.pose.quat, [](double x) { return x != 0; }))
    X_WB = pose_of_input(place_, body.prefix, "quat", body.pose.p, body.pose.quat);
  jumped_[k] = X_WB != part.X_W || body.scale != body.scale_in_force;
  if (body.scale != body.scale_in_force) {
    if (!(body.scale >= kLeastScale && body.scale <= kMostScale))
      throw Error(place_ + "." + body.prefix + "scale", "is " + text::to_text(body.scale) + ", expected " +
                                                            text::to_text(kLeastScale) + " to " + text::to_text(kMostScale));
    part.body.set_scaled(*body.unscaled, body.scale);
    body.scale_in_force = body.scale;
  }
  cell_.place(part, X_WB);
}

/// Brings all parts to the inputs.
void Monitor::place(Time now, Duration h) {
  check_inputs(now);
  if (cloud_ < bodies_.size()) cell_.parts[cloud_].body.set_ball(cloud_r_);
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    Body& body = *bodies_[k];
    body.was_lost = body.lost[0] != 0;
    if (body.kept)
      body.lost[0] = body.track.take(body.pose.is_finite(), vector3(body.pose.p), vector3(body.pose.v), now.seconds(),
                                     h.seconds(), figures_.v_max, figures_.restart_delay);
    if (body.comes)
      place_obstacle(k);
    else if (body.lost[0] != 0)  // where it was seen last
      cell_.place(cell_.parts[k], body.pose.last());
    else if (cell_.parts[k].moves)
      cell_.place(cell_.parts[k], pose_of_input(place_, body.prefix, "quat", body.pose.p, body.pose.quat));
  }
  for (const auto& robot : robots_) {
    Robot& r = *robot;
    if (floating_) r.X_WB = pose_of_input(place_, r.prefix, "base_quat", r.base.p, r.base.quat);
    r.place(cell_, r.q, r.dq);
    for (std::size_t l = 0; l < r.placed->shapes.size(); ++l) jumped_[r.first + l] = r.show_tools(cell_, l) ? 1 : 0;
    r.tools_in_force = r.tools_wanted;
    r.at = -1;
  }
}

std::array<std::size_t, 2> Monitor::groups_of(const collision::Pair& pair) const {
  const auto of = [](const collision::Part& part) { return 2 * static_cast<std::size_t>(part.robot); };
  const collision::Part &a = cell_.parts[pair.a], &b = cell_.parts[pair.b];
  if (pair.self) return {of(b) + 1, of(b) + 1};
  return {of(a.robot < 0 ? b : a), of(b)};
}

double Monitor::inflation(const collision::Pair& pair) const {
  return pair.self ? 0 : cell_.parts[pair.a].robot < 0 ? r_ : 2 * r_;
}

/// Measures a pair as far as it may be the nearest of a group.
void Monitor::measure(std::size_t k) {
  const collision::Pair& pair = cell_.pairs[k];
  const std::array<std::size_t, 2> groups = groups_of(pair);
  constexpr double kSlack = 1e-12;  // of rounding, so that the nearest pair does not depend on the order
  bounds_[k] = scene::kInfinity;
  if (!cell_.parts[pair.a].present) return;
  const double grown = inflation(pair);
  const double most =
      std::max(nearest_[groups[0]].d, nearest_[groups[1]].d) + motions_[pair.a] + motions_[pair.b] + kSlack + grown;
  collision::Distance found = cell_.distance(pair, most, bounds_[k]);
  bounds_[k] -= grown;
  found.d -= grown;
  for (const std::size_t g : groups) {
    if (found.d < nearest_[g].d || (found.d == nearest_[g].d && k < nearest_pairs_[g]))
      nearest_[g] = found, nearest_pairs_[g] = k;
  }
}

void Monitor::measure() {
  // The pairs that were the nearest before bound all others.
  const std::size_t none = cell_.pairs.size();
  for (collision::Distance& nearest : nearest_) nearest.d = scene::kInfinity;
  for (std::size_t g = 0; g < groups(); ++g) {
    if (nearest_pairs_[g] < none) measure(nearest_pairs_[g]);
  }
  for (std::size_t k = 0; k < none; ++k) {
    bool known = false;
    for (std::size_t g = 0; g < groups(); ++g) known = known || (nearest_pairs_[g] == k && nearest_[g].d < scene::kInfinity);
    if (!known) measure(k);
  }
}

/// The twist of its frame's origin, in W.
Twist Monitor::twist_of(std::size_t k) const {
  const collision::Part& part = cell_.parts[k];
  Twist V = Twist::Zero();
  if (part.robot < 0) {
    if (part.moves && !bodies_[k]->comes && bodies_[k]->lost[0] == 0)
      V << vector3(bodies_[k]->pose.v), vector3(bodies_[k]->pose.w);
    return V;
  }
  const Robot& r = robot_of(part);
  const Vector3d v = vector3(r.base.v), w = vector3(r.base.w);
  if (part.link >= 0) V = r.V_WL[static_cast<std::size_t>(part.link)];
  V.head<3>() += v + w.cross(part.X_W.p - r.X_WB.p);
  V.tail<3>() += w;
  return V;
}

/// The speed of its fastest point.
double Monitor::speed_of(std::size_t k) const {
  const collision::Part& part = cell_.parts[k];
  const Twist V = twist_of(k);
  const double w = V.tail<3>().norm();
  return (V.head<3>() + V.tail<3>().cross(part.middle - part.X_W.p)).norm() + (w > 0 ? w * part.body.radius() : 0);
}

/// `robot`: the one whose point is p_a.
void Monitor::write(std::size_t group, int robot, Ports& ports) const {
  const collision::Distance& nearest = nearest_[group];
  if (!(nearest.d < scene::kInfinity)) {
    ports.distance = ports.time = kNone;
    ports.rate = 0;
    ports.p_a = ports.p_b = ports.n = {};
    ports.pair = {};
    ports.points_known = 0;
    return;
  }
  std::size_t a = cell_.pairs[nearest_pairs_[group]].a, b = cell_.pairs[nearest_pairs_[group]].b;
  Vector3d n = nearest.n, p_a = nearest.p_a, p_b = nearest.p_b;
  if (cell_.parts[a].robot != robot) {
    std::swap(a, b);
    std::swap(p_a, p_b);
    n = -n;
  }
  const auto velocity = [this](std::size_t part, const Vector3d& p) {
    const Twist V = twist_of(part);
    return Vector3d(V.head<3>() + V.tail<3>().cross(p - cell_.parts[part].X_W.p));
  };
  const double d = nearest.d, rate = n.dot(velocity(b, p_b) - velocity(a, p_a));
  p_a += r_ * n;
  p_b = p_a + d * n;
  ports.distance = d;
  ports.rate = rate;
  ports.time = d <= 0 ? 0 : rate < 0 ? std::min(-d / rate, kNone) : kNone;
  Eigen::Map<Vector3d>(ports.p_a.data()) = p_a;
  Eigen::Map<Vector3d>(ports.p_b.data()) = p_b;
  Eigen::Map<Vector3d>(ports.n.data()) = n;
  ports.pair = {static_cast<std::int32_t>(a) + 1, static_cast<std::int32_t>(b) + 1};
  ports.points_known = nearest.on_surfaces ? 1 : 0;
}

void Monitor::write_outputs() {
  std::size_t best = 0;
  all_.self = all_.least = kNone;
  for (std::size_t i = 0; i < robots_.size(); ++i) {
    Ports& ports = robots_[i]->ports;
    write(2 * i, static_cast<int>(i), ports);
    ports.least = std::min(least_[2 * i], kNone);
    ports.self = std::min(nearest_[2 * i + 1].d, kNone);
    all_.least = std::min(all_.least, ports.least);
    all_.self = std::min(all_.self, ports.self);
    if (nearest_[2 * i].d < nearest_[2 * best].d) best = i;
  }
  write(2 * best, static_cast<int>(best), all_);
}

/// What the next step needs of this one.
void Monitor::remember() {
  for (const auto& robot : robots_) robot->remember();
  for (const auto& body : bodies_)
    if (body->lost[0] == 0) body->pose.remember();
}

/// Brings what does not move to its parameters, and forgets which pairs were the nearest.
void Monitor::place_static() {
  for (std::size_t k = 0; k < bodies_.size(); ++k) {
    const Body& body = *bodies_[k];
    if (!cell_.parts[k].moves)
      cell_.place(cell_.parts[k], pose_of(place_ + "." + body.prefix + "quat0", body.pose.p, body.pose.quat));
  }
  for (const auto& robot : robots_) {
    if (!floating_) robot->X_WB = pose_of(place_ + "." + robot->prefix + "base_quat0", robot->base.p, robot->base.quat);
    for (Robot::Kept& kept : robot->kept) kept.bound = -scene::kInfinity;
    robot->kept_first = 0;
  }
  std::ranges::fill(nearest_pairs_, cell_.pairs.size());
}

void Monitor::initialise(Time start) {
  place_static();
  for (std::size_t k = 0; k < given_.scene.bodies.size(); ++k) {
    bodies_[k]->pose.set_before(given_.scene.bodies[k].X_WB);
    bodies_[k]->lost = {};
    bodies_[k]->track.reset();
  }
  event_body_ = 0;
  place(start, {});
  std::ranges::fill(motions_, 0.0);
  measure();
  for (std::size_t g = 0; g < groups(); ++g) least_[g] = nearest_[g].d;
  remember();
  write_outputs();
  if (!separates_) return;
  events_.reset();
  for (const auto& robot : robots_) robot->separation->reset();
  keep_separation(start.seconds(), 0);
}

void Monitor::restored() { place_static(); }

StepResult Monitor::step(Time now, Duration h) {
  place(now + h, h);
  find_motions();
  measure();
  sweep();
  remember();
  write_outputs();
  if (separates_) keep_separation((now + h).seconds(), h.seconds());
  return StepResult::kDone;
}

}  // namespace cotwin::monitor
