#include "models/numerics/batch.h"

#include <algorithm>
#include <cstring>

#include "models/numerics/kernels/kernels.h"

namespace cotwin::numerics {

BatchMatrix::BatchMatrix(std::size_t rows, std::size_t columns, const double* A)
    : rows_(rows), columns_(columns), packed_((rows + 7) / 8 * 8 * columns, 0.0), first_((rows + 7) / 8, columns) {
  for (std::size_t r = 0; r < rows; ++r)
    for (std::size_t c = 0; c < columns; ++c) {
      packed_[(r / 8 * columns + c) * 8 + r % 8] = A[r * columns + c];
      if (A[r * columns + c] != 0) first_[r / 8] = std::min(first_[r / 8], c);
    }
}

void BatchMatrix::times(const double* x, std::size_t stride, double* y) const {
  kernels().times(rows_, columns_, packed_.data(), first_.data(), x, stride, y);
}

void combine(std::size_t rows, std::size_t columns, std::size_t count, const double* X, const double* A, std::size_t stride,
             double* y) {
  kernels().combine(rows, columns, count, X, A, stride, y);
}

LaneRange range_of(std::size_t rows, std::size_t step, const double* y) {
  static_assert(sizeof(LaneRange) == 4 * BatchMatrix::kLanes * sizeof(double));
  LaneRange range;
  std::array<double, 4 * BatchMatrix::kLanes> all;
  kernels().range(rows, step, y, all.data());
  std::memcpy(&range, all.data(), sizeof range);
  return range;
}

void add_moments(std::size_t rows, std::size_t count, const double* w, const double* y, double* squares, double* most) {
  kernels().moments(rows, count, w, y, squares, most);
}

}  // namespace cotwin::numerics
