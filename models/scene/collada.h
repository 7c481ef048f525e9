#pragma once
#include <string>
#include <string_view>

#include "models/scene/mesh.h"

namespace cotwin::scene {

/// Reads the meshes of a COLLADA file (.dae, 1.4 and 1.5) as one: triangles, polylists and polygons (which become fans of triangles), each placed by the
/// nodes of the scene, in m by <unit>. As viewers of robots do, <up_axis> is ignored. Materials, skins and animations are not read. Vertices
/// are not welded. Throws Error `place:line: …`.
Mesh parse_collada(std::string_view xml, const std::string& place);

}  // namespace cotwin::scene
