#include "fmu/file_kind.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <string>

namespace cotwin::fmu {

bool is_archive(const std::filesystem::path& file) {
  std::error_code none;
  if (!std::filesystem::is_regular_file(file, none)) return false;  // a pipe is read only once
  std::array<char, 4> begin{};
  std::ifstream(file, std::ios::binary).read(begin.data(), begin.size());
  return std::string_view(begin.data(), begin.size()) == "PK\x03\x04";
}

bool has_ending(const std::filesystem::path& file, std::string_view ending) {
  const std::string own = file.extension().string();
  const auto small = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::ranges::equal(own, ending, {}, small, small);
}

}  // namespace cotwin::fmu
