#include "components/unit/settings.h"

#include <algorithm>

#include "models/text/error.h"
#include "models/text/text.h"

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

std::string joined(const std::vector<std::string>& words) {
  std::string out;
  for (const std::string& word : words) out += (out.empty() ? "" : ", ") + word;
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
                   std::vector<fs::path> folders)
    : unit_(std::move(unit)), defaults_(std::move(defaults)), folders_(std::move(folders)) {
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

std::string Settings::text(const std::string& key, const std::string& fallback) {
  const std::string* found = lookup(key);
  return found != nullptr ? *found : fallback;
}

std::string Settings::text(const std::string& key) {
  if (const std::string* found = lookup(key)) return *found;
  throw Error("unit:" + unit_,
              "needs the setting '" + key + "', as in unit:" + unit_ + "?" + key + "=… (or --set " + key + "=…)");
}

long long Settings::integer(const std::string& key, long long fallback, long long min, long long max) {
  const std::string* found = lookup(key);
  if (found == nullptr) return fallback;
  const auto value = text::parse_integer(*found);
  if (!value || *value < min || *value > max) {
    throw Error("unit:" + unit_,
                key + "=" + *found + ", expected an integer from " + std::to_string(min) + " to " + std::to_string(max));
  }
  return *value;
}

bool Settings::boolean(const std::string& key, bool fallback) {
  const std::string* found = lookup(key);
  if (found == nullptr) return fallback;
  const auto value = text::parse_boolean(*found);
  if (!value) throw Error("unit:" + unit_, key + "=" + *found + ", expected true or false");
  return *value;
}

std::string Settings::choice(const std::string& key, const std::vector<std::string>& choices) {
  const std::string* found = lookup(key);
  if (found == nullptr) return choices.front();
  if (std::find(choices.begin(), choices.end(), *found) == choices.end()) {
    throw Error("unit:" + unit_, key + "=" + *found + ", expected one of " + joined(choices));
  }
  return *found;
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

fs::path Settings::robot_file(const std::string& key) {
  return robot_file(text(key), " (another robot: --set " + key + "=PATH.urdf)");
}

fs::path Settings::robot_file(const std::string& robot, const std::string& hint) {
  const bool is_path = robot.find('/') != std::string::npos || fs::path(robot).extension() == ".urdf";
  const fs::path found = file(is_path ? robot : "robots/" + robot + "/robot.urdf", hint);
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
    const std::string closest = text::closest(key, asked_);
    throw Error("unit:" + unit_, "no setting '" + key + "'" + (closest.empty() ? "" : "; did you mean '" + closest + "'?") +
                                     (asked_.empty() ? "; there is none" : "; there are " + joined(asked_)));
  }
}

}  // namespace cotwin
