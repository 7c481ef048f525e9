// Fast bodies in a step. Contact points beyond the margin do not exist, and the plane of a point that is far away extends beyond
// the shape: a body would pass a wall, or be stopped beside one. So points of fast bodies act only where the bodies touch, and a
// fast body drifts until its next impact only. The impact acts at the end of that step or at the start of the next one. The rest
// of the step is lost for the body: its forces act for the time of its drift, so that the energy is that of its motion.
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

bool World::Impl::find_fast(double h) { return advance.find_fast(bodies, h); }

/// Marks the points of pairs of shapes with a fast body that do not touch and cannot do so by the other body's motion.
void World::Impl::find_distant_points(double h) {
  const auto motion = [&](int b) {
    const RigidBody& body = bodies[index(b)];
    const bool moves = body.motion != scene::Motion::kStatic && !advance.is_fast(index(b));
    return moves ? h * (body.v.norm() + body.radius * body.w.norm()) : 0;
  };
  for (std::size_t first = 0, end = 0; first < touches.size(); first = end) {
    const ContactPoint& pair = touches[first].point;
    double gap = scene::kInfinity;
    for (end = first;
         end < touches.size() && touches[end].point.body_a == pair.body_a && touches[end].point.body_b == pair.body_b &&
         touches[end].point.shape_a == pair.shape_a && touches[end].point.shape_b == pair.shape_b;
         ++end) {
      gap = std::min(gap, touches[end].point.gap);
    }
    const bool fast = advance.is_fast(index(pair.body_a)) || advance.is_fast(index(pair.body_b));
    const bool distant = fast && gap > near(h, scene.gravity) + motion(pair.body_a) + motion(pair.body_b);
    for (std::size_t t = first; t < end; ++t) touches[t].distant = distant;
  }
}

void World::Impl::drift(double h) {
  const bool fast = find_fast(h);
  // Bodies with joints have been moved by satisfy_joints().
  std::size_t next = 0;
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (next < linked.size() && index(linked[next]) == b) {
      ++next;
    } else if (!fast || !advance.is_fast(b)) {
      bodies[b].drift(h);
    }
  }
  if (!fast) return;
  advance.find_stops(bodies, h, near(h, scene.gravity));
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (!advance.is_fast(b)) continue;
    RigidBody& body = bodies[b];
    const double lost = h - advance.stop(b);
    body.drift(advance.stop(b));
    if (!(lost > 0)) continue;
    const Wrench& F = applied[b];
    body.v -= lost * scene.gravity;
    body.apply_impulse(-lost * F.head<3>(), -lost * (F.tail<3>() + (body.R * body.X_PB.p).cross(F.head<3>())));
  }
}

}  // namespace cotwin::contact_world
