#include "models/numerics/triangle.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <string>
#include <vector>

#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "models/numerics/batch.h"
#include "models/numerics/kernels/kernels.h"
#include "models/numerics/random.h"
#include "tests/support/allocations.h"

namespace cotwin::numerics::compression_test {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;
using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

MatrixXd random_matrix(Index rows, Index columns, std::uint32_t stream = 0) {
  MatrixXd A(rows, columns);
  for (Index r = 0; r < rows; ++r)
    for (Index c = 0; c < columns; ++c)
      A(r, c) = normal({7, stream, static_cast<std::uint32_t>(r), 0, static_cast<std::uint32_t>(c)});
  return A;
}

Triangle compressed(const MatrixXd& A, double forgetting = 1) {
  Triangle triangle(static_cast<std::size_t>(A.cols()), forgetting);
  for (Index r = 0; r < A.rows(); ++r) {
    const VectorXd row = A.row(r).transpose();
    triangle.add(row.data());
  }
  triangle.flush();
  return triangle;
}

MatrixXd matrix(const Triangle& triangle) {
  const auto p = static_cast<Index>(triangle.columns());
  return Eigen::Map<const RowMajor>(triangle.R(), p, p);
}

TEST(Triangle, HasTheGramMatrixOfAllRowsWhateverTheirNumber) {
  for (const Index rows : {1, 5, 63, 64, 65, 128, 1000})
    for (const Index columns : {1, 2, 7, 13, 48}) {
      const MatrixXd A = random_matrix(rows, columns);
      const Triangle triangle = compressed(A);
      const MatrixXd R = matrix(triangle);
      EXPECT_TRUE(R.isUpperTriangular(0));
      EXPECT_LT((R.transpose() * R - A.transpose() * A).norm(), 1e-13 * (A.transpose() * A).norm()) << rows << " x " << columns;
      EXPECT_EQ(triangle.rows(), static_cast<std::size_t>(rows));
      EXPECT_EQ(triangle.weight(), static_cast<double>(rows));
    }
}

// Columns that span eight orders of magnitude and are dependent to 1e-6: sums of squares would have lost all digits of the
// smallest directions, reflections lose none. Compares ‖X b − y‖² from R with all rows in extended precision.
TEST(Triangle, GivesSquaredErrorsToTwelveDigitsWhereSumsOfSquaresFail) {
  const Index rows = 20000, columns = 30;
  MatrixXd A = random_matrix(rows, columns + 1);
  for (Index c = 1; c < columns; ++c) A.col(c) = A.col(c - 1) + 1e-6 * A.col(c);
  for (Index c = 0; c < columns; ++c) A.col(c) *= std::pow(10.0, -4 + 8.0 * static_cast<double>(c) / (columns - 1));
  VectorXd truth = random_matrix(columns, 1, 3);
  for (Index c = 0; c < columns; ++c) truth[c] /= A.col(c).norm();
  A.col(columns) = A.leftCols(columns) * truth + 1e-3 * A.col(columns);
  const MatrixXd R = matrix(compressed(A));
  const auto squares = [&](const VectorXd& b) {
    long double sum = 0;
    for (Index r = 0; r < rows; ++r) {
      long double e = -static_cast<long double>(A(r, columns));
      for (Index c = 0; c < columns; ++c) e += static_cast<long double>(A(r, c)) * b[c];
      sum += e * e;
    }
    return static_cast<double>(sum);
  };
  VectorXd b(columns + 1);
  for (const double factor : {0.0, 0.5, 0.999, 1.5}) {  // far from the optimum and near it
    b << factor * truth, -1;
    const double expected = squares(b.head(columns));
    EXPECT_NEAR((R * b).squaredNorm(), expected, 1e-12 * expected) << factor;
  }
  // the least-squares solution itself
  const VectorXd solved = R.topLeftCorner(columns, columns).triangularView<Eigen::Upper>().solve(R.col(columns).head(columns));
  const double least = R(columns, columns) * R(columns, columns);
  EXPECT_NEAR(squares(solved), least, 1e-8 * least);
  EXPECT_LE(least, squares(truth) * (1 + 1e-12));
}

TEST(Triangle, ForgetsExponentially) {
  const double factor = 0.97;
  const Index rows = 333;
  const MatrixXd A = random_matrix(rows, 6);
  const Triangle triangle = compressed(A, factor);
  MatrixXd gram = MatrixXd::Zero(6, 6);
  double weight = 0;
  for (Index r = 0; r < rows; ++r) {
    gram += std::pow(factor, rows - 1 - r) * A.row(r).transpose() * A.row(r);
    weight += std::pow(factor, rows - 1 - r);
  }
  EXPECT_LT((matrix(triangle).transpose() * matrix(triangle) - gram).norm(), 1e-13 * gram.norm());
  EXPECT_NEAR(triangle.weight(), weight, 1e-12 * weight);
}

TEST(Triangle, MergedPartsEqualTheWhole) {
  const MatrixXd A = random_matrix(500, 9), older = random_matrix(171, 9, 1);
  for (const double factor : {1.0, 0.99}) {
    Triangle both = compressed(A, factor);
    both.merge(compressed(older, factor));
    MatrixXd all(671, 9);
    all << older, A;
    const Triangle expected = compressed(all, factor);
    const MatrixXd gram = matrix(expected).transpose() * matrix(expected);
    EXPECT_LT((matrix(both).transpose() * matrix(both) - gram).norm(), 1e-13 * gram.norm());
    EXPECT_EQ(both.rows(), 671u);
    EXPECT_NEAR(both.weight(), expected.weight(), 1e-11);
  }
}

TEST(Triangle, ContinuesToTheSameBitsFromWhatWasWritten) {
  const MatrixXd A = random_matrix(500, 13);
  for (const double forgetting : {1.0, 0.99}) {
    const Triangle whole = compressed(A, forgetting);
    for (const Index stop : {0, 1, 64, 100, 448}) {
      Triangle first(13, forgetting), second(13, forgetting);
      const auto add = [&](Triangle& triangle, Index from, Index to) {
        for (Index r = from; r < to; ++r) {
          const VectorXd row = A.row(r).transpose();
          triangle.add(row.data());
        }
      };
      add(first, 0, stop);
      add(second, 0, 77);  // is replaced
      ByteWriter out;
      first.write(out);
      ByteReader in(as_bytes(out.bytes()), "bytes");
      const auto before = cotwin::testing::allocations();
      second.read(in);
      EXPECT_EQ(cotwin::testing::allocations(), before);
      in.expect_end();
      EXPECT_EQ(second.rows(), static_cast<std::size_t>(stop));
      add(second, stop, 500);
      second.flush();
      EXPECT_EQ(matrix(second), matrix(whole)) << stop;
      EXPECT_EQ(second.weight(), whole.weight());
      EXPECT_EQ(second.rows(), 500u);
    }
  }
}

TEST(Triangle, RefusesInvalidNumbers) {
  const double nan = std::numeric_limits<double>::quiet_NaN(), infinity = std::numeric_limits<double>::infinity();
  Triangle triangle(3);
  const MatrixXd A = random_matrix(100, 3);
  for (Index r = 0; r < 100; ++r) {
    const VectorXd row = A.row(r).transpose();
    triangle.add(row.data());
  }
  ByteWriter out;
  triangle.write(out);
  const auto error_with = [&](std::size_t at, auto value) -> std::string {
    std::string bytes = out.bytes();
    std::memcpy(bytes.data() + at, &value, sizeof value);
    ByteReader in(as_bytes(bytes), "bytes");
    try {
      triangle.read(in);
    } catch (const Error& error) {
      return error.what();
    }
    return "";
  };
  EXPECT_EQ(error_with(0, std::uint64_t{1} << 53), "");
  EXPECT_EQ(error_with(0, std::uint64_t{1} << 54), "bytes: has a triangle of 18014398509481984 rows, expected at most 2^53");
  EXPECT_NE(error_with(0, std::uint64_t{35}).find("has 36 rows in an incomplete block"), std::string::npos);
  EXPECT_NE(error_with(8, std::uint64_t{64}).find("has 64 rows in an incomplete block"), std::string::npos);
  EXPECT_EQ(error_with(16, infinity), "bytes: has a number that is not finite in a triangle");
  EXPECT_NE(error_with(16, -1.0).find("expected 0 or above"), std::string::npos);
  for (std::size_t at = 24; at < out.bytes().size(); at += 8)
    EXPECT_EQ(error_with(at, nan), "bytes: has a number that is not finite in a triangle");
}

TEST(Triangle, ReducesDependentColumnsToZero) {
  MatrixXd A = random_matrix(300, 6);
  A.col(3) = A.col(0) - 2 * A.col(2);
  A.col(5).setZero();
  const MatrixXd R = matrix(compressed(A));
  EXPECT_LT(std::abs(R(3, 3)), 1e-13 * R.norm());
  EXPECT_EQ(R.col(5).norm(), 0);
}

TEST(Triangle, TakingRowsAllocatesNothing) {
  Triangle triangle(20);
  const VectorXd row = random_matrix(20, 1);
  const auto before = testing::allocations();
  for (int i = 0; i < 1000; ++i) triangle.add(row.data());
  EXPECT_EQ(testing::allocations(), before);
}

TEST(Triangle, RefusesInvalidForgettingFactors) {
  EXPECT_THROW(Triangle(0), Error);
  EXPECT_THROW(Triangle(3, 0), Error);
  EXPECT_THROW(Triangle(3, 1.01), Error);
  EXPECT_THROW(Triangle(3).merge(Triangle(4)), Error);
}

TEST(NumericsKernels, OfAllInstructionSetsAgreeToRounding) {
  for (const char* isa : {"x86-64-v2", "x86-64-v3", "x86-64-v4"}) {
    const NumericsKernels& k = kernels(isa);
    const std::size_t p = 23;
    std::vector<double> R(p * p, 0.0), block(p * 64);
    MatrixXd A(2 * 64, static_cast<Index>(p));
    for (int part = 0; part < 2; ++part) {
      const MatrixXd B = random_matrix(64, static_cast<Index>(p), static_cast<std::uint32_t>(part));
      A.middleRows(64 * part, 64) = B;
      std::copy(B.data(), B.data() + B.size(), block.begin());
      k.absorb(p, R.data(), block.data());
    }
    const Eigen::Map<const RowMajor> triangle(R.data(), static_cast<Index>(p), static_cast<Index>(p));
    EXPECT_LT((triangle.transpose() * triangle - A.transpose() * A).norm(), 1e-13 * (A.transpose() * A).norm()) << k.isa;
  }
}

TEST(NumericsKernels, OfAllInstructionSetsMultiplyAndMoveAlike) {
  // 13 rows of a 9-column matrix, packed by eight rows as kernels.h says
  const MatrixXd A = random_matrix(13, 9), x = random_matrix(8, 9, 2);
  std::vector<double> packed(2 * 9 * 8, 0.0);
  for (std::size_t r = 0; r < 13; ++r)
    for (std::size_t c = 0; c < 9; ++c) packed[(r / 8 * 9 + c) * 8 + r % 8] = A(static_cast<Index>(r), static_cast<Index>(c));
  const std::size_t first[2] = {0, 0};
  const std::vector<double> low(5, -1.0), high(5, 1.0);
  const std::vector<std::uint32_t> informant{3, 1, 4, 1, 5, 2, 6, 5};
  std::vector<double> moved;  // by the first of them
  for (const char* isa : {"x86-64-v2", "x86-64-v3", "x86-64-v4"}) {
    const NumericsKernels& k = kernels(isa);
    std::vector<double> y(2 * 8 * 8);
    k.times(13, 9, packed.data(), first, x.data(), 8, y.data());
    const MatrixXd expected = A * x.transpose();
    for (Index r = 0; r < 13; ++r)
      for (Index lane = 0; lane < 8; ++lane)
        EXPECT_NEAR(y[static_cast<std::size_t>(8 * r + lane)], expected(r, lane), 1e-13 * expected.norm()) << k.isa;
    const MatrixXd start = random_matrix(8, 5, 3), best = random_matrix(8, 5, 4);
    MatrixXd position = 0.9 * start.cwiseMax(-1).cwiseMin(1), speed = 0.3 * best;
    k.move(
        {5, 8, 0, 99, 7, 0.7, 1.5, 1.5, low.data(), high.data(), best.data(), informant.data(), position.data(), speed.data()});
    std::vector<double> result(position.data(), position.data() + 40);
    result.insert(result.end(), speed.data(), speed.data() + 40);
    if (moved.empty()) moved = result;
    for (std::size_t i = 0; i < 80; ++i) EXPECT_NEAR(result[i], moved[i], 1e-14) << k.isa;
  }
}

TEST(BatchMatrix, MultipliesEightColumnsAtOnce) {
  for (const Index rows : {1, 7, 8, 30})
    for (const Index columns : {1, 9, 70}) {
      RowMajor A = random_matrix(rows, columns);
      for (Index r = 0; r < rows; ++r) A.row(r).head(std::min(r, columns)).setZero();
      const BatchMatrix batch(static_cast<std::size_t>(rows), static_cast<std::size_t>(columns), A.data());
      const RowMajor x = random_matrix(columns, 11, 5);  // a stride of 11; the first eight columns are multiplied
      std::vector<double> y(batch.room());
      batch.times(x.data(), 11, y.data());
      const MatrixXd expected = A * x.leftCols(8);
      for (Index r = 0; r < rows; ++r)
        for (Index k = 0; k < 8; ++k)
          EXPECT_NEAR(y[static_cast<std::size_t>(8 * r + k)], expected(r, k), 1e-13 * (1 + expected.norm()));
    }
}

}  // namespace
}  // namespace cotwin::numerics::compression_test
