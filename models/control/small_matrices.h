#pragma once
#include <algorithm>
#include <cmath>
#include <type_traits>
#include <utility>

/// Loops over rows of small matrices in plain arrays. A size is an int, or std::integral_constant<int, n> where the compiler
/// should unroll the loops.
namespace cotwin::control {

inline constexpr int kMostRows = 6;  // of a task: a twist

/// f(i) for i = 0 … n − 1.
template <class N, class F>
inline void each(N n, F f) {
  if constexpr (std::is_same_v<N, int>) {
    for (int i = 0; i < n; ++i) f(i);
  } else {
    [&]<int... i>(std::integer_sequence<int, i...>) { (f(std::integral_constant<int, i>()), ...); }
    (std::make_integer_sequence<int, N::value>());
  }
}

/// f(i) for i = n − 1 … 0.
template <class N, class F>
inline void each_down(N n, F f) {
  if constexpr (std::is_same_v<N, int>) {
    for (int i = n - 1; i >= 0; --i) f(i);
  } else {
    each(n, [&](auto i) { f(std::integral_constant<int, N::value - 1 - i.value>()); });
  }
}

/// Two sums, of the elements with even and with odd index.
inline double dot(const double* a, const double* b, int n) {
  double even = 0, odd = 0;
  for (int i = 0; i + 1 < n; i += 2) {
    even += a[i] * b[i];
    odd += a[i + 1] * b[i + 1];
  }
  if (n % 2 != 0) even += a[n - 1] * b[n - 1];
  return even + odd;
}

/// y += factor x
inline void add(double factor, const double* x, double* y, int n) {
  for (int i = 0; i < n; ++i) y[i] += factor * x[i];
}

/// Diagonal d and squares e² beside it of a tridiagonal matrix with the eigenvalues of the symmetric A, by Householder's
/// reflections. A (m x m, row-major) is overwritten.
template <class M>
inline void tridiagonalise(double* A, double* d, double* e_squared, M m) {
  each(m, [&](auto k) {
    d[k] = A[k * m + k];
    if (k + 1 == m) return;
    double v[kMostRows], w[kMostRows];
    double rest = 0;
    for (int i = k + 1; i < m; ++i) v[i] = A[i * m + k];
    for (int i = k + 2; i < m; ++i) rest += v[i] * v[i];
    const double square = rest + v[k + 1] * v[k + 1];
    e_squared[k] = square;
    if (k + 2 == m || !(rest > 0)) return;
    v[k + 1] += std::copysign(std::sqrt(square), v[k + 1]);
    const double beta = 2 / (rest + v[k + 1] * v[k + 1]);
    double product = 0;
    for (int i = k + 1; i < m; ++i) {
      w[i] = beta * dot(A + i * m + k + 1, v + k + 1, m - k - 1);
      product += w[i] * v[i];
    }
    for (int i = k + 1; i < m; ++i) w[i] -= beta / 2 * product * v[i];
    for (int i = k + 1; i < m; ++i) {
      for (int j = k + 1; j < m; ++j) A[i * m + j] -= v[i] * w[j] + w[i] * v[j];
    }
  });
}

/// Smallest eigenvalue of the symmetric positive semidefinite G (m x m, row-major), to 1e-9 of it, by Laguerre's iteration on its
/// tridiagonal form, whose L D Lᵀ has the pivots δ_k(λ). From below it converges monotonically and cubically, because all roots
/// are real: with S_1 = −Σ δ'/δ and S_2 = −S_1', λ += m/(S_1 + √((m − 1)(m S_2 − S_1²))). Pivots, unlike the characteristic
/// polynomial, keep their digits where several eigenvalues are 0.
template <class M>
inline double smallest_eigenvalue(const double* G, M m) {
  constexpr int kMost = 20;
  constexpr double kEnough = 1e-9;  // of λ; for the next step as cubic convergence predicts it
  double trace = 0;
  for (int i = 0; i < m; ++i) trace += G[i * m + i];
  if (!(trace > 0)) return 0;
  double A[kMostRows * kMostRows], d[kMostRows], e_squared[kMostRows];
  const double scale = 1 / trace;
  for (int i = 0; i < m * m; ++i) A[i] = G[i] * scale;
  tridiagonalise(A, d, e_squared, m);
  double x = 0, before = 0;
  for (int i = 0; i < kMost; ++i) {
    double pivot = d[0] - x, inverse = 1 / pivot;
    double u = -inverse, w = 0;  // δ'/δ, δ''/δ
    double S_1 = -u, S_2 = u * u;
    bool positive = pivot > 0;
    for (int k = 1; k < m; ++k) {
      const double r = e_squared[k - 1] * inverse;
      const double slope = r * u - 1, curvature = r * (w - 2 * u * u);
      pivot = d[k] - x - r;
      positive = positive && pivot > 0;
      inverse = 1 / pivot;
      u = slope * inverse;
      w = curvature * inverse;
      S_1 -= u;
      S_2 += u * u - w;
    }
    if (!positive) break;
    const double step = m / (S_1 + std::sqrt(std::max(0.0, (m - 1) * (m * S_2 - S_1 * S_1))));
    x += step;
    const double ratio = step / before;
    if (i > 0 && step * ratio * ratio * ratio <= kEnough * x) break;
    before = step;
  }
  return x * trace;
}

}  // namespace cotwin::control
