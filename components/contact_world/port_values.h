#pragma once
#include <string>
#include <vector>

#include "models/mechanics/pose.h"

/// Poses and names in the unit's ports.
namespace cotwin::contact_world {

/// Pose from position and quaternion (w, x, y, z). Throws Error at `place` unless the quaternion has length 1.
Pose pose_of(const std::string& place, const std::vector<double>& p, const std::vector<double>& quat);
/// Pose from the inputs `prefix`base_p and `prefix`base_quat, where the quaternion is normalised: it may have been interpolated.
/// Throws Error for a quaternion of zero.
Pose pose_of_input(const std::string& place, const std::string& prefix, const std::vector<double>& p,
                   const std::vector<double>& quat);
/// Writes the quaternion (w, x, y, z) of R with w ≥ 0.
void put_quaternion(const Eigen::Matrix3d& R, std::vector<double>& quat);
/// Valid variable name: replaces every character other than a letter, digit, dot or underscore by an underscore.
std::string identifier(const std::string& name);

}  // namespace cotwin::contact_world
