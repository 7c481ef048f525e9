#pragma once
#include <span>
#include <string>
#include <vector>

#include "models/mechanics/pose.h"

/// Poses as values of ports.
namespace cotwin {

/// Pose from position and quaternion (w, x, y, z). Throws Error at `place` unless the quaternion has length 1 to
/// a thousandth; it is normalised.
Pose pose_of(const std::string& place, const std::vector<double>& p, const std::vector<double>& quat);
/// Pose from inputs, where the quaternion is normalised: it may have been interpolated. Throws Error at `place`.`prefix``name` for a quaternion of
/// zero. Allocates nothing otherwise.
Pose pose_of_input(const std::string& place, const std::string& prefix, const char* name, const std::vector<double>& p,
                   const std::vector<double>& quat);
/// Writes the quaternion (w, x, y, z) of R with w ≥ 0.
void put_quaternion(const Eigen::Matrix3d& R, std::vector<double>& quat);
/// The rotation vector (rad, up to π long) that turns the axes of quaternion `from` into those of `to`, in the axes of `from`. Lengths do not count.
Eigen::Vector3d turn_between(std::span<const double, 4> from, std::span<const double, 4> to);

}  // namespace cotwin
