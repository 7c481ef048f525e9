#pragma once
#include <filesystem>
#include <string_view>

/// What a file is, by its first bytes and by the end of its name.
namespace cotwin::fmu {

/// Whether it begins as a zip archive does, whatever its name is.
bool is_archive(const std::filesystem::path& file);
/// Whether its name ends in `ending`, `.fmu`, in capitals or not.
bool has_ending(const std::filesystem::path& file, std::string_view ending);

}  // namespace cotwin::fmu
