#include "models/mechanics/pose_values.h"

#include <Eigen/Geometry>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin {

using Values = std::vector<double>;

Pose pose_of(const std::string& place, const Values& p, const Values& quat) {
  const Eigen::Quaterniond Q(quat[0], quat[1], quat[2], quat[3]);
  constexpr double kRounded = 1e-3;  // 0.707 0 0 0.707, or half the vector of a small rotation beside 1
  if (!(std::abs(Q.norm() - 1) < kRounded)) {
    throw Error(place, "the quaternion (w, x, y, z) has length " + text::to_text(Q.norm()) + ", expected 1");
  }
  return {Q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
}

Pose pose_of_input(const std::string& place, const std::string& prefix, const char* name, const Values& p, const Values& quat) {
  const Eigen::Quaterniond Q(quat[0], quat[1], quat[2], quat[3]);
  if (!(Q.norm() > 0)) throw Error(place + "." + prefix + name, "the quaternion (w, x, y, z) is 0, expected length 1");
  return {Q.normalized().toRotationMatrix(), {p[0], p[1], p[2]}};
}

void put_quaternion(const Eigen::Matrix3d& R, Values& quat) {
  Eigen::Quaterniond Q(R);
  if (Q.w() < 0) Q.coeffs() = -Q.coeffs();
  quat = {Q.w(), Q.x(), Q.y(), Q.z()};
}

Eigen::Vector3d turn_between(std::span<const double, 4> from, std::span<const double, 4> to) {
  const Eigen::Quaterniond A(from[0], from[1], from[2], from[3]), B(to[0], to[1], to[2], to[3]), turn = A.conjugate() * B;
  const double sine = turn.vec().stableNorm(), angle = 2 * std::atan2(sine, std::abs(turn.w()));
  return std::copysign(sine > 0 ? angle / sine : 0, turn.w()) * turn.vec();
}

}  // namespace cotwin
