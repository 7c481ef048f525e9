#pragma once
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>

namespace cotwin::fri {

static_assert(std::endian::native == std::endian::little, "words are read as they are in memory");

/// Row k has the effect of a byte on the CRC-32 if k zero bytes follow it.
inline constexpr auto kCrcTable = [] {
  std::array<std::array<std::uint32_t, 256>, 8> table{};
  for (std::uint32_t byte = 0; byte < 256; ++byte) {
    std::uint32_t crc = byte;
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (0xedb88320 & (0 - (crc & 1)));
    table[0][byte] = crc;
  }
  for (std::size_t row = 1; row < table.size(); ++row) {
    for (std::size_t byte = 0; byte < 256; ++byte) {
      table[row][byte] = table[row - 1][byte] >> 8 ^ table[0][table[row - 1][byte] & 0xff];
    }
  }
  return table;
}();

/// CRC-32 of IEEE 802.3 and zlib: polynomial 0xEDB88320 (reflected), begins and ends with an inversion. Eight bytes per step.
inline std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = 0xffffffff;
  std::size_t i = 0;
  for (; i + 8 <= bytes.size(); i += 8) {
    std::uint64_t word = 0;
    std::memcpy(&word, bytes.data() + i, sizeof word);
    word ^= crc;
    crc = 0;
    for (std::size_t k = 0; k < 8; ++k) crc ^= kCrcTable[7 - k][word >> 8 * k & 0xff];
  }
  for (; i < bytes.size(); ++i) crc = crc >> 8 ^ kCrcTable[0][(crc ^ bytes[i]) & 0xff];
  return ~crc;
}

}  // namespace cotwin::fri
