#pragma once
#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace cotwin::scene {

/// A convex polytope: vertices, faces as whole polygons (coplanar triangles are merged) and edges.
struct Polytope {
  struct Face {
    Eigen::Vector3d n;                   // unit, outwards; the solid is at n·x ≤ d
    double d = 0;                        // m
    std::uint32_t begin = 0, count = 0;  // its corners, counter-clockwise seen from outside, in `corners`
  };
  struct Edge {
    std::array<std::uint32_t, 2> vertices{};
    std::array<std::uint32_t, 2> faces{};
  };
  std::vector<Eigen::Vector3d> vertices;
  std::vector<Face> faces;
  std::vector<std::uint32_t> corners;       // indices into vertices
  std::vector<std::uint32_t> corner_edges;  // the edge from this corner of the face to the next
  std::vector<Edge> edges;

  double volume() const;                  // m³
  Eigen::Vector3d centroid() const;       // of the volume
  Eigen::Matrix3d second_moment() const;  // ∫ (x·x U − x xᵀ) dV about the centroid, m⁵; times the density: the inertia
};

/// The box with these edge lengths about the origin: vertex 4 i + 2 j + k at the signs of x, y, z (0: minus); faces −x, +x, −y
/// …
Polytope box_polytope(const Eigen::Vector3d& size);

/// The convex hull of `points`; its vertices are a subset of them, in their order. Points within 1e-9 of the extent of a face's
/// plane belong to the face, and of points nearer to each other than that one is a vertex. It is verified: convex at every edge,
/// Euler's formula, no point above a face by more than 1e-9 of the extent and 1e-15 of the largest coordinate (of very many points:
/// a share of them). Throws Error for fewer than four points, points that are not finite, and points (nearly) in one plane.
Polytope convex_hull(std::span<const Eigen::Vector3d> points);

}  // namespace cotwin::scene
