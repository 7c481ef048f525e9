#pragma once
#include <vector>

#include "models/mechanics/inertia.h"
#include "models/scene/scene.h"

namespace cotwin::scene {

/// A plate with a round hole, as SDF has none: the plate's middle is the frame's origin, its hole is about z.
struct RoundHole {
  double radius = 0;             // m, of the circle that fits into it
  double depth = 0;              // thickness of the plate, m
  double width = 0, length = 0;  // edges of the plate along x and y, m
  double chamfer = 0;            // at 45 degrees around the upper rim (+z): so wide and so deep, m
  int facets = 64;               // flat faces around, each a convex piece of its own
};

/// The hole's facets touch the circle in their middles and are farther out at their corners: radius (1/cos(π/facets) − 1).
double deviation_from_round(const RoundHole& hole);

/// The plate as a ring of convex pieces in its frame. Throws Error for a hole that does not fit into the plate.
std::vector<Shape> round_hole(const RoundHole& hole);

/// Mass distribution of the solid shape in the body's frame, from the density (kg/m³). Throws Error for a plane.
Inertia solid_inertia(const Shape& shape, double density);

}  // namespace cotwin::scene
