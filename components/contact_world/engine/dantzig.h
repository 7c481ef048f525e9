#pragma once
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "components/contact_world/engine/pivoting.h"

namespace cotwin::contact_world {

/// The friction of one contact: rows t1 and t2 of a problem, perpendicular to each other, are bounded by row `normal`:
///   |(x_t1, x_t2)| ≤ μ x_normal,  and where w_t ≠ 0:  x_t = −μ x_normal w_t / |w_t|   (Coulomb's cone, no pyramid)
struct FrictionCone {
  int normal = -1;
  int t1 = -1, t2 = -1;  // t2 = −1: friction in one direction
  double mu = 0;
};

/// The boxed linear complementarity problem with friction: find x and w with
///   w = A x + b,  lo ≤ x ≤ hi;  w_i ≥ 0 where x_i = lo_i,  ≤ 0 where x_i = hi_i,  0 between.
/// Infinite bounds on both sides make an equality row. A may be singular; rows may repeat or contradict each other.
struct BoxedProblem {
  int n = 0;
  const double* A = nullptr;                 // n x n, row-major, symmetric, positive semidefinite
  const double* b = nullptr;                 // n
  const double* lo = nullptr;                // n; those of friction rows are not read
  const double* hi = nullptr;                // n
  std::span<const FrictionCone> cones;       // each row in at most one; the normals' lo is ≥ 0
  std::span<const RowProfile> profile = {};  // of A's n rows, within 0 … n: outside A is 0, unread; empty: A is full
  std::span<const int> pairs = {};           // of n rows: which two bodies it acts between; −1: nothing known; empty: of none
  std::uint64_t version = 0;  // of A: that of the problem solved last says that A is the same to the bit; 0: unknown
};

/// Dantzig's pivoting for it: one violated row after the other is driven to w = 0 while the rows settled before stay
/// complementary [Cottle, Dantzig 1968; Baraff 1994, section 4; the paper's second solver].
/// Differences from Baraff:
///  1. Starts from any x: the rows strictly inside their bounds are the first basis. A good start needs no pivot at all.
///  2. A row that depends on the basis is not pivoted on. If its w is 0 it is parked where it is; else load is moved along the
///     null direction onto it until a row of the basis reaches its bound and leaves. Only where nothing ever blocks do rows
///     contradict each other: the row is left with w ≠ 0 and counted.
///  3. ½ xᵀAx + bᵀx never rises; after n steps without progress the lowest index enters and leaves, so that degenerate problems
///     do not cycle.
///  4. The cones: given the normals, friction is a box whose first side is turned into the direction of x_t, i.e. the cone's
///     tangent plane, with the curvature |w_t| / |x_t| on the diagonal of the second. Turning, and the bounds μ x_normal, are
///     Newton's iteration around the pivoting.
/// Costs O(n²) a pivot; with a narrow profile (rows of neighbours near each other) less.
class Dantzig {
 public:
  struct Options {
    double tolerance = 1e-11;       // of w_i / √A_ii, relative to the largest |b_j| / √A_jj
    double pivot_tolerance = 1e-8;  // of A_ii: a pivot below is none
    int pivots = 0;                 // at most; 0: 10 n + 100
    int turns = 30;                 // of the friction cones, at most
  };

  enum class Status {
    kSolved,         // to the tolerance
    kContradiction,  // but for rows that no x satisfies
    kTurnLimit,      // the box is solved, its bounds are not yet the cone's
    kPivotLimit,
    kBadInput  // n < 0, NaN, infinite A or b, lo > hi, rows out of range: x is 0 or the bound nearest to it
  };

  struct Result {
    Status status = Status::kSolved;
    int pivots = 0;
    int turns = 0;          // of the friction cones
    double residual = 0;    // largest violation, in w's measure; of cones by their distance from Coulomb's law
    int redundant = 0;      // rows parked inside their bounds: they depend on others
    int contradicting = 0;  // rows left with w ≠ 0
  };

  Dantzig() = default;
  explicit Dantzig(const Options& options) : options_(options) {}

  /// Allocates for problems of n rows and so many cones now; solve() allocates only beyond.
  void reserve(int n, int cones);

  /// x: start on entry (zeros, or the last step's x; brought within its bounds), result on return. w: result. Both of n rows.
  /// On any status x is finite, within its bounds (those of cones to the tolerance), and the best that was found.
  Result solve(const BoxedProblem& problem, std::span<double> x, std::span<double> w);

 private:
  // A cone's place in the pass at hand: its axes (t1', t2') are (t1, t2) turned by the angle (c, s), r bounds them, and the
  // curvature stands on the diagonal of t2'.
  struct Turned {
    double c = 1, s = 0, r = 0, curvature = 0;
  };
  struct Friction {  // x and w of a cone's rows in the turned axes; r = μ x_normal, ρ of the size of 1 / A_tt
    double x1 = 0, x2 = 0, w1 = 0, w2 = 0, r = 0, rho = 0;
  };
  struct Side {  // a friction row at its bound: x_row = sign μ x_normal
    int row = -1, cone = -1;
    double sign = 1;
  };

  bool valid(const BoxedProblem& problem, std::size_t x, std::size_t w);
  static Result refuse(const BoxedProblem& problem, std::span<double> x, std::span<double> w);
  void start(const BoxedProblem& problem, std::span<const double> x);
  void solve_cones(const BoxedProblem& problem, int limit, Result& result, std::span<double> x, std::span<double> w);
  Friction friction(const FrictionCone& cone, const Turned& turned) const;
  static double excess(const Friction& f);
  void predict_bounds(const BoxedProblem& problem);
  void turn(const BoxedProblem& problem);
  double velocity(const BoxedProblem& problem, int i, const double* x) const;
  bool solve_box(const BoxedProblem& problem, int limit);
  void widen(int i, int begin, int end);
  void turn_axes(const BoxedProblem& problem, const FrictionCone& cone, Turned& now, double c, double s);
  void unturn(const BoxedProblem& problem, std::span<double> x, std::span<double> w) const;
  double diagonal(int i) const { return A_now_[static_cast<std::size_t>(i) * (n_ + 1)]; }

  Options options_;
  Pivoting box_;
  std::size_t n_ = 0;
  double highest_ = 0;                                // that a cone's normal may become
  const double *A_now_ = nullptr, *b_now_ = nullptr;  // the problem's, or the turned copies
  std::vector<double> A_, b_;
  std::vector<RowProfile> profile_;  // of A_now_
  std::vector<char> in_cone_;        // of each row
  std::vector<Turned> turned_;
  std::vector<double> bound_;  // of each cone in the next pass
  std::vector<Side> sides_;
  std::vector<double> response_, system_, change_, column_;  // of predict_bounds()
};

}  // namespace cotwin::contact_world
