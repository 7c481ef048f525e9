#include "models/collision/ray.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "models/collision/body.h"

namespace cotwin::collision {
namespace {

using Eigen::Vector3d;
using scene::kInfinity;

/// Where a line p + t d is in a convex set: from `in` to `out`; everywhere until something cuts it, nowhere if in > out.
struct Stretch {
  double in = -kInfinity, out = kInfinity;

  /// Cuts off the half space in which `height` + t `rate` is positive.
  void cut(double height, double rate) {
    if (rate == 0) {
      if (height > 0) out = -kInfinity;
    } else if (rate < 0) {
      in = std::max(in, -height / rate);
    } else {
      out = std::min(out, -height / rate);
    }
  }
  void cut_box(const Vector3d& half, const Vector3d& p, const Vector3d& d) {
    for (Eigen::Index i = 0; i < 3; ++i) {
      cut(p[i] - half[i], d[i]);
      cut(-p[i] - half[i], -d[i]);
    }
  }
  /// Leaves the ball ‖p + t d‖ ≤ radius, in a plane a circle. From the point of the line that is nearest to the middle, which keeps digits far away.
  template <class Vector>
  void cut_ball(const Vector& p, const Vector& d, double radius) {
    const double square = d.squaredNorm(), nearest = square > 0 ? -p.dot(d) / square : 0;
    const double rest = radius * radius - (p + nearest * d).squaredNorm();
    const double half = square > 0 ? std::sqrt(std::max(rest, 0.0) / square) : kInfinity;
    in = std::max(in, nearest - half);
    out = rest < 0 ? -kInfinity : std::min(out, nearest + half);
  }
  double first() const { return in <= out && out >= 0 ? std::max(in, 0.0) : kInfinity; }
};

Stretch cylinder(const Vector3d& p, const Vector3d& d, double radius, double half) {
  Stretch side;
  side.cut_ball(p.head<2>().eval(), d.head<2>().eval(), radius);
  side.cut(p.z() - half, d.z());
  side.cut(-p.z() - half, -d.z());
  return side;
}

/// Nearer than this to its edge, a share of the triangle, it is met: no ray passes between two triangles.
constexpr double kEdge = 1e-9;

}  // namespace

Crossing cross(const Ray& ray, const Convex& triangle) {
  const std::vector<Vector3d>& corners = triangle.polytope.vertices;
  const Vector3d u = corners[1] - corners[0], v = corners[2] - corners[0];
  const Vector3d d = triangle.X_BC.R.transpose() * ray.d;
  const Vector3d from = triangle.X_BC.R.transpose() * (ray.p - triangle.X_BC.p) - corners[0];
  const Vector3d across = d.cross(v), up = from.cross(u);
  const double det = u.dot(across), a = from.dot(across) / det, b = d.dot(up) / det;
  if (det == 0) return {0, std::nan(""), false};
  return {v.dot(up) / det, std::min({a, b, 1 - a - b}), det > 0};
}

double first_along(const Ray& ray, const Convex& piece) {
  const Vector3d p = piece.X_BC.R.transpose() * (ray.p - piece.X_BC.p), d = piece.X_BC.R.transpose() * ray.d;
  Stretch stretch;
  switch (piece.core) {
    case Core::kPlane:
      stretch.cut(p.z(), d.z());
      break;
    case Core::kPoint:
      stretch.cut_ball(p, d, piece.round);
      break;
    case Core::kSegment: {
      double first = cylinder(p, d, piece.round, piece.half).first();
      for (const double end : {-piece.half, piece.half}) {
        Stretch cap;
        cap.cut_ball(Vector3d(p.x(), p.y(), p.z() - end), d, piece.round);
        first = std::min(first, cap.first());
      }
      return first;
    }
    case Core::kCylinder:
      stretch = cylinder(p, d, piece.radius, piece.half);
      break;
    case Core::kEllipsoid:
      stretch.cut_ball(p.cwiseQuotient(piece.extent).eval(), d.cwiseQuotient(piece.extent).eval(), 1);
      break;
    case Core::kPolytope: {
      if (piece.polytope.vertices.size() == 3) {
        const Crossing crossing = cross(ray, piece);
        return crossing.within >= -kEdge && crossing.t >= 0 ? crossing.t : kInfinity;
      }
      if (piece.box) {
        stretch.cut_box(piece.extent, p, d);
        break;
      }
      for (const scene::Polytope::Face& face : piece.polytope.faces) stretch.cut(face.n.dot(p) - face.d, face.n.dot(d));
      break;
    }
    case Core::kHeights:
      return kInfinity;
  }
  return stretch.first();
}

double Body::first_along(const Ray& ray, double most) const {
  if (contains(ray.p)) return 0;
  double best = kInfinity;
  const auto try_piece = [&](std::uint32_t k) {
    if (present_[k] == 0) return;
    const double t = collision::first_along(ray, pieces_[k]);
    if (t < best && t <= most) best = most = t;
  };
  for (const std::uint32_t k : planes_) try_piece(k);
  if (nodes_.empty()) return best;
  const auto entry = [&ray](const Node& node) {
    Stretch stretch;
    // A little larger, as rounding of flat boxes must not lose what is in them.
    stretch.cut_box(node.half.array() + kEdge * node.radius, ray.p - node.middle, ray.d);
    return stretch.first();
  };
  struct Step {
    std::int32_t node;
    double least;  // the ray enters its box there
  };
  std::array<Step, 64> stack;  // a tree that halves 2³² pieces leaves 33
  stack[0] = {root(), entry(node(root()))};
  for (std::size_t n = 1; n > 0;) {
    const Step step = stack[--n];
    if (!(step.least <= most) || step.least == kInfinity) continue;
    const Node& at = node(step.node);
    if (at.left < 0) {
      try_piece(at.piece);
      continue;
    }
    Step near{at.left, entry(node(at.left))}, far{at.right, entry(node(at.right))};
    if (far.least < near.least) std::swap(near, far);
    stack[n++] = far;
    stack[n++] = near;
  }
  return best;
}

}  // namespace cotwin::collision
