#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::contact_world {

/// One point where two shapes touch or are about to.
struct ContactPoint {
  int body_a = -1, body_b = -1;                   // indices into Scene::bodies, a < b
  int shape_a = 0, shape_b = 0;                   // indices into Body::shapes
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();  // halfway between the two surfaces, m
  Eigen::Vector3d n_W = Eigen::Vector3d::Zero();  // unit normal, from a to b
  double gap = 0;                                 // signed distance along n, m; negative: they interpenetrate
  std::uint64_t id = 0;  // of the features: one of its kind in the pair of shapes, and the same from step to step
};

/// Finds the contact points of a scene's shapes: a function of the poses alone. The same poses give the same points in the same
/// order, to the last bit, whatever was asked before.
///
/// The deepest point of a pair has its signed distance: apart exactly (10⁻⁹ m for sizes of 0.1 m); interpenetrating, the way
/// along which they come apart soonest: of boxes, spheres, capsules and hulls the best there is, of cylinders a locally best
/// one until 1 % of the smaller one's size, deeper the best that EPA finds. The other points lie where the outlines of the
/// features that face each other, seen along n, cross or hold each other's corners; their gaps are along n.
///
/// Pieces of one body that touch each other with whole faces (a ring around a hole) are one surface: nothing is pushed out of
/// the seam between them. Bodies that are static, both, do not meet; driven ones meet all but those that the scene leaves out.
class Collision {
 public:
  explicit Collision(const scene::Scene& scene);
  ~Collision();
  Collision(Collision&&) noexcept;
  Collision& operator=(Collision&&) noexcept;

  /// Points of all pairs that may touch whose gap is below `margin` (m), at most four a pair of convex shapes with faces. One
  /// pose a body, in the order of the scene. Allocates nothing once as many points, pairs and boxes were seen before as there
  /// are now.
  void detect(std::span<const Pose> X_WB, double margin);
  std::span<const ContactPoint> points() const;  // sorted by pair and feature; valid until the next detect()

  /// Allocates for so many contact points now.
  void reserve(std::size_t points);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::contact_world
