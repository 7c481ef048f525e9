#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::trajectory {

/// How a spline begins and ends.
enum class SplineEnds {
  kRest,  // q̇ = q̈ = 0
  kFree   // q̇ and q̈ of the polynomial through the first (last) six points
};

/// Velocities and accelerations at knots, row by row as q.
struct SplineKnots {
  std::vector<double> dq, ddq;
};

/// The interpolating quintic spline: of all motions through q(t_k) with the given q̇ and q̈ at both ends, the one of least ∫
/// jerk² dt. It is C⁴ (jerk and snap continuous at every inner knot), and exact for polynomials up to degree five with free
/// ends. On a regular grid it is symmetric in time, so it delays nothing, and its derivatives are of fourth order or better.
/// `t` has N ≥ 2 increasing instants, `q` N·joints values, row by row. Work grows with N·joints.
SplineKnots solve_spline(std::span<const double> t, std::size_t joints, std::span<const double> q, SplineEnds ends);

}  // namespace cotwin::trajectory
