#include "models/scene/png.h"

#include <png.h>

#include <algorithm>
#include <csetjmp>
#include <cstring>

#include "models/foundation/support/error.h"

namespace cotwin::scene {

namespace {

/// libpng's reader, and what its callbacks use. libpng reports errors by longjmp.
struct Decoder {
  std::string_view rest;
  std::string fault;
  png_structp png = nullptr;
  png_infop info = nullptr;
  std::size_t channels = 0, depth = 0;
  std::vector<png_byte> bytes;
  std::vector<png_bytep> rows;

  explicit Decoder(std::string_view all) : rest(all) {
    png = png_create_read_struct(PNG_LIBPNG_VER_STRING, this, on_error, on_warning);
    if (png != nullptr) info = png_create_info_struct(png);
    if (info == nullptr) throw Error("libpng: no memory");
    png_set_read_fn(png, this, read);
  }
  ~Decoder() { png_destroy_read_struct(&png, &info, nullptr); }
  Decoder(const Decoder&) = delete;
  Decoder& operator=(const Decoder&) = delete;

  static void on_error(png_structp from, png_const_charp message) {
    static_cast<Decoder*>(png_get_error_ptr(from))->fault = message;
    png_longjmp(from, 1);
  }
  static void on_warning(png_structp, png_const_charp) {}
  static void read(png_structp from, png_bytep to, std::size_t count) {
    auto& self = *static_cast<Decoder*>(png_get_io_ptr(from));
    if (count > self.rest.size()) png_error(from, "the file ends too early");
    std::memcpy(to, self.rest.data(), count);
    self.rest.remove_prefix(count);
  }

  // The functions with setjmp have no objects with destructors, which a longjmp would skip. False: `fault` says why.
  bool read_header();
  bool prepare();
  bool read_pixels();
};

bool Decoder::read_header() {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_info(png, info);
  return true;
}

bool Decoder::prepare() {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  const png_byte type = png_get_color_type(png, info);
  if (type == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png);
  if (type == PNG_COLOR_TYPE_GRAY) png_set_expand_gray_1_2_4_to_8(png);
  png_set_strip_alpha(png);
  png_set_interlace_handling(png);
  png_read_update_info(png, info);
  channels = png_get_channels(png, info);
  depth = png_get_bit_depth(png, info);
  return true;
}

bool Decoder::read_pixels() {
  if (setjmp(png_jmpbuf(png)) != 0) return false;
  png_read_image(png, rows.data());
  png_read_end(png, nullptr);
  return true;
}

}  // namespace

GreyImage parse_png(std::string_view bytes, const std::string& place, std::size_t most_pixels) {
  constexpr std::string_view kSignature = "\x89PNG\r\n\x1A\n";
  if (!bytes.starts_with(kSignature)) throw Error(place, "no PNG image, expected a greyscale PNG");
  Decoder decoder(bytes);
  const auto expect = [&](bool read) {
    if (!read) throw Error(place, "damaged: " + decoder.fault + ", expected a whole PNG image");
  };
  expect(decoder.read_header());
  GreyImage image;
  image.width = png_get_image_width(decoder.png, decoder.info);
  image.height = png_get_image_height(decoder.png, decoder.info);
  if (image.width > most_pixels / image.height) {
    throw Error(place, std::to_string(image.width) + " × " + std::to_string(image.height) + " pixels, expected " +
                           std::to_string(most_pixels) + " pixels at most: scale the image down");
  }
  expect(decoder.prepare());
  const std::size_t wide = decoder.depth / 8, row = png_get_rowbytes(decoder.png, decoder.info);
  image.white = wide == 2 ? 65535 : 255;
  decoder.bytes.resize(row * image.height);
  for (std::size_t y = 0; y < image.height; ++y) decoder.rows.push_back(decoder.bytes.data() + y * row);
  expect(decoder.read_pixels());
  image.pixels.reserve(image.width * image.height);
  for (std::size_t y = 0; y < image.height; ++y) {
    for (std::size_t x = 0; x < image.width; ++x) {
      const png_byte* pixel = decoder.rows[y] + x * wide * decoder.channels;
      for (std::size_t c = 1; c < decoder.channels; ++c) {
        if (!std::equal(pixel, pixel + wide, pixel + c * wide)) {
          throw Error(place, "the pixel in column " + std::to_string(x + 1) + ", row " + std::to_string(y + 1) +
                                 " is coloured, expected grey pixels");
        }
      }
      image.pixels.push_back(static_cast<std::uint16_t>(wide == 2 ? pixel[0] << 8 | pixel[1] : pixel[0]));
    }
  }
  return image;
}

}  // namespace cotwin::scene
