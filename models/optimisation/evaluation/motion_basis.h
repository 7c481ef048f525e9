#pragma once
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "models/numerics/batch.h"
#include "models/trajectory/polynomial.h"

namespace cotwin::optimisation {

/// Conditions at both ends of a motion of n joints.
struct Ends {
  std::vector<double> q_from, dq_from, ddq_from;  // n each; rad, rad/s, rad/s²
  std::vector<double> q_to, dq_to, ddq_to;
  bool at_rest() const;
  bool at_rest_at_end() const;
};

/// Polynomials over s = t/T in [0, 1] as linear functions of a few coordinates per joint,
///   q(s) = Σ_c x_c β_c(s),   x = [q_from, q_to, (T q̇_from, T² q̈_from, T q̇_to, T² q̈_to,) c_r],
/// with the conditions in brackets only if some joint is not at rest at an end. Tables of β_c in the layout of BatchMatrix
/// evaluate eight motions at once.
class MotionBasis {
 public:
  /// `degree` 5 to bernstein::kMaxDegree.
  MotionBasis(int degree, bool at_rest);

  int degree() const { return terms_.degree(); }
  std::size_t columns() const { return points_.size(); }
  std::size_t boundary_columns() const { return at_rest_ ? 2 : 6; }
  std::size_t redundant() const { return terms_.size(); }
  bool at_rest() const { return at_rest_; }
  const trajectory::RedundantTerms& terms() const { return terms_; }
  /// The degree + 1 control points of β_c.
  std::span<const double> points(std::size_t c) const { return points_[c]; }

  /// Row k: dʳβ_c/dsʳ at s[k], r ≤ 3.
  numerics::BatchMatrix table(std::span<const double> s, int derivative) const;
  /// Control points of dʳβ_c/dsʳ on `parts` equal parts of [0, 1]; neighbouring parts share a point: parts · (degree − r) + 1
  /// rows. Every (degree − r)-th value is attained, and all values bound the derivative.
  numerics::BatchMatrix hull(int parts, int derivative) const;

 private:
  trajectory::RedundantTerms terms_;
  bool at_rest_;
  std::vector<std::vector<double>> points_;
};

}  // namespace cotwin::optimisation
