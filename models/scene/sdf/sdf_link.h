#pragma once
#include <cstdint>
#include <filesystem>

#include "models/scene/scene.h"
#include "models/scene/sdf/sdf_values.h"

namespace cotwin::scene::sdf {

inline constexpr std::uint32_t kAllBits = 0xFFFF;  // default of <collide_bitmask>

/// Reads motion, inertia, shapes and velocity of a link, not its name and pose. `is_static`: of its model. Mesh paths are
/// relative to `folder`. `mask`: becomes the <collide_bitmask> of its collisions.
Body read_link(const xml::Element& element, bool is_static, const std::filesystem::path& folder, std::uint32_t& mask,
               const Warn& warn);

/// The file of a uri: relative to `folder`, or for model://name in `folder` or its parent. Throws Error with the searched
/// paths.
std::filesystem::path find_file(const xml::Element& uri, const std::filesystem::path& folder);

}  // namespace cotwin::scene::sdf
