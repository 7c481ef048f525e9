#include "models/scene/hull.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;
using Index = std::uint32_t;

constexpr Index kNone = std::numeric_limits<Index>::max();
constexpr double kFlat = 1e-9;  // of the extent: tolerance for points in a plane, and nearer points are one
__extension__ using Int128 = __int128;

/// Quickhull (Barber, Dobkin, Huhdanpaa 1996): replaces each triangle by a fan to the farthest point above it. The points are on a grid of 2^-50 of the
/// extent, where the side of a plane on which a point lies is exact: so the surface is convex, however thin its triangles are.
class Quickhull {
 public:
  /// Throws Error for points without volume.
  explicit Quickhull(std::span<const Vector3d> points);
  /// With points nearer than `tolerance` (of the extent) as one, and with faces as flat as that. Throws Error for points without volume.
  Polytope polytope(double tolerance);
  /// Whether it is a convex polytope that contains all points, up to kFlat of the extent and the rounding of coordinates.
  bool holds(const Polytope& polytope) const;

 private:
  struct Triangle {
    std::array<Index, 3> v{};
    std::array<Index, 3> neighbour{};  // the triangle across the edge from v[i] to v[i + 1]
    Vector3d n = Vector3d::Zero();
    double d = 0;
    std::vector<Index> outside;  // points above it
    bool gone = false;
  };

  void surround(const std::vector<Index>& points);
  void start(const std::vector<Index>& points);
  std::vector<Index> vertices_without_near(double least) const;
  Index add(Index a, Index b, Index c);
  std::array<Int128, 3> normal(Index a, Index b, Index c) const;
  void assign_points(const std::vector<Index>& points, const std::vector<Index>& triangles);
  void add_point(Index over);
  double above(const Triangle& t, Index point) const { return t.n.dot(on_grid_[point]) - t.d; }
  bool sees(Index point, const Triangle& t) const;
  std::vector<Index> merged(double flat, std::vector<Vector3d>& normals) const;

  std::span<const Vector3d> points_;
  std::vector<Vector3d> on_grid_;    // integers
  double extent_ = 0, largest_ = 0;  // m: largest side of the box around the points, largest coordinate
  double grid_ = 0;                  // extent_ on the grid
  double rounding_ = 0;              // on the grid: points at most this high above a triangle count as in its plane
  std::vector<Triangle> triangles_;
};

Quickhull::Quickhull(std::span<const Vector3d> points) : points_(points) {
  if (points.size() < 4) throw Error("hull", std::to_string(points.size()) + " points, expected at least 4");
  Vector3d low = points_[0], high = points_[0];
  for (const Vector3d& p : points_) {
    if (!p.allFinite()) throw Error("hull", "a point is not finite");
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  extent_ = (high - low).maxCoeff();
  if (!std::isfinite(extent_)) throw Error("hull", "extent is not finite");
  largest_ = std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());
  const int shift = extent_ > 0 ? 50 - std::ilogb(extent_) : 0;
  on_grid_.reserve(points.size());
  for (const Vector3d& p : points_) {
    on_grid_.push_back((p - low).unaryExpr([shift](double x) { return std::round(std::ldexp(x, shift)); }));
  }
  grid_ = std::ldexp(extent_, shift);
  rounding_ = 1e-13 * grid_;
}

/// Surrounds these points by triangles.
void Quickhull::surround(const std::vector<Index>& points) {
  start(points);
  assign_points(points, {0, 1, 2, 3});
  for (Index i = 0; i < triangles_.size(); ++i) {  // grows in the loop
    if (!triangles_[i].gone && !triangles_[i].outside.empty()) add_point(i);
  }
}

/// Twice the area of a triangle times its normal.
std::array<Int128, 3> Quickhull::normal(Index a, Index b, Index c) const {
  const Eigen::Matrix<std::int64_t, 3, 1> u = (on_grid_[b] - on_grid_[a]).cast<std::int64_t>(),
                                          w = (on_grid_[c] - on_grid_[a]).cast<std::int64_t>();
  const auto minor = [&](int i, int j) { return Int128{u[i]} * w[j] - Int128{u[j]} * w[i]; };
  return {minor(1, 2), minor(2, 0), minor(0, 1)};
}

Index Quickhull::add(Index a, Index b, Index c) {
  Triangle t;
  t.v = {a, b, c};
  const std::array<Int128, 3> n = normal(a, b, c);
  t.n = Vector3d(static_cast<double>(n[0]), static_cast<double>(n[1]), static_cast<double>(n[2])).normalized();
  t.d = std::max({t.n.dot(on_grid_[a]), t.n.dot(on_grid_[b]), t.n.dot(on_grid_[c])});
  triangles_.push_back(std::move(t));
  return static_cast<Index>(triangles_.size() - 1);
}

/// Whether the point is above the plane of the triangle: exact.
bool Quickhull::sees(Index point, const Triangle& t) const {
  constexpr double kCertain = 16;  // more than the rounding of above()
  const double height = above(t, point);
  if (std::abs(height) > kCertain) return height > 0;
  // In two parts, as 128 bits have no room for the sum.
  const std::array<Int128, 3> n = normal(t.v[0], t.v[1], t.v[2]);
  const Eigen::Matrix<std::int64_t, 3, 1> offset = (on_grid_[point] - on_grid_[t.v[0]]).cast<std::int64_t>();
  Int128 high = 0, low = 0;
  for (int i = 0; i < 3; ++i) {
    high += (n[static_cast<std::size_t>(i)] >> 32) * offset[i];
    low += (n[static_cast<std::size_t>(i)] & 0xFFFFFFFF) * offset[i];
  }
  high += low >> 32;
  return high > 0 || (high == 0 && (low & 0xFFFFFFFF) != 0);
}

void Quickhull::assign_points(const std::vector<Index>& points, const std::vector<Index>& triangles) {
  for (const Index p : points) {
    Index best = kNone;
    double most = rounding_;
    for (const Index t : triangles) {
      const double height = above(triangles_[t], p);
      if (height > most) most = height, best = t;
    }
    if (best != kNone) triangles_[best].outside.push_back(p);
  }
}

/// Begins with four points that are far from each other.
void Quickhull::start(const std::vector<Index>& points) {
  triangles_.clear();
  const auto farthest = [&](auto&& distance) {
    Index best = points[0];
    double most = -1;
    for (const Index i : points) {
      const double x = distance(on_grid_[i]);
      if (x > most) most = x, best = i;
    }
    return best;
  };
  Vector3d low = on_grid_[points[0]], high = low;
  for (const Index i : points) low = low.cwiseMin(on_grid_[i]), high = high.cwiseMax(on_grid_[i]);
  Eigen::Index longest = 0;
  (high - low).maxCoeff(&longest);
  const Index a = farthest([&](const Vector3d& p) { return high[longest] - p[longest]; });
  const Index b = farthest([&](const Vector3d& p) { return (p - on_grid_[a]).norm(); });
  const Vector3d line = (on_grid_[b] - on_grid_[a]).normalized();
  const Index c = farthest([&](const Vector3d& p) { return (p - on_grid_[a]).cross(line).norm(); });
  add(a, b, c);
  const Index d = farthest([&](const Vector3d& p) { return std::abs(triangles_[0].n.dot(p) - triangles_[0].d); });
  const double height = above(triangles_[0], d);
  if (!(std::abs(height) > kFlat * grid_)) {
    throw Error("hull", std::to_string(points_.size()) + " points within " +
                            text::to_text(std::abs(height) / grid_ * extent_, 3) +
                            " m of a plane, expected a body with volume");
  }
  triangles_.clear();
  const std::array<Index, 4> v = height < 0 ? std::array{a, b, c, d} : std::array{a, c, b, d};  // d below a, b, c
  add(v[0], v[1], v[2]);
  add(v[1], v[0], v[3]);
  add(v[2], v[1], v[3]);
  add(v[0], v[2], v[3]);
  triangles_[0].neighbour = {1, 2, 3};
  triangles_[1].neighbour = {0, 3, 2};
  triangles_[2].neighbour = {0, 1, 3};
  triangles_[3].neighbour = {0, 2, 1};
}

/// Adds the farthest point above the triangle to the hull: removes all triangles visible from it and connects it to their
/// horizon.
void Quickhull::add_point(Index over) {
  const std::vector<Index>& candidates = triangles_[over].outside;
  const Index top = *std::max_element(candidates.begin(), candidates.end(), [&](Index a, Index b) {
    return above(triangles_[over], a) < above(triangles_[over], b);
  });
  std::vector<Index> seen{over}, orphans;
  triangles_[over].gone = true;
  struct Rim {
    Index from, to, neighbour;
  };
  std::vector<Rim> horizon;
  for (std::size_t k = 0; k < seen.size(); ++k) {
    const Triangle& t = triangles_[seen[k]];
    for (std::size_t e = 0; e < 3; ++e) {
      Triangle& next = triangles_[t.neighbour[e]];
      if (next.gone) continue;
      if (sees(top, next)) {
        next.gone = true;
        seen.push_back(t.neighbour[e]);
      }
    }
  }
  for (const Index s : seen) {
    const Triangle& t = triangles_[s];
    for (std::size_t e = 0; e < 3; ++e) {
      if (!triangles_[t.neighbour[e]].gone) horizon.push_back({t.v[e], t.v[(e + 1) % 3], t.neighbour[e]});
    }
    orphans.insert(orphans.end(), t.outside.begin(), t.outside.end());
  }
  for (const Index s : seen) triangles_[s].outside.clear();

  std::vector<Index> fan;
  for (const Rim& rim : horizon) {
    const Index t = add(rim.from, rim.to, top);
    triangles_[t].neighbour[0] = rim.neighbour;
    Triangle& other = triangles_[rim.neighbour];
    for (std::size_t e = 0; e < 3; ++e) {
      if (other.v[e] == rim.to && other.v[(e + 1) % 3] == rim.from) other.neighbour[e] = t;
    }
    fan.push_back(t);
  }
  for (const Index t : fan) {
    for (const Index u : fan) {
      if (triangles_[u].v[0] == triangles_[t].v[1]) triangles_[t].neighbour[1] = u;  // across (to, top)
      if (triangles_[u].v[1] == triangles_[t].v[0]) triangles_[t].neighbour[2] = u;  // across (top, from)
    }
  }
  std::erase(orphans, top);  // now a vertex
  assign_points(orphans, fan);
}

/// The vertices, of those that an edge of at most this length connects only the first one.
std::vector<Index> Quickhull::vertices_without_near(double least) const {
  std::vector<char> used(points_.size(), 0);
  std::vector<std::array<Index, 2>> near;
  for (const Triangle& t : triangles_) {
    if (t.gone) continue;
    for (std::size_t e = 0; e < 3; ++e) {
      const Index a = t.v[e], b = t.v[(e + 1) % 3];
      used[a] = 1;
      if (a < b && (on_grid_[a] - on_grid_[b]).norm() <= least) near.push_back({a, b});
    }
  }
  std::sort(near.begin(), near.end());  // so that those before decide, of which it is certain whether they stay
  for (const auto& [a, b] : near) used[b] = used[a] != 0 ? 0 : used[b];
  std::vector<Index> kept;
  for (Index i = 0; i < used.size(); ++i) {
    if (used[i] != 0) kept.push_back(i);
  }
  return kept;
}

/// Index of the face of each triangle: the largest triangle defines the plane, neighbours within `flat` of it join the face.
std::vector<Index> Quickhull::merged(double flat, std::vector<Vector3d>& normals) const {
  std::vector<Index> order;
  for (Index i = 0; i < triangles_.size(); ++i) {
    if (!triangles_[i].gone) order.push_back(i);
  }
  const auto area = [&](Index i) {
    const auto& v = triangles_[i].v;
    return (points_[v[1]] - points_[v[0]]).cross(points_[v[2]] - points_[v[0]]).norm();
  };
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return area(a) > area(b); });
  std::vector<Index> face(triangles_.size(), kNone);
  for (const Index seed : order) {
    if (face[seed] != kNone) continue;
    const auto count = static_cast<Index>(normals.size());
    const Triangle& plane = triangles_[seed];
    normals.push_back(plane.n);
    std::vector<Index> region{seed};
    face[seed] = count;
    for (std::size_t k = 0; k < region.size(); ++k) {
      for (const Index next : triangles_[region[k]].neighbour) {
        const auto& v = triangles_[next].v;
        const bool within = flat > 0 && std::all_of(v.begin(), v.end(), [&](Index p) { return above(plane, p) >= -flat; });
        if (face[next] != kNone || !within) continue;
        face[next] = count;
        region.push_back(next);
      }
    }
  }
  return face;
}

/// A face by its normal and the indices of its points.
struct Loop {
  Vector3d n;
  std::vector<Index> corners;
};

/// Converts loops to faces, edges and vertices.
Polytope assemble(std::span<const Vector3d> points, std::vector<Loop> loops) {
  // A point with only two faces lies within an edge.
  std::vector<Index> faces_at(points.size(), 0);
  for (const Loop& loop : loops) {
    for (const Index p : loop.corners) ++faces_at[p];
  }
  for (Loop& loop : loops) std::erase_if(loop.corners, [&](Index p) { return faces_at[p] < 3; });
  std::erase_if(loops, [](const Loop& loop) { return loop.corners.size() < 3; });

  Polytope polytope;
  std::vector<Index> renamed(points.size(), kNone);
  for (const Loop& loop : loops) {
    for (const Index p : loop.corners) renamed[p] = 0;
  }
  for (Index p = 0; p < points.size(); ++p) {
    if (renamed[p] == kNone) continue;
    renamed[p] = static_cast<Index>(polytope.vertices.size());
    polytope.vertices.push_back(points[p]);
  }
  std::vector<std::array<Index, 3>> sides;  // smaller vertex, larger vertex, corner
  for (const auto& [n, loop] : loops) {
    double d = -std::numeric_limits<double>::infinity();
    const auto begin = static_cast<Index>(polytope.corners.size()), count = static_cast<Index>(loop.size());
    for (Index k = 0; k < count; ++k) {
      const Index a = renamed[loop[k]], b = renamed[loop[(k + 1) % count]];
      d = std::max(d, n.dot(points[loop[k]]));
      sides.push_back({std::min(a, b), std::max(a, b), begin + k});
      polytope.corners.push_back(a);
    }
    polytope.faces.push_back({n, d, begin, count});
  }
  std::vector<Index> face_of(polytope.corners.size());
  for (Index f = 0; f < polytope.faces.size(); ++f) {
    for (Index k = 0; k < polytope.faces[f].count; ++k) face_of[polytope.faces[f].begin + k] = f;
  }
  polytope.corner_edges.assign(polytope.corners.size(), 0);
  std::sort(sides.begin(), sides.end());
  for (std::size_t k = 0; k < sides.size(); ++k) {
    const auto& [a, b, corner] = sides[k];
    if (k == 0 || sides[k - 1][0] != a || sides[k - 1][1] != b)
      polytope.edges.push_back({{a, b}, {face_of[corner], face_of[corner]}});
    polytope.edges.back().faces[1] = face_of[corner];
    polytope.corner_edges[corner] = static_cast<Index>(polytope.edges.size() - 1);
  }
  return polytope;
}

Polytope Quickhull::polytope(double tolerance) {
  std::vector<Index> points(points_.size()), vertices;
  std::iota(points.begin(), points.end(), 0);
  for (std::size_t count = 0; count != points.size(); points = vertices_without_near(tolerance * grid_)) {
    surround(points);
    count = vertices_without_near(-1).size();
  }
  std::vector<Loop> loops;
  std::vector<Vector3d> normals;
  const std::vector<Index> face = merged(tolerance * grid_, normals);
  std::vector<std::vector<std::array<Index, 2>>> rims(normals.size());  // edges between different faces
  for (Index i = 0; i < triangles_.size(); ++i) {
    const Triangle& t = triangles_[i];
    if (t.gone) continue;
    for (std::size_t e = 0; e < 3; ++e) {
      if (face[t.neighbour[e]] != face[i]) rims[face[i]].push_back({t.v[e], t.v[(e + 1) % 3]});
    }
  }
  for (std::size_t f = 0; f < rims.size(); ++f) {
    auto& rim = rims[f];
    Loop loop{normals[f], {}};
    Index at = rim.empty() ? kNone : rim.front()[0];
    for (std::size_t k = 0; k < rim.size(); ++k) {
      const auto next = std::find_if(rim.begin(), rim.end(), [&](const auto& side) { return side[0] == at; });
      if (next == rim.end()) break;
      loop.corners.push_back(at);
      at = (*next)[1];
      (*next)[0] = kNone;
    }
    if (loop.corners.size() >= 3) loops.push_back(std::move(loop));
  }
  return assemble(points_, std::move(loops));
}

bool Quickhull::holds(const Polytope& polytope) const {
  constexpr double kRounding = 1e-15;  // of the largest coordinate
  constexpr std::size_t kMost = 20'000'000;
  const double tolerance = kFlat * extent_ + kRounding * largest_;
  const std::vector<Polytope::Face>& faces = polytope.faces;
  if (polytope.vertices.size() + faces.size() != polytope.edges.size() + 2 ||
      polytope.corners.size() != 2 * polytope.edges.size())
    return false;
  const auto corner = [&](Index f, Index k) -> const Vector3d& {
    return polytope.vertices[polytope.corners[faces[f].begin + k % faces[f].count]];
  };
  // From a point of the body, as coordinates may be large.
  const auto height = [&](Index f, const Vector3d& p) { return faces[f].n.dot(p - points_[0]); };
  std::vector<double> most(faces.size(), -std::numeric_limits<double>::infinity());
  for (Index f = 0; f < faces.size(); ++f) {
    for (Index k = 0; k < faces[f].count; ++k) {
      const Vector3d side = corner(f, k + 1) - corner(f, k), next = corner(f, k + 2) - corner(f, k + 1);
      if (!(faces[f].n.cross(side).stableNormalized().dot(next) >= -tolerance)) return false;
      most[f] = std::max(most[f], height(f, corner(f, k)));
    }
    most[f] += tolerance;
  }
  // A closed surface that is convex at every edge is convex: of very many points a share will do.
  for (const Polytope::Edge& edge : polytope.edges) {
    const auto& [one, other] = edge.faces;
    if (one == other) return false;
    for (Index k = 0; k < faces[one].count; ++k)
      if (!(height(other, corner(one, k)) <= most[other])) return false;
    for (Index k = 0; k < faces[other].count; ++k)
      if (!(height(one, corner(other, k)) <= most[one])) return false;
  }
  const std::size_t stride = 1 + points_.size() * faces.size() / kMost;
  for (Index f = 0; f < faces.size(); ++f) {
    for (std::size_t p = 0; p < points_.size(); p += stride)
      if (!(height(f, points_[p]) <= most[f])) return false;
  }
  return polytope.volume() > 0;
}

/// Σ over the tetrahedra from `origin` to the triangles of each face: f(signed volume, the three corners from the origin).
template <class F>
void over_tetrahedra(const Polytope& polytope, const Vector3d& origin, F&& f) {
  for (const Polytope::Face& face : polytope.faces) {
    const Vector3d a = polytope.vertices[polytope.corners[face.begin]] - origin;
    for (Index k = 1; k + 1 < face.count; ++k) {
      const Vector3d b = polytope.vertices[polytope.corners[face.begin + k]] - origin;
      const Vector3d c = polytope.vertices[polytope.corners[face.begin + k + 1]] - origin;
      f(a.dot(b.cross(c)) / 6, a, b, c);
    }
  }
}

}  // namespace

double Polytope::volume() const {
  double sum = 0;
  over_tetrahedra(*this, vertices.front(), [&](double v, const Vector3d&, const Vector3d&, const Vector3d&) { sum += v; });
  return sum;
}

Vector3d Polytope::centroid() const {
  Vector3d sum = Vector3d::Zero();
  double total = 0;
  over_tetrahedra(*this, vertices.front(), [&](double v, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    sum += v * (a + b + c) / 4;
    total += v;
  });
  return vertices.front() + sum / total;
}

Eigen::Matrix3d Polytope::second_moment() const {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();  // ∫ x xᵀ dV; over a tetrahedron at the origin V/20 (Σ pᵢ pᵢᵀ + s sᵀ)
  over_tetrahedra(*this, centroid(), [&](double v, const Vector3d& a, const Vector3d& b, const Vector3d& c) {
    const Vector3d s = a + b + c;
    sum += v / 20 * (a * a.transpose() + b * b.transpose() + c * c.transpose() + s * s.transpose());
  });
  return sum.trace() * Eigen::Matrix3d::Identity() - sum;
}

Polytope box_polytope(const Vector3d& size) {
  std::vector<Vector3d> points;
  for (int i = 0; i < 8; ++i) {
    points.push_back(
        size.cwiseProduct(Vector3d((i & 4) != 0 ? 0.5 : -0.5, (i & 2) != 0 ? 0.5 : -0.5, (i & 1) != 0 ? 0.5 : -0.5)));
  }
  const Vector3d x = Vector3d::UnitX(), y = Vector3d::UnitY(), z = Vector3d::UnitZ();
  return assemble(
      points,
      {{-x, {0, 1, 3, 2}}, {x, {4, 6, 7, 5}}, {-y, {0, 4, 5, 1}}, {y, {2, 3, 7, 6}}, {-z, {0, 2, 6, 4}}, {z, {1, 5, 7, 3}}});
}

Polytope convex_hull(std::span<const Vector3d> points) {
  Quickhull quickhull(points);
  // Of nearly flat and nearly equal points a surface with smaller faces may hold where one with whole faces does not.
  for (const double tolerance : {kFlat, 1e-2 * kFlat, 0.0}) {
    Polytope polytope = quickhull.polytope(tolerance);
    if (quickhull.holds(polytope)) return polytope;
  }
  throw Error("hull", std::to_string(points.size()) + " points without a convex surface that contains them to " +
                          text::to_text(kFlat) + " of their extent, expected a body with clear faces");
}

}  // namespace cotwin::scene
