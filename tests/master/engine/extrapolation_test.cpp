#include "master/engine/coupling/extrapolation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

namespace cotwin::master::extrapolation_test {
namespace {

using Vector = Eigen::VectorXd;

Vector of(double a, double b) { return Vector{{a, b}}; }

template <class Function>
void follow(Extrapolation& guess, Function x, int first, int last) {
  for (int n = first; n < last; ++n) guess.add(x(n), x(n + 1), Vector::Ones(2), n > first);
}

double next_error(const Extrapolation& guess, const Vector& last, const Vector& next) {
  Vector x = last;
  guess.advance(x, guess.degree());
  return (x - next).cwiseAbs().maxCoeff();
}

TEST(Extrapolation, ContinuesPolynomialsUpToItsDegreeExactly) {
  for (int degree = 1; degree <= Extrapolation::kMostDegree; ++degree) {
    const auto x = [&](int n) { return of(std::pow(0.1 * n, degree), 1 - std::pow(0.1 * n, degree - 1)); };
    Extrapolation guess(2);
    follow(guess, x, 0, 12);
    EXPECT_LT(next_error(guess, x(12), x(13)), 1e-11) << degree;  // rounding of 0.1^k n^k times 2^degree
  }
}

// The differences of a smooth function become smaller with the degree until rounding decides.
TEST(Extrapolation, ContinuesASineBetterThanALine) {
  const auto x = [](int n) { return of(std::sin(0.01 * n), std::cos(0.01 * n)); };
  Extrapolation guess(2);
  follow(guess, x, 0, 40);
  EXPECT_LT(next_error(guess, x(40), x(41)), 1e-13);
  const Vector line = 2 * x(40) - x(39);
  EXPECT_GT((line - x(41)).cwiseAbs().maxCoeff(), 1e-5);
}

// A high degree multiplies noise by 2^degree; the last value is the best guess there.
TEST(Extrapolation, DoesNotMultiplyNoise) {
  const auto x = [](int n) { return of(std::fmod(0.7548 * n, 1.0), std::fmod(0.5698 * n, 1.0)); };
  double worst = 0;
  for (int last = 9; last < 200; ++last) {
    Extrapolation guess(2);
    follow(guess, x, 0, last);
    worst = std::max(worst, next_error(guess, x(last), x(last + 1)));
  }
  EXPECT_LT(worst, 6);  // degree 7 misses by up to 2^8 / 2
}

// All degrees have missed by the jump, the higher ones as a part of a sum that would repeat it.
TEST(Extrapolation, DoesNotRepeatAJump) {
  for (int jump = 9; jump < 200; ++jump) {
    const auto x = [&](int n) { return of(std::sin(0.05 * n) + (n > jump ? 1 : 0), std::cos(0.03 * n)); };
    Extrapolation guess(2);
    follow(guess, x, 0, jump + 1);
    EXPECT_LT(next_error(guess, x(jump + 1), x(jump + 2)), 0.1) << jump;
  }
}

TEST(Extrapolation, BeginsAnewAfterAStepThatDoesNotContinue) {
  const auto x = [](int n) { return of(n * n, n); };
  Extrapolation guess(2);
  follow(guess, x, 0, 10);
  EXPECT_EQ(guess.degree(), 2);
  guess.add(x(20), x(21), Vector::Ones(2), false);
  EXPECT_EQ(guess.degree(), 1);
  EXPECT_EQ(guess.last_change()[0], 41);
}

TEST(Extrapolation, GoesOnFromItsNumbers) {
  const auto x = [](int n) { return of(std::sin(0.02 * n), n * n * 0.5); };
  Extrapolation one(2), other(2);
  follow(one, x, 0, 9);
  std::vector<double> numbers(static_cast<std::size_t>(one.state_size()));
  one.save(numbers);
  other.restore(numbers);
  one.add(x(9), x(10), Vector::Ones(2), true);
  other.add(x(9), x(10), Vector::Ones(2), true);
  EXPECT_EQ(next_error(one, x(10), x(11)), next_error(other, x(10), x(11)));
  for (const double damaged : {-1.0, 1e9, std::numeric_limits<double>::quiet_NaN()}) {
    numbers.back() = damaged;
    other.restore(numbers);
    EXPECT_EQ(other.degree(), 0);
  }
}

}  // namespace
}  // namespace cotwin::master::extrapolation_test
