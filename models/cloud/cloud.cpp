#include "models/cloud/cloud.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>

namespace cotwin::cloud {

using Eigen::Vector3d;
using Eigen::Vector3f;

namespace {

/// Leaves the first of equal points, in their order.
void drop_doubles(std::vector<Vector3f>& points) {
  struct Place {
    std::array<float, 3> p;
    std::uint32_t k;
    bool operator<(const Place& other) const { return p != other.p ? p < other.p : k < other.k; }
  };
  std::vector<Place> places;
  places.reserve(points.size());
  for (const Vector3f& p : points) places.push_back({{p.x(), p.y(), p.z()}, static_cast<std::uint32_t>(places.size())});
  std::ranges::sort(places, std::less<>());
  constexpr float kDropped = std::numeric_limits<float>::quiet_NaN();
  for (std::size_t i = 1; i < places.size(); ++i) {
    if (places[i].p == places[i - 1].p) points[places[i].k].x() = kDropped;
  }
  std::erase_if(points, [](const Vector3f& p) { return std::isnan(p.x()); });
}

}  // namespace

Cloud make_cloud(std::span<const Vector3d> points) {
  Cloud cloud;
  if (points.empty()) return cloud;
  Vector3d low = points[0], high = low;
  for (const Vector3d& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  constexpr double kFar = 16;
  if (low.cwiseAbs().cwiseMax(high.cwiseAbs()).maxCoeff() > kFar * (high - low).maxCoeff())
    cloud.origin = ((low + high) / 2).array().round();
  cloud.points.reserve(points.size());
  for (const Vector3d& p : points) cloud.points.push_back((p - cloud.origin).cast<float>());
  drop_doubles(cloud.points);
  return cloud;
}

Cloud moved(const Cloud& cloud, const Pose& X_WC) {
  std::vector<Vector3d> points;
  points.reserve(cloud.points.size());
  for (std::size_t k = 0; k < cloud.points.size(); ++k) points.push_back(X_WC * cloud.point(k));
  return make_cloud(points);
}

Cloud thinned(const Cloud& cloud, double size) {
  struct Cell {
    std::array<std::int64_t, 3> cube;
    std::uint32_t k;
    bool operator<(const Cell& other) const { return cube != other.cube ? cube < other.cube : k < other.k; }
  };
  std::vector<Cell> cells;
  cells.reserve(cloud.points.size());
  for (std::size_t k = 0; k < cloud.points.size(); ++k) {
    const Vector3d cube = (cloud.point(k) / size).array().floor();
    cells.push_back(
        {{static_cast<std::int64_t>(cube.x()), static_cast<std::int64_t>(cube.y()), static_cast<std::int64_t>(cube.z())},
         static_cast<std::uint32_t>(k)});
  }
  std::ranges::sort(cells, std::less<>());
  std::vector<Vector3d> means;
  for (std::size_t i = 0; i < cells.size();) {
    const std::size_t first = i;
    Vector3d sum = Vector3d::Zero();
    for (; i < cells.size() && cells[i].cube == cells[first].cube; ++i) sum += cloud.points[cells[i].k].cast<double>();
    means.push_back(cloud.origin + sum / static_cast<double>(i - first));
  }
  return make_cloud(means);
}

}  // namespace cotwin::cloud
