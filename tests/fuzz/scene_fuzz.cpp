#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "models/collision/contact/detector.h"
#include "models/foundation/support/error.h"
#include "models/scene/sdf/sdf.h"

/// An SDF file that can be read gives a scene for collision detection: any number of points, without NaN.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  scene::Scene scene;
  try {
    std::vector<std::string> warnings;
    scene = scene::parse_sdf({reinterpret_cast<const char*>(data), size}, "fuzz.sdf", &warnings);
  } catch (const Error&) {
    return 0;
  }
  std::size_t shapes = 0;
  std::vector<Pose> poses;
  for (const scene::Body& body : scene.bodies) {
    shapes += body.shapes.size();
    poses.push_back(body.X_WB);
  }
  if (shapes > 100) return 0;
  collision::Detector detector(scene);
  for (const double margin : {0.0, 0.01}) {
    detector.detect(poses, margin);
    for (const collision::ContactPoint& p : detector.points()) {
      if (!std::isfinite(p.gap) || !p.p_W.allFinite() || !(std::abs(p.n_W.norm() - 1) < 1e-6)) std::abort();
    }
  }
  return 0;
}
