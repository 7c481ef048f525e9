#pragma once
#include "models/distance/convex.h"
#include "models/distance/separation.h"

/// The convex shapes of models/distance.
namespace cotwin::contact_world {

using distance::between_segments;
using distance::Convex;
using distance::Core;
using distance::Corner;
using distance::Feature;
using distance::find_covered_faces;
using distance::kDiscCorners;
using distance::make_convex;
using distance::Placed;
using distance::Separation;

}  // namespace cotwin::contact_world
