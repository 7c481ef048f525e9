#pragma once
#include <complex>

/// When a robot that is guided by hand vibrates (VI-C).
namespace cotwin::guidance {

/// The loop of a position-controlled robot that is guided through its twin, along one direction, x_i = 0:
///   hand        f = −K_e(s) p,   K_e = G F/(G + F),   G = K_g + D_g s,   F = m_h s² + D_h s + K_h
///   sensor      first-order low-pass 1/(1 + s/(2π cutoff))
///   admittance  M p_c″ + D p_c′ = f      (3a) with S = 0
///   delay       e^(−s delay), that of the sensor and of the line together
///   robot       p = T p_c + C f; if it is rigid,   T = ω² z/N,   C = 1/(mass N),   N = s² + (2ζω s + ω²) z
///               with an elastic gear K_J before a motor B, and a position control of the motor (components/compliance/joints/tracking.h):
///               T = k r/Δ,   C = (B s² + k + a)/Δ,   Δ = m s² (B s² + k + a) + k (B s² + a),   k = K_J + D_J s,
///               m = mass − B,   a = mass (2ζω s + ω²) z,   r = mass ω² z
///   synchronisation of robot and twin (V-D, components/io/links/synchronisation.h): the robot's command is p_c + P e^(−s cycle) (p_c − p),
///               P = K_P + K_D (1 − e^(−s cycle))/cycle, with p as it was measured, `delay` before it acts again
/// h is the step for which the position controller holds its torque: z = (1 − e^(−sh))/(sh), 1 for h = 0. With h > 0 the low-pass
/// is the sampled one.
struct Loop {
  double m_h = 0, D_h = 0, K_h = 300;  // kg, N.s/m, N/m; see components/operator_hand/hand.h
  double D_g = 0, K_g = 0;             // N.s/m, N/m; K_g = 0: the hand is fixed to the robot, G = ∞
  double cutoff = 0;                   // Hz; 0: no filter
  double delay = 0;                    // s
  double omega = 0, zeta = 1,
         mass = 0;                 // 1/s, 1, kg; omega = 0: the robot follows exactly; mass (with the motor) = 0: nor yields
  double h = 0;                    // s
  double K_J = 0, D_J = 0, B = 0;  // N/m, N.s/m, kg; K_J = 0: rigid
  double K_P = 0, K_D = 0, cycle = 0;  // 1, s, s; cycle > 0 where K_P or K_D is not 0
};

/// Gain from p_c to −f at s, with sensor and delay: the closed loop has its poles where M s² + D s + gain(s) = 0.
std::complex<double> gain(const Loop& loop, std::complex<double> s);

struct Border {
  double D = 0;      // N.s/m: stable for every larger damping; 0: for every damping
  double omega = 0;  // rad/s: of the vibration at the border
};
/// The border of vibration for the inertia M > 0 of the admittance, by D-partition: on the imaginary axis
///   M ω² = Re gain(jω),   D ω = −Im gain(jω)
/// so every ω that fulfils the first equation belongs to one D; the largest is the border. The delay is exact.
Border damping_border(const Loop& loop, double M);

/// The number of poles with a positive real part, by the argument principle (Nyquist). The delay is exact. 0 for M: q_c does not depend on the
/// hand, and the poles are those of robot and synchronisation.
int unstable_poles(const Loop& loop, double M, double D);

/// The largest K_P ≤ 10 at which the loop is stable with M and D (M = 0: as above) and K_D = 0, for all smaller ones too, to 1e-3. 0: it vibrates
/// without synchronisation.
double synchronisation_border(Loop loop, double M, double D);

}  // namespace cotwin::guidance
