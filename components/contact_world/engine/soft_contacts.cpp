// The soft contacts of a world: soft_contact.h in the two stages of a step.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Difference of an impulse from its linearisation, relative to the impulse, that is accepted.
constexpr double kCurved = 1e-6;

/// Share of the limit from which a contact yields all through the step.
constexpr double kYields = 1 - 1e-9;

/// (h ω)² above which sweeps are not exact enough.
constexpr double kStiff = 100;

}  // namespace

/// Adds the law of a soft contact to its row. Returns whether the row is needed. The velocity stage repeats the spring's impulse of
/// the position stage.
bool World::Impl::collect_spring(std::size_t t, ConeRow& row, Stage stage, double h) {
  const Contact& touch = touches[t];
  if (stage == Stage::kVelocity && touch.conserves) {
    row.spring = ConeRow::Spring::kGiven;
    row.push = touch.push;
    row.damper = h / 2 * touch.damping * touch.share;
    return touch.push > 0;
  }
  row.spring = ConeRow::Spring::kLaw;
  row.law = {touch.gap, touch.stiffness, touch.damping, h};
  row.law.limit = touch.limit;
  row.u = normal_velocity(touch);
  if (stage == Stage::kPosition) {
    // Other contacts may push the bodies together within the step, so open points have rows as well.
    const double mobility = bodies[index(touch.point.body_a)].inverse_mass + bodies[index(touch.point.body_b)].inverse_mass;
    const bool light = touch.damping * touch.damping * mobility < 4 * kDamped * touch.stiffness;
    row.law.conserves = light;
    row.slow = row.rest;
    return touch.gap <= 0 || row.law.conserves;
  }
  return touch.gap <= 0;
}

/// Whether contacts in the step have very stiff springs. They do not damp errors of the solution, which would
/// create energy, so they are pivoted, except where joints are swept.
bool World::Impl::has_stiff_springs() const {
  if (!pivots) return false;
  for (const ConeRow& row : rows.cones()) {
    const bool acts = row.law.gap <= 0 || row.law.gap + row.law.h * row.u < 0;
    if (row.spring == ConeRow::Spring::kLaw && row.swing > kStiff && acts) return true;
  }
  return false;
}

/// Linearises the soft contacts at their new velocities. Returns whether an impulse differs from its law. The law of a contact with
/// a limit is not convex, and velocities can alternate between two sides of its bend for ever: then the change is at most half
/// of that before.
bool World::Impl::linearise_springs() {
  bool differs = false;
  for (ConeRow& row : rows.cones()) {
    if (row.spring != ConeRow::Spring::kLaw || !row.law.conserves) continue;
    const double u = normal_velocity(touches[index(row.point)]);
    const double exact = std::max(0.0, row.law.impulse(u)), linear = std::max(0.0, (row.target - u) / row.softness);
    if (std::abs(exact - linear) <= kCurved * std::max(exact, linear)) continue;
    const double change = u - row.u;
    const bool alternates = row.law.limit < kInfinity && change * row.change < 0 && std::abs(change) > std::abs(row.change) / 2;
    row.change = alternates ? -row.change / 2 : change;
    row.u += row.change;
    differs = true;
  }
  return differs;
}

void World::Impl::store_spring_impulses() {
  for (Contact& touch : touches) {
    touch.push = touch.share = 0;
    touch.conserves = false;
  }
  for (const ConeRow& row : rows.cones()) {
    if (row.spring != ConeRow::Spring::kLaw) continue;
    const double x = row.x[0];
    if (x > 0) status.swing = std::max(status.swing, std::sqrt(row.swing));
    Contact& touch = touches[index(row.point)];
    const double u = normal_velocity(touch);
    if (!row.law.conserves) continue;
    touch.conserves = true;
    touch.share = x < row.law.h / 2 * row.law.limit * kYields ? row.law.share(u) : 0;              // the limit is that of both
    if (x > 0) touch.push = std::max(0.0, x + row.law.h / 2 * row.law.damping * touch.share * u);  // without the damper
  }
}

/// Applies the spring impulses of points that have no successor at the new poses.
void World::Impl::apply_lost_springs() {
  for (const Contact& touch : touches_before) {
    if (touch.matched || touch.push == 0 || touch.stiffness == kInfinity) continue;
    const Vector3d& p = touch.point.p_W;
    const auto speed = [&](int b) {
      const RigidBody& body = bodies[index(b)];
      return touch.point.n_W.dot(body.v + body.w.cross(p - body.p));
    };
    const double at_a = speed(touch.point.body_a), at_b = speed(touch.point.body_b);
    for (const int b : {touch.point.body_a, touch.point.body_b}) {
      RigidBody& body = bodies[index(b)];
      if (!body.dynamic()) continue;
      const Vector3d impulse = (b == touch.point.body_a ? -touch.push : touch.push) * touch.point.n_W;
      body.apply_impulse(impulse, (p - body.p).cross(impulse));
    }
    exchange(touch.point.body_a, touch.point.body_b, touch.push * (at_a + speed(touch.point.body_a)) / 2,
             touch.push * (at_b + speed(touch.point.body_b)) / 2);
  }
}

}  // namespace cotwin::contact_world
