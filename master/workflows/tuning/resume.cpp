#include "master/workflows/tuning/resume.h"

#include <iterator>
#include <nlohmann/json.hpp>
#include <system_error>

#include "master/workflows/tuning/files.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/file_hash.h"

namespace cotwin::master::tuning {

namespace fs = std::filesystem;
using nlohmann::json;

namespace {

constexpr const char* kFormat = "cotwin tuning 2";

std::string to_hex(std::string_view bytes) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string text;
  text.reserve(2 * bytes.size());
  for (const char c : bytes) {
    const auto byte = static_cast<unsigned char>(c);
    text += kDigits[byte >> 4];
    text += kDigits[byte & 15];
  }
  return text;
}

std::string from_hex(const std::string& text, const std::string& place) {
  const auto digit = [&](char c) -> unsigned {
    if (c >= '0' && c <= '9') return static_cast<unsigned>(c - '0');
    if (c >= 'a' && c <= 'f') return static_cast<unsigned>(c - 'a' + 10);
    throw Error(place, "'swarm' is no text of hexadecimal digits");
  };
  if (text.size() % 2 != 0) throw Error(place, "'swarm' ends within a byte");
  std::string bytes(text.size() / 2, '\0');
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(digit(text[2 * i]) << 4 | digit(text[2 * i + 1]));
  return bytes;
}

}  // namespace

std::string to_text(const Resume& resume) {
  json object;
  object["format"] = kFormat;
  object["settings"] = to_json(resume.settings);
  object["file_sizes"] = resume.file_sizes;
  object["program"] = resume.program;
  object["hashes"] = resume.hashes;
  object["swarm"] = to_hex(resume.swarm);
  return object.dump(1) + "\n";
}

Resume parse_resume(std::string_view text, const std::string& place) {
  const json object = json::parse(text, nullptr, false);
  if (object.is_discarded() || !object.is_object())
    throw Error(place, "is no JSON object, expected what a stopped tuning left");
  if (!object.contains("format") || object["format"] != kFormat)
    throw Error(place, std::string("has another format, expected '") + kFormat + "'");
  Resume resume;
  if (!object.contains("settings") || !object.contains("swarm") || !object["swarm"].is_string() ||
      !object.contains("file_sizes") || !object["file_sizes"].is_array())
    throw Error(place, "lacks 'settings', 'file_sizes' or 'swarm'");
  resume.settings = settings_from_json(object["settings"], place + ": settings");
  for (const json& size : object["file_sizes"]) {
    if (!size.is_number_unsigned())
      throw Error(place, "'file_sizes' holds " + std::string(size.type_name()) + ", expected sizes in bytes");
    resume.file_sizes.push_back(size.get<std::uintmax_t>());
  }
  if (!object.contains("program") || !object["program"].is_string() || !object.contains("hashes") ||
      !object["hashes"].is_array())
    throw Error(place, "lacks 'program' or 'hashes'");
  resume.program = object["program"].get<std::string>();
  for (const json& hash : object["hashes"]) {
    if (!hash.is_string()) throw Error(place, "'hashes' holds " + std::string(hash.type_name()) + ", expected text");
    resume.hashes.push_back(hash.get<std::string>());
  }
  resume.swarm = from_hex(object["swarm"].get<std::string>(), place);
  return resume;
}

std::vector<std::uintmax_t> file_sizes(const Settings& settings) {
  std::vector<std::uintmax_t> sizes;
  for (const auto* files : {&settings.data, &settings.held_out}) {
    for (const fs::path& file : *files) {
      std::error_code error, none;
      const bool is_folder = fs::is_directory(file, none);
      std::uintmax_t size = is_folder ? 0 : fs::file_size(file, error);
      for (const fs::directory_entry& part : is_folder ? fs::directory_iterator(file, error) : fs::directory_iterator())
        size += part.is_regular_file(none) ? part.file_size(error) : 0;
      if (error) throw Error(file.string(), "cannot be opened, expected a log (CSV, ROS bag)");
      sizes.push_back(size);
    }
  }
  return sizes;
}

std::vector<std::string> file_hashes(const Settings& settings) {
  std::vector<std::string> hashes = {hexadecimal(hash_of_file(settings.robot))};
  for (const auto* files : {&settings.data, &settings.held_out}) {
    for (const fs::path& file : *files) hashes.push_back(hexadecimal(hash_of_file(file)));
  }
  return hashes;
}

void save_resume(const fs::path& file, const Resume& resume) { write_file(file, to_text(resume)); }

Resume load_resume(const fs::path& file) {
  Resume resume = parse_resume(text::read_file(file, "what a stopped tuning left there"), file.string());
  if (file_sizes(resume.settings) != resume.file_sizes)
    throw Error(file.string(), "the log has changed since the tuning stopped, expected the same files");
  if (file_hashes(resume.settings) != resume.hashes)
    throw Error(file.string(), "the robot or the log has changed since the tuning stopped, expected the same files");
  return resume;
}

}  // namespace cotwin::master::tuning
