// What is inside closed meshes, against winding numbers and the nearest triangle; surfaces without solid from both sides.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "models/collision/body.h"
#include "models/scene/mesh.h"
#include "tests/models/collision/meshes.h"
#include "tests/support/allocations.h"

namespace cotwin::collision::inside_test {
namespace {

using Eigen::Vector3d;
using scene::Mesh;
using scene::Shape;
using scene::ShapeType;

std::mt19937_64 random_engine{7};
double real(double low, double high) { return std::uniform_real_distribution<double>(low, high)(random_engine); }
Vector3d within(const Vector3d& half) {
  return {real(-half.x(), half.x()), real(-half.y(), half.y()), real(-half.z(), half.z())};
}

/// The winding number of a mesh around a point, by the solid angles of its triangles [van Oosterom, Strackee 1983].
double winding(const Mesh& mesh, const Vector3d& p) {
  double sum = 0;
  for (const auto& t : mesh.triangles) {
    const Vector3d a = mesh.vertices[t[0]] - p, b = mesh.vertices[t[1]] - p, c = mesh.vertices[t[2]] - p;
    const double x = a.norm(), y = b.norm(), z = c.norm();
    sum += 2 * std::atan2(a.dot(b.cross(c)), x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y);
  }
  return sum / (4 * std::numbers::pi);
}

/// The distance of a point from a triangle: from its plane, or from its edges.
double from_triangle(const Vector3d& p, const std::array<Vector3d, 3>& t) {
  const Vector3d n = (t[1] - t[0]).cross(t[2] - t[0]).normalized();
  double least = scene::kInfinity;
  bool above = true;
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d along = t[(k + 1) % 3] - t[k], way = p - t[k];
    above = above && along.cross(way).dot(n) >= 0;
    least = std::min(least, (way - std::clamp(way.dot(along) / along.squaredNorm(), 0.0, 1.0) * along).norm());
  }
  return above ? std::abs(n.dot(p - t[0])) : least;
}

double from_surface(const Mesh& mesh, const Vector3d& p) {
  double least = scene::kInfinity;
  for (const auto& t : mesh.triangles)
    least = std::min(least, from_triangle(p, {mesh.vertices[t[0]], mesh.vertices[t[1]], mesh.vertices[t[2]]}));
  return least;
}

void add(Mesh& mesh, const Mesh& other, bool turned) {
  const auto first = static_cast<std::uint32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), other.vertices.begin(), other.vertices.end());
  for (auto t : other.triangles) {
    if (turned) std::swap(t[1], t[2]);
    mesh.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
}

/// 2 × 2 × 2 with a dent on top, in the middle: a pyramid down to z = −0.5.
Mesh dented() {
  Mesh mesh;
  for (const double z : {-1.0, 1.0})
    for (const auto& [x, y] : {std::pair{-1.0, -1.0}, {1.0, -1.0}, {1.0, 1.0}, {-1.0, 1.0}})
      mesh.vertices.emplace_back(x, y, z);
  mesh.vertices.emplace_back(0, 0, -0.5);
  mesh.triangles = {{0, 2, 1}, {0, 3, 2}, {4, 5, 8}, {5, 6, 8}, {6, 7, 8}, {7, 4, 8}};
  for (std::uint32_t k = 0; k < 4; ++k) {
    const std::uint32_t next = (k + 1) % 4;
    mesh.triangles.push_back({k, next, next + 4});
    mesh.triangles.push_back({k, next + 4, k + 4});
  }
  return mesh;
}

Shape shape(ShapeType type, const Vector3d& size, const Vector3d& p = Vector3d::Zero()) {
  Shape s;
  s.type = type;
  s.size = size;
  s.X_BS.p = p;
  return s;
}

/// The distance of a ball from a mesh, both as they are.
Distance from_ball(const std::vector<Shape>& mesh, const Vector3d& p, double r = 0) {
  const Body solid(mesh), ball(std::vector{shape(ShapeType::kSphere, {r, 0, 0})});
  Finder finder;
  finder.reserve(solid);
  finder.reserve(ball);
  return finder.find(solid, {}, ball, {Eigen::Matrix3d::Identity(), p});
}

TEST(ClosedMeshes, HaveTheInsideOfTheirWindingNumber) {
  Mesh hollow = bumps(12, 16, 0.9, 0.1);  // its cavity faces inwards
  add(hollow, bumps(8, 12, 0.5, 0.15), true);
  const std::vector<Mesh> meshes{dented(), hollow, torus(24, 12), bumps(30, 40, 0.8, 0.3), torus(200, 50)};
  int inside = 0;
  for (std::size_t m = 0; m < meshes.size(); ++m) {
    const Mesh& mesh = meshes[m];
    const Body solid(shapes_of(mesh)), dot(std::vector{shape(ShapeType::kSphere, Vector3d::Zero())});
    EXPECT_FALSE(solid.open());
    Finder finder;
    finder.reserve(solid);
    finder.reserve(dot);
    Vector3d half = Vector3d::Zero();
    for (const Vector3d& v : mesh.vertices) half = half.cwiseMax(v.cwiseAbs());
    for (int k = 0; k < (mesh.triangles.size() > 10000 ? 100 : 2475); ++k) {
      Vector3d p = within(1.1 * half);
      if (k % 10 == 0) p = 0.7 * mesh.vertices[static_cast<std::size_t>(k) % mesh.vertices.size()];  // rays through edges
      const double around = winding(mesh, p), d = from_surface(mesh, p);
      if (d < 1e-9) continue;
      const Pose X_W{Eigen::AngleAxisd(k, Vector3d(1, 2, 2) / 3).toRotationMatrix(), {0.3 * k, 0, 1}};
      const std::uint64_t before = cotwin::testing::allocations();
      const Distance found = finder.find(solid, X_W, dot, X_W * Pose{Eigen::Matrix3d::Identity(), p});
      const Distance back = finder.find(dot, X_W * Pose{Eigen::Matrix3d::Identity(), p}, solid, X_W, found.d + 1e-9);
      EXPECT_EQ(cotwin::testing::allocations(), before);
      const bool is_inside = std::abs(around) > 0.5;
      inside += is_inside ? 1 : 0;
      ASSERT_NEAR(found.d, is_inside ? -d : d, 1e-9 * (1 + 0.3 * k)) << "mesh " << m << " at " << p.transpose();
      ASSERT_NEAR(back.d, found.d, 1e-9 * (1 + 0.3 * k));
      EXPECT_LT((back.n + found.n).norm(), 1e-6);
      EXPECT_LT((found.p_a + found.d * found.n - found.p_b).norm(), 1e-9 * (1 + 0.3 * k));
      EXPECT_NEAR(from_surface(mesh, X_W.inverse() * found.p_a), 0, 1e-9 * (1 + 0.3 * k)) << "on the surface";
    }
  }
  EXPECT_GT(inside, 2000);
}

// Of a body the whole has to come out: along the shortest way of its nearest point.
TEST(ClosedMeshes, AreLeftByTheDepthOfTheBody) {
  const Body block(shapes_of(dented()));
  Finder finder;
  finder.reserve(block);
  const auto distance_of = [&](const std::vector<Shape>& shapes, const Vector3d& p) {
    const Body body(shapes);
    finder.reserve(body);
    const Pose X{Eigen::Matrix3d::Identity(), p};
    const Distance there = finder.find(block, {}, body, X), back = finder.find(body, X, block, {});
    EXPECT_NEAR(there.d, back.d, 1e-12);
    if (there.d < 0 && shapes.size() == 1) {
      const Pose out{X.R, X.p - there.d * there.n};
      EXPECT_NEAR(finder.find(block, {}, body, out).d, 0, 1e-9) << "moved so far it only touches";
    }
    return there;
  };
  const Distance box = distance_of({shape(ShapeType::kBox, {0.2, 0.1, 0.1})}, {0.7, 0.1, -0.7});
  EXPECT_NEAR(box.d, -(0.2 + 0.2), 1e-12);
  EXPECT_LT((box.n - Vector3d::UnitX()).norm(), 1e-9);
  EXPECT_NEAR(distance_of({shape(ShapeType::kCapsule, {0.1, 0.4, 0})}, {-0.6, 0, -0.6}).d, -0.7, 1e-12);
  // What crosses the surface leaves the solid behind it; what is outside, in the dent, is apart.
  EXPECT_NEAR(distance_of({shape(ShapeType::kSphere, {0.1, 0, 0})}, {0.93, 0.5, -0.5}).d, -0.17, 1e-9);
  EXPECT_NEAR(distance_of({shape(ShapeType::kSphere, {0.1, 0, 0})}, {0, 0, 0.5}).d, 1 / std::hypot(1, 1.5) - 0.1, 1e-9);
  // One of two pieces is inside.
  EXPECT_NEAR(
      distance_of({shape(ShapeType::kSphere, {0.1, 0, 0}), shape(ShapeType::kSphere, {0.1, 0, 0}, {2, 0, 0})}, {0.7, 0, -0.6})
          .d,
      -0.4, 1e-12);
  // A mesh inside a mesh.
  Mesh small = dented();
  for (Vector3d& v : small.vertices) v *= 0.1;
  EXPECT_NEAR(distance_of(shapes_of(small), {0.7, 0, -0.75}).d, -(0.15 + 0.2), 1e-9);
  // Nothing is too far for it, and nothing too deep is told where less is asked for.
  const Body deep(std::vector{shape(ShapeType::kSphere, {0.01, 0, 0})});
  finder.reserve(deep);
  const Pose X{Eigen::Matrix3d::Identity(), {0, 0, -0.75}};
  EXPECT_NEAR(finder.find(block, {}, deep, X, 0.0).d, -0.26, 1e-12);
  EXPECT_EQ(finder.find(block, {}, deep, X, -0.9).d, scene::kInfinity);
}

TEST(ClosedMeshes, MayBeNestedTurnedOrDoubled) {
  const Vector3d inside(0.7, 0.1, -0.7), outside(0, 0, 0.5);
  const auto is_inside = [](const Mesh& mesh, const Vector3d& p) { return from_ball(shapes_of(mesh), p).d < 0; };
  Mesh turned = dented();
  std::swap(turned.triangles[5][1], turned.triangles[5][2]);  // one of them
  Mesh all_turned;
  add(all_turned, dented(), true);
  Mesh doubled = dented(), both_sides = dented(), nested = dented();
  add(doubled, dented(), false);
  add(both_sides, dented(), true);
  Mesh small = dented();
  for (Vector3d& v : small.vertices) v = 0.2 * v + inside;
  add(nested, small, false);
  for (const Mesh& mesh : {turned, all_turned, doubled, nested}) {
    EXPECT_TRUE(is_inside(mesh, inside));
    EXPECT_FALSE(is_inside(mesh, outside));
    EXPECT_FALSE(is_inside(mesh, {1.5, 0, 0}));
  }
  EXPECT_FALSE(is_inside(both_sides, inside)) << "both sides of a surface enclose nothing";
  // Two that overlap, in one body; the second one beside a shape of another kind.
  std::vector<Shape> pair = shapes_of(dented());
  for (Shape one : shapes_of(dented())) {
    one.X_BS.p = {0.5, 0, 0};
    pair.push_back(one);
  }
  pair.push_back(shape(ShapeType::kBox, {1, 1, 1}, {5, 0, 0}));
  EXPECT_LT(from_ball(pair, inside).d, 0);
  EXPECT_LT(from_ball(pair, {1.2, 0, -0.7}).d, 0);
  EXPECT_NEAR(from_ball(pair, {2, 0, -0.7}).d, 0.5, 1e-12);
}

TEST(OpenMeshes, HaveNoSolidBehindThem) {
  // A sheet in the plane x = 0.5, of 2 m.
  Mesh sheet;
  sheet.vertices = {{0.5, -1, -1}, {0.5, 1, -1}, {0.5, 1, 1}, {0.5, -1, 1}};
  sheet.triangles = {{0, 1, 2}, {0, 2, 3}};
  for (const bool turned : {false, true}) {
    Mesh mesh;
    add(mesh, sheet, turned);
    EXPECT_TRUE(Body(shapes_of(mesh)).open());
    for (int k = 0; k < 200; ++k) {
      const Vector3d p = within({1.5, 1.5, 1.5});
      const double r = real(0.01, 0.2), apart = from_surface(mesh, p) - r;
      if (apart > 0) EXPECT_NEAR(from_ball(shapes_of(mesh), p, r).d, apart, 1e-9);
      if (apart < 0) EXPECT_NEAR(from_ball(shapes_of(mesh), p, r).d, apart, 0.2) << "the way out";
      EXPECT_EQ(from_ball(shapes_of(mesh), p, r).d < 0, apart < 0);
    }
    // In its plane, beside it.
    EXPECT_NEAR(from_ball(shapes_of(mesh), {0.5, 1.4, 0.3}, 0.1).d, 0.3, 1e-12);
    EXPECT_NEAR(from_ball(shapes_of(mesh), {0.5, 1.3, 1.4}, 0.1).d, 0.4, 1e-12);
    EXPECT_NEAR(from_ball(shapes_of(mesh), {0.5, 0.2, 0.3}, 0.1).d, -0.1, 1e-12);
    // Capsules and boxes, against the nearest of a fine row of points.
    for (int k = 0; k < 100; ++k) {
      const Pose X{Eigen::AngleAxisd(real(0, 6), within({1, 1, 1}).normalized()).toRotationMatrix(), within({1.5, 1.5, 1.5})};
      const Body capsule(std::vector{shape(ShapeType::kCapsule, {0.1, 0.6, 0})}), solid(shapes_of(mesh));
      const Body box(std::vector{shape(ShapeType::kBox, {0.3, 0.3, 0.3})});
      Finder finder;
      for (const Body* one : {&capsule, &solid, &box}) finder.reserve(*one);
      double least = scene::kInfinity;
      for (int i = 0; i <= 600; ++i) least = std::min(least, from_surface(mesh, X * Vector3d(0, 0, -0.3 + i / 1000.0)));
      const Distance found = finder.find(solid, {}, capsule, X);
      if (least > 0.1) EXPECT_NEAR(found.d, least - 0.1, 1e-6);
      if (found.d > 1e-6) EXPECT_LT(least - 0.1, found.d + 1e-6);
      const Distance of_box = finder.find(solid, {}, box, X);
      if (!(of_box.d > 0)) continue;
      EXPECT_NEAR(from_surface(mesh, of_box.p_a), 0, 1e-9);
      EXPECT_NEAR(((X.inverse() * of_box.p_b).cwiseAbs() - Vector3d::Constant(0.15)).maxCoeff(), 0, 1e-9);
      EXPECT_GE((X.R.transpose() * of_box.n).dot(X.inverse() * X.p - X.inverse() * of_box.p_b), 0);
    }
  }
  // A hole of one triangle: there is no inside.
  Mesh hole = dented();
  hole.triangles.erase(hole.triangles.begin() + 3);
  EXPECT_TRUE(Body(shapes_of(hole)).open());
  EXPECT_GT(from_ball(shapes_of(hole), {0.7, 0.1, -0.7}).d, 0);
}

}  // namespace
}  // namespace cotwin::collision::inside_test
