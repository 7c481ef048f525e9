// Closed meshes of bodies, and what is inside them.
#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include "models/collision/body.h"

namespace cotwin::collision {

using Eigen::Vector3d;

/// Finds the triangles that are joined at edges, and whether they close.
void Body::find_meshes(std::span<const scene::Shape> shapes) {
  struct Use {
    std::array<double, 6> ends;  // in the body, the lesser one first
    int direction;
    std::uint32_t piece;
  };
  std::vector<Use> uses;
  closed_.assign(shapes.size(), Closed::kNo);
  groups_.resize(shapes.size());
  std::iota(groups_.begin(), groups_.end(), 0U);
  for (std::uint32_t k = 0; k < shapes.size(); ++k) {
    if (shapes[k].type != scene::ShapeType::kTriangle) continue;
    closed_[k] = Closed::kOriented;
    for (std::size_t i = 0; i < 3; ++i) {
      std::array<Vector3d, 2> ends{shapes[k].X_BS * shapes[k].vertices[i], shapes[k].X_BS * shapes[k].vertices[(i + 1) % 3]};
      const bool turned = std::ranges::lexicographical_compare(ends[1], ends[0]);
      if (turned) std::swap(ends[0], ends[1]);
      uses.push_back({{ends[0].x(), ends[0].y(), ends[0].z(), ends[1].x(), ends[1].y(), ends[1].z()}, turned ? -1 : 1, k});
    }
  }
  if (uses.empty()) return;
  std::ranges::sort(uses, {}, &Use::ends);
  const auto first_of = [this](std::uint32_t k) {
    while (groups_[k] != k) k = groups_[k] = groups_[groups_[k]];
    return k;
  };
  // First which triangles are joined, then which edges of a mesh are open.
  for (const bool judge : {false, true}) {
    for (auto begin = uses.begin(); begin != uses.end();) {
      const auto end = std::find_if(begin, uses.end(), [&](const Use& use) { return use.ends != begin->ends; });
      int around = 0;
      for (auto use = begin; use != end; ++use) {
        around += use->direction;
        const std::uint32_t one = first_of(begin->piece), other = first_of(use->piece);
        groups_[std::max(one, other)] = std::min(one, other);
      }
      Closed& closed = closed_[first_of(begin->piece)];
      if (judge && around != 0 && closed == Closed::kOriented) closed = Closed::kEven;
      if (judge && (end - begin) % 2 != 0) closed = Closed::kNo;
      begin = end;
    }
  }
  prisms_.resize(shapes.size());
  for (std::uint32_t k = 0; k < shapes.size(); ++k) {
    groups_[k] = first_of(k);
    if (shapes[k].type != scene::ShapeType::kTriangle) continue;
    closed_[k] = closed_[groups_[k]];
    (closed_[k] == Closed::kNo ? open_ : bounds_) = true;
    if (closed_[k] != Closed::kNo) prisms_[k] = make_convex(shapes[k]);
  }
}

/// Counts the triangles below a node that the ray crosses.
void Body::count_crossings(const Ray& ray, std::int32_t at, Crossings& crossings) const {
  const Node& node = nodes_[static_cast<std::size_t>(at)];
  const Vector3d one = (node.middle - node.half - ray.p).cwiseQuotient(ray.d);
  const Vector3d other = (node.middle + node.half - ray.p).cwiseQuotient(ray.d);
  if (std::max(one.cwiseMin(other).maxCoeff(), 0.0) > one.cwiseMax(other).minCoeff()) return;
  if (node.left >= 0) {
    count_crossings(ray, node.left, crossings);
    count_crossings(ray, node.right, crossings);
    return;
  }
  const Closed closed = closed_[node.piece];
  if (closed == Closed::kNo || present_[node.piece] == 0) return;
  const Crossing crossing = cross(ray, triangles_[node.piece]);
  constexpr double kEdge = 1e-9;  // of the triangle: nearer to an edge another ray is cast
  if (!(crossing.within >= -kEdge && crossing.t >= 0)) return;
  crossings.certain = crossings.certain && crossing.within > kEdge;
  (closed == Closed::kOriented ? crossings.around : crossings.all) += crossing.front ? 1 : -1;
}

bool Body::contains(const Vector3d& p) const {
  if (!bounds_ || ((p - nodes_.back().middle).cwiseAbs() - nodes_.back().half).maxCoeff() > 0) return false;
  // Towards a side that is near, never along an axis.
  static const std::array<Vector3d, 4> kDirections{Vector3d(0.5217, 0.6131, 0.5932), Vector3d(0.7321, 0.3719, 0.5707),
                                                   Vector3d(0.3907, 0.5303, 0.7523), Vector3d(0.6029, 0.7417, 0.2939)};
  const Vector3d side = (p - nodes_.back().middle).unaryExpr([](double x) { return x < 0 ? -1.0 : 1.0; });
  Crossings crossings;
  for (const Vector3d& direction : kDirections) {
    crossings = {};
    count_crossings({p, direction.cwiseProduct(side)}, root(), crossings);
    if (crossings.certain) break;
  }
  return crossings.around != 0 || crossings.all % 2 != 0;
}

void Finder::find_inside(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most, Distance& best) {
  for (std::uint32_t k = 0; k < b.pieces_.size(); ++k) {
    const Convex& piece = b.pieces_[k];
    if (b.groups_[k] != k || b.present_[k] == 0 || piece.core == Core::kPlane) continue;
    const bool corners = !piece.polytope.vertices.empty();  // the middle of a polytope may be outside of it
    const Vector3d p_B = corners ? Vector3d(piece.X_BC * piece.polytope.vertices[0]) : piece.X_BC.p;
    if (!a.contains(X_WA.inverse() * (X_WB * p_B))) continue;
    const Distance found = nearest(a, X_WA, b, X_WB, scene::kInfinity, k);
    if (!(found.d > 0 && found.d < scene::kInfinity)) continue;  // it touches the surface, and was found
    double depth = 0;                                            // of the part's far side below the surface
    for (std::uint32_t j = k; j < b.pieces_.size(); ++j) {
      const Convex& own = b.pieces_[j];
      if (b.groups_[j] != k) continue;
      const Placed placed{&own, X_WB.R * own.X_BC.R, X_WB * own.X_BC.p};
      depth = std::max(depth, (support(placed, found.n) - found.p_a).dot(found.n) + own.round);
    }
    if (-depth <= most && -depth < best.d) best = {-depth, -found.n, found.p_a, found.p_a + depth * found.n, false};
  }
}

}  // namespace cotwin::collision
