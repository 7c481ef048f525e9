#include "models/collision/contact/patch.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>

namespace cotwin::collision {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::Vector2d;
using Eigen::Vector3d;

constexpr int kDiscSides = 32, kStrips = 16;

/// Faces steeper than this (cosine) have almost no area along the normal.
constexpr double kSteep = 0.02;

/// m: rounding of depths.
constexpr double kNoise = 1e-9;

/// m²: smaller regions carry nothing.
constexpr double kLeastArea = 1e-12;

/// Two faces are alike well aligned below this difference of the cosines.
constexpr double kAlike = 1e-4;

bool has_faces(const Placed& piece, const Vector3d& d) {
  const Core core = piece.convex->core;
  return core == Core::kPlane || core == Core::kPolytope ||
         (core == Core::kCylinder && std::abs(piece.R.col(2).dot(d)) > std::sqrt(0.5));
}

/// Cosine between d and the face of the piece that faces d best; −1 for shapes without one.
double alignment(const Placed& piece, const Vector3d& d) {
  if (!has_faces(piece, d)) return -1;
  if (piece.convex->core == Core::kPlane) return piece.R.col(2).dot(d);
  if (piece.convex->core == Core::kCylinder) return std::abs(piece.R.col(2).dot(d));
  double best = -1;
  const Vector3d d_C = piece.R.transpose() * d;
  for (const scene::Polytope::Face& face : piece.convex->polytope.faces) best = std::max(best, face.n.dot(d_C));
  return best;
}

/// Radius of the regular polygon with the area of a circle, for sides that span 2 · `half` rad.
double of_equal_area(double radius, double half) { return radius * std::sqrt(2 * half / std::sin(2 * half)); }

/// Corners of the disc's polygon, of the area of the unit circle, counter-clockwise.
const std::array<Vector2d, kDiscSides>& disc() {
  static const auto corners = [] {
    std::array<Vector2d, kDiscSides> points;
    const double radius = of_equal_area(1, M_PI / kDiscSides);
    for (int k = 0; k < kDiscSides; ++k) {
      const double angle = 2 * M_PI * k / kDiscSides;
      points[static_cast<std::size_t>(k)] = radius * Vector2d(std::cos(angle), std::sin(angle));
    }
    return points;
  }();
  return corners;
}

}  // namespace

void Patch::reserve(std::size_t corners) {
  corners = std::max<std::size_t>(corners, kDiscSides);
  feature_.corners.reserve(corners);
  outline_.reserve(corners);
  corners_.reserve(3 * corners);
  kept_.reserve(3 * corners);
}

/// Takes the face of the base that faces n_, or the plane across n_ through its farthest point.
void Patch::set_base(const Placed& base) {
  outline_.clear();
  slope_.setZero();
  const Core core = base.convex->core;
  const auto tilt = [&](const Vector3d& normal, const Vector3d& p) {
    slope_ = -Vector2d(normal.dot(t1_), normal.dot(t2_)) / normal.dot(n_);
    height_ = n_.dot(p) - slope_.dot(across(p));
  };
  const auto bound = [&](const auto& corner, std::size_t count) {
    for (std::size_t k = 0; k < count; ++k) {
      const Vector2d u = across(corner(k)), along = across(corner((k + 1) % count)) - u;
      const double length = along.norm();
      if (length > 0) outline_.push_back({u, Vector2d(-along.y(), along.x()) / length});
    }
  };
  if (core == Core::kPlane) {
    tilt(base.R.col(2), base.p);
    return;
  }
  if (has_faces(base, n_) && core == Core::kCylinder) {
    const double side = base.R.col(2).dot(n_) < 0 ? -1 : 1;
    const Vector3d centre = base.p + side * base.convex->half * base.R.col(2);
    tilt(base.R.col(2), centre);
    const Vector3d x = base.convex->radius * base.R.col(0), y = side * base.convex->radius * base.R.col(1);
    bound([&](std::size_t k) { return Vector3d(centre + disc()[k].x() * x + disc()[k].y() * y); }, kDiscSides);
    return;
  }
  supporting_feature(base, n_, feature_);
  if (core == Core::kPolytope && feature_.corners.size() > 2) {
    tilt(feature_.n, feature_.corners[0].p);
    bound([&](std::size_t k) { return feature_.corners[k].p; }, feature_.corners.size());
    return;
  }
  height_ = n_.dot(support(base, n_)) + base.convex->round;
}

void Patch::add_corner(const Vector3d& p) {
  const Vector2d u = across(p);
  corners_.push_back({u, base_at(u) - n_.dot(p)});
}

/// Adds the part of the polygon corners_ that lies within the base's outline and deeper than `level`.
void Patch::add_polygon(double level) {
  const auto clip = [&](const auto& height) {
    kept_.clear();
    for (std::size_t k = 0; k < corners_.size(); ++k) {
      const Point &p = corners_[k], &next = corners_[(k + 1) % corners_.size()];
      const double h = height(p), h_next = height(next);
      if (h >= 0) kept_.push_back(p);
      if ((h >= 0) == (h_next >= 0)) continue;
      const double part = h / (h - h_next);
      kept_.push_back({p.u + part * (next.u - p.u), p.depth + part * (next.depth - p.depth)});
    }
    std::swap(corners_, kept_);
  };
  clip([&](const Point& p) { return p.depth - level; });
  for (const Border& border : outline_) {
    if (corners_.size() < 3) break;
    clip([&](const Point& p) { return border.inward.dot(p.u - border.u); });
  }
  if (corners_.size() < 3) return;
  for (const Point& p : corners_) {
    if (p.depth > sums_.deepest.depth) sums_.deepest = p;
  }
  // Products of linear functions over a triangle: area / 12 (Σf Σg + Σ f g).
  const Point& o = corners_[0];
  for (std::size_t k = 1; k + 1 < corners_.size(); ++k) {
    const Point &p = corners_[k], &q = corners_[k + 1];
    const Vector2d e = p.u - o.u, f = q.u - o.u;
    const double area = std::abs(e.x() * f.y() - e.y() * f.x()) / 2;
    const Vector2d u = o.u + p.u + q.u;
    const double depth = o.depth + p.depth + q.depth;
    sums_.area += area;
    sums_.first += area / 3 * u;
    sums_.volume += area / 3 * depth;
    sums_.second += area / 12 * (u * u.transpose() + o.u * o.u.transpose() + p.u * p.u.transpose() + q.u * q.u.transpose());
    sums_.load += area / 12 * (depth * u + o.depth * o.u + p.depth * p.u + q.depth * q.u);
    sums_.square += area / 12 * (depth * depth + o.depth * o.depth + p.depth * p.depth + q.depth * q.depth);
  }
}

void Patch::add_polytope(const Placed& piece, double level) {
  const Convex& c = *piece.convex;
  const Vector3d n_C = piece.R.transpose() * n_;
  for (std::size_t f = 0; f < c.polytope.faces.size(); ++f) {
    const scene::Polytope::Face& face = c.polytope.faces[f];
    if (face.n.dot(n_C) > -kSteep || (!c.covered.empty() && c.covered[f] != 0)) continue;
    corners_.clear();
    for (std::uint32_t k = face.begin; k < face.begin + face.count; ++k)
      add_corner(piece.p + piece.R * c.polytope.vertices[c.polytope.corners[k]]);
    add_polygon(level);
  }
}

/// The end of a cylinder that faces the base.
void Patch::add_disc(const Placed& piece, double level) {
  const Vector3d axis = piece.R.col(2);
  if (std::abs(axis.dot(n_)) <= kSteep) return;
  const Vector3d centre = piece.p - (axis.dot(n_) > 0 ? 1 : -1) * piece.convex->half * axis;
  const Vector3d x = piece.convex->radius * piece.R.col(0), y = piece.convex->radius * piece.R.col(1);
  corners_.clear();
  for (const Vector2d& u : disc()) add_corner(centre + u.x() * x + u.y() * y);
  add_polygon(level);
}

/// The side of a cylinder or capsule, as strips over the angle that is deeper than `level`.
void Patch::add_side(const Placed& piece, double radius, double level) {
  const Vector3d axis = piece.R.col(2);
  const Vector3d radial = -n_ + axis.dot(n_) * axis;
  const double length = radial.norm();
  if (length <= kSteep) return;
  const Vector3d down = radial / length, aside = axis.cross(down);
  double depth = kNoise;
  for (const double end : {-1.0, 1.0}) {
    const Vector3d lowest = piece.p + end * piece.convex->half * axis + radius * down;
    depth = std::max(depth, base_at(across(lowest)) - n_.dot(lowest) - level);
  }
  constexpr double kWidest = 0.17;  // cosine
  const double most = std::acos(std::clamp(1 - depth / (radius * length), kWidest, 1.0)), half = most / kStrips;
  const double outer = of_equal_area(radius, half);
  const auto line = [&](int k) {
    const double angle = most * (2.0 * k / kStrips - 1);
    return Vector3d(outer * (std::cos(angle) * down + std::sin(angle) * aside));
  };
  const Vector3d along = piece.convex->half * axis;
  for (int k = 0; k < kStrips; ++k) {
    corners_.clear();
    add_corner(piece.p - along + line(k));
    add_corner(piece.p + along + line(k));
    add_corner(piece.p + along + line(k + 1));
    add_corner(piece.p - along + line(k + 1));
    add_polygon(level);
  }
}

/// A share of an ellipsoid, which a linear map makes of the unit ball: with the depth x in units of the distance h from its
/// centre to the parallel tangent plane, V = abc π x² (1 − x/3), A = dV/dδ, and ∫ d² dA = abc h 2π (x⁴/4 + (1 − x) x³/3).
void Patch::add_ellipsoid(const Vector3d& centre, const Vector3d& extent, const Matrix3d& R, double share) {
  const Vector3d scaled = extent.cwiseProduct(R.transpose() * n_);
  const double h = scaled.norm();
  const Vector3d lowest = centre - R * extent.cwiseProduct(scaled) / h;
  const double depth = base_at(across(lowest)) - n_.dot(lowest);
  if (!(depth > 0)) return;
  const double x = std::min(depth / h, 1.0), all = share * extent.prod();
  const Vector3d middle = lowest + x * (centre - lowest);
  const Vector2d u = across(middle);
  const double of_cap =
      1 - 3 * (2 - x) * (2 - x) / (4 * (3 - x));  // its centroid, on the line from the lowest point to the centre
  const double area = all / h * M_PI * x * (2 - x), volume = all * M_PI * x * x * (1 - x / 3);
  // Second moments of the unit disc of radius² x (2 − x), mapped: R diag(extent) (U − s sᵀ) diag(extent) Rᵀ.
  const Vector3d s = scaled / h;
  const Matrix3d map = R * extent.asDiagonal();
  const Matrix3d square = x * (2 - x) / 4 * (map * map.transpose() - (map * s) * (map * s).transpose());
  Eigen::Matrix<double, 2, 3> flat;
  flat << t1_.transpose(), t2_.transpose();
  sums_.area += area;
  sums_.volume += volume;
  sums_.square += all * h * 2 * M_PI * (x * x * x * x / 4 + (1 - x) * x * x * x / 3);
  sums_.first += area * u;
  sums_.load += volume * across(lowest + of_cap * (centre - lowest));
  sums_.second += area * (u * u.transpose() + Matrix2d(flat * square * flat.transpose()));
  if (depth > sums_.deepest.depth) sums_.deepest = {u, depth};
}

void Patch::add_piece(const Placed& base, const Placed& piece, double level) {
  const Convex& c = *piece.convex;
  switch (c.core) {
    case Core::kPlane:
      return;
    case Core::kPoint: {
      const double other = base.convex->core == Core::kPoint ? base.convex->round : 0;
      const double radius = other > 0 ? c.round * other / (c.round + other) : c.round;
      const Vector3d centre = piece.p + (radius - c.round) * n_;
      return add_ellipsoid(centre, Vector3d::Constant(radius), Matrix3d::Identity(), 1);
    }
    case Core::kEllipsoid:
      return add_ellipsoid(piece.p, c.extent, piece.R, 1);
    case Core::kSegment:
      add_side(piece, c.round, level);
      for (const double end : {-1.0, 1.0}) {
        const Vector3d centre = piece.p + end * c.half * piece.R.col(2);
        const double share = (1 - end * piece.R.col(2).dot(n_)) / 2;
        add_ellipsoid(centre, Vector3d::Constant(c.round), Matrix3d::Identity(), share);
      }
      return;
    case Core::kCylinder:
      add_disc(piece, level);
      return add_side(piece, c.radius, level);
    case Core::kPolytope:
      return add_polytope(piece, level);
  }
}

void Patch::emit(bool swapped, bool round, const Vector2d* line, std::vector<ManifoldPoint>& touches) const {
  const double A = sums_.area, mean = sums_.volume / A;
  const Vector2d c = round ? Vector2d(sums_.load / sums_.volume) : Vector2d(sums_.first / A);
  Matrix2d S = sums_.second / A - c * c.transpose();
  const Vector2d product = sums_.load / A - mean * c;
  Vector2d slope = Vector2d::Zero(), e1 = Vector2d::Zero(), e2 = Vector2d::Zero();
  int count = 1;
  if (line != nullptr) {
    const double along = std::max(0.0, line->dot(S * *line));
    if (along > 0) slope = *line * line->dot(product) / along;
    e1 = std::sqrt(along) * *line;
    count = 2;
  } else if (!round) {
    const double ridge = 1e-12 * S.trace();
    S(0, 0) += ridge;
    S(1, 1) += ridge;
    const double determinant = S(0, 0) * S(1, 1) - S(0, 1) * S(0, 1);
    if (determinant > 0 && S(0, 0) > 0) {
      slope = Vector2d(S(1, 1) * product[0] - S(0, 1) * product[1], S(0, 0) * product[1] - S(0, 1) * product[0]) / determinant;
      e1 = Vector2d(S(0, 0), S(0, 1)) / std::sqrt(S(0, 0));  // Cholesky's factor: S = e1 e1ᵀ + e2 e2ᵀ
      e2 = Vector2d(0, std::sqrt(determinant / S(0, 0)));
      count = 4;
    }
  }
  double bulge = sums_.deepest.depth + slope.dot(c - sums_.deepest.u) - mean;
  if (!(bulge > 1e-6 * std::abs(mean) + kNoise)) bulge = 0;
  double linear = 0;
  touches.clear();
  for (int k = 0; k < count; ++k) {
    const Vector2d step = (k % 2 == 0 ? 1 : -1) * e1 + (k < 2 ? 1 : -1) * e2;
    const Vector2d u = c + step;
    ManifoldPoint touch;
    touch.load = mean + slope.dot(step);
    const double depth = touch.load + bulge;
    const Vector2d place = u + origin_;
    touch.p = place.x() * t1_ + place.y() * t2_ + (base_at(u) - depth / 2) * n_;
    touch.n = swapped ? Vector3d(-n_) : n_;
    touch.gap = -depth;
    touch.id = feature_pair_id(FeatureKind::kFace, static_cast<std::uint32_t>(k), FeatureKind::kFace, 0);
    touch.area = A / count;
    touch.share = 1.0 / count;
    linear += touch.area * touch.load * touch.load;
    touches.push_back(touch);
  }
  const double spread = linear > 0 ? std::max(1.0, sums_.square / linear) : 1;
  for (ManifoldPoint& touch : touches) touch.spread = spread;
}

void Patch::find(const Placed& a, const Placed& b, bool prefer_b, const Vector3d& n, double margin,
                 std::vector<ManifoldPoint>& touches) {
  double gap = touches[0].gap;
  for (const ManifoldPoint& touch : touches) gap = std::min(gap, touch.gap);
  const double of_a = alignment(a, n), of_b = alignment(b, -n);
  const bool swapped = prefer_b ? of_b > of_a - kAlike : of_b > of_a + kAlike;
  const Placed &base = swapped ? b : a, &piece = swapped ? a : b;
  n_ = swapped ? Vector3d(-n) : n;
  Eigen::Index least = 0;
  (base.R.transpose() * n_).cwiseAbs().minCoeff(&least);
  t1_ = n_.cross(Vector3d(base.R.col(least))).normalized();
  t2_ = n_.cross(t1_);
  origin_ = Vector2d(t1_.dot(touches[0].p), t2_.dot(touches[0].p));
  set_base(base);
  const double level = gap > 0 ? -gap - margin : -kNoise;
  sums_ = {};
  add_piece(base, piece, level);
  const Core core = piece.convex->core;
  const bool round = core == Core::kPoint || core == Core::kEllipsoid;
  const bool lies = (core == Core::kCylinder || core == Core::kSegment) && std::abs(piece.R.col(2).dot(n_)) <= kSteep;
  const Vector2d line = lies ? Vector2d(t1_.dot(piece.R.col(2)), t2_.dot(piece.R.col(2))).normalized() : Vector2d::Zero();
  if (sums_.area > kLeastArea) {
    emit(swapped, round, lies ? &line : nullptr, touches);
  } else {
    for (ManifoldPoint& touch : touches) touch.share = 1.0 / static_cast<double>(touches.size());
  }
}

}  // namespace cotwin::collision
