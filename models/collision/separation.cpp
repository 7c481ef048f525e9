#include "models/collision/separation.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::collision {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// v / ‖v‖, or `fallback` for very small v.
Vector3d unit(const Vector3d& v, const Vector3d& fallback) {
  const double length = v.stableNorm();
  return length > 1e-150 ? Vector3d(v / length) : fallback;
}

Separation towards(const Vector3d& from, const Vector3d& p, const Vector3d& fallback) {
  const Vector3d offset = p - from;
  return {unit(offset, fallback), offset.stableNorm(), p};
}

Separation from_box(const Convex& c, const Vector3d& p) {
  const Vector3d nearest = p.cwiseMax(-c.extent).cwiseMin(c.extent);
  Eigen::Index axis = 0;
  const double outside = (p.cwiseAbs() - c.extent).maxCoeff(&axis);
  const Vector3d n = Vector3d::Unit(axis) * std::copysign(1.0, p[axis]);
  if (outside <= 0) return {n, outside, p};
  return towards(nearest, p, n);
}

Separation from_cylinder(const Convex& c, const Vector3d& p) {
  const double r = std::hypot(p.x(), p.y());
  const Vector3d out = r > 0 ? Vector3d(p.x() / r, p.y() / r, 0) : Vector3d::UnitX();
  const Vector3d up = Vector3d::UnitZ() * std::copysign(1.0, p.z());
  const double beyond_side = r - c.radius, beyond_cap = std::abs(p.z()) - c.half;
  if (beyond_side <= 0 || beyond_cap <= 0)
    return beyond_side > beyond_cap ? Separation{out, beyond_side, p} : Separation{up, beyond_cap, p};
  const double distance = std::hypot(beyond_side, beyond_cap);
  return {(beyond_side * out + beyond_cap * up) / distance, distance, p};
}

/// The nearest point of an ellipsoid has p_i r_i² / (r_i² + t): t by bisection, as the sum of (p_i r_i / (r_i² + t))² − 1
/// decreases from t = −min r² (Eberly, "Distance from a point to an ellipse, an ellipsoid, or a hyperellipsoid"). Here t + min r²
/// is sought. It is 0 for a point on the longer axes inside: the nearest points are then symmetric, and one of them is taken.
Separation from_ellipsoid(const Convex& c, const Vector3d& p) {
  const Vector3d square = c.extent.cwiseAbs2(), scaled = p.cwiseProduct(c.extent).cwiseAbs();
  Eigen::Index shortest = 0;
  for (Eigen::Index i = 1; i < 3; ++i) {
    if (square[i] < square[shortest] || (square[i] == square[shortest] && scaled[i] > scaled[shortest])) shortest = i;
  }
  const Vector3d longer = square.array() - square[shortest];
  const auto excess = [&](double s) { return scaled.cwiseQuotient((longer.array() + s).matrix()).squaredNorm() - 1; };
  constexpr double kLimit = 1e-300;
  const bool symmetric = scaled[shortest] == 0 && excess(kLimit) <= 0;
  double low = scaled[shortest], high = symmetric ? kLimit : scaled.norm();
  while (!symmetric && low < high) {
    const double middle = (low + high) / 2;
    if (middle == low || middle == high) break;
    (excess(middle) > 0 ? low : high) = middle;
  }
  Vector3d nearest = Vector3d::Zero();
  for (Eigen::Index i = 0; i < 3; ++i) {
    if (p[i] != 0) nearest[i] = p[i] * square[i] / (longer[i] + high);
  }
  if (symmetric) {
    const double rest = 1 - nearest.cwiseQuotient(c.extent).squaredNorm();
    nearest[shortest] = c.extent[shortest] * std::sqrt(std::max(rest, 0.0));
  }
  const Vector3d n = nearest.cwiseQuotient(square).normalized();
  return {n, n.dot(p - nearest), p};
}

Vector3d nearest_on_edge(const scene::Polytope& polytope, const scene::Polytope::Edge& edge, const Vector3d& p) {
  const Vector3d& a = polytope.vertices[edge.vertices[0]];
  const Vector3d along = polytope.vertices[edge.vertices[1]] - a;
  const double square = along.squaredNorm();
  return a + along * (square > 0 ? std::clamp((p - a).dot(along) / square, 0.0, 1.0) : 0.0);
}

Separation from_polytope(const scene::Polytope& polytope, const Vector3d& p, double enough) {
  Separation best{Vector3d::UnitZ(), -scene::kInfinity, Vector3d::Zero()};
  for (const scene::Polytope::Face& face : polytope.faces) {
    const double height = face.n.dot(p) - face.d;
    if (height > best.gap) best = {face.n, height, p};
  }
  if (best.gap <= 0 || best.gap > enough) return best;
  double least = scene::kInfinity;
  for (const scene::Polytope::Face& face : polytope.faces) {  // points above a face
    const double height = face.n.dot(p) - face.d;
    if (height <= 0 || height >= least) continue;
    bool above = face.count > 2;  // sides of flat ones are edges
    for (std::uint32_t k = 0; k < face.count && above; ++k) {
      const Vector3d& from = polytope.vertices[polytope.corners[face.begin + k]];
      const Vector3d& to = polytope.vertices[polytope.corners[face.begin + (k + 1) % face.count]];
      above = (to - from).cross(p - from).dot(face.n) >= 0;
    }
    if (above) least = height, best = {face.n, height, p};
  }
  double square = least * least;
  const scene::Polytope::Edge* nearest = nullptr;
  for (const scene::Polytope::Edge& edge : polytope.edges) {
    const double own = (p - nearest_on_edge(polytope, edge, p)).squaredNorm();
    if (own < square) square = own, nearest = &edge;
  }
  return nearest == nullptr ? best : towards(nearest_on_edge(polytope, *nearest, p), p, best.n);
}

/// Separating axes of two boxes in frame A: C = R_AB, t = position of B's centre.
Separation between_boxes(const Placed& a, const Placed& b, double margin) {
  const Vector3d& half_a = a.convex->extent;
  const Vector3d& half_b = b.convex->extent;
  const Matrix3d C = a.R.transpose() * b.R;
  const Vector3d t = a.R.transpose() * (b.p - a.p);
  const Matrix3d absolute = C.cwiseAbs();
  const Vector3d t_b = C.transpose() * t;
  const Vector3d gaps_a = t.cwiseAbs() - half_a - absolute * half_b;
  const Vector3d gaps_b = t_b.cwiseAbs() - half_b - absolute.transpose() * half_a;
  Eigen::Index i = 0, j = 0;
  const double gap_a = gaps_a.maxCoeff(&i), gap_b = gaps_b.maxCoeff(&j);
  Separation best = gap_a >= gap_b ? Separation{a.R.col(i) * std::copysign(1.0, t[i]), gap_a, Vector3d::Zero()}
                                   : Separation{b.R.col(j) * std::copysign(1.0, t_b[j]), gap_b, Vector3d::Zero()};
  if (best.gap > margin) return best;
  Eigen::Index edge_a = -1, edge_b = -1;
  double sign = 1;
  for (i = 0; i < 3; ++i) {
    const Eigen::Index i1 = (i + 1) % 3, i2 = (i + 2) % 3;
    for (j = 0; j < 3; ++j) {
      const Eigen::Index j1 = (j + 1) % 3, j2 = (j + 2) % 3;
      const double square = C(i1, j) * C(i1, j) + C(i2, j) * C(i2, j);  // ‖aᵢ × bⱼ‖²
      if (square < 1e-12) continue;                                     // parallel: covered by the faces
      const double offset = t[i2] * C(i1, j) - t[i1] * C(i2, j);        // t · (aᵢ × bⱼ)
      const double reach = half_a[i1] * absolute(i2, j) + half_a[i2] * absolute(i1, j) + half_b[j1] * absolute(i, j2) +
                           half_b[j2] * absolute(i, j1);
      const double gap = (std::abs(offset) - reach) / std::sqrt(square);
      if (gap > best.gap) best.gap = gap, edge_a = i, edge_b = j, sign = offset < 0 ? -1 : 1;
    }
  }
  if (edge_a >= 0) best.n = (a.R.col(edge_a).cross(b.R.col(edge_b)) * sign).normalized();
  return best;
}

/// Largest gap over the faces of `own`, in its frame; `vertices`: those of the other polytope in its own frame.
Separation over_faces(const scene::Polytope& own, const std::vector<Vector3d>& vertices, const Matrix3d& R, const Vector3d& t,
                      double margin) {
  Separation best{Vector3d::UnitZ(), -scene::kInfinity, Vector3d::Zero()};
  for (const scene::Polytope::Face& face : own.faces) {
    const Vector3d n = R.transpose() * face.n;  // in the other polytope's frame
    double least = scene::kInfinity;
    for (const Vector3d& v : vertices) least = std::min(least, n.dot(v));
    const double gap = least + face.n.dot(t) - face.d;
    if (gap > best.gap) best.n = face.n, best.gap = gap;
    if (gap > margin) return best;
  }
  return best;
}

/// Considers pairs of edges whose arcs on the Gauss sphere cross; only these are edges of the Minkowski difference.
Separation over_edges(const scene::Polytope& a, const scene::Polytope& b, const Matrix3d& R_AB, const Vector3d& t,
                      double margin) {
  Separation best{Vector3d::UnitZ(), -scene::kInfinity, Vector3d::Zero()};
  for (const scene::Polytope::Edge& edge_b : b.edges) {
    const Vector3d c = -(R_AB * b.faces[edge_b.faces[0]].n), d = -(R_AB * b.faces[edge_b.faces[1]].n);
    const Vector3d q = R_AB * b.vertices[edge_b.vertices[0]] + t;
    const Vector3d along_b = R_AB * (b.vertices[edge_b.vertices[1]] - b.vertices[edge_b.vertices[0]]);
    for (const scene::Polytope::Edge& edge_a : a.edges) {
      const Vector3d& m = a.faces[edge_a.faces[0]].n;
      const Vector3d& o = a.faces[edge_a.faces[1]].n;
      const Vector3d& p = a.vertices[edge_a.vertices[0]];
      const Vector3d along_a = a.vertices[edge_a.vertices[1]] - p;
      // along_a ∥ m × o and along_b ∥ c × d: the arcs m–o and c–d cross within one hemisphere.
      const double c_side = along_a.dot(c), d_side = along_a.dot(d), m_side = along_b.dot(m), o_side = along_b.dot(o);
      if (c_side * d_side >= 0 || m_side * o_side >= 0) continue;
      Vector3d n = along_a.cross(along_b);
      const double length = n.norm();
      if (length < 1e-6 * along_a.norm() * along_b.norm()) continue;
      n /= length;
      if (n.dot(m) + n.dot(o) < 0) n = -n;
      if (n.dot(c) + n.dot(d) <= 0) continue;  // crosses on the opposite hemisphere
      const double gap = n.dot(q - p);
      if (gap > best.gap) best.n = n, best.gap = gap;
      if (gap > margin) return best;
    }
  }
  return best;
}

}  // namespace

Separation of_point(const Placed& piece, const Vector3d& p, double enough) {
  const Convex& c = *piece.convex;
  const Vector3d p_C = piece.R.transpose() * (p - piece.p);
  Separation s;
  switch (c.core) {
    case Core::kPlane:
      s = {Vector3d::UnitZ(), p_C.z(), p_C};
      break;
    case Core::kPoint:
      s = towards(Vector3d::Zero(), p_C, Vector3d::UnitZ());
      break;
    case Core::kSegment:
      s = towards({0, 0, std::clamp(p_C.z(), -c.half, c.half)}, p_C, Vector3d::UnitX());
      break;
    case Core::kCylinder:
      s = from_cylinder(c, p_C);
      break;
    case Core::kEllipsoid:
      s = from_ellipsoid(c, p_C);
      break;
    case Core::kPolytope:
      s = c.box ? from_box(c, p_C) : from_polytope(c.polytope, p_C, enough);
      break;
  }
  s.n = piece.R * s.n;
  s.p_b = p;
  return s;
}

Separation along_axes(const Placed& a, const Placed& b, double margin) {
  if (a.convex->box && b.convex->box) return between_boxes(a, b, margin);
  const scene::Polytope& A = a.convex->polytope;
  const scene::Polytope& B = b.convex->polytope;
  const Matrix3d R_AB = a.R.transpose() * b.R;
  const Vector3d t_A = a.R.transpose() * (b.p - a.p), t_B = b.R.transpose() * (a.p - b.p);
  Separation best = over_faces(A, B.vertices, R_AB, t_A, margin);
  best.n = a.R * best.n;
  if (best.gap > margin) return best;
  Separation other = over_faces(B, A.vertices, R_AB.transpose(), t_B, margin);
  if (other.gap > best.gap) best.n = -(b.R * other.n), best.gap = other.gap;
  if (best.gap > margin) return best;
  other = over_edges(A, B, R_AB, t_A, margin);
  if (other.gap <= best.gap) return best;
  other.n = a.R * other.n;
  // Short edges may not fit the planes of merged faces.
  other.gap = std::min(other.gap, gap_along(a, b, other.n));
  if (other.gap > best.gap) best = other;
  return best;
}

Separation between_segments(const Vector3d& p_a, const Vector3d& d_a, double half_a, const Vector3d& p_b, const Vector3d& d_b,
                            double half_b) {
  // Minimises ‖w + s d_b − t d_a‖² over |t| ≤ half_a, |s| ≤ half_b.
  const Vector3d w = p_b - p_a;
  const double turn = d_a.dot(d_b), wa = w.dot(d_a), wb = w.dot(d_b);
  const Vector3d across = d_a.cross(d_b);
  const double square = across.squaredNorm();  // 1 − turn²
  double t = square > 1e-16 ? std::clamp((wa - turn * wb) / square, -half_a, half_a) : std::clamp(0.0, -half_a, half_a);
  double s = std::clamp(turn * t - wb, -half_b, half_b);
  t = std::clamp(wa + turn * s, -half_a, half_a);
  s = std::clamp(turn * t - wb, -half_b, half_b);
  const Vector3d crossing = unit(across, d_a.unitOrthogonal());
  Separation apart = towards(p_a + t * d_a, p_b + s * d_b, crossing);
  constexpr double kCrossed = 1e-13;  // of the lengths: their difference is rounding
  if (apart.gap <= kCrossed * (half_a + half_b)) apart.n = crossing;
  return apart;
}

double gap_along(const Placed& a, const Placed& b, const Vector3d& n) { return n.dot(support(b, -n) - support(a, n)); }

Separation best_guess(const Placed& a, const Placed& b, double margin) {
  Separation best;
  best.gap = -std::numeric_limits<double>::infinity();
  const auto try_direction = [&](const Vector3d& direction) {
    const double length = direction.norm();
    if (!(length > 1e-9) || best.gap > margin) return;
    const Vector3d n = direction / length;
    const double gap = gap_along(a, b, n);
    if (gap > best.gap) best.n = n, best.gap = gap;
  };
  const Vector3d offset = b.p - a.p;
  const auto try_axes_of = [&](const Placed& piece, double sign) {
    const Convex& c = *piece.convex;
    for (const scene::Polytope::Face& face : c.polytope.faces) try_direction(sign * (piece.R * face.n));
    if (c.core != Core::kPolytope) {
      const Vector3d axis = piece.R.col(2);
      if (c.core == Core::kCylinder) try_direction(axis * std::copysign(1.0, axis.dot(offset)));
      try_direction((offset - axis * axis.dot(offset)) / std::max(offset.norm(), 1e-300));
    }
  };
  try_axes_of(a, 1);
  try_axes_of(b, -1);
  if (a.convex->core != Core::kPolytope && b.convex->core != Core::kPolytope) {
    const Vector3d across = a.R.col(2).cross(b.R.col(2));
    try_direction(across * std::copysign(1.0, across.dot(offset)));
  }
  try_direction(offset / std::max(offset.norm(), 1e-300));
  if (std::isinf(best.gap)) try_direction(Vector3d::UnitZ());
  best.p_b = support(b, -best.n);
  return best;
}

}  // namespace cotwin::collision
