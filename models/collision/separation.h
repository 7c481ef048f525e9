#pragma once
#include <Eigen/Core>

#include "models/collision/convex.h"

namespace cotwin::collision {

/// Separation of two convex sets along the best direction found.
struct Separation {
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();   // unit, from a to b
  double gap = 0;                                 // m; negative: distance that b must move along n to separate
  Eigen::Vector3d p_b = Eigen::Vector3d::Zero();  // on b, nearest to a (or deepest in a); only where a function documents it
};

/// Separation with a point as b: its distance from a core (negative inside) and the outward unit normal there. If the distance is more than `enough`, it
/// may be a lower bound above it instead: the distance from a plane that touches the core.
Separation of_point(const Placed& piece, const Eigen::Vector3d& p, double enough = scene::kInfinity);

/// The largest gap over the normals of faces and of pairs of edges (Gottschalk, Lin and Manocha 1996 for boxes; Gregorius 2013
/// for the relevant pairs). Exact for interpenetrating polytopes, otherwise a lower bound of the distance. Returns at the first
/// gap above `margin`.
Separation along_axes(const Placed& a, const Placed& b, double margin);

/// Distance of the segments p ± half d of unit directions d, with p_b. Where they cross, n is d_a × d_b, but of nearly parallel ones rounding.
Separation between_segments(const Eigen::Vector3d& p_a, const Eigen::Vector3d& d_a, double half_a, const Eigen::Vector3d& p_b,
                            const Eigen::Vector3d& d_b, double half_b);

/// Gap of the cores along a direction: a lower bound of their distance.
double gap_along(const Placed& a, const Placed& b, const Eigen::Vector3d& n);

/// The best of a few candidate directions: normals of faces and caps, across axes, from centre to centre.
Separation best_guess(const Placed& a, const Placed& b, double margin);

/// For cores with curves or lines: the best common normal of pairs of features near `start` (vertex, edge, circle, axis), each
/// solved exactly; repeated from the result while it improves. `certain`: two points at the distance of the gap are known, so
/// that no direction is better for separated cores. On entry it describes `start`, on return the result.
Separation refine(const Placed& a, const Placed& b, const Separation& start, bool& certain, Feature& scratch);

}  // namespace cotwin::collision
