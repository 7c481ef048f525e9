#include "components/contact_world/engine/world.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

std::vector<RigidBody> rigid_bodies(const scene::Scene& scene) {
  std::vector<RigidBody> bodies;
  bodies.reserve(scene.bodies.size());
  for (const scene::Body& body : scene.bodies) bodies.emplace_back(body);
  return bodies;
}

template <class T>
std::vector<T> joints_of(std::span<const scene::Joint> from, std::span<const RigidBody> bodies) {
  std::vector<T> joints;
  joints.reserve(from.size());
  for (const scene::Joint& joint : from) joints.emplace_back(joint, bodies);
  return joints;
}

constexpr std::size_t kHeader = 3 + Guard::kNumbers, kNumbersPerBody = 16, kNumbersPerJoint = 5 + kJointRows,
                      kNumbersPerNode = 18, kNumbersPerTouch = 26;

}  // namespace

World::Impl::Impl(scene::Scene the_scene, Options the_options)
    : scene(std::move(the_scene)),
      options(the_options),
      bodies(rigid_bodies(scene)),
      joints(joints_of<Joint>(scene.joints, bodies)),
      axes(joints.size()),
      forest(bodies, joints),
      rows(bodies, forest),
      detector(scene),
      latches(joints_of<Latch>(scene.latches, bodies)),
      joint_x(joints.size()),
      applied(bodies.size(), Wrench::Zero()),
      poses(bodies.size()),
      twists(bodies.size()),
      q(joints.size()),
      dq(joints.size()) {
  std::vector<char> is_linked(bodies.size(), 0);
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const Joint& joint = joints[j];
    joint_x[j].fill(0);
    if (!is_dynamic(joint.parent) && !is_dynamic(joint.child)) continue;
    for (const int body : {joint.parent, joint.child}) {
      if (body >= 0 && bodies[index(body)].motion != scene::Motion::kStatic) is_linked[index(body)] = 1;
    }
    const bool whole = !forest.contains(static_cast<int>(j));
    has_whole_joints = has_whole_joints || whole;
    const bool closes = !whole && joint.has_axis() && forest.freedom_of(static_cast<int>(j)) < 0;
    if (whole || closes || options.method != Method::kTree) loose.push_back({static_cast<int>(j), whole});
  }
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (is_linked[b]) linked.push_back(static_cast<int>(b));
    const bool driven = bodies[b].motion == scene::Motion::kDriven;
    if (driven && is_linked[b]) carriers.push_back(static_cast<int>(b));
    has_driven = has_driven || driven;
  }
  in_loops.resize(joints.size());
  for (const Forest::Tree& tree : forest.trees()) {
    for (const Loops::Row& row : tree.loops.rows()) in_loops[index(row.joint)] = 1;
  }
  places.resize(linked.size());
  advance = Advance(bodies, is_linked, detector);
  check_gears();
  open_accounts();
  pushed = bodies;
  starts.resize(bodies.size());
  shifted.resize(bodies.size());
  frozen.resize(bodies.size());
  latches_changed();
  laws.reserve(joints.size());
  drives.resize(joints.size());
  for (const scene::Body& body : scene.bodies) {
    materials.emplace_back();
    for (const scene::Shape& shape : body.shapes) {
      materials.back().push_back(&shape.material);
      pivots = pivots || shape.material.restitution > 0 || shape.material.soft();
      torsional = torsional || shape.material.torsion > 0;
    }
  }
  make_dents();
  detector.reserve(options.contacts);
  reserve(options.contacts);
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    poses[b] = bodies[b].pose();
    twists[b] = bodies[b].twist();
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    q[j] = joints[j].q;
    dq[j] = joints[j].has_axis() ? joints[j].speed(bodies) : 0;
  }
}

std::size_t World::Impl::loop_numbers() const {
  std::size_t count = 0;
  for (const Forest::Tree& tree : forest.trees()) count += tree.loops.memory().size();
  return count;
}

World::World(scene::Scene scene, Options options) : impl_(std::make_unique<Impl>(std::move(scene), options)) {}
World::~World() = default;
World::World(World&&) noexcept = default;
World& World::operator=(World&&) noexcept = default;

void World::step(double h) { impl_->step(h); }

const scene::Scene& World::scene() const { return impl_->scene; }
std::span<const Pose> World::poses() const { return impl_->poses; }
std::span<const Twist> World::twists() const { return impl_->twists; }
std::span<const double> World::q() const { return impl_->q; }
std::span<const double> World::dq() const { return impl_->dq; }
std::span<const ContactPoint> World::contacts() const { return impl_->points; }
std::span<const Eigen::Vector3d> World::forces() const { return impl_->forces; }
const Status& World::status() const { return impl_->status; }
std::span<const Yielding> World::yielding() const { return impl_->yielding; }
std::size_t World::forgotten_dents() const { return impl_->forgotten; }

// Setting the present value changes no bits.
void World::set_pose(std::size_t body, const Pose& X_WB) {
  Impl& w = *impl_;
  if (w.poses[body] == X_WB) return;
  w.bodies[body].set_pose(X_WB);
  w.poses[body] = w.bodies[body].pose();
  w.stale = true;
  w.restored = false;
  w.guard.moved = true;
  for (std::size_t j = 0; j < w.joints.size(); ++j) {
    Joint& joint = w.joints[j];
    if (joint.parent != static_cast<int>(body) && joint.child != static_cast<int>(body)) continue;
    joint.place(w.bodies);
    joint.measure();
    w.q[j] = joint.q;
  }
}

void World::set_twist(std::size_t body, const Twist& V_WB) {
  Impl& w = *impl_;
  if (w.twists[body] == V_WB) return;
  w.bodies[body].set_twist(V_WB);
  w.twists[body] = w.bodies[body].twist();
  if (w.bodies[body].dynamic()) w.guard.moved = true;
}

World::ContactLaw World::contact_law(std::size_t point) const {
  const Impl::Contact& touch = impl_->touches[point];
  return {touch.mu, touch.stiffness, touch.damping};
}

const RigidBody& World::body(std::size_t body) const { return impl_->bodies[body]; }

void World::set_body(std::size_t body, const Inertia& inertia) {
  Impl& w = *impl_;
  scene::Body& seen = w.scene.bodies[body];
  if (seen.inertia == inertia || !w.bodies[body].dynamic()) return;
  w.bodies[body].set_inertia(inertia, seen.shapes, seen.name);
  seen.inertia = inertia;
  w.poses[body] = w.bodies[body].pose();
  w.twists[body] = w.bodies[body].twist();
  w.advance.refit(body, w.bodies[body]);
  w.set_small_energies();
  w.stale = true;
  w.restored = false;
  w.guard.moved = true;
  for (Joint& joint : w.joints) {
    if (joint.parent != static_cast<int>(body) && joint.child != static_cast<int>(body)) continue;
    joint.refit(w.bodies);
    joint.place(w.bodies);
  }
  for (Latch& latch : w.latches) latch.joint.refit(w.bodies);
}

void World::set_tool(std::size_t body, const std::string& tool, bool present) {
  Impl& w = *impl_;
  const std::vector<scene::Shape>& shapes = w.scene.bodies[body].shapes;
  for (std::size_t s = 0; s < shapes.size(); ++s) {
    if (shapes[s].tool == tool) w.detector.set_present(static_cast<int>(body), static_cast<int>(s), present);
  }
  w.stale = true;
  w.restored = false;
  w.guard.moved = true;
}

void World::set_foundation(std::size_t body, double foundation, double yield, double breakthrough) {
  Impl& w = *impl_;
  for (scene::Shape& shape : w.scene.bodies[body].shapes) {
    scene::Material& m = shape.material;
    if (m.foundation == 0) continue;
    const bool same = (yield < scene::kInfinity) == (m.yield < scene::kInfinity) &&
                      (breakthrough < scene::kInfinity) == (m.breakthrough < scene::kInfinity);
    if (!(foundation > 0 && foundation < scene::kInfinity && yield > 0 && breakthrough > 0 && same))
      throw Error("contact world", "foundation of body '" + w.scene.bodies[body].name + "': " + text::to_text(foundation) +
                                       ", limit " + text::to_text(yield) + ", breakthrough " + text::to_text(breakthrough) +
                                       ", expected positive values, and limits where there were some at the start");
    m.foundation = foundation;
    m.yield = yield;
    m.breakthrough = breakthrough;
  }
  w.stale = true;
  w.restored = false;
  w.guard.moved = true;
}

void World::apply(std::size_t body, const Wrench& F_B_W) { impl_->applied[body] = F_B_W; }

void World::set_tau(std::size_t joint, double tau, double stiffness, double damping, double rate) {
  Axis& axis = impl_->axes[joint];
  axis.tau = tau;
  axis.stiffness = stiffness;
  axis.damping = damping;
  axis.rate = rate;
}

void World::set_inertia(std::size_t joint, double inertia) {
  Axis& axis = impl_->axes[joint];
  if (axis.inertia == inertia) return;
  axis.inertia = inertia;
  impl_->guard.moved = true;
}

void World::set_motor(std::size_t joint, double dq, double tau_max) {
  impl_->axes[joint].motor_speed = dq;
  impl_->axes[joint].motor_torque = tau_max;
}

double World::energy() const {
  double energy = 0;
  for (const RigidBody& body : impl_->bodies) {
    if (body.dynamic()) energy += body.kinetic_energy() - body.mass * impl_->scene.gravity.dot(body.p);
  }
  for (const Joint& joint : impl_->joints)
    energy += joint.stiffness * (joint.q - joint.q_spring) * (joint.q - joint.q_spring) / 2;
  return energy;
}

double World::largest_gap() const { return impl_->largest_gap(); }

std::size_t World::state_size() const {
  const Impl& w = *impl_;
  return kHeader + Account::kNumbers * w.guard.accounts.size() + kNumbersPerBody * w.bodies.size() +
         kNumbersPerJoint * w.joints.size() + kNumbersPerNode * w.forest.nodes().size() + w.loop_numbers() + w.dent_numbers() +
         Latch::kNumbers * w.latches.size() + kNumbersPerTouch * w.options.contacts;
}

void World::save(std::vector<double>& state) const {
  const Impl& w = *impl_;
  state.resize(state_size());
  double* to = state.data();
  const auto put = [&](const auto&... values) { ((*to++ = static_cast<double>(values)), ...); };
  const auto put_all = [&](const auto& vector) {
    for (const double value : vector) put(value);
  };
  const std::size_t kept = std::min(w.touches.size(), w.options.contacts);
  const Guard& guard = w.guard;
  put(w.stale && !w.restored, w.margin, kept);
  put(guard.nearest, guard.stalled, guard.start_gap, guard.start_tilt,
      (guard.assembling ? 1 : 0) + (guard.begun ? 2 : 0) + (guard.moved ? 4 : 0));
  for (const RigidBody& body : w.bodies) {
    put_all(body.p);
    put_all(body.Q);
    put_all(body.v);
    put_all(body.w);
    put_all(body.L);
  }
  for (const Account& one : guard.accounts) {
    put(one.energy, one.potential, one.highest, one.lowest, one.excess, one.owed, one.lost, one.net, one.jumped, one.share,
        one.largest_share, one.gained, one.buried);
  }
  for (std::size_t j = 0; j < w.joints.size(); ++j) {
    const Axis& axis = w.axes[j];
    put(w.joints[j].q, axis.lock, axis.motor_speed, axis.motor_torque, axis.inertia);
    put_all(w.joint_x[j]);
  }
  for (const Forest::Node& node : w.forest.nodes()) {
    for (const Spatial& curve : node.curve) put_all(curve);
  }
  for (const Forest::Tree& tree : w.forest.trees()) {
    put_all(tree.loops.memory());
  }
  for (const Latch& latch : w.latches) {
    put(latch.closed, latch.holds, latch.overloaded, latch.progress);
    for (const Motion6& motion : {latch.met, latch.impulse}) {
      put_all(motion.linear);
      put_all(motion.angular);
    }
  }
  if (!w.dents.empty()) {
    put(w.next_dent, w.forgotten);
    for (const Dent& dent : w.dents) {
      put(dent.body, dent.shape, dent.reach, dent.area, dent.depth, dent.pierced);
      put_all(dent.p);
    }
    for (const Yielding& one : w.yielding) put(one.depth, one.work, one.pierced);
  }
  for (std::size_t t = 0; t < kept; ++t) {
    const ContactPoint& point = w.touches[t].point;
    put(point.body_a, point.body_b, point.shape_a, point.shape_b, point.id >> 32U, point.id & 0xffffffffU);
    put_all(point.p_W);
    put_all(w.touches[t].impulse);
    put_all(w.touches[t].travel.a);
    put_all(w.touches[t].travel.b);
    put_all(w.touches[t].travel.change_a);
    put_all(w.touches[t].travel.change_b);
    put(w.touches[t].travel.known, w.touches[t].travel.goes_on);
  }
  std::fill(to, state.data() + state.size(), 0.0);
}

void World::restore(std::span<const double> state) {
  Impl& w = *impl_;
  const double* from = state.data();
  const auto get = [&] { return *from++; };
  const auto get_all = [&](auto& vector) {
    for (double& value : vector) value = get();
  };
  const double points = state[2];
  if (!(points >= 0 && points <= static_cast<double>(w.options.contacts))) {
    throw Error("contact world", "invalid state: " + text::to_text(points) + " contact points, expected 0 to " +
                                     std::to_string(w.options.contacts));
  }
  const std::size_t joints = kHeader + Account::kNumbers * w.guard.accounts.size() + kNumbersPerBody * w.bodies.size();
  const auto is_motor_torque = [&](std::size_t at) {
    return at >= joints && at < joints + kNumbersPerJoint * w.joints.size() && (at - joints) % kNumbersPerJoint == 3;
  };
  for (std::size_t k = 0; k < state.size(); ++k) {
    if (!(std::abs(state[k]) < 1e18) && !(is_motor_torque(k) && state[k] == scene::kInfinity))
      throw Error("contact world", "invalid state: value " + text::to_text(state[k]) + ", expected a magnitude below 1e18");
  }
  const auto expect_whole = [&](std::size_t at, double least, double most) {
    if (!(state[at] >= least && state[at] <= most)) {
      throw Error("contact world", "invalid state: number " + text::to_text(state[at]) + ", expected " + text::to_text(least) +
                                       " to " + text::to_text(most));
    }
  };
  expect_whole(kHeader - 1, 0, 7);
  constexpr double kMost = std::numeric_limits<std::int32_t>::max(), kHalf = std::numeric_limits<std::uint32_t>::max();
  std::size_t at = joints;
  for (std::size_t j = 0; j < w.joints.size(); ++j, at += kNumbersPerJoint) expect_whole(at + 1, -kMost, kMost);
  at += kNumbersPerNode * w.forest.nodes().size() + w.loop_numbers() + Latch::kNumbers * w.latches.size();
  if (!w.dents.empty()) {
    expect_whole(at, 0, static_cast<double>(w.dents.size() - 1));
    expect_whole(at + 1, 0, kMost);
    for (std::size_t d = 0; d < w.dents.size(); ++d) {
      expect_whole(at + 2 + kNumbersPerDent * d, -1, kMost);
      expect_whole(at + 3 + kNumbersPerDent * d, 0, kMost);
    }
    at += w.dent_numbers();
  }
  for (std::size_t t = 0; t < static_cast<std::size_t>(points); ++t, at += kNumbersPerTouch) {
    for (std::size_t k = 0; k < 4; ++k) expect_whole(at + k, -kMost, kMost);
    for (std::size_t k = 4; k < 6; ++k) expect_whole(at + k, 0, kHalf);
  }
  const bool was_stale = get() != 0;
  w.margin = get();
  const auto kept = static_cast<std::size_t>(get());
  Guard& guard = w.guard;
  for (double* number : {&guard.nearest, &guard.stalled, &guard.start_gap, &guard.start_tilt}) *number = get();
  const auto flags = static_cast<unsigned>(get());
  guard.assembling = (flags & 1U) != 0;
  guard.begun = (flags & 2U) != 0;
  guard.moved = (flags & 4U) != 0;
  for (std::size_t b = 0; b < w.bodies.size(); ++b) {
    RigidBody& body = w.bodies[b];
    get_all(body.p);
    get_all(body.Q);
    get_all(body.v);
    get_all(body.w);
    get_all(body.L);
    body.place();
    w.poses[b] = body.pose();
    w.twists[b] = body.twist();
  }
  for (Account& one : guard.accounts) {
    for (double* number : {&one.energy, &one.potential, &one.highest, &one.lowest, &one.excess, &one.owed, &one.lost, &one.net,
                           &one.jumped, &one.share, &one.largest_share, &one.gained}) {
      *number = get();
    }
    one.buried = get() != 0;
  }
  for (std::size_t j = 0; j < w.joints.size(); ++j) {
    Axis& axis = w.axes[j];
    w.joints[j].q = get();
    axis.lock = static_cast<std::int32_t>(get());
    axis.motor_speed = get();
    axis.motor_torque = get();
    axis.inertia = get();
    get_all(w.joint_x[j]);
    w.joints[j].place(w.bodies);
    w.q[j] = w.joints[j].q;
    w.dq[j] = w.joints[j].has_axis() ? w.joints[j].speed(w.bodies) : 0;
    const int f = w.forest.freedom_of(static_cast<int>(j));
    if (f >= 0) w.forest.freedoms()[index(f)].s = w.dq[j];
  }
  for (Forest::Node& node : w.forest.nodes()) {
    for (Spatial& curve : node.curve) get_all(curve);
  }
  for (Forest::Tree& tree : w.forest.trees()) {
    for (double& value : tree.loops.memory()) value = get();
  }
  for (Latch& latch : w.latches) {
    latch.closed = get() != 0;
    latch.holds = get() != 0;
    latch.overloaded = get() != 0;
    latch.progress = std::clamp(get(), 0.0, 1.0);
    for (Motion6* motion : {&latch.met, &latch.impulse}) {
      get_all(motion->linear);
      get_all(motion->angular);
    }
    latch.sum = {};
    latch.joint.place(w.bodies);
  }
  w.latches_changed();
  if (!w.dents.empty()) {
    w.next_dent = static_cast<std::size_t>(get());
    w.forgotten = static_cast<std::size_t>(get());
    for (Dent& dent : w.dents) {
      dent.is_new = false;
      dent.body = static_cast<int>(get());
      dent.shape = static_cast<int>(get());
      dent.reach = get();
      dent.area = get();
      dent.depth = get();
      dent.pierced = get() != 0;
      get_all(dent.p);
    }
    for (Yielding& one : w.yielding) {
      one.depth = get();
      one.work = get();
      one.pierced = get() != 0;
    }
  }
  w.touches.resize(kept);
  for (Impl::Contact& touch : w.touches) {
    touch = {};
    ContactPoint& point = touch.point;
    point.body_a = static_cast<int>(get());
    point.body_b = static_cast<int>(get());
    point.shape_a = static_cast<int>(get());
    point.shape_b = static_cast<int>(get());
    point.id = static_cast<std::uint64_t>(get()) << 32U;
    point.id |= static_cast<std::uint64_t>(get());
    get_all(point.p_W);
    get_all(touch.impulse);
    get_all(touch.travel.a);
    get_all(touch.travel.b);
    get_all(touch.travel.change_a);
    get_all(touch.travel.change_b);
    touch.travel.known = get() != 0;
    touch.travel.goes_on = get() != 0;
  }
  w.points.clear();
  w.forces.clear();
  w.stale = true;
  w.joints_hold = false;
  w.restored = !was_stale;
}

}  // namespace cotwin::contact_world
