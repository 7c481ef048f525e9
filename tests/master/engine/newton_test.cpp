#include "master/engine/coupling/newton.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <Eigen/QR>
#include <cmath>
#include <functional>
#include <random>

namespace cotwin::master::newton_test {
namespace {

using Vector = Eigen::VectorXd;
using Matrix = Eigen::MatrixXd;
using Outcome = Newton::Outcome;

/// y(x) as a function, with forward differences.
class Function final : public CoupledOutputs {
 public:
  explicit Function(std::function<Vector(const Vector&)> y) : y_(std::move(y)) {}
  bool evaluate(const Vector& x, Vector& y) override {
    ++evaluations;
    y = y_(x);
    return evaluations != stop_at;
  }
  bool linearise(const Vector& x, Vector& y, Matrix& jacobian) override {
    for (Eigen::Index j = 0; j < x.size(); ++j) {
      Vector moved = x;
      moved[j] += 1e-4 * std::max(std::abs(x[j]), 1e-3);
      jacobian.col(j) = (y_(moved) - y) / (moved[j] - x[j]);
    }
    return !stop_in_linearise;
  }
  int evaluations = 0, stop_at = -1;
  bool stop_in_linearise = false;

 private:
  std::function<Vector(const Vector&)> y_;
};

Vector vector(std::initializer_list<double> values) {
  Vector v(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), v.begin());
  return v;
}

Vector ones(Eigen::Index n) { return Vector::Ones(n); }

constexpr Newton::Limits kLimits{.iterations = 50, .tolerance = 1e-12, .weak = 1e-8};

TEST(Newton, SolvesALinearProblemInTwoSteps) {
  // A ring of 40 gains of 1.5 and biases of 1: x = 1.5 x + 1 for each, so x = −2.
  constexpr Eigen::Index kSize = 40;
  Function ring([=](const Vector& x) {
    Vector y(kSize);
    for (Eigen::Index i = 0; i < kSize; ++i) y[(i + 1) % kSize] = 1.5 * x[i] + 1;
    return y;
  });
  Newton newton(kSize);
  Vector x = Vector::Zero(kSize);
  ASSERT_EQ(newton.solve(ring, x, ones(kSize), kLimits), Outcome::kConverged);
  EXPECT_LT((x.array() + 2).abs().maxCoeff(), 1e-11);
  EXPECT_LE(newton.iterations(), 2);
  EXPECT_EQ(newton.linearisations(), 1);
  EXPECT_FALSE(newton.nonlinear());
  EXPECT_LE(newton.worst(), 1e-12);
}

TEST(Newton, SolvesRandomLinearProblems) {
  // y = A x + b, compared with the solution by QR decomposition; rows and columns of A are scaled by 1e-4 to 1e4.
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> uniform(-1, 1);
  for (int trial = 0; trial < 2000; ++trial) {
    const Eigen::Index n = 1 + trial % 30;
    const auto draw = [&] { return uniform(random); };
    const Vector size = Vector::NullaryExpr(n, [&] { return std::pow(10, 4 * draw()); });
    const Matrix a = size.asDiagonal() * Matrix(Matrix::NullaryExpr(n, n, draw)) * size.cwiseInverse().asDiagonal();
    const Vector b = size.cwiseProduct(Vector(Vector::NullaryExpr(n, draw)));
    const Matrix scaled = Matrix::Identity(n, n) - Matrix(size.cwiseInverse().asDiagonal() * a * size.asDiagonal());
    const Eigen::ColPivHouseholderQR<Matrix> qr(scaled);
    if (std::abs(qr.matrixR()(n - 1, n - 1)) < 1e-3) continue;  // nearly singular
    const Vector expected = size.cwiseProduct(qr.solve(b.cwiseQuotient(size)));
    Function f([&](const Vector& x) { return Vector(a * x + b); });
    Newton newton(n);
    Vector x = Vector::Zero(n);
    ASSERT_EQ(newton.solve(f, x, size, kLimits), Outcome::kConverged) << trial;
    ASSERT_LT((x - expected).cwiseQuotient(size).cwiseAbs().maxCoeff(), 1e-8) << trial;
    ASSERT_LE(newton.iterations(), 5) << trial;
  }
}

TEST(Newton, SolvesANonlinearProblem) {
  // x = cos z, z = x² + 0.5: compared with bisection of x − cos(x² + 0.5).
  double low = 0, high = 1;
  for (int i = 0; i < 100; ++i) {
    const double middle = 0.5 * (low + high);
    (middle < std::cos(middle * middle + 0.5) ? low : high) = middle;
  }
  Function f([](const Vector& x) { return vector({std::cos(x[1]), x[0] * x[0] + 0.5}); });
  Newton newton(2);
  Vector x = Vector::Zero(2);
  ASSERT_EQ(newton.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0], low, 1e-11);
  EXPECT_NEAR(x[1], low * low + 0.5, 1e-11);
  EXPECT_TRUE(newton.nonlinear());
  EXPECT_LT(newton.iterations(), 15);
}

TEST(Newton, TheLastEvaluationIsAtTheSolution) {
  Vector last;
  Function f([&](const Vector& x) {
    last = x;
    return vector({std::exp(-x[0])});
  });
  Newton newton(1);
  Vector x = Vector::Zero(1);
  ASSERT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kConverged);
  EXPECT_EQ(last[0], x[0]);
  EXPECT_EQ(newton.y()[0], std::exp(-x[0]));
  EXPECT_NEAR(x[0], 0.567143290409783873, 1e-12);  // the omega constant, Ω e^Ω = 1
}

TEST(Newton, RecognisesALinearProblemWithoutAUniqueSolution) {
  for (const Eigen::Index n : {1, 2, 40}) {
    Function ring([n](const Vector& x) {
      Vector y(n);
      for (Eigen::Index i = 0; i < n; ++i) y[(i + 1) % n] = (i % 2 == 0 ? 1.6 : 1 / 1.6) * x[i] + 1;
      if (n == 1) y[0] = x[0] + 1;
      return y;
    });
    Newton newton(n);
    Vector x = Vector::Constant(n, 0.3);
    EXPECT_EQ(newton.solve(ring, x, ones(n), kLimits), Outcome::kSingular) << n;
  }
}

TEST(Newton, SolvesForUnknownsOfVeryDifferentMagnitudes) {
  // F = 5e8 + 5e17 d and d = 2e-9 − 1e-18 F: the entries of I − ∂y/∂x differ by 35 orders of magnitude.
  Function f([](const Vector& x) { return vector({5e8 + 5e17 * x[1], 2e-9 - 1e-18 * x[0]}); });
  Newton newton(2);
  Vector x = vector({0, 0});
  ASSERT_EQ(newton.solve(f, x, vector({1e9, 1e-9}), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0] / 1e9, 1, 1e-11);
  EXPECT_NEAR(x[1] / 1e-9, 1, 1e-11);
}

TEST(Newton, AWideTriangleIsNotSingular) {
  // x0 = 1e15 x1 + 1, x1 = 2e-15, x2 = −1e12 x2 + 1e12
  Function f([](const Vector& x) { return vector({1e15 * x[1] + 1, 2e-15, 1e12 - 1e12 * x[2]}); });
  Newton newton(3);
  Vector x = Vector::Zero(3);
  ASSERT_EQ(newton.solve(f, x, vector({1, 1e-15, 1}), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0], 3, 1e-11);
  EXPECT_NEAR(x[2], 1e12 / (1e12 + 1), 1e-11);
}

TEST(Newton, CrossesAKink) {
  // y falls with slope 0.5 left of 0 and with slope 4 right of it: y = x at 0.6 only.
  Function f([](const Vector& x) { return vector({x[0] < 0 ? 3 - 0.5 * x[0] : 3 - 4 * x[0]}); });
  for (const double guess : {-100.0, -1e-9, 0.0, 100.0}) {
    Newton newton(1);
    Vector x = vector({guess});
    ASSERT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kConverged) << guess;
    EXPECT_NEAR(x[0], 0.6, 1e-12);
  }
}

TEST(Newton, ShortensAStepThatLeavesTheDomain) {
  // ln x = 0; the first full step from 8 ends at 8 − 8 ln 8 = −8.6.
  Function f([](const Vector& x) { return vector({x[0] - std::log(x[0])}); });
  Newton newton(1);
  Vector x = vector({8});
  ASSERT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0], 1, 1e-11);
}

TEST(Newton, ReportsThatThereIsNoSolution) {
  Function f([](const Vector& x) { return vector({x[0] * x[0] + 1}); });  // x² − x + 1 > 0
  for (const double guess : {-3.0, 0.0, 0.7, 20.0}) {
    Newton newton(1);
    Vector x = vector({guess});
    const Outcome outcome = newton.solve(f, x, ones(1), kLimits);
    EXPECT_TRUE(outcome == Outcome::kDiverged || outcome == Outcome::kSingular) << guess;
    EXPECT_GT(newton.worst(), 0.1);
  }
}

TEST(Newton, FindsTheSolutionNearTheGuess) {
  // x² + 0.09 = x at 0.1 and 0.9
  Function f([](const Vector& x) { return vector({x[0] * x[0] + 0.09}); });
  for (const auto& [guess, solution] : {std::pair{0.0, 0.1}, {0.3, 0.1}, {0.8, 0.9}, {1.5, 0.9}}) {
    Newton newton(1);
    Vector x = vector({guess});
    ASSERT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kConverged);
    EXPECT_NEAR(x[0], solution, 1e-11) << guess;
  }
}

TEST(Newton, KeepsTheJacobianForTheNextProblem) {
  double bias = 1;
  Function f([&](const Vector& x) { return vector({0.5 * x[1] + 0.01 * std::sin(x[0]) + bias, -0.8 * x[0]}); });
  Newton newton(2);
  Vector x = Vector::Zero(2);
  ASSERT_EQ(newton.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  EXPECT_EQ(newton.linearisations(), 1);
  bias = 1.01;
  ASSERT_EQ(newton.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  EXPECT_EQ(newton.linearisations(), 0);
  EXPECT_LT(newton.iterations(), 6);
  EXPECT_NEAR(x[0], 0.5 * x[1] + 0.01 * std::sin(x[0]) + bias, 1e-12);
}

TEST(Newton, ReplacesAJacobianThatDoesNotFit) {
  double gain = 0.5;
  Function f([&](const Vector& x) { return vector({gain * x[1] + 1, x[0] + 1}); });
  Newton newton(2);
  Vector x = Vector::Zero(2);
  ASSERT_EQ(newton.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  gain = 30;
  ASSERT_EQ(newton.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0], -31.0 / 29, 1e-11);  // x0 = 30 (x0 + 1) + 1
}

TEST(Newton, ACopiedJacobianNeedsNoLinearisation) {
  Function f([](const Vector& x) { return vector({-3 * x[1] + 1, 2 * x[0] + 2}); });
  Newton first(2), second(2);
  Vector x = Vector::Zero(2), z = Vector::Zero(2);
  ASSERT_EQ(first.solve(f, x, ones(2), kLimits), Outcome::kConverged);
  second.jacobian() = first.jacobian();
  second.set_known(first.known());
  ASSERT_EQ(second.solve(f, z, ones(2), kLimits), Outcome::kConverged);
  EXPECT_EQ(second.linearisations(), 0);
  EXPECT_NEAR(z[0], -5.0 / 7, 1e-12);
}

TEST(Newton, StopsWhereAUnitDoesNotStep) {
  for (const int stop_at : {1, 2}) {
    Function f([](const Vector& x) { return vector({std::cos(x[0])}); });
    f.stop_at = stop_at;
    Newton newton(1);
    Vector x = vector({0.2});
    EXPECT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kStopped);
  }
  Function f([](const Vector& x) { return vector({std::cos(x[0])}); });
  f.stop_in_linearise = true;
  Newton newton(1);
  Vector x = vector({0.2});
  EXPECT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kStopped);
}

TEST(Newton, ReportsTheUnknownThatDoesNotConverge) {
  Function f([](const Vector& x) { return vector({0.5 * x[0] + 1, x[1] * x[1] + 1, 0.1 * x[0]}); });
  Newton newton(3);
  Vector x = Vector::Zero(3);
  EXPECT_EQ(newton.solve(f, x, ones(3), kLimits), Outcome::kDiverged);
  EXPECT_EQ(newton.worst_unknown(), 1);
}

TEST(Newton, AcceptsTheRoundingErrorOfItsFunction) {
  // y has an error of 1e-10 that depends on the last bits of x.
  Function f([](const Vector& x) { return vector({0.3 * x[0] + 1 + 1e-10 * std::sin(1e14 * x[0])}); });
  Newton newton(1);
  Vector x = vector({0});
  ASSERT_EQ(newton.solve(f, x, ones(1), kLimits), Outcome::kConverged);
  EXPECT_NEAR(x[0], 1 / 0.7, 1e-9);
  EXPECT_LE(newton.worst(), 1e-8);
}

TEST(Newton, AcceptsTheNoiseOfAnIterativeSolverWhereAllowed) {
  // y is known to `noise`, as of a solver that ends at a tolerance of its own. A residual above `stagnant` is not accepted.
  for (const double noise : {1e-6, 3e-6, 1e-3}) {
    Function f([=](const Vector& x) { return vector({0.3 * x[0] + 1 + noise * std::sin(1e14 * x[0])}); });
    for (const double stagnant : {0.0, 1e-5}) {
      Newton::Limits limits;
      limits.stagnant = stagnant;
      Newton newton(1);
      Vector x = vector({1});
      const bool converges = newton.solve(f, x, ones(1), limits) == Outcome::kConverged;
      EXPECT_EQ(converges, noise < stagnant) << noise;
      if (converges) {
        EXPECT_NEAR(x[0], 1 / 0.7, 2e-5);
      }
    }
  }
}

TEST(Newton, AllowedNoiseChangesNothingWhereNewtonsMethodConverges) {
  Function f([](const Vector& x) { return vector({std::cos(x[0]), std::tanh(4 * x[0]) + 0.5 * x[1]}); });
  Vector ends[2];
  for (const double stagnant : {0.0, 1e-5}) {
    Newton::Limits limits = kLimits;
    limits.stagnant = stagnant;
    Newton newton(2);
    Vector x = vector({-3, 5});
    ASSERT_EQ(newton.solve(f, x, ones(2), limits), Outcome::kConverged);
    EXPECT_LE(newton.worst(), 1e-12);
    ends[stagnant > 0] = x;
  }
  EXPECT_EQ(ends[0], ends[1]);
}

}  // namespace
}  // namespace cotwin::master::newton_test
