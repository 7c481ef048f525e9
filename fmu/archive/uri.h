#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace cotwin::fmu {

/// The folder that a file URI (RFC 8089) names: file:/x, file:///x, file://localhost/x, %-escapes. A path without a scheme,
/// which some hosts give, is taken as it is. Throws Error for another scheme, another host and a broken escape.
std::filesystem::path path_from_uri(std::string_view uri);

/// file:///… with everything but unreserved characters escaped. The path must be absolute.
std::string uri_from_path(const std::filesystem::path& path);

}  // namespace cotwin::fmu
