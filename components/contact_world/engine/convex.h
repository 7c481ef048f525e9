#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/hull.h"
#include "models/scene/scene.h"

/// Convex pieces as collision sees them: a core, and a surface at a constant distance around it.
namespace cotwin::contact_world {

enum class Core : std::uint8_t {
  kPlane,     // z = 0 of C, solid below
  kPoint,     // C's origin
  kSegment,   // on C's z
  kCylinder,  // about C's z
  kPolytope
};

/// A shape in its own frame C, whose origin is in the middle of it.
struct Convex {
  Core core = Core::kPoint;
  bool box = false;                                  // a polytope with the faces of box_polytope
  double round = 0;                                  // the surface is so far outside of the core, m: sphere, capsule
  double half = 0;                                   // half length of a segment or cylinder, m
  double radius = 0;                                 // of a cylinder, m
  Eigen::Vector3d extent = Eigen::Vector3d::Zero();  // half sizes of the core along C's axes, m
  scene::Polytope polytope;
  std::vector<std::uint8_t> covered;  // of each face: whether another piece of the body lies on all of it; empty if on none
  Pose X_BC;                          // in the body
};

/// Throws Error for a hull without volume.
Convex make_convex(const scene::Shape& shape);

/// Fills in `covered` of the pieces of one body: no surface is where two of them touch.
void find_covered_faces(std::span<Convex> pieces);

/// A piece somewhere: the pair's own origin, the world's axes.
struct Placed {
  const Convex* convex = nullptr;
  Eigen::Matrix3d R;
  Eigen::Vector3d p;
};

/// A corner of a supporting feature, and the edge that goes from it to the next.
struct Corner {
  Eigen::Vector3d p;
  std::uint32_t vertex = 0, edge = 0;
};

/// What of a core lies farthest in some direction: a point, a segment, or a polygon, counter-clockwise seen from outside.
struct Feature {
  std::vector<Corner> corners;
  Eigen::Vector3d n;  // of the polygon's plane, outwards
  std::uint32_t face = 0;
};

/// The core's point farthest along d.
Eigen::Vector3d support(const Placed& piece, const Eigen::Vector3d& d);

/// The feature that faces d best and holds the point farthest along it. A disc is a polygon of kDiscCorners corners, the first
/// of them farthest along d.
void supporting_feature(const Placed& piece, const Eigen::Vector3d& d, Feature& feature);
inline constexpr int kDiscCorners = 16;

/// Whether what lies farthest along d belongs to a covered face that d leans out of: no contact can have this direction.
bool leans_into_covered(const Placed& piece, const Eigen::Vector3d& d);

}  // namespace cotwin::contact_world
