#include "models/scene/height_field.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::scene {

using Eigen::Vector3d;

HeightField::HeightField(Image image) : image_(std::move(image)) {
  const std::string pixels = std::to_string(image_.width) + " × " + std::to_string(image_.height) + " pixels";
  if (image_.width < 2 || image_.height < 2) throw Error(pixels + ", expected 2 × 2 at least");
  if (image_.sampling < 1 || image_.sampling > kMostTriangles)
    throw Error("sampling " + std::to_string(image_.sampling) + ", expected 1 or more");
  const double triangles = 2 * static_cast<double>(image_.width - 1) * static_cast<double>(image_.height - 1) *
                           static_cast<double>(image_.sampling) * static_cast<double>(image_.sampling);
  if (triangles > static_cast<double>(kMostTriangles)) {
    throw Error(pixels + " at sampling " + std::to_string(image_.sampling) + " are " + text::to_text(triangles, 12) +
                " triangles, expected " + std::to_string(kMostTriangles) +
                " at most (4097 × 4097 pixels): scale the image down");
  }
  if (image_.grey.size() != image_.width * image_.height)
    throw Error(pixels + " with " + std::to_string(image_.grey.size()) + " grey values");
  const auto is_length = [](double x) { return x > 0 && std::isfinite(x); };
  if (!is_length(image_.dx) || !is_length(image_.dy) || !(image_.step >= 0 && std::isfinite(image_.step)))
    throw Error("cells of " + text::to_text(image_.dx, 6) + " × " + text::to_text(image_.dy, 6) + " m with " +
                text::to_text(image_.step, 6) + " m per grey value, expected > 0, > 0 and ≥ 0");

  columns_ = (image_.width - 1) * image_.sampling;
  rows_ = (image_.height - 1) * image_.sampling;
  tiles_along_ = (image_.width - 2) / kTile + 1;
  tiles_across_ = (image_.height - 2) / kTile + 1;
  tiles_.reserve(tiles_along_ * tiles_across_);
  for (std::size_t b = 0; b < tiles_across_; ++b) {
    for (std::size_t a = 0; a < tiles_along_; ++a) {
      Tile tile{65535, 0};
      for (std::size_t row = b * kTile; row <= std::min((b + 1) * kTile, image_.height - 1); ++row) {
        const auto first =
            image_.grey.begin() + static_cast<std::ptrdiff_t>((image_.height - 1 - row) * image_.width + a * kTile);
        const std::size_t count = std::min(kTile, image_.width - 1 - a * kTile) + 1;
        const auto [low, high] = std::minmax_element(first, first + static_cast<std::ptrdiff_t>(count));
        tile.low = std::min(tile.low, *low);
        tile.high = std::max(tile.high, *high);
      }
      tiles_.push_back(tile);
    }
  }
  const auto by_low = [](const Tile& s, const Tile& t) { return s.low < t.low; };
  const auto by_high = [](const Tile& s, const Tile& t) { return s.high < t.high; };
  low_ = std::min_element(tiles_.begin(), tiles_.end(), by_low)->low * image_.step;
  high_ = std::max_element(tiles_.begin(), tiles_.end(), by_high)->high * image_.step;
  constexpr double kDeepest = 32, kOfSize = 0.1;  // cells; of the field's diagonal
  const Vector3d size(image_.dx * static_cast<double>(columns_), image_.dy * static_cast<double>(rows_), high_ - low_);
  depth_ = std::min(kDeepest * std::min(image_.dx, image_.dy), kOfSize * size.norm());
}

double HeightField::high_of_tile(std::size_t column, std::size_t row) const {
  return image_.step * tiles_[row / tile_cells() * tiles_along_ + column / tile_cells()].high;
}

double HeightField::bottom(std::size_t column, std::size_t row) const {
  const std::size_t a = column / tile_cells(), b = row / tile_cells();
  std::uint16_t low = 65535;
  for (std::size_t y = b - std::min<std::size_t>(b, 1); y <= std::min(b + 1, tiles_across_ - 1); ++y) {
    for (std::size_t x = a - std::min<std::size_t>(a, 1); x <= std::min(a + 1, tiles_along_ - 1); ++x)
      low = std::min(low, tiles_[y * tiles_along_ + x].low);
  }
  return image_.step * low - depth_;
}

double HeightField::height(std::size_t column, std::size_t row) const {
  if (image_.sampling == 1) return image_.step * grey(column, row);
  const std::size_t n = image_.sampling;
  const std::size_t i = std::min(column / n, image_.width - 2), j = std::min(row / n, image_.height - 2);
  const double a = static_cast<double>(column - i * n) / static_cast<double>(n);
  const double b = static_cast<double>(row - j * n) / static_cast<double>(n);
  const double lower = (1 - a) * grey(i, j) + a * grey(i + 1, j), upper = (1 - a) * grey(i, j + 1) + a * grey(i + 1, j + 1);
  return image_.step * ((1 - b) * lower + b * upper);
}

Vector3d HeightField::node(std::size_t column, std::size_t row) const {
  const auto from_middle = [](std::size_t k, std::size_t count) {
    return static_cast<double>(k) - static_cast<double>(count) / 2;
  };
  return {image_.dx * from_middle(column, columns_), image_.dy * from_middle(row, rows_), height(column, row)};
}

HeightField::Triangle HeightField::triangle(std::size_t number) const {
  const std::size_t cell = number / 2, i = cell % columns_, j = cell / columns_;
  Triangle t;
  const auto set = [&](std::size_t k, const Vector3d& corner, bool border, std::size_t column, std::size_t row) {
    t.corners[k] = corner;
    t.border[k] = border;
    t.beyond[k] = border ? Vector3d::Zero() : node(column, row);
  };
  if (number % 2 == 0) {
    set(0, node(i, j), j == 0, i, j - 1);
    set(1, node(i + 1, j), i + 1 == columns_, i + 2, j + 1);
    set(2, node(i + 1, j + 1), false, i, j + 1);
  } else {
    set(0, node(i, j), false, i + 1, j);
    set(1, node(i + 1, j + 1), j + 1 == rows_, i + 1, j + 2);
    set(2, node(i, j + 1), i == 0, i - 1, j);
  }
  return t;
}

std::vector<Vector3d> HeightField::coarse_triangles(std::size_t most_cells) const {
  const auto nodes = [&](std::size_t cells) {
    std::vector<std::size_t> taken;
    for (std::size_t k = 0; k < cells; k += (cells - 1) / most_cells + 1) taken.push_back(k);
    taken.push_back(cells);
    return taken;
  };
  const std::vector<std::size_t> columns = nodes(columns_), rows = nodes(rows_);
  std::vector<Vector3d> corners;
  for (std::size_t j = 0; j + 1 < rows.size(); ++j) {
    for (std::size_t i = 0; i + 1 < columns.size(); ++i) {
      const Vector3d lower_left = node(columns[i], rows[j]), upper_right = node(columns[i + 1], rows[j + 1]);
      corners.insert(corners.end(), {lower_left, node(columns[i + 1], rows[j]), upper_right});
      corners.insert(corners.end(), {lower_left, upper_right, node(columns[i], rows[j + 1])});
    }
  }
  return corners;
}

}  // namespace cotwin::scene
