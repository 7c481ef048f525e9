#pragma once
#include <span>
#include <string>
#include <string_view>

/// The text `assumed` of a file with data of a robot: names of its parameters that are assumptions, not measurements, separated by blanks;
/// "all", "none", or "" where the file does not tell.
namespace cotwin {

/// Throws Error at `place` for a name that is not one of `known`.
void check_assumed(const std::string& place, const std::string& assumed, std::span<const char* const> known);
/// Whether the text names this parameter.
bool is_assumed(std::string_view assumed, std::string_view name);

}  // namespace cotwin
