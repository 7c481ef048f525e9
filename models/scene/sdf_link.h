#pragma once
#include <filesystem>

#include "models/scene/scene.h"
#include "models/scene/sdf_values.h"

namespace cotwin::scene::sdf {

/// A link without its name and place in the world: motion, inertia, shapes, velocity. `is_static`: of its
/// model. Meshes are looked for beside `folder`.
Body read_link(const xml::Element& element, bool is_static, const std::filesystem::path& folder, const Warn& warn);

/// The file that a uri means: relative to `folder`, or model://name beside it or beside its parent. Throws Error naming what
/// was looked for.
std::filesystem::path find_file(const xml::Element& uri, const std::filesystem::path& folder);

}  // namespace cotwin::scene::sdf
