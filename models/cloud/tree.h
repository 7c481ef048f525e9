#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "models/cloud/cloud.h"

namespace cotwin::cloud {

/// The points of a cloud in a tree of boxes. Each leaf has 8 points, the last one perhaps fewer; nodes are numbered as in a heap (the children of k are
/// 2 k + 1 and 2 k + 2), so that they need no pointers: 18 bytes a point in all. Does not change afterwards: threads may share it.
class Tree {
 public:
  /// Of the box of a node about the origin of the cloud, m.
  struct Node {
    Eigen::Vector3d middle, half;
    double radius;              // of the ball about its middle
    std::int32_t left, right;   // nodes; -1: a leaf
    std::uint32_t first, last;  // of a leaf: its points are from first up to, without, last
  };

  /// Takes a cloud of at least one point, whose points change their order.
  explicit Tree(Cloud cloud);

  const Cloud& cloud() const { return cloud_; }
  /// Of nodes, of which 0 is the root; then each point is a leaf by itself, in their order.
  Node node(std::int32_t k) const;
  std::int32_t nodes() const { return static_cast<std::int32_t>(boxes_.size()); }
  /// The most steps from the root to a leaf.
  std::size_t depth() const { return depth_; }
  /// The distance of a point, m, from the nearest other one; infinity for a single one.
  double to_next(std::size_t k) const;

 private:
  static constexpr std::size_t kLeaf = 8;
  struct Box {
    std::array<float, 3> low, high;
  };
  Box build(std::size_t node);
  std::size_t first_leaf_below(std::size_t node) const;
  std::size_t leaf_number(std::size_t node) const;
  double gap(std::size_t node, const Eigen::Vector3f& p) const;

  Cloud cloud_;
  std::vector<Box> boxes_;
  std::size_t leaves_ = 0, depth_ = 0;
};

/// Distances of points from the nearest other one, m: infinity for a single one.
struct Spacing {
  double median, most;  // most: of 95 % of them
  double largest;
};
/// Of all points, or of about `samples` of them.
Spacing spacing(const Tree& tree, std::size_t samples = 0);

/// The cloud of a file, as obstacle.
struct Obstacle {
  std::shared_ptr<const Tree> points;
  Spacing spacing;                   // of about 10 000 points
  std::vector<std::string> remarks;  // of the reader; points so far apart that they cannot be in m

  /// The radius of balls around the points of which 95 % touch the next one, in whole 0.1 mm; 0 of a single point.
  double touching() const;
  /// What to tell of balls that are smaller; `name`: of their radius. "" of others.
  std::string gaps(const std::string& name, double radius) const;
};
/// Throws as load_cloud().
Obstacle load_obstacle(const std::filesystem::path& file);
/// The beginning of its key in a FileStore, before the path.
inline constexpr const char* kCloudKey = "cloud\n";

}  // namespace cotwin::cloud
