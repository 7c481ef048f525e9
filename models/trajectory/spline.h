#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::trajectory {

/// Boundary conditions of a spline.
enum class SplineEnds {
  kRest,  // q̇ = q̈ = 0
  kFree   // q̇ and q̈ of the polynomial through the first (last) six points
};

/// Velocities and accelerations at the knots, row by row as q.
struct SplineKnots {
  std::vector<double> dq, ddq;
};

/// The interpolating quintic spline: among all motions through q(t_k) with the given q̇ and q̈ at both ends, the one of minimum
/// ∫ jerk² dt. It is C⁴ (jerk and snap are continuous at every inner knot) and exact for polynomials up to degree five with
/// free ends. On a regular grid it is symmetric in time, so it has no delay, and its derivatives are of fourth order or better.
/// `t` has N ≥ 2 increasing times, `q` N·joints values, row by row. Costs O(N·joints).
SplineKnots solve_spline(std::span<const double> t, std::size_t joints, std::span<const double> q, SplineEnds ends);

}  // namespace cotwin::trajectory
