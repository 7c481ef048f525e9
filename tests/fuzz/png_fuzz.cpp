// Any bytes are a greyscale image or an Error.
#include <cstdint>
#include <cstdlib>
#include <string_view>

#include "models/foundation/support/error.h"
#include "models/scene/png.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace cotwin;
  try {
    const scene::GreyImage image = scene::parse_png({reinterpret_cast<const char*>(data), size}, "image", 10'000);
    if (image.pixels.empty() || image.pixels.size() != image.width * image.height) std::abort();
    for (const std::uint16_t pixel : image.pixels) {
      if (pixel > image.white) std::abort();
    }
  } catch (const Error& error) {
    if (!std::string_view(error.what()).starts_with("image")) std::abort();
  }
  return 0;
}
