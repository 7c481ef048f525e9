#include "models/control/cascade.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace cotwin::control {
namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// f(n), with n known to the compiler for arms of 7 joints, whose loops are then unrolled.
template <class F>
void with_joints(int n, F f) {
  if (n == 7) return f(std::integral_constant<int, 7>());
  f(n);
}

inline double dot(const double* a, const double* b, int n) {
  double sum = 0;
  for (int i = 0; i < n; ++i) sum += a[i] * b[i];
  return sum;
}

inline void add(double factor, const double* x, double* y, int n) {
  for (int i = 0; i < n; ++i) y[i] += factor * x[i];
}

/// A = R Rᵀ for the lower triangle of A (m x m, row-major). False if it is not positive definite.
bool cholesky(const double* A, double* R, int m) {
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j < i; ++j) R[i * m + j] = (A[i * m + j] - dot(R + i * m, R + j * m, j)) / R[j * m + j];
    const double square = A[i * m + i] - dot(R + i * m, R + i * m, i);
    if (!(square > 0)) return false;
    R[i * m + i] = std::sqrt(square);
  }
  return true;
}

/// Diagonal d and squares e² beside it of a tridiagonal matrix with the eigenvalues of the symmetric A, by Householder's
/// reflections. A (m x m, row-major, lower triangle) is overwritten.
inline void tridiagonalise(double* A, double* d, double* e_squared, int m) {
  for (int k = 0; k + 1 < m; ++k) {
    d[k] = A[k * m + k];
    double v[kMostRows], w[kMostRows];
    double square = 0;
    for (int i = k + 1; i < m; ++i) {
      v[i] = A[i * m + k];
      square += v[i] * v[i];
    }
    e_squared[k] = square;
    const double rest = square - v[k + 1] * v[k + 1];
    if (k + 2 == m || !(rest > 0)) continue;
    v[k + 1] += std::copysign(std::sqrt(square), v[k + 1]);
    const double beta = 2 / (rest + v[k + 1] * v[k + 1]);
    double product = 0;
    for (int i = k + 1; i < m; ++i) {
      double sum = 0;
      for (int j = k + 1; j < m; ++j) sum += (j <= i ? A[i * m + j] : A[j * m + i]) * v[j];
      w[i] = beta * sum;
      product += w[i] * v[i];
    }
    for (int i = k + 1; i < m; ++i) w[i] -= beta / 2 * product * v[i];
    for (int i = k + 1; i < m; ++i) {
      for (int j = k + 1; j <= i; ++j) A[i * m + j] -= v[i] * w[j] + w[i] * v[j];
    }
  }
  d[m - 1] = A[m * m - 1];
}

/// Smallest eigenvalue of the symmetric positive semidefinite G (m x m, row-major; `A`: scratch of that size), by Laguerre's
/// iteration on its tridiagonal form, whose L D Lᵀ has the pivots δ_k(λ). From below it converges monotonically and cubically,
/// because all roots are real: with S_1 = −Σ δ'/δ and S_2 = −S_1', λ += m/(S_1 + √((m − 1)(m S_2 − S_1²))). Pivots, unlike the
/// characteristic polynomial, keep their digits where several eigenvalues are 0.
inline double smallest_eigenvalue(const double* G, double* A, int m) {
  constexpr int kMost = 20;
  constexpr double kEnough = 1e-7;  // of λ; the next step would be about its third power
  double trace = 0;
  for (int i = 0; i < m; ++i) trace += G[i * m + i];
  if (!(trace > 0)) return 0;
  for (int i = 0; i < m * m; ++i) A[i] = G[i] / trace;
  double d[kMostRows], e_squared[kMostRows];
  tridiagonalise(A, d, e_squared, m);
  double x = 0;
  for (int i = 0; i < kMost; ++i) {
    double pivot = d[0] - x, u = -1 / pivot, w = 0;  // w: δ''/δ
    double S_1 = -u, S_2 = u * u;
    bool positive = pivot > 0;
    for (int k = 1; k < m; ++k) {
      const double r = e_squared[k - 1] / pivot;
      const double slope = r * u - 1, curvature = r * (w - 2 * u * u);
      pivot = d[k] - x - r;
      positive = positive && pivot > 0;
      u = slope / pivot;
      w = curvature / pivot;
      S_1 -= u;
      S_2 += u * u - w;
    }
    if (!positive) break;
    const double step = m / (S_1 + std::sqrt(std::max(0.0, (m - 1) * (m * S_2 - S_1 * S_1))));
    x += step;
    if (!(step > kEnough * x)) break;
  }
  return x * trace;
}

double smallest_eigenvalue_of(const double* G, double* A, int m) {
  if (m == 6) return smallest_eigenvalue(G, A, 6);  // unrolled
  if (m == 3) return smallest_eigenvalue(G, A, 3);
  return smallest_eigenvalue(G, A, m);
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
      t(static_cast<std::size_t>(rows)),
      damped(rows, rows),
      eigen(Square::Identity(rows, rows)) {}

Cascade::Cascade(int n, const std::vector<int>& rows)
    : n_(n),
      L_(static_cast<std::size_t>(n * n)),
      inverse_diagonal_(static_cast<std::size_t>(n)),
      columns_(static_cast<std::size_t>(n * kMostRows)),
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

template <int N>
bool Cascade::factorise(const MatrixIn& M) {
  const int n = N > 0 ? N : n_;
  double* L = L_.data();
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < i; ++j) {
      L[i * n + j] = (M(i, j) - dot(L + i * n, L + j * n, j)) * inverse_diagonal_[static_cast<std::size_t>(j)];
    }
    const double square = M(i, i) - dot(L + i * n, L + i * n, i);
    if (!(square > 0)) return false;
    L[i * n + i] = std::sqrt(square);
    inverse_diagonal_[static_cast<std::size_t>(i)] = 1 / L[i * n + i];
  }
  return true;
}

void Cascade::lower_solve(double* x) const {
  with_joints(n_, [&](auto n) {
    for (int i = 0; i < n; ++i) x[i] = (x[i] - dot(L_.data() + i * n, x, i)) * inverse_diagonal_[static_cast<std::size_t>(i)];
  });
}

void Cascade::forward(const double* x, double* y) const {
  with_joints(n_, [&](auto n) {
    std::fill(y, y + n, 0.0);
    for (int i = 0; i < n; ++i) add(x[i], L_.data() + i * n, y, i + 1);
  });
}

void Cascade::backward(const double* y, double* x) const {
  with_joints(n_, [&](auto n) {
    std::copy(y, y + n, x);
    for (int i = n - 1; i >= 0; --i) {
      x[i] *= inverse_diagonal_[static_cast<std::size_t>(i)];
      add(-x[i], L_.data() + i * n, x, i);
    }
  });
}

// Ĵ = diag(scale) J L⁻ᵀ: L Ĵᵀ = (scaled J)ᵀ for all rows at once.
template <int N>
void Cascade::whiten(const Task& task, Level& level) {
  const int n = N > 0 ? N : n_;
  const int m = static_cast<int>(task.a.size());
  for (int i = 0; i < n; ++i) {
    double* x = columns_.data() + i * kMostRows;
    for (int r = 0; r < m; ++r) x[r] = task.scale[r] * task.J(r, i);
    for (int j = 0; j < i; ++j) {
      const double factor = L_[static_cast<std::size_t>(i * n + j)];
      const double* other = columns_.data() + j * kMostRows;
      for (int r = 0; r < kMostRows; ++r) x[r] -= factor * other[r];
    }
    for (int r = 0; r < kMostRows; ++r) x[r] *= inverse_diagonal_[static_cast<std::size_t>(i)];
    for (int r = 0; r < m; ++r) level.J_hat[static_cast<std::size_t>(r * n + i)] = x[r];
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
template <int N>
void Cascade::gram(const Task& task, Level& level, bool projected) {
  const int n = N > 0 ? N : n_;
  const int m = static_cast<int>(task.J.rows());
  double* rows = Y_.data() + level.first * n;  // free until orthonormalise()
  for (int i = 0; i < m; ++i) {
    double* row = rows + i * n;
    if (projected) {
      const double* w = level.W.data() + i * n;
      for (int j = 0; j < n; ++j) row[j] = dot(L_.data() + j * n, w, j + 1);
    } else {
      for (int j = 0; j < n; ++j) row[j] = task.scale[i] * task.J(i, j);
    }
    for (int j = 0; j <= i; ++j)
      level.G[static_cast<std::size_t>(i * m + j)] = level.G[static_cast<std::size_t>(j * m + i)] = dot(row, rows + j * n, n);
  }
}

// Rows W = R Y with Y Yᵀ = 1 (Gram–Schmidt, again where a row nearly vanished), Y ← √activation Y.
template <int N>
void Cascade::orthonormalise(Level& level, int m) {
  const int n = N > 0 ? N : n_;
  constexpr double kMuch = 0.1;  // where this is left of a row's square, rounding spoils the next digit: again
  double* Y = Y_.data() + level.first * n;
  for (int i = 0; i < m; ++i) {
    double* row = Y + i * n;
    double* R = level.R.data() + i * m;
    std::copy_n(level.W.data() + i * n, n, row);
    std::fill_n(R, i, 0.0);
    double square = dot(row, row, n), before;
    do {
      double c[kMostRows];
      for (int j = 0; j < i; ++j) c[j] = dot(row, Y + j * n, n);
      for (int j = 0; j < i; ++j) add(-c[j], Y + j * n, row, n);
      for (int j = 0; j < i; ++j) R[j] += c[j];
      before = square;
      square = dot(row, row, n);
    } while (square < kMuch * before);
    R[i] = std::sqrt(square);
    const double inverse = 1 / R[i];
    for (int j = 0; j < n; ++j) row[j] *= inverse;
  }
  if (level.root == 1) return;
  for (int i = 0; i < m * n; ++i) Y[i] *= level.root;
}

// A + s lambda_0² U diag(sigma_0² − g²)⁺ Uᵀ = R Rᵀ, A = Ĵ Wᵀ; Y = √activation R⁻¹ W.
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
    const double square = lambda_0 * lambda_0 * (sigma_0 * sigma_0 - std::max(0.0, level.eigen.eigenvalues()[i]));
    if (!(square > 0)) continue;
    most = std::max(most, square);
    const auto u = level.eigen.eigenvectors().col(i);
    level.damped += (s * square) * (u * u.transpose());
  }
  task.lambda = std::sqrt(most);
  Eigen::Map<Rows>(level.G.data(), m, m) = level.damped;  // G is not needed any more; its lower triangle is used
  if (!cholesky(level.G.data(), level.R.data(), m)) return;
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

template <int N>
bool Cascade::decompose_as(const MatrixIn& M) {
  if (!factorise<N>(M)) return false;
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
    whiten<N>(task, level);
    level.W = level.J_hat;
    for (int i = 0; i < m; ++i) project_row(level, level.W.data() + i * n_);
    gram<N>(task, level, rows_ > 0);
    task.sigma_min = std::sqrt(smallest_eigenvalue_of(level.G.data(), level.R.data(), m));
    if (level.root == 0) continue;
    if (exact_ && task.sigma_min >= sigma_0) {
      level.active = true;
      orthonormalise<N>(level, m);
    } else {
      damp(task, level, m);
    }
    if (!level.active || task.lambda > 0 || level.root < 1) exact_ = false;
    if (level.active) rows_ += m;
  }
  return true;
}

bool Cascade::decompose(const MatrixIn& M) { return n_ == 7 ? decompose_as<7>(M) : decompose_as<0>(M); }

void Cascade::solve(VectorOut ddq) {
  std::fill(z_.begin(), z_.end(), 0.0);
  with_joints(n_, [&](auto n) {
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      Task& task = tasks[k];
      Level& level = levels_[k];
      if (!level.active) continue;
      const int m = static_cast<int>(task.a.size());
      double* t = level.t.data();
      for (int i = 0; i < m; ++i) {  // t = R⁻¹ (a − J q̈), rows scaled
        const double rest = task.scale[i] * task.a[i] - dot(level.J_hat.data() + i * n, z_.data(), n);
        const double* R = level.R.data() + i * m;
        t[i] = (rest - dot(R, t, i)) / R[i];
      }
      for (int i = 0; i < m; ++i) add(level.root * t[i], Y_.data() + (level.first + i) * n, z_.data(), n);
    }
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      Task& task = tasks[k];
      for (int i = 0; i < static_cast<int>(task.a.size()); ++i)
        task.residual[i] = task.a[i] - dot(levels_[k].J_hat.data() + i * n, z_.data(), n) / task.scale[i];
    }
  });
  backward(z_.data(), ddq.data());
}

void Cascade::remove(double* x) {
  double* c = c_.data();
  with_joints(n_, [&](auto n) {
    for (int j = 0; j < rows_; ++j) c[j] = dot(x, Y_.data() + j * n, n);
    for (int j = 0; j < rows_; ++j) add(-c[j], Y_.data() + j * n, x, n);
  });
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
  with_joints(n_, [&](auto n) {
    for (std::size_t k = tasks.size(); k-- > 0;) {
      const Task& task = tasks[k];
      const Level& level = levels_[k];
      Eigen::VectorXd& f = forces[k];
      if (!level.active) {
        f.setZero();
        continue;
      }
      const int m = static_cast<int>(task.a.size());
      for (int i = 0; i < m; ++i) f[i] = level.root * dot(Y_.data() + (level.first + i) * n, x_.data(), n);
      for (int i = m - 1; i >= 0; --i) {
        f[i] /= level.R[static_cast<std::size_t>(i * m + i)];
        for (int j = 0; j < i; ++j) f[j] -= level.R[static_cast<std::size_t>(i * m + j)] * f[i];
      }
      for (int i = 0; i < m; ++i) {
        add(-f[i], level.J_hat.data() + i * n, x_.data(), n);
        f[i] *= task.scale[i];
      }
    }
  });
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
