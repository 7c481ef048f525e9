#pragma once
#include <filesystem>
#include <string_view>

/// The kind of a file, by its first bytes or the ending of its name.
namespace cotwin::fmu {

/// Returns whether the file begins with the signature of a zip archive. Its name does not matter.
bool is_archive(const std::filesystem::path& file);
/// Returns whether the name ends in `ending` (".fmu"), in upper or lower case.
bool has_ending(const std::filesystem::path& file, std::string_view ending);

}  // namespace cotwin::fmu
