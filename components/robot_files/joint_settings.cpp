#include "components/robot_files/joint_settings.h"

#include <string_view>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin {
namespace {

/// Calls visit(entry) for each entry of a list.
template <class Visit>
void for_each_entry(const std::string& list, const Visit& visit) {
  if (list.empty()) return;
  for (const std::string_view entry : text::split(list, ',')) visit(text::trim(entry));
}

/// Removes "robot/" from the start of a name. Returns false for the name of another robot.
bool strip(const std::string& robot, std::string_view& name) {
  if (robot.empty()) return true;
  if (name.substr(0, robot.size() + 1) != robot + "/") return false;
  name.remove_prefix(robot.size() + 1);
  return true;
}

}  // namespace

void read_joint_settings(const std::string& place, const std::string& robot, const std::string& lock,
                         const std::string& passive, robot::UrdfOptions& options) {
  for_each_entry(lock, [&](std::string_view entry) {
    const std::size_t colon = entry.rfind(':');
    const auto position = colon == std::string_view::npos ? std::nullopt : text::parse_real(entry.substr(colon + 1));
    if (!position || colon == 0) throw Error(place, "lock=" + lock + ", expected joint:position,joint:position in rad or m");
    std::string_view name = entry.substr(0, colon);
    if (!strip(robot, name)) return;
    if (!options.locked.emplace(name, *position).second)
      throw Error(place, "lock=" + lock + ": joint '" + std::string(name) + "' stands there twice");
  });
  for_each_entry(passive, [&](std::string_view name) {
    if (name.empty()) throw Error(place, "passive=" + passive + ", expected joint,joint");
    if (strip(robot, name)) options.passive.emplace(name);
  });
}

void check_joint_settings(const std::string& place, const std::set<std::string>& robots, const std::string& lock,
                          const std::string& passive) {
  for (const std::string& list : {lock, passive}) {
    for_each_entry(list, [&](std::string_view entry) {
      if (robots.contains(std::string(entry.substr(0, entry.find('/')))) && entry.find('/') != std::string_view::npos) return;
      throw Error(place, "'" + std::string(entry) +
                             "' in lock or passive names no robot, expected robot/joint with a "
                             "robot of the setting robots");
    });
  }
}

}  // namespace cotwin
