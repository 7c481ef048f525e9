#pragma once
#include <Eigen/Core>

#include "models/collision/separation.h"

/// How near two convex shapes are.
namespace cotwin::collision {

/// The nearest points of a and b; of those that overlap, the shortest translation that separates them.
struct Distance {
  double d = scene::kInfinity;                   // m; negative: they overlap, and moving b by -d n separates them
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();  // unit
  Eigen::Vector3d p_a = Eigen::Vector3d::Zero(), p_b = Eigen::Vector3d::Zero();  // p_b = p_a + d n
  bool on_surfaces = true;  // p_a and p_b are; not of what overlaps with the solid behind a closed mesh
};

/// The signed distance of two shapes, in the frame of their poses. Separated ones: spheres, capsules and boxes to rounding, others to 1e-9 of their size
/// (slender hulls to 1e-7). Points are on the surfaces to 1e-9 of the size, of 1000 pairs one only to 2e-8, and to 1e-6 if cylinders or ellipsoids overlap. Depths of
/// spheres, of capsules, and of polytopes with fewer than 4000 pairs of edges, are the least; others are the least that is found from 100 directions: of
/// 1000 pairs one may be too deep, by less than 1 %. Finite, but of two planes infinity. `scratch` has room for the corners of a face.
/// Allocates nothing.
/// If the distance is more than `most`, the result may be a lower bound above it instead, with points that are not the nearest.
Distance distance(const Placed& a, const Placed& b, Feature& scratch, double most = scene::kInfinity);

/// Of two cores of which the first one is no later kind (Core) than the second: their separation where it has a closed form, with p_b: of a plane, a
/// point (a sphere), two segments (capsules). False for others and for two planes.
bool closed_form(const Placed& a, const Placed& b, Separation& s);

/// Whether two polytopes have so few pairs of edges that along_axes() is worth its time: it is exact where they overlap.
bool few_edges(const Placed& a, const Placed& b);

}  // namespace cotwin::collision
