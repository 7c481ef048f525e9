#include "models/control/guidance.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>
#include <numbers>
#include <random>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::guidance::guidance_test {
namespace {

using Polynomial = std::vector<double>;  // a_0 + a_1 s + …

Polynomial operator*(const Polynomial& a, const Polynomial& b) {
  Polynomial c(a.size() + b.size() - 1);
  for (std::size_t i = 0; i < a.size(); ++i) {
    for (std::size_t j = 0; j < b.size(); ++j) c[i + j] += a[i] * b[j];
  }
  return c;
}

Polynomial operator+(Polynomial a, const Polynomial& b) {
  a.resize(std::max(a.size(), b.size()));
  for (std::size_t i = 0; i < b.size(); ++i) a[i] += b[i];
  return a;
}

/// Roots with a positive real part, by the companion matrix, balanced by the substitution s = scale · x.
int unstable_roots(Polynomial a, double scale) {
  double power = 1;
  for (double& x : a) {
    x *= power;
    power *= scale;
  }
  const auto n = static_cast<Eigen::Index>(a.size()) - 1;
  Eigen::MatrixXd C = Eigen::MatrixXd::Zero(n, n);
  for (Eigen::Index i = 0; i < n; ++i) C(i, n - 1) = -a[static_cast<std::size_t>(i)] / a.back();
  C.diagonal(-1).setOnes();
  const Eigen::VectorXcd roots = C.eigenvalues();
  return static_cast<int>((roots.real().array() > 0).count());
}

/// e^(−sτ) as N(−s)/N(s) of order 10.
Polynomial pade(double tau) {
  constexpr int n = 10;
  Polynomial N(n + 1);
  double c = 1;
  for (int k = 0; k <= n; ++k) {
    N[static_cast<std::size_t>(k)] = c * std::pow(tau, k);
    c *= static_cast<double>(n - k) / ((2.0 * n - k) * (k + 1));
  }
  return N;
}

/// The loop as a polynomial, with the delay as a Padé approximation.
Polynomial characteristic(const Loop& l, double M, double D) {
  const Polynomial G{l.K_g, l.D_g}, F{l.K_h, l.D_h, l.m_h}, N{l.omega * l.omega, 2 * l.zeta * l.omega, 1};
  const Polynomial filter{1, 1 / (2 * std::numbers::pi * l.cutoff)}, up = pade(l.delay);
  Polynomial down = up;
  for (std::size_t k = 1; k < down.size(); k += 2) down[k] *= -1;
  // K_e T/(1 + K_e/(mass N)) = G F ω² mass/((G + F) mass N + G F)
  const Polynomial hand = G * F, whole = Polynomial{l.mass} * (G + F) * N + hand;
  return Polynomial{0, D, M} * whole * filter * up + Polynomial{l.omega * l.omega * l.mass} * hand * down;
}

Loop example(double delay) {
  return {.m_h = 0.7, .D_h = 20, .K_h = 400, .D_g = 50, .K_g = 5000, .cutoff = 40, .delay = delay, .omega = 150, .mass = 20};
}

// M s² + D s + K e^(−sτ): at the border M ω² = K cos ωτ and D ω = K sin ωτ.
TEST(GuidanceBorder, OfASpringBehindADelayIsTheClosedForm) {
  for (const double tau : {0.001, 0.02, 0.3}) {
    for (const double turn : {0.05, 0.4, 1.2, 1.55}) {
      const double K = 350, omega = turn / tau, M = K * std::cos(turn) / (omega * omega), D = K * std::sin(turn) / omega;
      const Border border = damping_border({.K_h = K, .delay = tau}, M);
      EXPECT_NEAR(border.D, D, 1e-9 * D);
      EXPECT_NEAR(border.omega, omega, 1e-9 * omega);
    }
  }
}

// The same border, solved for K: ω tan ωτ = D/M, K = M ω²/cos ωτ.
TEST(GuidanceBorder, OfTheHandsStiffnessIsTheClosedForm) {
  for (const double tau : {0.01, 0.1}) {
    for (const double turn : {0.1, 0.7, 1.4}) {
      const double omega = turn / tau, M = 2.5, D = M * omega * std::tan(turn), K = M * omega * omega / std::cos(turn);
      EXPECT_EQ(unstable_poles({.K_h = K * (1 - 1e-4), .delay = tau}, M, D), 0) << tau << " s, " << turn;
      EXPECT_GT(unstable_poles({.K_h = K * (1 + 1e-4), .delay = tau}, M, D), 0) << tau << " s, " << turn;
    }
  }
  EXPECT_EQ(unstable_poles({.m_h = 0.7, .D_h = 20, .K_h = 1e8}, 1, 10), 0) << "without delay";
  for (const double K : {390.0, 410.0}) {  // the chart of examples/09_manual_guidance has 400 N/m there
    Loop loop = example(0.08);
    loop.K_h = K;
    EXPECT_EQ(unstable_poles(loop, 5, 16.5) > 0, K > 400) << K;
  }
}

// (M s² + D s)(s² + 2ζω s + ω²) + K ω² = 0, Routh: K < a₁ (a₃ a₂ − M a₁)/(a₃² ω²).
TEST(GuidanceBorder, WithoutDelayIsThatOfRouth) {
  for (const double M : {0.1, 1.0, 10.0}) {
    for (const double omega : {40.0, 150.0}) {
      const Loop loop{.K_h = 3000, .omega = omega, .zeta = 0.7};
      const auto bound = [&](double D) {
        const double a3 = D + 2 * loop.zeta * omega * M, a2 = 2 * loop.zeta * omega * D + omega * omega * M,
                     a1 = omega * omega * D;
        return a1 * (a3 * a2 - M * a1) / (a3 * a3 * omega * omega);
      };
      double low = 0, high = 1e5;
      for (int i = 0; i < 100; ++i) {
        const double D = (low + high) / 2;
        (bound(D) < loop.K_h ? low : high) = D;
      }
      EXPECT_NEAR(damping_border(loop, M).D, low, 1e-9 * low) << M << " kg, " << omega << " rad/s";
    }
  }
}

TEST(GuidanceBorder, OfTheWholeLoopIsWhereTheRootsOfItsPolynomialCross) {
  for (const double delay : {0.004, 0.01, 0.02, 0.04, 0.06}) {
    for (const double M : {0.25, 0.5, 1.0, 3.0, 20.0}) {
      const Loop loop = example(delay);
      const Border border = damping_border(loop, M);
      if (border.D == 0) {
        EXPECT_EQ(unstable_roots(characteristic(loop, M, 0.1), 100), 0) << delay << " s, " << M << " kg";
        continue;
      }
      EXPECT_GT(unstable_roots(characteristic(loop, M, 0.999 * border.D), 100), 0) << delay << " s, " << M << " kg";
      EXPECT_EQ(unstable_roots(characteristic(loop, M, 1.001 * border.D), 100), 0) << delay << " s, " << M << " kg";
    }
  }
}

TEST(GuidanceBorder, SeparatesLoopsWithUnstablePolesFromThoseWithout) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> u(0, 1);
  int with_border = 0;
  for (int i = 0; i < 60; ++i) {
    const Loop loop{.m_h = 0.5 + 0.5 * u(random),
                    .D_h = 10 + 40 * u(random),
                    .K_h = 100 + 400 * u(random),
                    .D_g = 100 * u(random),
                    .K_g = 2000 + 8000 * u(random),
                    .cutoff = u(random) < 0.3 ? 0 : 10 + 90 * u(random),
                    .delay = 0.1 * u(random),
                    .omega = 50 + 200 * u(random),
                    .zeta = 0.5 + u(random),
                    .mass = u(random) < 0.3 ? 0 : 2 + 50 * u(random),
                    .h = u(random) < 0.5 ? 0 : 2e-3 * u(random)};
    const double M = std::pow(10, 2 * u(random) - 0.7);
    const Border border = damping_border(loop, M);
    EXPECT_EQ(unstable_poles(loop, M, 1.01 * border.D + 1e-3), 0) << "loop " << i;
    if (border.D < 0.1) continue;
    ++with_border;
    EXPECT_EQ(unstable_poles(loop, M, 0.99 * border.D) % 2, 0) << "loop " << i;
    EXPECT_GT(unstable_poles(loop, M, 0.99 * border.D), 0) << "loop " << i;
  }
  EXPECT_GT(with_border, 20);
}

// A gear of 1e12 N/m is rigid; at low frequencies any gear is a further spring in series.
TEST(GuidanceBorder, OfAnElasticRobotTendsToThatOfTheRigidOne) {
  Loop elastic = example(0.02);
  elastic.B = 8;
  elastic.K_J = 1e12;
  for (const double omega : {1.0, 30.0, 200.0}) {
    const std::complex<double> s(0, omega), rigid = gain(example(0.02), s);
    EXPECT_LT(std::abs(gain(elastic, s) - rigid), 1e-6 * std::abs(rigid));
  }
  elastic.K_J = 2000;
  const double motor = elastic.mass * elastic.omega * elastic.omega;  // N/m, of the position control
  EXPECT_NEAR(gain(elastic, {0, 1e-6}).real(), 1 / (1 / 400. + 1 / 5000. + 1 / motor + 1 / 2000.), 1e-3);
  EXPECT_THROW((void)damping_border({.K_h = 300, .omega = 100, .mass = 5, .K_J = 1e4, .B = 6}, 1), Error);
}

// 1 + K_P T e^(−sτ) = 0, T = ω²/N: at the border N = −K_P ω² e^(−jwτ), so that each w belongs to one K_P and one τ = cycle + delay.
TEST(GuidanceSynchronisation, BorderOfARobotAloneIsTheClosedForm) {
  for (const double omega : {40.0, 150.0}) {
    for (const double turn : {0.6, 1.0, 2.0}) {
      const double w = turn * omega;
      const std::complex<double> N(omega * omega - w * w, 2 * 0.7 * omega * w);
      const double K_P = std::abs(N) / (omega * omega), tau = (std::numbers::pi - std::arg(N)) / w;
      const Loop loop{.K_h = 0, .delay = 0.7 * tau, .omega = omega, .zeta = 0.7, .cycle = 0.3 * tau};
      EXPECT_NEAR(synchronisation_border(loop, 0, 0), K_P, 2e-3 * K_P) << omega << ' ' << turn;
    }
  }
  const Loop exact{.K_h = 0, .cycle = 0.001};
  EXPECT_NEAR(synchronisation_border(exact, 0, 0), 1, 2e-3) << "T = 1: Jury's criterion has 1 for a = 1";
}

// M s² + D s + K_e T (1 + P)/(1 + K_e C + P T e^(−sτ)) with P = K_P and no cycle, as a polynomial.
TEST(GuidanceSynchronisation, BorderOfTheWholeLoopIsWhereTheRootsOfItsPolynomialCross) {
  for (const double delay : {0.004, 0.01, 0.03}) {
    for (const double M : {1.0, 4.0}) {
      Loop l{.m_h = 0.7, .D_h = 20, .K_h = 400, .delay = delay, .omega = 150, .mass = 20, .cycle = 1e-9};
      const double D = damping_border(l, M).D + 20, border = synchronisation_border(l, M, D);
      ASSERT_GT(border, 0.05);
      const auto roots = [&](double K_P) {
        const double r = l.omega * l.omega * l.mass;
        const Polynomial F{l.K_h, l.D_h, l.m_h}, N{l.omega * l.omega, 2 * l.zeta * l.omega, 1}, up = pade(l.delay);
        Polynomial down = up;
        for (std::size_t k = 1; k < down.size(); k += 2) down[k] *= -1;
        const Polynomial Q = (Polynomial{l.mass} * N + F) * up + Polynomial{K_P * r} * down;
        return unstable_roots(Polynomial{0, D, M} * Q + Polynomial{r * (1 + K_P)} * F * down, 100);
      };
      EXPECT_EQ(roots(0.99 * border), 0) << delay << ' ' << M;
      EXPECT_GT(roots(1.01 * border), 0) << delay << ' ' << M;
      l.K_P = 1.01 * border;
      EXPECT_EQ(unstable_poles(l, M, D), roots(l.K_P));
    }
  }
}

// Joints as those of the LWR 4+: a link of 2.7 kg.m2 before a motor of 3 kg.m2, 12 000 N.m/rad and its damping, 3 % of the critical one.
TEST(GuidanceSynchronisation, ElasticJointsAllowMuchLess) {
  Loop l{.K_h = 0, .delay = 0.002, .omega = 150, .mass = 5.7, .h = 1e-3, .K_J = 12'000, .D_J = 10, .B = 3, .cycle = 1e-3};
  const double elastic = synchronisation_border(l, 0, 0);
  EXPECT_LT(elastic, 0.5);
  EXPECT_GT(elastic, 0.05);
  l.K_J = l.B = 0;
  EXPECT_GT(synchronisation_border(l, 0, 0), 2);
}

TEST(GuidanceBorder, RefusesValuesThatNoLoopHas) {
  EXPECT_THROW((void)damping_border(example(0.01), 0), Error);
  EXPECT_THROW((void)damping_border(example(-0.01), 1), Error);
  EXPECT_THROW((void)unstable_poles({.K_P = 0.5}, 1, 1), Error) << "without a cycle";
  EXPECT_THROW((void)damping_border(example(std::numeric_limits<double>::quiet_NaN()), 1), Error);
  EXPECT_EQ(damping_border({.K_h = 0, .delay = 0.1}, 1).D, 0) << "without a hand nothing vibrates";
}

}  // namespace
}  // namespace cotwin::guidance::guidance_test
