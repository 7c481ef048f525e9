#pragma once
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace cotwin::fri {

/// Row k has the effect of a byte on the CRC-32 if k zero bytes follow it.
inline constexpr auto kCrcTable = [] {
  std::array<std::array<std::uint32_t, 256>, 4> table{};
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

/// CRC-32 of IEEE 802.3 and zlib: polynomial 0xEDB88320 (reflected), begins and ends with an inversion. Four bytes per step.
inline std::uint32_t crc32(std::span<const std::uint8_t> bytes) {
  std::uint32_t crc = 0xffffffff;
  std::size_t i = 0;
  for (; i + 4 <= bytes.size(); i += 4) {
    crc ^= static_cast<std::uint32_t>(bytes[i]) | static_cast<std::uint32_t>(bytes[i + 1]) << 8 |
           static_cast<std::uint32_t>(bytes[i + 2]) << 16 | static_cast<std::uint32_t>(bytes[i + 3]) << 24;
    crc = kCrcTable[3][crc & 0xff] ^ kCrcTable[2][crc >> 8 & 0xff] ^ kCrcTable[1][crc >> 16 & 0xff] ^ kCrcTable[0][crc >> 24];
  }
  for (; i < bytes.size(); ++i) crc = crc >> 8 ^ kCrcTable[0][(crc ^ bytes[i]) & 0xff];
  return ~crc;
}

}  // namespace cotwin::fri
