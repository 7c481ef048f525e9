#pragma once
#include <cstddef>
#include <cstdint>
#include <string>

namespace cotwin::testing {

inline std::string big_endian(std::uint32_t value) {
  std::string bytes;
  for (int shift = 24; shift >= 0; shift -= 8) bytes += static_cast<char>(value >> shift & 255);
  return bytes;
}

/// A chunk of a PNG file with its length and CRC-32.
inline std::string png_chunk(const std::string& type, const std::string& data) {
  std::uint32_t crc = 0xFFFFFFFF;
  for (const char c : type + data) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (0xEDB88320 & (0 - (crc & 1)));
  }
  return big_endian(static_cast<std::uint32_t>(data.size())) + type + data + big_endian(~crc);
}

inline std::string png_header(std::uint32_t width, std::uint32_t height, int depth, int colour) {
  return "\x89PNG\r\n\x1A\n" + png_chunk("IHDR", big_endian(width) + big_endian(height) + static_cast<char>(depth) +
                                                     static_cast<char>(colour) + std::string(3, '\0'));
}

/// A PNG file (RFC 2083) without compression from rows of samples (their bytes, as stored). `colour`: 0 grey, 2 RGB, 3 palette,
/// 4 grey with alpha. `before`: chunks between the header and the pixels.
inline std::string png(std::uint32_t width, std::uint32_t height, int depth, int colour, const std::string& samples,
                       const std::string& before = "") {
  std::string rows;
  for (std::size_t y = 0; y < height; ++y) rows += '\0' + samples.substr(samples.size() / height * y, samples.size() / height);
  std::string stream = "\x78\x01";
  for (std::size_t at = 0; at < rows.size(); at += 65535) {
    const std::string block = rows.substr(at, 65535);
    const auto size = static_cast<std::uint16_t>(block.size()), check = static_cast<std::uint16_t>(~size);
    stream += at + block.size() == rows.size() ? '\1' : '\0';
    for (const std::uint16_t word : {size, check}) stream += {static_cast<char>(word & 255), static_cast<char>(word >> 8)};
    stream += block;
  }
  std::uint32_t a = 1, b = 0;
  for (const char c : rows) a = (a + static_cast<unsigned char>(c)) % 65521, b = (b + a) % 65521;
  return png_header(width, height, depth, colour) + before + png_chunk("IDAT", stream + big_endian(b << 16 | a)) +
         png_chunk("IEND", "");
}

/// A greyscale image of 16 bit of pixel(column, row), row 0 at the top.
template <class Pixel>
std::string grey_png(int width, int height, const Pixel& pixel) {
  std::string samples;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) samples += big_endian(static_cast<std::uint32_t>(pixel(x, y))).substr(2);
  }
  return png(static_cast<std::uint32_t>(width), static_cast<std::uint32_t>(height), 16, 0, samples);
}

}  // namespace cotwin::testing
