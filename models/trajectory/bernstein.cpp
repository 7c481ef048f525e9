#include "models/trajectory/bernstein.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>

namespace cotwin::trajectory::bernstein {

namespace {

using Points = std::array<double, kMaxDegree + 1>;

/// Control points of the derivative; `size` becomes their number.
Points derivative_points(std::span<const double> b, int derivative, std::size_t& size) {
  assert(b.size() <= Points{}.size() && b.size() > static_cast<std::size_t>(derivative));
  Points points{};
  std::copy(b.begin(), b.end(), points.begin());
  size = b.size();
  for (int k = 0; k < derivative; ++k) {
    const double degree = static_cast<double>(size - 1);
    for (std::size_t i = 0; i + 1 < size; ++i) points[i] = degree * (points[i + 1] - points[i]);
    --size;
  }
  return points;
}

/// Branch and bound over halves: skips parts whose control points do not exceed the value attained so far.
struct Maximum {
  double tolerance;
  Extreme best;

  void search(const Points& points, std::size_t size, double from, double to, int depth) {
    const double bound = *std::max_element(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(size));
    if (!(bound > best.value + tolerance) || depth == 0) return;  // also if points are not finite
    Points left = points, right = points;                         // de Casteljau at the middle
    for (std::size_t level = 1; level < size; ++level) {
      for (std::size_t i = 0; i + level < size; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
      left[level] = right[0];
    }
    const double middle = 0.5 * (from + to);
    if (right[0] > best.value) best = {right[0], middle};
    const auto greatest = [size](const Points& p) {
      return *std::max_element(p.begin(), p.begin() + static_cast<std::ptrdiff_t>(size));
    };
    if (greatest(left) >= greatest(right)) {
      search(left, size, from, middle, depth - 1);
      search(right, size, middle, to, depth - 1);
    } else {
      search(right, size, middle, to, depth - 1);
      search(left, size, from, middle, depth - 1);
    }
  }
};

/// The first value above `limit` that halving finds in parts whose control points exceed it.
bool find_above(const Points& points, std::size_t size, double limit, double tolerance, int depth, double& value) {
  double bound = points[0];
  for (std::size_t i = 1; i < size; ++i) bound = std::max(bound, points[i]);
  value = std::max(points[0], points[size - 1]);
  if (value > limit) return true;
  if (!(bound > limit + tolerance) || depth == 0) return false;
  Points left, right;
  std::copy_n(points.begin(), size, right.begin());
  left[0] = points[0];
  for (std::size_t level = 1; level < size; ++level) {  // de Casteljau at the middle
    for (std::size_t i = 0; i + level < size; ++i) right[i] = 0.5 * (right[i] + right[i + 1]);
    left[level] = right[0];
  }
  return find_above(left, size, limit, tolerance, depth - 1, value) ||
         find_above(right, size, limit, tolerance, depth - 1, value);
}

double tolerance_of(double least, double greatest) {
  // The second term exceeds rounding; without it, a flat polynomial would be halved to the full depth everywhere.
  return 1e-13 * (greatest - least) + 1e-14 * std::max(std::abs(least), std::abs(greatest));
}

Extreme maximum(const Points& points, std::size_t size) {
  const auto end = points.begin() + static_cast<std::ptrdiff_t>(size);
  const auto [least, greatest] = std::minmax_element(points.begin(), end);
  Maximum search{tolerance_of(*least, *greatest), {points[0], 0}};
  if (points[size - 1] > points[0]) search.best = {points[size - 1], 1};
  constexpr int kDepth = 50;  // halves down to 1e-15
  search.search(points, size, 0, 1, kDepth);
  return search.best;
}

/// The last levels of de Casteljau's triangle give the derivatives of a polynomial of degree d as differences.
std::array<double, 4> last_levels(double w0, double w1, double w2, double w3, double s, double d) {
  const double r = 1 - s;
  const double u0 = r * w0 + s * w1, u1 = r * w1 + s * w2, u2 = r * w2 + s * w3;
  const double v0 = r * u0 + s * u1, v1 = r * u1 + s * u2;
  return {r * v0 + s * v1, d * (v1 - v0), d * (d - 1) * ((u2 - u1) - (u1 - u0)),
          d * (d - 1) * (d - 2) * ((w3 - w2) - 2 * (w2 - w1) + (w1 - w0))};
}

}  // namespace

std::array<double, 4> evaluate(std::span<const double> b, double s) {
  assert(b.size() >= 4 && b.size() <= kMaxDegree + 1);
  const double r = 1 - s;
  if (b.size() == 6) {  // the common case, kept in registers
    const double w0 = r * b[0] + s * b[1], w1 = r * b[1] + s * b[2], w2 = r * b[2] + s * b[3], w3 = r * b[3] + s * b[4],
                 w4 = r * b[4] + s * b[5];
    return last_levels(r * w0 + s * w1, r * w1 + s * w2, r * w2 + s * w3, r * w3 + s * w4, s, 5);
  }
  Points w;
  std::copy(b.begin(), b.end(), w.begin());
  for (std::size_t size = b.size(); size > 4; --size) {
    for (std::size_t i = 0; i + 1 < size; ++i) w[i] = r * w[i] + s * w[i + 1];
  }
  return last_levels(w[0], w[1], w[2], w[3], s, static_cast<double>(b.size() - 1));
}

std::vector<double> elevate(std::span<const double> b, int degree) {
  std::vector<double> points(b.begin(), b.end());
  while (static_cast<int>(points.size()) - 1 < degree) {
    const double next = static_cast<double>(points.size());  // resulting degree
    points.push_back(points.back());
    for (std::size_t i = points.size() - 2; i > 0; --i) {
      const double share = static_cast<double>(i) / next;
      points[i] = share * points[i - 1] + (1 - share) * points[i];
    }
  }
  return points;
}

std::array<double, 6> quintic(const std::array<double, 3>& start, const std::array<double, 3>& end) {
  // p' = 5 Δb and p'' = 20 Δ²b at both ends.
  const double b1 = start[0] + start[1] / 5, b4 = end[0] - end[1] / 5;
  return {start[0], b1, 2 * b1 - start[0] + start[2] / 20, 2 * b4 - end[0] + end[2] / 20, b4, end[0]};
}

Extremes extremes(std::span<const double> b, int derivative) {
  std::size_t size = 0;
  Points points = derivative_points(b, derivative, size);
  Extremes found;
  found.max = maximum(points, size);
  for (double& p : points) p = -p;
  found.min = maximum(points, size);
  found.min.value = -found.min.value;
  return found;
}

std::optional<double> value_above(std::span<const double> b, int derivative, double limit) {
  std::size_t size = 0;
  const Points points = derivative_points(b, derivative, size);
  const auto [least, greatest] = std::minmax_element(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(size));
  constexpr int kDepth = 50;
  double value = 0;
  if (!find_above(points, size, limit, tolerance_of(*least, *greatest), kDepth, value)) return std::nullopt;
  return value;
}

Hull hull(std::span<const double> b, int derivative) {
  std::size_t size = 0;
  const Points points = derivative_points(b, derivative, size);
  const auto [least, greatest] = std::minmax_element(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(size));
  return {*least, *greatest};
}

}  // namespace cotwin::trajectory::bernstein
