#include "models/collision/contact/detector.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <set>

#include "models/scene/shapes.h"
#include "tests/components/contact_world/shapes.h"
#include "tests/support/allocations.h"

namespace cotwin::contact_world::testing::collision_test {
namespace {

constexpr double kExact = 1e-9;  // m, of shapes of 0.1 m
// Curved bodies deep inside each other: Bullet's EPA approximates their Minkowski difference by 64 points.
constexpr double kDeep = 0.01, kDeepError = 1e-5;  // m
constexpr double kFar = 1;                         // m: a margin that contains all pairs

std::vector<ContactPoint> points_of(const scene::Scene& scene, const std::vector<Pose>& X, double margin) {
  collision::Detector detector(scene);
  detector.detect(X, margin);
  return {detector.points().begin(), detector.points().end()};
}

/// The points are on the surfaces: the surfaces of a and b are half a gap away along n.
void expect_on_surfaces(const Shape& a, const Pose& X_a, const Shape& b, const Pose& X_b, const ContactPoint& p) {
  EXPECT_NEAR(p.n_W.norm(), 1, 1e-12);
  // Tangent plane: the shape extends no farther along n than the point.
  EXPECT_NEAR(p.n_W.dot(farthest(a, X_a, p.n_W)), p.n_W.dot(p.p_W) - p.gap / 2, kExact);
  EXPECT_NEAR(p.n_W.dot(farthest(b, X_b, -p.n_W)), p.n_W.dot(p.p_W) + p.gap / 2, kExact);
}

/// The distance to the surface of one shape, negative inside, by definition; only its sign and zero are used.
double outside(const Shape& shape, const Pose& X, const Vector3d& p_W) {
  const Vector3d p = X.inverse() * p_W;
  const double r = shape.size.x(), half = shape.size.y() / 2;
  switch (shape.type) {
    case ShapeType::kSphere:
      return p.norm() - r;
    case ShapeType::kBox:
      return (p.cwiseAbs() - shape.size / 2).maxCoeff();
    case ShapeType::kCylinder:
      return std::max(std::hypot(p.x(), p.y()) - r, std::abs(p.z()) - half);
    case ShapeType::kCapsule:
      return Vector3d(p.x(), p.y(), p.z() - std::clamp(p.z(), -half, half)).norm() - r;
    case ShapeType::kPlane:
      return p.z();
    case ShapeType::kEllipsoid: {  // to first order
      const double level = p.cwiseQuotient(shape.size).squaredNorm() - 1;
      return level / (2 * p.cwiseQuotient(shape.size.cwiseAbs2()).norm());
    }
    case ShapeType::kTriangle:
    case ShapeType::kHull:
      break;
  }
  // For a hull: the largest gap between the point and all planes through three vertices that have the other vertices on one
  // side.
  double most = -std::numeric_limits<double>::infinity();
  const std::vector<Vector3d>& v = shape.vertices;
  for (std::size_t i = 0; i < v.size(); ++i) {
    for (std::size_t j = i + 1; j < v.size(); ++j) {
      for (std::size_t k = j + 1; k < v.size(); ++k) {
        Vector3d n = (v[j] - v[i]).cross(v[k] - v[i]).normalized();
        double above = 0, below = 0;
        for (const Vector3d& w : v) above = std::max(above, n.dot(w - v[i])), below = std::min(below, n.dot(w - v[i]));
        if (above > 1e-12 && below < -1e-12) continue;
        if (above > 1e-12) n = -n;
        most = std::max(most, n.dot(p - v[i]));
      }
    }
  }
  return most;
}

struct Case {
  ShapeType a, b;
};

class EveryPair : public ::testing::TestWithParam<Case> {};

std::vector<Case> all_pairs() {
  std::vector<Case> pairs;
  for (const ShapeType a : kBodies) {
    for (const ShapeType b : kBodies) pairs.push_back({a, b});
  }
  return pairs;
}

INSTANTIATE_TEST_SUITE_P(Shapes, EveryPair, ::testing::ValuesIn(all_pairs()),
                         [](const auto& test) { return name_of(test.param.a) + "_" + name_of(test.param.b); });

/// Weak duality: the gap along any n is at most the signed distance. If two points of the surfaces face each other along a
/// direction at that gap, this direction is the best one for separated bodies, and for interpenetrating bodies if no other
/// direction has more.
TEST_P(EveryPair, HasItsExactDistanceAtRandomPoses) {
  Random random(7);
  for (int i = 0; i < 150; ++i) {
    const Shape a = random_shape(GetParam().a, random), b = random_shape(GetParam().b, random);
    const Pose X_a{random.rotation(), random.vector(0.2)};
    Pose X_b{random.rotation(), random.vector(0.2)};
    if (i % 3 != 0) {  // close to touching: from 3 mm inside to 3 mm apart
      Vector3d n;
      const double gap = best_gap(a, X_a, b, X_b, random, &n);
      X_b.p += n * (random.real(-0.003, 0.003) - gap);
    }
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(a) + " at " + text_of(X_a) + ", " + text_of(b) + " at " +
                 text_of(X_b));
    const std::vector<ContactPoint> points = points_of(scene_of({a, b}), {X_a, X_b}, kFar);
    ASSERT_FALSE(points.empty());
    ASSERT_LE(points.size(), 4u);
    const ContactPoint& p = deepest(points);
    expect_on_surfaces(a, X_a, b, X_b, p);
    const Vector3d p_a = p.p_W - p.n_W * (p.gap / 2), p_b = p.p_W + p.n_W * (p.gap / 2);
    EXPECT_NEAR(outside(a, X_a, p_a), 0,
                2e-8);  // on curved surfaces the point may be off sideways by the root of kExact
    EXPECT_NEAR(outside(b, X_b, p_b), 0, 2e-8);
    // For cylinders with a penetration below 1 % of the size the direction is locally the best, for polytopes globally.
    const bool local = p.gap < 0 && p.gap > -0.003 && (a.type == ShapeType::kCylinder || b.type == ShapeType::kCylinder);
    EXPECT_LE(best_gap(a, X_a, b, X_b, random), p.gap + (local ? -0.2 * p.gap : kExact));
  }
}

TEST(Collision, EllipsoidsHaveTheirDistanceToTwoTenthsOfAMillimetre) {
  Random random(19);
  for (int i = 0; i < 200; ++i) {
    const Shape a = random_shape(ShapeType::kEllipsoid, random);
    const Shape b = random_shape(i % 6 == 5 ? ShapeType::kEllipsoid : kBodies[static_cast<std::size_t>(i % 6)], random);
    const Pose X_a{random.rotation(), random.vector(0.2)};
    Pose X_b{random.rotation(), random.vector(0.2)};
    Vector3d n;
    const double gap = best_gap(a, X_a, b, X_b, random, &n);
    X_b.p += n * (random.real(-0.001, 0.003) - gap);
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(a) + " at " + text_of(X_a) + ", " + text_of(b) + " at " +
                 text_of(X_b));
    const std::vector<ContactPoint> points = points_of(scene_of({a, b}), {X_a, X_b}, kFar);
    ASSERT_FALSE(points.empty());
    EXPECT_NEAR(deepest(points).gap, best_gap(a, X_a, b, X_b, random), 2e-4);
  }
}

TEST_P(EveryPair, IsTheSamePairSeenFromTheOtherSide) {
  Random random(11);
  for (int i = 0; i < 100; ++i) {
    const Shape a = random_shape(GetParam().a, random), b = random_shape(GetParam().b, random);
    const Pose X_a{random.rotation(), random.vector(0.1)}, X_b{random.rotation(), random.vector(0.1)};
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(a) + " at " + text_of(X_a) + ", " + text_of(b) + " at " +
                 text_of(X_b));
    const auto one = points_of(scene_of({a, b}), {X_a, X_b}, kFar), other = points_of(scene_of({b, a}), {X_b, X_a}, kFar);
    ASSERT_FALSE(one.empty());
    ASSERT_FALSE(other.empty());
    const ContactPoint &p = deepest(one), &q = deepest(other);
    EXPECT_NEAR(p.gap, q.gap, p.gap > -kDeep ? kExact : kDeepError);
  }
}

TEST_P(EveryPair, MovesWithTheWorld) {
  Random random(13);
  for (int i = 0; i < 50; ++i) {
    const Shape a = random_shape(GetParam().a, random), b = random_shape(GetParam().b, random);
    const Pose X_a{random.rotation(), random.vector(0.1)}, X_b{random.rotation(), random.vector(0.1)};
    const Pose X{random.rotation(), random.vector(3)};
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(a) + " at " + text_of(X_a) + ", " + text_of(b) + " at " +
                 text_of(X_b));
    const auto here = points_of(scene_of({a, b}), {X_a, X_b}, kFar),
               there = points_of(scene_of({a, b}), {X * X_a, X * X_b}, kFar);
    ASSERT_FALSE(here.empty());
    ASSERT_FALSE(there.empty());
    EXPECT_NEAR(deepest(here).gap, deepest(there).gap, deepest(here).gap > -kDeep ? kExact : kDeepError);
  }
}

/// A contact point keeps its id while the bodies move slowly, and moves with them.
TEST_P(EveryPair, KeepsItsPointsUnderSmallMotions) {
  Random random(17);
  constexpr double kMotion = 1e-7;  // m, rad
  int kept = 0, all = 0;
  for (int i = 0; i < 100; ++i) {
    const Shape a = random_shape(GetParam().a, random), b = random_shape(GetParam().b, random);
    const Pose X_a{random.rotation(), random.vector(0.2)};
    Pose X_b{random.rotation(), random.vector(0.2)};
    Vector3d n;
    const double gap = best_gap(a, X_a, b, X_b, random, &n);
    X_b.p += n * (random.real(-0.001, 0.001) - gap);
    const Pose X_m{Eigen::AngleAxisd(kMotion, random.direction()).toRotationMatrix() * X_b.R,
                   X_b.p + random.direction() * kMotion};
    const auto before = points_of(scene_of({a, b}), {X_a, X_b}, 0.005), after = points_of(scene_of({a, b}), {X_a, X_m}, 0.005);
    for (const ContactPoint& p : before) {
      const auto same = std::find_if(after.begin(), after.end(), [&](const ContactPoint& q) { return q.id == p.id; });
      ++all;
      if (same == after.end()) continue;
      const double moved = (same->p_W - p.p_W).norm();
      if (moved > 2e-4) continue;  // where rims and edges cross at a small angle: up to 1e3 times the motion
      ++kept;
      EXPECT_NEAR(same->gap, p.gap, moved + 20 * kMotion) << "case " << i;
    }
  }
  EXPECT_GT(all, 90);
  EXPECT_GE(kept, all - all / 25);  // random poses are sometimes at a change of features
}

TEST_P(EveryPair, IsFiniteWhereThereIsNoBestDirection) {
  Random random(19);
  for (int i = 0; i < 60; ++i) {
    Shape a = random_shape(GetParam().a, random), b = random_shape(GetParam().b, random);
    if (i % 4 == 1) a.size *= 1e-5, b.size *= 1;
    if (i % 4 == 2) a.size *= 1e4;
    if (i % 4 == 1 || i % 4 == 2) {
      for (Vector3d& v : a.vertices) v *= i % 4 == 1 ? 1e-5 : 1e4;
    }
    const Matrix3d R = random.rotation();
    const Pose X_a{R, Vector3d::Zero()};
    const Pose X_b{i % 2 == 0 ? R : random.rotation(), i % 3 == 0 ? Vector3d(random.vector(1e-300)) : Vector3d::Zero()};
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(a) + ", " + text_of(b));
    const auto points = points_of(scene_of({a, b}), {X_a, X_b}, 0.001);
    for (const ContactPoint& p : points) {
      EXPECT_TRUE(p.p_W.allFinite() && p.n_W.allFinite() && std::isfinite(p.gap));
      EXPECT_NEAR(p.n_W.norm(), 1, 1e-9);
    }
    const double gap = best_gap(a, X_a, b, X_b, random);  // a hull need not contain the origin of its frame
    EXPECT_EQ(points.empty(), gap > 0.001);
    if (points.empty()) continue;
    EXPECT_LT(deepest(points).gap, std::max(0.0, gap + kExact));
  }
}

TEST_P(EveryPair, TouchesAPlaneWithItsLowestPoint) {
  Random random(23);
  for (int i = 0; i < 100; ++i) {
    const Shape shape = random_shape(GetParam().a, random);
    const Pose X_P{random.rotation(), random.vector(1)}, X_B{random.rotation(), random.vector(0.3)};
    const Vector3d n = X_P.R.col(2);
    const double lowest = n.dot(farthest(shape, X_B, -n) - X_P.p);
    const auto points = points_of(scene_of({make(ShapeType::kPlane, Vector3d::Zero()), shape}), {X_P, X_B}, 10);
    SCOPED_TRACE("case " + std::to_string(i) + ": " + text_of(shape) + " at " + text_of(X_B));
    ASSERT_FALSE(points.empty());
    EXPECT_NEAR(deepest(points).gap, lowest, kExact);
    for (const ContactPoint& p : points) {
      EXPECT_EQ(p.n_W, n);
      EXPECT_NEAR(n.dot(p.p_W - X_P.p), p.gap / 2, kExact);  // halfway between the plane and the body
    }
  }
}

Pose at(const Vector3d& p, const Matrix3d& R = Matrix3d::Identity()) { return {R, p}; }
Matrix3d turned(double angle, const Vector3d& axis) { return Eigen::AngleAxisd(angle, axis.normalized()).toRotationMatrix(); }

TEST(Collision, SpheresHaveTheDistanceOfTheirCentresLessTheirRadii) {
  const Shape a = make(ShapeType::kSphere, {0.1, 0, 0}), b = make(ShapeType::kSphere, {0.05, 0, 0});
  const auto points = points_of(scene_of({a, b}), {at({0, 0, 0}), at({0.3, 0.4, 0})}, kFar);
  ASSERT_EQ(points.size(), 1u);
  EXPECT_NEAR(points[0].gap, 0.35, 1e-15);
  EXPECT_TRUE(points[0].n_W.isApprox(Vector3d(0.6, 0.8, 0), 1e-15));
  EXPECT_TRUE(points[0].p_W.isApprox(Vector3d(0.6, 0.8, 0) * (0.1 + 0.35 / 2), 1e-14));
}

TEST(Collision, ACubeStandsOnItsFourCorners) {
  const Shape cube = make(ShapeType::kBox, {0.1, 0.1, 0.1}), table = make(ShapeType::kBox, {1, 1, 0.1});
  for (const double gap : {-0.001, 0.0, 0.001}) {
    for (const bool plane : {false, true}) {
      const auto points = plane ? points_of(scene_of({make(ShapeType::kPlane, Vector3d::Zero()), cube}),
                                            {at({0, 0, 0}), at({0, 0, 0.05 + gap})}, 0.002)
                                : points_of(scene_of({table, cube}), {at({0, 0, -0.05}), at({0, 0, 0.05 + gap})}, 0.002);
      ASSERT_EQ(points.size(), 4u);
      double sum_x = 0, sum_y = 0;
      std::set<std::uint64_t> ids;
      for (const ContactPoint& p : points) {
        EXPECT_NEAR(p.gap, gap, 1e-15);
        EXPECT_EQ(p.n_W, Vector3d(0, 0, 1));
        EXPECT_NEAR(std::abs(p.p_W.x()), 0.05, 1e-12);
        EXPECT_NEAR(std::abs(p.p_W.y()), 0.05, 1e-12);
        EXPECT_NEAR(p.p_W.z(), gap / 2, 1e-12);
        sum_x += p.p_W.x();
        sum_y += p.p_W.y();
        ids.insert(p.id);
      }
      EXPECT_NEAR(sum_x, 0, 1e-12);
      EXPECT_NEAR(sum_y, 0, 1e-12);
      EXPECT_EQ(ids.size(), 4u);
    }
  }
}

TEST(Collision, TwoCubesTurnedAgainstEachOtherMeetInFourOfEightPoints) {
  const Shape cube = make(ShapeType::kBox, {0.1, 0.1, 0.1});
  const auto points = points_of(scene_of({cube, cube}), {at({0, 0, 0}), at({0, 0, 0.1}, turned(M_PI / 4, {0, 0, 1}))}, 0.001);
  ASSERT_EQ(points.size(), 4u);
  // The corners of the octagon are at this distance from its centre. Four of them support the cube while they surround it.
  const double corner = 0.05 / std::cos(M_PI / 8);
  Vector3d sum = Vector3d::Zero();
  for (const ContactPoint& p : points) {
    EXPECT_NEAR(std::hypot(p.p_W.x(), p.p_W.y()), corner, 1e-12);
    sum += p.p_W;
  }
  EXPECT_LT(std::hypot(sum.x(), sum.y()), 0.05);
}

TEST(Collision, AlignedCubesKeepTheirPointsDuringSmallMotions) {
  // Corner on corner: which of the two gives the id of the point must not depend on rounding.
  Random random(3);
  const Shape cube = make(ShapeType::kBox, {0.1, 0.1, 0.1});
  const scene::Scene scene = scene_of({cube, cube});
  std::vector<std::uint64_t> ids;
  for (int i = 0; i < 200; ++i) {
    const auto points = points_of(
        scene,
        {at({0, 0, 0}), at(Vector3d(0, 0, 0.1) + random.vector(2e-9), turned(random.real(-2e-9, 2e-9), random.direction()))},
        0.001);
    ASSERT_EQ(points.size(), 4u);
    std::vector<std::uint64_t> now;
    for (const ContactPoint& p : points) now.push_back(p.id);
    if (ids.empty()) ids = now;
    EXPECT_EQ(now, ids) << "case " << i;
  }
}

TEST(Collision, CrossedEdgesTouchInOnePoint) {
  // Two cubes standing on their edges, crossed: the lowest edge of the upper cube along y meets the highest edge of the lower
  // cube along x.
  const Shape cube = make(ShapeType::kBox, {0.1, 0.1, 0.1});
  const double edge = 0.05 * std::sqrt(2);
  for (const double gap : {-0.001, 0.0005}) {
    const auto points = points_of(
        scene_of({cube, cube}),
        {at({0, 0, 0}, turned(M_PI / 4, {1, 0, 0})), at({0.01, 0.02, 2 * edge + gap}, turned(M_PI / 4, {0, 1, 0}))}, 0.001);
    ASSERT_EQ(points.size(), 1u);
    EXPECT_NEAR(points[0].gap, gap, 1e-14);
    EXPECT_TRUE(points[0].n_W.isApprox(Vector3d(0, 0, 1), 1e-12));
    EXPECT_TRUE(points[0].p_W.isApprox(Vector3d(0.01, 0, edge + gap / 2), 1e-12));
  }
}

TEST(Collision, CornersOfSeparatedCubesHaveTheirExactDistance) {
  const Shape cube = make(ShapeType::kBox, {0.1, 0.1, 0.1});
  const auto points = points_of(scene_of({cube, cube}), {at({0, 0, 0}), at({0.101, 0.102, 0.102})}, 0.01);
  ASSERT_EQ(points.size(), 1u);
  EXPECT_NEAR(points[0].gap, 0.003, 1e-14);
  EXPECT_TRUE(points[0].n_W.isApprox(Vector3d(1, 2, 2) / 3, 1e-9));
  EXPECT_TRUE(points_of(scene_of({cube, cube}), {at({0, 0, 0}), at({0.101, 0.102, 0.102})}, 0.0029).empty());
}

TEST(Collision, ACylinderStandsOnFourPointsOfItsRim) {
  const Shape cylinder = make(ShapeType::kCylinder, {0.03, 0.1, 0}), table = make(ShapeType::kBox, {1, 1, 0.1});
  for (const bool plane : {false, true}) {
    const auto points = plane ? points_of(scene_of({make(ShapeType::kPlane, Vector3d::Zero()), cylinder}),
                                          {at({0, 0, 0}), at({0, 0, 0.05})}, 0.001)
                              : points_of(scene_of({table, cylinder}), {at({0, 0, -0.05}), at({0, 0, 0.05})}, 0.001);
    ASSERT_EQ(points.size(), 4u);
    Vector3d sum = Vector3d::Zero();
    for (const ContactPoint& p : points) {
      EXPECT_NEAR(p.gap, 0, 1e-15);
      EXPECT_NEAR(std::hypot(p.p_W.x(), p.p_W.y()), 0.03, 1e-12);
      sum += p.p_W;
    }
    EXPECT_LT(sum.norm(), 1e-3);
  }
}

TEST(Collision, ATiltedCylinderTouchesWithItsLowestRimPoint) {
  const Shape cylinder = make(ShapeType::kCylinder, {0.03, 0.1, 0});
  Random random(5);
  for (int i = 0; i < 200; ++i) {
    const double tilt = std::pow(10, random.real(-9, -0.1));  // rad
    const Vector3d axis(random.real(-1, 1), random.real(-1, 1), 0);
    const auto points = points_of(scene_of({make(ShapeType::kPlane, Vector3d::Zero()), cylinder}),
                                  {at({0, 0, 0}), at({0, 0, 0.05}, turned(tilt, axis))}, 0.1);
    // Half the height, times the cosine of the tilt; the rim, lower by its sine.
    EXPECT_NEAR(deepest(points).gap, 0.05 - 0.05 * std::cos(tilt) - 0.03 * std::sin(tilt), kExact) << tilt;
  }
}

TEST(Collision, ALyingCylinderAndALyingCapsuleTouchInTwoPoints) {
  const Shape cylinder = make(ShapeType::kCylinder, {0.03, 0.1, 0}), capsule = make(ShapeType::kCapsule, {0.03, 0.1, 0});
  const Shape table = make(ShapeType::kBox, {1, 1, 0.1});
  const Matrix3d lying = turned(M_PI / 2, {0, 1, 0});
  for (const Shape& shape : {cylinder, capsule}) {
    for (const bool plane : {false, true}) {
      const auto points = plane ? points_of(scene_of({make(ShapeType::kPlane, Vector3d::Zero()), shape}),
                                            {at({0, 0, 0}), at({0, 0, 0.029}, lying)}, 0.001)
                                : points_of(scene_of({table, shape}), {at({0, 0, -0.05}), at({0, 0, 0.029}, lying)}, 0.001);
      ASSERT_EQ(points.size(), 2u) << text_of(shape) << plane;
      for (const ContactPoint& p : points) {
        EXPECT_NEAR(p.gap, -0.001, 1e-12);
        EXPECT_NEAR(std::abs(p.p_W.x()), 0.05, 1e-12);
        EXPECT_NEAR(p.p_W.y(), 0, 1e-12);
      }
    }
  }
}

TEST(Collision, AnOverhangingCapsuleTouchesUpToTheEdge) {
  const Shape capsule = make(ShapeType::kCapsule, {0.03, 0.1, 0}), table = make(ShapeType::kBox, {1, 1, 0.1});
  const auto points =
      points_of(scene_of({table, capsule}), {at({0, 0, -0.05}), at({0.48, 0, 0.03}, turned(M_PI / 2, {0, 1, 0}))}, 0.001);
  ASSERT_EQ(points.size(), 2u);
  EXPECT_NEAR(std::max(points[0].p_W.x(), points[1].p_W.x()), 0.5, 1e-12);
  EXPECT_NEAR(std::min(points[0].p_W.x(), points[1].p_W.x()), 0.43, 1e-12);
}

TEST(Collision, ParallelCylindersTouchAlongTheirLine) {
  const Shape cylinder = make(ShapeType::kCylinder, {0.03, 0.1, 0});
  const auto points = points_of(scene_of({cylinder, cylinder}), {at({0, 0, 0}), at({0.0599, 0, 0.04})}, 0.001);
  ASSERT_EQ(points.size(), 2u);
  for (const ContactPoint& p : points) {
    EXPECT_NEAR(p.gap, -0.0001, 1e-12);
    EXPECT_TRUE(p.n_W.isApprox(Vector3d(1, 0, 0), 1e-12));
  }
  EXPECT_NEAR(std::abs(points[0].p_W.z() - points[1].p_W.z()), 0.06, 1e-12);
}

/// A peg on the axis of a bore has the clearance as distance to every facet; moved sideways, the facet ahead is nearer by the
/// motion.
TEST(Collision, APegInABoreIsHeldAllAround) {
  scene::RoundHole hole;
  hole.radius = 0.01505;
  hole.depth = 0.04;
  hole.width = hole.length = 0.12;
  hole.chamfer = 0.002;
  hole.facets = 96;
  scene::Scene scene = scene_of({make(ShapeType::kCylinder, {0.015, 0.06, 0})});
  scene::Body plate;
  plate.motion = scene::Motion::kStatic;
  plate.shapes = scene::round_hole(hole);
  scene.bodies.push_back(plate);
  const auto centred = points_of(scene, {at({0, 0, 0.02}), at({0, 0, 0})}, 1e-4);
  EXPECT_EQ(centred.size(), 2u * 96);  // a line on each facet
  for (const ContactPoint& p : centred) {
    EXPECT_NEAR(p.gap, 0.5e-4, kExact);
    EXPECT_NEAR(p.n_W.z(), 0, 1e-12);
    EXPECT_GT(p.n_W.dot(Vector3d(p.p_W.x(), p.p_W.y(), 0).normalized()), 0.999);
  }
  for (const double aside : {0.4e-4, 0.6e-4}) {
    const auto moved = points_of(scene, {at({aside, 0, 0.02}), at({0, 0, 0})}, 1e-4);
    EXPECT_NEAR(deepest(moved).gap, 0.5e-4 - aside, kExact);  // facet 0 is ahead on x
    EXPECT_NEAR(deepest(moved).n_W.x(), 1, 1e-9);
  }
  // Above the plate, on its axis and wider than the hole: the rim touches the upper edges of the chamfers.
  scene.bodies[0].shapes[0].size.x() = 0.0169;
  const auto above = points_of(scene, {at({0, 0, 0.0495}), at({0, 0, 0})}, 1e-3);
  ASSERT_FALSE(above.empty());
  for (const ContactPoint& p : above) EXPECT_LT(p.n_W.z(), 0);
}

/// Pieces of one body that touch each other have no surface between them: a body that slides over the seam does not collide
/// with it.
TEST(Collision, ABoxSlidesOverTheSeamsOfAPlate) {
  scene::RoundHole hole;
  hole.radius = 0.01;
  hole.depth = 0.04;
  hole.width = hole.length = 0.4;
  hole.facets = 16;
  scene::Scene scene = scene_of({make(ShapeType::kBox, {0.05, 0.05, 0.05})});
  scene::Body plate;
  plate.motion = scene::Motion::kStatic;
  plate.shapes = scene::round_hole(hole);
  scene.bodies.push_back(plate);
  Random random(29);
  for (int i = 0; i < 500; ++i) {
    const double depth = std::pow(10, random.real(-8, -3));  // m
    const Vector3d p(random.real(0.08, 0.15), random.real(-0.1, 0.1), 0.02 + 0.025 - depth);
    const auto points = points_of(scene, {at(p, turned(random.real(0, 6), {0, 0, 1})), at({0, 0, 0})}, 1e-3);
    ASSERT_FALSE(points.empty());
    for (const ContactPoint& q : points) {
      if (q.gap >= 0) continue;
      EXPECT_GT(-q.n_W.z(), 0.999) << "case " << i << " depth " << depth << " at " << p.transpose();
    }
  }
}

/// Hulls with so many edges that not all pairs of edges are tried.
TEST(Collision, HullsOfManyFacesHaveTheirExactDistance) {
  Random random(59);
  for (int i = 0; i < 60; ++i) {
    Shape a = make(ShapeType::kHull, {0, 0, 0}), b = a;
    for (int k = 0; k < 80; ++k)
      a.vertices.push_back(0.1 * random.direction()), b.vertices.push_back(0.07 * random.direction());
    const Pose X_a{random.rotation(), random.vector(0.2)};
    Pose X_b{random.rotation(), random.vector(0.2)};
    Vector3d n;
    const double gap = best_gap(a, X_a, b, X_b, random, &n);
    if (i % 2 == 0) X_b.p += n * (random.real(-0.0005, 0.003) - gap);
    SCOPED_TRACE("case " + std::to_string(i) + " at " + text_of(X_a) + ", " + text_of(X_b));
    const auto points = points_of(scene_of({a, b}), {X_a, X_b}, kFar);
    ASSERT_FALSE(points.empty());
    const ContactPoint& p = deepest(points);
    expect_on_surfaces(a, X_a, b, X_b, p);
    const bool local = p.gap < 0 && p.gap > -0.002;
    EXPECT_LE(best_gap(a, X_a, b, X_b, random), p.gap + (local ? -0.2 * p.gap : kExact));
  }
}

scene::Scene random_scene(Random& random, int count) {
  std::vector<Shape> shapes{make(ShapeType::kPlane, Vector3d::Zero())};
  for (int i = 1; i < count; ++i) shapes.push_back(random_shape(kBodies[static_cast<std::size_t>(i) % kBodies.size()], random));
  return scene_of(shapes);
}

std::vector<Pose> random_poses(Random& random, int count) {
  std::vector<Pose> poses{at({0, 0, -0.4})};
  for (int i = 1; i < count; ++i) poses.push_back({random.rotation(), random.vector(0.5)});
  return poses;
}

bool same_bits(std::span<const ContactPoint> a, std::span<const ContactPoint> b) {
  return a.size() == b.size() && std::equal(a.begin(), a.end(), b.begin(), [](const ContactPoint& p, const ContactPoint& q) {
           return p.body_a == q.body_a && p.body_b == q.body_b && p.shape_a == q.shape_a && p.shape_b == q.shape_b &&
                  p.id == q.id && std::memcmp(p.p_W.data(), q.p_W.data(), 24) == 0 &&
                  std::memcmp(p.n_W.data(), q.n_W.data(), 24) == 0 && std::memcmp(&p.gap, &q.gap, 8) == 0;
         });
}

TEST(Collision, IsAFunctionOfThePosesAlone) {
  Random random(31);
  constexpr int kCount = 40;
  const scene::Scene scene = random_scene(random, kCount);
  collision::Detector detector(scene);
  const std::vector<Pose> poses = random_poses(random, kCount);
  detector.detect(poses, 0.01);
  const std::vector<ContactPoint> first(detector.points().begin(), detector.points().end());
  EXPECT_GT(first.size(), 20u);
  for (int i = 0; i < 10; ++i) {
    detector.detect(random_poses(random, kCount), random.real(0, 0.1));
    detector.detect(poses, 0.01);
    EXPECT_TRUE(same_bits(detector.points(), first));
  }
  EXPECT_TRUE(same_bits(points_of(scene, poses, 0.01), first));
}

TEST(Collision, FindsTheContactsOfEachPair) {
  Random random(37);
  constexpr int kCount = 30;
  for (int i = 0; i < 5; ++i) {
    const scene::Scene scene = random_scene(random, kCount);
    const std::vector<Pose> poses = random_poses(random, kCount);
    std::vector<ContactPoint> expected;
    for (int a = 0; a < kCount; ++a) {
      for (int b = a + 1; b < kCount; ++b) {
        const auto of = [&](int k) { return scene.bodies[static_cast<std::size_t>(k)].shapes[0]; };
        const auto X = [&](int k) { return poses[static_cast<std::size_t>(k)]; };
        for (ContactPoint p : points_of(scene_of({of(a), of(b)}), {X(a), X(b)}, 0.02)) {
          p.body_a = a;
          p.body_b = b;
          expected.push_back(p);
        }
      }
    }
    EXPECT_TRUE(same_bits(points_of(scene, poses, 0.02), expected));
  }
}

TEST(Collision, SortsItsPointsByPairAndFeature) {
  Random random(41);
  const scene::Scene scene = random_scene(random, 40);
  const auto points = points_of(scene, random_poses(random, 40), 0.02);
  const auto key = [](const ContactPoint& p) { return std::tuple(p.body_a, p.body_b, p.shape_a, p.shape_b, p.id); };
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_LT(points[i].body_a, points[i].body_b);
    if (i == 0) continue;
    EXPECT_LT(key(points[i - 1]), key(points[i]));
  }
}

TEST(Collision, AllocatesNothingAfterTheFirstSteps) {
  Random random(43);
  constexpr int kCount = 60;
  collision::Detector detector(random_scene(random, kCount));
  std::vector<std::vector<Pose>> poses;
  for (int i = 0; i < 20; ++i) poses.push_back(random_poses(random, kCount));
  for (const auto& X : poses) detector.detect(X, 0.05);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int i = 0; i < 5; ++i) {
    for (const auto& X : poses) detector.detect(X, 0.05);
  }
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

TEST(Collision, ReserveAvoidsAllocationsInTheFirstStep) {
  Random random(47);
  constexpr int kCount = 60;
  collision::Detector detector(random_scene(random, kCount));
  detector.reserve(4000);
  const std::vector<Pose> poses = random_poses(random, kCount);
  const std::uint64_t before = cotwin::testing::allocations();
  detector.detect(poses, 0.05);
  EXPECT_EQ(cotwin::testing::allocations(), before);
  EXPECT_GT(detector.points().size(), 0u);
}

TEST(Collision, LeavesOutPairsThatTheSceneExcludes) {
  const Shape ball = make(ShapeType::kSphere, {0.1, 0, 0});
  const std::vector<Pose> X(2);
  scene::Scene scene = scene_of({ball, ball});
  EXPECT_EQ(points_of(scene, X, 0.01).size(), 1u);
  scene.no_contact = {{1, 0}};
  EXPECT_TRUE(points_of(scene, X, 0.01).empty());
  scene.no_contact.clear();
  scene::Joint joint;
  joint.parent = 1;
  joint.child = 0;
  scene.joints = {joint};
  EXPECT_TRUE(points_of(scene, X, 0.01).empty());
  scene.joints[0].parent = -1;  // a joint to the world connects no bodies
  EXPECT_EQ(points_of(scene, X, 0.01).size(), 1u);
  scene.bodies[0].motion = scene::Motion::kStatic;
  EXPECT_EQ(points_of(scene, X, 0.01).size(), 1u);
  scene.bodies[1].motion = scene::Motion::kDriven;  // whose contact forces are outputs
  EXPECT_EQ(points_of(scene, X, 0.01).size(), 1u);
  scene.bodies[1].motion = scene::Motion::kStatic;
  EXPECT_TRUE(points_of(scene, X, 0.01).empty());
  scene::Scene one = scene_of({ball});
  one.bodies[0].shapes.push_back(ball);
  EXPECT_TRUE(points_of(one, {Pose{}}, 0.01).empty());
}

TEST(Collision, FindsNoContactForPosesWithNaN) {
  Random random(53);
  constexpr int kCount = 30;
  const scene::Scene scene = random_scene(random, kCount);
  std::vector<Pose> poses = random_poses(random, kCount);
  for (std::size_t i = 1; i < kCount; i += 3) poses[i].p.y() = std::numeric_limits<double>::quiet_NaN();
  for (const ContactPoint& p : points_of(scene, poses, 0.02)) EXPECT_TRUE(std::isfinite(p.gap) && p.p_W.allFinite());
}

}  // namespace
}  // namespace cotwin::contact_world::testing::collision_test
