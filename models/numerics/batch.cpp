#include "models/numerics/batch.h"

#include <algorithm>

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

}  // namespace cotwin::numerics
