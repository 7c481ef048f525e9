#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/mechanics/pose.h"

namespace cotwin::mechanics_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

constexpr double kPi = 3.14159265358979323846;
constexpr double kUlp = std::numeric_limits<double>::epsilon();

std::mt19937_64& numbers() {
  static std::mt19937_64 generator(20170101);
  return generator;
}
double uniform(double low, double high) { return std::uniform_real_distribution<double>(low, high)(numbers()); }
Vector3d random_vector(double size) { return {uniform(-size, size), uniform(-size, size), uniform(-size, size)}; }
Matrix3d random_rotation() { return rotation_from_rpy(uniform(-kPi, kPi), uniform(-kPi, kPi), uniform(-kPi, kPi)); }
Pose random_pose() { return {random_rotation(), random_vector(1)}; }

struct PointMass {
  double mass;
  Vector3d p;
};
using PointMasses = std::vector<PointMass>;

PointMasses random_points(int count) {
  PointMasses points;
  for (int i = 0; i < count; ++i) points.push_back({uniform(0.1, 3), random_vector(0.5)});
  return points;
}

/// By definition: m = Σ mᵢ, c = Σ mᵢ pᵢ / m, I = Σ mᵢ (rᵢ·rᵢ U − rᵢ rᵢᵀ) with rᵢ = pᵢ − c.
Inertia summed(const PointMasses& points) {
  Inertia body;
  Vector3d m_c = Vector3d::Zero();
  for (const PointMass& point : points) {
    body.mass += point.mass;
    m_c += point.mass * point.p;
  }
  body.p_LC = m_c / body.mass;
  for (const PointMass& point : points) {
    const Vector3d r = point.p - body.p_LC;
    for (int row = 0; row < 3; ++row) {
      for (int column = 0; column < 3; ++column) {
        body.I_CC(row, column) += point.mass * ((row == column ? r.dot(r) : 0) - r[row] * r[column]);
      }
    }
  }
  return body;
}

PointMasses moved(const Pose& X, PointMasses points) {
  for (PointMass& point : points) point.p = X * point.p;
  return points;
}

/// A box of homogeneous density with its centre at L's origin: m/12 (b² + c²) and so on.
Inertia box(double mass, double a, double b, double c) {
  Inertia body{mass, Vector3d::Zero(), Matrix3d::Zero()};
  body.I_CC.diagonal() << mass / 12 * (b * b + c * c), mass / 12 * (a * a + c * c), mass / 12 * (a * a + b * b);
  return body;
}

Inertia with_moments(double mass, const Vector3d& moments, const Matrix3d& R = Matrix3d::Identity()) {
  Inertia body{mass, {}, moments.asDiagonal()};
  return Inertia{mass, Vector3d::Zero(), body.I_CC}.seen_from({R, Vector3d::Zero()});
}

void expect_near(const Inertia& a, const Inertia& b, double tolerance) {
  EXPECT_NEAR(a.mass, b.mass, tolerance * b.mass);
  EXPECT_LE((a.p_LC - b.p_LC).cwiseAbs().maxCoeff(), tolerance) << a.p_LC.transpose() << " and " << b.p_LC.transpose();
  EXPECT_LE((a.I_CC - b.I_CC).cwiseAbs().maxCoeff(), tolerance * b.mass) << a.I_CC << "\nand\n" << b.I_CC;
}

// Each of the sums below has about ten terms of order 1 (m, kg·m² per kg).
constexpr double kRounding = 100 * kUlp;

TEST(Pose, RollPitchYawTurnsAboutFixedAxesInThatOrder) {
  for (int i = 0; i < 1000; ++i) {
    const double roll = uniform(-kPi, kPi), pitch = uniform(-kPi, kPi), yaw = uniform(-kPi, kPi);
    const Matrix3d R = (Eigen::AngleAxisd(yaw, Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Vector3d::UnitY()) *
                        Eigen::AngleAxisd(roll, Vector3d::UnitX()))
                           .toRotationMatrix();
    EXPECT_TRUE(rotation_from_rpy(roll, pitch, yaw).isApprox(R, kRounding));
  }
  // A quarter turn about x takes y to z.
  EXPECT_TRUE((rotation_from_rpy(kPi / 2, 0, 0) * Vector3d::UnitY()).isApprox(Vector3d::UnitZ(), kRounding));
}

TEST(Pose, ChainsCancelAndInvert) {
  for (int i = 0; i < 1000; ++i) {
    const Pose X_AB = random_pose(), X_BC = random_pose();
    const Vector3d p_CQ = random_vector(1);
    EXPECT_TRUE(((X_AB * X_BC) * p_CQ).isApprox(X_AB * (X_BC * p_CQ), kRounding));
    const Pose back = X_AB * X_AB.inverse();
    EXPECT_TRUE(back.R.isIdentity(kRounding));
    EXPECT_TRUE(back.p.isZero(kRounding));
  }
}

TEST(Pose, RotationsAreOrthonormalAndRightHanded) {
  for (int i = 0; i < 1000; ++i) EXPECT_TRUE(is_rotation(random_rotation()));
  EXPECT_FALSE(is_rotation(-Matrix3d::Identity()));  // a reflection
  EXPECT_FALSE(is_rotation(1.001 * Matrix3d::Identity()));
  EXPECT_FALSE(is_rotation(Matrix3d::Constant(std::numeric_limits<double>::quiet_NaN())));
}

TEST(Inertia, OfACompositeBodyIsThatOfAllItsPoints) {
  for (int i = 0; i < 1000; ++i) {
    const PointMasses one = random_points(5), other = random_points(7);
    PointMasses all = one;
    all.insert(all.end(), other.begin(), other.end());
    expect_near(summed(one) + summed(other), summed(all), kRounding);
  }
}

TEST(Inertia, SeenFromAnotherFrameIsThatOfTheMovedPoints) {
  for (int i = 0; i < 1000; ++i) {
    const PointMasses points = random_points(6);
    const Pose X_AL = random_pose();
    expect_near(summed(points).seen_from(X_AL), summed(moved(X_AL, points)), kRounding);
    expect_near(summed(points).seen_from(X_AL).seen_from(X_AL.inverse()), summed(points), kRounding);
  }
}

TEST(Inertia, AboutTheOriginIsTheSecondMomentThere) {
  for (int i = 0; i < 1000; ++i) {
    const PointMasses points = random_points(6);
    Matrix3d I_LL = Matrix3d::Zero();
    for (const PointMass& point : points) {
      I_LL += point.mass * (point.p.squaredNorm() * Matrix3d::Identity() - point.p * point.p.transpose());
    }
    const Inertia body = summed(points);
    EXPECT_LE((body.about_origin() - I_LL).cwiseAbs().maxCoeff(), kRounding * body.mass);
  }
}

TEST(Inertia, ParametersAreLinearInTheMassDistribution) {
  for (int i = 0; i < 1000; ++i) {
    const Inertia a = summed(random_points(4)), b = summed(random_points(5));
    EXPECT_TRUE((a + b).parameters().isApprox(a.parameters() + b.parameters(), kRounding));
    expect_near(Inertia::from_parameters(a.parameters()), a, kRounding);
  }
  const Eigen::Matrix<double, 10, 1> nothing = Eigen::Matrix<double, 10, 1>::Zero();
  EXPECT_EQ(Inertia::from_parameters(nothing), Inertia{});
}

TEST(Inertia, OfBoxesGluedTogetherIsThatOfTheWholeBox) {
  // Two cubes of 0.2 m side by side along x make a box of 0.4 x 0.2 x 0.2 m.
  const Inertia cube = box(3, 0.2, 0.2, 0.2);
  const auto at = [](double x) { return Pose{Matrix3d::Identity(), {x, 0, 0}}; };
  expect_near(cube.seen_from(at(-0.1)) + cube.seen_from(at(0.1)), box(6, 0.4, 0.2, 0.2), kRounding);
}

TEST(Inertia, OfNothingAddedChangesNothing) {
  const Inertia body = summed(random_points(5));
  const Inertia frame = Inertia{}.seen_from(random_pose());
  EXPECT_EQ(body + frame, body);
  EXPECT_EQ(frame + body, body);
}

TEST(Inertia, StaysSymmetricToTheLastBit) {
  Inertia body = summed(random_points(5));
  for (int i = 0; i < 100; ++i) {
    body = body.seen_from(random_pose()) + summed(random_points(3)).seen_from(random_pose());
    EXPECT_EQ(body.I_CC, body.I_CC.transpose());
    EXPECT_EQ(body.about_origin(), body.about_origin().transpose());
    body = Inertia::from_parameters(body.parameters());
    EXPECT_EQ(body.I_CC, body.I_CC.transpose());
  }
}

TEST(Inertia, OfAnyBodyOfPointMassesIsPhysical) {
  for (int i = 0; i < 10000; ++i) {
    const Inertia body = summed(random_points(4)).seen_from(random_pose());  // four random points span space almost surely
    EXPECT_EQ(body.unphysical(), "") << body.I_CC;
  }
}

TEST(Inertia, OfALaminaRoundedToThreeDigitsIsPhysical) {
  // A lamina is on the border: J₁ + J₂ = J₃.
  EXPECT_EQ(with_moments(1, {0.0124, 0.0234, 0.0358}, random_rotation()).unphysical(), "");
  EXPECT_EQ(with_moments(1, {0.0124, 0.0234, 0.03585}).unphysical(), "");
}

TEST(Inertia, ThatIsUnphysicalIsReported) {
  const auto why = [](const Inertia& body) { return body.unphysical(); };
  EXPECT_EQ(why(Inertia{}), "mass 0 kg, expected > 0");
  EXPECT_EQ(why(with_moments(-1, {1, 1, 1})), "mass -1 kg, expected > 0");
  EXPECT_EQ(why(with_moments(1, {0, 0, 0})), "no moments of inertia, expected > 0 kg m2");
  EXPECT_EQ(why(with_moments(1, {0.1, 0.1, 0.3})), "principal moments 0.1, 0.1, 0.3 kg m2 violate the triangle inequality");
  EXPECT_EQ(why(with_moments(1, {-0.1, 0.2, 0.2})), "principal moments -0.1, 0.2, 0.2 kg m2 are not all > 0");
  EXPECT_EQ(why(with_moments(1, {0, 0.2, 0.2})),
            "principal moments 0, 0.2, 0.2 kg m2 are not all > 0");  // a rod without thickness
  EXPECT_EQ(why(with_moments(std::numeric_limits<double>::infinity(), {1, 1, 1})),
            "mass, centre of mass or inertia is not finite");
  // Of a part of a body.
  const auto part = [](const Inertia& body) { return body.unphysical(Inertia::Least::kZero); };
  for (const Vector3d& J : {Vector3d(0, 0, 0), Vector3d(0, 0.2, 0.2), Vector3d(0.1, 0.1, 0.2), Vector3d(-1e-6, 0.1, 0.1)})
    EXPECT_EQ(part(with_moments(1, J)), "");
  for (const Inertia& none : {with_moments(1, {-0.1, 0.2, 0.2}), with_moments(1, {0, 0.1, 0.2}), with_moments(0, {0, 0, 0}),
                              with_moments(-1, {0, 0, 0})})
    EXPECT_NE(part(none), "");
  Inertia skew = with_moments(1, {1, 1, 1});
  skew.I_CC(0, 1) = 0.1;
  EXPECT_EQ(why(skew), "the inertia matrix is not symmetric");
}

TEST(Inertia, ViolatingTheTriangleInequalityIsFoundInAnyOrientationAndScale) {
  for (int i = 0; i < 10000; ++i) {
    const double scale = std::pow(10, uniform(-12, 12));
    const double J1 = uniform(0.01, 1), J2 = uniform(0.01, 1);
    const Matrix3d R = random_rotation();
    // 0.2 % beyond the border is a violation, 0.1 % is rounding to three digits.
    EXPECT_NE(with_moments(1, scale * Vector3d(J1, J2, 1.002 * (J1 + J2)), R).unphysical(), "");
    EXPECT_EQ(with_moments(1, scale * Vector3d(J1, J2, 1.001 * (J1 + J2)), R).unphysical(), "");
  }
}

}  // namespace
}  // namespace cotwin::mechanics_test
