#pragma once
#include <array>
#include <span>

#include "models/mechanics/pose.h"

namespace cotwin::rtde {

/// x y z (m) and the rotation vector (axis × angle, rad), as UR gives poses.
std::array<double, 6> to_ur_pose(const Pose& X);
/// From x y z and a rotation vector.
Pose from_ur_pose(std::span<const double> pose);

}  // namespace cotwin::rtde
