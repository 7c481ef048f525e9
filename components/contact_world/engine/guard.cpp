// Detection of joints that part and of energy that no work explains.
#include "components/contact_world/engine/guard.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"
#include "models/foundation/support/text.h"

namespace cotwin::contact_world {
namespace {

/// Joints within these bounds are assembled.
constexpr double kAssembledGap = 1e-4, kAssembledAngle = 1e-3;  // m, rad (m for a prismatic joint's limits)

/// Largest tilt of an assembled joint, and the growth of gap or tilt of one that started apart.
constexpr double kLargestTilt = 0.1;  // rad
constexpr double kGrowth = 1.5;

/// Joints that hold (Impl::joints_hold) have smaller gaps than this.
constexpr double kCertainGap = 1e-4;  // m

/// Joints that start apart must come nearer by 1 % at least once in this number of steps.
constexpr double kStalledSteps = 200;
constexpr double kNearer = 0.99;

/// In soft contacts deeper than this, relative to the smaller body, normals jump and the springs' energy with them.
constexpr double kDeep = 0.05;

/// Bodies that overlap by more than this are named in messages.
constexpr double kNamedOverlap = 1e-3;  // m

/// Gains below the energy of this height and this speed of all bodies are no error.
constexpr double kSmallHeight = 0.01, kSmallSpeed = 0.1;  // m, m/s
constexpr double kSmallEnergy = 1e-6;                     // J

double tilt(const Joint& joint) { return std::acos(std::clamp(joint.alignment(), -1.0, 1.0)); }

}  // namespace

double World::Impl::elastic_energy() const {
  double twice = 0;
  for (const Contact& touch : touches) twice += touch.stored();
  return twice / 2;
}

World::Impl::Energy World::Impl::measure_energy() const {
  Energy energy;
  double twice = 0;
  for (const RigidBody& body : bodies) {
    if (!body.dynamic()) continue;
    twice += body.mass * body.v.squaredNorm() + body.L.dot(body.w);
    energy.potential -= body.mass * scene.gravity.dot(body.p);
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    const double extension = joints[j].q - joints[j].q_spring;
    twice += axes[j].inertia * dq[j] * dq[j] + joints[j].stiffness * extension * extension;
  }
  energy.elastic = elastic_energy();
  energy.motion = twice / 2 + energy.elastic;
  return energy;
}

/// Kinetic energy with the inertias of axes.
double World::Impl::motion_energy() const {
  double twice = 0;
  for (const RigidBody& body : bodies) {
    if (body.dynamic()) twice += body.mass * body.v.squaredNorm() + body.L.dot(body.w);
  }
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!(axes[j].inertia > 0)) continue;
    const double speed = joints[j].speed(bodies);
    twice += axes[j].inertia * speed * speed;
  }
  return twice / 2;
}

/// Takes a state that was set from outside. The energy that this added is work.
void World::Impl::begin_guard() {
  guard.work = guard.lifted = guard.passive = guard.placed = 0;
  guard.elastic = elastic_energy();
  guard.counts = std::all_of(carriers.begin(), carriers.end(),
                             [&](int b) { return bodies[index(b)].v.isZero(0) && bodies[index(b)].w.isZero(0); });
  if (!guard.moved) return;
  guard.moved = false;
  for (std::size_t j = 0; j < joints.size(); ++j) {
    if (!joints[j].has_axis()) continue;
    joints[j].measure();
    dq[j] = joints[j].speed(bodies);
  }
  const Energy now = measure_energy();
  if (!guard.begun) {
    guard.begun = true;
    guard.available = now.motion;
    guard.highest = now.potential;
  } else {
    guard.available += std::max(0.0, now.motion + now.potential - guard.energy);
    guard.highest += now.potential - guard.potential;
  }
  guard.energy = now.motion + now.potential;
  guard.potential = now.potential;
  guard.start_gap = guard.start_tilt = 0;
  guard.assembling = !assembled();
  if (!guard.assembling) return;
  guard.start_gap = largest_gap();
  for (const Joint& joint : joints) guard.start_tilt = std::max(guard.start_tilt, tilt(joint));
  guard.nearest = guard.start_gap;
  guard.stalled = 0;
}

bool World::Impl::assembled() {
  for (const Joint& joint : joints) {
    if (joint.gap() > kAssembledGap || tilt(joint) > kAssembledAngle) return false;
    if (joint.has_axis() && !(joint.q >= joint.q_min - kAssembledAngle && joint.q <= joint.q_max + kAssembledAngle))
      return false;
  }
  return std::all_of(scene.gears.begin(), scene.gears.end(),
                     [&](const scene::Gear& gear) { return std::abs(gear_error(gear)) <= kAssembledAngle; });
}

double World::Impl::largest_gap() const {
  double gap = 0;
  for (const Joint& joint : joints) gap = std::max(gap, joint.gap());
  return gap;
}

/// Stores the bodies' motion before forces and impulses act.
void World::Impl::begin_stage() {
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (bodies[b].motion != scene::Motion::kStatic) starts[b] = {bodies[b].p, bodies[b].v, bodies[b].w};
  }
}

/// Impulse of limits, friction and motor of a joint in the last solution.
double World::Impl::axis_impulse(std::size_t joint) {
  const std::array<double, kJointRows>& x = joint_x[joint];
  double sum = 0;
  for (int row = kSpringRow + 1; row < kGearRow; ++row) sum += x[index(row)];
  const int f = forest.freedom_of(static_cast<int>(joint));
  if (f >= 0 && !laws[joint].empty()) sum += laws[joint].impulse(forest.freedoms()[index(f)]);
  return sum;
}

/// Work of gravity, of applied wrenches, and of contacts on the relative motion of their bodies, and the impulses on the axes of joints. The arms are those of the stage's start,
/// because bodies with joints have moved since.
void World::Impl::account_stage(Stage stage, double h) {
  const auto mean = [&](int body, const Vector3d& p) -> Vector3d {
    const RigidBody& now = bodies[index(body)];
    const Start& start = starts[index(body)];
    return (start.v + now.v + (start.w + now.w).cross(p - start.p)) / 2;
  };
  for (const ConeRow& row : rows.cones()) {
    const Contact& touch = touches[index(row.point)];
    if (touch.impulse.isZero(0)) continue;
    const Vector3d& p = touch.point.p_W;
    guard.passive += touch.impulse.dot(mean(touch.point.body_b, p) - mean(touch.point.body_a, p));
  }
  const auto mean_spin = [&](int body) -> Vector3d {
    return body < 0 ? Vector3d(Vector3d::Zero()) : Vector3d((starts[index(body)].w + bodies[index(body)].w) / 2);
  };
  for (const BoxRow& row : rows.boxes()) {
    const RowOrigin& origin = row_origin[index(row.origin)];
    if (origin.joint < 0 && origin.latch < 0) guard.passive += row.x * row.m.dot(mean_spin(row.b) - mean_spin(row.a));
  }
  account_latches();
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const RigidBody& body = bodies[b];
    if (!body.dynamic()) continue;
    const Vector3d way = h / 4 * (starts[b].v + body.v);
    guard.passive += body.mass * scene.gravity.dot(way);
    const Wrench& F = applied[b];
    if (F.isZero(0)) continue;
    const Vector3d turn = h / 4 * (starts[b].w + body.w);
    guard.add_work(F.head<3>().dot(way + turn.cross(body.R * body.X_PB.p)) + F.tail<3>().dot(turn));
  }
  for (std::size_t j = 0; j < joints.size(); ++j) axes[j].passive[stage == Stage::kPosition ? 0 : 1] = axis_impulse(j);
}

/// Work of the contacts' position correction, which lifts bodies, of driven bodies and of applied wrenches; called after the
/// position stage.
void World::Impl::account_position_stage(double h) {
  account_stage(Stage::kPosition, h);
  // An upper bound: the force of the whole step is at most twice that of its first half.
  for (const ConeRow& row : rows.cones()) {
    guard.lifted += 2 * row.x[0] * row.lift;
  }
  if (has_driven) {
    for (const Contact& touch : touches) guard.add_work(driven_work(touch, touch.impact + touch.sum));
  }
}

void World::Impl::account_velocity_stage(double h) {
  account_stage(Stage::kVelocity, h);
  if (!has_driven) return;
  for (const Contact& touch : touches) guard.add_work(driven_work(touch, touch.impulse));
}

/// Work of a driven body by an impulse on b.
double World::Impl::driven_work(const Contact& touch, const Vector3d& impulse) const {
  const auto along = [&](int body) {
    const RigidBody& one = bodies[index(body)];
    if (one.motion != scene::Motion::kDriven) return 0.0;
    return impulse.dot(one.v + one.w.cross(touch.point.p_W - one.p));
  };
  return along(touch.point.body_a) - along(touch.point.body_b);
}

/// Work of drive, motor, limits, friction and damper of a joint in a step from position q_0 and speed s_0 to the joint's present position and
/// speed s_1. The joint's own spring does no work: its energy is part of E.
void World::Impl::account_axis(std::size_t joint, double q_0, double s_0, double s_1, double h) {
  const Axis& axis = axes[joint];
  const double s = (joints[joint].q - q_0) / h, damping = h / 2 * joints[joint].damping;
  const auto work = [&](double first, double second) { return first * (s_0 + s) / 2 + second * (s + s_1) / 2; };
  guard.passive -= work(damping * s, damping * s_1);
  const double others = work(axis.passive[0], axis.passive[1]);
  if (axis.motor_torque > 0) {
    guard.add_work(others);
  } else {
    guard.passive += others;
  }
  if (axis.tau == 0 && axis.stiffness == 0 && axis.damping == 0) return;
  const double constant = axis.tau + axis.stiffness * h / 2 * (axis.rate - s);
  guard.add_work(
      work(h / 2 * (constant + axis.damping * (axis.rate - s)), h / 2 * (constant + axis.damping * (axis.rate - s_1))));
}

void World::Impl::end_guard() {
  double jumps = 0;  // J, twice the energy of soft contacts whose normals may jump
  for (const Contact& touch : touches) {
    if (touch.stiffness == scene::kInfinity || touch.without_effect || touch.point.gap > 0) continue;
    if (!touch.matched) guard.placed += touch.stored() / 2;  // a manifold's new point has energy at once
    const double size = std::min(bodies[index(touch.point.body_a)].radius, bodies[index(touch.point.body_b)].radius);
    if (touch.jumped && -touch.point.gap > kDeep * size) jumps += touch.stored();
  }
  const Energy now = measure_energy();
  const double total = now.motion + now.potential;
  // Corrections of depth lift bodies and press others together. The velocity stage takes their speed back, so they explain no
  // motion: impulses that bodies without room exert on one another have no bound.
  const double higher = std::max(0.0, now.potential - guard.potential) + std::max(0.0, now.elastic - guard.elastic);
  const double lifted = std::min(guard.lifted, higher);
  guard.add_work(lifted + guard.placed);
  double gain = total - guard.energy - guard.work;
  // Without what gravity and the soft contacts' springs have stored. Errors of one solution that the next one takes back are no gain.
  const double stored = now.potential - guard.potential + now.elastic - guard.elastic;
  const double passive = guard.passive + stored - guard.placed - lifted;
  const double lost = std::max(0.0, -passive - guard.owed);
  guard.owed = std::max(0.0, guard.owed + passive);
  gain += lost;
  // Jumps may give the energy of their springs and no more than there was before, in all steps together.
  if (gain < 0) guard.jumped = std::max(0.0, guard.jumped + gain);
  if (gain > 0 && jumps > 0) {
    const double most = jumps + guard.available + guard.fall + small_energy - guard.jumped;
    const double explained = std::clamp(most, 0.0, gain);
    guard.jumped += explained;
    gain -= explained;
  }
  if (guard.counts && !guard.assembling) guard.excess = std::max(0.0, guard.excess + gain);
  guard.energy = total;
  guard.potential = now.potential;
  guard.highest = std::max(guard.highest, now.potential);
  guard.fall = std::max(guard.fall, guard.highest - now.potential);
  if (!guard.assembling) return;
  const double gap = largest_gap();
  if (gap < kNearer * guard.nearest) {
    guard.nearest = gap;
    guard.stalled = 0;
  } else {
    ++guard.stalled;
  }
  if (!assembled()) return;
  guard.assembling = false;
  guard.start_gap = guard.start_tilt = 0;
}

/// Index of the joint with the largest gap.
std::size_t World::Impl::widest_joint() const {
  const auto wider = [](const Joint& a, const Joint& b) { return a.gap() < b.gap(); };
  return static_cast<std::size_t>(std::max_element(joints.begin(), joints.end(), wider) - joints.begin());
}

std::string World::fault(double gap_limit, double energy_limit) const {
  const Impl& w = *impl_;
  const Guard& guard = w.guard;
  const auto name = [&](std::size_t j) { return "joint '" + w.scene.joints[j].name + "'"; };
  if (gap_limit > 0) {
    const double limit = std::max(gap_limit, kGrowth * guard.start_gap);
    const bool holds = w.joints_hold && gap_limit > kCertainGap;
    const double largest_tilt = std::max(kLargestTilt, kGrowth * guard.start_tilt);
    static const double kAligned = std::cos(kLargestTilt);
    const double aligned = guard.start_tilt == 0 ? kAligned : std::cos(std::min(largest_tilt, std::numbers::pi));
    for (std::size_t j = 0; j < w.joints.size() && !holds; ++j) {
      if (w.joints[j].gap() > limit) {
        return name(j) + " has parted by " + text::to_text(w.joints[j].gap(), 4) + " m, expected at most " +
               text::to_text(limit, 4) + " m (joint_gap_limit): use shorter steps";
      }
      if (w.joints[j].alignment() < aligned) {
        return name(j) + " is tilted by " + text::to_text(tilt(w.joints[j]), 4) + " rad, expected at most " +
               text::to_text(largest_tilt, 4) + " rad (joint_gap_limit): use shorter steps";
      }
    }
    if (guard.assembling && guard.stalled > kStalledSteps && guard.nearest > gap_limit) {
      const std::size_t j = w.widest_joint();
      return name(j) + " does not close: its gap remains " + text::to_text(w.joints[j].gap(), 4) + " m, expected at most " +
             text::to_text(gap_limit) + " m (joint_gap_limit): correct the frames of the joints or the start positions";
    }
  }
  if (!(energy_limit > 0)) return {};
  const double limit = energy_limit * (guard.available + guard.fall) + w.small_energy;
  if (!(guard.excess > limit)) return {};
  std::string where, advice = "use shorter steps";
  const auto deepest = std::min_element(w.points.begin(), w.points.end(),
                                        [](const ContactPoint& a, const ContactPoint& b) { return a.gap < b.gap; });
  if (deepest != w.points.end() && deepest->gap < -kNamedOverlap) {
    const auto body = [&](int index) { return "'" + w.scene.bodies[static_cast<std::size_t>(index)].name + "'"; };
    where = "bodies " + body(deepest->body_a) + " and " + body(deepest->body_b) + " overlap by " +
            text::to_text(-deepest->gap, 4) + " m";
    advice = "start them apart, or " + advice;
  } else if (!w.joints.empty()) {
    const std::size_t j = w.widest_joint();
    where = name(j) + " has the largest gap, " + text::to_text(w.joints[j].gap(), 4) + " m";
    for (const Forest::Tree& tree : w.forest.trees()) {
      if (tree.loops.empty() || !tree.loops.nearly_singular()) continue;
      where = "the loop that " + name(index(tree.loops.rows()[0].joint)) +
              " closes is in a nearly singular position, as are links in line";
      advice = "start it away from there, give the links slack, or let a joint yield: shorter steps do not help";
    }
  } else {
    const auto slower = [](const RigidBody& a, const RigidBody& b) { return a.kinetic_energy() < b.kinetic_energy(); };
    const auto fastest = std::max_element(w.bodies.begin(), w.bodies.end(), slower) - w.bodies.begin();
    where = "body '" + w.scene.bodies[static_cast<std::size_t>(fastest)].name + "' has the largest kinetic energy";
  }
  return "energy has grown by " + text::to_text(guard.excess, 4) + " J without work (" + where + "), expected at most " +
         text::to_text(limit, 4) + " J (energy_limit): " + advice;
}

double World::gain() const {
  const Guard& guard = impl_->guard;
  return guard.excess / (guard.available + guard.fall + impl_->small_energy);
}

double World::Impl::small_energy_of(const scene::Scene& scene) {
  double mass = 0;
  for (const scene::Body& body : scene.bodies) {
    if (body.motion == scene::Motion::kDynamic) mass += body.inertia.mass;
  }
  return mass * (scene.gravity.norm() * kSmallHeight + kSmallSpeed * kSmallSpeed / 2) + kSmallEnergy;
}

}  // namespace cotwin::contact_world
