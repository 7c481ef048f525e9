#pragma once
#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "models/collision/separation.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

namespace cotwin::collision {

/// A point at which two shapes touch or are close to touching.
struct ContactPoint {
  int body_a = -1, body_b = -1;                   // indices into Scene::bodies, a < b
  int shape_a = 0, shape_b = 0;                   // indices into Body::shapes
  Eigen::Vector3d p_W = Eigen::Vector3d::Zero();  // halfway between the two surfaces, m
  Eigen::Vector3d n_W = Eigen::Vector3d::Zero();  // unit normal, from a to b
  double gap = 0;                                 // signed distance along n, m; negative: they interpenetrate
  std::uint64_t id = 0;                           // of the features: unique in the pair of shapes, constant from step to step
  double area = 0, share = 1;                     // of patch.h: as ManifoldPoint in manifold.h
  double load = 0, spread = 1;
};

/// Finds the contact points of a scene's shapes. The result depends on the poses alone: equal poses give equal points in the
/// same order, to the last bit.
///
/// The gap of a pair's deepest point is the signed distance. Separated shapes: exact (10⁻⁹ m for sizes of 0.1 m).
/// Interpenetrating shapes: the shortest translation that separates them; the global minimum for boxes, spheres, capsules and
/// hulls; for ellipsoids to 0.2 mm; for cylinders a local minimum up to a depth of 1 % of the smaller shape's size, beyond that the best that EPA finds.
/// The other points are intersections and corners of the outlines of the two facing features, projected along n; their gaps
/// are measured along n.
///
/// Pieces of one body that share whole faces (a ring around a hole) form one surface: no contact normal comes from the seam.
/// Two static bodies do not collide; driven bodies collide with all others except those that the scene excludes.
class Detector {
 public:
  explicit Detector(const scene::Scene& scene);
  ~Detector();
  Detector(Detector&&) noexcept;
  Detector& operator=(Detector&&) noexcept;

  /// Finds the points with a gap below `margin` (m) of all pairs that can collide, at most four for each pair of convex pieces.
  /// X_WB: one pose per body of the scene. Allocates only if there are more points, pairs or boxes than in any call before.
  void detect(std::span<const Pose> X_WB, double margin);
  /// As detect() after only the bodies with a nonzero `moved` have changed their poses, with the same margin: gives the same
  /// result, but computes only the points of their pairs.
  void update(std::span<const Pose> X_WB, double margin, std::span<const char> moved);
  std::span<const ContactPoint> points() const;  // sorted by pair and feature; valid until the next detect() or update()

  /// A convex piece of a body's surface.
  struct Piece {
    Convex convex;
    int body = 0, shape = 0;
    bool moves = false;
    bool foundation = false;  // its points are those of patch.h
    bool soft = false;        // its material yields
  };
  std::span<const Piece> pieces() const;  // in the order of the bodies; valid as long as the object
  bool ignores(int body_a, int body_b) const;

  /// Whether the shapes of a tool (scene::Shape::tool) touch anything; at first they do not. Call detect() after it.
  void set_present(int body, int shape, bool present);

  /// Bodies that a latch joins do not collide with one another. Call detect() after it.
  void clear_joined();
  void add_joined(int body_a, int body_b);

  /// Allocates memory for this number of contact points.
  void reserve(std::size_t points);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cotwin::collision
