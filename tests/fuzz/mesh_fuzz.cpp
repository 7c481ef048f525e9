// Any bytes are a mesh (STL, OBJ or COLLADA) whose hull has a volume and all points, or an Error.
#include <algorithm>
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/scene/hull.h"
#include "models/scene/mesh.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  for (const scene::MeshFormat format : {scene::MeshFormat::kStl, scene::MeshFormat::kObj, scene::MeshFormat::kCollada}) {
    const char* place = "mesh";
    try {
      const scene::Mesh mesh = scene::parse_mesh(bytes, format, "mesh");
      place = "hull";
      const scene::Polytope hull = scene::convex_hull(mesh.vertices);
      if (hull.vertices.size() < 4 || !(hull.volume() > 0)) std::abort();
      double largest = 0, extent = 0;
      for (const Eigen::Vector3d& p : mesh.vertices) {
        if (!p.allFinite()) std::abort();
        largest = std::max(largest, p.cwiseAbs().maxCoeff());
        extent = std::max(extent, (p - mesh.vertices[0]).norm());
      }
      for (const scene::Polytope::Face& face : hull.faces) {
        const Eigen::Vector3d& corner = hull.vertices[hull.corners[face.begin]];
        for (const Eigen::Vector3d& p : mesh.vertices)
          if (!(face.n.dot(p - corner) <= 2e-9 * extent + 1e-14 * largest)) std::abort();
      }
    } catch (const Error& error) {
      if (!std::string_view(error.what()).starts_with(place)) std::abort();
    }
  }
  return 0;
}
