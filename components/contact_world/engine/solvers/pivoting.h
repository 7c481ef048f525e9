#pragma once
#include <algorithm>
#include <cstdint>
#include <span>
#include <vector>

#include "components/contact_world/engine/solvers/incremental_ldl.h"

namespace cotwin::contact_world {

/// A and b of a BoxedProblem with a profile for each row.
struct BoxedSystem {
  const double* A = nullptr;
  const double* b = nullptr;
  const RowProfile* profile = nullptr;
  std::span<const int> pairs;
  std::uint64_t version = 0;
};

/// Dantzig's pivoting for constant bounds:  w = A x + b,  lo ≤ x ≤ hi;  w_i ≥ 0 where x_i = lo_i, ≤ 0 where x_i = hi_i, 0
/// between. Friction cones: dantzig.h. Usage: begin(), set x, lo and hi, solve().
class Pivoting {
 public:
  void reserve(int n);
  /// Starts a problem of n rows; x, lo, hi and w have n unspecified elements. tolerance, pivot_tolerance: Dantzig::Options.
  void begin(int n, double tolerance, double pivot_tolerance);

  std::vector<double> x, lo, hi;  // n; lo ≤ hi
  std::vector<double> w;          // n; after solve()

  /// Starts from x clamped to its bounds; the rows strictly inside them form the first basis. Returns false after `limit`
  /// pivots since begin(), with the best x so far. May be called again with changed A, b, x, lo, hi.
  bool solve(const BoxedSystem& system, int limit);

  enum class State : char { kFree, kLow, kHigh, kFixed, kParked, kContradicting };
  State state(int i) const { return state_[static_cast<std::size_t>(i)]; }
  /// Violation of row i's condition, in the measure of w.
  double violation(int i) const;
  /// Largest |w_i| that counts as zero.
  double zero(int i) const { return zero_[static_cast<std::size_t>(i)]; }
  int pivots() const { return pivots_; }
  int count(State state) const;
  const IncrementalLdl& basis() const { return ldl_; }

 private:
  double pivot(int i) { return ldl_.pivot(i, row(i), row(i)[i], system_.profile[i]); }
  const double* row(int i) const { return system_.A + static_cast<std::size_t>(i) * static_cast<std::size_t>(n_); }
  double least_pivot(int i) const { return std::max(pivot_tolerance_ * row(i)[i], noise_); }
  void measure();
  void find_basis();
  void factor();
  void evaluate();
  void add_column(int j, double dx);
  bool settle();
  bool enter(int i);
  int next() const;
  int blocking(const double* dx, double& length) const;
  void add_columns(const double* dx);
  void to_bound(int i, bool high);
  void leave(int i) {
    ldl_.remove(i);
    version_ = 0;
  }

  int n_ = 0, limit_ = 0, pivots_ = 0, stalls_ = 0, changes_ = 0;
  BoxedSystem system_;
  double tolerance_ = 0, pivot_tolerance_ = 0, noise_ = 0, b_scale_ = 0;
  std::vector<double> zero_, scale_, dx_;
  std::vector<int> in_basis_;  // rows in the basis per pair of bodies
  std::vector<State> state_;
  std::vector<State> factored_;  // state_ at the time of the factorisation
  std::uint64_t version_ = 0;    // of A at that time; 0: unknown, or rows have entered or left since
  IncrementalLdl ldl_;
};

}  // namespace cotwin::contact_world
