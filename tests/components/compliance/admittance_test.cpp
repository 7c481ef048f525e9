// The exact solution of the second-order relation of the joint admittance, compared with closed forms.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "components/compliance/joints/second_order.h"

namespace cotwin::compliance::admittance_test {
namespace {

// Rounding of the series and of up to ~20 doublings, relative to the largest term.
constexpr double kRounding = 1e-12;

TEST(SecondOrder, CriticallyDampedStepResponseIsTheClosedForm) {
  const double M = 2, S = 50, u = 7, w = std::sqrt(S / M);
  const SecondOrder system{M, 2 * std::sqrt(S * M), S};
  for (double t : {1e-4, 1e-3, 0.05, 0.3, 2.0, 20.0}) {
    const Deviation d = advance(system, {}, u, 0, t);
    EXPECT_NEAR(d.x, u / S * (1 - (1 + w * t) * std::exp(-w * t)), kRounding * u / S) << t;
    EXPECT_NEAR(d.dx, u / S * w * w * t * std::exp(-w * t), kRounding * u / S * w) << t;
  }
}

TEST(SecondOrder, UnderdampedRelationSwingsAsTheClosedFormSays) {
  const double M = 0.5, D = 0.8, S = 30, p = D / (2 * M), w = std::sqrt(S / M - p * p);
  for (double t : {1e-3, 0.2, 1.7, 6.0}) {
    const Deviation d = advance({M, D, S}, {0.3, 0}, 0, 0, t);
    EXPECT_NEAR(d.x, 0.3 * std::exp(-p * t) * (std::cos(w * t) + p / w * std::sin(w * t)), kRounding) << t;
  }
}

TEST(SecondOrder, OverdampedRelationIsASumOfTwoExponentials) {
  const double M = 1, D = 1000, S = 40;
  const double root = std::sqrt(D * D / 4 - S), fast = -(D / 2 + root), slow = S / fast;  // their product is S / M
  for (double t : {1e-3, 0.1, 10.0, 100.0}) {
    const Deviation d = advance({M, D, S}, {0, 1}, 0, 0, t);
    EXPECT_NEAR(d.x, (std::exp(slow * t) - std::exp(fast * t)) / (slow - fast), kRounding) << t;
  }
}

TEST(SecondOrder, FreeFloatingMassFollowsAParabolaAndWithDampingADrift) {
  const double M = 3, u = 2, D = 5, T = M / D;
  for (double t : {1e-3, 0.1, 4.0}) {
    EXPECT_NEAR(advance({M, 0, 0}, {}, u, 0, t).x, u * t * t / (2 * M), kRounding * t * t);
    EXPECT_NEAR(advance({M, 0, 0}, {}, 0, u, t).x, u * t * t * t / (6 * M), kRounding * t * t * t);
    EXPECT_NEAR(advance({M, D, 0}, {}, u, 0, t).x, u / D * (t + T * std::expm1(-t / T)), kRounding * t);
  }
}

TEST(SecondOrder, RampsAndStepsSuperpose) {
  const SecondOrder system{1.3, 4, 25};
  const double h = 0.37;
  const Deviation start{0.2, -0.5};
  const Deviation all = advance(system, start, 3, -2, h);
  const Deviation parts[] = {advance(system, start, 0, 0, h), advance(system, {}, 3, 0, h), advance(system, {}, 0, -2, h)};
  EXPECT_NEAR(all.x, parts[0].x + parts[1].x + parts[2].x, kRounding);
  EXPECT_NEAR(all.dx, parts[0].dx + parts[1].dx + parts[2].dx, kRounding);
}

TEST(SecondOrder, ManyShortStepsAgreeWithOneLongStepForAnyRelation) {
  std::mt19937_64 random(20261120);
  std::uniform_real_distribution<double> decade(-3, 3), value(-10, 10), unit(0, 1);
  for (int round = 0; round < 20'000; ++round) {
    SecondOrder system{std::pow(10, decade(random)), std::pow(10, decade(random)), std::pow(10, decade(random))};
    if (unit(random) < 0.1) system.S = 0;
    if (unit(random) < 0.1) system.D = 0;
    const Deviation start{value(random), value(random)};
    const double u0 = value(random), u1 = value(random), h = 1e-3;
    const int steps = 100;
    Deviation once = advance(system, start, u0, u1, steps * h), many = start;
    double largest = std::abs(start.x), fastest = std::abs(start.dx);
    for (int i = 0; i < steps; ++i) {
      many = advance(system, many, u0 + u1 * i * h, u1, h);
      largest = std::max(largest, std::abs(many.x));
      fastest = std::max(fastest, std::abs(many.dx));
    }
    // A rounding error of the elongation corresponds to √(S/M) times this speed.
    const double w = std::sqrt(system.S / system.M);
    ASSERT_NEAR(once.x, many.x, 1e-11 * (largest + fastest * steps * h))
        << "M D S " << system.M << " " << system.D << " " << system.S;
    ASSERT_NEAR(once.dx, many.dx, 1e-11 * (fastest + w * largest))
        << "M D S " << system.M << " " << system.D << " " << system.S;
  }
}

TEST(SecondOrder, NoStepIsTooLongForAStiffRelation) {
  // S/M = 1e12 1/s2 over 10 s: the solution has settled and stays finite.
  const Deviation d = advance({1e-6, 2.0, 1e6}, {1, 1e3}, 5, 0, 10);
  EXPECT_NEAR(d.x, 5e-6, 1e-18);
  EXPECT_NEAR(d.dx, 0, 1e-12);
}

}  // namespace
}  // namespace cotwin::compliance::admittance_test
