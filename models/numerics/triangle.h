#pragma once
#include <cstddef>
#include <vector>

#include "models/foundation/support/bytes.h"

namespace cotwin::numerics {

/// A tall matrix A (N x p, N unbounded) compressed to the triangle R of its QR factorisation: RᵀR = Σ_s λ^(N−1−s) a_s a_sᵀ over
/// its rows a_s, with the forgetting factor λ (1: none). Rows are added in blocks by Householder reflections of [R; block]
/// (Golub and Van Loan, Matrix Computations, 4th ed., 5.2 and 6.5), which are backward stable, unlike sums of squares. Memory
/// and cost per row do not depend on N. With A = [X | y], all least-squares results follow from R: ‖X b − y‖² = ‖R [b; −1]‖².
/// Kernels for several instruction sets are chosen at run time (COTWIN_CPU, see models/robot/kernels/kernels.h). They agree to
/// rounding, and each gives the same bits for the same rows.
class Triangle {
 public:
  static constexpr std::size_t kRows = 64;  // of a block

  /// Throws Error unless columns >= 1 and 0 < forgetting <= 1.
  explicit Triangle(std::size_t columns, double forgetting = 1);

  std::size_t columns() const { return columns_; }
  /// Number of rows added, and their weight Σ λ^age.
  std::size_t rows() const { return rows_; }
  double weight() const;
  /// Rows in an incomplete block, less than kRows.
  std::size_t pending() const { return pending_; }

  /// Appends one row. Allocates nothing.
  void add(const double* row);
  /// Storage of the next row, to be written directly: column c at [c * kRows]; commit() adds it.
  double* next() { return block_.data() + pending_; }
  void commit();
  /// Adds the rows of `other`, with as many columns, as if they were older than those here. Without forgetting the order does
  /// not matter; with it, `other` is aged by the weight of the rows here.
  void merge(const Triangle& other);
  /// Adds an incomplete block to R.
  void flush();
  /// R, row-major (p x p, zero below the diagonal); diagonal elements may have either sign. Does not include an incomplete
  /// block: call flush() first.
  const double* R() const { return R_.data(); }
  double operator()(std::size_t row, std::size_t column) const { return R_[row * columns_ + column]; }

  /// Removes all rows. Allocates nothing.
  void clear();
  /// Appends the whole state, the rows of an incomplete block included.
  void write(ByteWriter& out) const;
  /// Continues from what a triangle of as many columns wrote, to the same bits. Allocates nothing. Throws Error at the place of
  /// `in` for numbers that are not finite and for impossible numbers of rows; then the content is unspecified.
  void read(ByteReader& in);

  friend bool operator==(const Triangle&, const Triangle&) = default;

 private:
  void age(std::size_t rows);

  std::size_t columns_;
  double forgetting_;
  std::size_t rows_ = 0;
  std::size_t pending_ = 0;    // rows in block_
  double weight_ = 0;          // of the rows in R_
  std::vector<double> R_;      // columns x columns, row-major
  std::vector<double> block_;  // columns x kRows, by column
};

}  // namespace cotwin::numerics
