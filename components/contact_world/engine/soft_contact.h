#pragma once
#include <algorithm>
#include <limits>

namespace cotwin::contact_world {

/// Spring and damper of a soft contact over half a step, as a function of the normal velocity u in the middle of the step.
///
/// The spring's impulse is that of the mean force by its potential V = k min(gap, 0)²/2,
///   x(u) = −h/2 (V(gap + h u) − V(gap)) / (h u)
/// and acts in both halves of the step. So the step keeps the energy for any stiffness (Gonzalez 1996), also if the bodies touch
/// or separate within it; in contact, it is the implicit midpoint rule. The damper acts during the part of the step in contact,
/// implicitly in each half.
///
/// Contacts with more damping, calm contacts whose oscillation the step does not resolve (they would oscillate from step to step
/// for ever), and all contacts where joints are swept have a law with numerical damping, which acts from the start of a step:
///   x(u) = −h/2 k (gap + θ h u) where gap ≤ 0,   θ = max(0, 1 − 1/(2 (h ω)²))
///
/// A contact with a limit is an elastic, perfectly plastic one: its force, with that of the damper, is at most the limit. V then
/// includes the energy that yielding dissipates, limit · (depth − limit/k), so that the mean force does its work to rounding.
struct SoftContact {
  double gap = 0, stiffness = 0, damping = 0;  // m at the start of the step, N/m, N.s/m
  double h = 0;                                // s
  bool conserves = false;
  double theta = 0;  // of the numerical damping

  double limit = std::numeric_limits<double>::infinity();  // N; the contact yields instead of exceeding it

  double spring(double u) const;  // N.s
  double share(double u) const;   // part of the step in contact
  double impulse(double u) const { return std::min(spring(u) - h / 2 * damping * share(u) * u, h / 2 * limit); }
  double slope(double u) const;  // d impulse / du ≤ 0
  double yielding_force(double u) const;
  /// The velocity u = w + A · impulse(u), impulse ≥ 0, for a mobility A (1/kg) and the velocity w without the contact.
  double solve(double w, double A) const;
};

/// (h ω)² above which a step does not resolve a spring and the mobility behind it.
inline constexpr double kUnresolved = 0.5;

/// Square of the damping ratio above which a contact has numerical damping.
inline constexpr double kDamped = 0.0625;

}  // namespace cotwin::contact_world
