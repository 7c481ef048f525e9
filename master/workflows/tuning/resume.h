#pragma once
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

#include "master/workflows/tuning/settings.h"

namespace cotwin::master::tuning {

/// The state of a stopped tuning: its settings, and the saved swarm (identification::SwarmSearch::save).
struct Resume {
  Settings settings;
  std::vector<std::uintmax_t> file_sizes;  // bytes, of data and held_out, to detect changed logs
  std::string swarm;
  std::string program = {};              // that wrote it; another one gives other bits
  std::vector<std::string> hashes = {};  // of the robot, data and held_out
};

std::string to_text(const Resume& resume);
/// Throws Error `place: …` for text that to_text() did not write.
Resume parse_resume(std::string_view text, const std::string& place);

void save_resume(const std::filesystem::path& file, const Resume& resume);
/// Throws Error also if the robot or the log have changed.
Resume load_resume(const std::filesystem::path& file);
std::vector<std::uintmax_t> file_sizes(const Settings& settings);
std::vector<std::string> file_hashes(const Settings& settings);

}  // namespace cotwin::master::tuning
