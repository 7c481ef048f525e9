#include "components/contact_world/engine/solvers/dantzig.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "tests/support/allocations.h"

namespace cotwin::contact_world::dantzig_test {
namespace {

using RowMajor = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kInfinity = std::numeric_limits<double>::infinity();

struct Random {
  std::mt19937_64 engine;
  double operator()(double low, double high) { return low + (high - low) * static_cast<double>(engine() >> 11) * 0x1p-53; }
  int index(int count) { return static_cast<int>(engine() % static_cast<std::uint64_t>(count)); }
  VectorXd vector(int n, double limit) {
    VectorXd v(n);
    for (double& e : v) e = (*this)(-limit, limit);
    return v;
  }
};

struct Problem {
  RowMajor A;
  VectorXd b, lo, hi;
  std::vector<FrictionCone> cones;

  explicit Problem(int n) : A(RowMajor::Zero(n, n)), b(VectorXd::Zero(n)), lo(VectorXd::Zero(n)), hi(n) {
    hi.setConstant(kInfinity);
  }
  int n() const { return static_cast<int>(b.size()); }
  operator BoxedProblem() const { return {n(), A.data(), b.data(), lo.data(), hi.data(), cones}; }
  double objective(const VectorXd& x) const { return 0.5 * x.dot(A * x) + b.dot(x); }
};

struct Solution {
  VectorXd x, w;
  Dantzig::Result result;
};

Solution solve(Dantzig& solver, const Problem& problem, const VectorXd& start) {
  Solution s{start, VectorXd::Zero(problem.n()), {}};
  s.result = solver.solve(problem, std::span(s.x.data(), static_cast<std::size_t>(problem.n())),
                          std::span(s.w.data(), static_cast<std::size_t>(problem.n())));
  return s;
}

Solution solve(const Problem& problem) {
  Dantzig solver;
  return solve(solver, problem, VectorXd::Zero(problem.n()));
}

bool is_friction(const Problem& problem, int i) {
  for (const FrictionCone& cone : problem.cones) {
    if (i == cone.t1 || i == cone.t2) return true;
  }
  return false;
}

// Largest violation of the bounds and of Coulomb's law, formulated independently of the solver: sign conditions by distance
// from the bounds, friction by |x_t| ≤ μ x_n and x_t = −μ x_n w_t / |w_t|, as an error of the force (if it slips) or of the
// slip (if it hardly slips).
double kkt(const Problem& problem, const VectorXd& x) {
  const VectorXd w = problem.A * x + problem.b;
  double worst = 0;
  for (int i = 0; i < problem.n(); ++i) {
    if (is_friction(problem, i)) continue;
    if (x(i) < problem.lo(i) || x(i) > problem.hi(i)) return kInfinity;
    if (problem.lo(i) == problem.hi(i)) continue;
    if (w(i) > 0 && x(i) != problem.lo(i)) worst = std::max(worst, w(i));
    if (w(i) < 0 && x(i) != problem.hi(i)) worst = std::max(worst, -w(i));
  }
  for (const FrictionCone& cone : problem.cones) {
    const Eigen::Vector2d x_t(x(cone.t1), cone.t2 < 0 ? 0 : x(cone.t2)), w_t(w(cone.t1), cone.t2 < 0 ? 0 : w(cone.t2));
    const double r = cone.mu * x(cone.normal);
    if (x_t.norm() > r + 1e-10 * (1e-3 + problem.b.cwiseAbs().maxCoeff()) / problem.A(cone.t1, cone.t1)) return kInfinity;
    const double slip = (x_t + r * w_t.normalized()).norm() * problem.A(cone.t1, cone.t1);
    const double skew = r > 0 ? (w_t + w_t.norm() * x_t / r).norm() : 0;
    worst = std::max(worst, std::min(slip, skew));
  }
  return worst;
}

// Every one of the 3ⁿ assignments of each row to its lower bound, its upper bound or between.
double lowest_objective(const Problem& problem) {
  const int n = problem.n();
  int sets = 1;
  for (int i = 0; i < n; ++i) sets *= 3;
  double lowest = kInfinity;
  for (int set = 0; set < sets; ++set) {
    VectorXd x = VectorXd::Zero(n);
    std::vector<int> free;
    bool possible = true;
    for (int i = 0, rest = set; i < n; ++i, rest /= 3) {
      if (rest % 3 == 0) free.push_back(i);
      if (rest % 3 == 1) x(i) = problem.lo(i);
      if (rest % 3 == 2) x(i) = problem.hi(i);
      possible = possible && std::isfinite(x(i));
    }
    if (!possible) continue;
    const int m = static_cast<int>(free.size());
    MatrixXd A_FF(m, m);
    VectorXd r(m);
    for (int p = 0; p < m; ++p) {
      r(p) = -problem.b(free[static_cast<std::size_t>(p)]) - problem.A.row(free[static_cast<std::size_t>(p)]).dot(x);
      for (int q = 0; q < m; ++q) A_FF(p, q) = problem.A(free[static_cast<std::size_t>(p)], free[static_cast<std::size_t>(q)]);
    }
    const VectorXd x_F = m > 0 ? VectorXd(A_FF.completeOrthogonalDecomposition().solve(r)) : r;
    for (int p = 0; p < m; ++p) x(free[static_cast<std::size_t>(p)]) = x_F(p);
    bool feasible = true;
    for (int i = 0; i < n; ++i) feasible = feasible && x(i) >= problem.lo(i) - 1e-12 && x(i) <= problem.hi(i) + 1e-12;
    if (feasible) lowest = std::min(lowest, problem.objective(x));
  }
  return lowest;
}

// A = J Jᵀ of rank ≤ `rank` with b = J v, so that no rows contradict each other; some rows are repeated.
Problem random_problem(Random& random, int n, int rank) {
  MatrixXd J(n, rank);
  for (int i = 0; i < n; ++i) J.row(i) = random.vector(rank, 1).transpose();
  for (int i = 1; i < n; ++i) {
    if (random.index(6) == 0) J.row(i) = J.row(random.index(i)) * (random.index(2) == 0 ? 1 : -1);
    if (random.index(20) == 0) J.row(i).setZero();
  }
  Problem problem(n);
  problem.A = J * J.transpose();
  problem.b = J * random.vector(rank, 1);
  for (int i = 0; i < n; ++i) {
    switch (random.index(5)) {
      case 0:
        problem.lo(i) = -kInfinity;
        break;
      case 1:
        problem.lo(i) = -random(0, 0.3);
        problem.hi(i) = random(0, 0.3);
        break;
      case 2:
        problem.lo(i) = problem.hi(i) = random(-0.1, 0.1);
        break;
      default:
        break;  // a contact's normal: 0 … infinity
    }
  }
  return problem;
}

// Stacked boxes of edge `a` and 1 kg, the lowest on the ground, held against gravity for 1 ms: four contacts per pair, normals
// up. Rows: normal, x, y of each. Offsets do not tilt the boxes but move them sideways.
Problem stack(int boxes, double mu, double a, bool cones, const Eigen::Vector3d& push) {
  const int n = 12 * boxes;
  MatrixXd J = MatrixXd::Zero(n, 6 * boxes);
  VectorXd M_inverse(6 * boxes), v(6 * boxes);
  for (int k = 0; k < boxes; ++k) {
    M_inverse.segment<6>(6 * k) << 1, 1, 1, 6 / (a * a), 6 / (a * a), 6 / (a * a);
    v.segment<6>(6 * k) << 0, 0, -9.81e-3, 0, 0, 0;
    v.segment<3>(6 * k) += k == boxes - 1 ? push : Eigen::Vector3d::Zero();
    for (int c = 0; c < 4; ++c) {
      const Eigen::Vector3d below((c & 1 ? 0.5 : -0.5) * a, (c & 2 ? 0.5 : -0.5) * a, -0.5 * a);
      for (int r = 0; r < 3; ++r) {
        const Eigen::Vector3d direction = Eigen::Vector3d::Unit((r + 2) % 3);
        const int row = 12 * k + 3 * c + r;
        J.row(row).segment<3>(6 * k) = direction.transpose();
        J.row(row).segment<3>(6 * k + 3) = below.cross(direction).transpose();
        if (k == 0) continue;
        const Eigen::Vector3d above(below.x(), below.y(), 0.5 * a);
        J.row(row).segment<3>(6 * k - 6) = -direction.transpose();
        J.row(row).segment<3>(6 * k - 3) = -above.cross(direction).transpose();
      }
    }
  }
  Problem problem(n);
  problem.A = J * M_inverse.asDiagonal() * J.transpose();
  problem.b = J * v;
  for (int c = 0; c < 4 * boxes; ++c) {
    if (cones) {
      problem.cones.push_back({3 * c, 3 * c + 1, 3 * c + 2, mu});
    } else {
      for (int t : {3 * c + 1, 3 * c + 2}) {
        problem.lo(t) = -mu * 9.81e-3;
        problem.hi(t) = mu * 9.81e-3;
      }
    }
  }
  return problem;
}

TEST(IncrementalLdl, SolvesLikeADenseFactorisationWhileRowsEnterAndLeave) {
  Random random{std::mt19937_64(1)};
  const int n = 30;
  double worst = 0;
  for (int round = 0; round < 20; ++round) {
    MatrixXd J = MatrixXd::NullaryExpr(n, n, [&] { return random(-1, 1); });
    if (round % 2 == 0) {  // a band, for the profile
      for (int i = 0; i < n; ++i) {
        for (int j = 0; j < n; ++j) {
          if (std::abs(i - j) > 3) J(i, j) = 0;
        }
      }
    }
    RowMajor A = J * J.transpose();
    A.diagonal().array() += 0.1;
    IncrementalLdl ldl;
    ldl.clear(n);
    std::vector<int> F;
    for (int change = 0; change < 120; ++change) {
      const int i = random.index(n);
      if (ldl.contains(i)) {
        ldl.remove(i);
        F.erase(std::find(F.begin(), F.end(), i));
      } else {
        VectorXd row = A.row(i);
        RowProfile profile;
        if (round % 2 == 0) {
          profile = {std::max(0, i - 6), std::min(n, i + 7)};
          row.head(profile.begin).setConstant(std::numeric_limits<double>::quiet_NaN());
          row.tail(n - profile.end).setConstant(std::numeric_limits<double>::quiet_NaN());
        }
        const double d = ldl.pivot(i, row.data(), A(i, i), profile);
        VectorXd z(std::max(1, ldl.size()));
        ldl.column(z.data());
        double expected = A(i, i);
        for (std::size_t p = 0; p < F.size(); ++p) expected -= A(i, F[p]) * z(static_cast<Eigen::Index>(p));
        EXPECT_NEAR(d, expected, 1e-10 * A(i, i));
        ldl.append();
        F.push_back(i);
      }
      ASSERT_EQ(ldl.size(), static_cast<int>(F.size()));
      const auto m = static_cast<Eigen::Index>(F.size());
      MatrixXd A_FF(m, m);
      for (Eigen::Index p = 0; p < m; ++p) {
        ASSERT_EQ(ldl.row(static_cast<int>(p)), F[static_cast<std::size_t>(p)]);
        for (Eigen::Index q = 0; q < m; ++q) A_FF(p, q) = A(F[static_cast<std::size_t>(p)], F[static_cast<std::size_t>(q)]);
      }
      const VectorXd r = random.vector(static_cast<int>(m), 1);
      VectorXd v = r;
      ldl.solve(v.data());
      if (m > 0) worst = std::max(worst, (A_FF * v - r).cwiseAbs().maxCoeff());
    }
  }
  EXPECT_LT(worst, 1e-11);  // condition numbers up to 1e3
}

TEST(Dantzig, FindsTheLowestOfAllActiveSetsOfSmallProblems) {
  Random random{std::mt19937_64(2)};
  Dantzig solver;
  for (int round = 0; round < 3000; ++round) {
    const int n = 1 + random.index(6), rank = 1 + random.index(6);
    const Problem problem = random_problem(random, n, rank);
    const Solution s = solve(solver, problem, random.vector(n, 1));
    ASSERT_EQ(s.result.status, Dantzig::Status::kSolved) << "round " << round;
    const double lowest = lowest_objective(problem);
    ASSERT_NEAR(problem.objective(s.x), lowest, 1e-9 * (1 + std::abs(lowest))) << "round " << round;
    ASSERT_LT(kkt(problem, s.x), 1e-9) << "round " << round;
  }
}

TEST(Dantzig, SatisfiesTheConditionsOfDegenerateAndRedundantProblemsOfAnySize) {
  Random random{std::mt19937_64(3)};
  Dantzig solver;
  for (int round = 0; round < 2000; ++round) {
    const int n = 1 + random.index(60), rank = 1 + random.index(n + 5);
    const Problem problem = random_problem(random, n, rank);
    const Solution s = solve(solver, problem, round % 2 == 0 ? VectorXd(VectorXd::Zero(n)) : random.vector(n, 1));
    ASSERT_EQ(s.result.status, Dantzig::Status::kSolved) << "round " << round << ", n " << n << ", rank " << rank;
    ASSERT_LT(kkt(problem, s.x), 1e-8) << "round " << round;
    ASSERT_LE(s.result.residual, 1e-8) << "round " << round;
    ASSERT_LT((s.w - problem.A * s.x - problem.b).cwiseAbs().maxCoeff(), 1e-9) << "round " << round;
  }
}

TEST(Dantzig, NeedsFewPivotsWhereLeastIndexPivotingNeedsExponentiallyMany) {
  // Fathi 1979 [Math. Programming 17]: A = L Lᵀ with ones on and twos below the diagonal of L, b = −1; Murty's least-index
  // method takes 2ⁿ − 1 pivots. All rows are violated equally at the start.
  const int n = 40;
  Problem problem(n);
  MatrixXd L = MatrixXd::Zero(n, n);
  for (int i = 0; i < n; ++i) {
    L(i, i) = 1;
    for (int j = 0; j < i; ++j) L(i, j) = 2;
  }
  problem.A = L * L.transpose();
  problem.b.setConstant(-1);
  const Solution s = solve(problem);
  EXPECT_EQ(s.result.status, Dantzig::Status::kSolved);
  EXPECT_LT(kkt(problem, s.x), 1e-10);
  EXPECT_LT(s.result.pivots, 10 * n);
}

TEST(Dantzig, DoesNotCycleWhereAllPivotsTie) {
  // A body on many equal legs at the same place, with and without load: each pivot is a tie between all others.
  for (const double load : {0.0, 1.0}) {
    for (int legs = 1; legs < 80; ++legs) {
      Problem problem(3 * legs);
      MatrixXd J(3 * legs, 3);
      for (int k = 0; k < legs; ++k) J.block<3, 3>(3 * k, 0) << 1, 0, 0, 1, 1, 0, 1, 0, 1;
      problem.A = J * J.transpose();
      problem.b = J * Eigen::Vector3d(-load, 0, 0);
      const Solution s = solve(problem);
      ASSERT_EQ(s.result.status, Dantzig::Status::kSolved);
      ASSERT_LT(kkt(problem, s.x), 1e-10);
      ASSERT_NEAR((J.transpose() * s.x)(0), load, 1e-9);
    }
  }
}

TEST(Dantzig, LeavesContradictingRowsAndSatisfiesTheOthers) {
  // The same row twice as an equality with different speeds, beside a contact of another body.
  Problem problem(3);
  problem.A << 1, 1, 0, 1, 1, 0, 0, 0, 2;
  problem.b << -1, 0.5, -4;
  problem.lo << -kInfinity, -kInfinity, 0;
  const Solution s = solve(problem);
  EXPECT_EQ(s.result.status, Dantzig::Status::kContradiction);
  EXPECT_EQ(s.result.contradicting, 1);
  EXPECT_NEAR(s.x(2), 2, 1e-12);
  EXPECT_NEAR(s.x(0) + s.x(1), 1, 1e-12);      // the first one is satisfied,
  EXPECT_NEAR(s.result.residual, 1.5, 1e-12);  // the second one cannot be
}

TEST(Dantzig, CarriesAStackOfBoxesOnFourCoplanarContactsEach) {
  for (const bool cones : {false, true}) {
    const Problem problem = stack(10, 0.5, 0.1, cones, Eigen::Vector3d::Zero());
    const Solution s = solve(problem);
    ASSERT_EQ(s.result.status, Dantzig::Status::kSolved);
    EXPECT_LT(kkt(problem, s.x), 1e-13);
    for (int k = 0; k < 10; ++k) {  // each layer carries the layers above
      double load = 0;
      for (int c = 0; c < 4; ++c) load += s.x(12 * k + 3 * c);
      EXPECT_NEAR(load, (10 - k) * 9.81e-3, 1e-12);
    }
  }
}

TEST(Dantzig, TopplesSlidesOrHoldsAPushedStack) {
  Random random{std::mt19937_64(4)};
  Dantzig solver;
  int unsolved = 0;
  for (int round = 0; round < 1000; ++round) {
    const double z = random(-0.01, 0.01), y = random(-0.05, 0.05),
                 x = random(-0.05, 0.05);  // in the same order with every compiler
    const double mu = random(0.05, 0.8);
    const Problem problem = stack(1 + random.index(6), mu, 0.1, true, Eigen::Vector3d(x, y, z));
    const Solution s = solve(solver, problem, VectorXd::Zero(problem.n()));
    if (s.result.status == Dantzig::Status::kTurnLimit) {
      ++unsolved;
      ASSERT_LT(s.result.residual, 1e-3);
    } else {
      ASSERT_EQ(s.result.status, Dantzig::Status::kSolved) << "round " << round;
      ASSERT_LT(kkt(problem, s.x), 1e-11) << "round " << round;
    }
  }
  EXPECT_LE(unsolved, 5);  // Newton's iteration around the pivoting is not guaranteed to converge; the status reports it
}

// The additional knowledge of the contact world about its rows. The profile of every other contact extends by one box, as for
// rows that share bodies with different rows: profiles need not be symmetric.
struct KnownRows {
  std::vector<RowProfile> profile;
  std::vector<int> pairs;
};

KnownRows known_rows(Problem& stack) {
  KnownRows known;
  for (int i = 0; i < stack.n(); ++i) {
    const int box = i / 12, more = i / 3 % 2;  // shares bodies with the rows below and above
    known.profile.push_back({std::max(0, 12 * (box - 1 - more)), std::min(stack.n(), 12 * (box + 2 + more))});
    known.pairs.push_back(box);
    stack.A.row(i).head(known.profile.back().begin).setConstant(std::numeric_limits<double>::quiet_NaN());
    stack.A.row(i).tail(stack.n() - known.profile.back().end).setConstant(std::numeric_limits<double>::quiet_NaN());
  }
  return known;
}

TEST(Dantzig, ReadsNothingOutsideOfTheProfileAndSolvesAsManyProblems) {
  Random random{std::mt19937_64(9)};
  int solved = 0, solved_full = 0, unsolved = 0;
  for (int round = 0; round < 300; ++round) {
    const Eigen::Vector3d push(random(-0.01, 0.01), random(-0.01, 0.01), random(-0.01, 0));
    const Problem problem = stack(1 + random.index(8), 0.5, 0.1, true, push);
    Problem known = problem;
    const KnownRows rows = known_rows(known);
    BoxedProblem boxed = known;
    boxed.profile = rows.profile;
    boxed.pairs = rows.pairs;
    const VectorXd start = VectorXd::Constant(problem.n(), 1e-3);
    Dantzig other;
    solved_full += solve(other, problem, start).result.status == Dantzig::Status::kSolved;
    for (const int turns : {Dantzig::Options().turns, 1}) {
      Dantzig::Options options;
      options.turns = turns;
      Dantzig solver(options);
      Solution s{start, VectorXd::Zero(problem.n()), {}};
      s.result = solver.solve(boxed, {s.x.data(), static_cast<std::size_t>(problem.n())},
                              {s.w.data(), static_cast<std::size_t>(problem.n())});
      ASSERT_NE(s.result.status, Dantzig::Status::kBadInput) << "round " << round;
      ASSERT_LT((s.w - problem.A * s.x - problem.b).cwiseAbs().maxCoeff(), 1e-12) << "round " << round;
      unsolved += s.result.status == Dantzig::Status::kTurnLimit;
      if (s.result.status != Dantzig::Status::kSolved) continue;
      ASSERT_LT(kkt(problem, s.x), 1e-11) << "round " << round;
      solved += turns > 1;
    }
  }
  EXPECT_GT(unsolved, 100) << "with one iteration few are solved, and their w is checked as well";
  EXPECT_GT(solved, 270);  // jamming friction has no guarantee; the order of sums may decide
  EXPECT_NEAR(solved, solved_full, 6);
}

TEST(Dantzig, GivesTheSameBitsWithAndWithoutKeptFactors) {
  Random random{std::mt19937_64(10)};
  Dantzig with_factors;
  VectorXd x = VectorXd::Zero(72), start = x;
  for (int round = 0; round < 100; ++round) {
    if (round % 4 == 0) start.setZero();  // otherwise from the last solution
    const Eigen::Vector3d push(random(-0.004, 0.004), random(-0.004, 0.004), 0);
    const Problem problem = stack(6, 0.5, 0.1, true, push);
    BoxedProblem boxed = problem;
    boxed.version = 1;
    const auto n = static_cast<std::size_t>(problem.n());
    Solution s{start, VectorXd::Zero(problem.n()), {}};
    s.result = with_factors.solve(boxed, {s.x.data(), n}, {s.w.data(), n});
    Dantzig fresh;
    const Solution expected = solve(fresh, problem, start);
    ASSERT_EQ(s.x, expected.x) << "round " << round;
    ASSERT_EQ(s.w, expected.w) << "round " << round;
    ASSERT_EQ(s.result.redundant, expected.result.redundant) << "round " << round;
    start = s.x;
  }
}

TEST(Dantzig, DoesNotUseFactorsThatReserveHasCleared) {
  Problem problem(3);
  problem.A << 3, 1, 0, 1, 3, 1, 0, 1, 3;
  problem.b.setConstant(-1);  // x = (2, 1, 2) / 7: all rows are free
  BoxedProblem boxed = problem;
  boxed.version = 1;
  const auto n = static_cast<std::size_t>(problem.n());
  Dantzig solver;
  VectorXd x = VectorXd::Zero(problem.n()), w = x;
  solver.solve(boxed, {x.data(), n}, {w.data(), n});
  const Dantzig::Result before =
      solver.solve(boxed, {x.data(), n}, {w.data(), n});  // no pivot: the factors are those of the matrix
  ASSERT_EQ(before.pivots, 0);
  solver.reserve(2 * problem.n(), 0);
  const Dantzig::Result after = solver.solve(boxed, {x.data(), n}, {w.data(), n});
  EXPECT_EQ(after.status, Dantzig::Status::kSolved);
  EXPECT_EQ(after.redundant, before.redundant) << "rows outside of every basis count as dependent";
}

TEST(Dantzig, NeedsNoPivotFromTheSolutionItself) {
  const Problem problem = stack(10, 0.5, 0.1, true, {0.002, 0.001, 0});
  Dantzig solver;
  const Solution cold = solve(solver, problem, VectorXd::Zero(problem.n()));
  const Solution warm = solve(solver, problem, cold.x);
  EXPECT_GT(cold.result.pivots, 0);
  EXPECT_EQ(warm.result.pivots, 0);
  EXPECT_EQ(warm.result.turns, 0);
  EXPECT_LT((warm.x - cold.x).cwiseAbs().maxCoeff(), 1e-13);
}

TEST(Dantzig, SlidesAgainstTheDirectionOfMotionWhateverTheAxes) {
  // A point mass of 2 kg on the ground with v_t = 0.1 m/s: the friction impulse is μ m g h against v, or stops it.
  Random random{std::mt19937_64(5)};
  for (int round = 0; round < 1000; ++round) {
    const double m = 2, mu = random(0.01, 1), g_h = 9.81e-3, angle = random(-3.2, 3.2), speed = random(0, 0.02);
    Problem problem(3);
    problem.A = RowMajor::Identity(3, 3) / m;
    problem.b << -g_h, speed * std::cos(angle), speed * std::sin(angle);
    problem.cones = {{0, 1, 2, mu}};
    const Solution s = solve(problem);
    ASSERT_EQ(s.result.status, Dantzig::Status::kSolved);
    const double expected = std::min(mu * m * g_h, m * speed);
    ASSERT_NEAR(s.x(1), -expected * std::cos(angle), 1e-12);
    ASSERT_NEAR(s.x(2), -expected * std::sin(angle), 1e-12);
  }
}

TEST(Dantzig, ObeysCoulombsLawWithNormalsAndFrictionCoupled) {
  // Bodies of random inertia pressed on random points with random normals, several of them in a chain.
  Random random{std::mt19937_64(6)};
  Dantzig solver;
  int unsolved = 0;
  const int rounds = 2000;
  for (int round = 0; round < rounds; ++round) {
    const int contacts = 1 + random.index(12), bodies = 1 + random.index(4);
    MatrixXd J = MatrixXd::Zero(3 * contacts, 6 * bodies);
    for (int c = 0; c < contacts; ++c) {
      const Eigen::Vector3d normal = (Eigen::Vector3d(0, 0, 1) + random.vector(3, 0.4)).normalized();
      const Eigen::Vector3d t1 = normal.unitOrthogonal(), t2 = normal.cross(t1), p = random.vector(3, 1);
      const int body = random.index(bodies);
      for (int r = 0; r < 3; ++r) {
        const Eigen::Vector3d& direction = r == 0 ? normal : r == 1 ? t1 : t2;
        J.row(3 * c + r).segment<3>(6 * body) = direction.transpose();
        J.row(3 * c + r).segment<3>(6 * body + 3) = p.cross(direction).transpose();
        if (body == 0) continue;
        J.row(3 * c + r).segment<3>(6 * body - 6) = -direction.transpose();
        J.row(3 * c + r).segment<3>(6 * body - 3) = -(p + Eigen::Vector3d(0, 0, 1)).cross(direction).transpose();
      }
    }
    VectorXd v = random.vector(6 * bodies, 0.1);
    for (int k = 0; k < bodies; ++k) v(6 * k + 2) -= 0.1;
    Problem problem(3 * contacts);
    problem.A = J * J.transpose();
    problem.b = J * v;
    for (int c = 0; c < contacts; ++c) problem.cones.push_back({3 * c, 3 * c + 1, 3 * c + 2, random(0.1, 0.7)});
    const Solution s = solve(solver, problem, VectorXd::Zero(problem.n()));
    ASSERT_TRUE(s.x.allFinite());
    if (s.result.status != Dantzig::Status::kSolved) {
      ++unsolved;
      ASSERT_EQ(s.result.status, Dantzig::Status::kTurnLimit) << "round " << round;
      continue;
    }
    ASSERT_LT(kkt(problem, s.x), 1e-9) << "round " << round;
  }
  // With strong coupling Coulomb's law may have no solution (Painlevé); then the status reports it.
  EXPECT_LT(unsolved, rounds / 50);
}

TEST(Dantzig, ReturnsABoundedSolutionForContradictoryContacts) {
  // Bodies inside each other: contacts from all sides demand speeds that are impossible together, and friction jams the rest.
  Random random{std::mt19937_64(8)};
  Dantzig solver;
  for (int round = 0; round < 100; ++round) {
    const int contacts = 10 + random.index(40);
    MatrixXd J(3 * contacts, 12);
    for (int i = 0; i < 3 * contacts; ++i) J.row(i) = random.vector(12, 1).transpose();
    Problem problem(3 * contacts);
    problem.A = J * J.transpose();
    problem.b = random.vector(3 * contacts, 1);
    for (int c = 0; c < contacts; ++c) problem.cones.push_back({3 * c, 3 * c + 1, 3 * c + 2, random(0, 1.5)});
    const Solution s = solve(solver, problem, VectorXd::Zero(problem.n()));
    ASSERT_TRUE(s.x.allFinite() && s.w.allFinite()) << "round " << round;
    ASSERT_NE(s.result.status, Dantzig::Status::kBadInput) << "round " << round;
    ASSERT_LT(s.x.cwiseAbs().maxCoeff(), 1e11) << "round " << round;  // some steps of 1e8; b and A are of size 1
    ASSERT_LT(s.result.residual, 1e6) << "round " << round;
    for (const FrictionCone& cone : problem.cones) {
      ASSERT_GE(s.x(cone.normal), 0);
      ASSERT_LE(std::hypot(s.x(cone.t1), s.x(cone.t2)), cone.mu * s.x(cone.normal) * (1 + 1e-9) + 1e-12);
    }
  }
}

TEST(Dantzig, AllocatesNothingWithinItsCapacity) {
  const Problem small = stack(3, 0.3, 0.1, true, {0.02, 0.01, 0}), large = stack(10, 0.3, 0.1, true, {0.02, 0.01, 0});
  Dantzig solver;
  solver.reserve(large.n(), static_cast<int>(large.cones.size()));
  VectorXd x = VectorXd::Zero(large.n()), w = x;
  const auto before = cotwin::testing::allocations();
  for (const Problem* problem : {&large, &small, &large}) {
    const auto n = static_cast<std::size_t>(problem->n());
    solver.solve(*problem, std::span(x.data(), n), std::span(w.data(), n));
  }
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

TEST(Dantzig, GivesTheSameBitsWhateverWasSolvedBefore) {
  Random random{std::mt19937_64(7)};
  const Problem problem = stack(6, 0.2, 0.1, true, {0.03, -0.02, 0});
  const Solution first = solve(problem);
  Dantzig solver;
  for (int round = 0; round < 20; ++round) {
    const Problem other = random_problem(random, 1 + random.index(90), 20);
    solve(solver, other, random.vector(other.n(), 1));
    const Solution again = solve(solver, problem, VectorXd::Zero(problem.n()));
    ASSERT_EQ(first.x, again.x);
    ASSERT_EQ(first.w, again.w);
  }
}

TEST(Dantzig, RefusesInvalidProblems) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto status = [](const auto& change) {
    Problem problem = stack(1, 0.5, 0.1, true, Eigen::Vector3d::Zero());
    change(problem);
    const Solution s = solve(problem);
    EXPECT_TRUE(s.x.allFinite());
    return s.result.status;
  };
  using Status = Dantzig::Status;
  EXPECT_EQ(status([](Problem&) {}), Status::kSolved);
  EXPECT_EQ(status([&](Problem& p) { p.A(3, 3) = nan; }), Status::kBadInput);
  EXPECT_EQ(status([&](Problem& p) { p.A(3, 7) = p.A(7, 3) = nan; }), Status::kBadInput);
  EXPECT_EQ(status([&](Problem& p) { p.A(0, 6) = p.A(6, 0) = kInfinity; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.A(3, 3) = -1; }), Status::kBadInput);
  EXPECT_EQ(status([&](Problem& p) { p.b(2) = nan; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.b(2) = -kInfinity; }), Status::kBadInput);
  EXPECT_EQ(status([&](Problem& p) { p.lo(0) = nan; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.lo(0) = 2, p.hi(0) = 1; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.lo(0) = -1; }), Status::kBadInput);  // a cone's normal that pulls
  EXPECT_EQ(status([&](Problem& p) { p.cones[0].mu = nan; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.cones[0].mu = -0.1; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.cones[0].normal = 99; }), Status::kBadInput);
  EXPECT_EQ(status([](Problem& p) { p.cones[0].t2 = p.cones[1].t1; }), Status::kBadInput);  // a row in two cones

  const auto status_of_rows = [](const auto& change) {
    const Problem problem = stack(1, 0.5, 0.1, true, Eigen::Vector3d::Zero());
    std::vector<RowProfile> profile(12, {0, 12});
    std::vector<int> pairs(12, 0);
    change(profile, pairs);
    BoxedProblem boxed = problem;
    boxed.profile = profile;
    boxed.pairs = pairs;
    std::vector<double> x(12, 0.0), w(12, 0.0);
    return Dantzig().solve(boxed, x, w).status;
  };
  using Profile = std::vector<RowProfile>;
  using Pairs = std::vector<int>;
  EXPECT_EQ(status_of_rows([](Profile&, Pairs&) {}), Status::kSolved);
  EXPECT_EQ(status_of_rows([](Profile& profile, Pairs&) { profile.pop_back(); }), Status::kBadInput);
  EXPECT_EQ(status_of_rows([](Profile& profile, Pairs&) { profile[3] = {-1, 12}; }), Status::kBadInput);
  EXPECT_EQ(status_of_rows([](Profile& profile, Pairs&) { profile[3] = {0, 13}; }), Status::kBadInput);
  EXPECT_EQ(status_of_rows([](Profile& profile, Pairs&) { profile[3] = {7, 5}; }), Status::kBadInput);
  EXPECT_EQ(status_of_rows([](Profile&, Pairs& pairs) { pairs.pop_back(); }), Status::kBadInput);
  EXPECT_EQ(status_of_rows([](Profile&, Pairs& pairs) { pairs[5] = 12; }), Status::kBadInput);
}

TEST(Dantzig, TakesAStartOfNaNForZero) {
  const Problem problem = stack(2, 0.5, 0.1, true, Eigen::Vector3d::Zero());
  Dantzig solver;
  VectorXd start = VectorXd::Constant(problem.n(), std::numeric_limits<double>::quiet_NaN());
  const Solution s = solve(solver, problem, start);
  EXPECT_EQ(s.result.status, Dantzig::Status::kSolved);
  EXPECT_LT(kkt(problem, s.x), 1e-13);
}

TEST(Dantzig, ReturnsTheBestWithinItsBoundOfPivots) {
  const Problem problem = stack(10, 0.5, 0.1, false, {0.05, 0, 0});
  double last = 0;
  for (const int pivots : {1, 5, 20, 1000}) {
    Dantzig::Options options;
    options.pivots = pivots;
    Dantzig solver(options);
    const Solution s = solve(solver, problem, VectorXd::Zero(problem.n()));
    EXPECT_EQ(s.result.status, pivots == 1000 ? Dantzig::Status::kSolved : Dantzig::Status::kPivotLimit);
    EXPECT_LE(problem.objective(s.x), last);  // it decreases with every pivot
    last = problem.objective(s.x);
  }
}

}  // namespace
}  // namespace cotwin::contact_world::dantzig_test
