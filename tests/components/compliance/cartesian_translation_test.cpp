// Mass, damping and stiffness in three directions: Propagator, modal_damping and the tank in matrix form.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <cmath>
#include <unsupported/Eigen/MatrixFunctions>

#include "components/compliance/cartesian/frame/parameters.h"
#include "components/compliance/cartesian/frame/translation.h"
#include "components/compliance/joints/second_order.h"

namespace cotwin::compliance::cartesian_translation_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

Matrix3d symmetric_of(const Vector3d& d, const Vector3d& off) {
  Matrix3d A;
  A << d[0], off[0], off[1], off[0], d[1], off[2], off[1], off[2], d[2];
  return A;
}
const Matrix3d kMass = symmetric_of({2, 3, 1.5}, {0.4, -0.3, 0.2});
const Matrix3d kStiffness = symmetric_of({1500, 1000, 500}, {200, -150, 80});

struct Motion {
  Vector3d x = Vector3d::Zero(), dx = Vector3d::Zero();
};
Motion after(const Impedance& z, Motion m, const Vector3d& u0, const Vector3d& u1, double h, int steps) {
  Propagator p;
  p.prepare(z, h);
  for (int k = 0; k < steps; ++k) p.advance(m.x, m.dx, u0 + u1 * (k * h), u1);
  return m;
}

TEST(CartesianTranslation, FollowsTheClosedFormOfEveryModeAtTheAperiodicLimit) {
  // x = V y with Vᵀ M V = I, Vᵀ S V = Λ: ÿ + 2 ω ẏ + ω² y = vᵀ u, from rest y = vᵀu/ω² (1 − (1 + ω t) e^(−ω t)).
  const Eigen::GeneralizedSelfAdjointEigenSolver<Matrix3d> modes(kStiffness, kMass);
  const Matrix3d V = modes.eigenvectors();
  const Impedance z{kMass, modal_damping(kMass, kStiffness, 1, 0), kStiffness};
  const Vector3d u(60, -40, 25);
  for (const double h : {1e-4, 1e-3, 0.05, 1.0}) {
    const int steps = static_cast<int>(std::lround(1 / h));
    const Motion m = after(z, {}, u, Vector3d::Zero(), h, steps);
    Vector3d y;
    for (int i = 0; i < 3; ++i) {
      const double w = std::sqrt(modes.eigenvalues()[i]);
      y[i] = V.col(i).dot(u) / (w * w) * (1 - (1 + w) * std::exp(-w));
    }
    EXPECT_LT((m.x - V * y).norm(), 1e-12 * (V * y).norm() * (1 + 1e-3 * steps)) << h;
  }
}

TEST(CartesianTranslation, AgreesWithTheMatrixExponentialForDampingThatIsNotModal) {
  const Matrix3d D = symmetric_of({20, 90, 5}, {15, 3, -8});
  const Impedance z{kMass, D, kStiffness};
  Eigen::Matrix<double, 12, 12> A = Eigen::Matrix<double, 12, 12>::Zero();  // x, ẋ, u, u̇
  const Matrix3d inverse = kMass.inverse();
  A.block<3, 3>(0, 3).setIdentity();
  A.block<3, 3>(3, 0) = -inverse * kStiffness;
  A.block<3, 3>(3, 3) = -inverse * D;
  A.block<3, 3>(3, 6) = inverse;
  A.block<3, 3>(6, 9).setIdentity();
  for (const double h : {1e-3, 0.03, 0.4}) {
    Eigen::Matrix<double, 12, 1> s;
    s << 0.01, -0.02, 0.03, 0.4, 0.1, -0.3, 10, -20, 5, 100, 30, -70;
    const Motion m = after(z, {s.head<3>(), s.segment<3>(3)}, s.segment<3>(6), s.tail<3>(), h, 1);
    const Eigen::Matrix<double, 12, 1> e = Eigen::Matrix<double, 12, 12>(A * h).exp() * s;
    EXPECT_LT((m.x - e.head<3>()).norm(), 1e-13) << h;
    EXPECT_LT((m.dx - e.segment<3>(3)).norm(), 1e-12) << h;
  }
}

TEST(CartesianTranslation, DiagonalMatricesGiveThreeSingleMotions) {
  const Vector3d M(1, 10, 0.2), D(77.45, 0, 44.72), S(1500, 0, 500), u0(60, -1, 3), u1(0, 5, -2);
  const Impedance z{M.asDiagonal(), D.asDiagonal(), S.asDiagonal()};
  const Motion start{{0.01, 0.02, -0.01}, {0.1, -0.3, 0}};
  const Motion m = after(z, start, u0, u1, 0.02, 1);
  for (int i = 0; i < 3; ++i) {
    const Deviation d = advance(SecondOrder{M[i], D[i], S[i]}, {start.x[i], start.dx[i]}, u0[i], u1[i], 0.02);
    EXPECT_NEAR(m.x[i], d.x, 1e-15);
    EXPECT_NEAR(m.dx[i], d.dx, 1e-14);
  }
}

TEST(CartesianTranslation, OneLongStepIsManyShortOnesAlsoForStiffAndFreeDirections) {
  const Matrix3d M = symmetric_of({1, 1, 0.01}, {0, 0, 0}), S = symmetric_of({1e6, 0, 10}, {0, 100, 0});
  const Impedance z{M, modal_damping(M, S, 0.7, 2), S};
  const Motion start{{0.01, 0.02, -0.01}, {0.1, -0.3, 0.2}};
  const Motion one = after(z, start, {1, 2, 3}, {4, 5, 6}, 0.5, 1);
  const Motion many = after(z, start, {1, 2, 3}, {4, 5, 6}, 0.5 / 512, 512);
  EXPECT_LT((one.x - many.x).norm(), 1e-10);
  EXPECT_LT((one.dx - many.dx).norm(), 1e-9);
}

TEST(CartesianTranslation, ModalDampingIsTwoRootsOfStiffnessTimesMassAndAtLeastThatOfAFreeMode) {
  const Matrix3d D = modal_damping(Vector3d(1, 4, 9).asDiagonal(), Vector3d(1500, 0, 4).asDiagonal(), 0.5, 2);
  const Vector3d expected(std::sqrt(1500.0), 4.0 * 2, 9.0 * 2);
  EXPECT_LT((D - Matrix3d(expected.asDiagonal())).norm(), 1e-12);
}

TEST(CartesianTranslation, ChangesOfMassAndStiffnessNeverAddMoreEnergyThanTheTankGives) {
  CartesianParameters now, wanted;
  wanted.M_T = {30, 5, 10};
  wanted.M_T_off = {2, -1, 0.5};
  wanted.S_T = {5000, 100, 1000};
  wanted.S_T_off = {300, -100, 50};
  const Vector3d x(0.05, -0.04, 0.03), dx(0.3, 0.2, -0.4);
  const auto energy = [&] {
    return (dx.dot(symmetric(now.M_T, now.M_T_off) * dx) + x.dot(symmetric(now.S_T, now.S_T_off) * x)) / 2;
  };
  for (const double start : {0.0, 0.3, 5.0}) {
    now = CartesianParameters();
    Tank tank{start, 10};
    bool paid = true;
    for (int n = 0; n < 200; ++n) {
      const double before = energy() + tank.energy;
      paid = change(now, wanted, kTranslation, 0.95, {x, dx}, tank) && paid;
      EXPECT_LE(energy() + tank.energy, before + 1e-12);
      EXPECT_GE(tank.energy, 0);
      EXPECT_NO_THROW(check_definite(now, "test"));
    }
    EXPECT_EQ(paid, start == 5.0);
    const double left = (symmetric(wanted.S_T, wanted.S_T_off) - symmetric(now.S_T, now.S_T_off)).norm();
    EXPECT_EQ(left < 1, start == 5.0) << left;
  }
}

}  // namespace
}  // namespace cotwin::compliance::cartesian_translation_test
