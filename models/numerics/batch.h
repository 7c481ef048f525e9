#pragma once
#include <cstddef>
#include <vector>

namespace cotwin::numerics {

/// A constant matrix laid out to be multiplied with eight columns at once, one per lane of a block of particles.
class BatchMatrix {
 public:
  static constexpr std::size_t kLanes = 8;

  BatchMatrix() = default;
  /// `A` row-major (rows x columns); leading zeros of rows, as of a triangle, are skipped by eights.
  BatchMatrix(std::size_t rows, std::size_t columns, const double* A);

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  /// Doubles that `y` must have room for: rows rounded up to eights, times eight.
  std::size_t room() const { return (rows_ + 7) / 8 * 8 * kLanes; }
  /// y = A x: coordinate c of lane k at x[c * stride + k], row r of lane k at y[r * 8 + k].
  void times(const double* x, std::size_t stride, double* y) const;

 private:
  std::size_t rows_ = 0, columns_ = 0;
  std::vector<double> packed_;
  std::vector<std::size_t> first_;
};

}  // namespace cotwin::numerics
