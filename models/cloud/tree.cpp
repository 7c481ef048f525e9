#include "models/cloud/tree.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "models/cloud/cloud_file.h"
#include "models/foundation/support/text.h"

namespace cotwin::cloud {

using Eigen::Vector3d;
using Eigen::Vector3f;

namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

Vector3d to_double(const std::array<float, 3>& p) { return {p[0], p[1], p[2]}; }

}  // namespace

Tree::Tree(Cloud cloud) : cloud_(std::move(cloud)) {
  leaves_ = (cloud_.points.size() + kLeaf - 1) / kLeaf;
  boxes_.resize(2 * leaves_ - 1);
  while ((std::size_t{1} << depth_) < leaves_) ++depth_;
  build(0);
}

/// The leaves from left to right: first those of the deepest level, which have the highest numbers.
std::size_t Tree::leaf_number(std::size_t node) const {
  const std::size_t deepest = (std::size_t{1} << depth_) - 1;
  return node >= deepest ? node - deepest : node + leaves_ - deepest;
}

std::size_t Tree::first_leaf_below(std::size_t node) const {
  while (node < leaves_ - 1) node = 2 * node + 1;
  return leaf_number(node);
}

/// Divides the points below a node along the longest side of their box, as its leaves need them.
Tree::Box Tree::build(std::size_t node) {
  const std::size_t begin = kLeaf * first_leaf_below(node);
  std::size_t last = node;
  while (last < leaves_ - 1) last = 2 * last + 2;
  const std::size_t end = std::min(kLeaf * (leaf_number(last) + 1), cloud_.points.size());
  const auto at = [this](std::size_t k) { return cloud_.points.begin() + static_cast<std::ptrdiff_t>(k); };
  Vector3f low = *at(begin), high = low;
  for (auto p = at(begin); p != at(end); ++p) {
    low = low.cwiseMin(*p);
    high = high.cwiseMax(*p);
  }
  const Box box{{low.x(), low.y(), low.z()}, {high.x(), high.y(), high.z()}};
  boxes_[node] = box;
  if (node >= leaves_ - 1) return box;
  Eigen::Index axis = 0;
  (high - low).maxCoeff(&axis);
  std::nth_element(at(begin), at(kLeaf * first_leaf_below(2 * node + 2)), at(end),
                   [axis](const Vector3f& a, const Vector3f& b) { return a[axis] < b[axis]; });
  build(2 * node + 1);
  build(2 * node + 2);
  return box;
}

Tree::Node Tree::node(std::int32_t k) const {
  const auto at = static_cast<std::size_t>(k);
  if (at >= boxes_.size()) {
    const auto point = static_cast<std::uint32_t>(at - boxes_.size());
    return {cloud_.points[point].cast<double>(), Vector3d::Zero(), 0, -1, -1, point, point + 1};
  }
  const Vector3d low = to_double(boxes_[at].low), high = to_double(boxes_[at].high);
  Node node{(low + high) / 2, (high - low) / 2, 0, -1, -1, 0, 0};
  node.radius = node.half.norm();
  if (at < leaves_ - 1) {
    node.left = 2 * k + 1;
    node.right = 2 * k + 2;
  } else {
    node.first = static_cast<std::uint32_t>(kLeaf * leaf_number(at));
    node.last = static_cast<std::uint32_t>(std::min<std::size_t>(node.first + kLeaf, cloud_.points.size()));
  }
  return node;
}

/// The square of a point's distance from a box.
double Tree::gap(std::size_t node, const Vector3f& p) const {
  const Vector3d at = p.cast<double>(), low = to_double(boxes_[node].low), high = to_double(boxes_[node].high);
  return (low - at).cwiseMax(at - high).cwiseMax(0).squaredNorm();
}

double Tree::to_next(std::size_t k) const {
  const Vector3f p = cloud_.points[k];
  double least = kInfinity;
  const auto look = [&](std::size_t leaf) {
    const std::size_t end = std::min(kLeaf * (leaf + 1), cloud_.points.size());
    for (std::size_t i = kLeaf * leaf; i < end; ++i) {
      if (i != k) least = std::min(least, (cloud_.points[i].cast<double>() - p.cast<double>()).squaredNorm());
    }
  };
  look(k / kLeaf);
  std::array<std::size_t, 64> open{0};
  for (std::size_t count = 1; count > 0;) {
    const std::size_t node = open[--count];
    if (gap(node, p) >= least) continue;
    if (node >= leaves_ - 1) {
      look(leaf_number(node));
      continue;
    }
    const bool left_first = gap(2 * node + 1, p) <= gap(2 * node + 2, p);
    open[count++] = 2 * node + (left_first ? 2 : 1);
    open[count++] = 2 * node + (left_first ? 1 : 2);
  }
  return std::sqrt(least);
}

Spacing spacing(const Tree& tree, std::size_t samples) {
  const std::size_t n = tree.cloud().points.size(), stride = samples == 0 ? 1 : std::max<std::size_t>(1, n / samples);
  std::vector<double> gaps;
  gaps.reserve(n / stride + 1);
  for (std::size_t k = 0; k < n; k += stride) gaps.push_back(tree.to_next(k));
  const auto share = [&gaps](double x) {
    const auto at = gaps.begin() + static_cast<std::ptrdiff_t>(x * static_cast<double>(gaps.size() - 1));
    std::ranges::nth_element(gaps, at);
    return *at;
  };
  return {share(0.5), share(0.95), *std::ranges::max_element(gaps)};
}

double Obstacle::touching() const {
  constexpr double kRound = 1e-4;  // m
  return points->cloud().points.size() > 1 ? std::ceil(spacing.most / 2 / kRound) * kRound : 0;
}

std::string Obstacle::gaps(const std::string& name, double radius) const {
  if (!(radius < touching())) return "";
  return name + " is " + text::to_text(radius, 3) + " m, but 95 % of the points are up to " + text::to_text(spacing.most, 3) +
         " m from the next one: links may pass between them, expected at least " + text::to_text(touching(), 3) + " m";
}

Obstacle load_obstacle(const std::filesystem::path& file) {
  CloudFile read = load_cloud(file);
  const auto tree = std::make_shared<const Tree>(std::move(read.cloud));
  constexpr std::size_t kSamples = 10'000;
  Obstacle obstacle{tree, spacing(*tree, kSamples), std::move(read.remarks)};
  constexpr double kApart = 0.1;  // m
  if (obstacle.touching() > kApart)
    obstacle.remarks.push_back("points are up to " + text::to_text(obstacle.spacing.most, 3) +
                               " m (95 %) from the next one: are they in m? `cotwin cloud --unit mm -o` converts them");
  return obstacle;
}

}  // namespace cotwin::cloud
