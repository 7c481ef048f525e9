#pragma once
#include <filesystem>
#include <vector>

#include "fmu/check/check.h"
#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// Returns the shared libraries of an unpacked FMU for all platforms, sorted.
std::vector<std::filesystem::path> libraries(const std::filesystem::path& folder);

/// Checks the libraries without loading them: whether one fits this platform and, for each, its dependencies, whether its
/// machine fits the name of its folder, and whether it exports the FMI functions and nothing else.
void check_libraries(const std::filesystem::path& folder, const ModelDescription& description, std::vector<Finding>& out);

}  // namespace cotwin::fmu
