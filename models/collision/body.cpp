#include "models/collision/body.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "models/collision/descend.h"
#include "models/foundation/support/error.h"

namespace cotwin::collision {
using Eigen::Vector3d;

Body::Body(std::span<const scene::Shape> shapes) {
  std::vector<std::uint32_t> bounded;
  for (const scene::Shape& shape : shapes) {
    const auto k = static_cast<std::uint32_t>(pieces_.size());
    pieces_.push_back(shape.type == scene::ShapeType::kTriangle ? make_flat(shape) : make_convex(shape));
    present_.push_back(shape.tool.empty() ? 1 : 0);
    const Convex& piece = pieces_.back();
    corners_ = std::max(corners_, most_corners(piece));
    (piece.core == Core::kPlane ? planes_ : bounded).push_back(k);
    reach_ = std::max(reach_,
                      piece.core == Core::kPlane ? scene::kInfinity : piece.X_BC.p.norm() + piece.extent.norm() + piece.round);
  }
  const auto is_flat = [](const Convex& piece) { return piece.polytope.vertices.size() == 3; };
  if (std::ranges::any_of(pieces_, is_flat))
    triangles_.assign(pieces_.size(), {Vector3d::Constant(std::nan("")), Vector3d::Zero(), Vector3d::Zero()});
  for (std::size_t k = 0; k < triangles_.size(); ++k) {
    const std::vector<Vector3d>& v = pieces_[k].polytope.vertices;
    if (is_flat(pieces_[k])) triangles_[k] = {pieces_[k].X_BC * v[0], pieces_[k].X_BC * v[1], pieces_[k].X_BC * v[2]};
  }
  find_meshes(shapes);
  if (!bounded.empty()) {
    const Node& root = nodes_[static_cast<std::size_t>(build(bounded))];
    middle_ = root.middle;
    radius_ = root.radius;
  }
  if (!planes_.empty()) radius_ = scene::kInfinity;
  for (std::size_t halves = bounded.size(); halves > 1; halves = (halves + 1) / 2) ++depth_;
}

void Body::set_scaled(const Body& unscaled, double factor) {
  *this = unscaled;
  for (std::size_t k = 0; k < pieces_.size() + prisms_.size(); ++k) {
    Convex& c = k < pieces_.size() ? pieces_[k] : prisms_[k - pieces_.size()];
    for (double* length : {&c.round, &c.half, &c.radius}) *length *= factor;
    c.extent *= factor;
    c.X_BC.p *= factor;
    for (Vector3d& v : c.polytope.vertices) v *= factor;
    for (scene::Polytope::Face& face : c.polytope.faces) face.d *= factor;
  }
  for (Corners& triangle : triangles_)
    for (Vector3d& corner : triangle) corner *= factor;
  for (Node& node : nodes_) {
    node.middle *= factor;
    node.half *= factor;
    node.radius *= factor;
  }
  middle_ *= factor;
  for (double* length : {&reach_, &radius_}) *length *= factor;
}

/// Halves the pieces by the middles of their boxes along the longest side.
std::int32_t Body::build(std::span<std::uint32_t> pieces) {
  Vector3d low = Vector3d::Constant(scene::kInfinity), high = -low, first = low, last = high;
  for (const std::uint32_t k : pieces) {
    const Convex& c = closed_[k] == Closed::kNo ? pieces_[k] : prisms_[k];
    const Vector3d &p = c.X_BC.p, half = half_sizes(c, c.X_BC.R);
    low = low.cwiseMin(p - half);
    high = high.cwiseMax(p + half);
    first = first.cwiseMin(p);
    last = last.cwiseMax(p);
  }
  Node node;
  node.middle = (low + high) / 2;
  node.half = (high - low) / 2;
  node.radius = node.half.norm();
  if (pieces.size() == 1) {
    const Convex& c = closed_[pieces[0]] == Closed::kNo ? pieces_[pieces[0]] : prisms_[pieces[0]];
    node.piece = pieces[0];
    node.radius = std::min(node.radius, c.extent.norm() + c.round);
  } else {
    Eigen::Index axis = 0;
    (last - first).maxCoeff(&axis);
    const std::size_t middle = pieces.size() / 2;
    std::ranges::nth_element(pieces, pieces.begin() + static_cast<std::ptrdiff_t>(middle),
                             [&](std::uint32_t i, std::uint32_t j) {
                               const double a = pieces_[i].X_BC.p[axis], b = pieces_[j].X_BC.p[axis];
                               return a != b ? a < b : i < j;
                             });
    node.left = build(pieces.first(middle));
    node.right = build(pieces.subspan(middle));
  }
  nodes_.push_back(node);
  return static_cast<std::int32_t>(nodes_.size()) - 1;
}

void Finder::reserve(const Body& solid) {
  depth_ = std::max(depth_, solid.depth_);
  stack_.reserve(2 * depth_ + 2);  // each step leaves one more, and there are two trees to descend
  scratch_.corners.reserve(solid.corners_);
}

Distance Finder::find(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most) {
  if (b.points_ != nullptr) return from_cloud(a, X_WA, b, X_WB, most);
  if (a.points_ != nullptr) {
    const Distance back = from_cloud(b, X_WB, a, X_WA, most);
    return {back.d, -back.n, back.p_b, back.p_a, back.on_surfaces};
  }
  Distance best = nearest(a, X_WA, b, X_WB, most);
  if (best.d <= 0) return best;
  if (a.bounds_) find_inside(a, X_WA, b, X_WB, most, best);
  if (!b.bounds_) return best;
  Distance back = {.d = best.d};
  find_inside(b, X_WB, a, X_WA, most, back);
  return back.d < best.d ? Distance{back.d, -back.n, back.p_b, back.p_a, back.on_surfaces} : best;
}

Distance Finder::nearest(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most, std::uint32_t group) {
  Distance best;
  const auto try_pieces = [&](std::uint32_t i, std::uint32_t j) {
    if (a.present_[i] == 0 || b.present_[j] == 0) return;
    if (group != kAll && (a.closed_[i] == Body::Closed::kNo || b.groups_[j] != group)) return;
    const Convex *piece_a = &a.pieces_[i], *piece_b = &b.pieces_[j];
    // About a place near both: far from the origin of W the rounding is larger.
    const Vector3d origin = piece_a->core == Core::kPlane ? X_WB * piece_b->X_BC.p : X_WA * piece_a->X_BC.p;
    const auto measure = [&] {
      return distance({piece_a, X_WA.R * piece_a->X_BC.R, X_WA * piece_a->X_BC.p - origin},
                      {piece_b, X_WB.R * piece_b->X_BC.R, X_WB * piece_b->X_BC.p - origin}, scratch_, most);
    };
    Distance found = measure();
    if (found.d <= 0 && (a.closed_[i] != Body::Closed::kNo || b.closed_[j] != Body::Closed::kNo)) {
      // What crosses a surface has to leave the solid behind it.
      if (a.closed_[i] != Body::Closed::kNo) piece_a = &a.prisms_[i];
      if (b.closed_[j] != Body::Closed::kNo) piece_b = &b.prisms_[j];
      found = measure();
      found.on_surfaces = false;
    }
    if (found.d > most || !(found.d < best.d)) return;
    best = {found.d, found.n, found.p_a + origin, found.p_b + origin, found.on_surfaces};
    most = found.d;
  };
  for (const std::uint32_t i : a.planes_) {
    for (std::uint32_t j = 0; j < b.pieces_.size(); ++j) try_pieces(i, j);
  }
  for (const std::uint32_t j : b.planes_) {
    for (std::uint32_t i = 0; i < a.pieces_.size(); ++i) try_pieces(i, j);
  }
  if (a.nodes_.empty() || b.nodes_.empty()) return best;
  descend(a, b, b.root(), X_WA.inverse() * X_WB, 0, most, [&](const Body::Node& of_a, const Body::Node& of_b) {
    if (of_b.left < 0) try_pieces(of_a.piece, of_b.piece);
    return true;
  });
  return best;
}

}  // namespace cotwin::collision
