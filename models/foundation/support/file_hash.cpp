#include "models/foundation/support/file_hash.h"

#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <vector>

#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/error.h"

namespace cotwin {

std::uint64_t hash_of_file(const std::filesystem::path& file) {
  std::error_code none;
  if (std::filesystem::is_directory(file, none)) {
    std::map<std::string, std::filesystem::path> parts;
    for (const auto& entry : std::filesystem::directory_iterator(file))
      if (entry.is_regular_file()) parts.emplace(entry.path().filename().string(), entry.path());
    std::uint64_t hash = parts.size();
    for (const auto& [name, part] : parts) hash = hash * 0x100000001b3u ^ hash_of_file(part);
    return hash;
  }
  std::ifstream in(file, std::ios::binary);
  if (!in) throw Error(file.string(), "cannot be read: " + system_reason(errno));
  std::vector<char> buffer(1u << 20);
  std::uint64_t hash = 0xcbf29ce484222325u;
  while (in) {
    in.read(buffer.data(), static_cast<std::streamsize>(buffer.size()));
    const auto n = static_cast<std::size_t>(in.gcount());
    std::memset(buffer.data() + n, 0, n % 8 == 0 ? 0 : 8 - n % 8);
    for (std::size_t i = 0; i < n; i += 8) {
      std::uint64_t word;
      std::memcpy(&word, buffer.data() + i, sizeof word);
      hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
      hash ^= hash >> 32;
    }
    hash += n;
  }
  if (in.bad()) throw Error(file.string(), "cannot be read: " + system_reason(errno));
  return hash;
}

std::string hexadecimal(std::uint64_t hash) {
  constexpr const char* kDigits = "0123456789abcdef";
  std::string digits;
  for (int shift = 60; shift >= 0; shift -= 4) digits += kDigits[(hash >> shift) & 15];
  return digits;
}

}  // namespace cotwin
