#include "models/collision/convex.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

#include "models/scene/shapes.h"

namespace cotwin::collision {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;
using Index = std::uint32_t;

Convex polytope_of(scene::Polytope polytope, const Pose& X_BS) {
  Convex convex;
  convex.core = Core::kPolytope;
  Vector3d low = polytope.vertices[0], high = low;
  for (const Vector3d& v : polytope.vertices) low = low.cwiseMin(v), high = high.cwiseMax(v);
  const Vector3d middle = (low + high) / 2;
  for (Vector3d& v : polytope.vertices) v -= middle;
  for (scene::Polytope::Face& face : polytope.faces) {  // anew: coordinates may have been large
    face.d = -scene::kInfinity;
    for (Index k = 0; k < face.count; ++k)
      face.d = std::max(face.d, face.n.dot(polytope.vertices[polytope.corners[face.begin + k]]));
  }
  convex.extent = (high - low) / 2;
  convex.polytope = std::move(polytope);
  convex.X_BC = X_BS * Pose{Eigen::Matrix3d::Identity(), middle};
  return convex;
}

/// Unit direction of d on the circle of a cylinder, in C. For d along the axis the direction is undefined; the small offset
/// along x selects one and makes it vary continuously. Error of the gap of the rim's lowest point: below kOffset × radius.
Vector2d radial_direction(const Vector3d& d_C) {
  constexpr double kOffset = 1e-9;
  const Vector2d u(d_C.x() + kOffset, d_C.y());
  const double length = u.norm();
  return length > 0 ? Vector2d(u / length) : Vector2d::UnitX();
}

void add_disc(const Placed& piece, const Vector3d& d_C, Feature& feature) {
  static const auto circle = [] {
    std::array<Vector2d, kDiscCorners> points;
    for (int k = 0; k < kDiscCorners; ++k) {
      const double angle = 2 * M_PI * k / kDiscCorners;
      points[static_cast<std::size_t>(k)] = {std::cos(angle), std::sin(angle)};
    }
    return points;
  }();
  const Convex& c = *piece.convex;
  const double side = d_C.z() < 0 ? -1 : 1;
  const Vector2d u = radial_direction(d_C);
  const Vector3d x = piece.R * Vector3d(c.radius * u.x(), c.radius * u.y(), 0);
  const Vector3d y =
      piece.R * Vector3d(-c.radius * u.y() * side, c.radius * u.x() * side, 0);  // counter-clockwise from outside
  const Vector3d centre = piece.p + piece.R.col(2) * (side * c.half);
  const Index first = side < 0 ? 0 : kDiscCorners;
  for (Index k = 0; k < kDiscCorners; ++k) {
    feature.corners.push_back({centre + circle[k].x() * x + circle[k].y() * y, first + k, first + k});
  }
  feature.n = piece.R.col(2) * side;
  feature.face = side < 0 ? 0 : 1;
}

/// Adds two corners: a line on a cylinder's side, or the segment itself.
void add_line(const Placed& piece, const Vector3d& middle, Feature& feature) {
  const Vector3d half = piece.R.col(2) * piece.convex->half;
  constexpr Index kLine = 2 * kDiscCorners;
  feature.corners.push_back({middle - half, kLine, kLine});
  feature.corners.push_back({middle + half, kLine + 1, kLine});
}

Index farthest_vertex(const scene::Polytope& polytope, const Vector3d& d_C) {
  Index best = 0;
  double most = polytope.vertices[0].dot(d_C);
  for (Index v = 1; v < polytope.vertices.size(); ++v) {
    const double x = polytope.vertices[v].dot(d_C);
    if (x > most) most = x, best = v;
  }
  return best;
}

/// Among the faces with the most vertices that are farthest along d, the one that faces d best.
Index best_face(const Convex& c, const Vector3d& d_C) {
  if (c.box) {
    Eigen::Index axis = 0;
    d_C.cwiseAbs().maxCoeff(&axis);
    return static_cast<Index>(2 * axis + (d_C[axis] > 0 ? 1 : 0));
  }
  const scene::Polytope& polytope = c.polytope;
  if (polytope.vertices.size() == 3) {  // flat
    const auto faces_less = [&](const auto& one, const auto& other) { return one.n.dot(d_C) < other.n.dot(d_C); };
    return static_cast<Index>(std::ranges::max_element(polytope.faces, faces_less) - polytope.faces.begin());
  }
  constexpr double kSame = 1e-9;  // of the extent
  const double top = polytope.vertices[farthest_vertex(polytope, d_C)].dot(d_C) - kSame * c.extent.maxCoeff() * d_C.norm();
  Index best = 0, held = 0;
  double most = 0;
  for (Index f = 0; f < polytope.faces.size(); ++f) {
    const scene::Polytope::Face& face = polytope.faces[f];
    Index holds = 0;
    for (Index k = face.begin; k < face.begin + face.count; ++k) {
      holds += polytope.vertices[polytope.corners[k]].dot(d_C) >= top ? 1 : 0;
    }
    const double x = face.n.dot(d_C);
    if (holds > held || (holds == held && holds > 0 && x > most)) held = holds, most = x, best = f;
  }
  return best;
}

/// For edges and vertices without a face that faces d: adds the edge perpendicular to d, or the vertex alone.
void add_edge_or_vertex(const Placed& piece, const Vector3d& d_C, Feature& feature) {
  const scene::Polytope& polytope = piece.convex->polytope;
  const Index tip = farthest_vertex(polytope, d_C);
  Index best = 0;
  double least = 0.1;  // sine; steeper edges are ignored
  bool found = false;
  for (Index e = 0; e < polytope.edges.size(); ++e) {
    const auto& [from, to] = polytope.edges[e].vertices;
    if (from != tip && to != tip) continue;
    const double slope = std::abs((polytope.vertices[to] - polytope.vertices[from]).stableNormalized().dot(d_C));
    if (slope < least) least = slope, best = e, found = true;
  }
  const auto place = [&](Index v) { return Vector3d(piece.p + piece.R * polytope.vertices[v]); };
  if (!found) {
    feature.corners.push_back({place(tip), tip, 0});
    return;
  }
  for (const Index v : polytope.edges[best].vertices) feature.corners.push_back({place(v), v, best});
}

/// Marks the faces of a triangle's prism that are no surface of its mesh: the bottom, and the sides at smooth and concave edges.
void cover(Convex& prism, const scene::Shape& triangle) {
  const std::vector<Vector3d>& v = triangle.vertices;
  const Vector3d up = (v[1] - v[0]).cross(v[2] - v[0]).normalized();
  const int edges = static_cast<int>(triangle.size.y());
  prism.covered.assign(prism.polytope.faces.size(), 0);
  prism.sides.resize(prism.covered.size());
  for (std::size_t f = 0; f < prism.covered.size(); ++f) {
    const Vector3d& n = prism.polytope.faces[f].n;
    if (std::abs(n.dot(up)) > 0.5) {
      if (n.dot(up) > 0) prism.top = f;
      prism.covered[f] = n.dot(up) < 0;
      prism.sides[f].outwards = -up;
      continue;
    }
    int best = 0;
    double most = -1;
    for (int e = 0; e < 3; ++e) {
      const auto k = static_cast<std::size_t>(e);
      const Vector3d outwards = (v[(k + 1) % 3] - v[k]).cross(up).normalized();
      if (outwards.dot(n) <= most) continue;
      most = outwards.dot(n);
      best = e;
      prism.sides[f] = {outwards, triangle.turns[e]};
    }
    prism.covered[f] = edges >> best & 1;
  }
}

}  // namespace

Convex make_convex(const scene::Shape& shape) {
  Convex convex;
  switch (shape.type) {
    case scene::ShapeType::kPlane:
      convex.core = Core::kPlane;
      break;
    case scene::ShapeType::kSphere:
      convex.round = shape.size.x();
      break;
    case scene::ShapeType::kCapsule:
      convex.core = Core::kSegment;
      convex.round = shape.size.x();
      convex.half = shape.size.y() / 2;
      convex.extent = {0, 0, convex.half};
      break;
    case scene::ShapeType::kCylinder:
      convex.core = Core::kCylinder;
      convex.radius = shape.size.x();
      convex.half = shape.size.y() / 2;
      convex.extent = {convex.radius, convex.radius, convex.half};
      break;
    case scene::ShapeType::kEllipsoid:
      convex.core = Core::kEllipsoid;
      convex.extent = shape.size;
      break;
    case scene::ShapeType::kBox:
      convex = polytope_of(scene::box_polytope(shape.size), shape.X_BS);
      convex.box = true;
      return convex;
    case scene::ShapeType::kTriangle: {
      convex = polytope_of(scene::convex_hull(scene::triangle_corners(shape)), shape.X_BS);
      convex.triangle = true;
      cover(convex, shape);
      return convex;
    }
    case scene::ShapeType::kHull:
      return polytope_of(scene::convex_hull(shape.vertices), shape.X_BS);
  }
  convex.X_BC = shape.X_BS;
  return convex;
}

Convex make_flat(const scene::Shape& triangle) {
  scene::Polytope flat;
  flat.vertices = triangle.vertices;
  const std::vector<Vector3d>& v = flat.vertices;
  const Vector3d n = (v[1] - v[0]).cross(v[2] - v[0]).normalized();
  flat.faces = {{n, n.dot(v[0]), 0, 3}, {-n, -n.dot(v[0]), 3, 3}};
  flat.corners = {0, 1, 2, 0, 2, 1};
  flat.corner_edges = {0, 1, 2, 5, 4, 3};
  flat.edges.resize(6);
  for (Index k = 0; k < 3; ++k) {
    const Index next = (k + 1) % 3;
    const Vector3d out = (v[next] - v[k]).cross(n).normalized();
    flat.faces.push_back({out, out.dot(v[k]), 6 + 2 * k, 2});
    flat.corners.insert(flat.corners.end(), {k, next});
    flat.corner_edges.insert(flat.corner_edges.end(), {k, k});
    flat.edges[k] = {{k, next}, {0, 2 + k}};
    flat.edges[3 + k] = {{k, next}, {2 + k, 1}};
  }
  return polytope_of(std::move(flat), triangle.X_BS);
}

void find_covered_faces(std::span<Convex> pieces) {
  constexpr double kCoincident = 1e-9;  // of the size of the smaller piece
  const auto covers = [](const Convex& own, const scene::Polytope::Face& face, const Convex& other, double near) {
    const Pose X = other.X_BC.inverse() * own.X_BC;
    for (const scene::Polytope::Face& over : other.polytope.faces) {
      if (over.n.dot(X.R * face.n) > -1 + 1e-12) continue;
      bool on = true;
      for (Index k = face.begin; k < face.begin + face.count && on; ++k) {
        const Vector3d p = X * own.polytope.vertices[own.polytope.corners[k]];
        on = std::abs(over.n.dot(p) - over.d) <= near;
        for (const scene::Polytope::Face& bound : other.polytope.faces) on = on && bound.n.dot(p) <= bound.d + near;
      }
      if (on) return true;
    }
    return false;
  };
  for (Convex& own : pieces) {
    if (own.core != Core::kPolytope || own.triangle) continue;
    for (const Convex& other : pieces) {
      if (&own == &other || other.core != Core::kPolytope || other.triangle) continue;
      if ((own.X_BC.p - other.X_BC.p).norm() > 1.001 * (own.extent.norm() + other.extent.norm())) continue;
      const double near = kCoincident * std::min(own.extent.norm(), other.extent.norm());
      for (std::size_t f = 0; f < own.polytope.faces.size(); ++f) {
        if (!covers(own, own.polytope.faces[f], other, near)) continue;
        own.covered.resize(own.polytope.faces.size());
        own.covered[f] = 1;
      }
    }
  }
}

namespace {

/// Whether d, in C, is a normal of the convex edge above a covered side. `farthest`: the least height along d of the part that is farthest.
bool is_normal_of_edge(const Convex& prism, const Convex::Side& side, const Vector3d& d, double farthest) {
  const scene::Polytope::Face& top = prism.polytope.faces[prism.top];
  constexpr double kSame = 1e-9;      // of the extent
  constexpr double kRounding = 1e-6;  // rad
  const double below = top.d - kSame * prism.extent.maxCoeff();
  const auto is_bottom = [&](const Vector3d& v) { return v.dot(d) >= farthest && v.dot(top.n) < below; };
  if (std::ranges::any_of(prism.polytope.vertices, is_bottom)) return false;
  return std::atan2(side.outwards.dot(d), top.n.dot(d)) <= side.turn + kRounding;
}

}  // namespace

bool points_out_of_covered(const Placed& piece, const Vector3d& d) {
  const Convex& c = *piece.convex;
  if (c.covered.empty()) return false;
  const Vector3d d_C = piece.R.transpose() * d;
  const std::vector<Vector3d>& vertices = c.polytope.vertices;
  constexpr double kSame = 1e-9;  // of the extent
  const double top = vertices[farthest_vertex(c.polytope, d_C)].dot(d_C) - kSame * c.extent.maxCoeff();
  const auto farthest = std::count_if(vertices.begin(), vertices.end(), [&](const Vector3d& v) { return v.dot(d_C) >= top; });
  const double lean = c.sides.empty() ? 0.05 : 1e-6;  // sine; a ball on triangles must not be pushed aside by their seams
  for (std::size_t f = 0; f < c.covered.size(); ++f) {
    const scene::Polytope::Face& face = c.polytope.faces[f];
    if (c.covered[f] == 0 || (c.sides.empty() ? face.n : c.sides[f].outwards).dot(d_C) <= lean) continue;
    const auto begin = c.polytope.corners.begin() + face.begin;
    if (std::count_if(begin, begin + face.count, [&](Index v) { return vertices[v].dot(d_C) >= top; }) != farthest) continue;
    if (c.sides.empty() || !is_normal_of_edge(c, c.sides[f], d_C, top)) return true;
  }
  return false;
}

Vector3d support(const Placed& piece, const Vector3d& d) {
  const Convex& c = *piece.convex;
  const Vector3d d_C = piece.R.transpose() * d;
  switch (c.core) {
    case Core::kPlane:
    case Core::kPoint:
      return piece.p;
    case Core::kSegment:
      return piece.p + piece.R.col(2) * std::copysign(c.half, d_C.z());
    case Core::kCylinder: {
      const double length = std::hypot(d_C.x(), d_C.y());
      const double scale = length > 0 ? c.radius / length : 0;
      return piece.p + piece.R * Vector3d(scale * d_C.x(), scale * d_C.y(), std::copysign(c.half, d_C.z()));
    }
    case Core::kEllipsoid: {
      const Vector3d scaled = c.extent.cwiseProduct(d_C);
      const double length = scaled.norm();
      return length > 0 ? Vector3d(piece.p + piece.R * (c.extent.cwiseProduct(scaled) / length)) : piece.p;
    }
    case Core::kPolytope:
      if (c.box) return piece.p + piece.R * Vector3d(d_C.array().sign() * c.extent.array());
      return piece.p + piece.R * c.polytope.vertices[farthest_vertex(c.polytope, d_C)];
  }
  return piece.p;
}

void supporting_feature(const Placed& piece, const Vector3d& d, Feature& feature) {
  feature.corners.clear();
  const Convex& c = *piece.convex;
  const Vector3d d_C = piece.R.transpose() * d;
  switch (c.core) {
    case Core::kPlane:
    case Core::kPoint:
      feature.corners.push_back({piece.p, 0, 0});
      return;
    case Core::kEllipsoid:
      feature.corners.push_back({support(piece, d), 0, 0});
      return;
    case Core::kSegment:
      add_line(piece, piece.p, feature);
      return;
    case Core::kCylinder:
      if (d_C.z() * d_C.z() >= 0.5 * d_C.squaredNorm()) {
        add_disc(piece, d_C, feature);
      } else {
        const Vector2d u = c.radius * radial_direction(d_C);
        add_line(piece, piece.p + piece.R * Vector3d(u.x(), u.y(), 0), feature);
      }
      return;
    case Core::kPolytope: {
      const Index f = best_face(c, d_C);
      const scene::Polytope::Face& face = c.polytope.faces[f];
      constexpr double kSteep = 0.2;  // cosine: faces beyond 78° do not represent the part farthest along d
      if (face.n.dot(d_C) < kSteep * d_C.norm()) {
        add_edge_or_vertex(piece, d_C, feature);
        return;
      }
      for (Index k = face.begin; k < face.begin + face.count; ++k) {
        const Index v = c.polytope.corners[k];
        feature.corners.push_back({piece.p + piece.R * c.polytope.vertices[v], v, c.polytope.corner_edges[k]});
      }
      feature.n = piece.R * face.n;
      feature.face = f;
      return;
    }
  }
}

Vector3d half_sizes(const Convex& c, const Eigen::Matrix3d& R) {
  const Vector3d half = Vector3d::Constant(c.round);
  switch (c.core) {
    case Core::kPlane:
      return Vector3d::Constant(scene::kInfinity);
    case Core::kPoint:
      return half;
    case Core::kSegment:
      return half + R.col(2).cwiseAbs() * c.half;
    case Core::kCylinder: {
      const Vector3d z = R.col(2);
      return half + z.cwiseAbs() * c.half + c.radius * (Vector3d::Ones() - z.cwiseAbs2()).cwiseMax(0).cwiseSqrt();
    }
    case Core::kEllipsoid:
      return half + (R * c.extent.asDiagonal()).rowwise().norm();
    case Core::kPolytope:
      return half + R.cwiseAbs() * c.extent;
  }
  return half;
}

std::size_t most_corners(const Convex& convex) {
  std::size_t corners = kDiscCorners;
  for (const scene::Polytope::Face& face : convex.polytope.faces) corners = std::max<std::size_t>(corners, face.count);
  return corners;
}

}  // namespace cotwin::collision
