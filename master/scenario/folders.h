#pragma once
#include <filesystem>
#include <string>
#include <vector>

/// Look-up of robots and scenes by name.
namespace cotwin::master {

/// Returns the folders in which units look up named data, in this order: `scenario_folder` (may be empty), the working
/// directory, the folders in COTWIN_MODELS, those of Cotwin.
std::vector<std::filesystem::path> model_folders(const std::filesystem::path& scenario_folder);
/// Returns the URDF with this path, or that of the robot with this name in the model folders. Throws Error if there is none.
std::filesystem::path urdf_of(const std::string& robot);

}  // namespace cotwin::master
