#pragma once
#include <Eigen/Geometry>
#include <cstdint>
#include <random>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::collision {

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double real(double low, double high) { return low + (high - low) * static_cast<double>(engine_() >> 11) * 0x1p-53; }
  Eigen::Vector3d vector(double most) { return {real(-most, most), real(-most, most), real(-most, most)}; }
  Eigen::Vector3d direction() {
    Eigen::Vector3d v = vector(1);
    while (v.norm() < 0.1 || v.norm() > 1) v = vector(1);
    return v.normalized();
  }
  Pose pose(double most) {
    const Eigen::Vector3d axis = direction();
    return {Eigen::AngleAxisd(real(0, 6), axis).toRotationMatrix(), vector(most)};
  }

 private:
  std::mt19937_64 engine_;
};

inline scene::Shape shape(scene::ShapeType type, const Eigen::Vector3d& size) {
  scene::Shape s;
  s.type = type;
  s.size = size;
  return s;
}

}  // namespace cotwin::collision
