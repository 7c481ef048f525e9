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

Crossing cross(const Ray& ray, const Corners& triangle) {
  const Vector3d u = triangle[1] - triangle[0], v = triangle[2] - triangle[0], from = ray.p - triangle[0];
  const Vector3d across = ray.d.cross(v), up = from.cross(u);
  const double det = u.dot(across);
  if (det == 0) return {0, std::nan(""), false};
  const double share = 1 / det, a = from.dot(across) * share, b = ray.d.dot(up) * share;
  return {v.dot(up) * share, std::min({a, b, 1 - a - b}), det > 0};
}

namespace {

double first_on(const Ray& ray, const Corners& triangle) {
  const Crossing crossing = cross(ray, triangle);
  return crossing.within >= -kEdge && crossing.t >= 0 ? crossing.t : kInfinity;
}

}  // namespace

double first_along(const Ray& ray, const Convex& piece) {
  const std::vector<Vector3d>& corners = piece.polytope.vertices;
  if (corners.size() == 3) return first_on(ray, {piece.X_BC * corners[0], piece.X_BC * corners[1], piece.X_BC * corners[2]});
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
      if (piece.box) {
        stretch.cut_box(piece.extent, p, d);
        break;
      }
      for (const scene::Polytope::Face& face : piece.polytope.faces) stretch.cut(face.n.dot(p) - face.d, face.n.dot(d));
      break;
    }
  }
  return stretch.first();
}

double Body::first_along(const Ray& ray, double most) const {
  double best = kInfinity;
  const auto try_piece = [&](std::uint32_t k) {
    if (present_[k] == 0) return;
    const double t = is_triangle(k) ? first_on(ray, triangles_[k]) : collision::first_along(ray, pieces_[k]);
    if (t < best && t <= most) best = most = t;
  };
  for (const std::uint32_t k : planes_) try_piece(k);
  if (nodes_.empty()) return best;
  constexpr double kParallel = 1e-200;  // in place of 0: what is beside the ray is far away
  const Vector3d inverse =
      ray.d.unaryExpr([](double x) { return 1 / (std::abs(x) < kParallel ? std::copysign(kParallel, x) : x); });
  const Vector3d size = inverse.cwiseAbs();
  const auto entry = [&](const Node& node) {
    const Vector3d middle = (node.middle - ray.p).cwiseProduct(inverse);
    // A little larger, as rounding of flat boxes must not lose what is in them.
    const Vector3d half = (node.half.array() + kEdge * node.radius).matrix().cwiseProduct(size);
    const double in = std::max((middle - half).maxCoeff(), 0.0);
    return in <= (middle + half).minCoeff() ? in : kInfinity;
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
