#pragma once
#include <filesystem>
#include <string>
#include <string_view>

namespace cotwin::fmu {

/// Returns the path of a file URI (RFC 8089): file:/x, file:///x, file://localhost/x, with %-escapes. Some hosts give a plain
/// path; it is returned unchanged. Throws Error for another scheme, another host and an invalid escape.
std::filesystem::path path_from_uri(std::string_view uri);

/// Returns file:///… with all characters except the unreserved ones escaped. The path must be absolute.
std::string uri_from_path(const std::filesystem::path& path);

}  // namespace cotwin::fmu
