#pragma once
#include <Eigen/Core>
#include <array>

#include "models/collision/convex.h"

/// Where rays meet shapes.
namespace cotwin::collision {

/// Half a line, in some frame.
struct Ray {
  Eigen::Vector3d p, d;  // where it starts; unit
};

/// The distance along a ray to the first point of a piece, both in the same frame: 0 from inside, infinity if it passes by. A flat triangle
/// (make_flat) is met from both sides, but not by rays in its plane.
double first_along(const Ray& ray, const Convex& piece);

/// The corners of a flat triangle, counter-clockwise seen from its front.
using Corners = std::array<Eigen::Vector3d, 3>;

/// How the line of a ray crosses the plane of a triangle (Möller, Trumbore, J. Graphics Tools 2(1), 1997).
struct Crossing {
  double t;       // on the ray
  double within;  // least barycentric coordinate: negative beside the triangle; no number for a line in its plane
  bool front;     // against its normal
};
Crossing cross(const Ray& ray, const Corners& triangle);

}  // namespace cotwin::collision
