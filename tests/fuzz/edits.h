#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

/// Byte strings that are protected by a hash: a fuzzer that changes bytes would never pass the check. So its input is taken as
/// edits of valid strings, and the hash is computed afterwards.
namespace cotwin::fuzz {

/// `good` with edits of three bytes each: place (two) and value; a place beyond the end cuts the string there modulo its
/// length.
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
