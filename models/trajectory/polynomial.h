#pragma once
#include <optional>
#include <span>
#include <vector>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// What a joint does at one end of a polynomial: position, velocity, acceleration and, where prescribed, jerk.
struct Boundary {
  double q = 0;                // rad
  double dq = 0;               // rad/s
  double ddq = 0;              // rad/s²
  std::optional<double> dddq;  // rad/s³
};

/// The redundant part of a polynomial of degree d ≥ 5 (V-B): of its d + 1 coefficients, six (seven, eight) are bound by
/// position, velocity, acceleration (and jerk) at both ends, the others, c_r, are free.
///   q(s) = q_boundary(s) + Σ_k c_r,k φ_k(s),      φ_k(s) = μ_k sᵃ (1 − s)ᵇ P_k^(2b,2a)(2s − 1),      s = t/T,
/// with a = b = 3 (4 at an end whose jerk is prescribed), so that no c_r touches a boundary condition. P_k are Jacobi
/// polynomials: the φ_k are orthogonal in L²(0, 1), which keeps the map c_r → q(t) well conditioned at any degree. μ_k makes
/// max |φ_k| = 1: c_r has the unit of q and c_r,k is the most that term k moves the joint. c_r = 0 is the polynomial of least
/// degree.
class RedundantTerms {
 public:
  /// Throws Error for a degree below 5 plus the number of prescribed jerks, or above bernstein::kMaxDegree.
  explicit RedundantTerms(int degree, bool start_jerk = false, bool end_jerk = false);

  int degree() const { return degree_; }
  bool start_jerk() const { return start_jerk_; }
  bool end_jerk() const { return end_jerk_; }
  /// The number of redundant coefficients: degree − 5, less one for each prescribed jerk.
  std::size_t size() const { return terms_.size(); }
  /// The degree + 1 control points of φ_k.
  std::span<const double> term(std::size_t k) const { return terms_[k]; }

 private:
  int degree_;
  bool start_jerk_, end_jerk_;
  std::vector<std::vector<double>> terms_;
};

/// The control points (degree + 1) over s = t/T of the polynomial from `start` to `end` in T seconds with coefficients c_r.
/// The jerks are prescribed where `terms` says so. Throws Error if c_r or the jerks do not fit `terms`, or T is not positive.
std::vector<double> make_polynomial(const Boundary& start, const Boundary& end, double T, const RedundantTerms& terms,
                                    std::span<const double> c_r);

}  // namespace cotwin::trajectory
