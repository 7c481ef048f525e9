#include "models/trajectory/spline.h"

#include <algorithm>
#include <array>
#include <cassert>
#include <utility>

namespace cotwin::trajectory {

namespace {

struct Matrix2 {
  double a, b, c, d;  // [a b; c d]
};
struct Vector2 {
  double v, a;  // velocity, acceleration
};

Matrix2 inverse(const Matrix2& m) {
  const double det = m.a * m.d - m.b * m.c;
  return {m.d / det, -m.b / det, -m.c / det, m.a / det};
}
Matrix2 operator*(const Matrix2& l, const Matrix2& r) {
  return {l.a * r.a + l.b * r.c, l.a * r.b + l.b * r.d, l.c * r.a + l.d * r.c, l.c * r.b + l.d * r.d};
}
Vector2 operator*(const Matrix2& m, Vector2 x) { return {m.a * x.v + m.b * x.a, m.c * x.v + m.d * x.a}; }
Matrix2 operator-(const Matrix2& l, const Matrix2& r) { return {l.a - r.a, l.b - r.b, l.c - r.c, l.d - r.d}; }
Vector2 operator-(Vector2 l, Vector2 r) { return {l.v - r.v, l.a - r.a}; }

/// Weights of values at `x` for value, first and second derivative at x0, of the polynomial through all of them (Fornberg,
/// Math. Comp. 51 (1988) 699).
std::vector<std::array<double, 3>> derivative_weights(double x0, std::span<const double> x) {
  std::vector<std::array<double, 3>> w(x.size(), {0, 0, 0});
  w[0][0] = 1;
  double c1 = 1;
  for (std::size_t i = 1; i < x.size(); ++i) {
    double c2 = 1;
    for (std::size_t j = 0; j < i; ++j) {
      const double c3 = x[i] - x[j];
      c2 *= c3;
      if (j + 1 == i) {
        for (std::size_t m = 3; m-- > 0;) {
          const double lower = m > 0 ? static_cast<double>(m) * w[i - 1][m - 1] : 0;
          w[i][m] = c1 / c2 * (lower - (x[i - 1] - x0) * w[i - 1][m]);
        }
      }
      for (std::size_t m = 3; m-- > 0;) {
        const double lower = m > 0 ? static_cast<double>(m) * w[j][m - 1] : 0;
        w[j][m] = ((x[i] - x0) * w[j][m] - lower) / c3;
      }
    }
    c1 = c2;
  }
  return w;
}

}  // namespace

// With Δ = q₁ − q₀ over a segment of length h,
//   jerk at its start  (60Δ − (36v₀ + 24v₁)h − (9a₀ − 3a₁)h²)/h³,   at its end  (60Δ − (24v₀ + 36v₁)h + (9a₁ − 3a₀)h²)/h³,
//   snap at its start (−360Δ + (192v₀ + 168v₁)h + (36a₀ − 24a₁)h²)/h⁴,   at its end (360Δ − (168v₀ + 192v₁)h + (36a₁ −
//   24a₀)h²)/h⁴.
// Continuity of both at each inner knot, written as the gradient of ½ ∫ jerk² (so that the matrix is symmetric and positive
// definite), is block tridiagonal with 2 × 2 blocks: lower_k x_{k−1} + diagonal_k x_k + upper_k x_{k+1} = b_k, x = (v, a).
SplineKnots solve_spline(std::span<const double> t, std::size_t joints, std::span<const double> q, SplineEnds ends) {
  const std::size_t N = t.size();
  assert(N >= 2 && q.size() == N * joints);
  SplineKnots knots{std::vector<double>(q.size(), 0.0), std::vector<double>(q.size(), 0.0)};
  if (ends == SplineEnds::kFree) {
    const std::size_t m = std::min<std::size_t>(6, N);
    for (const auto& [first, end] : {std::pair<std::size_t, std::size_t>{0, 0}, {N - m, N - 1}}) {
      const auto w = derivative_weights(t[end], t.subspan(first, m));
      for (std::size_t j = 0; j < joints; ++j) {
        double v = 0, a = 0;
        for (std::size_t i = 0; i < m; ++i) {
          const double difference =
              q[(first + i) * joints + j] - q[end * joints + j];  // the weights of a derivative sum to zero
          v += w[i][1] * difference;
          a += w[i][2] * difference;
        }
        knots.dq[end * joints + j] = v;
        knots.ddq[end * joints + j] = a;
      }
    }
  }
  if (N == 2) return knots;

  // Forward elimination; the matrix is the same for all joints.
  const auto upper = [&](std::size_t k) {
    const double h = t[k + 1] - t[k];
    return Matrix2{168 / (h * h * h), -24 / (h * h), 24 / (h * h), -3 / h};
  };
  const auto lower = [&](std::size_t k) {  // the transpose of upper(k − 1)
    const double h = t[k] - t[k - 1];
    return Matrix2{168 / (h * h * h), 24 / (h * h), -24 / (h * h), -3 / h};
  };
  std::vector<Matrix2> pivot(N);  // inverse of the eliminated diagonal block
  for (std::size_t k = 1; k + 1 < N; ++k) {
    const double l = t[k] - t[k - 1], r = t[k + 1] - t[k];
    const double off = 36 / (r * r) - 36 / (l * l);
    Matrix2 diagonal{192 / (l * l * l) + 192 / (r * r * r), off, off, 9 / l + 9 / r};
    if (k > 1) diagonal = diagonal - lower(k) * pivot[k - 1] * upper(k - 1);
    pivot[k] = inverse(diagonal);
  }
  std::vector<Vector2> b(N);
  for (std::size_t j = 0; j < joints; ++j) {
    const auto value = [&](std::size_t k) { return q[k * joints + j]; };
    const auto end = [&](std::size_t k) { return Vector2{knots.dq[k * joints + j], knots.ddq[k * joints + j]}; };
    for (std::size_t k = 1; k + 1 < N; ++k) {
      const double l = t[k] - t[k - 1], r = t[k + 1] - t[k];
      const double left = (value(k) - value(k - 1)) / (l * l * l), right = (value(k + 1) - value(k)) / (r * r * r);
      b[k] = {360 * (left / l + right / r), 60 * (right - left)};
      if (k == 1) b[k] = b[k] - lower(k) * end(0);
      if (k + 2 == N) b[k] = b[k] - upper(k) * end(N - 1);
      if (k > 1) b[k] = b[k] - lower(k) * (pivot[k - 1] * b[k - 1]);
    }
    for (std::size_t k = N - 2; k > 0; --k) {
      const Vector2 x = pivot[k] * (k + 2 == N ? b[k] : b[k] - upper(k) * end(k + 1));
      knots.dq[k * joints + j] = x.v;
      knots.ddq[k * joints + j] = x.a;
    }
  }
  return knots;
}

}  // namespace cotwin::trajectory
