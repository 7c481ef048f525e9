#pragma once
#include <string_view>

namespace cotwin::robot {

/// Whether a link or joint can have this name: 1 to 1000 bytes of UTF-8 without control characters.
bool is_urdf_name(std::string_view name);

}  // namespace cotwin::robot
