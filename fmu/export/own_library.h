#pragma once
#include <filesystem>

namespace cotwin::fmu {

/// The file of the library or program that this code is in; empty if the system does not tell.
std::filesystem::path own_library();

}  // namespace cotwin::fmu
