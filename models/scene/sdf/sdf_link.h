#pragma once
#include <filesystem>

#include "models/scene/scene.h"
#include "models/scene/sdf/sdf_values.h"

namespace cotwin::scene::sdf {

/// Reads motion, inertia, shapes and velocity of a link, not its name and pose. `is_static`: of its model. Mesh paths are
/// relative to `folder`.
Body read_link(const xml::Element& element, bool is_static, const std::filesystem::path& folder, const Warn& warn);

/// The file of a uri: relative to `folder`, or for model://name in `folder` or its parent. Throws Error with the searched
/// paths.
std::filesystem::path find_file(const xml::Element& uri, const std::filesystem::path& folder);

}  // namespace cotwin::scene::sdf
