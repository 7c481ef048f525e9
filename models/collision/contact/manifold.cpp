#include "models/collision/contact/manifold.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>

namespace cotwin::collision {

namespace {

using Eigen::Vector2d;
using Eigen::Vector3d;

/// Corners up to this distance outside of an outline (relative to the smaller size) are on it. The tolerance keeps the ids of
/// coincident corners independent of rounding.
constexpr double kOn = 1e-7;

double cross(const Vector2d& a, const Vector2d& b) { return a.x() * b.y() - a.y() * b.x(); }

/// Height along n of a polygon's plane at u.
class Plane {
 public:
  Plane(const Feature& feature, const Vector3d& n, const Vector3d& t1, const Vector3d& t2) {
    const double scale = 1 / feature.n.dot(n);
    slope_ = -scale * Vector2d(feature.n.dot(t1), feature.n.dot(t2));
    const Vector3d& p = feature.corners[0].p;
    height_ = n.dot(p) - slope_.x() * t1.dot(p) - slope_.y() * t2.dot(p);
  }
  double at(const Vector2d& u) const { return height_ + slope_.dot(u); }

 private:
  Vector2d slope_;
  double height_;
};

/// Radius across n of a core's line: 0 for an edge.
double curvature(const Placed& piece) {
  return piece.convex->core == Core::kCylinder ? piece.convex->radius : piece.convex->round;
}

}  // namespace

void Manifold::reserve(std::size_t corners) {
  corners = std::max<std::size_t>(corners, kDiscCorners);
  a_.corners.reserve(corners);
  b_.corners.reserve(corners);
  sides_.reserve(corners);
  points_.reserve(3 * corners);  // clipping by a side replaces one corner by up to two
  kept_.reserve(3 * corners);
  found_.reserve(3 * corners);
}

void Manifold::outline(const Feature& feature, bool clockwise) {
  sides_.clear();
  const std::size_t count = feature.corners.size();
  for (std::size_t k = 0; k < count; ++k) {
    const std::size_t i = clockwise ? count - 1 - k : k;
    const std::size_t next = clockwise ? (i + count - 1) % count : (i + 1) % count;
    const Vector2d u = across(feature.corners[i].p), along = across(feature.corners[next].p) - u;
    const double length = along.norm();
    if (length == 0) continue;
    sides_.push_back(
        {u, Vector2d(-along.y(), along.x()) / length, feature.corners[i].vertex, feature.corners[clockwise ? next : i].edge});
  }
}

/// Clips the polygon of points_ by one side after the other (Sutherland and Hodgman 1974).
void Manifold::clip(std::uint32_t own_face) {
  double own = 0, other = 0;
  for (const Point& p : points_) own = std::max(own, (p.u - points_[0].u).squaredNorm());
  for (const Side& s : sides_) other = std::max(other, (s.u - sides_[0].u).squaredNorm());
  const double on = on_ = kOn * std::sqrt(std::min(own, other));
  for (std::size_t s = 0; s < sides_.size() && !points_.empty(); ++s) {
    const Side& side = sides_[s];
    const std::uint32_t before = sides_[(s + sides_.size() - 1) % sides_.size()].edge;
    const std::uint32_t after = sides_[(s + 1) % sides_.size()].vertex;
    const auto height = [&](const Point& p) { return side.inward.dot(p.u - side.u); };
    kept_.clear();
    double h = height(points_[0]);
    for (std::size_t k = 0; k < points_.size(); ++k) {
      const Point& p = points_[k];
      const Point& next = points_[(k + 1) % points_.size()];
      const double h_next = height(next);
      const bool inside = h >= -on, inside_next = h_next >= -on;
      if (inside) kept_.push_back(p);
      if (inside != inside_next) {
        const double of_kept = inside ? h : h_next;
        if (of_kept > on) {
          Point cut;
          cut.u = p.u + h / (h - h_next) * (next.u - p.u);
          const bool at_start = (cut.u - side.u).squaredNorm() <= on * on;
          const bool at_end = (cut.u - sides_[(s + 1) % sides_.size()].u).squaredNorm() <= on * on;
          if (p.on_other || at_start || at_end) {  // the other's corner, above this face
            const bool start = p.on_other ? p.edge == before : at_start;
            cut.part_own = static_cast<std::uint32_t>(FeatureKind::kFace);
            cut.part_other = static_cast<std::uint32_t>(FeatureKind::kVertex) | (start ? side.vertex : after);
          } else {
            cut.part_own = static_cast<std::uint32_t>(FeatureKind::kEdge) | p.edge;
            cut.part_other = static_cast<std::uint32_t>(FeatureKind::kEdge) | side.edge;
          }
          cut.edge = p.edge;
          cut.on_other = p.on_other;
          kept_.push_back(cut);
        }
        if (inside) {
          kept_.back().edge = side.edge;
          kept_.back().on_other = true;
        }
      }
      h = h_next;
    }
    std::swap(points_, kept_);
  }
  for (Point& p : points_) {
    if (p.part_own == static_cast<std::uint32_t>(FeatureKind::kFace)) p.part_own |= own_face;
  }
}

void Manifold::polygons(const Vector3d& n, double round_a, double round_b) {
  constexpr double kClearly = 1e-4;  // parallel faces keep their roles despite rounding
  const bool clip_a = -b_.n.dot(n) > a_.n.dot(n) + kClearly;
  const Feature& own = clip_a ? a_ : b_;
  const Feature& other = clip_a ? b_ : a_;
  points_.clear();
  const std::size_t count = own.corners.size();
  for (std::size_t k = 0; k < count; ++k) {  // both counter-clockwise seen against n
    const std::size_t i = clip_a ? k : count - 1 - k;
    Point p;
    p.u = across(own.corners[i].p);
    p.part_own = static_cast<std::uint32_t>(FeatureKind::kVertex) | own.corners[i].vertex;
    p.part_other = static_cast<std::uint32_t>(FeatureKind::kFace) | other.face;
    p.edge = own.corners[clip_a ? i : (i + count - 1) % count].edge;
    points_.push_back(p);
  }
  outline(other, clip_a);
  clip(own.face);
  double extent = 0;  // points of outlines that only touch at corners have no stable ids
  for (const Point& p : points_) extent = std::max(extent, (p.u - points_[0].u).squaredNorm());
  if (extent <= on_ * on_) return;
  const Plane plane_a(a_, n, t1_, t2_), plane_b(b_, n, t1_, t2_);
  double smallest = scene::kInfinity;
  for (const Point& p : points_) {
    const double h_a = plane_a.at(p.u) + round_a, h_b = plane_b.at(p.u) - round_b;
    const std::uint64_t a = clip_a ? p.part_own : p.part_other, b = clip_a ? p.part_other : p.part_own;
    found_.push_back({t1_ * p.u.x() + t2_ * p.u.y() + n * ((h_a + h_b) / 2), n, h_b - h_a, a << 32 | b});
    if (!(h_b - h_a < smallest)) continue;
    smallest = h_b - h_a;
    face_margin_ = p.part_own < static_cast<std::uint32_t>(FeatureKind::kEdge) ? scene::kInfinity : 0;
    for (const Side& side : sides_) face_margin_ = std::min(face_margin_, side.inward.dot(p.u - side.u));
  }
}

/// Adds the part of a segment (or of a point) above a polygon. Swapped: the segment belongs to b.
void Manifold::segment_on_polygon(const Feature& segment, const Feature& polygon, bool swapped, const Vector3d& n,
                                  double round_a, double round_b) {
  outline(polygon, !swapped);
  const Corner& first = segment.corners.front();
  const Corner& last = segment.corners.back();
  const Vector2d u = across(first.p), along = across(last.p) - u;
  double size = 0;
  for (const Side& s : sides_) size = std::max(size, (s.u - sides_[0].u).norm());
  const double on = kOn * std::max(std::min(size, along.norm()), 1e-3 * size);
  double from = 0, to = 1;
  FeatureKind part_from = FeatureKind::kVertex, part_to = FeatureKind::kVertex;
  std::uint32_t side_from = 0, side_to = 0;
  for (const Side& side : sides_) {
    const double h0 = side.inward.dot(u - side.u), h1 = h0 + side.inward.dot(along);
    if (h0 < -on && h1 < -on) return;
    const double cut = h0 == h1 ? 0 : h0 / (h0 - h1);
    if (h0 < -on && cut > from) from = cut, part_from = FeatureKind::kEdge, side_from = side.edge;
    if (h1 < -on && cut < to) to = cut, part_to = FeatureKind::kEdge, side_to = side.edge;
  }
  if (from > to) return;
  // A segment that only touches a corner of the outline has no stable id there.
  if (segment.corners.size() > 1 && (to - from) * along.norm() <= on) return;
  const Plane plane(polygon, n, t1_, t2_);
  const auto add_point = [&](double t, FeatureKind part, std::uint32_t side, const Corner& corner) {
    const Vector2d at = u + t * along;
    const double h_segment = n.dot(first.p) + t * n.dot(last.p - first.p);
    const double h_a = (swapped ? plane.at(at) : h_segment) + round_a, h_b = (swapped ? h_segment : plane.at(at)) - round_b;
    FeatureKind other = part == FeatureKind::kVertex ? FeatureKind::kFace : FeatureKind::kEdge;
    std::uint32_t other_index = part == FeatureKind::kVertex ? polygon.face : side;
    for (const Side& s : sides_) {
      if (part == FeatureKind::kEdge && (at - s.u).norm() <= on) other = FeatureKind::kVertex, other_index = s.vertex;
    }
    const std::uint32_t own_index = part == FeatureKind::kVertex ? corner.vertex : first.edge;
    const std::uint64_t id =
        swapped ? feature_pair_id(other, other_index, part, own_index) : feature_pair_id(part, own_index, other, other_index);
    found_.push_back({t1_ * at.x() + t2_ * at.y() + n * ((h_a + h_b) / 2), n, h_b - h_a, id});
  };
  add_point(from, part_from, side_from, first);
  if (segment.corners.size() > 1 && to > from) add_point(to, part_to, side_to, last);
}

/// Adds the crossing of two segments and, for lines with curvature, both ends of the part in which they are near each other: at a
/// small angle a little rotation moves the deepest point from one end to the other. Two nearly parallel edges have no crossing,
/// only the ends of their common part.
void Manifold::segments(const Placed& piece_a, const Placed& piece_b, const Vector3d& n) {
  const double round_a = piece_a.convex->round, round_b = piece_b.convex->round;
  const double radius_a = curvature(piece_a), radius_b = curvature(piece_b);
  const Vector3d a = a_.corners[0].p, along_a = a_.corners[1].p - a, b = b_.corners[0].p, along_b = b_.corners[1].p - b;
  const Vector2d u = across(along_a), v = across(along_b), w = across(b - a);
  const double uu = u.squaredNorm(), vv = v.squaredNorm(), turned = cross(u, v), radius = radius_a + radius_b;
  if (uu == 0 || vv == 0) return;
  const std::uint32_t edge_a = a_.corners[0].edge, edge_b = b_.corners[0].edge;
  const Vector3d axis_a = a + (round_a - radius_a) * n, axis_b = b - (round_b - radius_b) * n;  // of the rounded lines
  const auto between = [&](double t, double s) { return Vector3d(axis_b + s * along_b - axis_a - t * along_a); };
  constexpr double kUpright = 1e-6;  // of the radius, sideways
  const auto add_point = [&](double t, double s, std::uint64_t id) {
    const Vector3d offset = between(t, s), p_a = axis_a + t * along_a;
    const bool leans = radius > 0 && n.dot(offset) > 0 && (offset - n.dot(offset) * n).norm() > kUpright * radius;
    const Vector3d m = leans ? Vector3d(offset.normalized()) : n;
    const double gap = m.dot(offset) - radius;
    found_.push_back({radius > 0 ? Vector3d(p_a + (radius_a + gap / 2) * m) : Vector3d(p_a + offset / 2), m, gap, id});
  };
  constexpr double kParallel = 1e-3;  // sine
  const bool crossing = std::abs(turned) > kParallel * std::sqrt(uu * vv);
  const double t = crossing ? cross(w, v) / turned : 0, s = crossing ? cross(w, u) / turned : 0;
  const bool meet = crossing && t >= -kOn && t <= 1 + kOn && s >= -kOn && s <= 1 + kOn;
  if (meet)
    add_point(std::clamp(t, 0.0, 1.0), std::clamp(s, 0.0, 1.0),
              feature_pair_id(FeatureKind::kEdge, edge_a, FeatureKind::kEdge, edge_b));
  if (radius == 0 && crossing) return;

  constexpr double kNear = 0.3, kApart = 0.05;              // of the radius: sideways, and along from the crossing
  const double b0 = u.dot(w) / uu, b1 = u.dot(w + v) / uu;  // b's ends along a
  double from = std::max(0.0, std::min(b0, b1)), to = std::min(1.0, std::max(b0, b1));
  if (crossing) {
    const double reach = kNear * radius * std::sqrt(vv) / std::abs(turned);
    from = std::max(from, t - reach);
    to = std::min(to, t + reach);
  }
  if (from > to + kOn) return;
  const auto foot = [&](double place) { return std::clamp(v.dot(place * u - w) / vv, 0.0, 1.0); };
  // The ball of the radius about a place on the axis is within the shape; for cylinders not at their ends if the normal leans.
  const auto inside = [](const Placed& piece, const Vector3d& along, const Vector3d& offset, double place) {
    if (piece.convex->core != Core::kCylinder) return place;
    const double lean = std::abs(offset.normalized().dot(along)) / along.squaredNorm() * piece.convex->radius;
    return std::clamp(place, std::min(lean, 0.5), std::max(1 - lean, 0.5));
  };
  std::uint32_t end = 0;
  for (const double limit : {from, to}) {
    const Vector3d offset = between(limit, foot(limit));
    const double place = inside(piece_a, along_a, offset, limit);
    const std::uint64_t id = feature_pair_id(FeatureKind::kFace, edge_a, FeatureKind::kFace, end++);
    if (meet && std::abs(place - t) * std::sqrt(uu) < kApart * radius) continue;
    add_point(place, inside(piece_b, along_b, offset, foot(place)), id);
    if (to <= from) return;
  }
}

double Manifold::find(const Placed& a, const Placed& b, const Vector3d& n, double margin, std::vector<ManifoldPoint>& touches) {
  supporting_feature(a, n, a_);
  supporting_feature(b, -n, b_);
  Eigen::Index smallest = 0;
  n.cwiseAbs().minCoeff(&smallest);
  t1_ = n.cross(Vector3d::Unit(smallest)).normalized();
  t2_ = n.cross(t1_);
  found_.clear();
  face_margin_ = 0;
  const std::size_t count_a = a_.corners.size(), count_b = b_.corners.size();
  const double round_a = a.convex->round, round_b = b.convex->round;
  if (count_a > 2 && count_b > 2) {
    polygons(n, round_a, round_b);
  } else if (count_b > 2) {
    segment_on_polygon(a_, b_, false, n, round_a, round_b);
  } else if (count_a > 2) {
    segment_on_polygon(b_, a_, true, n, round_a, round_b);
  } else if (count_a == 2 && count_b == 2) {
    segments(a, b, n);
  }
  return choose(margin, touches);
}

void Manifold::on_plane(const Placed& plane, const Placed& b, const Vector3d& n, double margin,
                        std::vector<ManifoldPoint>& touches) {
  supporting_feature(b, -n, b_);
  t1_ = n.unitOrthogonal();
  t2_ = n.cross(t1_);
  found_.clear();
  const std::size_t step = b.convex->core == Core::kCylinder && b_.corners.size() > 2 ? kDiscCorners / 4 : 1;
  for (std::size_t k = 0; k < b_.corners.size(); k += step) {
    const Vector3d& p = b_.corners[k].p;
    const double gap = n.dot(p - plane.p) - b.convex->round;
    found_.push_back({p - n * (b.convex->round + gap / 2), n, gap,
                      feature_pair_id(FeatureKind::kWhole, 0, FeatureKind::kVertex, b_.corners[k].vertex)});
  }
  choose(margin, touches);
}

/// Selects four of the points: the deepest, the one farthest from it, and on each side of these two the one that encloses the
/// largest area. Among (nearly) equal points the lowest id, so that rounding does not decide.
double Manifold::choose(double margin, std::vector<ManifoldPoint>& touches) {
  double smallest = scene::kInfinity;
  for (const ManifoldPoint& t : found_) smallest = std::min(smallest, t.gap);
  std::erase_if(found_, [&](const ManifoldPoint& t) { return !(t.gap < margin); });
  std::sort(found_.begin(), found_.end(),
            [](const ManifoldPoint& a, const ManifoldPoint& b) { return a.id != b.id ? a.id < b.id : a.gap < b.gap; });
  found_.erase(
      std::unique(found_.begin(), found_.end(), [](const ManifoldPoint& a, const ManifoldPoint& b) { return a.id == b.id; }),
      found_.end());
  if (found_.size() <= 4) {
    touches.insert(touches.end(), found_.begin(), found_.end());
    return smallest;
  }
  const auto best_of = [&](auto&& value, double slack) {
    std::size_t best = 0;
    double most = -scene::kInfinity;
    for (std::size_t k = 0; k < found_.size(); ++k) {
      const double x = value(found_[k]);
      if (x > most + slack) most = x, best = k;
    }
    return best;
  };
  const auto place = [&](const ManifoldPoint& t) { return across(t.p); };
  const std::size_t i = best_of([](const ManifoldPoint& t) { return -t.gap; }, 1e-9);  // m
  const Vector2d p = place(found_[i]);
  double size = 0;
  for (const ManifoldPoint& t : found_) size = std::max(size, (place(t) - p).squaredNorm());
  const double slack = 1e-6 * size;  // m²
  const std::size_t j = best_of([&](const ManifoldPoint& t) { return (place(t) - p).squaredNorm(); }, slack);
  const Vector2d along = place(found_[j]) - p;
  const std::size_t left = best_of([&](const ManifoldPoint& t) { return cross(along, place(t) - p); }, slack);
  const std::size_t right = best_of([&](const ManifoldPoint& t) { return -cross(along, place(t) - p); }, slack);
  std::array<std::size_t, 4> chosen{i, j, left, right};
  std::sort(chosen.begin(), chosen.end());
  for (std::size_t k = 0; k < 4; ++k) {
    if (k == 0 || chosen[k] != chosen[k - 1]) touches.push_back(found_[chosen[k]]);
  }
  return smallest;
}

}  // namespace cotwin::collision
