#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "components/contact_world/engine/solvers/pivoting.h"

namespace cotwin::contact_world {

/// Friction of one contact: rows t1 and t2, perpendicular to each other, are bounded by row `normal`:
///   |(x_t1, x_t2)| ≤ μ x_normal,  and where w_t ≠ 0:  x_t = −μ x_normal w_t / |w_t|   (Coulomb's exact cone)
struct FrictionCone {
  int normal = -1;
  int t1 = -1, t2 = -1;  // t2 = −1: friction in one direction
  double mu = 0;
};

/// The boxed linear complementarity problem with friction: find x and w with
///   w = A x + b,  lo ≤ x ≤ hi;  w_i ≥ 0 where x_i = lo_i,  ≤ 0 where x_i = hi_i,  0 between.
/// Two infinite bounds make an equality row. A may be singular; rows may be redundant or contradict each other.
struct BoxedProblem {
  int n = 0;
  const double* A = nullptr;            // n x n, row-major, symmetric, positive semidefinite
  const double* b = nullptr;            // n
  const double* lo = nullptr;           // n; ignored for friction rows
  const double* hi = nullptr;           // n
  std::span<const FrictionCone> cones;  // each row in at most one cone; lo of normal rows is ≥ 0
  std::span<const RowProfile> profile =
      {};                           // of A's n rows, within 0 … n: columns outside are 0 and not read; empty: A is full
  std::span<const int> pairs = {};  // per row: index of its pair of bodies; −1: unknown; empty: no pairs
  std::uint64_t version = 0;        // of A: equal to that of the last problem if A is the same to the bit; 0: unknown
};

/// Dantzig's pivoting: drives one violated row after the other to w = 0 while the rows solved before stay complementary
/// [Cottle, Dantzig 1968; Baraff 1994, section 4; the paper's second solver].
/// Differences from Baraff:
///  1. Any start x is allowed: the rows strictly inside their bounds form the first basis. A good start needs no pivots.
///  2. No pivot on a row that depends on the basis. If its w is 0, the row is parked: x stays as it is. Otherwise x moves along
///     the null direction until a basis row reaches its bound and leaves. If no row blocks, the rows contradict each other: the
///     row is left with w ≠ 0 and counted.
///  3. ½ xᵀAx + bᵀx never increases; after n steps without progress the lowest index enters and leaves, which excludes cycling
///     in degenerate problems.
///  4. Cones: for given normals, friction is a box whose first axis is rotated into the direction of x_t (the tangent plane of
///     the cone), with the curvature |w_t| / |x_t| on the diagonal of the second. Newton's iteration around the pivoting
///     updates the rotation and the bounds μ x_normal.
/// Costs O(n²) per pivot, less with a narrow profile (coupled rows near each other).
class Dantzig {
 public:
  struct Options {
    double tolerance = 1e-11;       // of w_i / √A_ii, relative to the largest |b_j| / √A_jj
    double pivot_tolerance = 1e-8;  // relative to A_ii: smaller pivots count as zero
    int pivots = 0;                 // largest number; 0: 10 n + 100
    int turns = 30;                 // largest number of Newton iterations for the friction cones
  };

  enum class Status {
    kSolved,         // to the tolerance
    kContradiction,  // solved except for rows that no x satisfies
    kTurnLimit,      // the box is solved, but its bounds do not match the cones yet
    kPivotLimit,
    kBadInput  // n < 0, NaN, infinite A or b, lo > hi, rows out of range: x is 0 or the nearest bound
  };

  struct Result {
    Status status = Status::kSolved;
    int pivots = 0;
    int turns = 0;          // Newton iterations for the friction cones
    double residual = 0;    // largest violation, in the measure of w; for cones the distance from Coulomb's law
    int redundant = 0;      // rows parked inside their bounds because they depend on others
    int contradicting = 0;  // rows left with w ≠ 0
  };

  Dantzig() = default;
  explicit Dantzig(const Options& options) : options_(options) {}

  void limit(int pivots, int turns) {
    options_.pivots = pivots;
    options_.turns = turns;
  }

  /// Allocates for n rows and this number of cones; solve() allocates only for larger problems.
  void reserve(int n, int cones);

  /// x: start on entry (zeros or the last step's x; clamped to its bounds), result on return. w: result. Both have n elements.
  /// For every status x is finite, within its bounds (cones: to the tolerance), and the best found.
  Result solve(const BoxedProblem& problem, std::span<double> x, std::span<double> w);

 private:
  // A cone in the current pass: its axes (t1', t2') are (t1, t2) rotated by the angle with cosine c and sine s; r bounds them;
  // the curvature is added to the diagonal of t2'.
  struct Rotated {
    double c = 1, s = 0, r = 0, curvature = 0;
  };
  struct Friction {  // x and w of a cone's rows in the rotated axes; r = μ x_normal, ρ of the order of 1 / A_tt
    double x1 = 0, x2 = 0, w1 = 0, w2 = 0, r = 0, rho = 0;
  };
  struct Side {  // a friction row at its bound: x_row = sign μ x_normal
    int row = -1, cone = -1;
    double sign = 1;
  };

  bool valid(const BoxedProblem& problem, std::size_t x, std::size_t w);
  static Result reject(const BoxedProblem& problem, std::span<double> x, std::span<double> w);
  void start(const BoxedProblem& problem, std::span<const double> x);
  void solve_cones(const BoxedProblem& problem, int limit, Result& result, std::span<double> x, std::span<double> w);
  Friction friction(const FrictionCone& cone, const Rotated& rotated) const;
  static double coulomb_violation(const Friction& f);
  void predict_bounds(const BoxedProblem& problem);
  void rotate_cones(const BoxedProblem& problem);
  double velocity(const BoxedProblem& problem, int i, const double* x) const;
  bool solve_box(const BoxedProblem& problem, int limit);
  void extend_profile(int i, int begin, int end);
  void rotate_axes(const BoxedProblem& problem, const FrictionCone& cone, Rotated& now, double c, double s);
  void rotate_back(const BoxedProblem& problem, std::span<double> x, std::span<double> w) const;
  double diagonal(int i) const { return A_now_[static_cast<std::size_t>(i) * (n_ + 1)]; }

  Options options_;
  Pivoting box_;
  std::size_t n_ = 0;
  double highest_ = 0;                                // upper limit of the predicted normals
  const double *A_now_ = nullptr, *b_now_ = nullptr;  // of the problem, or their rotated copies
  std::vector<double> A_, b_;
  std::vector<RowProfile> profile_;  // of A_now_
  std::vector<char> in_cone_;        // per row
  std::vector<Rotated> rotated_;
  std::vector<double> bound_;  // per cone, for the next pass
  std::vector<Side> sides_;
  std::vector<double> response_, system_, change_, column_;  // work arrays of predict_bounds()
};

}  // namespace cotwin::contact_world
