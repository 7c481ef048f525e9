#pragma once
#include <btBulletDynamicsCommon.h>

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "tests/benchmarks/contact/engine.h"

namespace cotwin::benchmark {

btVector3 to_bullet(const Eigen::Vector3d& v);
btTransform to_bullet(const Pose& X);
Eigen::Vector3d from_bullet(const btVector3& v);
Pose from_bullet(const btTransform& X);

/// The collision shapes of bodies, with margins of 1 mm (hulls: 0).
class BulletShapes {
 public:
  /// The body's first shape at X_PS in the frame P of its principal axes; an empty shape if it has none.
  btCollisionShape* make(const scene::Body& body, const Principal& frame);

 private:
  btEmptyShape nothing_;
  std::vector<std::unique_ptr<btCollisionShape>> shapes_;
};

}  // namespace cotwin::benchmark
