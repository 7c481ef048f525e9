#pragma once
#include "components/compliance/second_order.h"

namespace cotwin::compliance {

/// The largest stiffness K_e of an environment with which an admittance in one direction is stable:
///   M Δ̈ + D Δ̇ + S Δ = f,   x_c = x_d + Δ,   f = −K_e x
/// An environment without damping is the worst case.
///
/// For a robot with a position controller of its own, x = T x_c with T = ω²/(s² + 2ζω s + ω²), from Routh's criterion: with a₃ = D +
/// 2ζωM, a₂ = S + 2ζωD + ω²M, a₁ = 2ζωS + ω²D
///   K_e = a₁ (a₃ a₂ − M a₁)/(a₃² ω²) − S
/// For D = 0 it is 0.
double largest_contact_stiffness(const SecondOrder& admittance, double omega, double zeta);

/// A robot that follows x_c with tracking.h, reduced to one direction.
struct FollowingRobot {
  double mass = 1;          // kg, or kg.m² as the following; of the links if they are behind elastic joints, else with motors
  double motor = 0;         // kg
  double stiffness = 0;     // N/m; of the joints, 0: rigid
  double damping = 0;       // N.s/m; parallel to it
  double K_P = 0, K_D = 0;  // N/m, N.s/m; gains of tracking
  double shaping = 1;       // of the motor inertia
  double bandwidth = 500;   // rad/s; of the winding-up of elastic joints
  double step = 1e-3;       // s; torques are held for it
};

/// The same for such a robot. The measured force is fed forward, so the loop has only the delays of that: half a step, because
/// torques are held for it, and 2/bandwidth of the winding-up of elastic joints. During the delays the force itself moves the
/// links, which helps if they are not heavier than M.
///
/// The result is the least −1/G(jΩ) > 0, G = x/f of links, motors and controller without the environment (Nyquist), for 0.1 ≤ Ω ≤
/// π/step. It is at most min(M, mass)/step²: a contact that vibrates at more than 1/step rad/s is not resolved by the steps.
double largest_contact_stiffness(const SecondOrder& admittance, const FollowingRobot& robot);

}  // namespace cotwin::compliance
