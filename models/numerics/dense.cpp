#include "models/numerics/dense.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/QR>
#include <Eigen/SVD>
#include <algorithm>

namespace cotwin::numerics {

using Eigen::Index;
using Eigen::Matrix;
using Eigen::MatrixXd;
using Eigen::VectorXd;

template <int N>
requires(N > 0) SymmetricEigen<N> symmetric_eigen(const Matrix<double, N, N>& A) {
  const Eigen::SelfAdjointEigenSolver<Matrix<double, N, N>> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}
template <int N>
requires(N > 0) Matrix<double, N, 1> symmetric_eigenvalues(const Matrix<double, N, N>& A) {
  return Eigen::SelfAdjointEigenSolver<Matrix<double, N, N>>(A, Eigen::EigenvaluesOnly).eigenvalues();
}
template SymmetricEigen<3> symmetric_eigen(const Matrix<double, 3, 3>&);
template SymmetricEigen<6> symmetric_eigen(const Matrix<double, 6, 6>&);
template Matrix<double, 3, 1> symmetric_eigenvalues(const Matrix<double, 3, 3>&);
template Matrix<double, 6, 1> symmetric_eigenvalues(const Matrix<double, 6, 6>&);

SymmetricEigen<Eigen::Dynamic> symmetric_eigen(const MatrixIn& A) {
  const Eigen::SelfAdjointEigenSolver<MatrixXd> solver(A);
  return {solver.eigenvalues(), solver.eigenvectors()};
}
VectorXd symmetric_eigenvalues(const MatrixIn& A) {
  return Eigen::SelfAdjointEigenSolver<MatrixXd>(A, Eigen::EigenvaluesOnly).eigenvalues();
}

Svd svd(const MatrixIn& A) {
  const Eigen::JacobiSVD<MatrixXd> svd(A, Eigen::ComputeFullU | Eigen::ComputeFullV);
  return {svd.singularValues(), svd.matrixU(), svd.matrixV()};
}
VectorXd singular_values(const MatrixIn& A) { return Eigen::JacobiSVD<MatrixXd>(A).singularValues(); }

VectorXd solve_ldlt(const MatrixIn& A, const VectorIn& b) { return Eigen::LDLT<MatrixXd>(A).solve(b); }
template <int N>
requires(N > 0) Matrix<double, N, 1> solve_ldlt(const Matrix<double, N, N>& A, const Matrix<double, N, 1>& b) {
  return A.ldlt().solve(b);
}
template Matrix<double, 7, 1> solve_ldlt(const Matrix<double, 7, 7>&, const Matrix<double, 7, 1>&);

std::optional<VectorXd> solve_semidefinite(const MatrixIn& A, const VectorIn& b) {
  const Eigen::LDLT<MatrixXd> ldlt(A);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive()) return std::nullopt;
  return ldlt.solve(b);
}

std::optional<VectorXd> solve_cholesky(const MatrixIn& A, const VectorIn& b) {
  const Eigen::LLT<MatrixXd> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor.solve(b);
}

std::optional<MatrixXd> inverse_root(const MatrixIn& A) {
  const Eigen::LLT<MatrixXd> factor(A);
  if (factor.info() != Eigen::Success) return std::nullopt;
  return factor.matrixU().solve(MatrixXd::Identity(A.rows(), A.cols()));
}

VectorXd least_squares(const MatrixIn& A, const VectorIn& b) { return Eigen::ColPivHouseholderQR<MatrixXd>(A).solve(b); }

MatrixXd qr_triangle(const MatrixIn& A) {
  return Eigen::HouseholderQR<MatrixXd>(A).matrixQR().topRows(std::min(A.rows(), A.cols())).triangularView<Eigen::Upper>();
}

MatrixXd orthonormal_basis(const MatrixIn& A, double threshold) {
  Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  qr.setThreshold(threshold);
  return qr.householderQ() * MatrixXd::Identity(A.rows(), qr.rank());
}

PivotedQr pivoted_qr(const MatrixIn& A, const VectorIn& b) {
  const Eigen::ColPivHouseholderQR<MatrixXd> qr(A);
  const Index rows = std::min(A.rows(), A.cols());
  return {qr.matrixR().topRows(rows).triangularView<Eigen::Upper>(), qr.colsPermutation().indices(), qr.rank(),
          qr.householderQ().transpose() * b};
}

}  // namespace cotwin::numerics
