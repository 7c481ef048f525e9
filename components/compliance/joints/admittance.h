#pragma once
#include "components/compliance/joints/limits.h"
#include "components/compliance/joints/second_order.h"

namespace cotwin::compliance {

/// Desired compliance of one joint (IV-A3): M_a Δ̈ + D Δ̇ + S_a Δ = τ_e, Δ = q_c − q_d, like (3a), with
///   D = max(D_a + 2 zeta_a √(S_a M_a), 2 zeta_a M_a omega_free)
/// The second term damps a freely guided joint (S_a = 0).
struct Admittance {
  double M_a = 1, D_a = 0, zeta_a = 1, S_a = 0, omega_free = 0;
};
SecondOrder relation(const Admittance& a);

/// Energy that compliance may give out beyond the energy that it received. With the stored energy E = ½ M_a Δ̇² + ½ S_a Δ² and
/// the content T of the tank,
///   E + T ≤ E(0) + T(0) + ∫ τ_e Δ̇ dt
/// for any course of M_a and S_a: T provides the energy for a rise of either; damping and a fall of either fill the tank. So
/// the joint is passive with the storage function E + T (energy tank: Ferraguti, Secchi, Fantuzzi, ICRA 2013).
struct Tank {
  double energy = 0;    // J
  double capacity = 0;  // J
};

/// Takes the energy for changes of mass and stiffness, J, from the tank, which what a fall of one releases fills first. Returns
/// the share of the rises that the tank has the energy for, at most 1.
double pay(double energy_of_M, double energy_of_S, Tank& tank);

/// Changes M_a and S_a of `now` to those of `next` as far as the tank has the energy for it at the deviation `at`. Returns
/// false if the energy was not sufficient.
bool change(Admittance& now, const Admittance& next, const Deviation& at, Tank& tank);

struct Compliant {
  Deviation Delta;  // Δ, Δ̇ at the end of the step
  double ddDelta = 0;
  Limit limit = Limit::kNone;  // that acted in the step
};

/// A step of h seconds under τ_e = tau_e + tau_e_rate t: the exact solution, or, if a limit acts, a motion with constant
/// acceleration to the allowed Δ. Damping fills the tank.
Compliant advance(const Admittance& a, const Deviation& start, double tau_e, double tau_e_rate, const Limits& limits,
                  const Desired& desired, double h, Tank& tank);

}  // namespace cotwin::compliance
