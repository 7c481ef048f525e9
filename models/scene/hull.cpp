#include "models/scene/hull.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <limits>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;
using Index = std::uint32_t;

constexpr Index kNone = std::numeric_limits<Index>::max();
constexpr double kFlat = 1e-9;  // of the extent: tolerance for points in a plane

/// Quickhull (Barber, Dobkin, Huhdanpaa 1996): replaces each triangle by a fan to the farthest point above it.
class Quickhull {
 public:
  explicit Quickhull(std::span<const Vector3d> points);
  Polytope polytope() const;

 private:
  struct Triangle {
    std::array<Index, 3> v{};
    std::array<Index, 3> neighbour{};  // the triangle across the edge from v[i] to v[i + 1]
    Vector3d n = Vector3d::Zero();
    double d = 0;
    std::vector<Index> outside;  // points above it
    bool gone = false;
  };

  void start();
  bool try_with(double coarser);
  bool closed() const;
  Index add(Index a, Index b, Index c);
  void assign_points(const std::vector<Index>& points, const std::vector<Index>& triangles);
  void add_point(Index over);
  double above(const Triangle& t, Index point) const { return t.n.dot(points_[point]) - t.d; }
  std::vector<Index> merged() const;

  std::span<const Vector3d> points_;
  double extent_ = 0;
  double rounding_ = 0;  // m: points at most this high above a triangle count as in its plane
  std::vector<Triangle> triangles_;
};

Quickhull::Quickhull(std::span<const Vector3d> points) : points_(points) {
  // If points are so close to each other or to planes that rounding breaks the surface, a larger tolerance omits some of them.
  for (const double coarser : {1.0, 1e2, 1e4}) {
    if (try_with(coarser)) return;
  }
  throw Error("hull", std::to_string(points_.size()) +
                          " points nearly on a line or in planes: rounding prevents a closed "
                          "surface, expected a body with clear faces");
}

bool Quickhull::try_with(double coarser) {
  triangles_.clear();
  start();
  rounding_ *= coarser;
  std::vector<Index> all(points_.size());
  for (Index i = 0; i < all.size(); ++i) all[i] = i;
  assign_points(all, {0, 1, 2, 3});
  for (Index i = 0; i < triangles_.size(); ++i) {  // grows in the loop
    if (!triangles_[i].gone && !triangles_[i].outside.empty()) add_point(i);
  }
  return closed();
}

/// Whether the triangles form a closed surface without holes and handles: neighbours refer to each other, and F = 2 V − 4.
bool Quickhull::closed() const {
  std::vector<bool> used(points_.size());
  std::size_t faces = 0;
  for (Index i = 0; i < triangles_.size(); ++i) {
    const Triangle& t = triangles_[i];
    if (t.gone) continue;
    ++faces;
    for (std::size_t e = 0; e < 3; ++e) {
      used[t.v[e]] = true;
      const Triangle& next = triangles_[t.neighbour[e]];
      if (next.gone || std::find(next.neighbour.begin(), next.neighbour.end(), i) == next.neighbour.end()) return false;
    }
  }
  return faces == 2 * static_cast<std::size_t>(std::count(used.begin(), used.end(), true)) - 4;
}

Index Quickhull::add(Index a, Index b, Index c) {
  Triangle t;
  t.v = {a, b, c};
  t.n = (points_[b] - points_[a]).cross(points_[c] - points_[a]);
  const double length = t.n.stableNorm();
  if (length > 0) t.n /= length;  // a degenerate triangle has no plane and no points above it
  t.d = (t.n.dot(points_[a]) + t.n.dot(points_[b]) + t.n.dot(points_[c])) / 3;
  triangles_.push_back(std::move(t));
  return static_cast<Index>(triangles_.size() - 1);
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

void Quickhull::start() {
  const auto count = static_cast<Index>(points_.size());
  const std::string how_many = std::to_string(count) + " points";
  if (count < 4) throw Error("hull", how_many + ", expected at least 4");
  Vector3d low = points_[0], high = points_[0];
  for (const Vector3d& p : points_) {
    if (!p.allFinite()) throw Error("hull", "a point is not finite");
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  extent_ = (high - low).maxCoeff();
  if (!std::isfinite(extent_)) throw Error("hull", "extent is not finite");
  rounding_ = 1e-13 * extent_ + 4e-16 * std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());

  const auto farthest = [&](auto&& distance) {
    Index best = 0;
    double most = -1;
    for (Index i = 0; i < count; ++i) {
      const double x = distance(points_[i]);
      if (x > most) most = x, best = i;
    }
    return best;
  };
  Eigen::Index longest = 0;
  (high - low).maxCoeff(&longest);
  const Index a = farthest([&](const Vector3d& p) { return high[longest] - p[longest]; });
  const Index b = farthest([&](const Vector3d& p) { return (p - points_[a]).norm(); });
  const Vector3d line = (points_[b] - points_[a]).stableNormalized();
  const Index c = farthest([&](const Vector3d& p) { return (p - points_[a]).cross(line).norm(); });
  const Vector3d n = line.cross(points_[c] - points_[a]).stableNormalized();
  const Index d = farthest([&](const Vector3d& p) { return std::abs(n.dot(p - points_[a])); });
  const double thickness = std::abs(n.dot(points_[d] - points_[a]));
  if (!(thickness > kFlat * extent_)) {
    throw Error("hull", how_many + " within " + text::to_text(thickness, 3) + " m of a plane, expected a body with volume");
  }
  const bool below = n.dot(points_[d] - points_[a]) < 0;
  const std::array<Index, 4> v = below ? std::array{a, b, c, d} : std::array{a, c, b, d};  // d below a, b, c
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
      if (above(next, top) > rounding_) {
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
  std::erase(orphans, top);  // now a vertex: rounding must not put it above a new triangle
  assign_points(orphans, fan);
}

/// Index of the face of each triangle: the largest triangle defines the plane, neighbours within kFlat of it join the face.
std::vector<Index> Quickhull::merged() const {
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
  Index count = 0;
  for (const Index seed : order) {
    if (face[seed] != kNone) continue;
    const Triangle& plane = triangles_[seed];
    std::vector<Index> region{seed};
    face[seed] = count;
    for (std::size_t k = 0; k < region.size(); ++k) {
      for (const Index next : triangles_[region[k]].neighbour) {
        const auto& v = triangles_[next].v;
        const bool flat =
            std::all_of(v.begin(), v.end(), [&](Index p) { return std::abs(above(plane, p)) <= kFlat * extent_; });
        if (face[next] != kNone || !flat) continue;
        face[next] = count;
        region.push_back(next);
      }
    }
    ++count;
  }
  return face;
}

/// Converts loops to faces, edges and vertices. `loops`: indices of points.
Polytope assemble(std::span<const Vector3d> points, std::vector<std::vector<Index>> loops) {
  // A point with only two faces lies within an edge.
  std::vector<Index> faces_at(points.size(), 0);
  for (const auto& loop : loops) {
    for (const Index p : loop) ++faces_at[p];
  }
  for (auto& loop : loops) std::erase_if(loop, [&](Index p) { return faces_at[p] < 3; });
  std::erase_if(loops, [](const auto& loop) { return loop.size() < 3; });

  Polytope polytope;
  std::vector<Index> renamed(points.size(), kNone);
  for (const auto& loop : loops) {
    for (const Index p : loop) renamed[p] = 0;
  }
  for (Index p = 0; p < points.size(); ++p) {
    if (renamed[p] == kNone) continue;
    renamed[p] = static_cast<Index>(polytope.vertices.size());
    polytope.vertices.push_back(points[p]);
  }
  std::vector<std::array<Index, 3>> sides;  // smaller vertex, larger vertex, corner
  for (const auto& loop : loops) {
    Polytope::Face face{Vector3d::Zero(), 0, static_cast<Index>(polytope.corners.size()), static_cast<Index>(loop.size())};
    Vector3d centre = Vector3d::Zero();
    for (const Index p : loop) centre += points[p] / static_cast<double>(loop.size());
    for (std::size_t k = 0; k < loop.size(); ++k) {
      face.n += (points[loop[k]] - centre).cross(points[loop[(k + 1) % loop.size()]] - centre);
      const Index a = renamed[loop[k]], b = renamed[loop[(k + 1) % loop.size()]];
      sides.push_back({std::min(a, b), std::max(a, b), static_cast<Index>(polytope.corners.size())});
      polytope.corners.push_back(a);
    }
    face.n.stableNormalize();
    face.d = -std::numeric_limits<double>::infinity();
    for (const Index p : loop) face.d = std::max(face.d, face.n.dot(points[p]));
    polytope.faces.push_back(face);
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

Polytope Quickhull::polytope() const {
  const std::vector<Index> face = merged();
  const Index count = 1 + *std::max_element(face.begin(), face.end(), [](Index a, Index b) { return a + 1 < b + 1; });
  std::vector<std::vector<std::array<Index, 2>>> rims(count);  // edges between different faces
  for (Index i = 0; i < triangles_.size(); ++i) {
    const Triangle& t = triangles_[i];
    if (t.gone) continue;
    for (std::size_t e = 0; e < 3; ++e) {
      if (face[t.neighbour[e]] != face[i]) rims[face[i]].push_back({t.v[e], t.v[(e + 1) % 3]});
    }
  }
  std::vector<std::vector<Index>> loops;
  for (auto& rim : rims) {
    std::vector<Index> loop;
    Index at = rim.empty() ? kNone : rim.front()[0];
    for (std::size_t k = 0; k < rim.size(); ++k) {
      const auto next = std::find_if(rim.begin(), rim.end(), [&](const auto& side) { return side[0] == at; });
      if (next == rim.end()) break;
      loop.push_back(at);
      at = (*next)[1];
      (*next)[0] = kNone;
    }
    if (loop.size() >= 3) loops.push_back(std::move(loop));
  }
  return assemble(points_, std::move(loops));
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
  Polytope box = assemble(points, {{0, 1, 3, 2}, {4, 6, 7, 5}, {0, 4, 5, 1}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 5, 7, 3}});
  for (std::size_t f = 0; f < 6; ++f) {  // exact, also for boxes of zero thickness
    const auto axis = static_cast<Eigen::Index>(f / 2);
    box.faces[f].n = Vector3d::Unit(axis) * (f % 2 == 0 ? -1 : 1);
    box.faces[f].d = size[axis] / 2;
  }
  return box;
}

Polytope convex_hull(std::span<const Vector3d> points) { return Quickhull(points).polytope(); }

}  // namespace cotwin::scene
