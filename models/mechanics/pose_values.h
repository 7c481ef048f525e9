#pragma once
#include <string>
#include <vector>

#include "models/mechanics/pose.h"

/// Poses as values of ports.
namespace cotwin {

/// Pose from position and quaternion (w, x, y, z). Throws Error at `place` unless the quaternion has length 1.
Pose pose_of(const std::string& place, const std::vector<double>& p, const std::vector<double>& quat);
/// Pose from inputs, where the quaternion is normalised: it may have been interpolated. Throws Error at `place`.`prefix``name` for a quaternion of
/// zero. Allocates nothing otherwise.
Pose pose_of_input(const std::string& place, const std::string& prefix, const char* name, const std::vector<double>& p,
                   const std::vector<double>& quat);
/// Writes the quaternion (w, x, y, z) of R with w ≥ 0.
void put_quaternion(const Eigen::Matrix3d& R, std::vector<double>& quat);

}  // namespace cotwin
