#include "models/collision/contact/terrain.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

namespace cotwin::collision {

namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;

/// Cells from that of `low` to that of `high` along one axis: `first` and one past the last.
void find_cells(double low, double high, double half, double cell, std::size_t count, std::size_t& first, std::size_t& end) {
  const auto last = static_cast<double>(count - 1);
  const double from = std::floor((low + half) / cell), to = std::floor((high + half) / cell);
  first = end = 0;
  if (!(to >= 0 && from <= last)) return;
  first = static_cast<std::size_t>(std::max(from, 0.0));
  end = static_cast<std::size_t>(std::min(to, last)) + 1;
}

Vector3d upward_normal(const std::array<Vector3d, 3>& corners) {
  return (corners[1] - corners[0]).cross(corners[2] - corners[0]);
}

/// The id of a point with the feature of the column (of a: in the upper half) among those of all columns.
std::uint64_t with_number(std::uint64_t id, std::uint32_t number, bool of_a) {
  constexpr std::uint64_t kFeatures = 16;  // more than a column has of one kind
  constexpr std::uint64_t kKind = std::uint64_t{3} << 30;
  const int shift = of_a ? 32 : 0;
  const std::uint64_t part = id >> shift & 0xFFFFFFFF, other = id & ~(std::uint64_t{0xFFFFFFFF} << shift);
  const std::uint64_t feature = (part & ~kKind) % kFeatures;
  return other | ((part & kKind) | (number * kFeatures + feature)) << shift;
}

}  // namespace

Columns::Columns(const Convex& field, const Vector3d& low, const Vector3d& high) : field_(field), low_(low), high_(high) {
  const scene::HeightField& heights = *field.heights;
  std::size_t first_row = 0;
  find_cells(low.x(), high.x(), field.extent.x(), heights.dx(), heights.columns(), first_column_, end_column_);
  find_cells(low.y(), high.y(), field.extent.y(), heights.dy(), heights.rows(), first_row, end_row_);
  column_ = first_column_;
  row_ = first_column_ < end_column_ ? first_row : end_row_;
}

bool Columns::next() {
  const scene::HeightField& field = *field_.heights;
  const double black = field_.extent.z() - field.high();  // height of black in C
  for (; row_ < end_row_; ++row_, column_ = first_column_) {
    while (column_ < end_column_) {
      const std::size_t i = column_;
      if (half_ == 0) {
        bottom_ = field.bottom(i, row_) + black;
        if (field.high_of_tile(i, row_) + black < low_.z() || bottom_ > high_.z()) {
          column_ = (i / field.tile_cells() + 1) * field.tile_cells();
          continue;
        }
      }
      number_ = 2 * (row_ * field.columns() + i) + half_;
      triangle_ = field.triangle(number_);
      for (Vector3d& corner : triangle_.corners) corner.z() += black;
      for (Vector3d& corner : triangle_.beyond) corner.z() += black;
      column_ += half_;
      half_ = 1 - half_;
      const auto& c = triangle_.corners;
      if (std::max({c[0].z(), c[1].z(), c[2].z()}) >= low_.z()) return true;
    }
  }
  return false;
}

std::uint32_t Columns::number() const { return static_cast<std::uint32_t>(number_); }

Convex make_column() {
  Convex column;
  column.core = Core::kPolytope;
  column.triangle = true;
  scene::Polytope& p = column.polytope;
  p.vertices.resize(6);  // of the triangle, then those below them
  p.faces.resize(5);     // top, bottom, and the side below each edge of the triangle
  p.corners = {0, 1, 2, 3, 5, 4};
  p.corner_edges = {0, 1, 2, 5, 4, 3};
  p.edges.resize(9);  // of the top, of the bottom, and below each corner
  p.faces[0].count = p.faces[1].count = 3;
  p.faces[1].begin = 3;
  for (std::uint32_t k = 0; k < 3; ++k) {
    const std::uint32_t next = (k + 1) % 3, before = (k + 2) % 3;
    p.faces[2 + k].begin = 6 + 4 * k;
    p.faces[2 + k].count = 4;
    p.corners.insert(p.corners.end(), {next, k, 3 + k, 3 + next});
    p.corner_edges.insert(p.corner_edges.end(), {k, 6 + k, 3 + k, 6 + next});
    p.edges[k] = {{k, next}, {0, 2 + k}};
    p.edges[3 + k] = {{3 + k, 3 + next}, {1, 2 + k}};
    p.edges[6 + k] = {{k, 3 + k}, {2 + k, 2 + before}};
  }
  column.covered.assign(5, 1);
  column.covered[0] = 0;
  column.sides.resize(5);
  column.sides[1].outwards = -Vector3d::UnitZ();
  return column;
}

void Columns::write(Convex& column) const {
  const auto& c = triangle_.corners;
  Vector3d low = c[0].cwiseMin(c[1]).cwiseMin(c[2]), high = c[0].cwiseMax(c[1]).cwiseMax(c[2]);
  low.z() = bottom_;
  const Vector3d middle = (low + high) / 2;
  column.extent = (high - low) / 2;
  column.X_BC = {Matrix3d::Identity(), middle};
  scene::Polytope& p = column.polytope;
  for (std::size_t k = 0; k < 3; ++k) {
    p.vertices[k] = c[k] - middle;
    p.vertices[3 + k] = {p.vertices[k].x(), p.vertices[k].y(), -column.extent.z()};
  }
  const Vector3d n = upward_normal(c).normalized();
  const auto set = [&](std::size_t face, const Vector3d& normal, const Vector3d& on) {
    p.faces[face].n = normal;
    p.faces[face].d = normal.dot(on);
  };
  set(0, n, p.vertices[0]);
  set(1, -Vector3d::UnitZ(), p.vertices[3]);
  for (std::size_t k = 0; k < 3; ++k) {
    const Vector3d& to = c[(k + 1) % 3];
    const Vector3d along = to - c[k];
    set(2 + k, Vector3d(along.y(), -along.x(), 0).normalized(), p.vertices[k]);
    const Vector3d outwards = along.cross(n).normalized();
    const Vector3d m = (-along).cross(triangle_.beyond[k] - to);  // of the neighbour
    column.covered[2 + k] = !triangle_.border[k];
    column.sides[2 + k] = {outwards, triangle_.border[k] ? 0 : std::max(0.0, std::atan2(m.dot(outwards), m.dot(n)))};
  }
}

void Terrain::reserve(std::size_t corners, std::size_t points) {
  corners = std::max<std::size_t>(corners, 4);
  narrow_phase_.reserve(corners);
  patch_.reserve(corners);
  manifold_.reserve(std::max(corners, points / 3 + 1));
  of_column_.reserve(8);
  rest_.reserve(points);
  of_plane_.reserve(points);
}

void Terrain::find(const Placed& a, const Placed& b, Kind kind, double margin, std::vector<ManifoldPoint>& touches) {
  touches.clear();
  const bool of_a = a.convex->core == Core::kHeights;
  const Placed &field = of_a ? a : b, &piece = of_a ? b : a;
  const Matrix3d R_CF = field.R.transpose();
  const Placed seen{piece.convex, R_CF * piece.R, R_CF * (piece.p - field.p)};  // in C
  const Vector3d reach = half_sizes(*piece.convex, seen.R).array() + margin;
  for (Columns columns(*field.convex, seen.p - reach, seen.p + reach); columns.next();) {
    const Vector3d up = upward_normal(columns.triangle().corners);
    const double above = up.dot(support(seen, -up) - columns.triangle().corners[0]);
    if (above > (margin + piece.convex->round) * up.norm()) continue;
    columns.write(column_);
    const Placed column{&column_, field.R, field.p + field.R * column_.X_BC.p};
    const Placed &first = of_a ? column : piece, &second = of_a ? piece : column;
    const Vector3d n = narrow_phase_.find(first, second, margin, of_column_);
    if (kind != Kind::kPoints && !of_column_.empty())
      patch_.find(first, second, kind == Kind::kPatchOnB, n, margin, of_column_);
    for (ManifoldPoint& touch : of_column_) {
      touch.id = with_number(touch.id, columns.number(), of_a);
      touches.push_back(touch);
    }
  }
  if (kind == Kind::kPoints) choose_in_planes(of_a ? -1 : 1, touches);
}

/// `side`: -1 if the field is a, otherwise 1.
void Terrain::choose_in_planes(double side, std::vector<ManifoldPoint>& touches) {
  constexpr std::size_t kOfFace = 4;
  if (touches.size() <= kOfFace) return;
  constexpr double kParallel = 1e-12, kSame = 1e-8;  // 1 − cosine; m
  const auto height = [&](const ManifoldPoint& t, const Vector3d& n) {
    return n.dot(t.p) + side * t.gap / 2;
  };  // of the ground
  rest_.swap(touches);
  touches.clear();
  while (!rest_.empty()) {
    const ManifoldPoint first = rest_.front();
    of_plane_.clear();
    std::size_t left = 0;
    for (const ManifoldPoint& t : rest_) {
      const bool same = first.n.dot(t.n) >= 1 - kParallel && std::abs(height(t, first.n) - height(first, first.n)) <= kSame;
      if (same) {
        of_plane_.push_back(t);
      } else {
        rest_[left++] = t;
      }
    }
    rest_.resize(left);
    if (of_plane_.size() > kOfFace) manifold_.choose_of(first.n, of_plane_);
    touches.insert(touches.end(), of_plane_.begin(), of_plane_.end());
  }
}

}  // namespace cotwin::collision
