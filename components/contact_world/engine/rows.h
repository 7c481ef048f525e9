#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/engine/joints/forest.h"
#include "components/contact_world/engine/soft_contact.h"
#include "components/contact_world/engine/solvers/central_impulses.h"
#include "components/contact_world/engine/solvers/dantzig.h"

namespace cotwin::contact_world {

/// One body's part of a row: `y` are coefficients in its slice of coordinates, in which the inertia is the unit matrix.
struct Side {
  int offset = 0, size = 0;  // of the slice; size 0: no slice
  std::size_t y = 0;         // index in the array of all coefficients
};

/// One body's velocity in the row of a gear: d · (velocity at p) + m · (angular velocity).
struct GearPart {
  int body = -1;  // −1: at rest
  Vector3d d = Vector3d::Zero(), m = Vector3d::Zero(), p = Vector3d::Zero();
  friend bool operator==(const GearPart&, const GearPart&) = default;
};
using GearParts = std::array<GearPart, 4>;  // parent and child of both joints

/// One direction of relative motion of two bodies, constrained with bounds on the impulse x:
///   u + softness · x = target   where lo < x < hi;   ≥ target where x = lo;   ≤ target where x = hi
/// u = d · (velocity of b − velocity of a, at p) + m · (angular velocity of b − that of a).
struct BoxRow {
  int a = -1, b = -1;  // bodies; −1: the world
  Vector3d d = Vector3d::Zero(), m = Vector3d::Zero(), p = Vector3d::Zero();
  double target = 0, softness = 0;
  double lo = -std::numeric_limits<double>::infinity(), hi = std::numeric_limits<double>::infinity();
  double x = 0;
  double applied = 0;  // part of x that the bodies' velocities contain already
  double u = 0;        // velocity at z = 0
  double A = 0, inverse_A = 0;
  double regular = 0;  // regularisation, part of the softness
  double rest = 0;     // as that of a ConeRow: of the contacts that the row presses
  bool redundant = false;
  bool exact = false;  // its island is pivoted, because sweeps of stiff rows converge slowly
  Side side[2];
  int origin = 0;  // index in the order of addition
  int island = 0;
  int gear =
      -1;  // index of the parts that u is the sum of, in place of the two bodies; a and b are then bodies of the two trees
};

/// One contact point: impulses x along the normal (from a to b) and two tangents, in Coulomb's cone:
///   u_n + softness · x_n ≥ target ⟂ x_n ≥ lo,   |x_t| ≤ μ x_n,   u_t opposite to x_t if |x_t| = μ x_n
struct ConeRow {
  /// Soft contacts: the impulse follows the law, or it is given up to a damper.
  enum class Spring : char { kNone, kLaw, kGiven };
  int a = -1, b = -1;
  Matrix3d d;  // columns n, t1, t2 in W; for anisotropic friction t1 and t2 are scaled
  Vector3d p;
  Spring spring = Spring::kNone;  // otherwise prepare() computes target and softness
  SoftContact law;
  double u = 0;                 // kLaw: the law is linearised at this normal velocity
  bool linearised = false;      // false: u is the velocity without the contact
  double change = 0;            // of u between the last two linearisations, m/s
  double slow = 0;              // m/s: calmer contacts settle where the step does not resolve their spring
  double push = 0, damper = 0;  // kGiven: constant impulse, N.s, and impulse per speed, N.s²/m
  double swing = 0;             // result: (h ω)²
  double target = 0, softness = 0, mu = 0;
  double slide[2] = {};                                    // targets of the tangential velocities
  double lift = 0;                                         // part of the target that lifts the bodies out of each other
  double speed = std::numeric_limits<double>::infinity();  // of the point before gravity and drives act in the stage, m/s
  double rest = 0;   // speed below which the point is at rest because something presses it, m/s
  bool slid = true;  // the friction of the last solution was at its bound
  double lo = 0;     // ≤ 0; Dantzig uses 0
  double x[3] = {}, applied[3] = {};
  int point = 0;  // index of the step's contact
  int island = 0;
};

/// The constraint rows of one stage of a step, and their solvers.
class Rows {
 public:
  Rows(std::span<const RigidBody> bodies, const Forest& forest);

  /// Allocates for this number of contact points, box rows and gears among them.
  void reserve(std::size_t cones, std::size_t boxes, std::size_t gears);

  void clear();
  void add(const BoxRow& row) {
    boxes_.push_back(row);
    boxes_.back().origin = static_cast<int>(boxes_.size()) - 1;
  }
  void add(BoxRow row, const GearParts& parts) {
    row.gear = static_cast<int>(gears_.size());
    gears_.push_back(parts);
    add(row);
  }
  void add(const ConeRow& row) { cones_.push_back(row); }
  bool empty() const { return boxes_.empty() && cones_.empty(); }
  std::span<BoxRow> boxes() { return boxes_; }
  std::span<ConeRow> cones() { return cones_; }
  std::span<const ConeRow> cones() const { return cones_; }

  /// Sorts the rows by islands and computes all that depends on poses and on the trees' factors.
  void prepare(std::span<const RigidBody> bodies, const Forest& forest);
  /// As prepare(), but reuses its last results for equal poses and factors. Returns false and changes nothing if the rows
  /// differ in bodies, directions or points.
  bool update();
  /// Computes u of every row from the bodies' present twists.
  void measure(std::span<const RigidBody> bodies);

  /// Most pivots of an island, and most iterations for its friction.
  struct Pivots {
    int least = 0;
    double per_row = 0;
    int turns = 0;
  };

  struct Outcome {
    int iterations = 0;
    double residual = 0;
    int degenerate = 0;
    int extended = 0;  // islands that took more sweeps, that sweeps left to pivoting, or the other way round
    int unsolved = 0;  // islands with a residual above the speed of rest; at rest: above 5 % of it
    void add(const Outcome& of_island);
  };
  /// Islands of few contacts whose speeds are all below `rest`, or that of a row if it is larger, may take 50 times as many sweeps if they have
  /// not converged: their friction decides whether they stand.
  Outcome sweep(int iterations, double tolerance, double rest);
  Outcome pivot(int iterations, double tolerance, double rest);

  /// Applies the changes of x since the last call: to the velocities of free bodies, and as impulses in F to bodies of trees.
  void apply(std::span<RigidBody> bodies, Forest& forest);

 private:
  /// A is dense, and a pivot costs the square of its size: islands at rest with more than kRowsToPivot rows and others with more than kRowsOfMoving
  /// are swept only, those above kRowsOfSmall are swept first.
  static constexpr std::size_t kRowsOfSmall = 96, kRowsOfMoving = 240, kRowsToPivot = 600;
  /// Residual, relative to the speed of rest, up to which a result counts as exact.
  static constexpr double kExactResidual = 1e-4;
  /// Residual, relative to the speed of rest, above which small moving islands are pivoted after sweeps, and islands at rest are unsolved; the
  /// latter for long steps, in which bodies creep as far as in short ones, m/s.
  static constexpr double kPoorResidual = 0.05, kPoorCreep = 1e-3;
  static constexpr double kRoundingOfSpeed = 1e-14;  // of a residual, relative to the fastest point

  struct Island {
    std::size_t first_box = 0, end_box = 0, first_cone = 0, end_cone = 0, first_slice = 0, end_slice = 0;
  };
  static std::size_t rows_of(const Island& island) {
    return island.end_box - island.first_box + 3 * (island.end_cone - island.first_cone);
  }
  struct Slice {
    int offset = 0, size = 0;
  };
  enum class Hold : char { kOpen, kSticks, kSlips };
  /// Data of a cone that the sweeps read and write, in the order of the sweeps.
  struct Core {
    // Impulse, its change in the last sweep, and its change over the sweeps including extrapolation; element 3 is 0.
    alignas(16) double x[4], change[4], path[4];
    alignas(16) double b[4];  // velocity at z = 0 minus the target; [3] is 0
    double target, softness, mu, lo;
    double A_nn, A_n1, A_n2, A_11, A_12, A_22;  // of J M⁻¹ Jᵀ
    double inverse_11, inverse_12, inverse_22;  // of the tangents' block
    double inverse_nn, shift;        // shift: multiplier that keeps the tangential impulse on the cone, from the last solution
    double regular;                  // regularisation, part of the softness
    bool redundant, moves, one_way;  // moves: has a mobility; one_way: its tangents move along one direction only
    Hold hold;                       // after the last sweep
    Side side[2];
    std::size_t row;  // in cones_
    int point;        // of the row at the time of prepare()
  };

  int slice_of(int body) const { return body < 0 ? -1 : slice_of_body_[static_cast<std::size_t>(body)]; }
  int root(int slice);
  void join(int body_a, int body_b);
  void find_islands();
  void make_side(std::span<const RigidBody> bodies, const Forest& forest, int body, const Vector3d& d, const Vector3d& m,
                 const Vector3d& p, double sign, double* y) const;
  void make_sides(int a, int b, std::size_t rows, Side* sides);
  void make_gear_sides(std::span<const RigidBody> bodies, const Forest& forest, const BoxRow& row);
  void make_free_sides(std::span<const RigidBody> bodies, const ConeRow& row, Core& core);
  void make_sides(std::span<const RigidBody> bodies, const Forest& forest, const ConeRow& row, Core& core);
  void load_row(Core& core);
  void apply_impulse(const Core& core, const double* change);
  double velocity(const double* y, const Side& side) const;
  void apply_impulse(const double* y, const Side& side, double x);
  double solve(BoxRow& row);
  template <int kSizeA, int kSizeB>
  double solve(Core& core);
  double solve_any(Core& core);
  double share(const Island& island);
  bool stands(const Island& island, double enough, double rest) const;
  Vector3d velocity_of(const Core& core, double x_n) const;
  double slip(const Island& island, double still) const;
  void hold_if_slips(const Island& island, double still, double enough, double rest, Outcome& outcome);
  void apply_start(const Island& island);
  void apply_impulses(const Island& island);
  void scale_start(const Island& island);
  bool adds_energy(const Island& island) const;
  void clear_changes(const Island& island);
  void begin_acceleration(const Island& island);
  struct Shares {
    double of_change = 0, of_path = 0;
  };
  double squared_change(const Island& island) const;
  Shares optimal_shares(const Island& island) const;
  void extrapolate(const Island& island, Shares shares);
  /// Most sweeps and the residual that ends them; after `least` sweeps the larger one for islands at rest.
  struct Effort {
    int least = 0, most = 0;
    double tolerance = 0, tolerance_at_rest = 0;
  };
  double rest_of(const Island& island, double rest) const;
  bool at_rest(const Island& island, double rest) const;
  bool unsolved(double residual, double tolerance, bool rests, double rest) const;
  Effort effort(const Island& island, int iterations, double tolerance, bool rests, double rest) const;
  Outcome sweep(const Island& island, const Effort& effort, bool accelerate);
  Outcome sweep_only(const Island& island, const Effort& effort);
  /// What sweeps may leave without being followed by pivots.
  enum class Residual : char { kNone, kOfMovingContacts };
  Outcome sweep_or_pivot(const Island& island, int iterations, double tolerance, double rest, Residual allowed);
  Outcome sweep(const Island& island, int iterations, double tolerance, double rest, Residual allowed);
  bool pivot_from_start(const Island& island, const Pivots& limits, double acceptable, Outcome& outcome);
  Outcome pivot(const Island& island, int iterations, double tolerance, double rest);
  bool newly_loaded(const Island& island) const;
  void assemble(const Island& island);
  void add_block(const Side& left, int rows, const Side& right, int columns, double* A, std::size_t stride) const;
  void reserve_pivoting(std::size_t cones, std::size_t boxes);

  std::vector<Slice> slices_;  // first those of the trees
  int trees_ = 0;
  std::vector<int> slice_of_body_, parent_;
  std::vector<double> z_;                  // change of the coordinates since measure()
  std::vector<double> z_start_;            // velocities of free bodies at measure(), in the same coordinates
  std::vector<double> z_before_, z_path_;  // z_ before the last sweep, and its change over the sweeps
  std::vector<double> y_;
  std::vector<BoxRow> boxes_, sorted_boxes_;     // sorted by islands; while rows are added: those of the last prepare()
  std::vector<GearParts> gears_, gears_before_;  // of the rows; of the last prepare()
  std::vector<ConeRow> cones_;
  std::vector<Core> cores_;  // sorted by islands
  std::vector<Island> islands_;
  std::vector<int> island_of_slice_, island_slices_;  // the slices sorted by islands

  Dantzig dantzig_;
  std::vector<double> A_, b_, lo_, hi_, x_, w_;
  std::vector<RowProfile> profile_;  // of A_
  std::vector<int> pairs_;           // pair of bodies of each row of A_
  std::uint64_t version_ = 0;        // of A_
  std::vector<double> diagonal_;     // of A_ without softness
  double rounding_ = 0;              // of the speeds at measure(), m/s
  bool linear_ = false;              // no contact opened, closed, slipped or began to stick in the last sweep
  bool assembled_ = false;           // A_ belongs to the only island, as prepared
  std::vector<FrictionCone> friction_;
  std::vector<RowProfile> users_;  // work array of assemble(): first and last row of each slice
  CentralImpulses holding_;
  std::vector<double> before_holding_;  // impulses of the island's rows
  std::vector<int> place_;              // of a slice's first element in z_ among the island's coordinates
  std::vector<int> latest_, before_;    // last side in each slice, and the previous side of each side, or −1
};

}  // namespace cotwin::contact_world
