#pragma once
#include <Eigen/Core>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "components/contact_world/engine/body/body.h"
#include "components/contact_world/engine/joints/joint.h"

namespace cotwin::contact_world {

/// A spatial vector at a tree's origin O, linear part first: a twist (velocity of the point at O), or a force or impulse with
/// its moment about O.
using Spatial = std::array<double, 6>;

/// The joints that close the loops of one tree, as constraints on the tree's freedoms, solved in the least-squares sense.
///
/// The rows Y of the constraints (in coordinates in which the tree's inertia is the unit matrix, scaled by the mobility that
/// the bodies would have without joints) are split by their singular values, Y = U Σ Vᵀ. Velocities along V are constrained;
/// directions with σ close to 0 are not, so redundant loops are no special case. A direction whose σ will pass 0, or has passed
/// it, within a few steps is free during these steps: near such a singular pose the direction itself is not defined. The gap that
/// results is corrected afterwards, with limited speed.
class Loops {
 public:
  struct Row {
    int joint = -1;
    int node_a = -1, node_b = -1;        // of the parent and the child; −1: not in the tree
    int carrier_a = -1, carrier_b = -1;  // driven body of a side without node; −1: at rest
    Vector3d d, m, p;                    // as BoxRow, at the last place()
    Spatial f{};                         // unit impulse at O
    double scale = 1;                    // 1/√(J M⁻¹ Jᵀ of the bodies without joints)
    double speed = 0;                    // wanted in this stage
    double start = 0;                    // part of `speed` that corrects the error at the start of the step
    double curve[3] = {};                // remaining part in the last three steps, latest first
    double correction = 0;               // of `speed`, from the last measure()
    double impulse = 0;                  // result of solve()
  };

  /// Adds the rows of a joint between two nodes or carriers.
  void add(int joint, scene::JointType type, int node_a, int node_b, int carrier_a, int carrier_b);
  /// Allocates for a tree with this number of freedoms, after the last add().
  void reserve(int freedoms);

  static constexpr int kMostRank = 64;  // of Y
  bool empty() const { return rows_.empty(); }
  std::size_t size() const { return rows_.size(); }
  std::span<Row> rows() { return rows_; }
  std::span<const Row> rows() const { return rows_; }

  /// Tells how the next place() follows the last one: as a step, or as a jump. Without a call, it is the same place.
  void advance() { since_ = Since::kStep; }
  void jump() { since_ = Since::kJump; }
  void place(const Vector3d& O, std::span<const RigidBody> bodies, std::span<const Joint> joints);
  /// Computes the directions V. `respond(row, y)` adds the response of the tree's freedoms to the row's unit impulse to y. σ of
  /// successive steps are compared where `locks`, a hash of the locked freedoms, is the same.
  template <class Respond>
  void factor(std::uint32_t locks, const Respond& respond) {
    for (std::size_t i = 0; i < rows_.size(); ++i) {
      double* y = Y_.data() + i * freedoms_;
      std::fill_n(y, freedoms_, 0.0);
      respond(rows_[i], y);
    }
    decompose(locks);
  }
  /// y −= V Vᵀ y: what the loops leave of a response of the tree's freedoms.
  void project(double* y) const;
  /// Sets `impulse` of each row such that its speed changes from `present` to `speed`, as far as the freedoms permit.
  void solve();
  std::span<double> present() { return present_; }

  /// Whether a direction is about to be constrained no more, or has just begun to be: links in line, for example.
  bool nearly_singular() const;

  /// Wants no speed along any row.
  void clear_speeds();
  /// Sets the speeds to their extrapolation from the last three steps plus the correction of the present errors in a step h.
  /// `momentum`: √(2 T) of the tree, which limits the corrections.
  void predict(std::span<const Joint> joints, double h, double momentum);
  void restart();
  /// Computes the correction of the speeds for the errors at the end of a trial step. Returns the largest remaining change of
  /// position, m or rad.
  double measure(std::span<const Joint> joints, double h);
  void correct();
  void store();
  void clear_history();
  /// What a step needs of the steps before it.
  std::span<double> memory() { return memory_; }
  std::span<const double> memory() const { return memory_; }

 private:
  enum class Since { kSamePlace, kStep, kJump };

  void decompose(std::uint32_t locks);
  bool limit(std::span<double> speeds);
  void limit_start();

  std::vector<Row> rows_;
  std::size_t freedoms_ = 0, rank_ = 0, kept_ = 0;
  double* curve(std::size_t row) { return memory_.data() + 3 * row; }

  std::vector<double> memory_;  // per row: the remaining part of its speed in the last three steps, latest first; per singular
                                // value: its last value and its change in a step; the hash of the locks
  std::vector<double> Y_;       // rows x freedoms, scaled
  std::vector<double> U_, V_;   // columns of rows and of freedoms
  std::vector<double> sigma_;   // singular values that are kept
  std::vector<double> present_, wanted_, along_;
  double furthest_ = 0;              // limit of corrections along a column of V
  bool limited_ = true;              // the speeds respect the limit
  Since since_ = Since::kSamePlace;  // the last factor()
  bool held_back_ = false;           // in this step the limit was less than a wanted speed
  // Without heap, so that nothing in the solver allocates.
  using Gram = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMostRank, kMostRank>;
  Gram gram_;
  Eigen::SelfAdjointEigenSolver<Gram> solver_;
};

}  // namespace cotwin::contact_world
