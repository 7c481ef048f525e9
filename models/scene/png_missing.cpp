// parse_png() of a build without libpng.
#include "models/foundation/support/error.h"
#include "models/scene/png.h"

namespace cotwin::scene {

GreyImage parse_png(std::string_view, const std::string& place, std::size_t) {
  throw Error(place, "an image, and this build has no libpng, expected a build with the package libpng-dev");
}

}  // namespace cotwin::scene
