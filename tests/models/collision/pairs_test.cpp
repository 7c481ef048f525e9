// Pairs of all shapes: their points are on both surfaces (an upper bound of the distance), no plane between them leaves more room (a lower one), and no
// sampled direction leads out of an overlap sooner.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "models/collision/body.h"
#include "models/collision/nearest.h"
#include "tests/models/collision/random_shapes.h"

namespace cotwin::collision::pairs_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using scene::Shape;
using scene::ShapeType;

constexpr std::array kTypes{ShapeType::kSphere, ShapeType::kCapsule,   ShapeType::kCylinder, ShapeType::kBox,
                            ShapeType::kHull,   ShapeType::kEllipsoid, ShapeType::kPlane};

Shape random_shape(ShapeType type, double scale, Random& random) {
  const auto length = [&] { return scale * (random.real(0, 1) < 0.3 ? 0.1 : random.real(0.02, 0.5)); };
  Shape s = shape(type, {length(), length(), length()});
  if (type != ShapeType::kHull) return s;
  const int count = random.real(0, 1) < 0.2 ? 200 : static_cast<int>(random.real(4, 30));
  for (int k = 0; k < count; ++k)
    s.vertices.push_back(s.size.cwiseProduct(random.direction()) * (count == 200 ? 1 : random.real(0.5, 1)));
  return s;
}

/// How far a point is from the surface, m: near it, and to first order of it for ellipsoids.
double off_surface(const Shape& s, const Convex& convex, const Pose& X_WB, const Vector3d& p_W) {
  const Vector3d p = X_WB.inverse() * p_W;
  const double r = s.size.x(), half = s.size.y() / 2;
  switch (s.type) {
    case ShapeType::kPlane:
      return std::abs(p.z());
    case ShapeType::kSphere:
      return std::abs(p.norm() - r);
    case ShapeType::kCapsule:
      return std::abs((p - Vector3d(0, 0, std::clamp(p.z(), -half, half))).norm() - r);
    case ShapeType::kCylinder: {
      const double side = std::hypot(p.x(), p.y()) - r, cap = std::abs(p.z()) - half;
      return side > 0 && cap > 0 ? std::hypot(side, cap) : std::abs(std::max(side, cap));
    }
    case ShapeType::kBox: {
      const Vector3d beyond = p.cwiseAbs() - s.size / 2;
      return beyond.maxCoeff() > 0 ? beyond.cwiseMax(0).norm() : -beyond.maxCoeff();
    }
    case ShapeType::kEllipsoid: {
      const double value = p.cwiseQuotient(s.size).norm(), slope = p.cwiseQuotient(s.size.cwiseAbs2()).norm();
      return slope > 0 ? std::abs(value * (value - 1) / slope) : s.size.minCoeff();
    }
    default: {
      double most = -scene::kInfinity;
      for (const scene::Polytope::Face& face : convex.polytope.faces)
        most = std::max(most, face.n.dot(p - convex.X_BC.p) - face.d);
      return std::abs(most);
    }
  }
}

Placed place(const Convex& convex, const Pose& X_WB) { return {&convex, X_WB.R * convex.X_BC.R, X_WB * convex.X_BC.p}; }

const std::vector<Vector3d>& directions() {
  static const std::vector<Vector3d> all = [] {
    std::vector<Vector3d> n;
    constexpr int kCount = 500;
    for (int k = 0; k < kCount; ++k) {
      const double z = 1 - (2 * k + 1.0) / kCount, r = std::sqrt(1 - z * z), turn = 2.399963229728653 * k;
      n.emplace_back(r * std::cos(turn), r * std::sin(turn), z);
    }
    return n;
  }();
  return all;
}

/// Turned at random, with the same axes, with the same middle, or far away.
std::array<Pose, 2> random_poses(int kind, double scale, Random& random) {
  std::array<Pose, 2> X{Pose{}, Pose{}};
  const auto turn = [&](Pose& pose) { pose.R = random.pose(1).R; };
  if (kind < 3 || kind > 5) turn(X[0]), turn(X[1]);
  if (kind < 3) X[1].p = random.direction() * random.real(0, 1.5) * scale;
  if (kind == 3) X[1].p = (random.vector(2.5).array().round() * 0.1 * scale).matrix();
  if (kind == 4) X[1].p = Vector3d::Unit(static_cast<Eigen::Index>(random.real(0, 3))) * random.real(-0.3, 0.3) * scale;
  if (kind == 5) turn(X[1]);
  if (kind == 6) X[1].R = X[0].R;
  if (kind == 7) X[1].p = random.direction() * std::pow(10, random.real(0, 6)) * scale;
  return X;
}

TEST(Pairs, AreAsFarApartAsTheirPointsAndAPlaneSay) {
  Random random(1);
  Feature scratch;
  int overlaps = 0, coarse = 0, too_deep = 0;
  constexpr int kCount = 10000;
  for (int k = 0; k < kCount; ++k) {
    const double scale = k % 4 == 0 ? std::pow(10, std::round(random.real(-3, 3))) : 1;
    const auto type = [&](std::size_t types) {
      return kTypes[static_cast<std::size_t>(random.real(0, 1) * static_cast<double>(types))];
    };
    const Shape a = random_shape(type(kTypes.size()), scale, random), b = random_shape(type(kTypes.size() - 1), scale, random);
    const auto [X_a, X_b] = random_poses(k % 8, scale, random);
    const Convex A = make_convex(a), B = make_convex(b);
    const Placed placed_a = place(A, X_a), placed_b = place(B, X_b);
    const Distance found = distance(placed_a, placed_b, scratch);
    const double size = A.extent.norm() + A.round + B.extent.norm() + B.round, near = 1e-9 * size + 1e-14 * X_b.p.norm();
    SCOPED_TRACE(std::to_string(k) + ": " + std::to_string(static_cast<int>(a.type)) + " and " +
                 std::to_string(static_cast<int>(b.type)));
    ASSERT_TRUE(std::isfinite(found.d) && found.n.allFinite() && found.p_a.allFinite() && found.p_b.allFinite());
    ASSERT_NEAR(found.n.norm(), 1, 1e-12);
    ASSERT_LE((found.p_a + found.d * found.n - found.p_b).norm(), near);
    const double off = std::max(off_surface(a, A, X_a, found.p_a), off_surface(b, B, X_b, found.p_b));
    ASSERT_LE(off, 2e-6 * size);
    if (off > near) ++coarse;
    if (a.type == ShapeType::kPlane) continue;
    ASSERT_NEAR(gap_along(placed_a, placed_b, found.n) - A.round - B.round, found.d, 10 * near);
    if (found.d >= 0) continue;
    ++overlaps;
    double best = -scene::kInfinity;
    for (const Vector3d& n : directions()) best = std::max(best, gap_along(placed_a, placed_b, n) - A.round - B.round);
    ASSERT_LE(best, found.d + 0.02 * size);
    if (best > found.d + near) ++too_deep;
  }
  EXPECT_GT(overlaps, kCount / 4);
  EXPECT_LE(coarse, kCount / 1000);
  EXPECT_LE(too_deep, kCount / 2000);
}

// Where directions and points are not unique: 0 / 0 was "clear".
TEST(Pairs, AreFiniteOnAllAxesAndCentres) {
  std::vector<Shape> shapes;
  for (const ShapeType type :
       {ShapeType::kSphere, ShapeType::kCapsule, ShapeType::kCylinder, ShapeType::kBox, ShapeType::kEllipsoid}) {
    for (const Vector3d& size :
         {Vector3d(0.1, 0.1, 0.1), Vector3d(0.1, 0.1, 0.3), Vector3d(0.3, 0.1, 0.1), Vector3d(0.1, 0.3, 0.1),
          Vector3d(0.1, 0.2, 0.3), Vector3d(0, 0, 0), Vector3d(0.1, 0, 0), Vector3d(0, 0.1, 0.1)})
      shapes.push_back(shape(type, size));
  }
  std::vector<Convex> convex;
  for (const Shape& s : shapes) convex.push_back(make_convex(s));
  Feature scratch;
  int clear = 0;
  for (std::size_t i = 0; i < shapes.size(); ++i) {
    for (std::size_t j = 0; j < shapes.size(); ++j) {
      for (const int axis : {0, 1, 2}) {
        for (const double at : {0.0, 1e-300, 1e-17, 0.05, 0.2, 1.0}) {
          const Distance found =
              distance(place(convex[i], {}), place(convex[j], {Matrix3d::Identity(), at * Vector3d::Unit(axis)}), scratch);
          ASSERT_TRUE(std::isfinite(found.d) && found.n.allFinite() && found.p_a.allFinite() && found.p_b.allFinite())
              << i << " " << j << " axis " << axis << " at " << at;
          ASSERT_NEAR(found.n.norm(), 1, 1e-9);
          if (found.d > 0) ++clear;
        }
      }
    }
  }
  EXPECT_GT(clear, 900);
}

/// A ball in a spheroid: the least of the distances from many points of its surface.
double depth_in_ellipsoid(const Vector3d& radii, const Vector3d& p, double r) {
  double least = scene::kInfinity;
  constexpr int kCount = 200;
  for (int i = 0; i <= kCount; ++i) {
    for (int k = 0; k <= kCount; ++k) {
      const double u = M_PI * i / kCount, v = 2 * M_PI * k / kCount;
      const Vector3d q(std::sin(u) * std::cos(v), std::sin(u) * std::sin(v), std::cos(u));
      least = std::min(least, (q.cwiseProduct(radii) - p).norm());
    }
  }
  return least + r;
}

TEST(Pairs, OfABallOnTheLongAxisOfAnEllipsoidAreAsDeepAsItsSurfaceIsFar) {
  Feature scratch;
  for (const Vector3d& radii :
       {Vector3d(0.1, 0.1, 0.3), Vector3d(0.1, 0.1 + 1e-7, 0.3), Vector3d(0.3, 0.1, 0.1), Vector3d(0.1, 0.3, 0.1),
        Vector3d(0.3, 0.3, 0.1), Vector3d(0.1, 0.2, 0.3), Vector3d(0.2, 0.2, 0.2)}) {
    for (int axis = 0; axis < 3; ++axis) {
      for (const double share : {0.0, 0.3, 0.8, 0.9, 0.95}) {
        const Shape ball = shape(ShapeType::kSphere, {0.02, 0, 0}), ellipsoid = shape(ShapeType::kEllipsoid, radii);
        const Vector3d p = share * radii[axis] * Vector3d::Unit(axis);
        const Convex A = make_convex(ball), B = make_convex(ellipsoid);
        const Distance found = distance(place(A, {Matrix3d::Identity(), p}), place(B, {}), scratch);
        EXPECT_NEAR(found.d, -depth_in_ellipsoid(radii, p, 0.02), 1e-4) << radii.transpose() << " at " << p.transpose();
        EXPECT_LE(off_surface(ellipsoid, B, {}, found.p_b), 1e-12);
        EXPECT_LE(off_surface(ball, A, {Matrix3d::Identity(), p}, found.p_a), 1e-12);
      }
    }
  }
}

TEST(Pairs, OfACapsuleInAnEllipsoidLeaveItAcross) {
  const Shape capsule = shape(ShapeType::kCapsule, {0.02, 0.05, 0}), ellipsoid = shape(ShapeType::kEllipsoid, {0.1, 0.1, 0.3});
  const Convex A = make_convex(capsule), B = make_convex(ellipsoid);
  Feature scratch;
  EXPECT_NEAR(distance(place(A, {}), place(B, {}), scratch).d, -0.12, 1e-12);
}

TEST(Pairs, OfCapsulesWhoseAxesCrossHaveAFixedNormal) {
  Random random(2);
  const Convex one = make_convex(shape(ShapeType::kCapsule, {0.1, 0.5, 0})),
               other = make_convex(shape(ShapeType::kCapsule, {0.05, 0.4, 0}));
  Feature scratch;
  for (int k = 0; k < 1000; ++k) {
    const Pose X_a = random.pose(2);
    const double s = random.real(-0.2, 0.2), t = random.real(-0.15, 0.15);
    Pose X_b{random.pose(1).R, Vector3d::Zero()};
    X_b.p = X_a.p + s * X_a.R.col(2) - t * X_b.R.col(2);
    const Distance found = distance(place(one, X_a), place(other, X_b), scratch);
    EXPECT_NEAR(found.d, -0.15, 1e-12);
    EXPECT_TRUE(found.n.isApprox(X_a.R.col(2).cross(X_b.R.col(2)).normalized(), 1e-9)) << k;
  }
}

}  // namespace
}  // namespace cotwin::collision::pairs_test
