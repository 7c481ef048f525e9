#pragma once
#include <array>
#include <cstddef>
#include <vector>

namespace cotwin::numerics {

/// A constant matrix in a layout for the product with eight columns at once, one per lane of a block of particles.
class BatchMatrix {
 public:
  static constexpr std::size_t kLanes = 8;

  BatchMatrix() = default;
  /// `A` row-major (rows x columns). Leading zeros of rows, as in a triangle, are skipped in groups of eight.
  BatchMatrix(std::size_t rows, std::size_t columns, const double* A);

  std::size_t rows() const { return rows_; }
  std::size_t columns() const { return columns_; }
  /// Number of doubles of `y`: rows rounded up to a multiple of eight, times eight.
  std::size_t room() const { return (rows_ + 7) / 8 * 8 * kLanes; }
  /// y = A x: coordinate c of lane k at x[c * stride + k], row r of lane k at y[r * 8 + k].
  void times(const double* x, std::size_t stride, double* y) const;

 private:
  std::size_t rows_ = 0, columns_ = 0;
  std::vector<double> packed_;
  std::vector<std::size_t> first_;
};

/// y = X A: X rows x columns and y rows x count, row-major; row c of A at A[c * stride]. `count` is a multiple of eight.
void combine(std::size_t rows, std::size_t columns, std::size_t count, const double* X, const double* A, std::size_t stride,
             double* y);

/// Least and greatest values of eight lanes over rows, see range_of().
struct LaneRange {
  using Lanes = std::array<double, BatchMatrix::kLanes>;
  Lanes least, most;                // of all rows
  Lanes least_of_few, most_of_few;  // of every `step`-th row, beginning with the first
};
/// Row r of lane k at y[r * 8 + k]; rows, step ≥ 1.
LaneRange range_of(std::size_t rows, std::size_t step, const double* y);

/// Of each row of y (rows x count, row-major): adds Σ w y² to squares[r] and raises most[r] to max |y|. `count` is a multiple of
/// eight.
void add_moments(std::size_t rows, std::size_t count, const double* w, const double* y, double* squares, double* most);

}  // namespace cotwin::numerics
