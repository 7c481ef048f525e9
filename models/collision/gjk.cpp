// The searches use Bullet. Its GJK and EPA are header-only templates; no library is linked.
#include <BulletCollision/NarrowPhaseCollision/btGjkEpa3.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "models/collision/gjk.h"

namespace cotwin::collision {

namespace {

using Eigen::Vector3d;

btVector3 to_bullet(const Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Vector3d from_bullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }

/// Convex set in the form that Bullet's templates expect: the core, translated and scaled. Bullet's tolerances are 10⁻⁴,
/// absolute and relative to the distance; the caller chooses translation and scale so that neither matters.
class Magnified {
 public:
  Magnified(const Placed& piece, const Vector3d& shift, double scale, double margin = 0)
      : piece_(piece), shift_(shift), scale_(scale), margin_(margin) {}
  btVector3 getLocalSupportWithMargin(const btVector3& d) const {
    Vector3d p = support(piece_, from_bullet(d)) + shift_;
    if (margin_ > 0) p += from_bullet(d).normalized() * margin_;
    return to_bullet(p * scale_);
  }

 private:
  const Placed& piece_;
  const Vector3d shift_;
  const double scale_, margin_;  // margin: m, of a ball by which the core is grown
};

/// The Minkowski difference of A and B. (btGjkEpaSolver3_Distance would create one itself, but leaves one of its flags
/// uninitialised.)
MinkowskiDiff<Magnified> difference(const Magnified& A, const Magnified& B) {
  MinkowskiDiff<Magnified> difference(A, B);
  difference.EnableMargin(false);
  difference.m_toshape0.setIdentity();
  difference.m_toshape1.setIdentity();
  return difference;
}

double size_of(const Placed& a, const Placed& b) { return a.convex->extent.norm() + b.convex->extent.norm(); }

/// The points of a simplex in the Minkowski difference b − a, and the one of them that is nearest to the origin.
class Simplex {
 public:
  /// Returns false if the point is among them.
  bool add(const Vector3d& w, const Vector3d& on_b) {
    for (int k = 0; k < count_; ++k)
      if (w_[k] == w) return false;
    w_[count_] = w;
    on_b_[count_++] = on_b;
    return true;
  }
  /// Leaves the vertices whose convex hull has the nearest point in its inside; false if that is the origin, inside of four.
  bool reduce() {
    square_ = scene::kInfinity;
    bool outside = count_ < 4;
    if (count_ == 1) take(0, 1);
    if (count_ == 2) try_segment(0, 1);
    if (count_ == 3) try_triangle(0, 1, 2);
    if (count_ == 4) {
      constexpr double kFlat = 1e-10;  // of the edges: rounding decides on which side of a face the origin is
      const Vector3d x = w_[1] - w_[0], y = w_[2] - w_[0], z = w_[3] - w_[0];
      const bool flat = std::abs(x.cross(y).dot(z)) <= kFlat * x.norm() * y.norm() * z.norm();
      for (const auto& [i, j, k, l] : {std::array{0, 1, 2, 3}, {0, 3, 1, 2}, {0, 2, 3, 1}, {1, 3, 2, 0}}) {
        const Vector3d n = (w_[j] - w_[i]).cross(w_[k] - w_[i]);
        if (!flat && n.dot(w_[i]) * n.dot(w_[l] - w_[i]) < 0) continue;  // the origin is on the side of l
        outside = true;
        try_triangle(i, j, k);
      }
    }
    int kept = 0;
    for (int k = 0; k < count_; ++k) {
      if (!(weights_[k] > 0)) continue;
      w_[kept] = w_[k];
      on_b_[kept] = on_b_[k];
      weights_[kept++] = weights_[k];
    }
    count_ = kept;
    return outside;
  }
  const Vector3d& nearest() const { return nearest_; }
  Vector3d on_b() const {
    Vector3d p = Vector3d::Zero();
    for (int k = 0; k < count_; ++k) p += weights_[k] * on_b_[k];
    return p;
  }

 private:
  void take(int i, double u, int j = 0, double v = 0, int k = 0, double w = 0) {
    const Vector3d p = u * w_[i] + v * w_[j] + w * w_[k];
    if (!(p.squaredNorm() < square_)) return;
    square_ = p.squaredNorm();
    nearest_ = p;
    weights_ = {};
    weights_[i] += u;
    weights_[j] += v;
    weights_[k] += w;
  }
  void try_segment(int i, int j) {
    const Vector3d along = w_[j] - w_[i];
    const double t = std::clamp(-w_[i].dot(along) / along.squaredNorm(), 0.0, 1.0);
    take(i, 1 - t, j, t);
  }
  void try_triangle(int i, int j, int k) {
    const Vector3d n = (w_[j] - w_[i]).cross(w_[k] - w_[i]);
    const double u = n.dot(w_[j].cross(w_[k])), v = n.dot(w_[k].cross(w_[i])), w = n.dot(w_[i].cross(w_[j]));
    if (u > 0 && v > 0 && w > 0) return take(i, u / (u + v + w), j, v / (u + v + w), k, w / (u + v + w));
    if (u <= 0) try_segment(j, k);
    if (v <= 0) try_segment(k, i);
    if (w <= 0) try_segment(i, j);
  }

  std::array<Vector3d, 4> w_, on_b_;
  std::array<double, 4> weights_{};
  Vector3d nearest_ = Vector3d::Zero();
  double square_ = 0;
  int count_ = 0;
};

}  // namespace

Separation gjk(const Placed& a, const Placed& b, const Vector3d& n, double enough, double& upper) {
  constexpr double kRounding = 1e-15;  // of the size
  constexpr int kMost = 100;
  const double size = size_of(a, b), rounding = kRounding * size;
  Separation best;
  best.gap = -scene::kInfinity;
  upper = scene::kInfinity;
  Simplex simplex;
  Vector3d direction = n;
  for (int round = 0; round < kMost; ++round) {
    const Vector3d on_b = support(b, -direction), w = on_b - support(a, direction);
    const double gap = direction.dot(w);
    if (gap > best.gap) best.n = direction, best.gap = gap;
    if (best.gap > enough || upper - best.gap <= rounding || !simplex.add(w, on_b)) break;
    const bool outside = simplex.reduce();
    const double length = simplex.nearest().norm();
    if (!outside || length <= 10 * rounding) {
      if (!(best.gap > 0)) upper = 0;
      break;
    }
    if (!(length < upper)) break;  // as far as rounding allows
    upper = length;
    direction = simplex.nearest() / length;
    best.p_b = simplex.on_b();
  }
  return best;
}

Separation climb(const Placed& a, const Placed& b, const Separation& start) {
  const double size = size_of(a, b), apart = 1e-5 * size;
  constexpr int kRounds = 8;
  constexpr double kSame = 1e-12, kNear = 1e-10;  // of the size
  Separation best = start, now = start;
  best.p_b = support(b, -start.n);
  for (int round = 0; round < kRounds; ++round) {
    const bool as_it_is = round == 0 && now.gap > apart;
    const Vector3d shift = now.n * (as_it_is ? 0 : apart - now.gap);
    double upper = 0;
    const Separation found = gjk(a, {b.convex, b.R, b.p + shift}, now.n, scene::kInfinity, upper);
    if (!(upper > 0)) break;
    const double before = now.gap;
    now = {found.n, gap_along(a, b, found.n), found.p_b - shift};
    if (now.gap >= best.gap - kNear * size) best.p_b = now.p_b;
    if (now.gap > best.gap) best = now;
    if (std::abs(now.gap - before) <= kSame * size) break;
  }
  return best;
}

Separation expand(const Placed& a, const Placed& b, const Separation& start) {
  const double scale = 1e3 / size_of(a, b);  // EPA's tolerance of 10⁻⁴ is then 10⁻⁷ of the size
  const Magnified A(a, Vector3d::Zero(), scale), B(b, Vector3d::Zero(), scale);
  GJK<Magnified> gjk(A, B);
  if (gjk.Evaluate(difference(A, B), to_bullet(-start.n)) != eGjkInside) return start;
  EPA<Magnified> epa;
  if (epa.Evaluate(gjk, to_bullet(-start.n)) == eEpaFailed) return start;
  const Vector3d n = from_bullet(epa.m_normal);
  if (!(std::abs(n.squaredNorm() - 1) < 1e-6)) return start;
  const double gap = gap_along(a, b, n);
  if (!(gap > start.gap)) return start;
  return {n.normalized(), gap, support(b, -n)};
}

}  // namespace cotwin::collision
