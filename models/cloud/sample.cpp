#include "models/cloud/sample.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/numerics/random.h"
#include "models/scene/hull.h"

namespace cotwin::cloud {

using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;
using std::numbers::pi;

namespace {

struct SurfacePoint {
  Vector3d p, n;  // n: outwards, unit
};

/// A part of a surface, as an image of the unit square that keeps ratios of areas.
struct Patch {
  double area;  // m²
  std::function<SurfacePoint(double u, double v)> at;
};

Vector3d around(double radius, double angle, double z) { return {radius * std::cos(angle), radius * std::sin(angle), z}; }

Vector3d direction(double u, double v) { return around(2 * std::sqrt(u * (1 - u)), 2 * pi * v, 2 * u - 1); }

Patch triangle(const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  const Vector3d n = (b - a).cross(c - a);
  return {n.norm() / 2, [=](double u, double v) {
            if (u + v > 1) u = 1 - u, v = 1 - v;
            return SurfacePoint{a + u * (b - a) + v * (c - a), n.normalized()};
          }};
}

void add_polytope(const scene::Polytope& polytope, std::vector<Patch>& patches) {
  for (const scene::Polytope::Face& face : polytope.faces) {
    const auto corner = [&](std::uint32_t k) { return polytope.vertices[polytope.corners[face.begin + k]]; };
    for (std::uint32_t k = 1; k + 1 < face.count; ++k) patches.push_back(triangle(corner(0), corner(k), corner(k + 1)));
  }
}

/// Of the shape in its own frame; none of a plane.
std::vector<Patch> patches_of(const Shape& shape) {
  std::vector<Patch> patches;
  const double r = shape.size.x(), length = shape.size.y();
  const auto add_side = [&] {
    patches.push_back({2 * pi * r * length, [=](double u, double v) {
                         return SurfacePoint{around(r, 2 * pi * v, (u - 0.5) * length), around(1, 2 * pi * v, 0)};
                       }});
  };
  switch (shape.type) {
    case ShapeType::kSphere:
    case ShapeType::kCapsule: {
      const bool capsule = shape.type == ShapeType::kCapsule;
      if (capsule) add_side();
      patches.push_back({4 * pi * r * r, [=](double u, double v) {
                           const Vector3d n = direction(u, v);
                           return SurfacePoint{r * n + Vector3d(0, 0, capsule ? std::copysign(length / 2, n.z()) : 0), n};
                         }});
      break;
    }
    case ShapeType::kCylinder:
      add_side();
      for (const double end : {-1.0, 1.0}) {
        patches.push_back({pi * r * r, [=](double u, double v) {
                             return SurfacePoint{around(r * std::sqrt(u), 2 * pi * v, end * length / 2), {0, 0, end}};
                           }});
      }
      break;
    case ShapeType::kEllipsoid: {  // nearly: its ends have more points than they should
      const Vector3d radii = shape.size;
      constexpr double kThomsen = 1.6075;
      const auto power = [](double x) { return std::pow(x, kThomsen); };
      const double mean = (power(radii.x() * radii.y()) + power(radii.x() * radii.z()) + power(radii.y() * radii.z())) / 3;
      patches.push_back({4 * pi * std::pow(mean, 1 / kThomsen), [=](double u, double v) {
                           const Vector3d n = direction(u, v);
                           return SurfacePoint{n.cwiseProduct(radii), n.cwiseQuotient(radii).normalized()};
                         }});
      break;
    }
    case ShapeType::kBox:
      add_polytope(scene::box_polytope(shape.size), patches);
      break;
    case ShapeType::kHull:
      add_polytope(scene::convex_hull(shape.vertices), patches);
      break;
    case ShapeType::kTriangle:
      patches.push_back(triangle(shape.vertices[0], shape.vertices[1], shape.vertices[2]));
      break;
    case ShapeType::kPlane:
      break;
  }
  return patches;
}

}  // namespace

Cloud sample(const scene::Scene& scene, const Sampling& sampling, std::vector<std::string>& left_out) {
  constexpr double kMost = 1e8;
  std::vector<Vector3d> points;
  double due = 0.5;  // points
  for (const scene::Body& body : scene.bodies) {
    for (const Shape& shape : body.shapes) {
      const std::vector<Patch> patches = patches_of(shape);
      if (patches.empty() && std::ranges::find(left_out, body.name) == left_out.end()) left_out.push_back(body.name);
      const Pose X_WS = body.X_WB * shape.X_BS;
      for (const Patch& patch : patches) {
        due += patch.area / (sampling.spacing * sampling.spacing);
        if (!(due < kMost))
          throw Error("spacing", text::to_text(sampling.spacing) +
                                     " m, at which there are more than 1e8 points on the bodies of scene '" + scene.name +
                                     "', expected more");
        while (static_cast<double>(points.size()) + 1 <= due) {
          const auto k = static_cast<double>(points.size());
          constexpr double kAlong = 0.7548776662466927, kAcross = 0.5698402909980532;  // 1 / g, 1 / g², g³ = g + 1
          const auto turned = [&](double share) { return std::fmod(0.5 + share * k, 1.0); };
          const SurfacePoint at = patch.at(turned(kAlong), turned(kAcross));
          const double off =
              sampling.sigma * numerics::normal({sampling.seed, 0, 0, static_cast<std::uint32_t>(points.size()), 0});
          points.push_back(X_WS * Vector3d(at.p + off * at.n));
        }
      }
    }
  }
  return make_cloud(points);
}

double area(const scene::Body& body) {
  double sum = 0;
  for (const Shape& shape : body.shapes)
    for (const Patch& patch : patches_of(shape)) sum += patch.area;
  return sum;
}

}  // namespace cotwin::cloud
