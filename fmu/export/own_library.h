#pragma once
#include <filesystem>

namespace cotwin::fmu {

/// Returns the path of the library or program that contains this code; empty if the system cannot determine it.
std::filesystem::path own_library();

}  // namespace cotwin::fmu
