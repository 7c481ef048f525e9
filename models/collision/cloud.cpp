// Bodies of points, and their distance from bodies of shapes.
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "models/collision/body.h"
#include "models/collision/descend.h"

namespace cotwin::collision {

using Eigen::Vector3d;

namespace {

constexpr double kRounding = 1e-12;  // m

/// The pose of a body A in the frame C about the origin of a cloud. Differences first: both may be far away.
Pose about_origin(const Pose& X_WA, const Pose& X_WC, const Vector3d& origin) {
  return {X_WC.R.transpose() * X_WA.R, X_WC.R.transpose() * (X_WA.p - X_WC.p) - origin};
}

}  // namespace

Body::Body(std::shared_ptr<const cloud::Tree> points, double radius) : points_(std::move(points)) {
  middle_ = points_->cloud().origin + points_->node(0).middle;
  depth_ = points_->depth();
  set_ball(radius);
}

void Body::set_ball(double radius) {
  ball_ = radius;
  radius_ = points_->node(0).radius + radius;
  reach_ = middle_.norm() + radius_;
}

Distance Finder::nearest_point(const Body& a, const Pose& X_CA, const Body& cloud, std::int32_t node, double most,
                               bool closed) {
  Distance best;
  const auto placed = [&X_CA](const Convex& piece) { return Placed{&piece, X_CA.R * piece.X_BC.R, X_CA * piece.X_BC.p}; };
  const auto try_points = [&](std::size_t i, const cloud::Tree::Node& below) {
    const bool solid = a.closed_[i] != Body::Closed::kNo;
    if (a.present_[i] == 0 || (closed && !solid)) return false;
    const Convex& piece = a.pieces_[i];
    const Placed surface = placed(piece);
    const double grown = piece.round + cloud.ball_;
    // What crosses a surface has to leave the solid behind it, and may be deeper in there than it is beyond the surface.
    const auto enough = [&] { return (solid ? std::max(most, 0.0) : most) + kRounding; };
    // A point is at least as far away as it is from the plane that touches the piece across the way to the middle of the box.
    const Separation middle = of_point(surface, below.middle, enough() + grown + below.radius);
    if (middle.gap - middle.n.cwiseAbs().dot(below.half) - grown > enough()) return false;
    for (std::uint32_t k = below.first; k < below.last; ++k) {
      const Vector3d p = cloud.points_->cloud().points[k].cast<double>();
      if (middle.gap + middle.n.dot(p - below.middle) - grown > enough()) continue;
      Separation s = of_point(surface, p, enough() + grown);
      const bool behind = solid && s.gap - grown <= 0;
      if (behind) s = of_point(placed(a.prisms_[i]), p);
      const double d = s.gap - grown;
      if (d > most || !(d < best.d)) continue;
      const Vector3d p_b = p - cloud.ball_ * s.n;
      best = {d, s.n, p_b - d * s.n, p_b, !behind};
      most = d;
    }
    return true;
  };
  cloud::Tree::Node all = cloud.points_->node(node);
  if (all.left >= 0) all.last = static_cast<std::uint32_t>(cloud.points_->cloud().points.size());
  for (const std::uint32_t i : a.planes_) try_points(i, all);
  if (a.nodes_.empty()) return best;
  descend(a, *cloud.points_, node, X_CA.inverse(), cloud.ball_, most,
          [&](const Body::Node& of_a, const cloud::Tree::Node& of_c) { return try_points(of_a.piece, of_c); });
  return best;
}

/// The deepest of the points below a node that are inside a closed mesh of a without touching it, if it is deeper than `best`. `surface`: no point is
/// nearer to a surface, m, so that those of a node with a smaller radius are all on one side.
void Finder::find_points_inside(const Body& a, const Pose& X_CA, const Body& cloud, std::int32_t at, double surface,
                                double most, Distance& best) {
  const cloud::Tree& tree = *cloud.points_;
  const cloud::Tree::Node node = tree.node(at);
  const Pose X_AC = X_CA.inverse();
  const Body::Node& box = a.node(a.root());
  if (from_box(box.half, X_AC * node.middle - box.middle, node.radius) > 0) return;
  const auto point = [&](std::uint32_t k) { return Vector3d(tree.cloud().points[k].cast<double>()); };
  if (node.left >= 0) {
    std::int32_t leaf = at;
    while (tree.node(leaf).left >= 0) leaf = tree.node(leaf).left;
    if (node.radius < surface && !a.contains(X_AC * point(tree.node(leaf).first))) return;
    find_points_inside(a, X_CA, cloud, node.left, surface, most, best);
    find_points_inside(a, X_CA, cloud, node.right, surface, most, best);
    return;
  }
  for (std::uint32_t k = node.first; k < node.last; ++k) {
    if (!a.contains(X_AC * point(k))) continue;
    const Distance found = nearest_point(a, X_CA, cloud, tree.nodes() + static_cast<std::int32_t>(k), scene::kInfinity, true);
    if (!(found.d > 0 && found.d < scene::kInfinity)) continue;  // it touches the surface, and was found
    const double depth = found.d + 2 * cloud.ball_;              // of the ball's far side
    if (-depth <= most && -depth < best.d) best = {-depth, -found.n, found.p_a, found.p_a + depth * found.n};
  }
}

Distance Finder::from_cloud(const Body& a, const Pose& X_WA, const Body& cloud, const Pose& X_WC, double most) {
  if (a.points_ != nullptr) return {};
  const Vector3d& origin = cloud.points_->cloud().origin;
  const Pose X_CA = about_origin(X_WA, X_WC, origin);
  Distance best = nearest_point(a, X_CA, cloud, 0, most, false);
  if (a.bounds_) find_points_inside(a, X_CA, cloud, 0, std::min(best.d, most) + cloud.ball_, most, best);
  const auto in_W = [&](const Vector3d& p) { return Vector3d(X_WC.p + X_WC.R * (origin + p)); };
  return {best.d, X_WC.R * best.n, in_W(best.p_a), in_W(best.p_b), best.on_surfaces};
}

void Finder::find_near(const Body& body, const Pose& X_WB, const Body& cloud, const Pose& X_WC, double most,
                       std::vector<char>& near) {
  const cloud::Tree& tree = *cloud.points_;
  const Pose X_CB = about_origin(X_WB, X_WC, tree.cloud().origin), X_BC = X_CB.inverse();
  const auto n = static_cast<std::int32_t>(tree.cloud().points.size());
  for (std::int32_t k = 0; k < n; ++k) {
    const auto at = static_cast<std::size_t>(k);
    if (near[at] != 0) continue;
    const Vector3d p = X_BC * tree.cloud().points[at].cast<double>();
    near[at] = (p - body.middle()).norm() - body.radius() <= most &&
               (nearest_point(body, X_CB, cloud, tree.nodes() + k, most, false).d <= most || body.contains(p));
  }
}

}  // namespace cotwin::collision
