#pragma once
#include "models/collision/separation.h"

/// Searches for the best direction between two convex cores (Gilbert, Johnson, Keerthi 1988; van den Bergen 2001).
namespace cotwin::collision {

/// Of both cores, to which tolerances are relative, m.
inline double size_of(const Placed& a, const Placed& b) { return a.convex->extent.norm() + b.convex->extent.norm(); }

/// The direction of the largest gap of separated cores, with p_b, begun with n (unit): Gilbert, Johnson and Keerthi's search, which ends where the duality
/// gap between the least distance of two known points, `upper`, and the gap is rounding, or where the gap is more than `enough`. upper = 0: they overlap or touch.
Separation gjk(const Placed& a, const Placed& b, const Eigen::Vector3d& n, double enough, double& upper);

/// Ascends from `start` to the best direction, with p_b: exact for separated cores, a local optimum for interpenetrating ones.
/// gjk() measures the cores after moving them apart along `start`.
Separation climb(const Placed& a, const Placed& b, const Separation& start);

/// The best direction that the expanding polytope algorithm (van den Bergen 2001) sees for deep interpenetration; `start` if none is better, and for
/// separated cores.
Separation expand(const Placed& a, const Placed& b, const Separation& start);

}  // namespace cotwin::collision
