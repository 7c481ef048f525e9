#pragma once
#include <filesystem>
#include <string>

namespace cotwin::master::ssp {

/// "https" of "https:…"; "" for a relative reference (RFC 3986).
std::string scheme_of(const std::string& reference);

/// The text with its %-escapes (RFC 3986) resolved. Throws Error for malformed ones.
std::string percent_decoded(const std::string& text, const std::string& place);

/// The path that a relative reference or a file: URI means, %-escapes resolved. Throws Error for other schemes, other hosts and
/// malformed escapes.
std::filesystem::path uri_path(const std::string& reference, const std::string& place);

}  // namespace cotwin::master::ssp
