#pragma once
#include <cstddef>
#include <string>
#include <string_view>

#include "models/scene/mesh.h"

namespace cotwin::scene {

inline constexpr std::size_t kMostColladaNumbers = 60'000'000;

/// Reads the meshes of a COLLADA file (.dae, 1.4 and 1.5) as one: triangles, polylists and polygons (which become fans of triangles), each placed by the
/// nodes of the scene, in m by <unit>. As viewers of robots do, <up_axis> is ignored. Materials, skins and animations are not read. Vertices
/// are not welded. Throws Error `place:line: …`: also for strips, polygons with holes, skews and others that would be read only in part, and for
/// more than `most` numbers and elements read, or coordinates and corners placed by nodes.
Mesh parse_collada(std::string_view xml, const std::string& place, std::size_t most = kMostColladaNumbers);

}  // namespace cotwin::scene
