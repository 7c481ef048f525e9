#include "models/numerics/modes.h"

#include <array>
#include <cmath>
#include <limits>

namespace cotwin::numerics {

namespace {

constexpr int kN = 6;
constexpr int kMostSteps = 30 * kN;
constexpr double kNothing = 1e-100;  // of the largest element; its square is far from the end of the range of double
using Vector = Eigen::Matrix<double, kN, 1>;
using Row = Eigen::Matrix<double, 1, kN>;

struct Tridiagonal {
  std::array<double, kN> diagonal{};
  std::array<double, kN> beside{};  // [k] in row k + 1; the last one is 0
};

/// A = Uᵀ T U. Turns the rows of U, which was I.
Tridiagonal reduce(Eigen::Matrix<double, kN, kN> A, Modes6::Rows& U) {
  Tridiagonal T;
  for (int k = 0; k < kN - 2; ++k) {
    double below = 0;
    for (int i = k + 2; i < kN; ++i) below += A(i, k) * A(i, k);
    const double first = A(k + 1, k);
    T.beside[static_cast<std::size_t>(k)] = first;
    if (below < kNothing * kNothing) continue;
    const double length = std::copysign(std::sqrt(first * first + below), first);
    T.beside[static_cast<std::size_t>(k)] = -length;
    const double v_first = first + length;
    const double beta = 2 * v_first * v_first / (below + v_first * v_first);
    Vector v = Vector::Zero();
    v[k + 1] = 1;
    for (int i = k + 2; i < kN; ++i) v[i] = A(i, k) / v_first;
    const Vector p = beta * A.lazyProduct(v);
    const Vector w = p - (beta / 2 * p.dot(v)) * v;
    A.noalias() -= v.lazyProduct(w.transpose());
    A.noalias() -= w.lazyProduct(v.transpose());
    Row reflected = Row::Zero();
    for (int i = k + 1; i < kN; ++i) reflected += v[i] * U.row(i);
    for (int i = k + 1; i < kN; ++i) U.row(i) -= (beta * v[i]) * reflected;
  }
  T.beside[kN - 2] = A(kN - 1, kN - 2);
  for (int i = 0; i < kN; ++i) T.diagonal[static_cast<std::size_t>(i)] = A(i, i);
  return T;
}

/// One step on the rows from `first` to `last`, between which no element beside the diagonal is 0.
void step(Tridiagonal& T, Modes6::Rows& U, std::size_t first, std::size_t last) {
  auto& d = T.diagonal;
  auto& e = T.beside;
  const double half = (d[last - 1] - d[last]) / 2, corner = e[last - 1];
  const double shift = d[last] - corner * corner / (half + std::copysign(std::sqrt(half * half + corner * corner), half));
  double x = d[first] - shift, z = e[first];
  for (std::size_t k = first; k < last; ++k) {
    const double length = std::sqrt(x * x + z * z);
    const double c = length > kNothing ? x / length : 1, s = length > kNothing ? z / length : 0;
    if (k > first) e[k - 1] = length;
    const double dk = d[k], ek = e[k], next = d[k + 1];
    d[k] = c * c * dk + 2 * c * s * ek + s * s * next;
    d[k + 1] = s * s * dk - 2 * c * s * ek + c * c * next;
    e[k] = c * s * (next - dk) + (c * c - s * s) * ek;
    x = e[k];
    z = s * e[k + 1];
    if (k + 1 < last) e[k + 1] *= c;
    const auto i = static_cast<Eigen::Index>(k);
    const Row upper = U.row(i), lower = U.row(i + 1);
    U.row(i) = c * upper + s * lower;
    U.row(i + 1) = c * lower - s * upper;
  }
}

}  // namespace

Modes6 modes6(const Eigen::Matrix<double, 6, 6>& A) {
  Modes6 modes;
  modes.vectors.setIdentity();
  const double largest = A.cwiseAbs().maxCoeff();
  if (largest == 0) {
    modes.values.setZero();
    return modes;
  }
  Tridiagonal T = reduce(A / largest, modes.vectors);
  const auto vanishes = [&](std::size_t k) {
    return std::abs(T.beside[k]) <=
           kNothing + std::numeric_limits<double>::epsilon() * (std::abs(T.diagonal[k]) + std::abs(T.diagonal[k + 1]));
  };
  std::size_t last = kN - 1;
  for (int i = 0; i < kMostSteps && last > 0; ++i) {
    if (vanishes(last - 1)) {
      --last;
      continue;
    }
    std::size_t first = last - 1;
    while (first > 0 && !vanishes(first - 1)) --first;
    step(T, modes.vectors, first, last);
  }
  for (int i = 0; i < kN; ++i) {
    modes.values[i] = last == 0 ? largest * T.diagonal[static_cast<std::size_t>(i)] : std::numeric_limits<double>::quiet_NaN();
  }
  return modes;
}

}  // namespace cotwin::numerics
