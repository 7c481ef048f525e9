#include "models/energetics/cubic.h"

#include <algorithm>
#include <cmath>

namespace cotwin::energetics {
namespace {

/// The zero of p in [a, b], at whose ends p has different signs: Newton's method, kept in the interval by bisection.
double zero_between(const Cubic& p, double a, double b) {
  const bool rises = value(p, a) < 0;
  double s = 0.5 * (a + b);
  for (int k = 0; k < 100; ++k) {
    const double f = value(p, s), df = p[1] + s * (2 * p[2] + s * 3 * p[3]);
    ((f < 0) == rises ? a : b) = s;
    double next = df != 0 ? s - f / df : a;
    if (!(next > a && next < b)) next = 0.5 * (a + b);
    if (std::abs(next - s) <= 1e-16) break;
    s = next;
  }
  return s;
}

}  // namespace

Cubic through(const std::array<double, kNodes>& values) {
  // Newton's divided differences, then the powers of s.
  std::array<double, kNodes> d = values;
  for (std::size_t order = 1; order < kNodes; ++order) {
    for (std::size_t k = kNodes - 1; k >= order; --k) d[k] = (d[k] - d[k - 1]) / (kNode[k] - kNode[k - order]);
  }
  Cubic p{d[3], 0, 0, 0};
  for (std::size_t k = kNodes - 1; k-- > 0;) {
    for (std::size_t power = kNodes - 1; power > 0; --power) p[power] = p[power - 1] - kNode[k] * p[power];
    p[0] = d[k] - kNode[k] * p[0];
  }
  return p;
}

Crossings crossings(const Cubic& p) {
  // Between the zeros of p′ the polynomial is monotone.
  std::array<double, 4> ends{0, 0, 0, 1};
  std::size_t count = 1;
  const double a = 3 * p[3], b = p[2], c = p[1];  // p′ = a s² + 2 b s + c
  const double discriminant = b * b - a * c;
  if (discriminant > 0) {
    const double r = -(b + std::copysign(std::sqrt(discriminant), b));
    std::array<double, 2> extremes = {a != 0 ? r / a : -1, r != 0 ? c / r : -1};
    if (extremes[0] > extremes[1]) std::swap(extremes[0], extremes[1]);
    for (const double s : extremes) {
      if (s > 0 && s < 1) ends[count++] = s;
    }
  }
  ends[count++] = 1;
  Crossings found;
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const double left = value(p, ends[k]), right = value(p, ends[k + 1]);
    if ((left < 0 && right > 0) || (left > 0 && right < 0)) found.s[found.count++] = zero_between(p, ends[k], ends[k + 1]);
  }
  return found;
}

Parts parts(const Cubic& p) {
  const Crossings zeros = crossings(p);
  Parts sum;
  double before = 0;
  for (std::size_t k = 0; k <= zeros.count; ++k) {
    const double upto = integral(p, k < zeros.count ? zeros.s[k] : 1);
    (upto > before ? sum.positive : sum.negative) += upto - before;
    before = upto;
  }
  return sum;
}

}  // namespace cotwin::energetics
