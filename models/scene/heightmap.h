#pragma once
#include <Eigen/Core>
#include <cstddef>

#include "models/scene/png.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// Terrain from an image, as SDF's <heightmap>.
struct Heightmap {
  Eigen::Vector3d size{1, 1, 1};                  // m: between the outer pixels' centres along x and y; height of the brightest
                                                  // pixel above black, which is at z = 0
  Eigen::Vector3d pos = Eigen::Vector3d::Zero();  // of the middle of the image at black, m
  std::size_t sampling = 1;                       // cells between two pixels, linearly interpolated
};

/// The image as ground, two triangles to a cell, with solid below them; the top row is at y = +size.y/2, as in Gazebo. Throws
/// Error unless the image has 2 × 2 pixels or more, size is > 0 (z: ≥ 0), and the triangles are HeightField::kMostTriangles at
/// most.
Shape heightmap_shape(GreyImage image, const Heightmap& map);

}  // namespace cotwin::scene
