#pragma once
#include <Eigen/Core>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <vector>

#include "models/scene/mesh.h"

/// Meshes of any number of triangles.
namespace cotwin::collision {

/// A grid of quadrilaterals, two triangles each, closed in both directions or (rows) with a pole at each end.
inline scene::Mesh grid(int rows, int columns, bool poles, const std::function<Eigen::Vector3d(double, double)>& point) {
  scene::Mesh mesh;
  const int rings = poles ? rows - 1 : rows;
  for (int i = 0; i < rings; ++i)
    for (int k = 0; k < columns; ++k)
      mesh.vertices.push_back(point((i + (poles ? 1.0 : 0.0)) / rows, static_cast<double>(k) / columns));
  const auto at = [&](int i, int k) { return static_cast<std::uint32_t>(i % rings * columns + k % columns); };
  for (int i = 0; i < (poles ? rings - 1 : rings); ++i)
    for (int k = 0; k < columns; ++k) {
      mesh.triangles.push_back({at(i, k), at(i + 1, k), at(i + 1, k + 1)});
      mesh.triangles.push_back({at(i, k), at(i + 1, k + 1), at(i, k + 1)});
    }
  if (!poles) return mesh;
  for (const double end : {0.0, 1.0}) {
    const auto pole = static_cast<std::uint32_t>(mesh.vertices.size());
    mesh.vertices.push_back(point(end, 0));
    for (int k = 0; k < columns; ++k) {
      if (end == 0) mesh.triangles.push_back({pole, at(0, k), at(0, k + 1)});
      if (end == 1) mesh.triangles.push_back({pole, at(rings - 1, k + 1), at(rings - 1, k)});
    }
  }
  return mesh;
}

inline scene::Mesh torus(int rows, int columns) {
  return grid(rows, columns, false, [](double u, double v) {
    const double a = -2 * std::numbers::pi * u, b = 2 * std::numbers::pi * v, r = 0.6 + 0.2 * std::cos(b);
    return Eigen::Vector3d(r * std::cos(a), r * std::sin(a), 0.2 * std::sin(b));
  });
}

/// A ball with bumps, whose poles are above each other.
inline scene::Mesh bumps(int rows, int columns, double size, double height) {
  return grid(rows, columns, true, [=](double u, double v) {
    const double a = std::numbers::pi * u, b = 2 * std::numbers::pi * v;
    const double r = size * (1 + height * std::sin(5 * a) * std::cos(4 * b));
    return Eigen::Vector3d(r * std::sin(a) * std::cos(b), r * std::sin(a) * std::sin(b), r * std::cos(a));
  });
}

inline std::vector<scene::Shape> shapes_of(const scene::Mesh& mesh) {
  return scene::triangle_shapes(mesh, std::vector<double>(mesh.triangles.size(), 0.2));
}

}  // namespace cotwin::collision
