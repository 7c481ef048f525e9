#pragma once
#include <Eigen/Core>
#include <array>
#include <span>

/// First guesses of values at the end of a step.
namespace cotwin::master {

/// Extrapolates values x of equal steps by the polynomial of degree d through the last d + 1 of them,
///   x(n+1) ≈ x(n) + ∇x(n) + … + ∇^d x(n)   with the backward differences ∇^k x(n) = ∇^(k−1) x(n) − ∇^(k−1) x(n−1).
/// At step n this polynomial missed x(n) by ∇^(d+1) x(n): the degree is the one with which that was least lately.
class Extrapolation {
 public:
  static constexpr int kMostDegree = 7;

  explicit Extrapolation(Eigen::Index n) : differences_(Eigen::MatrixXd::Zero(n, kMostDegree + 1)) {}

  /// After a step from `first` to `last`. `continues`: the step before ended where this one began, and was as long; else the differences begin
  /// anew. `scale`: > 0, magnitude of each value.
  void add(const Eigen::VectorXd& first, const Eigen::VectorXd& last, const Eigen::VectorXd& scale, bool continues);
  /// The degree for a step as long as the last one; 0 before the first step.
  int degree() const;
  /// Adds the change in the next step to `x`, the last values. `degree`: up to that of degree().
  void advance(Eigen::VectorXd& x, int degree) const;
  /// x(n) − x(n−1)
  auto last_change() const { return differences_.col(0); }

  Eigen::Index state_size() const { return differences_.size() + kMostDegree + 2; }
  void save(std::span<double> numbers) const;
  /// `numbers` may be damaged.
  void restore(std::span<const double> numbers);

 private:
  Eigen::MatrixXd differences_;                   // column k: ∇^(k+1) x
  int known_ = 0;                                 // columns
  std::array<double, kMostDegree + 1> missed_{};  // by each degree lately, relative to the scale
};

}  // namespace cotwin::master
