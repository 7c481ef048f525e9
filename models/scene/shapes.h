#pragma once
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A plate with a round hole, which SDF does not have. The plate's centre is the frame's origin; the hole's axis is z.
struct RoundHole {
  double radius = 0;             // m, of the circle inscribed in the hole
  double depth = 0;              // thickness of the plate, m
  double width = 0, length = 0;  // edges of the plate along x and y, m
  double chamfer = 0;            // at 45 degrees at the upper rim (+z): width and depth, m
  int facets = 64;               // number of flat faces; each is a separate convex piece
};

/// The plate as a ring of convex pieces in its frame. Throws Error for a hole that does not fit into the plate.
std::vector<Shape> round_hole(const RoundHole& hole);

/// The vertices of a cone about z with its base at −length/2 and its tip at length/2, as a pyramid of 64 sides that has the
/// cone's volume. Throws Error unless both are > 0.
std::vector<Eigen::Vector3d> cone(double radius, double length);

/// The six corners of the prism that a kTriangle stands for, in its frame: the triangle, and the same at its depth.
std::vector<Eigen::Vector3d> triangle_corners(const Shape& triangle);

/// Mass distribution of the solid shape in the body's frame, from the density (kg/m³). Throws Error for a plane or a triangle.
Inertia solid_inertia(const Shape& shape, double density);

}  // namespace cotwin::scene
