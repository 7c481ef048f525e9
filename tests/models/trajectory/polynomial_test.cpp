#include "models/trajectory/polynomial.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <random>

#include "models/foundation/support/error.h"
#include "models/trajectory/bernstein.h"

namespace cotwin::trajectory::polynomial_test {
namespace {

using State = std::array<double, 4>;  // q, q̇, q̈, jerk

State at(const Path& path, double t, std::size_t joint = 0) {
  std::vector<double> q(path.joints()), dq(q), ddq(q), dddq(q);
  path.at(t, q, dq, ddq, dddq);
  return {q[joint], dq[joint], ddq[joint], dddq[joint]};
}

double binomial(int n, int k) {
  return std::round(std::exp(std::lgamma(n + 1.0) - std::lgamma(k + 1.0) - std::lgamma(n - k + 1.0)));
}

/// ∫₀¹ f g ds of two polynomials in Bernstein form of one degree: ∫ B_i B_j = C(d, i) C(d, j) / ((2d + 1) C(2d, i + j)).
double product(std::span<const double> f, std::span<const double> g) {
  const int d = static_cast<int>(f.size()) - 1;
  double sum = 0;
  for (int i = 0; i <= d; ++i) {
    for (int j = 0; j <= d; ++j) {
      sum += f[static_cast<std::size_t>(i)] * g[static_cast<std::size_t>(j)] * binomial(d, i) * binomial(d, j) /
             ((2 * d + 1) * binomial(2 * d, i + j));
    }
  }
  return sum;
}

TEST(Polynomial, TheBernsteinFormEvaluatesAsItsDefinition) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int d = 3; d <= 20; ++d) {
    std::vector<double> b(static_cast<std::size_t>(d + 1));
    for (double& x : b) x = uniform(random);
    for (const double s : {0.0, 0.2, 0.5, 0.77, 1.0}) {
      double sum = 0;
      for (int i = 0; i <= d; ++i)
        sum += b[static_cast<std::size_t>(i)] * binomial(d, i) * std::pow(s, i) * std::pow(1 - s, d - i);
      EXPECT_NEAR(bernstein::evaluate(b, s)[0], sum, 1e-13);
    }
  }
}

TEST(Polynomial, DerivativesAreThoseOfTheValues) {
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (const int d : {5, 9, 15}) {
    std::vector<double> b(static_cast<std::size_t>(d + 1));
    for (double& x : b) x = uniform(random);
    const double h = 1e-4;
    for (double s = 0.1; s < 0.95; s += 0.05) {
      const auto p = bernstein::evaluate(b, s), before = bernstein::evaluate(b, s - h), after = bernstein::evaluate(b, s + h);
      for (std::size_t k = 0; k < 3; ++k) {
        // Central difference: h²/6 times the third derivative of the differentiated function, at most about d⁵·2 here.
        EXPECT_NEAR((after[k] - before[k]) / (2 * h), p[k + 1], 1e-8 * std::pow(d, static_cast<double>(k) + 3));
      }
    }
  }
}

TEST(Polynomial, ElevationKeepsThePolynomial) {
  const std::vector<double> b = {1, -2, 0.5, 3, 2, -1};
  const auto higher = bernstein::elevate(b, 15);
  EXPECT_EQ(higher.size(), 16u);
  for (double s = 0; s <= 1; s += 0.1) {
    for (std::size_t k = 0; k < 4; ++k) EXPECT_NEAR(bernstein::evaluate(higher, s)[k], bernstein::evaluate(b, s)[k], 1e-11);
  }
}

// A damaged state may contain any numbers: the search for the largest value must end.
TEST(Polynomial, ExtremesOfNonFiniteValuesAreNotSearched) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity(), kNone = std::numeric_limits<double>::quiet_NaN();
  for (const double odd : {kInfinity, -kInfinity, kNone, 1e308}) {
    for (std::size_t at = 0; at < 8; ++at) {
      std::vector<double> b = {1, -3, 2, 5, -1, 4, 0, 2};
      b[at] = odd;
      b[(at + 3) % 8] = -odd;
      for (int derivative = 0; derivative <= 3; ++derivative) static_cast<void>(bernstein::extremes(b, derivative));
    }
  }
}

TEST(Polynomial, ExtremesAreFoundAndNeverExceeded) {
  std::mt19937 random(3);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 300; ++trial) {
    std::vector<double> b(6 + static_cast<std::size_t>(trial % 11));
    for (double& x : b) x = uniform(random);
    for (int derivative = 0; derivative <= 3; ++derivative) {
      const auto found = bernstein::extremes(b, derivative);
      const auto hull = bernstein::hull(b, derivative);
      const double span = hull.max - hull.min;
      const auto value = [&](double s) { return bernstein::evaluate(b, s)[static_cast<std::size_t>(derivative)]; };
      EXPECT_NEAR(value(found.max.s), found.max.value, 1e-11 * span);  // attained
      EXPECT_NEAR(value(found.min.s), found.min.value, 1e-11 * span);
      for (int i = 0; i <= 500; ++i) {
        const double x = value(i / 500.0);
        ASSERT_LE(x, found.max.value + 2e-13 * span + 1e-14) << "trial " << trial << ", derivative " << derivative;
        ASSERT_GE(x, found.min.value - 2e-13 * span + 1e-14) << "trial " << trial << ", derivative " << derivative;
      }
      EXPECT_LE(found.max.value, hull.max + 1e-12 * span);
      EXPECT_GE(found.min.value, hull.min - 1e-12 * span);
    }
  }
}

TEST(Polynomial, AnyRedundantCoefficientsMeetTheBoundaryConditions) {
  std::mt19937 random(4);
  std::uniform_real_distribution<double> uniform(-2, 2);
  for (const bool start_jerk : {false, true}) {
    for (const bool end_jerk : {false, true}) {
      for (int degree = 5 + start_jerk + end_jerk; degree <= 20; ++degree) {
        const RedundantTerms terms(degree, start_jerk, end_jerk);
        EXPECT_EQ(terms.size(), static_cast<std::size_t>(degree - 5 - start_jerk - end_jerk));
        for (int trial = 0; trial < 20; ++trial) {
          Boundary start{uniform(random), uniform(random), uniform(random), {}},
              end{uniform(random), uniform(random), uniform(random), {}};
          if (start_jerk) start.dddq = uniform(random);
          if (end_jerk) end.dddq = uniform(random);
          std::vector<double> c_r(terms.size());
          for (double& c : c_r) c = 5 * uniform(random);
          const double T = 0.3 + std::abs(uniform(random));
          const Path path(1, {0, T}, degree, make_polynomial(start, end, T, terms, c_r));
          const State a = at(path, 0), b = at(path, T);
          // Differences of control points of size 10, times d/T, d²/T², d³/T³.
          const double rounding = 1e-14 * degree / T;
          EXPECT_EQ(a[0], start.q);
          EXPECT_EQ(b[0], end.q);
          EXPECT_NEAR(a[1], start.dq, rounding);
          EXPECT_NEAR(b[1], end.dq, rounding);
          EXPECT_NEAR(a[2], start.ddq, 2 * rounding * degree / T);
          EXPECT_NEAR(b[2], end.ddq, 2 * rounding * degree / T);
          if (start_jerk) {
            EXPECT_NEAR(a[3], *start.dddq, 8 * rounding * degree * degree / (T * T));
          }
          if (end_jerk) {
            EXPECT_NEAR(b[3], *end.dddq, 8 * rounding * degree * degree / (T * T));
          }
        }
      }
    }
  }
}

TEST(Polynomial, RedundantTermsAreOrthogonalAndReachOne) {
  for (const bool jerk : {false, true}) {
    const RedundantTerms terms(15, jerk, jerk);
    double least = 1e9, greatest = 0;
    for (std::size_t i = 0; i < terms.size(); ++i) {
      const auto range = bernstein::extremes(terms.term(i));
      EXPECT_NEAR(std::max(range.max.value, -range.min.value), 1, 1e-10);
      const double norm = product(terms.term(i), terms.term(i));
      least = std::min(least, norm);
      greatest = std::max(greatest, norm);
      for (std::size_t j = 0; j < i; ++j) EXPECT_NEAR(product(terms.term(i), terms.term(j)), 0, 1e-9) << i << ", " << j;
    }
    // The Gram matrix of c_r -> q is diagonal: its condition number is that of the norms.
    EXPECT_LT(greatest / least, 5);
  }
}

TEST(Polynomial, WithoutRedundantCoefficientsItIsTheQuinticAtAnyDegree) {
  // Rest to rest: 10s³ − 15s⁴ + 6s⁵, with largest velocity 15/8, acceleration 10/√3 and jerk 60 per distance and duration.
  const double T = 2, from = 0.5, to = -1;
  for (const int degree : {5, 6, 10, 15}) {
    const RedundantTerms terms(degree);
    const Path path(1, {0, T}, degree,
                    make_polynomial({from, 0, 0, {}}, {to, 0, 0, {}}, T, terms, std::vector<double>(terms.size())));
    for (double s = 0; s <= 1; s += 0.05) {
      EXPECT_NEAR(at(path, s * T)[0], from + (to - from) * s * s * s * (10 + s * (6 * s - 15)), 1e-14);
    }
    EXPECT_NEAR(path.range(0, 1).largest().value, (to - from) * 15 / 8 / T, 1e-9);
    EXPECT_NEAR(path.range(0, 1).largest().t, T / 2, 1e-4);
    EXPECT_NEAR(std::abs(path.range(0, 2).largest().value), std::abs(to - from) * 10 / std::sqrt(3.0) / (T * T), 1e-9);
    EXPECT_NEAR(std::abs(path.range(0, 3).largest().value), std::abs(to - from) * 60 / (T * T * T), 1e-9);
  }
}

TEST(Polynomial, DegreesAndCoefficientsThatDoNotFitAreErrors) {
  EXPECT_THROW(RedundantTerms(4), Error);
  EXPECT_THROW(RedundantTerms(6, true, true), Error);
  EXPECT_THROW(RedundantTerms(bernstein::kMaxDegree + 1), Error);
  const RedundantTerms terms(7);
  const std::vector<double> one = {1};
  EXPECT_THROW(make_polynomial({}, {}, 1, terms, one), Error);
  EXPECT_THROW(make_polynomial({}, {}, 0, RedundantTerms(6), one), Error);
  EXPECT_THROW(make_polynomial({0, 0, 0, 1.0}, {}, 1, RedundantTerms(6), one), Error);
}

}  // namespace
}  // namespace cotwin::trajectory::polynomial_test
