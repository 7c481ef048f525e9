#include "models/collision/gjk.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cotwin::collision {

namespace {

using Eigen::Vector3d;

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
    if (!outside) return false;
    int kept = 0;
    for (int k = 0; k < count_; ++k) {
      if (!(weights_[k] > 0)) continue;
      w_[kept] = w_[k];
      on_b_[kept] = on_b_[k];
      weights_[kept++] = weights_[k];
    }
    count_ = kept;
    return true;
  }
  const Vector3d& nearest() const { return nearest_; }
  int count() const { return count_; }
  const Vector3d& vertex(int k) const { return w_[k]; }
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

/// gjk(), with the simplex in which it ends.
Separation search(const Placed& a, const Placed& b, const Vector3d& n, double enough, double& upper, Simplex& simplex) {
  constexpr double kRounding = 1e-15, kSame = 1e-12, kFar = 1e-9;  // of the size, of the distance
  constexpr int kMost = 100;
  const double size = size_of(a, b), rounding = kRounding * size;
  Separation best;
  best.gap = -scene::kInfinity;
  upper = scene::kInfinity;
  Vector3d direction = n;
  double gap = 0;
  for (int round = 0; round < kMost; ++round) {
    const Vector3d on_b = support(b, -direction), w = on_b - support(a, direction);
    gap = direction.dot(w);
    if (gap > best.gap) best.n = direction, best.gap = gap;
    if (best.gap > enough) return best;
    if (upper - best.gap <= rounding || !simplex.add(w, on_b)) break;
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
  // The gap hardly tells directions apart: that of the two points is theirs.
  if (upper > 0 && upper - best.gap <= kSame * size && upper - gap <= std::max(kSame * size, kFar * upper)) best.n = direction;
  return best;
}

}  // namespace

Separation gjk(const Placed& a, const Placed& b, const Vector3d& n, double enough, double& upper) {
  Simplex simplex;
  return search(a, b, n, enough, upper, simplex);
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
  constexpr int kMost = 64;  // vertices
  const double almost = 1e-9 * size_of(a, b), rounding = 1e-12 * size_of(a, b);
  struct Face {
    std::array<int, 3> v;
    Vector3d n = Vector3d::UnitZ();  // outwards
    double d = -1;
  };
  Simplex simplex;
  double upper = 0;
  (void)search(a, b, start.n, scene::kInfinity, upper, simplex);
  if (upper > 0 || simplex.count() < 4) return start;
  std::array<Vector3d, kMost> w;
  std::array<Face, 2 * kMost> faces;
  std::array<std::array<int, 2>, 6 * kMost> edges;
  int vertices = 0, count = 0;
  for (; vertices < 4; ++vertices) w[vertices] = simplex.vertex(vertices);
  bool degenerate = false;
  const auto add = [&](int i, int j, int k) {
    const Vector3d across = (w[j] - w[i]).cross(w[k] - w[i]);
    const double length = across.norm();
    degenerate = degenerate || !(length > 0);
    const Vector3d n = across / length;
    faces[count++] = {{i, j, k}, n, n.dot(w[i])};
  };
  if ((w[1] - w[0]).cross(w[2] - w[0]).dot(w[3] - w[0]) > 0) std::swap(w[1], w[2]);
  for (const auto& [i, j, k] : {std::array{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}}) add(i, j, k);
  Separation found = start;
  while (!degenerate) {
    const Face best = *std::min_element(faces.begin(), faces.begin() + count,
                                        [](const Face& one, const Face& other) { return one.d < other.d; });
    const Vector3d on_b = support(b, best.n), farthest = on_b - support(a, -best.n);
    const double depth = best.n.dot(farthest);
    if (-depth > found.gap) found = {-best.n, -depth, on_b};
    if (depth - best.d <= almost || vertices == kMost) break;
    // The faces that it sees are replaced by those from their border to it.
    int left = 0, border = 0;
    for (int f = 0; f < count; ++f) {
      if (!(faces[f].n.dot(farthest) > faces[f].d + rounding)) {
        faces[left++] = faces[f];
        continue;
      }
      for (int e = 0; e < 3; ++e) {
        const std::array<int, 2> edge{faces[f].v[e], faces[f].v[(e + 1) % 3]}, back{edge[1], edge[0]};
        const auto end = edges.begin() + border, known = std::find(edges.begin(), end, back);
        if (known == end)
          edges[border++] = edge;
        else
          *known = edges[--border];
      }
    }
    count = left;
    if (count + border > 2 * kMost) break;
    w[vertices] = farthest;
    for (int e = 0; e < border; ++e) add(edges[e][0], edges[e][1], vertices);
    ++vertices;
  }
  return found;
}

}  // namespace cotwin::collision
