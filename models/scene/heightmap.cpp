#include "models/scene/heightmap.h"

#include <algorithm>
#include <memory>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

Shape heightmap_shape(GreyImage image, const Heightmap& map) {
  constexpr double kLargest = 1e9;  // m
  if (!(map.size.x() > 0 && map.size.y() > 0 && map.size.z() >= 0 && map.size.maxCoeff() <= kLargest))
    throw Error("size " + text::to_text(map.size.x(), 6) + " " + text::to_text(map.size.y(), 6) + " " +
                text::to_text(map.size.z(), 6) + " m, expected > 0 along x and y, ≥ 0 along z, and ≤ 1e9");
  const int brightest = image.pixels.empty() ? 0 : *std::max_element(image.pixels.begin(), image.pixels.end());
  const auto cell = [&](double size, std::size_t pixels) {
    return size / static_cast<double>(std::max<std::size_t>((std::max<std::size_t>(pixels, 2) - 1) * map.sampling, 1));
  };
  HeightField::Image ground;
  ground.width = image.width;
  ground.height = image.height;
  ground.grey = std::move(image.pixels);
  ground.sampling = map.sampling;
  ground.dx = cell(map.size.x(), image.width);
  ground.dy = cell(map.size.y(), image.height);
  ground.step = brightest > 0 ? map.size.z() / brightest : 0;
  Shape shape;
  shape.type = ShapeType::kHeightmap;
  shape.heights.field = std::make_shared<const HeightField>(std::move(ground));
  shape.X_BS.p = map.pos;
  return shape;
}

}  // namespace cotwin::scene
