// The searches use Bullet. Its GJK and EPA are header-only templates; no library is linked.
#include <BulletCollision/NarrowPhaseCollision/btGjkEpa3.h>

#include <Eigen/Geometry>
#include <algorithm>
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

/// On A and on B, of the simplex in which a successful search ended.
std::pair<Vector3d, Vector3d> nearest_points(const GJK<Magnified>& gjk, const MinkowskiDiff<Magnified>& shape) {
  std::pair<Vector3d, Vector3d> points{Vector3d::Zero(), Vector3d::Zero()};
  for (U i = 0; i < gjk.m_simplex->rank; ++i) {
    points.first += gjk.m_simplex->p[i] * from_bullet(shape.Support(gjk.m_simplex->c[i]->d, 0));
    points.second += gjk.m_simplex->p[i] * from_bullet(shape.Support(-gjk.m_simplex->c[i]->d, 1));
  }
  return points;
}

double size_of(const Placed& a, const Placed& b) { return a.convex->extent.norm() + b.convex->extent.norm(); }

}  // namespace

Separation approach(const Placed& a, const Placed& b, const Separation& start, double left, double& upper) {
  const double margin = std::max(0.0, start.gap - left);
  const double scale = margin > 0 ? 1 / left : 1e3 / size_of(a, b);
  const Magnified A(a, Vector3d::Zero(), scale), B(b, Vector3d::Zero(), scale, margin);
  const MinkowskiDiff<Magnified> shape = difference(A, B);
  GJK<Magnified> gjk(A, B);
  if (gjk.Evaluate(shape, to_bullet(-start.n)) != eGjkValid) return start;
  const auto [p_a, p_b] = nearest_points(gjk, shape);
  const Vector3d n = (p_b - p_a).stableNormalized();
  Vector3d on_a = p_a / scale, on_b = p_b / scale;
  if (margin > 0) {
    on_a = on_b = Vector3d::Zero();
    for (U i = 0; i < gjk.m_simplex->rank; ++i) {
      const Vector3d d = from_bullet(gjk.m_simplex->c[i]->d);
      on_a += gjk.m_simplex->p[i] * support(a, d);
      on_b += gjk.m_simplex->p[i] * support(b, -d);
    }
  }
  upper = (on_b - on_a).norm();
  const double gap = gap_along(a, b, n);
  return gap > start.gap ? Separation{n, gap, on_b} : start;
}

Separation climb(const Placed& a, const Placed& b, const Separation& start) {
  // The cores are moved to a distance of 10⁻⁵ of their size, which is scaled to 1. Bullet's relative error of 10⁻⁴ is then 10⁻⁹
  // of the size; the error of the gap is smaller still, because the distance is stationary in n. The first round measures
  // separated cores where they are.
  const double size = size_of(a, b), apart = 1e-5 * size;
  constexpr int kRounds = 8;
  constexpr double kSame = 1e-12, kNear = 1e-10;  // of the size
  Separation best = start, now = start;
  best.p_b = support(b, -start.n);
  for (int round = 0; round < kRounds; ++round) {
    const bool as_it_is = round == 0 && now.gap > apart;
    const double moved = as_it_is ? 0 : apart - now.gap, scale = 1 / (now.gap + moved);
    const Magnified A(a, Vector3d::Zero(), scale), B(b, now.n * moved, scale);
    const MinkowskiDiff<Magnified> shape = difference(A, B);
    GJK<Magnified> gjk(A, B);
    if (gjk.Evaluate(shape, to_bullet(-now.n)) != eGjkValid) break;
    const auto [p_a, p_b] = nearest_points(gjk, shape);
    const double length = (p_b - p_a).norm();
    if (!(length > 1e-3)) break;  // the scaled distance is at least 1
    const Vector3d n = (p_b - p_a) / length;
    const double before = now.gap;
    now = {n, 0, p_b / scale - now.n * moved};
    now.gap = gap_along(a, b, now.n);
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
