#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

/// Byte strings that are guarded by a hash: a fuzzer that only sees bytes never gets past it. So its input is read as edits of
/// good ones, made behind the hash.
namespace cotwin::fuzz {

/// `good` with edits: three bytes each, place (two) and value; a place beyond the end cuts the string there modulo its length.
inline std::string edited(std::string good, const std::uint8_t* data, std::size_t size) {
  for (std::size_t i = 0; i + 2 < size && !good.empty(); i += 3) {
    const std::size_t place = static_cast<std::size_t>(data[i]) << 8 | data[i + 1];
    if (place < good.size()) {
      good[place] = static_cast<char>(data[i + 2]);
    } else if (place >= 0xff00) {
      good.resize(place % good.size());
    } else {
      good[place % good.size()] = static_cast<char>(data[i + 2]);
    }
  }
  return good;
}

}  // namespace cotwin::fuzz
