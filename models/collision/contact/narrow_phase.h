#pragma once
#include <Eigen/Core>
#include <vector>

#include "models/collision/contact/manifold.h"
#include "models/collision/nearest.h"

namespace cotwin::collision {

/// Contact points of two placed shapes.
class NarrowPhase {
 public:
  void reserve(std::size_t corners);

  /// Replaces `touches` by the points with a gap below `margin`; returns the pair's normal from a to b.
  Eigen::Vector3d find(const Placed& a, const Placed& b, double margin, std::vector<ManifoldPoint>& touches);

 private:
  Eigen::Vector3d find_ordered(const Placed& a, const Placed& b, double margin, std::vector<ManifoldPoint>& touches);
  Eigen::Vector3d find_on_uncovered(const Placed& a, const Placed& b, double margin, double least,
                                    std::vector<ManifoldPoint>& touches);
  Separation improve(const Placed& a, const Placed& b, const Separation& start, bool& certain);
  bool add_points(const Placed& a, const Placed& b, const Separation& s, double margin, std::vector<ManifoldPoint>& touches);

  Manifold manifold_;
  Feature scratch_;
};

}  // namespace cotwin::collision
