#include "fmu/archive/file_kind.h"

#include <algorithm>
#include <array>
#include <string>

#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"

namespace cotwin::fmu {

bool is_archive(const std::filesystem::path& file) {
  std::array<char, 4> begin{};
  try {
    const text::File in = text::open_file(file, "an archive");
    if (std::fread(begin.data(), 1, begin.size(), in.get()) != begin.size()) return false;
  } catch (const Error&) {  // reported by the code that reads the file later
    return false;
  }
  return std::string_view(begin.data(), begin.size()) == "PK\x03\x04";
}

bool has_ending(const std::filesystem::path& file, std::string_view ending) {
  const std::string own = file.extension().string();
  const auto small = [](char c) { return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c; };
  return std::ranges::equal(own, ending, {}, small, small);
}

}  // namespace cotwin::fmu
