// Fast bodies in a step. Contact points beyond the margin do not exist, and the plane of a point that is far away extends beyond
// the shape: a body would pass a wall, or be stopped beside one. So points of bodies that are fast against one another act only where they touch, and
// a fast body drifts until its next impact only. Then it moves on with what it has met. The impact acts at the end of that step or at the start of the
// next one. On a body that is not free, the rest of the step is lost: forces act for the time of the drift, so that the energy is that of the motion.
#include <Eigen/Geometry>
#include <algorithm>

#include "components/contact_world/engine/solvers/numbers.h"
#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

/// Gap below which bodies touch, besides the way of gravity in a step.
constexpr double kNear = 1e-5;  // m

double near(double h, const Vector3d& gravity) { return kNear + 2 * h * h * gravity.norm(); }

}  // namespace

/// What all bodies may have in common: the velocity of what stands, or is driven, or else that of the centre of mass, m/s.
Vector3d World::Impl::common_velocity() const {
  double mass = 0;
  Vector3d momentum = Vector3d::Zero();
  const RigidBody* driven = nullptr;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    const RigidBody& body = bodies[b];
    if (body.motion == scene::Motion::kStatic && !scene.bodies[b].shapes.empty()) return Vector3d::Zero();
    if (body.motion == scene::Motion::kDriven && driven == nullptr) driven = &body;
    if (!body.dynamic()) continue;
    mass += body.mass;
    momentum += body.mass * body.v;
  }
  return driven != nullptr ? driven->v : mass > 0 ? Vector3d(momentum / mass) : momentum;
}

void World::Impl::set_margin(double h) {
  double fastest = 0;
  const Vector3d common = common_velocity();
  for (const RigidBody& body : bodies) {
    if (body.motion != scene::Motion::kStatic)
      fastest = std::max(fastest, (body.v - common).norm() + body.radius * body.w.norm());
  }
  margin = std::min(1.5 * h * fastest + 2 * h * h * scene.gravity.norm() + 1e-5, kWidestMargin);
}

bool World::Impl::find_fast(double h) { return advance.find_fast(bodies, h, common_velocity()); }

/// Whether two bodies are fast against one another.
bool World::Impl::fast(int a, int b, double h) const {
  return advance.any() && advance.fast(index(a), bodies[index(a)], index(b), bodies[index(b)], h);
}

/// Marks the points of pairs of shapes that are fast against one another and do not touch. Those of a mechanism that will meet the other body act
/// at once: it is not stopped, and it must not close through what is in its way.
void World::Impl::find_distant_points(double h) {
  for (std::size_t first = 0, end = 0; first < touches.size(); first = end) {
    const ContactPoint& pair = touches[first].point;
    double gap = scene::kInfinity;
    for (end = first;
         end < touches.size() && touches[end].point.body_a == pair.body_a && touches[end].point.body_b == pair.body_b &&
         touches[end].point.shape_a == pair.shape_a && touches[end].point.shape_b == pair.shape_b;
         ++end) {
      gap = std::min(gap, touches[end].point.gap);
    }
    // Once in a step: what an impact has slowed down is swept as well.
    const std::size_t a = index(pair.body_a), b = index(pair.body_b);
    const double touching = near(h, scene.gravity);
    const bool distant =
        gap > touching && (touches[first].distant || fast(pair.body_a, pair.body_b, h)) &&
        !((advance.has_joints(a) || advance.has_joints(b)) && advance.meet(a, bodies[a], b, bodies[b], h, touching));
    for (std::size_t t = first; t < end; ++t) touches[t].distant = distant;
  }
}

void World::Impl::drift(double h) {
  const bool fast = find_fast(h);
  if (fast) {
    for (std::size_t b = 0; b < bodies.size(); ++b) advance.set_start(b, bodies[b]);
    for (std::size_t i = 0; i < linked.size(); ++i) {  // satisfy_joints() has moved them
      RigidBody start = bodies[index(linked[i])];
      const Place& place = places[i];
      start.p = place.p;
      start.Q = place.Q;
      start.R = place.R;
      start.v = place.v;
      start.w = place.w;
      start.L = place.L;
      advance.set_start(index(linked[i]), start);
    }
    advance.sweep(h, near(h, scene.gravity));
  }
  std::size_t next = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    RigidBody& body = bodies[b];
    if (next < linked.size() && index(linked[next]) == b) {
      ++next;
    } else if (!fast || !advance.is_fast(b)) {
      body.drift(h);
    } else {
      const RigidBody end = advance.end(b, h);
      body.p = end.p;
      body.Q = end.Q;
      body.R = end.R;
      body.update_spin();
      const double lost = advance.rides(b);
      if (!(lost > 0)) continue;
      const Wrench& F = applied[b];
      const Vector3d weight = body.mass * scene.gravity + F.head<3>();
      account(static_cast<int>(b))->work -= lost * weight.dot(end.v);  // of what carries it
      body.v -= lost * scene.gravity;
      body.apply_impulse(-lost * F.head<3>(), -lost * (F.tail<3>() + (body.R * body.X_PB.p).cross(F.head<3>())));
    }
  }
}

}  // namespace cotwin::contact_world
