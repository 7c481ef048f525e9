#include "models/numerics/modes.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "models/numerics/dense.h"

namespace cotwin::numerics::modes_test {
namespace {

using Square = Eigen::Matrix<double, 6, 6>;

/// The error of values and vectors relative to the largest value.
double error_of(const Square& A, const Modes6& modes) {
  const Square U = modes.vectors;
  const double size = std::max(A.cwiseAbs().maxCoeff(), std::numeric_limits<double>::min());
  return std::max((U.transpose() * modes.values.asDiagonal() * U - A).cwiseAbs().maxCoeff() / size,
                  (U * U.transpose() - Square::Identity()).cwiseAbs().maxCoeff());
}

Square symmetric(std::mt19937& generator) {
  std::normal_distribution<double> normal;
  Square A;
  for (double& a : A.reshaped()) a = normal(generator);
  return A + A.transpose();
}

constexpr double kRounding = 2e-14;  // some ten roundings in each of some thirty rotations

TEST(Modes6, DecomposeRandomMatrices) {
  std::mt19937 generator(1);
  for (int i = 0; i < 20'000; ++i) {
    const Square A = symmetric(generator);
    const Modes6 modes = modes6(A);
    ASSERT_LT(error_of(A, modes), kRounding) << i << '\n' << A;
    if (i % 100 != 0) continue;
    Eigen::Matrix<double, 6, 1> values = modes.values;
    std::ranges::sort(values);
    ASSERT_LT((values - symmetric_eigenvalues<6>(A)).cwiseAbs().maxCoeff(), kRounding * values.cwiseAbs().maxCoeff()) << A;
  }
}

TEST(Modes6, DecomposeMatricesWithEqualAndVeryDifferentValues) {
  std::mt19937 generator(2);
  const std::vector<std::array<double, 6>> all = {{0, 0, 0, 0, 0, 0},
                                                  {1, 1, 1, 1, 1, 1},
                                                  {1, 1, 1, 2, 2, 2},
                                                  {0, 0, 0, 500, 500, 1e4},
                                                  {-3, -3, 0, 0, 3, 3},
                                                  {1e-12, 1e-9, 1e-6, 1, 1e3, 1e6},
                                                  {1e-290, 2e-290, 3e-290, 0, 0, 1e-290},
                                                  {1e290, 2e290, 0, 0, 1, 1e290}};
  for (const auto& of : all) {
    const Eigen::Map<const Eigen::Matrix<double, 6, 1>> values(of.data());
    for (int i = 0; i < 100; ++i) {
      const Square V = modes6(symmetric(generator)).vectors;
      const Square turned = V.transpose() * values.asDiagonal() * V;
      const Square A = i == 0 ? Square(values.asDiagonal()) : Square((turned + turned.transpose()) / 2);
      ASSERT_LT(error_of(A, modes6(A)), kRounding) << A;
    }
  }
}

TEST(Modes6, DecomposeBlocksOfTranslationAndRotation) {
  std::mt19937 generator(3);
  for (int i = 0; i < 1000; ++i) {
    Square A = symmetric(generator);
    A.topRightCorner<3, 3>().setZero();
    A.bottomLeftCorner<3, 3>().setZero();
    ASSERT_LT(error_of(A, modes6(A)), kRounding) << A;
  }
}

TEST(Modes6, DecomposeMatricesWithSmallElementsBesideTheDiagonal) {
  std::mt19937 generator(4);
  for (int power = -170; power <= 0; ++power) {
    Square A = symmetric(generator);
    for (int i = 0; i < 6; ++i) {
      for (int k = 0; k < 6; ++k) A(i, k) *= i == k || (i < 2 && k < 2) ? 1 : std::pow(10, power);
    }
    ASSERT_LT(error_of(A, modes6(A)), kRounding) << power << '\n' << A;
  }
}

TEST(Modes6, HaveNoValuesWhereAnElementIsNotFinite) {
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    Square A = Square::Identity();
    A(4, 2) = A(2, 4) = bad;
    EXPECT_FALSE(modes6(A).values.allFinite());
  }
}

}  // namespace
}  // namespace cotwin::numerics::modes_test
