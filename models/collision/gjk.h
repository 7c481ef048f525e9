#pragma once
#include "models/collision/separation.h"

/// Searches for the best direction between two convex cores (Gilbert, Johnson, Keerthi 1988; van den Bergen 2001).
namespace cotwin::collision {

/// A better direction of separated cores, with p_b, by Bullet's GJK from anywhere; `start` if there is none. Where `start` separates the cores by
/// more than `left` (m), b is grown by a ball until that is left, so that GJK's tolerance of 1e-4 refers to what is left and not to the distance.
/// `upper`: the distance of two points of the cores that the search found, if it succeeded.
Separation approach(const Placed& a, const Placed& b, const Separation& start, double left, double& upper);

/// Ascends from `start` to the best direction, with p_b: exact for separated cores, a local optimum for interpenetrating ones.
/// Bullet's GJK measures the cores after moving them apart along `start`.
Separation climb(const Placed& a, const Placed& b, const Separation& start);

/// A direction for deep interpenetration by Bullet's EPA; returns `start` for separated cores or if EPA fails.
Separation expand(const Placed& a, const Placed& b, const Separation& start);

}  // namespace cotwin::collision
