// (3b) on unit quaternions: reference figures of independent code (numpy, RK4 at 0.1 ms), closed forms, energy.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <cmath>
#include <cstring>
#include <random>

#include "components/compliance/cartesian/frame/rotation.h"

namespace cotwin::compliance::cartesian_rotation_test {
namespace {

using Eigen::Matrix3d;
using Eigen::Quaterniond;
using Eigen::Vector3d;

Turned advance(Potential potential, const Impedance& z, const Turn& start, const Vector3d& m0, const Vector3d& m1, double h) {
  RotationStep step;
  step.prepare(z, h);
  return step.advance(potential, start, m0, m1);
}

Impedance aperiodic(const Matrix3d& S) { return {Matrix3d::Identity(), modal_damping(Matrix3d::Identity(), S, 1, 0), S}; }
Impedance uniform(double k) { return aperiodic(k * Matrix3d::Identity()); }

Turn at_rest_under(Potential potential, const Impedance& z, const Vector3d& m, double h = 1e-3, double seconds = 4) {
  Turn turn;
  for (int n = 0; n < std::lround(seconds / h); ++n) turn = advance(potential, z, turn, m, Vector3d::Zero(), h).turn;
  return turn;
}

double energy(Potential potential, const Impedance& z, const Turn& t) {
  return t.w.dot(z.M * t.w) / 2 + potential_energy(potential, z.S, t.Q);
}

TEST(CartesianRotation, AMomentTurnsByArcsinOfMomentOverStiffness) {
  const Impedance z = uniform(500);
  const std::pair<double, double> reference[] = {{10, 0.0200013}, {100, 0.201358}, {250, 0.523599}, {400, 0.9273}};
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  for (const auto& [m, angle] : reference) {
    const Vector3d phi = axis_angle(at_rest_under(Potential::kQuaternion, z, m * axis).Q);
    EXPECT_NEAR(phi.norm(), std::asin(m / 500), 1e-6) << m;
    EXPECT_NEAR(phi.norm(), angle, 1e-4) << m;
    EXPECT_LT(phi.cross(axis).norm(), 1e-9) << m;
  }
}

TEST(CartesianRotation, SmallAnglesByTheirSeriesJoinThoseOfTheClosedForms) {
  const Vector3d axis = Vector3d(1, -2, 0.5).normalized();
  for (double angle = 1e-12; angle < 3; angle *= 1.07) {
    const Quaterniond Q = quaternion_of(angle * axis);
    EXPECT_NEAR(Q.w(), std::cos(angle / 2), 3e-16) << angle;
    EXPECT_LT((Q.vec() - std::sin(angle / 2) * axis).norm(), 5e-16 * angle) << angle;
    EXPECT_LT((axis_angle(Q) - angle * axis).norm(), 2e-15 * angle) << angle;
  }
}

TEST(CartesianRotation, TheLogarithmTurnsInProportionToTheMoment) {
  const Impedance z = uniform(500);
  for (const double m : {10.0, 400.0, 1200.0}) {
    EXPECT_NEAR(axis_angle(at_rest_under(Potential::kLog, z, {0, m, 0}).Q).y(), m / 500, 1e-6) << m;
  }
}

TEST(CartesianRotation, UnequalStiffnessesTurnAsInTheReference) {
  const Impedance z = aperiodic(Vector3d(800, 500, 200).asDiagonal());
  const Vector3d phi = axis_angle(at_rest_under(Potential::kQuaternion, z, {60, 60, 60}).Q);
  EXPECT_NEAR(phi.norm(), 0.340482, 1e-6);
  EXPECT_LT((phi.normalized() - Vector3d(0.24313, 0.3133, 0.9180)).norm(), 1e-4);
}

TEST(CartesianRotation, PrincipalAxesMayPointAnywhere) {
  const Matrix3d R = Quaterniond(0.3, 0.5, -0.7, 0.4).normalized().toRotationMatrix();
  const Matrix3d S = R * Vector3d(800, 500, 200).asDiagonal() * R.transpose();
  const Vector3d m = R * Vector3d(60, 60, 60);
  const Vector3d phi =
      R.transpose() * axis_angle(at_rest_under(Potential::kQuaternion, aperiodic((S + S.transpose()) / 2), m).Q);
  EXPECT_LT((phi - 0.340482 * Vector3d(0.24313, 0.3133, 0.9180)).norm(), 1e-4);
}

TEST(CartesianRotation, TheEnergyBalanceClosesInThreeSeconds) {
  // The work and the dissipation by the trapezoidal rule on the motion itself.
  Impedance z = aperiodic(Vector3d(800, 500, 200).asDiagonal());
  z.M = Vector3d(1, 2, 0.5).asDiagonal();
  for (const Potential potential : {Potential::kQuaternion, Potential::kLog}) {
    Turn t;
    double work = 0, dissipated = 0;
    const double h = 2e-5;
    for (int n = 0; n < 150000; ++n) {
      const double time = n * h;
      const Vector3d m0(60 * std::sin(3 * time), 60 * std::cos(2 * time), 60);
      const Vector3d m1(60 * std::sin(3 * (time + h)), 60 * std::cos(2 * (time + h)), 60);
      const Turn next = advance(potential, z, t, m0, (m1 - m0) / h, h).turn;
      work += h / 2 * (m0.dot(t.w) + m1.dot(next.w));
      dissipated += h / 2 * (t.w.dot(z.D * t.w) + next.w.dot(z.D * next.w));
      t = next;
    }
    EXPECT_GT(work, 5);
    EXPECT_LT(std::abs(energy(potential, z, t) - work + dissipated), 1e-6 * work);
  }
}

TEST(CartesianRotation, KeepsItsEnergyToRoundingInLongStepsWithoutDamping) {
  Impedance z{Vector3d(1, 2, 0.5).asDiagonal(), Matrix3d::Zero(), Vector3d(800, 500, 200).asDiagonal()};
  z.S(0, 1) = z.S(1, 0) = 120;
  for (const Potential potential : {Potential::kQuaternion, Potential::kLog}) {
    Turn t{quaternion_of({0.4, -0.8, 0.5}), {2, 1, -3}};
    const double before = energy(potential, z, t);
    for (int n = 0; n < 5000; ++n) t = advance(potential, z, t, Vector3d::Zero(), Vector3d::Zero(), 5e-3).turn;
    EXPECT_NEAR(energy(potential, z, t), before, 1e-10 * before);
    EXPECT_NEAR(t.Q.norm(), 1, 1e-14);
  }
}

TEST(CartesianRotation, AgreesWithRungeKuttaOnTheEquationAsPrinted) {
  const Impedance z{Vector3d(1, 2, 0.5).asDiagonal(), Vector3d(10, 5, 20).asDiagonal(), Vector3d(800, 500, 200).asDiagonal()};
  using State = Eigen::Matrix<double, 7, 1>;  // η, ε, Δω
  const Vector3d m(60, -30, 80);
  const auto rate = [&](const State& s) {
    const double eta = s[0];
    const Vector3d e = s.segment<3>(1), w = s.tail<3>();
    Matrix3d E;
    E << eta, e.z(), -e.y(), -e.z(), eta, e.x(), e.y(), -e.x(), eta;
    State d;
    d << -0.5 * e.dot(w), 0.5 * E * w, z.M.inverse() * (m - z.D * w - 2 * E.transpose() * z.S * e);
    return d;
  };
  State s;
  s << 1, 0, 0, 0, 0, 0, 0;
  for (int n = 0; n < 20000; ++n) {
    const double h = 5e-5;
    const State a = rate(s), b = rate(s + h / 2 * a), c = rate(s + h / 2 * b), d = rate(s + h * c);
    s += h / 6 * (a + 2 * b + 2 * c + d);
  }
  double error[2];
  for (int k = 0; k < 2; ++k) {
    const double h = k == 0 ? 1e-3 : 5e-4;
    const Turn t = at_rest_under(Potential::kQuaternion, z, m, h, 1);
    error[k] = (t.Q.vec() - s.segment<3>(1)).norm() + (t.w - s.tail<3>()).norm() / 30;
  }
  EXPECT_LT(error[0], 2e-4);
  EXPECT_NEAR(error[0] / error[1], 4, 0.3);  // second order
}

TEST(CartesianRotation, SettlesToTwoPercentWithoutOvershootAtTheAperiodicLimit) {
  const Impedance z = uniform(500);
  const double angle = std::asin(10.0 / 500);
  Turn t;
  double settled = 0, highest = 0;
  for (int n = 1; n <= 1000; ++n) {
    t = advance(Potential::kQuaternion, z, t, {0, 0, 10}, Vector3d::Zero(), 1e-3).turn;
    const double phi = axis_angle(t.Q).z();
    highest = std::max(highest, phi);
    if (phi < 0.98 * angle) settled = n * 1e-3;
  }
  EXPECT_NEAR(settled, 0.261, 1.5e-3);
  EXPECT_LT(highest, angle * (1 + 1e-6));
}

TEST(CartesianRotation, StrongDampingBrakesWithoutRinging) {
  const Impedance z{Matrix3d::Identity(), 1e5 * Matrix3d::Identity(), 100 * Matrix3d::Identity()};
  Turn t{Quaterniond(1, 0, 0, 0), {10, 0, 0}};
  for (int n = 0; n < 5; ++n) t = advance(Potential::kQuaternion, z, t, Vector3d::Zero(), Vector3d::Zero(), 1e-3).turn;
  EXPECT_LT(std::abs(t.w.x()), 1e-3);
  EXPECT_NEAR(axis_angle(t.Q).x(), 1e-4, 1e-5);
}

TEST(CartesianRotation, MakesNoEnergyWhereParametersAreFarTooFastForTheStep) {
  for (const double k : {1e6, 1e9, 1e12}) {
    for (const double zeta : {0.0, 0.01, 1.0}) {
      Impedance z{1e-3 * Matrix3d::Identity(), Matrix3d::Zero(), Vector3d(k, k / 3, k / 10).asDiagonal()};
      z.D = modal_damping(z.M, z.S, zeta, 0);
      Turn t{quaternion_of({0.4, -0.8, 0.5}), {2, 1, -3}};
      const double before = energy(Potential::kQuaternion, z, t);
      for (int n = 0; n < 500; ++n) {
        t = advance(Potential::kQuaternion, z, t, Vector3d::Zero(), Vector3d::Zero(), 1e-2).turn;
        ASSERT_LT(energy(Potential::kQuaternion, z, t), before * (1 + 1e-3)) << k << ' ' << zeta << ' ' << n;
      }
    }
  }
}

TEST(CartesianRotation, ReturnsFromAlmostEveryOrientation) {
  std::mt19937 generator(3);
  std::normal_distribution<double> normal;
  const Impedance z = aperiodic(Vector3d(800, 500, 200).asDiagonal());
  for (int k = 0; k < 50; ++k) {
    const Quaterniond Q(normal(generator), normal(generator), normal(generator), normal(generator));
    Turn t{Q.normalized(), {normal(generator), normal(generator), normal(generator)}};
    if (t.Q.w() < 0) t.Q.coeffs() *= -1;
    for (int n = 0; n < 5000; ++n) t = advance(Potential::kQuaternion, z, t, Vector3d::Zero(), Vector3d::Zero(), 1e-3).turn;
    EXPECT_LT(axis_angle(t.Q).norm(), 1e-6) << k;
  }
}

TEST(CartesianRotation, TheElasticMomentIsTheGradientOfThePotential) {
  // U along exp(t a) Q, a in the axes of the desired frame.
  const Matrix3d S = (Matrix3d() << 800, 100, -50, 100, 500, 30, -50, 30, 200).finished();
  const Vector3d a = Vector3d(0.3, -0.5, 0.8);
  for (const Potential potential : {Potential::kQuaternion, Potential::kLog}) {
    for (const double angle : {0.01, 0.3, 1.5, 3.0}) {
      const Quaterniond Q = quaternion_of(angle * Vector3d(2, 1, -1).normalized());
      constexpr double d = 1e-5;
      const double slope = (potential_energy(potential, S, quaternion_of(d * a) * Q) -
                            potential_energy(potential, S, quaternion_of(-d * a) * Q)) /
                           (2 * d);
      EXPECT_NEAR(elastic_moment(potential, S, Q).dot(a), slope, 1e-5) << angle;
    }
  }
}

TEST(CartesianRotation, QAndMinusQHaveTheSameBits) {
  const Impedance z = aperiodic(Vector3d(800, 500, 200).asDiagonal());
  const Turn plus{quaternion_of({0.4, -0.8, 0.5}), {2, 1, -3}};
  const Turn minus{Quaterniond(-plus.Q.coeffs()), plus.w};
  const Turn a = advance(Potential::kQuaternion, z, plus, {1, 2, 3}, {4, 5, 6}, 1e-3).turn;
  const Turn b = advance(Potential::kQuaternion, z, minus, {1, 2, 3}, {4, 5, 6}, 1e-3).turn;
  EXPECT_EQ(std::memcmp(a.Q.coeffs().data(), b.Q.coeffs().data(), 4 * sizeof(double)), 0);
  EXPECT_EQ(std::memcmp(a.w.data(), b.w.data(), 3 * sizeof(double)), 0);
}

}  // namespace
}  // namespace cotwin::compliance::cartesian_rotation_test
