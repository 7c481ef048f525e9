#include "components/unit/setting_list.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin {

namespace {

Setting make_setting(std::string name, Setting::Kind kind, std::string description) {
  Setting setting;
  setting.name = std::move(name);
  setting.kind = kind;
  setting.description = std::move(description);
  return setting;
}

}  // namespace

std::string_view name_of(Setting::Kind kind) {
  switch (kind) {
    case Setting::Kind::kText:
      return "text";
    case Setting::Kind::kInteger:
      return "integer";
    case Setting::Kind::kBoolean:
      return "boolean";
    case Setting::Kind::kChoice:
      return "choice";
  }
  return "";
}

std::string allowed_values(const Setting& setting) {
  switch (setting.kind) {
    case Setting::Kind::kText:
      return "";
    case Setting::Kind::kInteger:
      return std::to_string(setting.min) + " to " + std::to_string(setting.max);
    case Setting::Kind::kBoolean:
      return "true, false";
    case Setting::Kind::kChoice:
      break;
  }
  return text::joined(setting.choices);
}

std::string default_value(const Setting& setting) {
  if (!setting.fallback) return "required";
  if (!setting.fallback_rule.empty()) return setting.fallback_rule;
  return setting.fallback->empty() ? "none" : *setting.fallback;
}

SettingList::Declared& SettingList::Declared::required() {
  list_.list_[index_].fallback.reset();
  return *this;
}

SettingList::Declared& SettingList::Declared::fallback_rule(std::string rule) {
  list_.list_[index_].fallback_rule = std::move(rule);
  return *this;
}

SettingList::Declared SettingList::text(std::string name, std::string fallback, std::string description) {
  Setting setting = make_setting(std::move(name), Setting::Kind::kText, std::move(description));
  setting.fallback = std::move(fallback);
  return add(std::move(setting));
}

SettingList::Declared SettingList::integer(std::string name, long long fallback, long long min, long long max,
                                           std::string description) {
  Setting setting = make_setting(std::move(name), Setting::Kind::kInteger, std::move(description));
  setting.fallback = std::to_string(fallback);
  setting.min = min;
  setting.max = max;
  return add(std::move(setting));
}

SettingList::Declared SettingList::boolean(std::string name, bool fallback, std::string description) {
  Setting setting = make_setting(std::move(name), Setting::Kind::kBoolean, std::move(description));
  setting.fallback = fallback ? "true" : "false";
  return add(std::move(setting));
}

SettingList::Declared SettingList::choice(std::string name, std::vector<std::string> choices, std::string description) {
  Setting setting = make_setting(std::move(name), Setting::Kind::kChoice, std::move(description));
  setting.fallback = choices.at(0);
  setting.choices = std::move(choices);
  return add(std::move(setting));
}

SettingList::Declared SettingList::robot(std::string description) {
  const Declared robot = text("robot", "", std::move(description));
  unphysical();
  joints_of_robot("");
  return robot;
}

void SettingList::cell(std::vector<std::string> shapes) {
  text("scene", "none", "bodies around the robots: a name in models/scenes, a path to an SDF file, or none");
  text("robot", "", "the robot, whose variables have no prefix: a name in models/robots, or a path to a URDF file");
  text("robots", "",
       "several robots instead, name:robot,name:robot as in left:lwr4,right:panda.urdf; the variables of each begin with its "
       "name and a dot");
  unphysical();
  choice(
      "robot_shapes", std::move(shapes),
      "collision shapes of the robots' links; all: those of the URDF; hulls: enclosing shapes of hulls.urdf or NAME_hulls.urdf "
      "beside it, if there is such a file; none: only tools touch something");
  joints_of_robot("; with several robots, robot/joint");
  text("tools", "",
       "collision shapes of tools that come and go, each name|frame|x y z|roll pitch yaw|URDF, separated by semicolons; attach "
       "events with a file set it");
}

void SettingList::joints_of_robot(const std::string& several) {
  text("lock", "",
       "joints that stand still, which merges their bodies: joint:position,joint:position in rad or m, as in finger:0.02" +
           several);
  text("passive", "", "joints without motor and gear, which move freely with the friction of the link: joint,joint" + several);
}

void SettingList::unphysical() {
  choice("unphysical", {"error", "warn", "estimate"},
         "reaction to inertias in the URDF that are missing or that no body can have: an error, used as they are with a "
         "warning, or "
         "replaced by the closest that a body can have and by rods of aluminium (models/robot/urdf/estimate.h); warn also "
         "ignores words without which the machine is another one");
}

const Setting* SettingList::find(std::string_view name) const {
  const auto found = std::find_if(list_.begin(), list_.end(), [&](const Setting& s) { return s.name == name; });
  return found == list_.end() ? nullptr : &*found;
}

std::vector<std::string> SettingList::names() const {
  std::vector<std::string> all;
  for (const Setting& setting : list_) all.push_back(setting.name);
  return all;
}

SettingList::Declared SettingList::add(Setting setting) {
  if (setting.name.empty()) throw Error("a setting without a name");
  if (find(setting.name) != nullptr) throw Error(setting.name, "declared twice");
  if (setting.description.empty()) throw Error(setting.name, "declared without a description");
  list_.push_back(std::move(setting));
  return {*this, list_.size() - 1};
}

}  // namespace cotwin
