#pragma once
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <cmath>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "models/collision/contact/detector.h"

/// Random convex shapes, and an oracle of their distance that shares no code with the code under test: support functions and
/// surfaces from the definition of each shape.
namespace cotwin::contact_world::testing {

using collision::ContactPoint;
using Eigen::Matrix3d;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double real(double low, double high) {  // not std's distribution: the same numbers with every library
    return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53;
  }
  Vector3d vector(double reach) {
    const double x = real(-reach, reach), y = real(-reach, reach);
    return {x, y, real(-reach, reach)};
  }
  Vector3d direction() {
    for (;;) {
      const Vector3d v = vector(1);
      if (v.norm() > 0.1 && v.norm() < 1) return v.normalized();
    }
  }
  Matrix3d rotation() {
    const double a = real(-1, 1), b = real(-1, 1), c = real(-1, 1), d = real(-1, 1);
    return Eigen::Quaterniond(a, b, c, d).normalized().toRotationMatrix();
  }

 private:
  std::mt19937_64 engine_;
};

inline const std::vector<ShapeType> kBodies{ShapeType::kSphere, ShapeType::kBox, ShapeType::kCylinder, ShapeType::kCapsule,
                                            ShapeType::kHull};

inline std::string name_of(ShapeType type) {
  switch (type) {
    case ShapeType::kSphere:
      return "sphere";
    case ShapeType::kBox:
      return "box";
    case ShapeType::kCylinder:
      return "cylinder";
    case ShapeType::kCapsule:
      return "capsule";
    case ShapeType::kHull:
      return "hull";
    case ShapeType::kPlane:
      return "plane";
    case ShapeType::kTriangle:
      return "triangle";
    case ShapeType::kEllipsoid:
      return "ellipsoid";
  }
  return "";
}

inline Shape make(ShapeType type, const Vector3d& size) {
  Shape shape;
  shape.type = type;
  shape.size = size;
  return shape;
}

inline Shape random_shape(ShapeType type, Random& random) {
  Shape shape = make(type, {random.real(0.05, 0.2), random.real(0.05, 0.2), random.real(0.05, 0.2)});
  if (type == ShapeType::kHull) {
    for (int i = 0; i < 14; ++i) shape.vertices.push_back(random.direction() * shape.size.x() + Vector3d(0.01, 0, 0));
  }
  return shape;
}

/// The point of the shape farthest along d, by definition.
inline Vector3d farthest(const Shape& shape, const Pose& X, const Vector3d& d) {
  const Vector3d u = X.R.transpose() * d;
  const double r = shape.size.x(), half = shape.size.y() / 2;
  Vector3d p = Vector3d::Zero();
  switch (shape.type) {
    case ShapeType::kSphere:
      p = r * u.normalized();
      break;
    case ShapeType::kBox:
      for (int i = 0; i < 3; ++i) p[i] = std::copysign(shape.size[i] / 2, u[i]);
      break;
    case ShapeType::kCylinder:
      p = Vector3d(u.x(), u.y(), 0).normalized() * r;
      p.z() = std::copysign(half, u.z());
      break;
    case ShapeType::kCapsule:
      p = r * u.normalized() + Vector3d(0, 0, std::copysign(half, u.z()));
      break;
    case ShapeType::kEllipsoid:
      p = shape.size.cwiseAbs2().cwiseProduct(u) / shape.size.cwiseProduct(u).norm();
      break;
    case ShapeType::kTriangle:
    case ShapeType::kHull:
      p = shape.vertices[0];
      for (const Vector3d& v : shape.vertices) {
        if (v.dot(u) > p.dot(u)) p = v;
      }
      break;
    case ShapeType::kPlane:
      break;
  }
  return X * p;
}

/// The gap of two shapes along n: a lower bound of their signed distance, and the distance itself for the best n.
inline double gap_along(const Shape& a, const Pose& X_a, const Shape& b, const Pose& X_b, const Vector3d& n) {
  return n.dot(farthest(b, X_b, -n) - farthest(a, X_a, n));
}

/// The largest gap over evenly spread directions, improved from the best of them.
inline double best_gap(const Shape& a, const Pose& X_a, const Shape& b, const Pose& X_b, Random& random,
                       Vector3d* best_n = nullptr) {
  constexpr int kDirections = 2000;
  double best = -std::numeric_limits<double>::infinity();
  Vector3d n = Vector3d::UnitZ();
  const auto offer = [&](const Vector3d& m) {
    const double gap = gap_along(a, X_a, b, X_b, m);
    if (gap <= best) return false;
    best = gap;
    n = m;
    return true;
  };
  for (int i = 0; i < kDirections; ++i) {  // a spiral by the golden angle
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z), turn = 2.399963229728653 * i;
    offer({r * std::cos(turn), r * std::sin(turn), z});
  }
  for (double step = 0.05; step > 1e-9;) {
    bool better = false;
    for (int k = 0; k < 12; ++k) better = offer((n + random.vector(step)).normalized()) || better;
    if (!better) step *= 0.6;
  }
  if (best_n != nullptr) *best_n = n;
  return best;
}

inline scene::Scene scene_of(const std::vector<Shape>& shapes) {
  scene::Scene scene;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    scene::Body body;
    body.name = "body_" + std::to_string(i);
    body.shapes = {shapes[i]};
    if (shapes[i].type == ShapeType::kPlane) body.motion = scene::Motion::kStatic;
    scene.bodies.push_back(body);
  }
  return scene;
}

inline const ContactPoint& deepest(std::span<const ContactPoint> points) {
  return *std::min_element(points.begin(), points.end(), [](const auto& p, const auto& q) { return p.gap < q.gap; });
}

inline std::string text_of(const Pose& X) {
  const Eigen::Quaterniond q(X.R);
  char buffer[200];
  std::snprintf(buffer, sizeof buffer, "p %.17g %.17g %.17g q %.17g %.17g %.17g %.17g", X.p.x(), X.p.y(), X.p.z(), q.w(), q.x(),
                q.y(), q.z());
  return buffer;
}

inline std::string text_of(const Shape& shape) {
  char buffer[200];
  std::snprintf(buffer, sizeof buffer, "%s %.17g %.17g %.17g", name_of(shape.type).c_str(), shape.size.x(), shape.size.y(),
                shape.size.z());
  return buffer;
}

}  // namespace cotwin::contact_world::testing
