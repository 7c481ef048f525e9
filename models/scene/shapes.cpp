#include "models/scene/shapes.h"

#include <Eigen/Geometry>
#include <cmath>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/hull.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Intersection of the ray from the origin with the rectangle of these half edges.
Vector2d on_rectangle(const Vector2d& half, const Vector2d& direction) {
  return direction * std::min(half.x() / std::abs(direction.x()), half.y() / std::abs(direction.y()));
}

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

Eigen::Matrix3d diagonal(double xx, double yy, double zz) { return Vector3d(xx, yy, zz).asDiagonal(); }

}  // namespace

std::vector<Shape> round_hole(const RoundHole& hole) {
  const std::string place = "round hole";
  const auto expect = [&](bool holds, const std::string& what) {
    if (!holds) throw Error(place, what);
  };
  const auto mm = [](double x) { return text::to_text(1e3 * x, 6) + " mm"; };
  expect(hole.facets >= 6 && hole.facets <= 1000, std::to_string(hole.facets) + " facets, expected 6 … 1000");
  for (const double x : {hole.radius, hole.depth, hole.width, hole.length}) {
    expect(x > 0 && std::isfinite(x), "a size of " + mm(x) + ", expected > 0");
  }
  expect(hole.chamfer >= 0 && hole.chamfer < hole.depth,
         "chamfer " + mm(hole.chamfer) + ", expected ≥ 0 and less than the depth " + mm(hole.depth));
  const double corner = (hole.radius + hole.chamfer) / std::cos(M_PI / hole.facets),
               edge = std::min(hole.width, hole.length) / 2;
  expect(corner < edge, "extends " + mm(corner) + " from its axis, expected less than half the plate's edge " + mm(edge));

  const Vector2d half(hole.width / 2, hole.length / 2);
  const double top = hole.depth / 2, step = 2 * M_PI / hole.facets;
  std::vector<Shape> pieces;
  for (int k = 0; k < hole.facets; ++k) {
    // Both neighbours compute their common ray in the same way, so that rounding leaves no gap.
    const auto ray = [&](int i) {
      const double angle = (i % hole.facets - 0.5) * step;
      return Vector2d(std::cos(angle), std::sin(angle));
    };
    const Vector2d first = ray(k), last = ray(k + 1);
    const double stretch = 1 / std::cos(step / 2);  // ratio of the distances of a facet's corners and middle
    Shape piece;
    piece.name = "facet_" + std::to_string(k + 1);
    piece.type = ShapeType::kHull;
    const auto add = [&](const Vector2d& u, double z) { piece.vertices.emplace_back(u.x(), u.y(), z); };
    for (const Vector2d& direction : {first, last}) {
      add(direction * (hole.radius * stretch), -top);
      if (hole.chamfer > 0) add(direction * (hole.radius * stretch), top - hole.chamfer);
      add(direction * ((hole.radius + hole.chamfer) * stretch), top);
      for (const double z : {-top, top}) add(on_rectangle(half, direction), z);
    }
    for (const double x : {-1.0, 1.0}) {
      for (const double y : {-1.0, 1.0}) {
        const Vector2d plate_corner(x * half.x(), y * half.y());
        const bool between = cross(first, plate_corner) > 0 && cross(plate_corner, last) > 0;
        for (const double z : {-top, top}) {
          if (between) add(plate_corner, z);
        }
      }
    }
    pieces.push_back(std::move(piece));
  }
  return pieces;
}

std::vector<Vector3d> cone(double radius, double length) {
  if (!(radius > 0) || !(length > 0))
    throw Error("a cone of radius " + text::to_text(radius, 6) + " m and length " + text::to_text(length, 6) +
                " m, expected > 0");
  constexpr int kSides = 64;
  const double area = kSides / 2. * std::sin(2 * M_PI / kSides), reach = radius * std::sqrt(M_PI / area);
  std::vector<Vector3d> vertices{{0, 0, length / 2}};
  for (int k = 0; k < kSides; ++k) {
    const double angle = 2 * M_PI * k / kSides;
    vertices.emplace_back(reach * std::cos(angle), reach * std::sin(angle), -length / 2);
  }
  return vertices;
}

std::vector<Vector3d> triangle_corners(const Shape& triangle) {
  std::vector<Vector3d> corners = triangle.vertices;
  const Vector3d n = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalized();
  for (std::size_t k = 0; k < 3; ++k) corners.emplace_back(corners[k] - triangle.size.x() * n);
  return corners;
}

Inertia solid_inertia(const Shape& shape, double density) {
  if (!(density > 0 && std::isfinite(density))) throw Error("density " + text::to_text(density, 6) + " kg/m3, expected > 0");
  const double r = shape.size.x(), l = shape.size.y();
  Inertia inertia;
  switch (shape.type) {
    case ShapeType::kSphere:
      inertia.mass = density * 4 / 3 * M_PI * r * r * r;
      inertia.I_CC = diagonal(1, 1, 1) * (0.4 * inertia.mass * r * r);
      break;
    case ShapeType::kEllipsoid: {
      const Vector3d square = shape.size.cwiseAbs2();
      inertia.mass = density * 4 / 3 * M_PI * shape.size.prod();
      inertia.I_CC = inertia.mass / 5 * diagonal(square.y() + square.z(), square.z() + square.x(), square.x() + square.y());
      break;
    }
    case ShapeType::kBox: {
      const Vector3d square = shape.size.cwiseAbs2();
      inertia.mass = density * shape.size.prod();
      inertia.I_CC = inertia.mass / 12 * diagonal(square.y() + square.z(), square.z() + square.x(), square.x() + square.y());
      break;
    }
    case ShapeType::kCylinder: {
      inertia.mass = density * M_PI * r * r * l;
      const double across = inertia.mass * (r * r / 4 + l * l / 12);
      inertia.I_CC = diagonal(across, across, inertia.mass * r * r / 2);
      break;
    }
    case ShapeType::kCapsule: {  // a cylinder and two half balls whose centres of mass are 3/8 r from their flats
      const double side = density * M_PI * r * r * l, caps = density * 4 / 3 * M_PI * r * r * r;
      const double arm = l / 2 + 3 * r / 8;
      const double own = 0.4 * r * r - 9 * r * r / 64;  // of a half ball about its centre of mass, across, per mass
      const double across = side * (r * r / 4 + l * l / 12) + caps * (own + arm * arm);
      inertia.mass = side + caps;
      inertia.I_CC = diagonal(across, across, side * r * r / 2 + caps * 0.4 * r * r);
      break;
    }
    case ShapeType::kHull: {
      const Polytope polytope = convex_hull(shape.vertices);
      inertia.mass = density * polytope.volume();
      inertia.p_LC = polytope.centroid();
      inertia.I_CC = density * polytope.second_moment();
      break;
    }
    case ShapeType::kTriangle:
      throw Error("a triangle has no mass");
    case ShapeType::kPlane:
      throw Error("a plane has no mass");
  }
  return inertia.seen_from(shape.X_BS);
}

}  // namespace cotwin::scene
