#include "models/identification/log_cholesky.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>

#include "models/foundation/support/error.h"
#include "tests/models/robot/random_robots.h"

namespace cotwin::identification::log_cholesky_test {
namespace {

using Eigen::Matrix4d;
using Eigen::Vector3d;
using robot::testing::Draw;

Vector10d random_xi(Draw& draw, double reach) { return draw.numbers(10, -reach, reach); }

TEST(PseudoInertia, IsTheSecondMomentOfTheMassInHomogeneousCoordinates) {
  // ∫ [r; 1] [r; 1]ᵀ dm of point masses, summed directly, compared with the body that they form.
  Draw draw(3);
  Matrix4d P = Matrix4d::Zero();
  Inertia body;
  for (int i = 0; i < 20; ++i) {
    const double m = draw.number(0.1, 2);
    const Vector3d r = draw.numbers(3, -1, 1);
    P += m * r.homogeneous() * r.homogeneous().transpose();
    Inertia point;
    point.mass = m;
    point.p_LC = r;
    body = body + point;
  }
  EXPECT_LT((pseudo_inertia(body.parameters()) - P).norm(), 1e-13 * P.norm());
  EXPECT_LT((from_pseudo_inertia(P) - body.parameters()).norm(), 1e-13 * P.norm());
}

TEST(LogCholesky, HasThePriorAtItsOrigin) {
  Draw draw(1);
  for (int i = 0; i < 100; ++i) {
    const Inertia prior = draw.inertia();
    const LogCholesky body(prior);
    EXPECT_LT((body.parameters(Vector10d::Zero()) - prior.parameters()).norm(), 1e-14 * (1 + prior.parameters().norm()));
  }
}

TEST(LogCholesky, GivesAPhysicalBodyForAnyCoordinates) {
  Draw draw(2);
  for (int i = 0; i < 5000; ++i) {
    const LogCholesky body(draw.inertia());
    const Vector10d pi = body.parameters(random_xi(draw, 3));
    const Inertia inertia = Inertia::from_parameters(pi);
    ASSERT_EQ(inertia.unphysical(), "") << "case " << i;
    ASSERT_GT(inertia.mass, 0);
  }
}

// e^(2α) scales mass and moments alike; t moves the centre of mass by standard deviations.
TEST(LogCholesky, CoordinatesHaveTheirDocumentedMeaning) {
  Inertia prior;
  prior.mass = 2;
  prior.p_LC = {0.1, 0.2, 0.3};
  const Vector3d deviation(0.03, 0.04, 0.05);  // of the mass distribution
  const Vector3d s = 2 * deviation.cwiseAbs2();
  prior.I_CC = Vector3d(s[1] + s[2], s[0] + s[2], s[0] + s[1]).asDiagonal();
  const LogCholesky body(prior);
  Vector10d xi = Vector10d::Zero();
  xi[0] = 0.5 * std::log(1.5);
  const Inertia heavier = Inertia::from_parameters(body.parameters(xi));
  EXPECT_NEAR(heavier.mass, 3, 1e-14);
  EXPECT_LT((heavier.p_LC - prior.p_LC).norm(), 1e-14);
  EXPECT_LT((heavier.I_CC - 1.5 * prior.I_CC).norm(), 1e-14);

  xi.setZero();
  xi.tail<3>() = Vector3d(1, -2, 0.5);
  const Inertia moved = Inertia::from_parameters(body.parameters(xi));
  EXPECT_NEAR(moved.mass, 2, 1e-14);
  EXPECT_LT((moved.p_LC - prior.p_LC - Vector3d(0.03, -0.08, 0.025)).norm(), 1e-14);
  EXPECT_LT((moved.I_CC - prior.I_CC).norm(), 1e-14);

  xi.setZero();
  xi[1] = std::log(2.0);
  const Inertia wider = Inertia::from_parameters(body.parameters(xi));
  EXPECT_NEAR(wider.I_CC(0, 0), prior.I_CC(0, 0), 1e-15);
  EXPECT_NEAR(wider.I_CC(1, 1), 4 * s[0] + s[2], 1e-15);
}

TEST(LogCholesky, DerivativesAreThoseOfTheParameters) {
  Draw draw(5);
  for (int i = 0; i < 200; ++i) {
    const LogCholesky body(draw.inertia());
    const Vector10d xi = random_xi(draw, 1.5);
    Matrix10d by_xi;
    const Vector10d pi = body.parameters(xi, by_xi);
    EXPECT_EQ((pi - body.parameters(xi)).norm(), 0);
    constexpr double kStep = 1e-6;
    for (int k = 0; k < 10; ++k) {
      const Vector10d step = kStep * Vector10d::Unit(k);
      const Vector10d difference = (body.parameters(xi + step) - body.parameters(xi - step)) / (2 * kStep);
      ASSERT_LT((difference - by_xi.col(k)).norm(), 1e-8 * (1 + by_xi.norm())) << "case " << i << ", coordinate " << k;
    }
  }
}

// D = tr(P_0⁻¹ P) − log det(P_0⁻¹ P) − 4 by matrices, for any prior.
TEST(Divergence, IsTheSumOfItsRootsSquared) {
  Draw draw(6);
  for (int i = 0; i < 200; ++i) {
    const Inertia prior = draw.inertia();
    const LogCholesky body(prior);
    const Vector10d xi = random_xi(draw, i < 100 ? 1.5 : 0.02);
    Matrix10d by_xi;
    const Vector10d roots = divergence_roots(xi, by_xi);
    const Matrix4d ratio = pseudo_inertia(prior.parameters()).inverse() * pseudo_inertia(body.parameters(xi));
    const double expected = ratio.trace() - std::log(ratio.determinant()) - 4;
    EXPECT_NEAR(roots.squaredNorm(), expected, 1e-9 * (1 + expected));
    constexpr double kStep = 1e-6;
    Matrix10d unused;
    for (int k = 0; k < 10; ++k) {
      const Vector10d step = kStep * Vector10d::Unit(k);
      const Vector10d difference = (divergence_roots(xi + step, unused) - divergence_roots(xi - step, unused)) / (2 * kStep);
      ASSERT_LT((difference - by_xi.col(k)).norm(), 2e-8 * (1 + by_xi.norm())) << i << ", " << k;
    }
  }
  Matrix10d at_origin;
  EXPECT_EQ(divergence_roots(Vector10d::Zero(), at_origin).norm(), 0);
  EXPECT_TRUE(at_origin.allFinite());
}

TEST(Consistent, LeavesPhysicalBodiesAndRepairsOthers) {
  Draw draw(7);
  const Inertia good = draw.inertia();
  EXPECT_EQ(consistent(good), good);

  Inertia point;  // mass without extent, as in a drawing
  point.mass = 3;
  point.p_LC = {0.1, 0, 0};
  Inertia flat;  // principal moments that violate the triangle inequality
  flat.mass = 1;
  flat.I_CC = Vector3d(0.01, 0.01, 0.05).asDiagonal();
  for (const Inertia& bad : {Inertia{}, point, flat}) {
    EXPECT_THROW(LogCholesky{bad}, Error);
    const Inertia repaired = consistent(bad);
    EXPECT_EQ(repaired.unphysical(), "");
    EXPECT_NO_THROW(LogCholesky{repaired});
    EXPECT_EQ(repaired.p_LC, bad.p_LC);
    if (bad.mass > 0) {
      EXPECT_EQ(repaired.mass, bad.mass);
    }
  }
}

}  // namespace
}  // namespace cotwin::identification::log_cholesky_test
