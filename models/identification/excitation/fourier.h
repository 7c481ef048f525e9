#pragma once
#include <cstddef>
#include <span>
#include <vector>

namespace cotwin::excitation {

/// A periodic motion of n joints as a finite Fourier series of the velocities,
///   q̇_j(t) = Σ_l a_jl cos(l ω t) + b_jl sin(l ω t),      l = 1 … harmonics,
/// whose coefficients satisfy Σ_l a_jl = 0 and Σ_l l b_jl = 0, so that q̇ = q̈ = 0 at the start and the end of each period.
struct FourierSeries {
  std::size_t joints = 0, harmonics = 0;
  double period = 0;            // s
  std::vector<double> a, b;     // joints · harmonics, joint by joint, rad/s
  std::vector<double> q_start;  // joints, rad, at the start of each period

  double omega() const;  // rad/s
  /// Position, velocity and acceleration of joint j at t.
  struct State {
    double q = 0, dq = 0, ddq = 0;
  };
  State at(std::size_t j, double t) const;
};

/// Changes the coefficients of one joint to the nearest ones at rest at the ends of the period: subtracts the mean from a, and
/// from b its part along (1, 2, …).
void bring_to_rest(std::span<double> a, std::span<double> b);

}  // namespace cotwin::excitation
