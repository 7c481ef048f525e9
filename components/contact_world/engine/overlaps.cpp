// Separates bodies that overlap deeply, as at the start of a scenario, by displacements that change no momentum.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

#include "components/contact_world/engine/world_impl.h"

namespace cotwin::contact_world {
namespace {

std::size_t index(int i) { return static_cast<std::size_t>(i); }

constexpr double kInfinity = std::numeric_limits<double>::infinity();

/// Depth from which displacements separate bodies; the contact rows correct smaller depths.
constexpr double kDeep = 5e-5;  // m

/// Share of the depth that one step removes, the largest speed, and the sweeps over the points.
constexpr double kShare = 0.2, kFastest = 0.5;  // 1, m/s
constexpr int kSweeps = 30;

}  // namespace

/// Whether displacements separate the bodies of a point: bodies with joints move by their rows only.
bool World::Impl::overlaps(const Touch& touch) const {
  if (touch.stiffness < kInfinity || touch.point.gap > -kDeep) return false;
  return is_free[index(touch.point.body_a)] || is_free[index(touch.point.body_b)];
}

/// Moves free bodies such that deep points become shallower and no other gap becomes negative: sweeps over n · δ ≥ target with
/// the bodies' inertias, from no displacement.
void World::Impl::separate_overlaps(double h) {
  if (std::none_of(touches.begin(), touches.end(), [&](const Touch& touch) { return overlaps(touch); })) return;
  for (Displacement& d : displacements) d = {};
  for (Touch& touch : touches) touch.pushed = 0;
  for (int sweep = 0; sweep < kSweeps; ++sweep) {
    for (Touch& touch : touches) {
      const ContactPoint& point = touch.point;
      if (touch.stiffness < kInfinity) continue;
      const double depth = overlaps(touch) ? std::min(-kShare * point.gap, kFastest * h) : -std::max(point.gap, 0.0);
      double way = 0, mobility = 0;
      for (const int b : {point.body_a, point.body_b}) {
        const RigidBody& body = bodies[index(b)];
        if (!is_free[index(b)]) continue;
        const Displacement& d = displacements[index(b)];
        const Vector3d r = point.p_W - body.p, moment = body.R.transpose() * r.cross(point.n_W);
        way += (b == point.body_a ? -1 : 1) * point.n_W.dot(d.linear + d.angular.cross(r));
        mobility += body.inverse_mass + body.inverse_moments.dot(moment.cwiseAbs2());
      }
      if (mobility == 0) continue;
      const double before = touch.pushed;
      touch.pushed = std::max(0.0, before + (depth - way) / mobility);
      for (const int b : {point.body_a, point.body_b}) {
        const RigidBody& body = bodies[index(b)];
        if (!is_free[index(b)]) continue;
        const Vector3d push = (b == point.body_a ? before - touch.pushed : touch.pushed - before) * point.n_W;
        const Vector3d moment = body.R.transpose() * (point.p_W - body.p).cross(push);
        displacements[index(b)].linear += body.inverse_mass * push;
        displacements[index(b)].angular += body.R * body.inverse_moments.cwiseProduct(moment);
      }
    }
  }
  for (std::size_t b = 0; b < bodies.size(); ++b) {
    if (is_free[b]) bodies[b].displace(displacements[b].linear, displacements[b].angular, false);
  }
}

}  // namespace cotwin::contact_world
