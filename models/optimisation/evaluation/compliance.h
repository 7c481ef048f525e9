#pragma once
#include <array>
#include <cstdint>
#include <functional>

namespace cotwin::optimisation {

/// Parameters of M ẍ + D ẋ + S x = f: kg, N s/m, N/m, or kg m², N m s/rad, N m/rad.
struct ComplianceValues {
  double M = 1, D = 1, S = 1;
};

/// Throws Error unless 0 < least ≤ most, finite, of each.
void check_ranges(const ComplianceValues& least, const ComplianceValues& most);

struct ComplianceProblem {
  ComplianceValues least, most;  // 0 < least ≤ most; equal: fixed
  /// What is minimised, such as the settling time or the time of a cycle (components/services, throughput). NaN counts as +∞.
  std::function<double(const ComplianceValues&)> cost;
  /// By how much a further condition is violated, such as stability at a stiff environment; 0 or less: met. May be empty.
  std::function<double(const ComplianceValues&)> violation = {};
  std::uint64_t seed = 1;
};

struct ComplianceSolution {
  ComplianceValues values;
  double cost = 0;
  bool feasible = false;
};

/// The best parameters within the bounds by a particle swarm over their logarithms with Deb's rules, then over ever smaller boxes
/// about the best ones. Costs may be discontinuous: settling times are, where an overshoot leaves the band. Same problem, same
/// bits. Throws Error for bounds out of range.
ComplianceSolution minimise_compliance(const ComplianceProblem& problem);

}  // namespace cotwin::optimisation
