#pragma once
#include <Eigen/Core>

namespace cotwin::numerics {

/// A = Uᵀ diag(values) U of a symmetric 6 x 6 matrix, in no order.
struct Modes6 {
  using Rows = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  Eigen::Matrix<double, 6, 1> values;
  Rows vectors;  // U; rows have length 1
};

/// For control steps: Householder reflections to a tridiagonal matrix and implicit QR steps with Wilkinson's shift (Golub, Van Loan, Matrix
/// Computations, 4th ed., 8.3), in less time than symmetric_eigen<6>(). Allocates nothing. Values are not finite if an element
/// of A is not.
Modes6 modes6(const Eigen::Matrix<double, 6, 6>& A);

}  // namespace cotwin::numerics
