#pragma once
#include <Eigen/Core>

#include "components/contact_world/engine/convex.h"

namespace cotwin::contact_world {

/// How far two convex sets are apart along the best direction found.
struct Separation {
  Eigen::Vector3d n = Eigen::Vector3d::UnitZ();   // unit, from a to b
  double gap = 0;                                 // m; negative: so far must b move along n to come free
  Eigen::Vector3d p_b = Eigen::Vector3d::Zero();  // on b, nearest to a (or deepest in it), where the function says so
};

/// A point as b: its distance from a core (negative inside), and the unit normal of the core's surface there.
Separation of_point(const Placed& piece, const Eigen::Vector3d& p);

/// The largest gap over the normals of faces and of pairs of edges (Gottschalk, Lin and Manocha 1996 for boxes; Gregorius 2013
/// for which pairs matter): exact if they interpenetrate, a lower bound of the distance else. Ends early with any gap above
/// `margin`.
Separation along_axes(const Placed& a, const Placed& b, double margin);

/// Distance of the segments p ± half d of unit directions d, with p_b.
Separation between_segments(const Eigen::Vector3d& p_a, const Eigen::Vector3d& d_a, double half_a, const Eigen::Vector3d& p_b,
                            const Eigen::Vector3d& d_b, double half_b);

/// The gap of the cores along a direction: a lower bound of their distance.
double gap_along(const Placed& a, const Placed& b, const Eigen::Vector3d& n);

/// The best direction among a few that suggest themselves: normals of faces and caps, across axes, from centre to centre.
Separation best_guess(const Placed& a, const Placed& b, double margin);

/// For cores with curves or lines: the best direction among those across pairs of features near `start`, vertex, edge, circle
/// and axis, each solved for exactly; tried again from there while that helps. `certain`: two points as far apart as the gap
/// are known, so that for cores apart no direction is better; as it is for `start`, and then for the result.
Separation refine(const Placed& a, const Placed& b, const Separation& start, bool& certain, Feature& scratch);

/// The best direction that a climb from `start` finds, with p_b: exact for what is apart, for what interpenetrates a local
/// optimum. Bullet's GJK measures the cores moved along `start` to where they are just apart.
Separation climb(const Placed& a, const Placed& b, const Separation& start);

/// A direction for what interpenetrates deeply, by Bullet's EPA; what is apart, or EPA gives up on, keeps `start`.
Separation expand(const Placed& a, const Placed& b, const Separation& start);

}  // namespace cotwin::contact_world
