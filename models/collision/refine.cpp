// refine() of separation.h: pairs of features as points, lines and circles.
#include <Eigen/Geometry>
#include <array>
#include <cmath>

#include "models/collision/separation.h"

namespace cotwin::collision {

namespace {

using Eigen::Vector3d;

/// A point p; a line p + u d with 0 ≤ u ≤ length and unit vector d; a circle about p with unit normal d.
struct Curve {
  enum Kind { kPoint, kLine, kCircle } kind = kPoint;
  Vector3d p, d;
  double length = 0;
  double radius = 0;
  double around = 0;  // distance of the surface from the line: a cylinder's side about its axis

  /// Returns whether a point of the unbounded curve lies on this one.
  bool contains(const Vector3d& place, double rounding) const {
    const double u = d.dot(place - p);
    return kind != kLine || (u >= -rounding && u <= length + rounding);
  }
};

/// The curves of a core near its supporting feature along d: a fixed-size array.
class Curves {
 public:
  void find(const Placed& piece, const Vector3d& d, Feature& feature);
  const Curve* begin() const { return curves_.data(); }
  const Curve* end() const { return curves_.data() + count_; }

 private:
  void add(const Curve& curve) {
    if (count_ < curves_.size()) curves_[count_++] = curve;
  }
  std::array<Curve, 64> curves_;
  std::size_t count_ = 0;
};

void Curves::find(const Placed& piece, const Vector3d& d, Feature& feature) {
  count_ = 0;
  const Convex& c = *piece.convex;
  const Vector3d axis = piece.R.col(2);
  if (c.core == Core::kCylinder) {
    add({Curve::kLine, piece.p - c.half * axis, axis, 2 * c.half, 0, c.radius});
    add({Curve::kCircle, piece.p + axis * std::copysign(c.half, axis.dot(d)), axis, 0, c.radius, 0});
  } else if (c.core == Core::kSegment) {
    add({Curve::kLine, piece.p - c.half * axis, axis, 2 * c.half, 0, 0});
    for (const double side : {-1.0, 1.0}) add({Curve::kPoint, piece.p + side * c.half * axis, axis, 0, 0, 0});
  } else {
    supporting_feature(piece, d, feature);
    const std::size_t count = feature.corners.size();
    for (std::size_t k = 0; k < count; ++k) {
      const Vector3d& p = feature.corners[k].p;
      const Vector3d along = feature.corners[(k + 1) % count].p - p;
      const double length = along.norm();
      add({Curve::kPoint, p, d, 0, 0, 0});
      if (length > 0) add({Curve::kLine, p, along / length, length, 0, 0});
    }
  }
}

/// A point of a curve with its first two derivatives along the curve.
struct Spot {
  Vector3d p, first, second;
};

Spot evaluate(const Curve& curve, const Vector3d& x, const Vector3d& y, double u) {
  if (curve.kind != Curve::kCircle) return {curve.p + u * curve.d, curve.d, Vector3d::Zero()};
  const double c = curve.radius * std::cos(u), s = curve.radius * std::sin(u);
  const Vector3d out = c * x + s * y;
  return {curve.p + out, c * y - s * x, -out};
}

/// Newton iteration for the stationary points of the distance of two curves, started at the points towards each other.
void find_stationary(const Curve& a, const Curve& b, const Vector3d& toward, Spot& on_a, Spot& on_b) {
  const Vector3d x_a = a.d.unitOrthogonal(), y_a = a.d.cross(x_a), x_b = b.d.unitOrthogonal(), y_b = b.d.cross(x_b);
  const auto start = [](const Curve& curve, const Vector3d& x, const Vector3d& y, const Vector3d& offset) {
    return curve.kind == Curve::kCircle ? std::atan2(offset.dot(y), offset.dot(x)) : 0.0;
  };
  double u = start(a, x_a, y_a, toward), v = start(b, x_b, y_b, -toward);
  if (b.kind == Curve::kLine) v = b.d.dot(evaluate(a, x_a, y_a, u).p - b.p);
  if (a.kind == Curve::kLine) u = a.d.dot(evaluate(b, x_b, y_b, v).p - a.p);
  constexpr int kIterations = 10;
  for (int i = 0; i < kIterations; ++i) {
    on_a = evaluate(a, x_a, y_a, u);
    on_b = evaluate(b, x_b, y_b, v);
    const Vector3d offset = on_b.p - on_a.p;
    const double g_u = -offset.dot(on_a.first), g_v = offset.dot(on_b.first);
    const double uu = on_a.first.squaredNorm() - offset.dot(on_a.second),
                 vv = on_b.first.squaredNorm() + offset.dot(on_b.second);
    const double uv = -on_a.first.dot(on_b.first), det = uu * vv - uv * uv;
    if (std::abs(det) <= 1e-14 * std::abs(uu * vv)) return;
    const double du = (uv * g_v - vv * g_u) / det, dv = (uv * g_u - uu * g_v) / det;
    u += du;
    v += dv;
    if (std::abs(du) * on_a.first.norm() + std::abs(dv) * on_b.first.norm() <= 1e-15 * (a.radius + b.radius)) return;
  }
  on_a = evaluate(a, x_a, y_a, u);
  on_b = evaluate(b, x_b, y_b, v);
}

/// Nearest points of two curves, in closed form where one exists. Returns false if they are undefined.
bool find_nearest(const Curve& a, const Curve& b, const Vector3d& n, Spot& on_a, Spot& on_b) {
  if (b.kind < a.kind) return find_nearest(b, a, -n, on_b, on_a);
  on_a = {a.p, a.d, Vector3d::Zero()};
  on_b = {b.p, b.d, Vector3d::Zero()};
  if (b.kind == Curve::kCircle) {
    if (a.kind != Curve::kPoint) {
      find_stationary(a, b, n, on_a, on_b);
      return true;
    }
    Vector3d out = a.p - b.p;
    out -= b.d * b.d.dot(out);
    const double length = out.norm();
    if (!(length > 0)) return false;
    on_b.p = b.p + out * (b.radius / length);
    return true;
  }
  if (b.kind == Curve::kPoint) return true;
  const Vector3d offset = b.p - a.p;
  if (a.kind == Curve::kPoint) {
    on_b.p = b.p - b.d * b.d.dot(offset);
    return true;
  }
  const double turn = a.d.dot(b.d), square = a.d.cross(b.d).squaredNorm();
  if (square < 1e-12) return false;  // parallel: the ends of the lines give better pairs
  const double t = (offset.dot(a.d) - turn * offset.dot(b.d)) / square;
  on_a.p = a.p + t * a.d;
  on_b.p = b.p + b.d * b.d.dot(on_a.p - b.p);
  return true;
}

/// Common normal of two points, near n: the cross product of the curves' directions if both are curves on the surface.
bool find_normal(const Curve& a, const Curve& b, const Spot& on_a, const Spot& on_b, Vector3d& n) {
  Vector3d across = on_b.p - on_a.p;
  const bool curves = a.kind != Curve::kPoint && b.kind != Curve::kPoint && a.around + b.around == 0;
  if (curves) {
    const Vector3d both = on_a.first.cross(on_b.first);
    if (both.norm() > 1e-6 * on_a.first.norm() * on_b.first.norm()) across = both.dot(n) < 0 ? Vector3d(-both) : both;
  }
  const double length = across.norm();
  if (!(length > 1e-150)) return false;
  n = across / length;
  return true;
}

}  // namespace

Separation refine(const Placed& a, const Placed& b, const Separation& start, bool& certain, Feature& scratch) {
  const double size = a.convex->extent.norm() + b.convex->extent.norm(), rounding = 1e-13 * size;
  Separation best = start;
  Curves of_a, of_b;
  const auto try_pair = [&](const Curve& on, const Curve& to, const Vector3d& toward) {
    Spot p_a, p_b;
    Vector3d n = toward;
    if (!find_nearest(on, to, toward, p_a, p_b) || !find_normal(on, to, p_a, p_b, n)) return;
    const Vector3d offset = p_b.p - p_a.p;
    const double along = n.dot(offset), between = along - on.around - to.around;
    if (between < best.gap - rounding) return;  // `between` is an upper bound of the gap along n
    const double gap = gap_along(a, b, n);
    constexpr double kPlace = 1e-9;  // of the size: the points lie on the features and their connection is along n
    const bool held = gap >= between - 10 * rounding && (offset - along * n).norm() <= kPlace * size &&
                      on.contains(p_a.p, kPlace * size) && to.contains(p_b.p, kPlace * size);
    if (gap > best.gap + rounding || (held && !certain && gap >= best.gap - rounding)) {
      best = {n, gap, p_b.p - to.around * n};
      certain = held;
    }
  };
  // Pairs that need Newton's iteration come last.
  const auto needs_newton = [](const Curve& on, const Curve& to) {
    return (on.kind == Curve::kCircle && to.kind != Curve::kPoint) || (to.kind == Curve::kCircle && on.kind != Curve::kPoint);
  };
  constexpr int kRounds = 6;
  for (int round = 0; round < kRounds; ++round) {
    const Vector3d n_before = best.n;
    const double gap_before = best.gap;
    of_a.find(a, n_before, scratch);
    of_b.find(b, -n_before, scratch);
    for (const bool newton : {false, true}) {
      for (const Curve& on : of_a) {
        for (const Curve& to : of_b) {
          if (needs_newton(on, to) == newton) try_pair(on, to, n_before);
        }
      }
      if (certain && best.gap >= 0) return best;
    }
    if (best.gap <= gap_before + rounding) break;
  }
  return best;
}

}  // namespace cotwin::collision
