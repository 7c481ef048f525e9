#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <array>
#include <vector>

/// Values of ports as vectors and quaternions, and back. Quaternions are (w, x, y, z) at ports.
namespace cotwin::compliance {

inline Eigen::Map<const Eigen::VectorXd> map(const std::vector<double>& v) {
  return {v.data(), static_cast<Eigen::Index>(v.size())};
}
inline Eigen::Map<Eigen::VectorXd> map(std::vector<double>& v) { return {v.data(), static_cast<Eigen::Index>(v.size())}; }
inline Eigen::Vector3d vector(const std::array<double, 3>& v) { return {v[0], v[1], v[2]}; }
inline std::array<double, 3> array(const Eigen::Vector3d& v) { return {v[0], v[1], v[2]}; }
inline Eigen::Quaterniond quaternion(const std::array<double, 4>& q) { return {q[0], q[1], q[2], q[3]}; }
inline std::array<double, 4> array(const Eigen::Quaterniond& q) { return {q.w(), q.x(), q.y(), q.z()}; }

}  // namespace cotwin::compliance
