#include "models/collision/nearest.h"

#include <algorithm>
#include <cmath>

#include "models/collision/gjk.h"

namespace cotwin::collision {

using Eigen::Vector3d;

namespace {

/// Two distances are the same up to this share of the size.
constexpr double kSameDistance = 1e-12;

Distance along(const Separation& s, double round_a, double round_b) {
  const double d = s.gap - round_a - round_b;
  const Vector3d p_b = s.p_b - round_b * s.n;
  return {d, s.n, p_b - d * s.n, p_b};
}

/// Of cores without a closed form.
Separation of_cores(const Placed& a, const Placed& b, double most, Feature& scratch) {
  const Vector3d offset = b.p - a.p;
  double upper = 0;
  const double size = a.convex->extent.norm() + b.convex->extent.norm();
  const double enough = most + kSameDistance * (size + std::abs(most));
  Separation s = gjk(a, b, offset.norm() > 0 ? Vector3d(offset.normalized()) : Vector3d::UnitZ(), enough, upper);
  if (s.gap > 0) {
    if (s.gap > enough || upper - s.gap <= kSameDistance * size) return s;
    bool certain = false;
    const Separation refined = refine(a, b, s, certain, scratch);
    if (certain) return refined;
    if (refined.gap > s.gap) s = {refined.n, refined.gap, s.p_b};
    return s;
  }
  // They intersect, or nearly so.
  if (few_edges(a, b)) {
    const Separation axes = along_axes(a, b, scene::kInfinity);
    if (axes.gap > s.gap) s = axes;
    s.p_b = support(b, -s.n);
    return s;
  }
  for (const Separation& other : {best_guess(a, b, scene::kInfinity), expand(a, b, s)}) {
    bool certain = false;
    const Separation found = refine(a, b, climb(a, b, other), certain, scratch);
    if (found.gap > s.gap) s = found;
  }
  return s;
}

Distance ordered(const Placed& a, const Placed& b, double most, Feature& scratch) {
  const double round_a = a.convex->round, round_b = b.convex->round;
  Separation s;
  if (closed_form(a, b, s)) return along(s, round_a, round_b);
  if (b.convex->core == Core::kPlane) return {};
  return along(of_cores(a, b, most + round_a + round_b, scratch), round_a, round_b);
}

}  // namespace

bool closed_form(const Placed& a, const Placed& b, Separation& s) {
  if (a.convex->core == Core::kPlane) {
    const Vector3d n = a.R.col(2), lowest = support(b, -n);
    s = {n, n.dot(lowest - a.p), lowest};
    return b.convex->core != Core::kPlane;
  }
  if (a.convex->core == Core::kPoint) {
    s = of_point(b, a.p);
    s.p_b = a.p - s.n * s.gap;
    s.n = -s.n;
    return true;
  }
  if (b.convex->core != Core::kSegment) return false;
  s = between_segments(a.p, a.R.col(2), a.convex->half, b.p, b.R.col(2), b.convex->half);
  return true;
}

bool few_edges(const Placed& a, const Placed& b) {
  constexpr std::size_t kMany = 4000;
  return a.convex->core == Core::kPolytope && b.convex->core == Core::kPolytope &&
         a.convex->polytope.edges.size() * b.convex->polytope.edges.size() < kMany;
}

Distance distance(const Placed& a, const Placed& b, Feature& scratch, double most) {
  if (a.convex->core <= b.convex->core) return ordered(a, b, most, scratch);
  const Distance s = ordered(b, a, most, scratch);
  return {s.d, -s.n, s.p_b, s.p_a};
}

}  // namespace cotwin::collision
