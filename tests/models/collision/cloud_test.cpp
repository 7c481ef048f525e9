// The distance of bodies from clouds, in closed form, against each point, and against spheres in the place of points.
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "models/collision/body.h"
#include "models/scene/hull.h"
#include "models/scene/mesh.h"
#include "tests/models/collision/random_shapes.h"
#include "tests/support/allocations.h"

namespace cotwin::collision::cloud_test {
namespace {

using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

std::shared_ptr<const cloud::Tree> tree_of(const std::vector<Vector3d>& points) {
  return std::make_shared<cloud::Tree>(cloud::make_cloud(points));
}

/// On a table, a wall and a ball, as a scanner sees them.
std::vector<Vector3d> cell(std::size_t n, Random& random) {
  std::vector<Vector3d> points;
  while (points.size() < n) {
    const std::size_t k = points.size() % 3;
    points.push_back(k == 0   ? Vector3d(random.real(-1, 1), random.real(-1, 1), 0)
                     : k == 1 ? Vector3d(1, random.real(-1, 1), random.real(0, 1))
                              : Vector3d(0.3, 0.4, 0.5) + 0.2 * random.direction());
  }
  return points;
}

/// The signed distance of a point from the triangles of a hull, of which it may be inside.
double from_hull(const scene::Polytope& hull, const Vector3d& p) {
  double most = -scene::kInfinity, least = scene::kInfinity;
  for (const scene::Polytope::Face& face : hull.faces) {
    most = std::max(most, face.n.dot(p) - face.d);
    for (std::uint32_t k = 1; k + 1 < face.count; ++k) {  // the nearest point of a triangle [Ericson 2005, 5.1.5], by its edges
      const Vector3d &a = hull.vertices[hull.corners[face.begin]], &b = hull.vertices[hull.corners[face.begin + k]],
                     &c = hull.vertices[hull.corners[face.begin + k + 1]];
      const Vector3d n = (b - a).cross(c - a).normalized(), foot = p - n * n.dot(p - a);
      bool within = true;
      for (const auto& [from, to] : {std::pair{a, b}, {b, c}, {c, a}}) {
        within = within && (to - from).cross(foot - from).dot(n) >= 0;
        const Vector3d along = to - from;
        least = std::min(least, (p - from - along * std::clamp((p - from).dot(along) / along.squaredNorm(), 0.0, 1.0)).norm());
      }
      if (within) least = std::min(least, std::abs(n.dot(p - a)));
    }
  }
  return most <= 0 ? most : least;
}

TEST(Clouds, HaveTheLeastDistanceOfTheirPoints) {
  Random random(1);
  constexpr double kBall = 0.004;
  const auto tree = tree_of(cell(100'000, random));
  const Body cloud(tree, kBall);
  Finder finder;
  for (int k = 0; k < 18; ++k) {
    Shape own = shape(ShapeType::kCapsule, {random.real(0.02, 0.1), random.real(0.1, 0.5), 0});
    const double r = own.size.x(), half = own.size.y() / 2;
    std::function<double(const Vector3d&)> from = [=](const Vector3d& p) {
      return (p - Vector3d(0, 0, std::clamp(p.z(), -half, half))).norm() - r;
    };
    if (k % 3 == 1) {
      own.type = ShapeType::kCylinder;
      from = [=](const Vector3d& p) {
        const double across = std::hypot(p.x(), p.y()) - r, along = std::abs(p.z()) - half;
        return across > 0 && along > 0 ? std::hypot(across, along) : std::max(across, along);
      };
    } else if (k % 3 == 2) {
      own = shape(ShapeType::kHull, Vector3d::Zero());
      for (int i = 0; i < 20; ++i) own.vertices.push_back(0.2 * random.direction());
      from = [hull = scene::convex_hull(own.vertices)](const Vector3d& p) { return from_hull(hull, p); };
    }
    const Body body(std::span(&own, 1));
    finder.reserve(body);
    finder.reserve(cloud);
    const Pose X_b = random.pose(k % 2 == 0 ? 0.5 : 2), X_c = random.pose(0.3);
    double least = scene::kInfinity;
    for (std::size_t i = 0; i < tree->cloud().points.size(); ++i)
      least = std::min(least, from(X_b.inverse() * (X_c * tree->cloud().point(i))) - kBall);
    const std::uint64_t before = cotwin::testing::allocations();
    const Distance found = finder.find(body, X_b, cloud, X_c), back = finder.find(cloud, X_c, body, X_b);
    const Distance bounded = finder.find(body, X_b, cloud, X_c, found.d),
                   too_far = finder.find(body, X_b, cloud, X_c, found.d - 1e-9);
    EXPECT_EQ(cotwin::testing::allocations(), before);
    EXPECT_NEAR(found.d, least, 1e-12) << k;
    EXPECT_EQ(back.d, found.d);
    EXPECT_EQ(back.p_a, found.p_b);
    EXPECT_EQ(back.n, -found.n);
    EXPECT_EQ(bounded.d, found.d);
    EXPECT_EQ(bounded.p_b, found.p_b);
    EXPECT_EQ(too_far.d, scene::kInfinity);
    EXPECT_NEAR(from(X_b.inverse() * found.p_a), 0, 1e-9);
    EXPECT_LT((found.p_a + found.d * found.n - found.p_b).norm(), 1e-12);
  }
}

/// A torus of triangles, closed.
std::vector<Shape> torus(int rows, int columns) {
  scene::Mesh mesh;
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < columns; ++k) {
      const double a = -2 * std::numbers::pi * i / rows, b = 2 * std::numbers::pi * k / columns, r = 0.6 + 0.2 * std::cos(b);
      mesh.vertices.emplace_back(r * std::cos(a), r * std::sin(a), 0.2 * std::sin(b));
    }
  const auto at = [&](int i, int k) { return static_cast<std::uint32_t>(i % rows * columns + k % columns); };
  for (int i = 0; i < rows; ++i)
    for (int k = 0; k < columns; ++k) {
      mesh.triangles.push_back({at(i, k), at(i + 1, k), at(i + 1, k + 1)});
      mesh.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i, k + 1)});
    }
  return scene::triangle_shapes(mesh, std::vector<double>(mesh.triangles.size(), 0.1));
}

/// All kinds of shapes, among them a tool that is absent half of the time.
std::vector<Shape> arm(Random& random) {
  std::vector<Shape> shapes{shape(ShapeType::kCapsule, {0.03, 0.1, 0}), shape(ShapeType::kBox, {0.1, 0.2, 0.3}),
                            shape(ShapeType::kCylinder, {0.05, 0.2, 0}), shape(ShapeType::kEllipsoid, {0.1, 0.05, 0.2}),
                            shape(ShapeType::kSphere, {0.1, 0, 0})};
  for (Shape& one : shapes) one.X_BS = random.pose(0.5);
  shapes.back().tool = "ball";
  return shapes;
}

// Also where points are wholly inside of a closed mesh, and with surfaces that are not closed.
TEST(Clouds, AreLikeASphereForEachPoint) {
  Random random(2);
  std::vector<Shape> open = torus(12, 8);
  open.pop_back();
  int inside = 0, touching = 0;
  for (int k = 0; k < 120; ++k) {
    const double ball = k % 4 == 0 ? 0 : 0.01;
    const bool few = k % 8 >= 4;
    std::vector<Vector3d> points;
    const Vector3d middle = few ? Vector3d(0.6, 0, 0) : Vector3d(0, 0, 0);
    for (int i = 0; i < (few ? 3 : 60); ++i) points.push_back(middle + random.vector(few ? 0.15 : 1));
    const auto tree = tree_of(points);
    std::vector<Shape> spheres;
    for (std::size_t i = 0; i < points.size(); ++i) {
      spheres.push_back(shape(ShapeType::kSphere, {std::max(ball, 1e-12), 0, 0}));
      spheres.back().X_BS.p = tree->cloud().point(i);
    }
    // The distance from several meshes and shapes is the least one.
    std::vector<std::vector<Shape>> parts{k % 4 == 0 ? arm(random) : k % 4 == 2 ? open : torus(12, 8)};
    if (k % 4 == 3) parts.push_back(arm(random));
    std::vector<Shape> shapes;
    for (const std::vector<Shape>& part : parts) shapes.insert(shapes.end(), part.begin(), part.end());
    Body body(shapes), cloud(tree, ball);
    if (k % 4 == 0 && k % 3 == 0) body.set_present(4, true);
    Finder finder;
    for (const Body* one : {&body, &cloud}) finder.reserve(*one);
    const Pose X_b{random.pose(0).R, few ? Vector3d(0, 0, 0) : random.vector(k % 5 == 0 ? 3 : 0.4)};
    const Pose X_c = few ? Pose{X_b.R, Vector3d(0, 0, 0)} : random.pose(0.2);
    const Distance found = finder.find(body, X_b, cloud, X_c);
    Distance expected;
    for (const Shape& sphere : spheres) {
      const Body bead(std::span(&sphere, 1));
      for (const std::vector<Shape>& part : parts) {
        const Distance one = finder.find(parts.size() == 1 ? body : Body(part), X_b, bead, X_c);
        if (one.d < expected.d) expected = one;
      }
    }
    ASSERT_NEAR(found.d, expected.d, 1e-9) << k;
    EXPECT_NEAR((found.p_a - expected.p_a).norm(), 0, 1e-6) << k;
    EXPECT_NEAR(finder.find(cloud, X_c, body, X_b, found.d + 1e-9).d, expected.d, 1e-9);
    EXPECT_EQ(finder.find(body, X_b, cloud, X_c, found.d - 1e-6).d, scene::kInfinity);
    touching += found.d <= 0 ? 1 : 0;
    for (std::size_t i = 0; i < points.size(); ++i)
      inside += body.contains(X_b.inverse() * (X_c * tree->cloud().point(i))) ? 1 : 0;
    std::vector<char> near(points.size(), 0);
    constexpr double kMargin = 0.05;
    finder.find_near(body, X_b, cloud, X_c, kMargin, near);
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Body bead(std::span(&spheres[i], 1));
      EXPECT_EQ(near[i] != 0, finder.find(body, X_b, bead, X_c).d <= kMargin) << k;
    }
  }
  EXPECT_GT(inside, 50);
  EXPECT_GT(touching, 25);
}

TEST(Clouds, OfAPlaneHaveTheDistanceOfTheNextPoints) {
  constexpr double kSpacing = 0.02, kBall = 0.003, kRadius = 0.1, kHeight = 0.25;
  std::vector<Vector3d> points;
  for (int i = -50; i <= 50; ++i)
    for (int k = -50; k <= 50; ++k) points.emplace_back(kSpacing * i, kSpacing * k, 0);
  const auto tree = tree_of(points);
  const Body ball(std::vector{shape(ShapeType::kSphere, {kRadius, 0, 0})});
  Body cloud(tree, kBall);
  Finder finder;
  finder.reserve(cloud);
  const auto at = [=](double x, double y) { return Pose{Eigen::Matrix3d::Identity(), {x, y, kHeight}}; };
  EXPECT_NEAR(finder.find(ball, at(0.1, -0.2), cloud, {}).d, kHeight - kRadius - kBall, 1e-8);
  const double beside = std::hypot(kHeight, kSpacing / std::numbers::sqrt2);
  EXPECT_NEAR(finder.find(ball, at(0.11, -0.21), cloud, {}).d, beside - kRadius - kBall, 1e-8);
  cloud.set_ball(0.05);
  EXPECT_NEAR(finder.find(ball, at(0.11, -0.21), cloud, {}).d, beside - kRadius - 0.05, 1e-8);
  EXPECT_NEAR(cloud.radius(), std::numbers::sqrt2 + 0.05, 1e-6);
  EXPECT_NEAR(finder.find(Body(std::vector{shape(ShapeType::kPlane, Vector3d::Zero())}), {}, cloud, at(0, 0)).d, kHeight - 0.05,
              1e-8);
  EXPECT_EQ(finder.find(cloud, {}, cloud, at(0, 0)).d, scene::kInfinity);
  EXPECT_FALSE(cloud.empty());
}

TEST(Clouds, HaveNoInside) {
  std::vector<Vector3d> points;
  for (int i = 0; i < 5000; ++i) {  // a sphere of radius 1 [Fibonacci's lattice]
    const double z = 1 - (2 * i + 1) / 5000.0, a = std::numbers::pi * (3 - std::sqrt(5.0)) * i;
    points.emplace_back(std::sqrt(1 - z * z) * std::cos(a), std::sqrt(1 - z * z) * std::sin(a), z);
  }
  const Body cloud(tree_of(points), 0.05), ball(std::vector{shape(ShapeType::kSphere, {0.2, 0, 0})});
  Finder finder;
  finder.reserve(cloud);
  EXPECT_NEAR(finder.find(ball, {}, cloud, {}).d, 1 - 0.2 - 0.05, 1e-7);
}

TEST(Clouds, FarAwayOrOfOnePointAreAsNear) {
  const Vector3d far(1e6, -512345.25, 99);
  Random random(4);
  std::vector<Vector3d> points = cell(3000, random), there;
  for (const Vector3d& p : points) there.push_back(p + far);
  const auto near_tree = tree_of(points), far_tree = tree_of(there);
  const Body body(arm(random)), one(near_tree, 0.01), other(far_tree, 0.01);
  const Body single(tree_of(std::vector<Vector3d>(7, Vector3d(1, 2, 3))), 0.5);
  Finder finder;
  for (const Body* each : {&body, &one, &other}) finder.reserve(*each);
  for (int k = 0; k < 50; ++k) {
    const Pose X = random.pose(1);
    const Distance found = finder.find(body, X, one, {}), found_far = finder.find(body, {X.R, X.p + far}, other, {});
    EXPECT_NEAR(found_far.d, found.d, 3e-7);
    EXPECT_NEAR(finder.find(body, X, other, {Eigen::Matrix3d::Identity(), -far}).d, found.d, 3e-7);
    const Body ball(std::vector{shape(ShapeType::kSphere, {0.25, 0, 0})});
    EXPECT_NEAR(finder.find(ball, X, single, {}).d, (X.p - Vector3d(1, 2, 3)).norm() - 0.75, 1e-12);
  }
}

}  // namespace
}  // namespace cotwin::collision::cloud_test
