#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "models/cloud/tree.h"
#include "models/collision/nearest.h"
#include "models/collision/ray.h"
#include "models/mechanics/pose.h"
#include "models/scene/scene.h"

/// How near bodies of many shapes are, which are in a tree of boxes.
namespace cotwin::collision {

/// The shapes of a body, in a tree of boxes in the frame of the body. Triangles that are joined at their edges are a mesh. It is closed, with solid
/// inside, if each edge has as many triangles in one direction as in the other, or, with triangles that face the wrong way, an even number of them;
/// otherwise it is a surface without solid. Inside is where the closed meshes wind around once or more; of those with triangles that face the wrong
/// way, where a ray crosses them an odd number of times.
/// Or the points of a cloud, with a ball around each. A cloud has no inside: what it encloses without touching a ball is clear.
class Body {
 public:
  /// Throws Error for a hull without volume.
  explicit Body(std::span<const scene::Shape> shapes);
  /// A cloud; `radius` of the balls, m.
  Body(std::shared_ptr<const cloud::Tree> points, double radius);

  /// `unscaled`, larger by the factor about the frame's origin. Allocates nothing if both have the same shapes.
  void set_scaled(const Body& unscaled, double factor);

  /// Of the balls of a cloud, m.
  void set_ball(double radius);

  bool empty() const { return pieces_.empty() && points_ == nullptr; }
  /// The radius of the ball about the frame's origin that encloses the shapes, m; infinity with a plane.
  double reach() const { return reach_; }
  /// A smaller ball around them: its middle in the frame of the body, and its radius.
  const Eigen::Vector3d& middle() const { return middle_; }
  double radius() const { return radius_; }
  const std::vector<Convex>& pieces() const { return pieces_; }  // triangles are flat
  /// Whether a mesh of it is not closed.
  bool open() const { return open_; }
  /// Whether a point in the frame of the body is inside a closed mesh. Allocates nothing.
  bool contains(const Eigen::Vector3d& p) const;
  /// The distance along a ray, in the frame of the body, to the first point of a shape that is present, if it is at most `most`, otherwise infinity; 0
  /// from inside a convex shape. A mesh is its surface, also from inside (contains()). Nothing of a cloud. Allocates nothing.
  double first_along(const Ray& ray, double most = scene::kInfinity) const;
  /// The shapes of tools are absent at first. Piece k is shape k.
  void set_present(std::size_t piece, bool present) { present_[piece] = present ? 1 : 0; }

 private:
  friend class Finder;
  struct Node {
    Eigen::Vector3d middle, half;        // box in the frame of the body
    double radius = 0;                   // of the ball about its middle
    std::int32_t left = -1, right = -1;  // nodes; -1: a leaf with `piece`
    std::uint32_t piece = 0;
  };
  const Node& node(std::int32_t k) const { return nodes_[static_cast<std::size_t>(k)]; }
  bool is_triangle(std::uint32_t piece) const { return !triangles_.empty() && !std::isnan(triangles_[piece][0].x()); }
  std::int32_t root() const { return static_cast<std::int32_t>(nodes_.size()) - 1; }
  struct Crossings {
    int around = 0, all = 0;
    bool certain = true;
  };
  enum class Closed : std::uint8_t { kNo, kOriented, kEven };
  std::int32_t build(std::span<std::uint32_t> pieces);
  void find_meshes(std::span<const scene::Shape> shapes);
  void count_crossings(const Ray& ray, std::int32_t node, Crossings& crossings) const;

  std::vector<Convex> pieces_;
  std::vector<Corners> triangles_;      // flat ones by piece, near each other for rays, NaN for other pieces; empty without
  std::vector<Convex> prisms_;          // of triangles of closed meshes, by piece; empty without
  std::vector<Closed> closed_;          // by piece
  std::vector<std::uint32_t> groups_;   // by piece: the first one of its mesh, or itself
  bool open_ = false, bounds_ = false;  // bounds: a mesh is closed
  std::vector<char> present_;
  std::vector<Node> nodes_;            // the root is the last one
  std::vector<std::uint32_t> planes_;  // pieces that are in no box
  double reach_ = 0, radius_ = 0;
  Eigen::Vector3d middle_ = Eigen::Vector3d::Zero();
  std::size_t depth_ = 0, corners_ = 0;  // of the tree; of the largest face
  std::shared_ptr<const cloud::Tree> points_;
  double ball_ = 0;
};

/// Finds the nearest points of two bodies.
class Finder {
 public:
  /// Allocates for these bodies.
  void reserve(const Body& solid);
  /// The distance of two bodies if it is at most `most`, otherwise infinity. Equal arguments give equal bits. Allocates nothing.
  /// Of a part that is inside a closed mesh of the other body without touching its surface it is -(its distance from the surface + its depth along
  /// n), with n towards the nearest point of the surface.
  /// Two clouds have the distance infinity.
  Distance find(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most = scene::kInfinity);
  /// Sets near[k] of the points of a cloud (in the order of its tree) whose distance from a body of shapes is at most `most`.
  void find_near(const Body& body, const Pose& X_WB, const Body& cloud, const Pose& X_WC, double most, std::vector<char>& near);

 private:
  struct Step {
    std::int32_t a, b;
    double least;  // lower bound of the distance
  };
  static constexpr std::uint32_t kAll = 0xFFFFFFFF;
  /// From the surfaces; with a group of b, that group from the closed meshes of a.
  Distance nearest(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most, std::uint32_t group = kAll);
  /// The deepest of the parts of b that are inside a without touching it, if it is deeper than `best`.
  void find_inside(const Body& a, const Pose& X_WA, const Body& b, const Pose& X_WB, double most, Distance& best);
  /// Calls visit(leaf of a, node of b) from a node of b down for those that may be nearer than `most`, which visit() may lower; it returns whether to go
  /// on down. b is larger by `grown`.
  template <class Tree, class Visit>
  void descend(const Body& a, const Tree& b, std::int32_t node, const Pose& X_AB, double grown, const double& most,
               const Visit& visit);
  // cloud.cpp; poses are in the frame C about the origin of the cloud
  Distance from_cloud(const Body& a, const Pose& X_WA, const Body& cloud, const Pose& X_WC, double most);
  /// From all points (node 0) or from one; `closed`: of the closed meshes of a.
  Distance nearest_point(const Body& a, const Pose& X_CA, const Body& cloud, std::int32_t node, double most, bool closed);
  void find_points_inside(const Body& a, const Pose& X_CA, const Body& cloud, std::int32_t node, double surface, double most,
                          Distance& best);

  std::vector<Step> stack_;
  std::size_t depth_ = 0;  // of the deepest tree
  Feature scratch_;
};

}  // namespace cotwin::collision
