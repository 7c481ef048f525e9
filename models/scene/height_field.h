#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

namespace cotwin::scene {

/// Ground as heights above a grid, with solid below it: about 2 bytes per grey value. The frame's origin is in the middle of the
/// grid at the height of black; columns of the grid lie along x, rows along y.
class HeightField {
 public:
  /// Grey values of an image, row by row from the largest y to the smallest.
  struct Image {
    std::size_t width = 0, height = 0;
    std::vector<std::uint16_t> grey;
    std::size_t sampling = 1;  // cells between two pixels, linearly interpolated
    double dx = 0, dy = 0;     // of a cell, m
    double step = 0;           // height of a grey value of 1, m

    friend bool operator==(const Image&, const Image&) = default;
  };
  /// A triangle of the surface: corners counter-clockwise seen from above.
  struct Triangle {
    std::array<Eigen::Vector3d, 3> corners;
    /// For the edge from corner k to the next: a corner of the neighbour's that is not on the edge, unless it is the border.
    std::array<Eigen::Vector3d, 3> beyond;
    std::array<bool, 3> border{};
  };

  HeightField() = default;
  /// Throws Error unless the image has 2 × 2 pixels or more, as many grey values, sampling ≥ 1, lengths > 0, a step ≥ 0, and
  /// kMostTriangles at most.
  explicit HeightField(Image image);

  /// 4097 × 4097 nodes. Indices of triangles and of their features fit into 30 bits.
  static constexpr std::size_t kMostTriangles = std::size_t{2} * 4096 * 4096;

  const Image& image() const { return image_; }
  std::size_t columns() const { return columns_; }  // of cells
  std::size_t rows() const { return rows_; }
  double dx() const { return image_.dx; }
  double dy() const { return image_.dy; }
  double low() const { return low_; }  // of the whole field, m
  double high() const { return high_; }

  /// Node of the grid, column 0 at the smallest x, row 0 at the smallest y.
  Eigen::Vector3d node(std::size_t column, std::size_t row) const;
  /// Each cell has two triangles: number 2 (row × columns + column), at its right and lower border, and the one after it.
  std::size_t triangles() const { return 2 * columns_ * rows_; }
  Triangle triangle(std::size_t number) const;

  /// Corners of triangles, three by three, for pictures: of every so many nodes, so that there are `most_cells` at most along a side.
  std::vector<Eigen::Vector3d> coarse_triangles(std::size_t most_cells) const;

  /// Heights are known by tiles of kTile × kTile pixels.
  static constexpr std::size_t kTile = 16;
  std::size_t tile_cells() const { return kTile * image_.sampling; }  // cells along a tile
  double high_of_tile(std::size_t column, std::size_t row) const;     // highest node of a cell's tile, m
  /// Where the solid below a cell ends: depth() below the lowest node of its tile and the tiles around it.
  double bottom(std::size_t column, std::size_t row) const;
  double depth() const { return depth_; }  // 32 cells, at most a tenth of the field's size, m

  friend bool operator==(const HeightField& a, const HeightField& b) { return a.image_ == b.image_; }

 private:
  struct Tile {
    std::uint16_t low = 0, high = 0;
  };
  double grey(std::size_t column, std::size_t row) const {
    return image_.grey[(image_.height - 1 - row) * image_.width + column];
  }
  double height(std::size_t column, std::size_t row) const;

  Image image_;
  std::size_t columns_ = 0, rows_ = 0, tiles_along_ = 0, tiles_across_ = 0;
  double low_ = 0, high_ = 0, depth_ = 0;
  std::vector<Tile> tiles_;
};

/// A height field that shapes share, because it may be large. Equal if the fields are.
struct SharedField {
  std::shared_ptr<const HeightField> field;

  const HeightField& operator*() const { return *field; }
  const HeightField* operator->() const { return field.get(); }
  explicit operator bool() const { return field != nullptr; }
  friend bool operator==(const SharedField& a, const SharedField& b) {
    return a.field == b.field || (a.field && b.field && *a.field == *b.field);
  }
};

}  // namespace cotwin::scene
