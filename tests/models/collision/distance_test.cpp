// Distances of convex shapes against closed forms and an independent quadratic program; bodies of many shapes against all their pairs.
#include "models/collision/body.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "models/collision/separation.h"
#include "models/foundation/support/error.h"
#include "models/scene/hull.h"
#include "models/scene/shapes.h"
#include "tests/models/collision/random_shapes.h"
#include "tests/support/allocations.h"

namespace cotwin::collision::distance_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

Shape hull(std::vector<Vector3d> vertices) {
  Shape s = shape(ShapeType::kHull, Vector3d::Zero());
  s.vertices = std::move(vertices);
  return s;
}

Shape random_hull(Random& random, double size) {
  std::vector<Vector3d> points;
  const Vector3d shares(random.real(0.2, 1), random.real(0.2, 1), random.real(0.2, 1));
  const int count = 4 + static_cast<int>(random.real(0, 30));
  for (int k = 0; k < count; ++k) points.push_back(size * shares.cwiseProduct(random.direction()) * random.real(0.5, 1));
  return hull(points);
}

Placed place(const Convex& convex, const Pose& X_WB) { return {&convex, X_WB.R * convex.X_BC.R, X_WB * convex.X_BC.p}; }

Distance measure(const Shape& a, const Pose& X_a, const Shape& b, const Pose& X_b) {
  const Convex A = make_convex(a), B = make_convex(b);
  Feature scratch;
  const Distance found = distance(place(A, X_a), place(B, X_b), scratch);
  EXPECT_NEAR(found.n.norm(), 1, 1e-12);
  EXPECT_LT((found.p_a + found.d * found.n - found.p_b).norm(), 1e-12 * (1 + found.p_b.norm()));
  return found;
}

/// The same from both sides, and with the whole world at another pose.
void expect_distance(const Shape& a, const Pose& X_a, const Shape& b, const Pose& X_b, double d, Random& random) {
  const double rounding = 1e-12 * (1 + std::abs(d));
  const Distance there = measure(a, X_a, b, X_b), back = measure(b, X_b, a, X_a);
  EXPECT_NEAR(there.d, d, rounding);
  EXPECT_NEAR(back.d, d, rounding);
  const Pose X = random.pose(1);
  EXPECT_NEAR(measure(a, X * X_a, b, X * X_b).d, d, 4 * rounding);
}

TEST(Distance, OfSpheresBoxesAndCapsulesIsTheirClosedForm) {
  Random random(1);
  for (int k = 0; k < 300; ++k) {
    const double r = random.real(0.01, 0.3), s = random.real(0.01, 0.3), l = random.real(0.01, 1);
    const Shape ball = shape(ShapeType::kSphere, {r, 0, 0}), other = shape(ShapeType::kSphere, {s, 0, 0});
    const Shape capsule = shape(ShapeType::kCapsule, {s, l, 0});
    const Vector3d edges(random.real(0.02, 1), random.real(0.02, 1), random.real(0.02, 1));
    const Shape box = shape(ShapeType::kBox, edges);
    const Pose at{Matrix3d::Identity(), random.vector(1)};
    const Vector3d p = at.p;
    expect_distance(ball, at, other, {}, p.norm() - r - s, random);
    const Vector3d beyond = p.cwiseAbs() - edges / 2;
    expect_distance(ball, at, box, {}, (beyond.maxCoeff() > 0 ? beyond.cwiseMax(0).norm() : beyond.maxCoeff()) - r, random);
    const Vector3d on_axis(0, 0, std::clamp(p.z(), -l / 2, l / 2));
    expect_distance(ball, at, capsule, {}, (p - on_axis).norm() - r - s, random);
    // Capsules that are parallel, and crossed.
    const Shape second = shape(ShapeType::kCapsule, {r, l, 0});
    const double along = std::max(std::abs(p.z()) - l, 0.0);
    expect_distance(second, at, capsule, {}, std::hypot(std::hypot(p.x(), p.y()), along) - r - s, random);
    const Pose crossed{Eigen::AngleAxisd(M_PI / 2, Vector3d::UnitX()).toRotationMatrix(), p};
    const double y = std::max(std::abs(p.y()) - l / 2, 0.0), z = std::max(std::abs(p.z()) - l / 2, 0.0);
    if (std::hypot(p.x(), std::hypot(y, z)) > 1e-6)
      expect_distance(second, crossed, capsule, {}, std::hypot(p.x(), std::hypot(y, z)) - r - s, random);
    // Boxes with the same axes.
    const Vector3d apart = p.cwiseAbs() - (edges + Vector3d::Constant(r)) / 2;
    expect_distance(shape(ShapeType::kBox, Vector3d::Constant(r)), at, box, {},
                    apart.maxCoeff() > 0 ? apart.cwiseMax(0).norm() : apart.maxCoeff(), random);
    // A plane below everything.
    expect_distance(shape(ShapeType::kPlane, Vector3d::Zero()), {}, capsule, at, p.z() - l / 2 - s, random);
  }
}

/// The point of the convex hull of {a - b} that is nearest to the origin, by Wolfe's algorithm (Finding the nearest point in a polytope, 1976).
double least_norm(const std::vector<Vector3d>& a, const std::vector<Vector3d>& b) {
  const auto farthest = [&](const Vector3d& d) -> Vector3d {
    const auto along = [&](const Vector3d& p, const Vector3d& q) { return p.dot(d) < q.dot(d); };
    return *std::ranges::max_element(a, along) - *std::ranges::min_element(b, along);
  };
  std::vector<Vector3d> corral{a[0] - b[0]};
  std::vector<double> weights{1};
  Vector3d x = corral[0];
  for (int round = 0; round < 200; ++round) {
    const Vector3d p = farthest(-x);
    if (x.squaredNorm() - x.dot(p) <= 1e-14 * (1 + x.squaredNorm())) break;
    corral.push_back(p);
    weights.push_back(0);
    while (true) {
      // Weights of the affine hull's point nearest to the origin.
      const auto n = static_cast<Eigen::Index>(corral.size());
      Eigen::MatrixXd K = Eigen::MatrixXd::Ones(n + 1, n + 1);
      K(n, n) = 0;
      for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j < n; ++j)
          K(i, j) = corral[static_cast<std::size_t>(i)].dot(corral[static_cast<std::size_t>(j)]);
      }
      const Eigen::VectorXd w = K.completeOrthogonalDecomposition().solve(Eigen::VectorXd::Unit(n + 1, n));
      double share = 1;
      for (std::size_t i = 0; i < corral.size(); ++i) {
        const double to = w[static_cast<Eigen::Index>(i)];
        if (to < 1e-12 && weights[i] > to) share = std::min(share, weights[i] / (weights[i] - to));
      }
      for (std::size_t i = 0; i < corral.size(); ++i) weights[i] += share * (w[static_cast<Eigen::Index>(i)] - weights[i]);
      for (std::size_t i = corral.size(); i-- > 0 && share < 1;) {
        if (weights[i] > 1e-12) continue;
        weights.erase(weights.begin() + static_cast<std::ptrdiff_t>(i));
        corral.erase(corral.begin() + static_cast<std::ptrdiff_t>(i));
      }
      if (share >= 1 || corral.size() <= 1) break;
    }
    x.setZero();
    for (std::size_t i = 0; i < corral.size(); ++i) x += weights[i] * corral[i];
  }
  return x.norm();
}

TEST(Distance, OfTenThousandPairsOfHullsIsThatOfAQuadraticProgram) {
  Random random(2);
  int separated = 0;
  for (int k = 0; k < 10000; ++k) {
    const double size = k % 10 == 0 ? 1e-3 : k % 10 == 1 ? 100 : 1;
    const Shape a = random_hull(random, size), b = random_hull(random, size * (k % 3 == 0 ? 0.05 : 1));
    const Pose X_a = random.pose(0.3 * size);
    Pose X_b = random.pose(1.6 * size);
    if (k % 4 == 0) X_b.p += X_a.p;
    std::vector<Vector3d> points_a, points_b;
    for (const Vector3d& v : a.vertices) points_a.push_back((X_a * v) / size);
    for (const Vector3d& v : b.vertices) points_b.push_back((X_b * v) / size);
    const double exact = least_norm(points_a, points_b);
    const Distance found = measure(a, X_a, b, X_b);
    if (exact < 1e-6) {
      EXPECT_LT(found.d, 1e-5 * size) << k;
      continue;
    }
    ++separated;
    ASSERT_NEAR(found.d / size, exact, 1e-9) << "case " << k;
  }
  EXPECT_GT(separated, 6000);
}

double outside(const Shape& s, const Pose& X_WB, const Vector3d& p_W) {
  Feature scratch;
  const Convex ball = make_convex(shape(ShapeType::kSphere, Vector3d::Zero())), body = make_convex(s);
  return distance(place(ball, {Matrix3d::Identity(), p_W}), place(body, X_WB), scratch).d;
}

// The nearest points are on both surfaces, so that d is an upper bound; that no plane between them leaves more room makes it a lower one.
TEST(Distance, OfEachPairOfShapesIsHeldByTwoPointsAndAPlane) {
  Random random(3);
  const auto random_shape = [&](int kind) {
    const double r = random.real(0.05, 0.3), l = random.real(0.05, 0.6);
    if (kind == 0) return shape(ShapeType::kCapsule, {r, l, 0});
    if (kind == 1) return shape(ShapeType::kCylinder, {r, l, 0});
    if (kind == 2) return shape(ShapeType::kBox, {r, l, 0.2});
    if (kind == 3) return shape(ShapeType::kEllipsoid, {r, l, 0.2});
    return random_hull(random, 0.3);
  };
  for (int k = 0; k < 2000; ++k) {
    const Shape a = random_shape(k % 5), b = random_shape(k / 5 % 5);
    const Pose X_a = random.pose(0.2), X_b = random.pose(1.5);
    const Distance found = measure(a, X_a, b, X_b);
    if (found.d <= 1e-6) continue;
    SCOPED_TRACE(k);
    EXPECT_NEAR(outside(a, X_a, found.p_a), 0, 1e-6);
    EXPECT_NEAR(outside(b, X_b, found.p_b), 0, 1e-6);
    const Convex A = make_convex(a), B = make_convex(b);
    EXPECT_NEAR(gap_along(place(A, X_a), place(B, X_b), found.n) - A.round - B.round, found.d, 1e-9);
  }
}

// The direction is then a difference of almost equal points: the nearest points are still on both surfaces.
TEST(Distance, IsExactWhereShapesNearlyTouch) {
  Random random(11);
  const auto random_shape = [&](int kind) {
    const Vector3d size(random.real(0.01, 1), random.real(0.01, 1), random.real(0.01, 1));
    if (kind < 3) return shape(std::array{ShapeType::kEllipsoid, ShapeType::kCylinder, ShapeType::kBox}[kind], size);
    std::vector<Vector3d> points;
    for (int k = 0; k < 20; ++k) points.push_back(size.cwiseProduct(random.direction()));
    return hull(points);
  };
  for (int k = 0; k < 1600; ++k) {
    const Shape a = random_shape(k % 4), b = random_shape(k / 4 % 4);
    const Pose X_a = random.pose(0.2);
    Pose X_b = random.pose(3);
    const Distance far = measure(a, X_a, b, X_b);
    if (far.d < 1e-3) continue;
    for (const double near : {1e-3, 1e-6}) {
      X_b.p -= (measure(a, X_a, b, X_b).d - near) * far.n;
      const Distance found = measure(a, X_a, b, X_b);
      SCOPED_TRACE(std::to_string(k) + " at " + std::to_string(near) + " m");
      EXPECT_NEAR(found.d, near, 1e-7);
      EXPECT_NEAR(outside(a, X_a, found.p_a), 0, 2e-7);
      EXPECT_NEAR(outside(b, X_b, found.p_b), 0, 2e-7);
    }
  }
}

TEST(Distance, OfOverlapsIsAWayOutAndNoDirectionHasAShorterOne) {
  Random random(4);
  int deep = 0;
  for (int k = 0; k < 1000; ++k) {
    const Shape a = random_hull(random, 1),
                b = k % 2 == 0 ? random_hull(random, 0.5) : shape(ShapeType::kCylinder, {0.3, 0.5, 0});
    const Pose X_a = random.pose(0.2);
    Pose X_b = random.pose(0.5);
    const Distance found = measure(a, X_a, b, X_b);
    if (found.d >= 0) continue;
    ++deep;
    X_b.p -= found.d * found.n;
    EXPECT_NEAR(measure(a, X_a, b, X_b).d, 0, 1e-7) << k;
    X_b.p += found.d * found.n;
    const Convex A = make_convex(a), B = make_convex(b);
    for (int i = 0; i < 100; ++i) {
      const double gap = gap_along(place(A, X_a), place(B, X_b), random.direction());
      EXPECT_LE(gap, found.d + (k % 2 == 0 ? 1e-12 : 0.1 * -found.d)) << k;
    }
  }
  EXPECT_GT(deep, 300);
}

TEST(Distance, IsFiniteWhereThereIsNoBestDirection) {
  Random random(5);
  for (const Shape& s : {shape(ShapeType::kSphere, {0.1, 0, 0}), shape(ShapeType::kCapsule, {0.1, 0.5, 0}),
                         shape(ShapeType::kBox, {0.1, 0.1, 0.1}), shape(ShapeType::kCylinder, {0.1, 0.2, 0}),
                         shape(ShapeType::kEllipsoid, {0.1, 0.1, 0.1}), random_hull(random, 0.2)}) {
    const Pose X = random.pose(1);
    const Distance found = measure(s, X, s, X);
    EXPECT_TRUE(std::isfinite(found.d) && found.d < 0 && found.d > -1) << found.d;
  }
  const Shape plane = shape(ShapeType::kPlane, Vector3d::Zero());
  const Convex convex = make_convex(plane);
  Feature scratch;
  EXPECT_EQ(distance(place(convex, {}), place(convex, {}), scratch).d, scene::kInfinity);
}

/// A dish: concave, of triangles.
std::vector<Shape> dish(int rings, int sectors) {
  const auto point = [&](int i, int k) {
    const double r = 0.1 + 0.5 * i / rings, angle = 2 * M_PI * k / sectors;
    return Vector3d(r * std::cos(angle), r * std::sin(angle), r * r);
  };
  std::vector<Shape> shapes;
  for (int i = 0; i < rings; ++i) {
    for (int k = 0; k < sectors; ++k) {
      for (const auto& corners : {std::array{point(i, k), point(i + 1, k), point(i + 1, k + 1)},
                                  std::array{point(i, k), point(i + 1, k + 1), point(i, k + 1)}}) {
        shapes.push_back(shape(ShapeType::kTriangle, {1e-3, 0, 0}));
        shapes.back().vertices = {corners[0], corners[1], corners[2]};
      }
    }
  }
  return shapes;
}

TEST(Bodies, HaveTheLeastDistanceOfTheirShapes) {
  Random random(6);
  const Body mesh(dish(12, 24));
  std::vector<Shape> arm;
  for (int k = 0; k < 5; ++k) {
    arm.push_back(k % 2 == 0 ? shape(ShapeType::kCapsule, {0.03, 0.1, 0}) : random_hull(random, 0.08));
    arm.back().X_BS = random.pose(0.2);
  }
  arm.push_back(shape(ShapeType::kSphere, {0.3, 0, 0}));
  arm.back().tool = "ball";
  Body link(arm);
  Finder finder;
  finder.reserve(mesh);
  finder.reserve(link);
  Feature scratch;
  scratch.corners.reserve(64);
  for (int k = 0; k < 200; ++k) {
    link.set_present(5, k % 4 == 0);
    const Pose X_m = random.pose(0.5), X_l = random.pose(k % 2 == 0 ? 0.8 : 3);
    double least = scene::kInfinity;
    for (std::size_t i = 0; i < mesh.pieces().size(); ++i) {
      for (std::size_t j = 0; j < (k % 4 == 0 ? 6U : 5U); ++j)
        least = std::min(least, distance(place(mesh.pieces()[i], X_m), place(link.pieces()[j], X_l), scratch).d);
    }
    const std::uint64_t before = cotwin::testing::allocations();
    const Distance found = finder.find(mesh, X_m, link, X_l), back = finder.find(link, X_l, mesh, X_m);
    const Distance bounded = finder.find(mesh, X_m, link, X_l, found.d),
                   too_far = finder.find(mesh, X_m, link, X_l, found.d - 1e-9);
    EXPECT_EQ(cotwin::testing::allocations(), before);
    EXPECT_NEAR(found.d, least, 1e-12) << k;
    EXPECT_NEAR(back.d, least, 1e-9) << k;
    EXPECT_EQ(bounded.d, found.d);
    EXPECT_EQ(bounded.p_b, found.p_b);
    EXPECT_EQ(too_far.d, scene::kInfinity);
  }
}

TEST(Bodies, OfAnotherSizeAreThoseOfScaledShapes) {
  Random random(8);
  const Body probe(std::vector{random_hull(random, 0.2), shape(ShapeType::kCapsule, {0.05, 0.6, 0})});
  Finder finder;
  finder.reserve(probe);
  for (int k = 0; k < 100; ++k) {
    std::vector<Shape> shapes = dish(3, 6);
    for (const ShapeType type :
         {ShapeType::kSphere, ShapeType::kBox, ShapeType::kCapsule, ShapeType::kCylinder, ShapeType::kEllipsoid})
      shapes.push_back(shape(type, {random.real(0.02, 0.3), random.real(0.02, 0.3), random.real(0.02, 0.3)}));
    shapes.push_back(random_hull(random, 0.3));
    for (Shape& one : shapes) one.X_BS = random.pose(0.4);
    if (k % 10 == 0) shapes.push_back(shape(ShapeType::kPlane, Vector3d::Zero()));
    const Body unscaled(shapes);
    const double factor = k % 2 == 0 ? random.real(0.1, 1) : random.real(1, 5);
    for (Shape& one : shapes) {
      one.X_BS.p *= factor;
      one.size.head(one.type == ShapeType::kTriangle ? 1 : 3) *= factor;  // of a triangle only the depth is a length
      for (Vector3d& v : one.vertices) v *= factor;
    }
    const Body expected(shapes);
    Body solid = unscaled;
    solid.set_scaled(unscaled, 7);
    solid.set_scaled(unscaled, factor);
    finder.reserve(solid);
    EXPECT_NEAR(1 / solid.reach(), 1 / expected.reach(), 1e-12);
    for (int pose = 0; pose < 5; ++pose) {
      const Pose X = random.pose(2);
      EXPECT_NEAR(finder.find(solid, {}, probe, X).d, finder.find(expected, {}, probe, X).d, 1e-9) << k;
    }
  }
}

TEST(Bodies, WithPlanesAndWithoutShapes) {
  Finder finder;
  const Body none(std::vector<Shape>{}), ball(std::vector{shape(ShapeType::kSphere, {0.1, 0, 0})});
  const Body ground(std::vector{shape(ShapeType::kPlane, Vector3d::Zero()), shape(ShapeType::kBox, {1, 1, 1})});
  for (const Body* solid : {&none, &ball, &ground}) finder.reserve(*solid);
  const Pose up{Matrix3d::Identity(), {3, 0, 2}};
  EXPECT_EQ(finder.find(none, {}, ball, up).d, scene::kInfinity);
  EXPECT_TRUE(none.empty());
  EXPECT_DOUBLE_EQ(finder.find(ground, {}, ball, up).d, 1.9);
  EXPECT_DOUBLE_EQ(finder.find(ball, up, ground, {}).d, 1.9);
  EXPECT_EQ(finder.find(ball, up, ground, {}).n, Vector3d(0, 0, -1));
  EXPECT_EQ(ground.radius(), scene::kInfinity);
  EXPECT_DOUBLE_EQ(ball.radius(), 0.1);
  EXPECT_DOUBLE_EQ(ball.reach(), 0.1);
}

TEST(Bodies, OfFlatHullsAreRefused) {
  const Shape flat = hull({{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {0.5, 0.5, 1e-12}});
  EXPECT_THROW(Body{std::vector{flat}}, Error);
}

}  // namespace
}  // namespace cotwin::collision::distance_test
