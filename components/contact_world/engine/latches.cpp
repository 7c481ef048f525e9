// Latches in a step of the world.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Impulses from this share of the bound on count as overload; below it they are rounding of a load that the latch bears.
constexpr double kAtBound = 1 - 1e-9;

/// Squared impulses up to this one have no direction.
constexpr double kNoDirection = 1e-200;

/// Right-handed axes, the first along a vector.
Matrix3d axes_along(const Vector3d& vector) {
  Matrix3d axes;
  axes.col(0) = vector.normalized();
  Eigen::Index least = 0;
  vector.cwiseAbs().minCoeff(&least);
  axes.col(1) = axes.col(0).cross(Vector3d::Unit(least)).normalized();
  axes.col(2) = axes.col(0).cross(axes.col(1));
  return axes;
}

}  // namespace

/// Marks the bodies that separate() never moves, and has contacts found anew: latched bodies have none with one another.
void World::Impl::latches_changed() {
  stale = true;
  restored = false;
  for (std::size_t b = 0; b < bodies.size(); ++b) frozen[b] = !bodies[b].dynamic();
  for (const int body : linked) frozen[index(body)] = 1;
  detector.clear_joined();
  for (const Latch& latch : latches) {
    if (!latch.closed) continue;
    if (std::min(latch.joint.parent, latch.joint.child) >= 0) detector.add_joined(latch.joint.parent, latch.joint.child);
    for (const int body : {latch.joint.parent, latch.joint.child}) {
      if (body >= 0) frozen[index(body)] = 1;
    }
  }
}

/// The springs of soft latches apply the impulse of the position stage in the velocity stage again.
void World::Impl::apply_soft_latches(Stage stage) {
  for (Latch& latch : latches) {
    if (!latch.closed) continue;
    latch.joint.place(bodies);
    if (stage == Stage::kPosition) continue;
    const Motion6 spring{latch.law.stiffness > 0 ? latch.impulse.linear : Vector3d(Vector3d::Zero()),
                         latch.law.turn_stiffness > 0 ? latch.impulse.angular : Vector3d(Vector3d::Zero())};
    for (const int body : {latch.joint.parent, latch.joint.child}) {
      if (body < 0 || !bodies[index(body)].dynamic()) continue;
      const double sign = body == latch.joint.child ? 1 : -1;
      RigidBody& b = bodies[index(body)];
      b.apply_impulse(sign * spring.linear, sign * (spring.angular + (latch.joint.p_child - b.p).cross(spring.linear)));
    }
  }
}

void World::Impl::collect_latch(std::size_t i, Stage stage, double h) {
  Latch& latch = latches[i];
  if (!latch.closed) return;
  const Joint& joint = latch.joint;
  const Latch::Aim aim = latch.aim(stage, h);
  const auto moving = [&](int body) { return body >= 0 && bodies[index(body)].motion != scene::Motion::kStatic ? body : -1; };
  // Both points turn about their centres of mass during the drift: (h²/2) ω × (ω × r) of displacement.
  const auto centripetal = [&](int body) -> Vector3d {
    if (body < 0) return Vector3d::Zero();
    const RigidBody& b = bodies[index(body)];
    return b.w.cross(b.w.cross(joint.p_child - b.p));
  };
  const Vector3d bend = h / 2 * (centripetal(joint.child) - centripetal(joint.parent));
  for (const bool turns : {false, true}) {
    const double stiffness = turns ? latch.law.turn_stiffness : latch.law.stiffness;
    if (stiffness > 0 && stage == Stage::kVelocity) continue;
    const double most = h / 2 * (turns ? latch.law.moment : latch.law.force);
    const Vector3d& error = turns ? aim.error.angular : aim.error.linear;
    const Vector3d& rate = turns ? aim.rate.angular : aim.rate.linear;
    Vector3d& impulse = turns ? latch.impulse.angular : latch.impulse.linear;
    // A bound for each axis is one for the load if the load is along an axis.
    const Matrix3d along = most < kInfinity && impulse.squaredNorm() > kNoDirection ? axes_along(impulse) : joint.R_parent;
    for (int k = 0; k < 3; ++k) {
      BoxRow row;
      row.a = moving(joint.parent);
      row.b = moving(joint.child);
      (turns ? row.m : row.d) = along.col(k);
      row.p = joint.p_child;
      row.exact = true;
      row.lo = -most;
      row.hi = most;
      row.x = std::clamp(along.col(k).dot(impulse), -most, most);
      row.target = along.col(k).dot(rate);
      if (stiffness > 0) {
        row.softness = 4 / (stiffness * h * h);
        row.target -= 2 / h * along.col(k).dot(error);
      } else if (stage == Stage::kPosition) {
        row.target -= along.col(k).dot(kShareOfJointError / h * error + (turns ? Vector3d(Vector3d::Zero()) : bend));
      }
      row_origin.push_back({-1, kJointRows, static_cast<int>(i)});
      rows.add(row);
    }
    impulse.setZero();  // store_impulses() adds those of the rows
  }
}

void World::Impl::store_latch_row(const BoxRow& row, Latch& latch) {
  latch.impulse.linear += row.x * row.d;
  latch.impulse.angular += row.x * row.m;
  latch.overloaded = latch.overloaded || std::abs(row.x) >= kAtBound * row.hi;
}

/// Work of the latches on the bodies that move by (1).
void World::Impl::account_latches() {
  for (Latch& latch : latches) {
    if (!latch.closed) continue;
    latch.sum.linear += latch.impulse.linear;
    latch.sum.angular += latch.impulse.angular;
    for (const int body : {latch.joint.parent, latch.joint.child}) {
      if (body < 0 || !bodies[index(body)].dynamic()) continue;
      const RigidBody& now = bodies[index(body)];
      const Start& start = starts[index(body)];
      const Vector3d spin = (start.w + now.w) / 2, speed = (start.v + now.v) / 2 + spin.cross(latch.joint.p_child - start.p);
      account(body)->work +=
          (body == latch.joint.child ? 1 : -1) * (latch.impulse.linear.dot(speed) + latch.impulse.angular.dot(spin));
    }
  }
}

void World::Impl::begin_latches() {
  for (Latch& latch : latches) {
    latch.sum = {};
    latch.overloaded = false;
  }
}

void World::Impl::advance_latches(double h) {
  bool opened = false;
  for (Latch& latch : latches) {
    latch.joint.place(bodies);
    if (latch.closed) opened = latch.advance(h) || opened;
  }
  if (opened) latches_changed();
}

// ---- From outside

std::span<const Latch> World::latches() const { return impl_->latches; }

void World::set_latch(std::size_t latch, const LatchLaw& law) { impl_->latches[latch].law = law; }

bool World::close_latch(std::size_t i) {
  Latch& latch = impl_->latches[i];
  latch.joint.place(impl_->bodies);
  if (latch.closed || !latch.within_reach()) return latch.closed;
  latch.close();
  impl_->latches_changed();
  return true;
}

void World::open_latch(std::size_t i) {
  if (!impl_->latches[i].closed) return;
  impl_->latches[i].open();
  impl_->latches_changed();
}

}  // namespace cotwin::contact_world
