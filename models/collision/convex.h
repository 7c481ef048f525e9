#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/hull.h"
#include "models/scene/scene.h"

/// Convex collision shapes: a core, and a surface at a constant distance from it.
namespace cotwin::collision {

enum class Core : std::uint8_t {
  kPlane,     // z = 0 of C, solid below
  kPoint,     // C's origin
  kSegment,   // on the z axis of C
  kCylinder,  // about the z axis of C
  kEllipsoid,
  kPolytope
};

/// A convex shape in its own frame C, whose origin is in its middle.
struct Convex {
  Core core = Core::kPoint;
  bool box = false;                                  // polytope with the faces of box_polytope
  bool triangle = false;                             // prism behind a triangle of a mesh
  double round = 0;                                  // distance of the surface from the core, m: sphere, capsule
  double half = 0;                                   // half length of a segment or cylinder, m
  double radius = 0;                                 // of a cylinder, m
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();  // half sizes of the core along C's axes, m
  scene::Polytope polytope;
  std::vector<std::uint8_t> covered;  // per face: 1 if another piece of the body covers all of it; empty if none is covered
  /// Of a triangle of a mesh: what is beyond a side. A side may be covered where a convex edge above it is not.
  struct Side {
    Eigen::Vector3d outwards = Eigen::Vector3d::Zero();  // across the upper edge in the plane of the top, unit
    double turn = 0;  // angle from the normal of the top to that of the neighbour's, rad; 0: the edge is flat or concave
  };
  std::vector<Side> sides;  // per face; empty for other shapes
  std::size_t top = 0;      // of their faces, the one that is the triangle
  Pose X_BC;                // in the body
};

/// Throws Error for a hull without volume.
Convex make_convex(const scene::Shape& shape);

/// The triangle of a kTriangle alone, without the solid behind it: a polytope without volume.
Convex make_flat(const scene::Shape& triangle);

/// Sets `covered` for the pieces of one body: covered faces are not part of the body's surface.
void find_covered_faces(std::span<Convex> pieces);

/// A shape at a pose relative to the origin of its pair, in world axes.
struct Placed {
  const Convex* convex = nullptr;
  Eigen::Matrix3d R;
  Eigen::Vector3d p;
};

/// A corner of a supporting feature and the edge from it to the next corner.
struct Corner {
  Eigen::Vector3d p;
  std::uint32_t vertex = 0, edge = 0;
};

/// The part of a core farthest in a direction: a point, a segment, or a polygon, counter-clockwise seen from outside.
struct Feature {
  std::vector<Corner> corners;
  Eigen::Vector3d n;  // normal of the polygon's plane, outwards
  std::uint32_t face = 0;
};

/// The core's point farthest along d.
Eigen::Vector3d support(const Placed& piece, const Eigen::Vector3d& d);

/// Finds the feature that contains the point farthest along d and faces d best. A disc becomes a polygon of kDiscCorners
/// corners, the first of them farthest along d.
void supporting_feature(const Placed& piece, const Eigen::Vector3d& d, Feature& feature);
inline constexpr int kDiscCorners = 16;

/// Returns whether d points out of a covered face that contains the part farthest along d: such a d is no contact normal. Convex
/// edges of triangles are not covered.
bool points_out_of_covered(const Placed& piece, const Eigen::Vector3d& d);

/// Half sizes of a piece's bounding box along the axes of a frame in which it is turned by R.
Eigen::Vector3d half_sizes(const Convex& convex, const Eigen::Matrix3d& R);

/// The most corners that a feature of the shape can have.
std::size_t most_corners(const Convex& convex);

}  // namespace cotwin::collision
