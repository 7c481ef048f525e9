#include "master/services/robot_folder.h"

#include <algorithm>
#include <sstream>
#include <vector>

#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/urdf/urdf.h"

namespace cotwin::master {

namespace {

namespace fs = std::filesystem;

/// Values of a parameter per joint in drive_train.ssv, compliance.ssv and energy.ssv.
std::size_t values_per_joint(const std::string& name) {
  const auto row = std::ranges::find_if(robot::kDriveParameters, [&](const auto& r) { return name == r.name; });
  return row == robot::kDriveParameters.end() ? 1 : std::max<std::size_t>(row->per_joint, 1);
}

/// The numbers of a text, separated by blanks; empty if it is another text.
std::vector<std::string> numbers_in(std::string list) {
  std::ranges::replace_if(
      list, [](char c) { return c == '\n' || c == '\t' || c == '\r'; }, ' ');
  std::vector<std::string> all;
  for (const std::string_view part : text::split(list, ' ')) {
    const std::string_view word = text::trim(part);
    if (word.empty()) continue;
    if (!text::parse_real(word)) return {};
    all.emplace_back(word);
  }
  return all;
}

/// Leaves out what belongs to the locked joints. Returns false for an element of one of them.
bool keep(ParameterValue& v, const services::Robot& robot) {
  const std::size_t bracket = v.name.find('[');
  const std::string name = v.name.substr(0, bracket);
  for (const char* of_bodies : {"mass", "first_moment", "inertia"})
    if (name == of_bodies)
      throw Error(v.place + ": " + v.name,
                  "describes bodies of the robot, expected none beside a robot with locked joints, "
                  "which merge their bodies");
  const std::size_t own = values_per_joint(name);
  const auto new_place = [&](std::size_t joint) {
    return std::ranges::find(robot.joints_kept, joint) - robot.joints_kept.begin();
  };
  if (bracket != std::string::npos) {
    const auto element = text::parse_integer(std::string_view(v.name).substr(bracket + 1, v.name.size() - bracket - 2));
    if (!element || *element < 1) return true;  // the unit refuses it
    const auto index = static_cast<std::size_t>(*element - 1), joint = index / own;
    const auto place = static_cast<std::size_t>(new_place(joint));
    if (place == robot.joints_kept.size()) return false;
    v.name = name + "[" + std::to_string(place * own + index % own + 1) + "]";
    return true;
  }
  const auto* list = std::get_if<std::string>(&v.value);
  if (!list) return true;
  const std::vector<std::string> values = numbers_in(*list);
  if (values.size() != own * robot.file_joints) return true;
  std::string kept;
  for (const std::size_t joint : robot.joints_kept)
    for (std::size_t k = 0; k < own; ++k) text::append(kept, values[joint * own + k], " ");
  v.value = kept;
  return true;
}

}  // namespace

RobotFolder::RobotFolder(const services::Robot& robot, bool rigid) {
  if (robot.urdf.empty()) throw Error("verify", "the robot is not from a file, expected a URDF");
  own_ = fs::absolute(robot.urdf).parent_path();
  urdf_ = fs::absolute(robot.urdf);
  if (urdf_.filename() == "robot.urdf" && robot.model.locked.empty() && !rigid) return;
  copy_.emplace();
  urdf_ = copy_->path() / "robot.urdf";
  write_file(urdf_, robot::to_urdf(robot.model));
  std::error_code none;
  for (const char* name : services::kDataFiles) {
    const fs::path file = own_ / name;
    if ((rigid && std::string_view(name) != "energy.ssv") || !fs::is_regular_file(file, none)) continue;
    if (robot.model.locked.empty()) {
      fs::copy_file(file, copy_->path() / name);  // lines keep their numbers in messages
      continue;
    }
    ParameterSet set = load_parameter_set(file), kept = set;
    kept.values.clear();
    for (ParameterValue& v : set.values)
      if (keep(v, robot)) kept.values.push_back(v);
    std::ostringstream out;
    write_parameter_set(out, kept);
    write_file(copy_->path() / name, out.str());
  }
}

bool RobotFolder::has(const std::string& file) const {
  std::error_code none;
  return fs::is_regular_file(urdf_.parent_path() / file, none);
}

std::string RobotFolder::in_own_folder(std::string message) const {
  const std::string other = urdf_.parent_path().string();
  if (other == own_.string()) return message;
  for (std::size_t at = message.find(other); at != std::string::npos; at = message.find(other, at + own_.string().size()))
    message.replace(at, other.size(), own_.string());
  return message;
}

}  // namespace cotwin::master
