#pragma once
#include <limits>
#include <vector>

namespace cotwin::contact_world {

/// Columns begin … end − 1 of a matrix row; all other elements are zero and not read.
struct RowProfile {
  int begin = 0, end = std::numeric_limits<int>::max();
};

/// L D Lᵀ of the rows and columns F of a symmetric positive semidefinite matrix A, in the order of entry. A row enters or
/// leaves in O(m²) for m rows in F, less if L has leading zeros.
class IncrementalLdl {
 public:
  /// Allocates for matrices of up to n rows.
  void reserve(int n);
  /// Empties F; rows 0 … n−1 may enter.
  void clear(int n);

  int size() const { return m_; }
  int row(int position) const { return row_[static_cast<std::size_t>(position)]; }
  bool contains(int i) const { return position_[static_cast<std::size_t>(i)] >= 0; }
  int position(int i) const { return position_[static_cast<std::size_t>(i)]; }

  /// Pivot that row i would have on entry: A_ii − A_iF A_FF⁻¹ A_Fi. `a`: the whole row i of A; `diagonal`: A_ii.
  double pivot(int i, const double* a, double diagonal, RowProfile profile = {});
  /// z (m, by position) = A_FF⁻¹ A_Fi for the row of the last pivot() call.
  void column(double* z) const;
  /// Adds the row of the last pivot() call; its pivot must be positive.
  void append();
  void remove(int i);
  /// v (m, by position) := A_FF⁻¹ v
  void solve(double* v) const;

 private:
  double* L(int position) { return L_.data() + slot_[static_cast<std::size_t>(position)] * stride_; }
  const double* L(int position) const { return L_.data() + slot_[static_cast<std::size_t>(position)] * stride_; }

  int m_ = 0;
  int ascending_ = 0;  // number of leading positions with ascending rows
  std::size_t stride_ = 0;
  std::vector<double> L_;  // strictly lower part; one slot of `stride_` elements per row
  std::vector<double> d_, d_inverse_;
  std::vector<double> p_, beta_;   // work arrays of the rank-one update
  std::vector<int> first_;         // L(i, k) = 0 for k < first_[i]
  std::vector<int> row_;           // position -> row of A
  std::vector<int> position_;      // row of A -> position, or −1
  std::vector<std::size_t> slot_;  // position -> slot of L_
  int candidate_ = -1, candidate_first_ = 0;
  double candidate_d_ = 0;
};

}  // namespace cotwin::contact_world
