#include "models/control/cascade.h"

#include <algorithm>
#include <cmath>

namespace cotwin::control {
namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

void add(double factor, const double* x, double* y, int n) {
  for (int i = 0; i < n; ++i) y[i] += factor * x[i];
}

/// A = R Rᵀ for the lower triangle of A − shift I (m x m, row-major). False if it is not positive definite.
inline bool cholesky(const double* A, double shift, double* R, int m) {
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < i; ++j) R[i * m + j] = (A[i * m + j] - dot(R + i * m, R + j * m, j)) / R[j * m + j];
    const double square = A[i * m + i] - shift - dot(R + i * m, R + i * m, i);
    if (!(square > 0)) return false;
    R[i * m + i] = std::sqrt(square);
  }
  return true;
}

/// R⁻¹ of a lower triangle (m x m, row-major).
inline void invert(const double* R, double* inverse, int m) {
  for (int i = 0; i < m; ++i) {
    const double d = 1 / R[i * m + i];
    inverse[i * m + i] = d;
    for (int j = 0; j < i; ++j) {
      double sum = 0;
      for (int k = j; k < i; ++k) sum += R[i * m + k] * inverse[k * m + j];
      inverse[i * m + j] = -d * sum;
    }
  }
}

/// Smallest eigenvalue of the symmetric positive semidefinite G, by Laguerre's iteration from below, which converges cubically
/// and monotonically for real roots: with S_1 = Σ 1/(λ_i − λ), S_2 = Σ 1/(λ_i − λ)², λ += m/(S_1 + √((m − 1)(m S_2 − S_1²))).
/// `R`, `X`: scratch, m x m.
inline double smallest_eigenvalue(const double* G, double* R, double* X, int m) {
  constexpr int kMost = 12;
  constexpr double kEnough = 1e-9;  // of the step before the last; the next step would be its third power
  double lambda = 0;
  for (int i = 0; i < kMost && cholesky(G, lambda, R, m); ++i) {
    invert(R, X, m);
    double S_1 = 0, S_2 = 0;
    for (int a = 0; a < m; ++a) {
      for (int b = 0; b <= a; ++b) {  // (X Xᵀ)_ab has the same Frobenius norm as Xᵀ X
        const double product = dot(X + a * m, X + b * m, b + 1);
        S_2 += (a == b ? 1 : 2) * product * product;
        if (a == b) S_1 += product;
      }
    }
    const double step = m / (S_1 + std::sqrt(std::max(0.0, (m - 1) * (m * S_2 - S_1 * S_1))));
    lambda += step;
    if (!(step > kEnough * lambda)) break;
  }
  return lambda;
}

double smallest_eigenvalue_of(const double* G, double* R, double* X, int m) {
  if (m == 6) return smallest_eigenvalue(G, R, X, 6);  // unrolled
  if (m == 3) return smallest_eigenvalue(G, R, X, 3);
  return smallest_eigenvalue(G, R, X, m);
}

}  // namespace

Task::Task(int rows, int joints)
    : J(Eigen::MatrixXd::Zero(rows, joints)),
      dJ(Eigen::MatrixXd::Zero(rows, joints)),
      a(Eigen::VectorXd::Zero(rows)),
      scale(Eigen::VectorXd::Ones(rows)),
      residual(Eigen::VectorXd::Zero(rows)) {}

Cascade::Level::Level(int rows, int n)
    : J_hat(static_cast<std::size_t>(rows * n)),
      W(J_hat),
      R(static_cast<std::size_t>(rows * rows)),
      G(R),
      scratch(R),
      t(static_cast<std::size_t>(rows)),
      c(t),
      damped(rows, rows),
      eigen(rows) {}

Cascade::Cascade(int n, const std::vector<int>& rows)
    : n_(n),
      L_(static_cast<std::size_t>(n * n)),
      inverse_diagonal_(static_cast<std::size_t>(n)),
      x_(static_cast<std::size_t>(n)),
      z_(static_cast<std::size_t>(n)) {
  int all = 0;
  for (const int m : rows) {
    tasks.emplace_back(m, n);
    levels_.emplace_back(m, n);
    all += m;
  }
  Y_.resize(static_cast<std::size_t>(all * n));
  c_.resize(static_cast<std::size_t>(all));
}

bool Cascade::factorise(const MatrixIn& M) {
  double* L = L_.data();
  for (int i = 0; i < n_; ++i) {
    for (int j = 0; j < i; ++j) {
      L[i * n_ + j] = (M(i, j) - dot(L + i * n_, L + j * n_, j)) * inverse_diagonal_[static_cast<std::size_t>(j)];
    }
    const double square = M(i, i) - dot(L + i * n_, L + i * n_, i);
    if (!(square > 0)) return false;
    L[i * n_ + i] = std::sqrt(square);
    inverse_diagonal_[static_cast<std::size_t>(i)] = 1 / L[i * n_ + i];
  }
  return true;
}

void Cascade::lower_solve(double* x) const {
  for (int i = 0; i < n_; ++i) x[i] = (x[i] - dot(L_.data() + i * n_, x, i)) * inverse_diagonal_[static_cast<std::size_t>(i)];
}

void Cascade::forward(const double* x, double* y) const {
  std::fill(y, y + n_, 0.0);
  for (int i = 0; i < n_; ++i) add(x[i], L_.data() + i * n_, y, i + 1);
}

void Cascade::backward(const double* y, double* x) const {
  std::copy(y, y + n_, x);
  for (int i = n_ - 1; i >= 0; --i) {
    x[i] *= inverse_diagonal_[static_cast<std::size_t>(i)];
    add(-x[i], L_.data() + i * n_, x, i);
  }
}

// Ĵ = diag(scale) J L⁻ᵀ by rows: L Ĵ_iᵀ = J_iᵀ.
void Cascade::whiten(const Task& task, Level& level) {
  const int m = static_cast<int>(task.J.rows());
  for (int i = 0; i < m; ++i) {
    double* row = level.J_hat.data() + i * n_;
    for (int j = 0; j < n_; ++j) row[j] = task.scale[i] * task.J(i, j);
    lower_solve(row);
  }
}

// row ← row (I − Yᵀ Y) with the rows of the levels above, twice if that is a projector: removes what rounding left.
void Cascade::project_row(const Level& level, double* row) {
  double* c = c_.data();
  for (int pass = 0; pass < (exact_ ? 2 : 1); ++pass) {
    for (int j = 0; j < level.first; ++j) c[j] = dot(row, Y_.data() + j * n_, n_);
    for (int j = 0; j < level.first; ++j) add(-c[j], Y_.data() + j * n_, row, n_);
  }
}

// G = J_k|p J_k|pᵀ; J_k|p = W Lᵀ.
void Cascade::gram(const Task& task, Level& level, bool projected) {
  const int m = static_cast<int>(task.J.rows());
  double* rows = Y_.data() + level.first * n_;  // free until orthonormalise()
  for (int i = 0; i < m; ++i) {
    double* row = rows + i * n_;
    if (projected) {
      const double* w = level.W.data() + i * n_;
      for (int j = 0; j < n_; ++j) row[j] = dot(L_.data() + j * n_, w, j + 1);
    } else {
      for (int j = 0; j < n_; ++j) row[j] = task.scale[i] * task.J(i, j);
    }
    for (int j = 0; j <= i; ++j)
      level.G[static_cast<std::size_t>(i * m + j)] = level.G[static_cast<std::size_t>(j * m + i)] = dot(row, rows + j * n_, n_);
  }
}

// Rows W = R Y with Y Yᵀ = 1 (Gram–Schmidt, twice), Y ← √activation Y.
void Cascade::orthonormalise(Level& level, int m) {
  double* Y = Y_.data() + level.first * n_;
  for (int i = 0; i < m; ++i) {
    double* row = Y + i * n_;
    double* R = level.R.data() + i * m;
    std::copy_n(level.W.data() + i * n_, n_, row);
    std::fill_n(R, i, 0.0);
    for (int pass = 0; pass < 2; ++pass) {
      double* c = level.c.data();
      for (int j = 0; j < i; ++j) c[j] = dot(row, Y + j * n_, n_);
      for (int j = 0; j < i; ++j) add(-c[j], Y + j * n_, row, n_);
      for (int j = 0; j < i; ++j) R[j] += c[j];
    }
    R[i] = std::sqrt(dot(row, row, n_));
    const double inverse = 1 / R[i];
    for (int j = 0; j < n_; ++j) row[j] *= inverse;
  }
  if (level.root == 1) return;
  for (int i = 0; i < m * n_; ++i) Y[i] *= level.root;
}

// A + s U diag(sigma_0² − g²)⁺ Uᵀ = R Rᵀ, A = Ĵ Wᵀ; Y = √activation R⁻¹ W.
void Cascade::damp(Task& task, Level& level, int m) {
  const auto G = Eigen::Map<const Rows>(level.G.data(), m, m);
  double squares = 0;
  for (int i = 0; i < m; ++i) squares += task.scale[i] * task.scale[i] * task.J.row(i).squaredNorm();
  if (!(squares > 0)) return;  // J = 0
  const double s = dot(level.J_hat.data(), level.J_hat.data(), m * n_) / squares;
  level.damped = G;
  level.eigen.compute(level.damped);
  double most = 0;
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < m; ++j) level.damped(i, j) = dot(level.J_hat.data() + i * n_, level.W.data() + j * n_, n_);
  }
  for (int i = 0; i < m; ++i) {
    const double square = sigma_0 * sigma_0 - std::max(0.0, level.eigen.eigenvalues()[i]);
    if (!(square > 0)) continue;
    most = std::max(most, square);
    const auto u = level.eigen.eigenvectors().col(i);
    level.damped += (s * square) * (u * u.transpose());
  }
  task.lambda = std::sqrt(most);
  Eigen::Map<Rows>(level.G.data(), m, m) = level.damped;  // G is not needed any more; its lower triangle is used
  if (!cholesky(level.G.data(), 0, level.R.data(), m)) return;
  level.active = true;
  double* Y = Y_.data() + level.first * n_;
  for (int i = 0; i < m; ++i) {
    const double* R = level.R.data() + i * m;
    double* row = Y + i * n_;
    std::copy_n(level.W.data() + i * n_, n_, row);
    for (int j = 0; j < i; ++j) add(-R[j], Y + j * n_, row, n_);
    const double inverse = 1 / R[i];
    for (int j = 0; j < n_; ++j) row[j] *= inverse;
  }
  for (int i = 0; i < m * n_; ++i) Y[i] *= level.root;
}

bool Cascade::decompose(const MatrixIn& M) {
  if (!factorise(M)) return false;
  rows_ = 0;
  exact_ = true;
  for (std::size_t k = 0; k < tasks.size(); ++k) {
    Task& task = tasks[k];
    Level& level = levels_[k];
    const int m = static_cast<int>(task.a.size());
    level.first = rows_;
    level.active = false;
    level.root = std::sqrt(std::clamp(task.activation, 0.0, 1.0));
    task.lambda = 0;
    whiten(task, level);
    level.W = level.J_hat;
    for (int i = 0; i < m; ++i) project_row(level, level.W.data() + i * n_);
    gram(task, level, rows_ > 0);
    task.sigma_min = std::sqrt(smallest_eigenvalue_of(level.G.data(), level.R.data(), level.scratch.data(), m));
    if (level.root == 0) continue;
    if (exact_ && task.sigma_min >= sigma_0) {
      level.active = true;
      orthonormalise(level, m);
    } else {
      damp(task, level, m);
    }
    if (!level.active || task.lambda > 0 || level.root < 1) exact_ = false;
    if (level.active) rows_ += m;
  }
  return true;
}

void Cascade::solve(VectorOut ddq) {
  std::fill(z_.begin(), z_.end(), 0.0);
  for (std::size_t k = 0; k < tasks.size(); ++k) {
    const Task& task = tasks[k];
    Level& level = levels_[k];
    if (!level.active) continue;
    const int m = static_cast<int>(task.a.size());
    double* t = level.t.data();
    for (int i = 0; i < m; ++i) {  // t = R⁻¹ (a − J q̈), rows scaled
      const double rest = task.scale[i] * task.a[i] - dot(level.J_hat.data() + i * n_, z_.data(), n_);
      const double* R = level.R.data() + i * m;
      t[i] = (rest - dot(R, t, i)) / R[i];
    }
    for (int i = 0; i < m; ++i) add(level.root * t[i], Y_.data() + (level.first + i) * n_, z_.data(), n_);
  }
  backward(z_.data(), ddq.data());
  for (std::size_t k = 0; k < tasks.size(); ++k) {
    Task& task = tasks[k];
    for (Eigen::Index i = 0; i < task.a.size(); ++i) {
      task.residual[i] = task.a[i] - dot(levels_[k].J_hat.data() + i * n_, z_.data(), n_) / task.scale[i];
    }
  }
}

void Cascade::remove(double* x) {
  double* c = c_.data();
  for (int j = 0; j < rows_; ++j) c[j] = dot(x, Y_.data() + j * n_, n_);
  for (int j = 0; j < rows_; ++j) add(-c[j], Y_.data() + j * n_, x, n_);
}

void Cascade::project(VectorOut v) {
  forward(v.data(), x_.data());
  remove(x_.data());
  backward(x_.data(), v.data());
}

// Nᵀ = L (I − Yᵀ Y) L⁻¹
void Cascade::project_force(VectorOut tau) {
  std::copy_n(tau.data(), n_, x_.data());
  lower_solve(x_.data());
  remove(x_.data());
  for (int i = 0; i < n_; ++i) tau[i] = dot(L_.data() + i * n_, x_.data(), i + 1);
}

void Cascade::solve_mass(VectorOut x) {
  std::copy_n(x.data(), n_, x_.data());
  lower_solve(x_.data());
  backward(x_.data(), x.data());
}

// From the last task to the first: f_k = A^# J_k|p v, v ← v − M⁻¹ J_kᵀ f_k. What is left of v after task k has no more part of
// the tasks k … r; A^# = activation R⁻ᵀ R⁻¹ and √activation R⁻¹ W = Y.
void Cascade::split(VectorOut v, std::vector<Eigen::VectorXd>& forces) {
  forward(v.data(), x_.data());
  for (std::size_t k = tasks.size(); k-- > 0;) {
    const Task& task = tasks[k];
    Level& level = levels_[k];
    Eigen::VectorXd& f = forces[k];
    if (!level.active) {
      f.setZero();
      continue;
    }
    const int m = static_cast<int>(task.a.size());
    for (int i = 0; i < m; ++i) f[i] = level.root * dot(Y_.data() + (level.first + i) * n_, x_.data(), n_);
    for (int i = m - 1; i >= 0; --i) {
      f[i] /= level.R[static_cast<std::size_t>(i * m + i)];
      for (int j = 0; j < i; ++j) f[j] -= level.R[static_cast<std::size_t>(i * m + j)] * f[i];
    }
    for (int i = 0; i < m; ++i) {
      add(-f[i], level.J_hat.data() + i * n_, x_.data(), n_);
      f[i] *= task.scale[i];
    }
  }
  backward(x_.data(), v.data());
}

void Cascade::projector(MatrixOut N) {
  N.setIdentity();
  for (int j = 0; j < n_; ++j) project(N.col(j));
}

void Cascade::inverse(std::size_t k, MatrixOut J_bar) {
  const Task& task = tasks[k];
  Level& level = levels_[k];
  const int m = static_cast<int>(task.a.size());
  J_bar.setZero();
  if (!level.active) return;
  double* t = level.t.data();
  for (int column = 0; column < m; ++column) {
    std::fill(z_.begin(), z_.end(), 0.0);
    for (int i = 0; i < m; ++i) {
      const double* R = level.R.data() + i * m;
      t[i] = ((i == column ? task.scale[i] : 0) - dot(R, t, i)) / R[i];
      add(level.root * t[i], Y_.data() + (level.first + i) * n_, z_.data(), n_);
    }
    backward(z_.data(), J_bar.col(column).data());
  }
}

}  // namespace cotwin::control
