#pragma once
#include <cstddef>

/// Solution of symmetric positive definite systems of the size of a robot. The loops are unrolled for six and seven joints.
namespace cotwin::drive_train {

/// A = L D Lᵀ in place for a symmetric positive definite A (n x n by columns, lower triangle read): L below the diagonal, 1/D
/// on it. N > 0 fixes n at compile time.
template <std::size_t N>
void ldlt(double* A, std::size_t dynamic_n) {
  const std::size_t n = N > 0 ? N : dynamic_n;
  for (std::size_t j = 0; j < n; ++j) {
    double* column = A + j * n;
    const double inverse = 1 / column[j];
    column[j] = inverse;
    for (std::size_t k = j + 1; k < n; ++k) {
      const double l = column[k] * inverse;
      double* target = A + k * n;
      for (std::size_t i = k; i < n; ++i) target[i] -= l * column[i];
    }
    for (std::size_t i = j + 1; i < n; ++i) column[i] *= inverse;
  }
}

/// x = A⁻¹ x with the factors of ldlt().
template <std::size_t N>
void solve_ldlt(const double* A, std::size_t dynamic_n, double* x) {
  const std::size_t n = N > 0 ? N : dynamic_n;
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t i = j + 1; i < n; ++i) x[i] -= A[j * n + i] * x[j];
  }
  for (std::size_t j = n; j-- > 0;) {
    double sum = x[j] * A[j * n + j];
    for (std::size_t i = j + 1; i < n; ++i) sum -= A[j * n + i] * x[i];
    x[j] = sum;
  }
}

inline void ldlt(double* A, std::size_t n) {
  switch (n) {
    case 6:
      return ldlt<6>(A, n);
    case 7:
      return ldlt<7>(A, n);
    default:
      return ldlt<0>(A, n);
  }
}

inline void solve_ldlt(const double* A, std::size_t n, double* x) {
  switch (n) {
    case 6:
      return solve_ldlt<6>(A, n, x);
    case 7:
      return solve_ldlt<7>(A, n, x);
    default:
      return solve_ldlt<0>(A, n, x);
  }
}

}  // namespace cotwin::drive_train
