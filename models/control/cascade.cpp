#include "models/control/cascade.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "models/control/small_matrices.h"

namespace cotwin::control {
namespace {

using Rows = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

template <int N>
using Constant = std::integral_constant<int, N>;

/// f(n), with n known to the compiler for arms of 7 joints, whose loops are then unrolled.
template <class F>
auto with_joints(int n, F f) {
  if (n == 7) return f(Constant<7>());
  return f(n);
}

/// f(m), with m known to the compiler for poses, and for positions and orientations.
template <class F>
auto with_rows(int m, F f) {
  if (m == 6) return f(Constant<6>());
  if (m == 3) return f(Constant<3>());
  return f(m);
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
      inverse(static_cast<std::size_t>(rows)),
      G(R),
      t(inverse),
      damped(rows, rows),
      eigen(Square::Identity(rows, rows)) {}

Cascade::Cascade(int n, const std::vector<int>& rows)
    : n_(n),
      l_(static_cast<std::size_t>(n * n)),
      root_(static_cast<std::size_t>(n)),
      inverse_root_(root_),
      columns_(static_cast<std::size_t>(n * kMostRows)),
      x_(root_),
      z_(root_) {
  int all = 0;
  for (const int m : rows) {
    tasks.emplace_back(m, n);
    levels_.emplace_back(m, n);
    all += m;
  }
  Y_.resize(static_cast<std::size_t>(all * n));
  c_.resize(static_cast<std::size_t>(all));
}

// M = l D lᵀ with ones on the diagonal of l, so L = l √D, column by column: only the quotients 1/d wait for one another.
template <class N>
bool Cascade::factorise(const MatrixIn& M, N n) {
  double *l = l_.data(), *root = root_.data(), *inverse_root = inverse_root_.data(), *column = columns_.data();
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j <= i; ++j) l[i * n + j] = M(i, j);
  }
  bool positive = true;
  each(n, [&](auto k) {
    const double d = l[k * n + k], inverse = 1 / d;
    positive = positive && d > 0;
    root[k] = std::sqrt(std::max(d, 0.0));
    inverse_root[k] = 1 / root[k];
    for (int i = k + 1; i < n; ++i) column[i] = l[i * n + k];
    for (int i = k + 1; i < n; ++i) {
      const double quotient = column[i] * inverse;
      add(-quotient, column + k + 1, l + i * n + k + 1, i - k);
      l[i * n + k] = quotient;
    }
  });
  return positive;
}

// x ← L⁻¹ x
void Cascade::lower_solve(double* x) const {
  with_joints(n_, [&](auto n) {
    const double *l = l_.data(), *inverse_root = inverse_root_.data();
    each(n, [&](auto j) {
      for (int i = j + 1; i < n; ++i) x[i] -= l[i * n + j] * x[j];
    });
    for (int i = 0; i < n; ++i) x[i] *= inverse_root[i];
  });
}

// y = Lᵀ x
void Cascade::forward(const double* x, double* y) const {
  with_joints(n_, [&](auto n) {
    const double *l = l_.data(), *root = root_.data();
    std::copy(x, x + n, y);
    each(n, [&](auto i) { add(x[i], l + i * n, y, i); });
    for (int i = 0; i < n; ++i) y[i] *= root[i];
  });
}

// x = L⁻ᵀ y
void Cascade::backward(const double* y, double* x) const {
  with_joints(n_, [&](auto n) {
    const double *l = l_.data(), *inverse_root = inverse_root_.data();
    for (int i = 0; i < n; ++i) x[i] = y[i] * inverse_root[i];
    each_down(n, [&](auto i) { add(-x[i], l + i * n, x, i); });
  });
}

// Ĵ = diag(scale) J L⁻ᵀ: L Ĵᵀ = (scaled J)ᵀ for all rows at once.
template <class N>
void Cascade::whiten(const Task& task, Level& level, N n) {
  const int m = static_cast<int>(task.a.size());
  const double *l = l_.data(), *inverse_root = inverse_root_.data(), *scale = task.scale.data();
  each(n, [&](auto i) {
    double* x = columns_.data() + i * kMostRows;
    const double* J = task.J.data() + i * m;
    for (int r = 0; r < m; ++r) x[r] = scale[r] * J[r];
    for (int j = 0; j < i; ++j) add(-l[i * n + j], columns_.data() + j * kMostRows, x, kMostRows);
  });
  for (int i = 0; i < n; ++i) {
    for (int r = 0; r < m; ++r)
      level.J_hat[static_cast<std::size_t>(r * n + i)] =
          inverse_root[i] * columns_[static_cast<std::size_t>(i * kMostRows + r)];
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
template <class N, class M>
void Cascade::gram(const Task& task, Level& level, bool projected, N n, M m) {
  double *rows = Y_.data() + level.first * n, *G = level.G.data();  // rows: free until orthonormalise()
  for (int i = 0; i < m; ++i) {
    double* row = rows + i * n;
    if (projected) {
      const double *l = l_.data(), *w = level.W.data() + i * n;
      for (int j = 0; j < n; ++j) row[j] = root_[static_cast<std::size_t>(j)] * w[j];
      each_down(n, [&](auto j) { row[j] += dot(l + j * n, row, j); });
    } else {
      for (int j = 0; j < n; ++j) row[j] = task.scale[i] * task.J(i, j);
    }
  }
  for (int i = 0; i < m; ++i) {
    for (int j = 0; j <= i; ++j) G[i * m + j] = G[j * m + i] = dot(rows + i * n, rows + j * n, n);
  }
}

// Rows W = R Y with Y Yᵀ = 1 (Gram–Schmidt, again where a row nearly vanished), Y ← √activation Y. Each row is removed from
// those after it before it is normalised, so that they do not wait for the root.
template <class N, class M>
void Cascade::orthonormalise(Level& level, N n, M m) {
  constexpr double kMuch = 0.1;  // where this is left of a row's square, rounding spoils the next digit: again
  double *Y = Y_.data() + level.first * n, *R = level.R.data();
  std::copy_n(level.W.data(), m * n, Y);
  double whole[kMostRows];
  for (int i = 0; i < m; ++i) whole[i] = dot(Y + i * n, Y + i * n, n);
  for (int i = 0; i < m; ++i) {
    double* row = Y + i * n;
    double square = dot(row, row, n), before = whole[i];
    while (square < kMuch * before) {
      double c[kMostRows];
      for (int j = 0; j < i; ++j) c[j] = dot(row, Y + j * n, n);
      for (int j = 0; j < i; ++j) add(-c[j], Y + j * n, row, n);
      for (int j = 0; j < i; ++j) R[i * m + j] += c[j];
      before = square;
      square = dot(row, row, n);
    }
    const double length = std::sqrt(square), inverse = 1 / length, inverse_square = 1 / square;
    for (int k = i + 1; k < m; ++k) {
      const double c = dot(Y + k * n, row, n);
      add(-c * inverse_square, row, Y + k * n, n);
      R[k * m + i] = c * inverse;
    }
    for (int j = 0; j < n; ++j) row[j] *= inverse;
    R[i * m + i] = length;
    level.inverse[static_cast<std::size_t>(i)] = inverse;
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
  for (int i = 0; i < m; ++i) level.inverse[static_cast<std::size_t>(i)] = 1 / level.R[static_cast<std::size_t>(i * m + i)];
  level.active = true;
  double* Y = Y_.data() + level.first * n_;
  for (int i = 0; i < m; ++i) {
    const double* R = level.R.data() + i * m;
    double* row = Y + i * n_;
    std::copy_n(level.W.data() + i * n_, n_, row);
    for (int j = 0; j < i; ++j) add(-R[j], Y + j * n_, row, n_);
    for (int j = 0; j < n_; ++j) row[j] *= level.inverse[static_cast<std::size_t>(i)];
  }
  for (int i = 0; i < m * n_; ++i) Y[i] *= level.root;
}

template <class N, class M>
void Cascade::take(Task& task, Level& level, N n, M m) {
  level.first = rows_;
  level.active = false;
  level.root = std::sqrt(std::clamp(task.activation, 0.0, 1.0));
  task.lambda = 0;
  whiten(task, level, n);
  level.W = level.J_hat;
  for (int i = 0; i < m && rows_ > 0; ++i) project_row(level, level.W.data() + i * n);
  gram(task, level, rows_ > 0, n, m);
  task.sigma_min = std::sqrt(smallest_eigenvalue(level.G.data(), m));
  if (level.root == 0) return;
  if (exact_ && task.sigma_min >= sigma_0) {
    level.active = true;
    orthonormalise(level, n, m);
  } else {
    damp(task, level, m);
  }
  if (!level.active || task.lambda > 0 || level.root < 1) exact_ = false;
  if (level.active) rows_ += m;
}

bool Cascade::decompose(const MatrixIn& M) {
  return with_joints(n_, [&](auto n) {
    if (!factorise(M, n)) return false;
    rows_ = 0;
    exact_ = true;
    for (std::size_t k = 0; k < tasks.size(); ++k)
      with_rows(static_cast<int>(tasks[k].a.size()), [&](auto m) { take(tasks[k], levels_[k], n, m); });
    return true;
  });
}

void Cascade::solve(VectorOut ddq) {
  double* z = z_.data();
  std::fill_n(z, n_, 0.0);
  with_joints(n_, [&](auto n) {
    bool first = true;  // z = 0
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      const Task& task = tasks[k];
      Level& level = levels_[k];
      if (!level.active) continue;
      const int m = static_cast<int>(task.a.size());
      double* t = level.t.data();
      for (int i = 0; i < m; ++i) {  // t = R⁻¹ (a − J q̈), rows scaled
        t[i] = task.scale[i] * task.a[i];
        if (!first) t[i] -= dot(level.J_hat.data() + i * n, z, n);
      }
      with_rows(m, [&](auto rows) {
        each(rows, [&](auto i) {
          t[i] *= level.inverse[static_cast<std::size_t>(i)];
          for (int j = i + 1; j < rows; ++j) t[j] -= level.R[static_cast<std::size_t>(j * rows + i)] * t[i];
        });
      });
      for (int i = 0; i < m; ++i) add(level.root * t[i], Y_.data() + (level.first + i) * n, z, n);
      first = false;
    }
    for (std::size_t k = 0; k < tasks.size(); ++k) {
      Task& task = tasks[k];
      for (int i = 0; i < static_cast<int>(task.a.size()); ++i)
        task.residual[i] = task.a[i] - dot(levels_[k].J_hat.data() + i * n, z, n) / task.scale[i];
    }
  });
  backward(z, ddq.data());
}

void Cascade::remove(double* x, int rows) {
  double* c = c_.data();
  with_joints(n_, [&](auto n) {
    for (int j = 0; j < rows; ++j) c[j] = dot(x, Y_.data() + j * n, n);
    for (int j = 0; j < rows; ++j) add(-c[j], Y_.data() + j * n, x, n);
  });
}

void Cascade::project(VectorOut v) {
  forward(v.data(), x_.data());
  remove(x_.data(), rows_);
  backward(x_.data(), v.data());
}

// In L⁻¹ coordinates: Lᵀ (v + M⁻¹ τ) = Lᵀ v + L⁻¹ τ.
void Cascade::project(VectorOut v, const VectorIn& tau) {
  double *x = x_.data(), *z = z_.data();
  forward(v.data(), x);
  std::copy_n(tau.data(), n_, z);
  lower_solve(z);
  for (int i = 0; i < n_; ++i) x[i] += z[i];
  remove(x, rows_);
  backward(x, v.data());
}

void Cascade::solve_mass(VectorOut x) {
  std::copy_n(x.data(), n_, x_.data());
  lower_solve(x_.data());
  backward(x_.data(), x.data());
}

// L⁻ᵀ (I − Yᵀ Y) L⁻¹
void Cascade::mobility(std::size_t kept, MatrixOut A) {
  const int rows = kept < tasks.size() ? levels_[kept].first : rows_;
  double* x = x_.data();
  for (int i = 0; i < n_; ++i) {
    std::fill_n(x, n_, 0.0);
    x[i] = 1;
    lower_solve(x);
    remove(x, rows);
    backward(x, A.col(i).data());
  }
}

// From the last task to the first: f_k = A^# J_k|p v, v ← v − M⁻¹ J_kᵀ f_k. What is left of v after task k has no more part of
// the tasks k … r; A^# = activation R⁻ᵀ R⁻¹ and √activation R⁻¹ W = Y.
void Cascade::split(VectorOut v, std::vector<Eigen::VectorXd>& forces) {
  double* x = x_.data();
  forward(v.data(), x);
  with_joints(n_, [&](auto n) {
    for (std::size_t k = tasks.size(); k-- > 0;) {
      const Task& task = tasks[k];
      const Level& level = levels_[k];
      if (!level.active) {
        forces[k].setZero();
        continue;
      }
      double* f = forces[k].data();
      const int m = static_cast<int>(task.a.size());
      for (int i = 0; i < m; ++i) f[i] = level.root * dot(Y_.data() + (level.first + i) * n, x, n);
      with_rows(m, [&](auto rows) {
        each_down(rows, [&](auto i) {
          f[i] *= level.inverse[static_cast<std::size_t>(i)];
          add(-f[i], level.R.data() + i * rows, f, i);
        });
      });
      for (int i = 0; i < m; ++i) {
        add(-f[i], level.J_hat.data() + i * n, x, n);
        f[i] *= task.scale[i];
      }
    }
  });
  backward(x, v.data());
}

}  // namespace cotwin::control
