#include "tests/benchmarks/contact/bullet_shapes.h"

namespace cotwin::benchmark {
namespace {

constexpr double kMargin = 1e-3;  // m

std::unique_ptr<btCollisionShape> make_convex(const scene::Shape& shape) {
  std::unique_ptr<btCollisionShape> convex;
  switch (shape.type) {
    case scene::ShapeType::kSphere:
      return std::make_unique<btSphereShape>(shape.size.x());
    case scene::ShapeType::kCapsule:
      return std::make_unique<btCapsuleShapeZ>(shape.size.x(), shape.size.y());
    case scene::ShapeType::kHull: {
      auto hull = std::make_unique<btConvexHullShape>();
      for (const Eigen::Vector3d& v : shape.vertices) hull->addPoint(to_bullet(v), false);
      hull->recalcLocalAabb();
      hull->setMargin(0);
      return hull;
    }
    case scene::ShapeType::kCylinder:
      convex = std::make_unique<btCylinderShapeZ>(btVector3(shape.size.x(), shape.size.x(), 0.5 * shape.size.y()));
      break;
    default:
      convex = std::make_unique<btBoxShape>(to_bullet((0.5 * shape.size).eval()));
  }
  convex->setMargin(kMargin);
  return convex;
}

}  // namespace

btVector3 to_bullet(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
btTransform to_bullet(const Pose& X) {
  return btTransform(
      btMatrix3x3(X.R(0, 0), X.R(0, 1), X.R(0, 2), X.R(1, 0), X.R(1, 1), X.R(1, 2), X.R(2, 0), X.R(2, 1), X.R(2, 2)),
      to_bullet(X.p));
}
Eigen::Vector3d from_bullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }
Pose from_bullet(const btTransform& X) {
  Pose out;
  out.p = from_bullet(X.getOrigin());
  for (int i = 0; i < 3; ++i) out.R.row(i) = from_bullet(X.getBasis().getRow(i)).transpose();
  return out;
}

btCollisionShape* BulletShapes::make(const scene::Body& body, const Principal& frame) {
  if (body.shapes.empty()) return &nothing_;
  const scene::Shape& shape = body.shapes[0];
  const Pose X_PS = frame.X_BP.inverse() * shape.X_BS;
  if (shape.type == scene::ShapeType::kPlane) {
    shapes_.push_back(std::make_unique<btStaticPlaneShape>(to_bullet(X_PS.R.col(2).eval()), X_PS.R.col(2).dot(X_PS.p)));
    return shapes_.back().get();
  }
  shapes_.push_back(make_convex(shape));
  if (X_PS == Pose{}) return shapes_.back().get();
  auto compound = std::make_unique<btCompoundShape>();
  compound->addChildShape(to_bullet(X_PS), shapes_.back().get());
  shapes_.push_back(std::move(compound));
  return shapes_.back().get();
}

}  // namespace cotwin::benchmark
