#include "master/scenario/folders.h"

#include <cstdlib>
#include <set>
#include <system_error>

#include "models/foundation/support/error.h"
#include "models/foundation/support/installation.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace fs = std::filesystem;

std::vector<fs::path> model_folders(const fs::path& scenario_folder) {
  std::vector<fs::path> folders;
  if (!scenario_folder.empty()) folders.push_back(fs::absolute(scenario_folder));
  folders.push_back(fs::current_path());
  if (const char* listed = std::getenv("COTWIN_MODELS")) {
    for (const std::string_view folder : text::split(listed, ':')) {
      if (!folder.empty()) folders.emplace_back(folder);
    }
  }
  folders.push_back(installation() / "share/cotwin/models");
  return folders;
}

namespace {

/// The robots in the model folders.
std::vector<std::string> robot_names() {
  std::set<std::string> names;
  std::error_code none;
  for (const fs::path& folder : model_folders({})) {
    for (const auto& entry : fs::directory_iterator(folder / "robots", none)) {
      if (fs::is_regular_file(entry.path() / "robot.urdf", none)) names.insert(entry.path().filename().string());
    }
  }
  return {names.begin(), names.end()};
}

}  // namespace

fs::path urdf_of(const std::string& robot) {
  std::error_code none;
  if (fs::is_regular_file(robot, none)) return robot;
  for (const fs::path& folder : model_folders({})) {
    const fs::path file = folder / "robots" / robot / "robot.urdf";
    if (fs::is_regular_file(file, none)) return file;
  }
  const std::string similar = text::closest(robot, robot_names());
  throw Error("robot '" + robot + "'", "is neither a file nor the name of a robot, expected a URDF" +
                                           (similar.empty() ? "" : "; did you mean " + similar + "?"));
}

}  // namespace cotwin::master
