#include "components/unit/settings.h"

#include <algorithm>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "models/robot/robot_model.h"
#include "models/scene/cell.h"

namespace cotwin {

namespace {

namespace fs = std::filesystem;

int hexadecimal(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::string unescape(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size() && hexadecimal(text[i + 1]) >= 0 && hexadecimal(text[i + 2]) >= 0) {
      out += static_cast<char>(hexadecimal(text[i + 1]) * 16 + hexadecimal(text[i + 2]));
      i += 2;
    } else {
      out += text[i];
    }
  }
  return out;
}

}  // namespace

std::string escape_setting(std::string_view text) {
  static constexpr char kDigits[] = "0123456789ABCDEF";
  std::string out;
  for (const char c : text) {
    if (c == '%' || c == '&' || c == '=' || static_cast<unsigned char>(c) < 0x20) {
      out += '%';
      out += kDigits[static_cast<unsigned char>(c) >> 4];
      out += kDigits[static_cast<unsigned char>(c) & 15];
    } else {
      out += c;
    }
  }
  return out;
}

Settings::Settings(std::string unit, std::string_view query, std::map<std::string, std::string> defaults,
                   std::vector<fs::path> folders, std::shared_ptr<FileStore> models)
    : unit_(std::move(unit)), defaults_(std::move(defaults)), folders_(std::move(folders)), models_(std::move(models)) {
  if (query.empty()) return;
  for (const std::string_view pair : text::split(query, '&')) {
    const std::size_t equals = pair.find('=');
    if (equals == std::string_view::npos || equals == 0) {
      throw Error("unit:" + unit_, "'" + std::string(pair) + "', expected setting=value");
    }
    if (!query_.emplace(unescape(pair.substr(0, equals)), unescape(pair.substr(equals + 1))).second) {
      throw Error("unit:" + unit_, "setting '" + std::string(pair.substr(0, equals)) + "' is given twice");
    }
  }
}

const std::string* Settings::lookup(const std::string& key) {
  if (std::find(asked_.begin(), asked_.end(), key) == asked_.end()) asked_.push_back(key);
  if (const auto found = query_.find(key); found != query_.end()) return &found->second;
  if (const auto found = defaults_.find(key); found != defaults_.end()) {
    defaults_used_.push_back(key);
    return &found->second;
  }
  return nullptr;
}

void Settings::declare(SettingList list) {
  list_ = std::move(list);
  const std::vector<std::string> names = list_.names();
  for (const auto& [key, value] : query_) {
    if (list_.find(key) != nullptr) continue;
    const std::string closest = text::closest(key, names);
    throw Error("unit:" + unit_, "no setting '" + key + "'" + (closest.empty() ? "" : "; did you mean '" + closest + "'?") +
                                     (names.empty() ? "; there is none" : "; there are " + text::joined(names)));
  }
}

const Setting& Settings::declared(const std::string& key, Setting::Kind kind) const {
  const Setting* setting = list_.find(key);
  if (setting == nullptr || setting->kind != kind) {
    throw Error("unit:" + unit_,
                "reads '" + key + "', which it does not declare as a setting of kind " + std::string(name_of(kind)));
  }
  return *setting;
}

std::optional<std::string> Settings::given(const std::string& key) const {
  if (const auto found = query_.find(key); found != query_.end()) return found->second;
  if (const auto found = defaults_.find(key); found != defaults_.end()) return found->second;
  return std::nullopt;
}

std::string Settings::value(const std::string& key, Setting::Kind kind, const std::string* fallback) {
  const Setting& setting = declared(key, kind);
  if (const std::string* found = lookup(key)) return *found;
  if (fallback != nullptr) return *fallback;
  if (setting.fallback) return *setting.fallback;
  fail_missing(key);
}

void Settings::fail_missing(const std::string& key) const {
  throw MissingSetting("unit:" + unit_,
                       "needs the setting '" + key + "', as in unit:" + unit_ + "?" + key + "=… (or --set " + key + "=…)");
}

void Settings::refuse(const std::string& key, const std::string& value, const std::string& expected) const {
  const bool for_all = !query_.contains(key);
  throw Error("unit:" + unit_,
              key + "=" + value + ", expected " + expected +
                  (for_all ? "; the value is given for all units, for one: --set COMPONENT." + key + "=…" : std::string()));
}

std::string Settings::text(const std::string& key) { return value(key, Setting::Kind::kText); }

long long Settings::integer(const std::string& key) {
  return integer(key, text::parse_integer(declared(key, Setting::Kind::kInteger).fallback.value_or("")).value_or(0));
}

long long Settings::integer(const std::string& key, long long fallback) {
  const Setting& setting = declared(key, Setting::Kind::kInteger);
  const std::string otherwise = std::to_string(fallback);
  const std::string found = value(key, Setting::Kind::kInteger, setting.fallback ? &otherwise : nullptr);
  const auto number = text::parse_integer(found);
  if (!number || *number < setting.min || *number > setting.max)
    refuse(key, found, "an integer from " + allowed_values(setting));
  return *number;
}

bool Settings::boolean(const std::string& key) {
  return boolean(key, declared(key, Setting::Kind::kBoolean).fallback == "true");
}

bool Settings::boolean(const std::string& key, bool fallback) {
  const Setting& setting = declared(key, Setting::Kind::kBoolean);
  const std::string otherwise = fallback ? "true" : "false";
  const std::string found = value(key, Setting::Kind::kBoolean, setting.fallback ? &otherwise : nullptr);
  const auto truth = text::parse_boolean(found);
  if (!truth) refuse(key, found, "true or false");
  return *truth;
}

std::string Settings::choice(const std::string& key) {
  const Setting& setting = declared(key, Setting::Kind::kChoice);
  std::string found = value(key, Setting::Kind::kChoice);
  if (std::find(setting.choices.begin(), setting.choices.end(), found) != setting.choices.end()) return found;
  const std::string closest = text::closest(found, setting.choices);
  refuse(key, found, "one of " + allowed_values(setting) + (closest.empty() ? "" : "; did you mean '" + closest + "'?"));
}

fs::path Settings::file(const std::string& name, const std::string& hint) const {
  const fs::path path(name);
  if (path.is_absolute()) {
    if (fs::exists(path)) return path;
    throw Error("unit:" + unit_, "no file " + name + hint);
  }
  std::vector<std::string> looked;
  for (const fs::path& folder : folders_) {
    const fs::path candidate = (folder / path).lexically_normal();
    if (fs::exists(candidate)) return candidate;
    if (std::find(looked.begin(), looked.end(), candidate) == looked.end()) looked.push_back(candidate.string());
  }
  std::string lines;
  for (const std::string& candidate : looked) lines += "\n  " + candidate;
  throw Error("unit:" + unit_, "no file " + name + hint + "; looked for" + lines);
}

fs::path Settings::scene_file() {
  const std::string name = text("scene");
  if (name == "none" || name.empty()) return {};
  const bool is_path = name.find('/') != std::string::npos || fs::path(name).has_extension();
  return file(is_path ? name : "scenes/" + name + "/scene.sdf", " (another scene: --set scene=PATH.sdf)");
}

fs::path Settings::data_file(const std::string& name) {
  const fs::path found = file(name);
  data_files_.push_back({name, found});
  return found;
}

void Settings::rename_data_files(const std::map<std::string, std::string>& names) {
  const auto rename = [&](std::string& value) {
    if (const auto whole = names.find(value); whole != names.end()) {
      value = whole->second;
      return;
    }
    std::string out;
    for (std::size_t at = 0; at <= value.size();) {
      const std::size_t end = std::min(value.find_first_of(",:", at), value.size());
      const std::string word = value.substr(at, end - at);
      const auto found = names.find(word);
      out += found == names.end() ? word : found->second;
      if (end < value.size()) out += value[end];
      at = end + 1;
    }
    value = out;
  };
  for (auto& [key, value] : query_) rename(value);
  for (auto& [key, value] : defaults_) rename(value);
}

fs::path Settings::robot_file(const std::string& key) {
  const std::string robot = text(key);
  if (robot.empty()) fail_missing(key);
  return robot_file(robot, " (another robot: --set " + key + "=PATH.urdf)");
}

/// "; did you mean 'lwr4'?"
static std::string similar_robot(const std::string& robot, const std::vector<fs::path>& folders) {
  std::vector<std::string> names;
  for (const fs::path& folder : folders) {
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(folder / "robots", none))
      if (fs::exists(entry.path() / "robot.urdf", none)) names.push_back(entry.path().filename().string());
  }
  std::ranges::sort(names);
  const std::string closest = text::closest(robot, names);
  return closest.empty() ? "" : "; did you mean '" + closest + "'?";
}

fs::path Settings::robot_file(const std::string& robot, const std::string& hint) {
  const bool is_path =
      robot.find('/') != std::string::npos || fs::path(robot).extension() == ".urdf" || fs::path(robot).extension() == ".xacro";
  const fs::path found =
      file(is_path ? robot : "robots/" + robot + "/robot.urdf", (is_path ? "" : similar_robot(robot, folders_)) + hint);
  robot_files_.push_back(found);
  return found;
}

std::string Settings::query() const {
  std::map<std::string, std::string> all = query_;
  for (const std::string& key : defaults_used_) all.emplace(key, defaults_.at(key));
  std::string text;
  for (const auto& [key, value] : all) text += (text.empty() ? "" : "&") + escape_setting(key) + "=" + escape_setting(value);
  return text;
}

void Settings::check_all_used() const {
  for (const auto& [key, value] : query_) {
    if (std::find(asked_.begin(), asked_.end(), key) != asked_.end()) continue;
    std::string others;
    for (const auto& [name, text] : query_) {
      if (name != key) text::append(others, name + "=" + text);
    }
    throw Error("unit:" + unit_, "the setting " + key + "=" + value + " has no effect with " +
                                     (others.empty() ? "the defaults of the other settings" : others) +
                                     ", expected it to be left out");
  }
}

std::vector<std::shared_ptr<const robot::RobotModel>> Settings::robots_used() const {
  if (!cell_) return robot_ ? std::vector{robot_} : std::vector<std::shared_ptr<const robot::RobotModel>>{};
  std::vector<std::shared_ptr<const robot::RobotModel>> robots;
  for (const scene::PlacedRobot& placed : cell_->robots) robots.emplace_back(cell_, &placed.model);
  return robots;
}

}  // namespace cotwin
