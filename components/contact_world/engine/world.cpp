#include "components/contact_world/engine/world.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <type_traits>
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

// The state as numbers. One list names them, for their count, for writing, checking and reading.

namespace {

constexpr double kLargest = 1e18;  // magnitudes of a state's numbers are smaller
constexpr double kMostWhole = std::numeric_limits<std::int32_t>::max(), kMostHalf = std::numeric_limits<std::uint32_t>::max();

/// What a number may be.
struct Range {
  double least = -kInfinity, most = kInfinity;
  const char* of = nullptr;  // what it counts
  bool infinite = false;     // it may be +∞
};
constexpr Range kWhole{-kMostWhole, kMostWhole}, kIndex{0, kMostWhole}, kHalfOfId{0, kMostHalf}, kUnlimited{.infinite = true};

struct Counter {
  static constexpr bool kMostTouches = true;
  std::size_t count = 0;
  void operator()(const auto&, const Range&) { ++count; }
};

struct Writer {
  static constexpr bool kMostTouches = false;
  double* to;
  void operator()(const auto& value, const Range&) { *to++ = static_cast<double>(value); }
};

bool fits(double number, const Range& range) {
  return std::abs(number) < kLargest && !(number < range.least) && !(number > range.most);
}
/// Throws Error for a number that does not fit.
void refuse(double number, const Range& range) {
  if (range.infinite && number == kInfinity) return;
  const bool too_large = range.of == nullptr && !(std::abs(number) < kLargest);
  const std::string shown = text::to_text(number);
  const std::string what = too_large ? "value " + shown : range.of == nullptr ? "number " + shown : shown + range.of;
  throw Error("contact world",
              "invalid state: " + what + ", expected " +
                  (too_large ? "a magnitude below 1e18" : text::to_text(range.least) + " to " + text::to_text(range.most)));
}

/// Reads what is not constant.
template <bool checks>
struct Reader {
  static constexpr bool kMostTouches = false;
  const double* from;
  template <class T>
  void operator()(T& value, const Range& range) {
    const double number = *from++;
    if (checks && !fits(number, range)) [[unlikely]]
      refuse(number, range);
    if constexpr (std::is_same_v<T, bool>) {
      value = number != 0;
    } else if constexpr (!std::is_const_v<T>) {
      value = static_cast<T>(number);
    }
  }
};

}  // namespace

/// Calls visit(number, range) for each number of the state. Numbers of a constant world are not changed, but those that the rest of the list needs.
template <class Self, class Visit>
void World::Impl::each_state(Self& w, Visit& visit) {
  constexpr bool kReads = !std::is_const_v<Self>;
  const auto numbers = [&](auto&... values) { (visit(values, Range{}), ...); };
  const auto lists = [&](auto&... vectors) {
    const auto list = [&](auto& vector) {
      for (auto& value : vector) numbers(value);
    };
    (list(vectors), ...);
  };
  auto& guard = w.guard;
  bool was_stale = w.stale && !w.restored;
  std::size_t kept = Visit::kMostTouches ? w.options.contacts : std::min(w.touches.size(), w.options.contacts);
  unsigned flags = (guard.assembling ? 1 : 0) + (guard.begun ? 2 : 0) + (guard.moved ? 4 : 0);
  numbers(was_stale, w.margin);
  visit(kept, {0, static_cast<double>(w.options.contacts), " contact points"});
  numbers(guard.nearest, guard.stalled, guard.start_gap, guard.start_tilt);
  visit(flags, {0, 7});
  if constexpr (kReads) {
    w.restored = !was_stale;
    guard.assembling = (flags & 1U) != 0;
    guard.begun = (flags & 2U) != 0;
    guard.moved = (flags & 4U) != 0;
    w.touches.assign(kept, {});
  }
  for (auto& body : w.bodies) lists(body.p, body.Q, body.v, body.w, body.L);
  for (auto& one : guard.accounts) {
    numbers(one.energy, one.potential, one.highest, one.lowest, one.excess, one.owed, one.lost, one.net, one.jumped, one.share,
            one.largest_share, one.gained, one.buried);
  }
  for (std::size_t j = 0; j < w.joints.size(); ++j) {
    auto& axis = w.axes[j];
    numbers(w.joints[j].q);
    visit(axis.lock, kWhole);
    numbers(axis.motor_speed);
    visit(axis.motor_torque, kUnlimited);
    numbers(axis.inertia);
    lists(w.joint_x[j]);
  }
  for (auto& node : w.forest.nodes()) lists(node.curve[0], node.curve[1], node.curve[2]);
  for (auto& tree : w.forest.trees()) {
    for (auto& value : tree.loops.memory()) numbers(value);
  }
  for (auto& latch : w.latches) {
    numbers(latch.closed, latch.holds, latch.overloaded, latch.progress);
    lists(latch.met.linear, latch.met.angular, latch.impulse.linear, latch.impulse.angular);
  }
  if (!w.dents.empty()) {
    visit(w.next_dent, {0, static_cast<double>(w.dents.size() - 1)});
    visit(w.forgotten, kIndex);
    for (auto& dent : w.dents) {
      visit(dent.body, {-1, kMostWhole});
      visit(dent.shape, kIndex);
      numbers(dent.reach, dent.area, dent.depth, dent.pierced);
      lists(dent.p);
    }
    for (auto& one : w.yielding) numbers(one.depth, one.work, one.pierced);
  }
  static const Contact none;
  for (std::size_t t = 0; t < kept; ++t) {
    auto& touch = [&]() -> auto& {
      if constexpr (kReads) {
        return w.touches[t];
      } else {
        return t < w.touches.size() ? w.touches[t] : none;
      }
    }
    ();
    auto& point = touch.point;
    for (auto* whole : {&point.body_a, &point.body_b, &point.shape_a, &point.shape_b}) visit(*whole, kWhole);
    std::uint64_t high = point.id >> 32U, low = point.id & 0xffffffffU;
    visit(high, kHalfOfId);
    visit(low, kHalfOfId);
    if constexpr (kReads) point.id = high << 32U | low;
    auto& travel = touch.travel;
    lists(point.p_W, touch.impulse, travel.a, travel.b, travel.change_a, travel.change_b);
    numbers(travel.known, travel.goes_on);
  }
}

/// Brings all that follows from a state that was read in line with it.
void World::Impl::after_restore() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    bodies[b].place();
    poses[b] = bodies[b].pose();
    twists[b] = bodies[b].twist();
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    joints[j].place(bodies);
    q[j] = joints[j].q;
    dq[j] = joints[j].has_axis() ? joints[j].speed(bodies) : 0;
    const int f = forest.freedom_of(static_cast<int>(j));
    if (f >= 0) forest.freedoms()[index(f)].s = dq[j];
  }
  for (Latch& latch : latches) {
    latch.progress = std::clamp(latch.progress, 0.0, 1.0);
    latch.sum = {};
    latch.joint.place(bodies);
  }
  for (Dent& dent : dents) dent.is_new = false;
  const bool margin_is_restored = restored;
  latches_changed();
  restored = margin_is_restored;
  points.clear();
  forces.clear();
  joints_hold = false;
}

std::size_t World::state_size() const {
  Counter counter;
  Impl::each_state(std::as_const(*impl_), counter);
  return counter.count;
}

void World::save(std::vector<double>& state) const {
  state.resize(state_size());
  Writer writer{state.data()};
  Impl::each_state(std::as_const(*impl_), writer);
  std::fill(writer.to, state.data() + state.size(), 0.0);
}

void World::restore(std::span<const double> state) {
  Reader<true> check{state.data()};
  Impl::each_state(std::as_const(*impl_), check);
  for (const double number : state.subspan(static_cast<std::size_t>(check.from - state.data()))) {
    if (!(std::abs(number) < kLargest)) refuse(number, {});
  }
  Reader<false> reader{state.data()};
  Impl::each_state(*impl_, reader);
  impl_->after_restore();
}

}  // namespace cotwin::contact_world
