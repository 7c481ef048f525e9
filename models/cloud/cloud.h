#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"

/// Points on surfaces, as scanners measure them.
namespace cotwin::cloud {

/// Points about an origin in single precision, m, so that far from the origin of their frame they keep their accuracy. No two are equal.
struct Cloud {
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> points;

  static auto fields(auto& c, auto each) { return each(c.origin, c.points); }
  Eigen::Vector3d point(std::size_t k) const { return origin + points[k].cast<double>(); }
};

/// A cloud of finite points, m, of equal ones the first. Its origin is 0 or, where they are farther from 0 than 16 times what they extend, whole metres
/// in their middle: so what was in single precision and not so far stays as it was.
Cloud make_cloud(std::span<const Eigen::Vector3d> points);

/// The points of a cloud in another frame, W. X_WC: of the cloud's frame.
Cloud moved(const Cloud& cloud, const Pose& X_WC);

/// One point, the mean, for each cube of this size, m, that has points.
Cloud thinned(const Cloud& cloud, double size);

}  // namespace cotwin::cloud
