#pragma once
#include <cstdint>
#include <string>
#include <vector>

#include "models/cloud/cloud.h"
#include "models/scene/scene.h"

namespace cotwin::cloud {

struct Sampling {
  double spacing = 0.01;   // m: there is one point for each square of this edge
  double sigma = 0;        // m, of a normal deviation along the normal
  std::uint64_t seed = 0;  // of the deviation
};

/// Points on the surfaces of a scene's bodies where these start, spread evenly [Roberts 2018: the sequence R2], also where they are inside of others.
/// `left_out`: bodies with planes, which have no end and no points. Throws Error for more than 10⁸ points.
Cloud sample(const scene::Scene& scene, const Sampling& sampling, std::vector<std::string>& left_out);

/// The area of a body's shapes, m², without planes.
double area(const scene::Body& body);

}  // namespace cotwin::cloud
