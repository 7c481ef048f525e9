#pragma once
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/support/places.h"
#include "tests/support/public_data.h"

/// Captures of real EtherCAT buses (places::public_data).
namespace cotwin::ethercat {

struct Captured {
  std::uint64_t time = 0;  // in the resolution of the interface
  std::vector<std::uint8_t> frame;

  bool is_ethercat() const { return frame.size() > 14 && frame[12] == 0x88 && frame[13] == 0xa4; }
  /// Whether a slave has passed the frame on: the bit of locally administered addresses is set in the source.
  bool returned() const { return (frame[6] & 2) != 0; }
};

inline std::string captures_folder() { return places::public_data("captures"); }

inline std::vector<std::uint8_t> file_bytes(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// The packets of a pcapng file (its enhanced packet blocks), little-endian.
inline std::vector<Captured> read_pcapng(const std::string& path) {
  const std::vector<std::uint8_t> bytes = file_bytes(path);
  const auto word = [&](std::size_t at) {
    std::uint32_t v;
    std::memcpy(&v, &bytes[at], 4);
    return v;
  };
  std::vector<Captured> packets;
  for (std::size_t at = 0; at + 12 <= bytes.size(); at += word(at + 4)) {
    if (word(at) != 6) continue;
    const auto begin = bytes.begin() + static_cast<std::ptrdiff_t>(at + 28);
    packets.push_back({std::uint64_t{word(at + 12)} << 32 | word(at + 16), {begin, begin + word(at + 20)}});
  }
  return packets;
}

}  // namespace cotwin::ethercat
