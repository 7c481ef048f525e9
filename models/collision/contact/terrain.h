#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "models/collision/contact/manifold.h"
#include "models/collision/contact/narrow_phase.h"
#include "models/collision/contact/patch.h"
#include "models/collision/separation.h"

namespace cotwin::collision {

/// The columns of solid below the triangles of a height field (Core::kHeights) that may touch a box. Together they are exactly the
/// field's solid, also beside steep places and at its border, and each is convex.
class Columns {
 public:
  /// The box from `low` to `high`, in the frame C of the field.
  Columns(const Convex& field, const Eigen::Vector3d& low, const Eigen::Vector3d& high);

  /// Goes to the next column, in the order of their numbers; false after the last.
  bool next();
  std::uint32_t number() const;                                               // of the triangle
  const scene::HeightField::Triangle& triangle() const { return triangle_; }  // in C

  /// Writes the column's polytope with X_BC in C. The bottom and the sides are covered, but not at the border
  /// of the field. `column` is one of
  /// make_column(), so that nothing is allocated.
  void write(Convex& column) const;

 private:
  const Convex& field_;
  const Eigen::Vector3d low_, high_;
  std::size_t first_column_ = 0, end_column_ = 0, end_row_ = 0;
  std::size_t column_ = 0, row_ = 0, half_ = 0;  // the next triangle
  std::size_t number_ = 0;
  double bottom_ = 0;
  scene::HeightField::Triangle triangle_;
};

Convex make_column();

/// Contacts of height fields: those of each column that is near, as of the triangles of a mesh.
class Terrain {
 public:
  /// Points of all columns under a body, of which find() leaves few, per point that a step may have.
  static constexpr std::size_t kColumns = 16;

  Terrain() : column_(make_column()) {}
  /// Allocates for faces of up to this number of corners, and for this number of points of one pair.
  void reserve(std::size_t corners, std::size_t points);

  /// What a pair of surfaces has for points: those of patch.h if one of them is a foundation.
  enum class Kind { kPoints, kPatchOnA, kPatchOnB };

  /// Replaces `touches` by the points with a gap below `margin`; a or b is the field. The points of columns in one plane are those
  /// of one face, four at most, except those of patches.
  void find(const Placed& a, const Placed& b, Kind kind, double margin, std::vector<ManifoldPoint>& touches);

 private:
  void choose_in_planes(double side, std::vector<ManifoldPoint>& touches);

  Convex column_;
  NarrowPhase narrow_phase_;
  Patch patch_;
  Manifold manifold_;
  std::vector<ManifoldPoint> of_column_, rest_, of_plane_;
};

}  // namespace cotwin::collision
