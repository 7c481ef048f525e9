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

/// Gains below the energy of this height and this speed of all bodies are no error.
constexpr double kSmallHeight = 0.01, kSmallSpeed = 0.1;  // m, m/s
constexpr double kSmallEnergy = 1e-6;                     // J

double tilt(const Joint& joint) { return std::acos(std::clamp(joint.alignment(), -1.0, 1.0)); }

}  // namespace

double World::Impl::elastic_energy() const {
  double twice = 0;
  for (const Touch& touch : touches) twice += touch.stored();
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

/// Takes a state that was set from outside. The energy that this added is work.
void World::Impl::begin_guard() {
  guard.work = guard.lifted = 0;
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

/// Work of the contacts' position correction, which lifts bodies, of driven bodies and of applied wrenches; called after the
/// position stage.
void World::Impl::account_position_stage(double h) {
  // An upper bound: the force of the whole step is at most twice that of its first half.
  for (const ConeRow& row : rows.cones()) {
    guard.lifted += 2 * row.x[0] * row.lift;
  }
  if (has_driven) {
    for (const Touch& touch : touches) guard.add_work(driven_work(touch, touch.impact + touch.sum));
  }
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!applied[b].isZero(0) && bodies[b].dynamic()) guard.add_work(h * applied[b].dot(bodies[b].twist()));
  }
}

void World::Impl::account_velocity_stage() {
  if (!has_driven) return;
  for (const Touch& touch : touches) guard.add_work(driven_work(touch, touch.impulse));
}

/// Work of a driven body by an impulse on b.
double World::Impl::driven_work(const Touch& touch, const Vector3d& impulse) const {
  const auto along = [&](int body) {
    const RigidBody& one = bodies[index(body)];
    if (one.motion != scene::Motion::kDriven) return 0.0;
    return impulse.dot(one.v + one.w.cross(touch.point.p_W - one.p));
  };
  return along(touch.point.body_a) - along(touch.point.body_b);
}

/// Work of the drive of a joint in a step from position q_0 and speed s_0 to the joint's present position and speed s_1: impulse times
/// mean speed of each stage. The joint's own spring does no work: its energy is part of E.
void World::Impl::account_axis(std::size_t joint, double q_0, double s_0, double s_1, double h) {
  const Axis& axis = axes[joint];
  if (axis.motor_torque > 0) {
    if (axis.motor_torque < scene::kInfinity) {
      guard.add_work(axis.motor_torque * std::abs(joints[joint].q - q_0));  // an upper bound
    } else {
      guard.counts = false;
    }
  }
  if (axis.tau == 0 && axis.stiffness == 0 && axis.damping == 0) return;
  const double s = (joints[joint].q - q_0) / h, constant = axis.tau + axis.stiffness * h / 2 * (axis.rate - s);
  const double first = h / 2 * (constant + axis.damping * (axis.rate - s));
  const double second = h / 2 * (constant + axis.damping * (axis.rate - s_1));
  double work = first * (s_0 + s) / 2;
  if (status.impacts > 0) work = std::max(work, first * s);  // s_0 is the speed before the impacts
  guard.add_work(work + second * (s + s_1) / 2);
}

void World::Impl::end_guard() {
  double jumps = 0;  // J, twice the energy of soft contacts whose normals may jump
  for (const Touch& touch : touches) {
    if (touch.stiffness == scene::kInfinity || touch.without_effect || touch.point.gap > 0) continue;
    if (!touch.matched) guard.add_work(touch.stored() / 2);  // a manifold's new point has energy at once
    const double size = std::min(bodies[index(touch.point.body_a)].radius, bodies[index(touch.point.body_b)].radius);
    if (-touch.point.gap > kDeep * size) jumps += touch.stored();
  }
  const Energy now = measure_energy();
  const double total = now.motion + now.potential;
  // Corrections of depth lift bodies and press others together. The velocity stage takes their speed back, so they explain no
  // motion: impulses that bodies without room exert on one another have no bound.
  const double higher = std::max(0.0, now.potential - guard.potential) + std::max(0.0, now.elastic - guard.elastic);
  guard.add_work(std::min(guard.lifted, higher));
  double gain = total - guard.energy - guard.work;
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
  std::string where;
  if (!w.joints.empty()) {
    const std::size_t j = w.widest_joint();
    where = name(j) + " has the largest gap, " + text::to_text(w.joints[j].gap(), 4) + " m";
  } else {
    const auto slower = [](const RigidBody& a, const RigidBody& b) { return a.kinetic_energy() < b.kinetic_energy(); };
    const auto fastest = std::max_element(w.bodies.begin(), w.bodies.end(), slower) - w.bodies.begin();
    where = "body '" + w.scene.bodies[static_cast<std::size_t>(fastest)].name + "' has the largest kinetic energy";
  }
  return "energy has grown by " + text::to_text(guard.excess, 4) + " J without work (" + where + "), expected at most " +
         text::to_text(limit, 4) + " J (energy_limit): use shorter steps";
}

double World::Impl::small_energy_of(const scene::Scene& scene) {
  double mass = 0;
  for (const scene::Body& body : scene.bodies) {
    if (body.motion == scene::Motion::kDynamic) mass += body.inertia.mass;
  }
  return mass * (scene.gravity.norm() * kSmallHeight + kSmallSpeed * kSmallSpeed / 2) + kSmallEnergy;
}

}  // namespace cotwin::contact_world
