// The rows of a stage of a step: joints outside the trees, gears and contacts.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Share of a penetration beyond the slop that one step corrects, and the largest speed of the correction.
constexpr double kCorrection = 0.2;
constexpr double kSlop = 5e-6;              // m
constexpr double kFastestCorrection = 0.1;  // m/s

/// Steps from the middle of the last one, where the travel is known, to that of the first half of the next one, for which it is needed.
constexpr double kAhead = 0.75;

/// Friction above this share of its bound slides.
constexpr double kOnCone = 1 - 1e-6;

/// Smaller gaps are treated as zero: a solver leaves such ones between bodies at rest, and they would part redundant points.
constexpr double kGapNoise = 1e-9;  // m

}  // namespace

/// Velocity of b relative to a at the point before the forces of the stage act.
Vector3d World::Impl::start_velocity(const Contact& touch) const {
  const auto of = [&](int body) -> Vector3d {
    if (bodies[index(body)].motion == scene::Motion::kStatic) return Vector3d::Zero();
    const Start& start = starts[index(body)];
    return start.v + start.w.cross(touch.point.p_W - bodies[index(body)].p);
  };
  return of(touch.point.body_b) - of(touch.point.body_a);
}

/// Speed that the impulse of the last solution alone gives the bodies, m/s.
double World::Impl::pressed_before(const Contact& touch) const {
  return touch.point.n_W.dot(touch.impulse) *
         (bodies[index(touch.point.body_a)].inverse_mass + bodies[index(touch.point.body_b)].inverse_mass);
}

/// Speed below which bodies are at rest that forces press together with the speed `pressed` in a stage, m/s.
double World::Impl::rest_of(double pressed, double h) const {
  return std::clamp(2 * kSlow * pressed, rest, std::max(rest, kSlow * h * kMostPressed));
}

/// The same of a contact that the forces of the stage press and, if it is soft, its spring.
double World::Impl::rest_of(const Contact& touch, double h) const {
  if (!weightless(h)) return rest;
  const double forces = touch.point.n_W.dot(start_velocity(touch)) - normal_velocity(touch), before = pressed_before(touch);
  return rest_of(touch.stiffness < kInfinity ? forces + before : std::max(forces, before), h);
}

void World::Impl::collect_rows(Stage stage, double h) {
  rows.clear();
  row_origin.clear();
  for (const LooseJoint& one : loose) collect_joint(one, stage, h);
  for (const scene::Gear& gear : scene.gears) collect_gear(gear, stage, h);
  for (std::size_t i = 0; i < latches.size(); ++i) collect_latch(i, stage, h);
  for (std::size_t t = 0; t < touches.size(); ++t) collect_contact(t, stage, h);
}

void World::Impl::collect_joint(const LooseJoint& one, Stage stage, double h) {
  const Joint& joint = joints[index(one.joint)];
  const Axis& axis = axes[index(one.joint)];
  const std::array<double, kJointRows>& x = joint_x[index(one.joint)];
  const Motion6 error = one.whole && stage == Stage::kPosition ? joint.error() : Motion6{};
  const auto add = [&](int row, const Vector3d& d, const Vector3d& m, double target, double lo, double hi, double softness) {
    BoxRow made;
    made.a = joint.parent >= 0 && bodies[index(joint.parent)].motion != scene::Motion::kStatic ? joint.parent : -1;
    made.b = joint.child >= 0 && bodies[index(joint.child)].motion != scene::Motion::kStatic ? joint.child : -1;
    made.d = d;
    made.m = m;
    made.p = joint.p_child;
    made.target = target;
    made.lo = lo;
    made.hi = hi;
    made.softness = softness;
    made.x = std::clamp(x[index(row)], lo, hi);
    if (row == kMotorRow) {  // presses with the speed that it would give without contacts
      double mobility = 0;
      for (const int body : {made.a, made.b}) mobility += body >= 0 ? bodies[index(body)].mobility(d, m, made.p) : 0;
      made.rest = rest_of(std::min(hi * mobility, std::abs(target - joint.speed(bodies))), h);
    }
    if (row < 6) made.target = -kShareOfJointError * (d.dot(error.linear) + m.dot(error.angular)) / h;
    row_origin.push_back({one.joint, row});
    rows.add(made);
  };
  const Vector3d zero = Vector3d::Zero();
  if (one.whole) {
    const bool slides = joint.type == scene::JointType::kPrismatic;
    const bool screw = joint.type == scene::JointType::kScrew;
    for (int k = 0; k < (slides ? 2 : 3); ++k) {
      const Vector3d d = slides || screw ? Vector3d(joint.R_parent.col(k)) : Vector3d(Vector3d::Unit(k));
      const Vector3d m = screw && k == 2 ? Vector3d(-joint.pitch * joint.axis()) : zero;
      add(k, d, m, 0, -kInfinity, kInfinity, 0);
    }
    const int turns = joint.type == scene::JointType::kSpherical ? 0 : joint.turns() ? 2 : 3;
    for (int k = 0; k < turns; ++k) {
      const Vector3d m = joint.R_parent.col(k);
      add(3 + k, zero, m, 0, -kInfinity, kInfinity, 0);
    }
  }
  if (!joint.has_axis()) return;
  const bool turns = joint.turns();
  const Vector3d d = turns ? zero : joint.axis(), m = turns ? joint.axis() : zero;
  const AxisDrive drive(joint, axis, stage, h);
  if (forest.freedom_of(one.joint) < 0 && drive.softness > 0) add(6, d, m, 0, -kInfinity, kInfinity, 1 / drive.softness);
  const LimitSpeeds limits(joint, stage, h);
  if (limits.lower > -kInfinity) add(7, d, m, limits.lower, 0, kInfinity, 0);
  if (limits.upper < kInfinity) add(8, d, m, limits.upper, -kInfinity, 0, 0);
  if (joint.friction > 0) add(9, d, m, 0, -joint.friction * h / 2, joint.friction * h / 2, 0);
  if (axis.motor_torque > 0) add(kMotorRow, d, m, axis.motor_speed, -axis.motor_torque * h / 2, axis.motor_torque * h / 2, 0);
}

void World::Impl::collect_contact(std::size_t t, Stage stage, double h) {
  Contact& touch = touches[t];
  if (touch.distant || touch.without_effect) return;
  const double gap = std::abs(touch.point.gap) > kGapNoise ? touch.point.gap : 0;
  const Vector3d& n = touch.point.n_W;
  ConeRow row = contact_row(t);
  row.rest = rest_of(touch, h);
  // Bodies that approach will bounce at the start of the next step, unless only forces press them together.
  const bool bounces =
      touch.restitution > 0 && normal_velocity(touch) < -row.rest && n.dot(start_velocity(touch)) < -row.rest / 2;
  if (touch.stiffness < kInfinity) {
    if (!collect_spring(t, row, stage, h)) return;
  } else {
    row.target = -gap / h;
    if (gap <= 0) {
      // The velocity stage removes the velocity of the position stage's correction, limited by the impulse of the whole step.
      row.lift = stage == Stage::kVelocity ? 0 : std::min(kCorrection * std::max(-gap - kSlop, 0.0) / h, kFastestCorrection);
      row.target = row.lift;
      if (stage == Stage::kVelocity && options.method != Method::kDantzig) row.lo = std::min(0.0, -n.dot(touch.sum));
    }
    if (bounces && stage == Stage::kVelocity) return;
  }
  if (stage == Stage::kPosition && touch.travel.goes_on) {  // the laws hold for the middle of the step
    const Vector3d change = h / 2 * change_along(touch);
    if (touch.stiffness == kInfinity && !bounces) row.target -= n.dot(change);
    for (int k = 0; k < 2; ++k) row.slide[k] = -row.d.col(k + 1).dot(change);
  }
  Eigen::Map<Vector3d>(row.x) = row.d.transpose() * touch.impulse;
  for (int k = 0; k < 2; ++k) {
    const double share = touch.mu_share[k];
    if (share != 1) row.x[k + 1] = share > 0 ? row.x[k + 1] / (share * share) : 0;
  }
  row.x[0] = std::max(row.x[0], row.lo);
  row.slid = row.x[0] > 0 && std::hypot(row.x[1], row.x[2]) >= kOnCone * row.mu * row.x[0];
  row.speed = start_velocity(touch).norm();
  rows.add(row);
  // Bounded by the normal impulse of the last solution: exact for constant forces.
  const double spin = touch.torsion * std::max(n.dot(touch.impulse), 0.0);
  if (!(spin > 0)) return;
  BoxRow turn;
  turn.a = row.a;
  turn.b = row.b;
  turn.m = n;
  turn.p = row.p;
  turn.lo = -spin;
  turn.hi = spin;
  row_origin.push_back({-1, kJointRows});
  rows.add(turn);
}

/// Rate at which the relative velocity of the bodies at the point changes during the drift, because the point travels and because free bodies
/// change their angular velocity, m/s².
Vector3d World::Impl::change_along(const Contact& touch) const {
  const auto of = [&](const RigidBody& body, const Vector3d& travel) -> Vector3d {
    Vector3d change = body.w.cross(travel);
    if (body.dynamic()) {
      const Vector3d moment = -body.w.cross(body.L);
      const Vector3d turn = body.R * body.inverse_moments.cwiseProduct(body.R.transpose() * moment);
      change += turn.cross(touch.point.p_W - body.p);
    }
    return change;
  };
  return of(bodies[index(touch.point.body_b)], touch.travel.b + kAhead * touch.travel.change_b) -
         of(bodies[index(touch.point.body_a)], touch.travel.a + kAhead * touch.travel.change_a);
}

/// The row of a contact point without target and impulse.
ConeRow World::Impl::contact_row(std::size_t t) const {
  const Contact& touch = touches[t];
  const Vector3d& n = touch.point.n_W;
  ConeRow row;
  row.a = bodies[index(touch.point.body_a)].motion == scene::Motion::kStatic ? -1 : touch.point.body_a;
  row.b = bodies[index(touch.point.body_b)].motion == scene::Motion::kStatic ? -1 : touch.point.body_b;
  Eigen::Index least = 0;
  n.cwiseAbs().minCoeff(&least);
  const Vector3d t1 = touch.tangent.isZero(0) ? Vector3d(n.cross(Vector3d::Unit(least)).normalized()) : touch.tangent;
  // Tangents scaled by their share of mu make the elliptic cone a round one.
  row.d << n, touch.mu_share[0] * t1, touch.mu_share[1] * n.cross(t1);
  row.p = touch.point.p_W;
  row.mu = touch.mu;
  row.point = static_cast<int>(t);
  return row;
}

}  // namespace cotwin::contact_world
