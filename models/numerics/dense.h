#pragma once
#include <Eigen/Core>
#include <optional>

/// Decompositions of dense matrices, compiled once: each of Eigen's takes 1 to 8 s of processor time in every file that instantiates it.
/// Results are those of Eigen. The functions for matrices of any size allocate. Code that must not allocate, or whose speed counts, has
/// members of Eigen's own types instead and says so.
namespace cotwin::numerics {

using MatrixIn = Eigen::Ref<const Eigen::MatrixXd>;
using VectorIn = Eigen::Ref<const Eigen::VectorXd>;

/// A = V diag(values) Vᵀ, ascending values. Only the lower triangle of A is read.
template <int N>
struct SymmetricEigen {
  Eigen::Matrix<double, N, 1> values;
  Eigen::Matrix<double, N, N> vectors;  // V; columns have length 1
};
SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const MatrixIn& A);
Eigen::VectorXd symmetric_eigenvalues(const MatrixIn& A);
/// For N = 3 and 6, without allocation.
template <int N>
requires(N > 0) SymmetricEigen<N> symmetric_eigen(const Eigen::Matrix<double, N, N>& A);
template <int N>
requires(N > 0) Eigen::Matrix<double, N, 1> symmetric_eigenvalues(const Eigen::Matrix<double, N, N>& A);

/// A = U diag(values) Vᵀ with square U and V, descending values (one-sided Jacobi).
struct Svd {
  Eigen::VectorXd values;
  Eigen::MatrixXd U, V;
};
Svd svd(const MatrixIn& A);
Eigen::VectorXd singular_values(const MatrixIn& A);

/// x with A x = b for a symmetric A (L D Lᵀ with pivoting); not finite where A is singular.
Eigen::VectorXd solve_ldlt(const MatrixIn& A, const VectorIn& b);
/// The same for N = 7, without allocation.
template <int N>
requires(N > 0) Eigen::Matrix<double, N, 1> solve_ldlt(const Eigen::Matrix<double, N, N>& A,
                                                       const Eigen::Matrix<double, N, 1>& b);
/// The same; nullopt unless A is positive semidefinite.
std::optional<Eigen::VectorXd> solve_semidefinite(const MatrixIn& A, const VectorIn& b);
/// The same by Cholesky's method; nullopt unless A is positive definite.
std::optional<Eigen::VectorXd> solve_cholesky(const MatrixIn& A, const VectorIn& b);
/// R⁻¹ of A = Rᵀ R, upper triangular; nullopt unless A is positive definite.
std::optional<Eigen::MatrixXd> inverse_root(const MatrixIn& A);

/// The least-squares solution of A x = b (QR with pivoting of columns).
Eigen::VectorXd least_squares(const MatrixIn& A, const VectorIn& b);
/// R of A = Q R, min(rows, columns) rows.
Eigen::MatrixXd qr_triangle(const MatrixIn& A);
/// An orthonormal basis of the columns of A; values of R below `threshold` times the largest count as zero.
Eigen::MatrixXd orthonormal_basis(const MatrixIn& A, double threshold);
/// A P = Q R with pivoting of columns.
struct PivotedQr {
  Eigen::MatrixXd R;        // min(rows, columns) rows, upper triangular
  Eigen::VectorXi columns;  // of A, in the order of R's
  Eigen::Index rank;        // to the rounding of doubles
  Eigen::VectorXd Qb;       // Qᵀ b
};
PivotedQr pivoted_qr(const MatrixIn& A, const VectorIn& b);

}  // namespace cotwin::numerics
