#pragma once
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace cotwin::scene {

/// A greyscale image. Rows from top to bottom, each from left to right.
struct GreyImage {
  std::size_t width = 0, height = 0;
  std::vector<std::uint16_t> pixels;  // as stored, without gamma correction
  std::uint16_t white = 255;          // the largest value that the file's depth allows: 255 or 65535
};

/// Decodes a PNG of any depth (1, 2 and 4 bit become 8) by libpng. Colour and palette images are read if all their pixels are
/// grey; an alpha channel is ignored. `place`: the file's name in messages. Throws Error `place: …` for other formats, coloured
/// pixels, damaged files and more than `most_pixels`, before they take memory; in a build without libpng for every file.
GreyImage parse_png(std::string_view bytes, const std::string& place, std::size_t most_pixels);

}  // namespace cotwin::scene
