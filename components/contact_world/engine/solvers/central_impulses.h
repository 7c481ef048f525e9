#pragma once
#include <Eigen/Core>
#include <cstddef>
#include <limits>
#include <span>
#include <vector>

#include "components/contact_world/engine/solvers/incremental_ldl.h"

namespace cotwin::contact_world {

/// Finds impulses x strictly within their bounds for which no row moves: w = A x + b = 0 with A = Y Yᵀ + softness. Where there are many, it finds
/// ones near their analytic centre, which maximises the product of the distances from the bounds [Boyd, Vandenberghe 2004, sections 8.5 and 11.3]:
/// redundant contacts share the load, and no small change of it makes them slip.
///
/// Newton's method follows the minima of ½ xᵀAx + bᵀx + τ B(x) for falling τ; B is −ln(μ² x_n² − |x_t|²) for a contact and −ln(x − lo) − ln(hi − x)
/// for a row. It solves for v = Yᵀ Δx, the change of the bodies' coordinates, which are fewer than the rows.
class CentralImpulses {
 public:
  /// A row, or a contact with friction and the rows n, t1, t2. Its coefficients are those of two slices of coordinates.
  struct Block {
    struct Part {
      const double* y = nullptr;  // count x size, row-major
      int first = 0, size = 0;    // of the coordinates
    } part[2];
    int count = 3;
    double mu = 0, softness = 0;                                  // of the first row
    double lo = 0, hi = std::numeric_limits<double>::infinity();  // of a single row
    Eigen::Vector3d x = Eigen::Vector3d::Zero(), w = Eigen::Vector3d::Zero();
    // Of the Newton step
    Eigen::Matrix3d inverse;
    Eigen::Vector3d gradient, step;
  };

  static constexpr int kMostCoordinates = 360;

  void reserve(std::size_t blocks, std::size_t coordinates);
  void clear() { blocks_.clear(); }
  void add(const Block& block) { blocks_.push_back(block); }
  std::span<const Block> blocks() const { return blocks_; }

  /// Starts from the rows' x, and w at that x. Returns whether it found impulses with |w| ≤ enough (m/s). Redundant rows may contradict each other
  /// by as much, for example where gaps differ by nanometres.
  bool solve(int coordinates, double enough);

 private:
  static bool inside(const Block& block, double share);
  static void place_inside(Block& block, double load);
  static void differentiate(Block& block, double tau);
  double drop_contradictions();
  bool factor();
  void find_steps(bool to_rest);
  double move(double share);

  std::vector<Block> blocks_;
  std::size_t n_ = 0;
  std::vector<double> matrix_, v_;  // I + Yᵀ D⁻¹ Y; v
  IncrementalLdl ldl_;
};

}  // namespace cotwin::contact_world
