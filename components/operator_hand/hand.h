#pragma once
#include <array>

#include "models/numerics/second_order.h"

namespace cotwin::operator_hand {

/// A hand along one axis: a mass m between the arm, which moves it by an intention x_i through a spring K with a damper D, and
/// a grip, whose spring K_g and damper D_g act with the share g = 0 (open) … 1 (closed) on the gripped point p:
///   m ẍ = f_m − f,   f_m = K (x_i − x) + D (ẋ_i − ẋ),   f = g (K_g (x − p) + D_g (ẋ − ṗ))
/// f is the force on the robot. The power balance of each axis is
///   d/dt (½ m ẋ² + ½ K (x_i − x)² + ½ g K_g (x − p)²) = f_m ẋ_i − f ṗ − D (ẋ_i − ẋ)² − g D_g (ẋ − ṗ)² + ½ ġ K_g (x − p)²
struct Hand {
  double m = 1, D = 0, K = 0, D_g = 0, K_g = 0;
};

/// Position and velocity at beginning, middle and end of a step.
using Course = std::array<numerics::Deviation, 3>;

/// Integrals over time, J.
struct Work {
  double muscles = 0;     // by the intention: ∫ f_m ẋ_i dt
  double robot = 0;       // on the robot: ∫ f ṗ dt
  double dissipated = 0;  // in both dampers
};

double force(const Hand& hand, double grip, const numerics::Deviation& x, const numerics::Deviation& p);
/// Energy of mass and springs, J.
double energy(const Hand& hand, double grip, const numerics::Deviation& x, const numerics::Deviation& x_i,
              const numerics::Deviation& p);

/// The state after h seconds: the exact solution for an intention and a gripped point that act linearly in each half of the
/// step, for any h, K and D. `work` grows by Simpson's rule.
numerics::Deviation advance(const Hand& hand, double grip, const numerics::Deviation& x, const Course& x_i, const Course& p,
                            double h, Work& work);

}  // namespace cotwin::operator_hand
