#pragma once
#include <filesystem>
#include <vector>

#include "fmu/check/check.h"
#include "fmu/description/model_description.h"

namespace cotwin::fmu {

/// The shared libraries of an unpacked FMU, for whatever platforms, sorted.
std::vector<std::filesystem::path> libraries(const std::filesystem::path& folder);

/// What is to be said of them without loading one: whether there is one for this platform, and of each what it needs and
/// whether it is of the platform that its folder says, stands alone, and shows what it must and nothing else.
void check_libraries(const std::filesystem::path& folder, const ModelDescription& description, std::vector<Finding>& out);

}  // namespace cotwin::fmu
