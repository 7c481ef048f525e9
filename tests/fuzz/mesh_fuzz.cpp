// Any bytes are a mesh (STL, OBJ or COLLADA) whose hull has a volume, or an Error.
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
      const std::vector<Eigen::Vector3d> hull = scene::convex_hull(mesh.vertices).vertices;
      if (hull.size() < 4) std::abort();
      for (const Eigen::Vector3d& vertex : hull) {
        if (!vertex.allFinite()) std::abort();
      }
    } catch (const Error& error) {
      if (!std::string_view(error.what()).starts_with(place)) std::abort();
    }
  }
  return 0;
}
