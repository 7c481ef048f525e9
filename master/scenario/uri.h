#pragma once
#include <filesystem>
#include <string>

namespace cotwin::master::ssp {

/// Returns the scheme: "https" for "https:…", "" for a relative reference (RFC 3986).
std::string scheme_of(const std::string& reference);

/// Decodes %-escapes (RFC 3986). Throws Error for malformed ones.
std::string percent_decoded(const std::string& text, const std::string& place);

/// Returns the path of a relative reference or a file: URI, with %-escapes decoded. Throws Error for other schemes, other hosts
/// and malformed escapes.
std::filesystem::path uri_path(const std::string& reference, const std::string& place);

}  // namespace cotwin::master::ssp
