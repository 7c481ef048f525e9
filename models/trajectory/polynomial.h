#pragma once
#include <optional>
#include <span>
#include <vector>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// Conditions at one end of a polynomial: position, velocity, acceleration and optionally jerk.
struct Boundary {
  double q = 0;                // rad
  double dq = 0;               // rad/s
  double ddq = 0;              // rad/s²
  std::optional<double> dddq;  // rad/s³
};

/// The redundant part of a polynomial of degree d ≥ 5 (V-B): position, velocity, acceleration (and jerk) at both ends determine
/// six (seven, eight) of its d + 1 coefficients; the others, c_r, are free.
///   q(s) = q_boundary(s) + Σ_k c_r,k φ_k(s),      φ_k(s) = μ_k sᵃ (1 − s)ᵇ P_k^(2b,2a)(2s − 1),      s = t/T,
/// with a = b = 3 (4 at an end with a prescribed jerk), so that c_r does not change the boundary conditions. P_k are Jacobi
/// polynomials: the φ_k are orthogonal in L²(0, 1), so the map c_r → q(t) is well conditioned at any degree. μ_k makes
/// max |φ_k| = 1: c_r has the unit of q, and |c_r,k| is the maximum displacement by term k. c_r = 0 gives the polynomial of
/// minimum degree.
class RedundantTerms {
 public:
  /// Throws Error for a degree below 5 plus the number of prescribed jerks, or above bernstein::kMaxDegree.
  explicit RedundantTerms(int degree, bool start_jerk = false, bool end_jerk = false);

  int degree() const { return degree_; }
  bool start_jerk() const { return start_jerk_; }
  bool end_jerk() const { return end_jerk_; }
  /// Number of redundant coefficients: degree − 5, minus one for each prescribed jerk.
  std::size_t size() const { return terms_.size(); }
  /// The degree + 1 control points of φ_k.
  std::span<const double> term(std::size_t k) const { return terms_[k]; }

 private:
  int degree_;
  bool start_jerk_, end_jerk_;
  std::vector<std::vector<double>> terms_;
};

/// Control points (degree + 1) over s = t/T of the polynomial from `start` to `end` in T seconds with coefficients c_r.
/// `terms` determines which jerks are prescribed. Throws Error if c_r or the jerks do not match `terms`, or T is not positive.
std::vector<double> make_polynomial(const Boundary& start, const Boundary& end, double T, const RedundantTerms& terms,
                                    std::span<const double> c_r);

}  // namespace cotwin::trajectory
