#include "models/collision/contact/narrow_phase.h"

#include <algorithm>
#include <cmath>

#include "models/collision/gjk.h"

namespace cotwin::collision {

namespace {

using Eigen::Vector3d;

/// Adds the single point of a pair whose features give none; p_b is on the core of b. If there are four points already, it
/// replaces the nearest.
void add_single_point(const Separation& s, double round_a, double round_b, double margin, std::vector<ManifoldPoint>& touches) {
  const double gap = s.gap - round_a - round_b;
  if (!(gap < margin)) return;
  const ManifoldPoint touch{s.p_b - s.n * (round_b + gap / 2), s.n, gap,
                            feature_pair_id(FeatureKind::kWhole, 0, FeatureKind::kWhole, 0)};
  if (touches.size() < 4) {
    touches.push_back(touch);
    return;
  }
  const auto distance = [&](const ManifoldPoint& t) { return (t.p - touch.p).squaredNorm(); };
  *std::min_element(touches.begin(), touches.end(),
                    [&](const ManifoldPoint& s1, const ManifoldPoint& s2) { return distance(s1) < distance(s2); }) = touch;
}

/// Whether n, out of a face of the base, is the direction of the shortest translation that separates the shapes: the deepest
/// point of the piece leaves the base through this face, and the other faces are farther away.
bool leaves_by_face(const Placed& base, const Placed& piece, const Vector3d& n) {
  if (base.convex->core != Core::kPolytope) return false;
  constexpr double kAligned = 1 - 1e-14;
  const Vector3d n_C = base.R.transpose() * n;
  const Vector3d p_C = base.R.transpose() * (support(piece, -n) - piece.convex->round * n - base.p);
  double depth = -1, least = scene::kInfinity;
  for (const scene::Polytope::Face& face : base.convex->polytope.faces) {
    const double distance = face.d - face.n.dot(p_C);
    if (face.n.dot(n_C) > kAligned) {
      depth = distance;
    } else {
      least = std::min(least, distance);
    }
  }
  return depth >= 0 && least >= depth;
}

}  // namespace

void NarrowPhase::reserve(std::size_t corners) {
  manifold_.reserve(corners);
  scratch_.corners.reserve(corners);
}

Vector3d NarrowPhase::find(const Placed& a, const Placed& b, double margin, std::vector<ManifoldPoint>& touches) {
  touches.clear();
  if (a.convex->core > b.convex->core) {
    const Vector3d n = -find(b, a, margin, touches);
    for (ManifoldPoint& t : touches) {
      t.id = t.id << 32 | t.id >> 32;
      t.n = -t.n;
    }
    return n;
  }
  const Vector3d n = find_ordered(a, b, margin, touches);
  const bool inside = !touches.empty() && (points_out_of_covered(a, n) || points_out_of_covered(b, -n));
  if (!inside) return n;
  double gap = scene::kInfinity;
  for (const ManifoldPoint& t : touches) gap = std::min(gap, t.gap);
  // Of the triangles of a surface: what leaves a prism by its side far sooner than by its top is in the neighbour's solid.
  constexpr double kSooner = 4, kSlack = 1e-4;  // of the smaller one's size
  const double slack = kSlack * std::min(a.convex->extent.norm() + a.convex->round, b.convex->extent.norm() + b.convex->round);
  const bool of_surface = a.convex->triangle || b.convex->triangle;
  return find_on_uncovered(a, b, margin, of_surface ? kSooner * std::min(gap, 0.0) - slack : -scene::kInfinity, touches);
}

/// For shapes that share faces with others of their body: uses the normals of uncovered faces only, if the gap is `least` or more.
Vector3d NarrowPhase::find_on_uncovered(const Placed& a, const Placed& b, double margin, double least,
                                        std::vector<ManifoldPoint>& touches) {
  touches.clear();
  Separation best;
  best.gap = -scene::kInfinity;
  for (const Placed* piece : {&a, &b}) {
    const Convex& c = *piece->convex;
    for (std::size_t f = 0; f < c.covered.size(); ++f) {
      if (c.covered[f] != 0) continue;
      const Vector3d n = piece->R * c.polytope.faces[f].n * (piece == &a ? 1 : -1);
      const double gap = gap_along(a, b, n);
      if (gap > best.gap) best.n = n, best.gap = gap;
    }
  }
  if (std::isfinite(best.gap) && best.gap >= least) manifold_.find(a, b, best.n, margin, touches);
  return best.n;
}

/// Finds the points of a pair whose cores are in ascending order.
Vector3d NarrowPhase::find_ordered(const Placed& a, const Placed& b, double margin, std::vector<ManifoldPoint>& touches) {
  const double round_a = a.convex->round, round_b = b.convex->round;
  if (a.convex->core == Core::kPlane) {
    const Vector3d n = a.R.col(2);
    if (b.convex->core != Core::kPlane) manifold_.on_plane(a, b, n, margin, touches);
    return n;
  }
  const double core_margin = margin + round_a + round_b;
  if (Separation s; closed_form(a, b, s)) {
    if (a.convex->core == Core::kPoint)
      add_single_point(s, round_a, round_b, margin, touches);
    else if (s.gap < core_margin)
      add_points(a, b, s, margin, touches);
    return s.n;
  }
  if (few_edges(a, b)) {
    Separation s = along_axes(a, b, margin);
    if (!(s.gap < margin) || add_points(a, b, s, margin, touches)) return s.n;
    bool certain = false;
    s = improve(a, b, s, certain);
    touches.clear();
    if (s.gap < margin) add_points(a, b, s, margin, touches);
    return s.n;
  }
  // Start with the best guess. If two points have that gap, the guess is optimal for separated shapes. For interpenetrating
  // shapes it is better than all directions within 90 degrees if the face around the deepest corner extends farther than the
  // penetration is deep.
  const Separation guess = best_guess(a, b, core_margin);
  if (!(guess.gap < core_margin)) return guess.n;
  const double size = std::min(a.convex->extent.norm(), b.convex->extent.norm());
  constexpr double kDeep = 1e-2;  // of the smaller one's size
  if (guess.gap < -kDeep * size && (leaves_by_face(a, b, guess.n) || leaves_by_face(b, a, -guess.n))) {
    add_points(a, b, guess, margin, touches);
    return guess.n;
  }
  bool certain = guess.gap > -kDeep * size && add_points(a, b, guess, margin, touches);
  if (certain && manifold_.face_margin() >= -guess.gap) return guess.n;
  Separation s = improve(a, b, guess, certain);
  if (s.gap < -kDeep * size) {  // the best direction may be anywhere
    certain = false;
    s = improve(a, b, expand(a, b, s), certain);
  }
  touches.clear();
  if (s.gap < core_margin) add_points(a, b, s, margin, touches);
  return s.n;
}

/// Improves `start` by refine(); if the result is not certain, by climb() and refine() again.
Separation NarrowPhase::improve(const Placed& a, const Placed& b, const Separation& start, bool& certain) {
  Separation s = refine(a, b, start, certain, scratch_);
  if (!certain) s = refine(a, b, climb(a, b, s), certain, scratch_);
  return s;
}

/// Adds the features' points along s.n, and the nearest points unless these are among them. Returns whether they are.
bool NarrowPhase::add_points(const Placed& a, const Placed& b, const Separation& s, double margin,
                             std::vector<ManifoldPoint>& touches) {
  const double round_a = a.convex->round, round_b = b.convex->round;
  const double deepest = manifold_.find(a, b, s.n, margin, touches);
  const double kRounding = 1e-9 * std::min(a.convex->extent.norm(), b.convex->extent.norm());
  const bool held = deepest <= s.gap - round_a - round_b + kRounding;
  if (!held) add_single_point(s, round_a, round_b, margin, touches);
  return held;
}

}  // namespace cotwin::collision
