#include "components/io/rtde/pose.h"

#include <Eigen/Geometry>

namespace cotwin::rtde {

std::array<double, 6> to_ur_pose(const Pose& X) {
  const Eigen::AngleAxisd turn(X.R);
  const Eigen::Vector3d r = turn.axis() * turn.angle();
  return {X.p.x(), X.p.y(), X.p.z(), r.x(), r.y(), r.z()};
}

Pose from_ur_pose(std::span<const double> pose) {
  const Eigen::Vector3d r(pose[3], pose[4], pose[5]);
  const double angle = r.norm();
  Pose X;
  X.p = {pose[0], pose[1], pose[2]};
  if (angle > 0) X.R = Eigen::AngleAxisd(angle, r / angle).toRotationMatrix();
  return X;
}

}  // namespace cotwin::rtde
