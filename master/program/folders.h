#pragma once
#include <filesystem>
#include <string>
#include <vector>

/// Where the robots and scenes that a user names are.
namespace cotwin::master {

/// Where units look up named data, in this order: `scenario_folder` (may be empty), the working directory, the folders of
/// COTWIN_MODELS, those that come with Cotwin.
std::vector<std::filesystem::path> model_folders(const std::filesystem::path& scenario_folder);
/// The URDF that is meant by its path or by the name of a robot in the model folders. Throws Error.
std::filesystem::path urdf_of(const std::string& robot);

}  // namespace cotwin::master
