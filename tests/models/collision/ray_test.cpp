// Where rays first meet shapes and bodies: closed forms, marches by distances, brute force over triangles.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

#include "models/collision/body.h"
#include "models/collision/ray.h"
#include "models/collision/separation.h"
#include "tests/models/collision/meshes.h"
#include "tests/models/collision/random_shapes.h"
#include "tests/support/allocations.h"

namespace cotwin::collision::ray_test {
namespace {

using Eigen::Vector3d;
using scene::kInfinity;
using scene::Shape;
using scene::ShapeType;

Shape hull(std::vector<Vector3d> corners) {
  Shape s = shape(ShapeType::kHull, Vector3d::Zero());
  s.vertices = std::move(corners);
  return s;
}

Shape triangle(const Vector3d& a, const Vector3d& b, const Vector3d& c) {
  Shape s = shape(ShapeType::kTriangle, {0.1, 0, 0});
  s.vertices = {a, b, c};
  return s;
}

Ray towards(const Vector3d& from, const Vector3d& to) { return {from, (to - from).normalized()}; }

TEST(Rays, MeetEachShapeWhereItsEquationSays) {
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  const double slope = std::sqrt(0.5);
  const Vector3d across(slope, 0, slope);
  struct Case {
    const char* what;
    Shape shape;
    Ray ray;
    double t;
  };
  const Shape sphere = shape(ShapeType::kSphere, {0.5, 0, 0}), capsule = shape(ShapeType::kCapsule, {0.2, 1, 0});
  const Shape cylinder = shape(ShapeType::kCylinder, {0.2, 1, 0}), box = shape(ShapeType::kBox, {0.2, 0.4, 1});
  const Shape ellipsoid = shape(ShapeType::kEllipsoid, {0.2, 0.3, 0.6}), plane = shape(ShapeType::kPlane, Vector3d::Zero());
  const Shape pyramid = hull({{0.5, 0.5, 0}, {-0.5, 0.5, 0}, {-0.5, -0.5, 0}, {0.5, -0.5, 0}, {0, 0, 1}});
  const Shape flat = triangle({0, 0, 0}, {1, 0, 0}, {0, 1, 0});
  const std::vector<Case> cases = {
      {"sphere, off its middle", sphere, {{-2, 0.3, 0}, x}, 2 - 0.4},
      {"sphere, touched", sphere, {{-2, 0.5, 0}, x}, 2},
      {"sphere, missed by 1e-12 of it", sphere, {{-2, 0.5 + 1e-12, 0}, x}, kInfinity},
      {"sphere, behind", sphere, {{2, 0, 0}, x}, kInfinity},
      {"sphere, from inside", sphere, {{0.1, 0.2, 0}, x}, 0},
      {"sphere of radius 0", shape(ShapeType::kSphere, Vector3d::Zero()), {{-1, 1e-9, 0}, x}, kInfinity},
      {"capsule, side", capsule, {{-2, 0, 0.4}, x}, 1.8},
      {"capsule, side, off its axis", capsule, {{-2, 0.12, 0.4}, x}, 2 - 0.16},
      {"capsule, cap along the axis", capsule, {{0.12, 0, 3}, -z}, 3 - 0.5 - 0.16},
      {"capsule, the cap beyond its end", capsule, {{-2, 0, 0.62}, x}, 2 - 0.16},
      {"capsule, above it", capsule, {{-2, 0, 0.71}, x}, kInfinity},
      {"capsule, from inside a cap", capsule, {{0, 0, 0.65}, z}, 0},
      {"cylinder, side", cylinder, {{-2, 0.12, 0.4}, x}, 2 - 0.16},
      {"cylinder, cap", cylinder, {{0.1, 0.1, 3}, -z}, 2.5},
      {"cylinder, cap aslant", cylinder, {{-1.1, 0, -1.5}, across}, std::sqrt(2.0)},
      {"cylinder, along its side", cylinder, {{0.2, 0, 3}, -z}, 2.5},
      {"cylinder, beside it", cylinder, {{0.201, 0, 3}, -z}, kInfinity},
      {"cylinder, from inside", cylinder, {{0.1, 0, 0.4}, x}, 0},
      {"box, face", box, {{0.05, 3, 0.4}, -y}, 2.8},
      {"box, along a face", box, {{0.1, 3, 0}, -y}, 2.8},
      {"box, aslant", box, {{-1.1, 0, -1}, across}, std::sqrt(2.0)},
      {"box, beside it", box, {{0.11, 3, 0}, -y}, kInfinity},
      {"box, from inside", box, {{0.09, 0.19, 0.49}, -y}, 0},
      {"ellipsoid, axis", ellipsoid, {{0, 0, 2}, -z}, 1.4},
      {"ellipsoid, off its axis", ellipsoid, {{0.12, 0, 2}, -z}, 2 - 0.6 * 0.8},
      {"ellipsoid, touched", ellipsoid, {{-1, 0.3, 0}, x}, 1},
      {"ellipsoid, from inside", ellipsoid, {{0, 0.29, 0}, x}, 0},
      {"plane", plane, {{1, 2, 3}, {0, -0.6, -0.8}}, 3.75},
      {"plane, parallel", plane, {{1, 2, 3}, x}, kInfinity},
      {"plane, away", plane, {{1, 2, 3}, z}, kInfinity},
      {"plane, from below", plane, {{1, 2, -1e-3}, z}, 0},
      {"hull, sloping face", pyramid, {{-2, 0, 0.5}, x}, 2 - 0.25},
      {"hull, its tip", pyramid, {{0, 0, 3}, -z}, 2},
      {"hull, floor", pyramid, {{0.2, 0.1, -1}, z}, 1},
      {"hull, past its tip", pyramid, {{-2, 0, 1.001}, x}, kInfinity},
      {"triangle, from its front", flat, {{0.2, 0.2, 1}, -z}, 1},
      {"triangle, from its back", flat, {{0.2, 0.2, -1}, z}, 1},
      {"triangle, on an edge", flat, {{0.5, 0.5, 1}, -z}, 1},
      {"triangle, beside it", flat, {{0.51, 0.51, 1}, -z}, kInfinity},
      {"triangle, in its plane", flat, {{-1, 0.2, 0}, x}, kInfinity},
      {"triangle, behind", flat, {{0.2, 0.2, 1}, z}, kInfinity},
  };
  Random random(1);
  for (Case c : cases) {
    const Body alone(std::array{c.shape});
    const double t = alone.first_along(c.ray);
    // Nearly touched: 1e-12 of it is 1e-6 of t.
    EXPECT_TRUE(t == c.t || std::abs(t - c.t) < 1e-14 * (1 + c.t)) << c.what << ": " << t << ", expected " << c.t;
    const bool edge = std::string(c.what).find("touched") != std::string::npos ||
                      std::string(c.what).find("along") != std::string::npos ||
                      std::string(c.what).find("parallel") != std::string::npos ||
                      std::string(c.what).find("in its plane") != std::string::npos;
    for (int k = 0; k < 20 && !edge; ++k) {  // in other frames, where rounding does not decide
      const Pose X_BS = random.pose(2);
      c.shape.X_BS = X_BS;
      const double moved = Body(std::array{c.shape}).first_along({X_BS * c.ray.p, X_BS.R * c.ray.d});
      EXPECT_TRUE(moved == c.t || std::abs(moved - c.t) < 1e-13 * (1 + c.t)) << c.what << ": " << moved << ", expected " << c.t;
    }
  }
}

/// Marches along a ray as far as nothing can be nearer, by the distances of points from the shape. Returns the first t at which it is within `near`.
double march(const Placed& placed, const Ray& ray, double most, double near) {
  double t = 0;
  for (int k = 0; k < 20000 && t < most; ++k) {
    const double gap = of_point(placed, ray.p + t * ray.d).gap - placed.convex->round;
    if (gap < near) return t;
    t += gap;
  }
  return t < most ? t : kInfinity;
}

TEST(Rays, EndWhereAMarchByDistancesEnds) {
  Random random(2);
  int met = 0, passed = 0;
  for (int k = 0; k < 30000; ++k) {
    const Vector3d size(random.real(0.02, 0.5), random.real(0.02, 0.5), random.real(0.02, 0.5));
    Shape s = shape(std::array{ShapeType::kSphere, ShapeType::kBox, ShapeType::kCylinder, ShapeType::kCapsule, ShapeType::kHull,
                               ShapeType::kEllipsoid, ShapeType::kPlane}[static_cast<std::size_t>(k % 7)],
                    k % 7 == 6 ? Vector3d::Zero() : size);
    for (int i = 0; s.type == ShapeType::kHull && i < 12; ++i) s.vertices.push_back(random.vector(0.4));
    s.X_BS = random.pose(0.3);
    const Ray ray = towards(random.vector(2), random.vector(0.5));
    const Convex convex = make_convex(s);
    const Placed placed{&convex, convex.X_BC.R, convex.X_BC.p};
    const double t = first_along(ray, convex);
    const auto gap = [&](double at) { return of_point(placed, ray.p + at * ray.d).gap - convex.round; };
    if (t == kInfinity) {
      ++passed;
      EXPECT_EQ(march(placed, ray, 1e3, -1e-9), kInfinity) << k;
      continue;
    }
    ++met;
    if (t == 0) {
      EXPECT_LE(gap(0), 1e-9) << k;
      continue;
    }
    EXPECT_NEAR(gap(t), 0, 2e-12) << k;
    const double early = march(placed, ray, 1e3, 1e-9);
    // A glancing ray is near for a while before it meets.
    EXPECT_LE(early, t + 1e-9) << k;
    EXPECT_GT(gap((early + t) / 2), -1e-12) << k;
  }
  EXPECT_GT(met, 8000);
  EXPECT_GT(passed, 8000);
}

/// The first triangle of a mesh that a ray meets, by its plane and the sides on which its edges are.
double brute(const scene::Mesh& mesh, const Ray& ray) {
  double first = kInfinity;
  for (const auto& corner : mesh.triangles) {
    const Vector3d &a = mesh.vertices[corner[0]], &b = mesh.vertices[corner[1]], &c = mesh.vertices[corner[2]];
    const Vector3d n = (b - a).cross(c - a);
    const double rate = n.dot(ray.d), t = n.dot(a - ray.p) / rate;
    if (rate == 0 || t < 0 || t >= first) continue;
    const Vector3d p = ray.p + t * ray.d;
    if ((b - a).cross(p - a).dot(n) >= 0 && (c - b).cross(p - b).dot(n) >= 0 && (a - c).cross(p - c).dot(n) >= 0) first = t;
  }
  return first;
}

TEST(Rays, MeetMeshesAsBruteForceOverTheirTriangles) {
  Random random(3);
  for (const auto& [mesh, rays] : {std::pair{bumps(12, 16, 0.4, 0.2), 100'000}, {torus(100, 100), 1500}}) {
    std::vector<Shape> shapes = shapes_of(mesh);
    const Body closed(shapes);
    shapes.pop_back();
    const Body open(shapes);
    scene::Mesh without = mesh;
    without.triangles.pop_back();
    ASSERT_TRUE(open.open() && !closed.open());
    int met = 0, inside = 0, wrong = 0;
    for (int k = 0; k < rays; ++k) {
      const Ray ray = towards(random.vector(1.2), random.vector(0.6));
      const Vector3d far = Vector3d(1e3, -2e3, 5e2);
      const double expected = brute(mesh, ray), t = closed.first_along(ray), of_open = open.first_along(ray);
      met += expected < kInfinity ? 1 : 0;
      const auto agree = [](double x, double y, double bound) { return x == y || std::abs(x - y) < bound; };
      inside += closed.contains(ray.p) ? 1 : 0;
      wrong += agree(t, expected, 1e-12) ? 0 : 1;
      if (k % 10 == 0) wrong += agree(of_open, brute(without, ray), 1e-12) ? 0 : 1;
      if (k % 50 != 0 || expected == kInfinity) continue;
      const Ray longer{ray.p - 3 * ray.d, ray.d};
      EXPECT_NEAR(closed.first_along(longer), brute(mesh, longer), 1e-12);
      EXPECT_EQ(closed.first_along(ray, expected * (1 - 1e-9)), kInfinity);
      EXPECT_NEAR(closed.first_along(ray, expected * (1 + 1e-9)), expected, 1e-12);
      Body twice(open);
      twice.set_scaled(open, 2);
      if (of_open < kInfinity) EXPECT_NEAR(twice.first_along({2 * ray.p, ray.d}), 2 * of_open, 1e-12);
      EXPECT_EQ(closed.first_along({ray.p + far, ray.d}), kInfinity);
    }
    EXPECT_EQ(wrong, 0);
    EXPECT_GT(met, rays / 4);
    EXPECT_GT(inside, rays / 500);
  }
}

// Through corners and edges, where each triangle alone may miss by rounding.
TEST(Rays, DoNotPassBetweenTriangles) {
  Random random(4);
  const scene::Mesh mesh = bumps(20, 24, 0.4, 0);
  const std::vector<Shape> flat = shapes_of(mesh);
  for (int turn = 0; turn < 10; ++turn) {
    const Pose X = turn == 0 ? Pose{} : random.pose(3);
    std::vector<Shape> shapes = shapes_of(mesh);
    for (Shape& s : shapes) s.X_BS = X * s.X_BS;
    const Body body(shapes);
    for (int k = 0; k < 1000; ++k) {
      const auto& corners =
          mesh.triangles[static_cast<std::size_t>(random.real(0, static_cast<double>(mesh.triangles.size())))];
      const Vector3d a = mesh.vertices[corners[0]], b = mesh.vertices[corners[1]];
      const Vector3d edge = a + (k % 3 == 0 ? 0 : random.real(0, 1)) * (b - a);
      const Vector3d from = 3 * random.direction();
      if (from.dot(edge) < 0.5) continue;
      EXPECT_NEAR(body.first_along(towards(X * from, X * edge)), (edge - from).norm(), 1e-8);
    }
  }
}

TEST(Rays, MeetTheNearestShapeThatIsPresent) {
  Random random(5);
  std::vector<Shape> shapes;
  for (int k = 0; k < 60; ++k) {
    Shape s = shape(std::array{ShapeType::kSphere, ShapeType::kBox, ShapeType::kCapsule}[static_cast<std::size_t>(k % 3)],
                    {random.real(0.02, 0.1), random.real(0.02, 0.1), random.real(0.02, 0.1)});
    s.X_BS = random.pose(1);
    if (k % 5 == 0) s.tool = "gripper";
    shapes.push_back(s);
  }
  shapes.push_back(shape(ShapeType::kPlane, Vector3d::Zero()));
  shapes.back().X_BS.p.z() = -1.5;
  Body body(shapes);
  for (const bool present : {false, true}) {
    for (std::size_t k = 0; k < shapes.size(); ++k)
      if (!shapes[k].tool.empty()) body.set_present(k, present);
    for (int k = 0; k < 3000; ++k) {
      const Ray ray = towards(random.vector(2), random.vector(1));
      double expected = kInfinity;
      for (const Shape& s : shapes) {
        if (s.tool.empty() || present) expected = std::min(expected, first_along(ray, make_convex(s)));
      }
      const std::uint64_t before = testing::allocations();
      const double t = body.first_along(ray);
      EXPECT_EQ(testing::allocations(), before);
      EXPECT_EQ(t, expected) << k;
    }
  }
}

// Also of what is inside.
TEST(Rays, MeetAClosedMeshOfAToolOnlyWhileItIsThere) {
  std::vector<Shape> shapes = shapes_of(bumps(8, 8, 0.4, 0));
  for (Shape& s : shapes) s.tool = "ball";
  Body body(shapes);
  const Ray within{{0.01, 0.02, 0.03}, Vector3d::UnitX()}, outside{{-2, 0.02, 0.03}, Vector3d::UnitX()};
  EXPECT_EQ(body.first_along(outside), kInfinity);
  EXPECT_FALSE(body.contains(within.p));
  for (std::size_t k = 0; k < shapes.size(); ++k) body.set_present(k, true);
  EXPECT_TRUE(body.contains(within.p));
  EXPECT_NEAR(body.first_along(within), 0.4, 0.05);
  EXPECT_NEAR(body.first_along(outside), 2 - 0.4, 0.05);
}

}  // namespace
}  // namespace cotwin::collision::ray_test
