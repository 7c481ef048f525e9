#include "models/scene/heightmap.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/scene/mesh.h"

namespace cotwin::scene {

namespace {

using Eigen::Vector3d;

constexpr double kDeepest = 0.1;  // depth of the solid behind a triangle, of the map's diagonal
constexpr double kFarthest = 4;   // how far it extends sideways, in cells: a wide solid collides with bodies that are far away
constexpr double kShallowest = 1e-4;  // of the map's diagonal

/// Heights at the nodes of a grid of `columns` × `rows`; row 0 is at the smallest y.
struct Grid {
  std::size_t columns = 0, rows = 0;
  double dx = 0, dy = 0;  // of a cell, m
  std::vector<double> heights;

  double& at(std::size_t column, std::size_t row) { return heights[row * columns + column]; }
  double at(std::size_t column, std::size_t row) const { return heights[row * columns + column]; }
  /// Bilinear, at x and y from the first node; −∞ outside.
  double height(double x, double y) const {
    const double u = x / dx, v = y / dy;
    if (!(u >= 0 && v >= 0 && u <= static_cast<double>(columns - 1) && v <= static_cast<double>(rows - 1))) return -kInfinity;
    const std::size_t i = std::min(static_cast<std::size_t>(u), columns - 2),
                      j = std::min(static_cast<std::size_t>(v), rows - 2);
    const double a = u - static_cast<double>(i), b = v - static_cast<double>(j);
    return (1 - b) * ((1 - a) * at(i, j) + a * at(i + 1, j)) + b * ((1 - a) * at(i, j + 1) + a * at(i + 1, j + 1));
  }
};

Grid grid_of(const GreyImage& image, const Heightmap& map) {
  Grid grid;
  grid.columns = (image.width - 1) * map.sampling + 1;
  grid.rows = (image.height - 1) * map.sampling + 1;
  grid.dx = map.size.x() / static_cast<double>(grid.columns - 1);
  grid.dy = map.size.y() / static_cast<double>(grid.rows - 1);
  const int brightest = *std::max_element(image.pixels.begin(), image.pixels.end());
  const double scale = brightest > 0 ? map.size.z() / brightest : 0;
  Grid pixels{image.width, image.height, 1, 1, {}};
  for (std::size_t y = image.height; y-- > 0;) {
    for (std::size_t x = 0; x < image.width; ++x) pixels.heights.push_back(scale * image.pixels[y * image.width + x]);
  }
  const auto samples = static_cast<double>(map.sampling);
  grid.heights.resize(grid.columns * grid.rows);
  for (std::size_t j = 0; j < grid.rows; ++j) {
    for (std::size_t i = 0; i < grid.columns; ++i)
      grid.at(i, j) = pixels.height(static_cast<double>(i) / samples, static_cast<double>(j) / samples);
  }
  return grid;
}

/// Depth of the solid behind a triangle: half of the way to where it ends, at the surface or the border.
double depth_behind(const Grid& grid, const Vector3d& a, const Vector3d& b, const Vector3d& c, double deepest) {
  const Vector3d n = (b - a).cross(c - a).normalized(), middle = (a + b + c) / 3;
  const double cell = std::min(grid.dx, grid.dy), sideways = n.head<2>().norm();
  double depth = sideways * deepest > kFarthest * cell ? kFarthest * cell / sideways : deepest;
  constexpr double kStep = 0.25;  // of a cell, sideways
  const double step = kStep * cell / sideways;
  for (const Vector3d& corner : {middle, a, b, c}) {
    const Vector3d p = 0.1 * middle + 0.9 * corner;
    const auto inside = [&](double way) {
      const Vector3d at = p - way * n;
      return at.z() <= grid.height(at.x(), at.y());
    };
    double out = step;
    while (out < 2 * depth && inside(out)) out += step;
    if (out >= 2 * depth) continue;
    double in = out - step;
    for (int k = 0; k < 10; ++k) (inside((in + out) / 2) ? in : out) = (in + out) / 2;
    depth = out / 2;
  }
  return depth;
}

}  // namespace

std::vector<Shape> heightmap_shapes(const GreyImage& image, const Heightmap& map) {
  const auto dimensions = std::to_string(image.width) + " × " + std::to_string(image.height) + " pixels";
  if (image.width < 2 || image.height < 2) throw Error(dimensions + ", expected 2 × 2 at least");
  constexpr double kLargest = 1e9;  // m
  if (!(map.size.x() > 0 && map.size.y() > 0 && map.size.z() >= 0 && map.size.maxCoeff() <= kLargest))
    throw Error("size " + text::to_text(map.size.x(), 6) + " " + text::to_text(map.size.y(), 6) + " " +
                text::to_text(map.size.z(), 6) + " m, expected > 0 along x and y, ≥ 0 along z, and ≤ 1e9");
  if (map.sampling < 1 || map.sampling > kMostHeightmapTriangles)
    throw Error("sampling " + std::to_string(map.sampling) + ", expected 1 or more");
  const double triangles =
      2 * static_cast<double>((image.width - 1) * map.sampling) * static_cast<double>((image.height - 1) * map.sampling);
  if (triangles > static_cast<double>(kMostHeightmapTriangles)) {
    throw Error(dimensions + " at sampling " + std::to_string(map.sampling) + " are " + text::to_text(triangles, 12) +
                " triangles, expected " + std::to_string(kMostHeightmapTriangles) +
                " at most (257 × 257 pixels): scale the image down");
  }
  const Grid grid = grid_of(image, map);
  const auto place = [&](std::size_t i, std::size_t j) {
    return Vector3d(static_cast<double>(i) * grid.dx, static_cast<double>(j) * grid.dy, grid.at(i, j));
  };
  Mesh mesh;
  std::vector<double> depths;
  const double diagonal = map.size.norm();
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    const auto index = [](std::size_t k) { return static_cast<std::uint32_t>(k); };
    mesh.triangles.push_back({index(a), index(b), index(c)});
    const double depth = depth_behind(grid, mesh.vertices[a], mesh.vertices[b], mesh.vertices[c], kDeepest * diagonal);
    depths.push_back(std::max(depth, kShallowest * diagonal));
  };
  for (std::size_t j = 0; j < grid.rows; ++j) {
    for (std::size_t i = 0; i < grid.columns; ++i) mesh.vertices.push_back(place(i, j));
  }
  for (std::size_t j = 0; j + 1 < grid.rows; ++j) {
    for (std::size_t i = 0; i + 1 < grid.columns; ++i) {
      const std::size_t k = j * grid.columns + i, above = k + grid.columns;
      add(k, k + 1, above + 1);
      add(k, above + 1, above);
    }
  }
  for (Vector3d& v : mesh.vertices) v += map.pos - Vector3d(map.size.x() / 2, map.size.y() / 2, 0);
  return triangle_shapes(mesh, depths);
}

}  // namespace cotwin::scene
