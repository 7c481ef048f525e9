#include "components/services/robots.h"

#include <algorithm>
#include <system_error>

#include "components/services/robot_files.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"
#include "models/robot/changes/tool.h"
#include "models/robot/urdf/urdf.h"
#include "models/scene/sdf/sdf.h"
#include "models/scene/urdf/urdf_shapes.h"

namespace cotwin::services {

namespace fs = std::filesystem;

namespace {

/// Leaves only the values of the joints `kept`.
template <class Struct, class Table>
void select(Struct& values, const Table& table, const std::vector<std::size_t>& kept, std::size_t all) {
  for (const auto& row : table) {
    std::vector<double>& x = values.*row.values;
    const std::size_t per_joint = x.size() / all;
    std::vector<double> own;
    for (const std::size_t j : kept)
      for (std::size_t k = 0; k < per_joint; ++k) own.push_back(x[j * per_joint + k]);
    x = own;
  }
}

bool is_file(const fs::path& path) {
  std::error_code none;
  return fs::is_regular_file(path, none);
}

}  // namespace

std::vector<std::size_t> Robot::unknown_motors() const {
  std::vector<std::size_t> unknown;
  for (std::size_t j = 0; j < model.joints.size(); ++j) {
    const auto in_file = [&](std::size_t k) { return k == (joints_kept.empty() ? j : joints_kept[j]); };
    const bool known = drives && drives->B[j] > 0 && std::ranges::none_of(drives->without_B, in_file);
    if (!known && !model.joints[j].passive) unknown.push_back(j);
  }
  return unknown;
}

Robot load_robot(const fs::path& urdf, const std::string& name, robot::UrdfOptions options) {
  Robot r;
  r.name = name;
  r.urdf = urdf;
  r.model = robot::load_urdf(urdf, options, &r.notes);
  const bool locked = !options.locked.empty();
  options.locked.clear();
  const robot::RobotModel whole = locked ? robot::load_urdf(urdf, options) : r.model;
  r.base = whole.base.inertia;
  r.file_joints = whole.joints.size();
  const fs::path drives = urdf.parent_path() / kDrivesFile, energy = urdf.parent_path() / kEnergyFile;
  if (is_file(drives)) r.drives = load_drives(drives, whole);
  if (is_file(energy)) r.energy = load_energy(energy, whole);
  for (const robot::Joint& joint : r.model.joints) {
    const auto at = std::ranges::find(whole.joints, joint.name, &robot::Joint::name);
    if (at == whole.joints.end()) {
      if (!r.drives && !r.energy) continue;
      throw Error(urdf.string(),
                  "joint '" + joint.name + "' follows a locked one, expected the leader of the group to be locked");
    }
    r.joints_kept.push_back(static_cast<std::size_t>(at - whole.joints.begin()));
  }
  if (!locked) return r;
  if (r.drives) select(*r.drives, robot::kDriveParameters, r.joints_kept, r.file_joints);
  if (r.energy) select(r.energy->losses, energetics::kDriveLosses, r.joints_kept, r.file_joints);
  return r;
}

Robots::Robots(std::vector<fs::path> folders, std::string fallback, bool paths, fs::path people, robot::UrdfOptions options)
    : folders_(std::move(folders)),
      fallback_(std::move(fallback)),
      paths_(paths),
      people_(std::move(people)),
      options_(std::move(options)) {
  for (const fs::path& folder : folders_)
    if (const fs::path beside = folder / "../people/iso_ts_15066.csv"; people_.empty() && is_file(beside)) people_ = beside;
  if (!people_.empty()) (void)robot::load_body_parts(people_);  // a wrong table is told before the first request
}

std::shared_ptr<const Robot> Robots::find(const std::string& name, const std::map<std::string, double>& locked) {
  const std::vector<fs::path> files = files_of(name);
  std::string key = name;
  for (const auto& [joint, q] : locked) key += "\n" + joint + "=" + text::to_text(q);
  Times times;
  for (const fs::path& file : files) {
    std::error_code missing;
    const auto time = fs::last_write_time(file, missing);
    times.push_back(missing ? std::nullopt : std::optional(time));
  }
  {
    const std::lock_guard lock(mutex_);
    if (const auto at = kept_.find(key); at != kept_.end() && at->second.times == times) return at->second.robot;
  }
  robot::UrdfOptions options = options_;
  options.locked = locked;
  auto loaded = std::make_shared<Robot>(load_robot(files.front(), name, options));
  if (!people_.empty()) loaded->parts = robot::load_body_parts(people_);
  const std::shared_ptr<const Robot> robot = std::move(loaded);
  constexpr std::size_t kMost = 64;  // locked joints at ever other positions would fill the memory
  const std::lock_guard lock(mutex_);
  if (kept_.size() >= kMost) kept_.clear();
  kept_[key] = {times, robot};
  return robot;
}

std::vector<fs::path> Robots::files_of(const std::string& name) const {
  std::vector<fs::path> files = {urdf_of(name)};
  for (const char* data : kDataFiles) files.push_back(files.front().parent_path() / data);
  if (!people_.empty()) files.push_back(people_);
  return files;
}

namespace {

/// A name that leads out of no folder.
bool is_plain(const std::string& name) {
  return !name.empty() && name.size() <= 100 && name.front() != '.' && std::ranges::all_of(name, [](char c) {
    return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-' || c == '.';
  });
}

}  // namespace

scene::Scene Robots::scene(const std::string& name, std::vector<std::string>& notes) const {
  if (paths_ && is_file(name)) return scene::load(name, &notes);
  if (!is_plain(name))
    throw Error("scene", "is not a name of letters, digits, '_', '-' and '.', expected one of the known scenes");
  for (const fs::path& folder : folders_)
    for (const fs::path& file : {folder / "../scenes" / name / "scene.sdf", folder / "../scenes" / (name + ".sdf")})
      if (is_file(file)) return scene::load(file, &notes);
  throw Error("scene", "'" + name + "' is unknown, expected scenes/" + name + "/scene.sdf or scenes/" + name +
                           ".sdf beside a folder with robots" + (paths_ ? ", or a path to an SDF file" : ""));
}

std::shared_ptr<const cloud::Obstacle> Robots::cloud(const std::string& name, std::vector<std::string>& notes) {
  fs::path found = paths_ && is_file(name) ? fs::path(name) : fs::path();
  if (found.empty() && !is_plain(name))
    throw Error("cloud", "is not a name of letters, digits, '_', '-' and '.', expected one of the known clouds" +
                             std::string(paths_ ? ", or a path to a file" : "; paths are for the command line"));
  for (const fs::path& folder : folders_)
    for (const fs::path& file : {folder / "../scenes" / name / "scene.pcd", folder / "../scenes" / (name + ".pcd")})
      if (found.empty() && is_file(file)) found = file;
  if (found.empty())
    throw Error("cloud", "'" + name + "' is unknown, expected scenes/" + name + "/scene.pcd or scenes/" + name +
                             ".pcd beside a folder with robots" + (paths_ ? ", or a path to a point cloud" : ""));
  std::error_code missing;  // told when it is read
  const fs::file_time_type time = fs::last_write_time(found, missing);
  std::shared_ptr<const cloud::Obstacle> cloud;
  {
    const std::lock_guard lock(mutex_);
    if (const auto at = clouds_.find(found); at != clouds_.end() && at->second.time == time) cloud = at->second.cloud;
  }
  if (cloud == nullptr) {
    cloud = std::make_shared<const cloud::Obstacle>(cloud::load_obstacle(found));
    constexpr std::size_t kMost = 8;  // they may be large
    const std::lock_guard lock(mutex_);
    if (clouds_.size() >= kMost) clouds_.clear();
    clouds_[found] = {time, cloud};
  }
  notes.insert(notes.end(), cloud->remarks.begin(), cloud->remarks.end());
  return cloud;
}

fs::path Robots::tool_file(const std::string& name) const {
  if (paths_ && is_file(name)) return name;
  if (!is_plain(name))
    throw Error("tool", "is not a name of letters, digits, '_', '-' and '.', expected one of the known tools" +
                            std::string(paths_ ? ", or a path to a URDF" : "; paths are for the command line"));
  for (const fs::path& folder : folders_)
    if (const fs::path file = folder / "../tools" / (name + ".urdf"); is_file(file)) return file;
  throw Error("tool", "'" + name + "' is unknown, expected tools/" + name + ".urdf beside a folder with robots" +
                          (paths_ ? ", or a path to a URDF" : ""));
}

robot::Attachment Robots::tool(const std::string& name, const std::string& as) const {
  const fs::path file = tool_file(name);
  return robot::parse_tool(text::read_file(file, "a tool (.urdf)"), file.string(), as);
}

std::vector<scene::Shape> Robots::tool_shapes(const std::string& name, const Pose& X_BA,
                                              std::vector<std::string>& notes) const {
  return scene::shapes_of_tool(tool_file(name), X_BA, &notes);
}

fs::path Robots::urdf_of(const std::string& name) const {
  if ((paths_ || name == fallback_) && is_file(name)) return name;
  if (!is_plain(name))
    throw Error("robot", "is not a name of letters, digits, '_', '-' and '.', expected one of the known robots");
  for (const fs::path& folder : folders_)
    for (const fs::path& file : {folder / name / "robot.urdf", folder / (name + ".urdf")})
      if (is_file(file)) return file;
  const std::string closest = text::closest(name, names());
  throw Error("robot", "'" + name + "' is unknown" + (closest.empty() ? "" : "; did you mean '" + closest + "'?") +
                           ", expected the name of a robot");
}

std::vector<std::string> Robots::names() const {
  std::vector<std::string> all;
  for (const fs::path& folder : folders_) {
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder, none)) {
      if (entry.path().extension() == ".urdf") all.push_back(entry.path().stem().string());
      if (is_file(entry.path() / "robot.urdf")) all.push_back(entry.path().filename().string());
    }
  }
  std::ranges::sort(all);
  all.erase(std::unique(all.begin(), all.end()), all.end());
  return all;
}

}  // namespace cotwin::services
