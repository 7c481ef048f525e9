#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "components/contact_world/engine/body.h"
#include "components/contact_world/engine/dantzig.h"
#include "components/contact_world/engine/forest.h"

namespace cotwin::contact_world {

/// One body's part in a row: `y` numbers of its slice of coordinates, in which inertia is the unit matrix.
struct Side {
  int offset = 0, size = 0;  // of the slice; size 0: the body has none
  std::size_t y = 0;         // where in the arena
};

/// One direction in which two bodies may be kept from moving against each other, with bounds on the impulse x:
///   u + softness · x = target   where lo < x < hi;   ≥ target where x = lo;   ≤ target where x = hi
/// u = d · (velocity of b − velocity of a, at p) + m · (angular velocity of b − that of a).
struct BoxRow {
  int a = -1, b = -1;  // bodies; −1: the world
  Vector3d d = Vector3d::Zero(), m = Vector3d::Zero(), p = Vector3d::Zero();
  double target = 0, softness = 0;
  double lo = -std::numeric_limits<double>::infinity(), hi = std::numeric_limits<double>::infinity();
  double x = 0;
  double applied = 0;  // of x, what the bodies' velocities have already
  double u = 0;        // at the coordinates' origin
  double A = 0, inverse_A = 0;
  double regular = 0;  // of the softness
  bool redundant = false;
  Side side[2];
  int origin = 0;  // how many had been added before it
  int island = 0;
};

/// One contact point: impulse x along the normal (from a to b) and two tangents, in Coulomb's cone:
///   u_n + softness · x_n ≥ target ⟂ x_n ≥ lo,   |x_t| ≤ μ x_n,   u_t against x_t where that is reached
struct ConeRow {
  int a = -1, b = -1;
  Matrix3d d;  // columns n, t1, t2 in W
  Vector3d p;
  double gap = 0;
  bool soft = false;  // by stiffness and damping, N/m and N.s/m; target and softness follow in prepare()
  double stiffness = 0, damping = 0;
  double target = 0, softness = 0, mu = 0;
  double lo = 0;  // ≤ 0; Dantzig takes 0
  double x[3] = {}, applied[3] = {};
  int point = 0;  // which contact of the step
  int island = 0;
};

/// The rows of one solution of a step, and their solvers.
class Rows {
 public:
  Rows(std::span<const RigidBody> bodies, const Forest& forest);

  /// Allocates for so many contact points and box rows now.
  void reserve(std::size_t cones, std::size_t boxes, bool pivoting);

  void clear();
  void add(const BoxRow& row) {
    boxes_.push_back(row);
    boxes_.back().origin = static_cast<int>(boxes_.size()) - 1;
  }
  void add(const ConeRow& row) { cones_.push_back(row); }
  bool empty() const { return boxes_.empty() && cones_.empty(); }
  std::span<BoxRow> boxes() { return boxes_; }
  std::span<ConeRow> cones() { return cones_; }

  /// Sorts the rows by islands and computes what depends on poses and on the trees' factors.
  void prepare(std::span<const RigidBody> bodies, const Forest& forest, double h);
  /// The same with what prepare() computed last, where poses and the trees' factors are those of then. False if the rows lie
  /// elsewhere: nothing has changed.
  bool update(double h);
  /// u of every row from the bodies' present twists.
  void measure(std::span<const RigidBody> bodies);

  struct Outcome {
    int iterations = 0;
    double residual = 0;
    int degenerate = 0;
    void add(const Outcome& other);
  };
  Outcome sweep(int iterations, double tolerance);
  Outcome pivot(int iterations, double tolerance);

  /// Adds what x has gained since it was applied last to the bodies' velocities: free bodies directly, those of trees as
  /// impulses in F.
  void apply(std::span<RigidBody> bodies, Forest& forest);

 private:
  struct Island {
    std::size_t first_box = 0, end_box = 0, first_cone = 0, end_cone = 0, first_slice = 0, end_slice = 0;
  };
  struct Slice {
    int offset = 0, size = 0;
  };
  enum class Hold : char { kOpen, kSticks, kSlips };
  /// What the sweeps read and write of a cone, in the order of the sweeps.
  struct Core {
    alignas(16) double x[4], change[4],
        way[4];               // x; what the last sweep changed of it; how far it came with what followed. [3] is 0
    alignas(16) double b[4];  // u at the coordinates' origin, less the target; [3] is 0
    double target, softness, mu, lo;
    double A_nn, A_n1, A_n2, A_11, A_12, A_22;  // of J M⁻¹ Jᵀ
    double inverse_11, inverse_12, inverse_22;  // of the tangents' block
    double inverse_nn, shift;                   // shift: what keeps the tangents' impulse on the cone, last time
    double regular;                             // of the softness
    bool redundant, moves, one_way;             // moves: it can at all; one_way: its tangents do along one direction alone
    Hold hold;                                  // after the last sweep
    Side side[2];
    std::size_t row;  // in cones_
    int point;        // that row's, when prepare() was called
  };

  int slice_of(int body) const { return body < 0 ? -1 : slice_of_body_[static_cast<std::size_t>(body)]; }
  int root(int slice);
  void join(int body_a, int body_b);
  void find_islands();
  void make_side(std::span<const RigidBody> bodies, const Forest& forest, int body, const Vector3d& d, const Vector3d& m,
                 const Vector3d& p, double sign, double* y) const;
  void make_sides(int a, int b, std::size_t rows, Side* sides);
  void make_free_sides(std::span<const RigidBody> bodies, const ConeRow& row, Core& core);
  void make_sides(std::span<const RigidBody> bodies, const Forest& forest, const ConeRow& row, Core& core);
  void load(Core& core, double h);
  void push(const Core& core, const double* change);
  double velocity(const double* y, const Side& side) const;
  void push(const double* y, const Side& side, double x);
  double solve(BoxRow& row);
  template <int kSizeA, int kSizeB>
  double solve(Core& core);
  double solve_any(Core& core);
  void start(const Island& island);
  void begin_following(const Island& island);
  struct Shares {
    double of_change = 0, of_way = 0;
  };
  double square_of_changes(const Island& island) const;
  Shares best_shares(const Island& island) const;
  void follow(const Island& island, Shares shares);
  Outcome sweep(const Island& island, int iterations, double tolerance);
  Outcome pivot(const Island& island, int iterations, double tolerance);
  bool newly_loaded(const Island& island) const;
  void assemble(const Island& island);
  void add_block(const Side& left, int rows, const Side& right, int columns, double* A, std::size_t stride) const;
  void reserve_pivoting(std::size_t cones, std::size_t boxes);

  std::vector<Slice> slices_;
  std::vector<int> slice_of_body_, parent_;
  std::vector<double> z_;                 // gained since measure()
  std::vector<double> z_before_, z_way_;  // before the last sweep, and over the sweeps
  std::vector<double> y_;
  std::vector<BoxRow> boxes_, sorted_boxes_;  // sorted by islands; while rows are added, as they were prepared last
  std::vector<ConeRow> cones_;
  std::vector<Core> cores_;  // sorted by islands
  std::vector<Island> islands_;
  std::vector<int> island_of_slice_, island_slices_;  // the slices sorted by islands

  Dantzig dantzig_;
  std::vector<double> A_, b_, lo_, hi_, x_, w_;
  std::vector<RowProfile> profile_;  // of A_
  std::vector<int> pairs_;           // of bodies, of its rows
  std::uint64_t version_ = 0;        // of A_
  std::vector<double> diagonal_;     // of A_ without softness
  bool linear_ = false;              // in the last sweep no contact opened, closed or slipped, nor began to stick
  bool assembled_ = false;           // A_ is that of the only island, as it was prepared
  std::vector<FrictionCone> friction_;
  std::vector<RowProfile> users_;     // of assemble(): the rows of each slice, from the first to the last
  std::vector<int> latest_, before_;  // the last side in each slice, and the one before each side, or −1
};

}  // namespace cotwin::contact_world
