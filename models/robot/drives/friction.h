#pragma once
#include <cmath>

/// Friction, torsion and stops of one joint, as value types. Speeds v in rad/s, torques in N.m, all quantities seen behind the
/// gear. A friction torque has the sign of v and is subtracted from the driving torque: B θ̈ + τ_J = τ_m − τ_f (2b). Friction
/// here does not depend on temperature.
namespace cotwin::robot {

/// A torque and its derivative by the speed (or by the angle of a spring).
struct TorqueAndSlope {
  double torque = 0;  // N.m
  double slope = 0;   // N.m.s/rad, or N.m/rad
};

/// Coulomb and viscous friction with a constant part, which makes it asymmetric:
///   τ_f(v) = h(v) tanh(v / v_R) + σ2 v + τ_0,   h(v) = τ_C + max(τ_S − τ_C, 0) e^{−|v / v_S|^δ}
/// Without a Stribeck effect (τ_S ≤ τ_C), h is τ_C. tanh regularises sign(v): within ±v_R the joint creeps instead of sticking;
/// a load τ < τ_C moves it at v_R artanh(τ / τ_C). Use StickSlip or Bristle where sticking matters.
struct CoulombViscous {
  double tau_C = 0;   // N.m, ≥ 0
  double sigma2 = 0;  // N.m.s/rad, ≥ 0
  double tau_0 = 0;   // N.m
  double v_R = 1e-2;  // rad/s, > 0
  double tau_S = 0;   // N.m, breakaway torque; up to τ_C: no Stribeck effect
  double v_S = 0.1;   // rad/s, > 0, Stribeck speed
  double delta = 2;   // Stribeck exponent
  TorqueAndSlope at(double v) const {
    return tau_C == 0 && tau_S == 0 ? TorqueAndSlope{sigma2 * v + tau_0, sigma2} : sliding(v);
  }

 private:
  TorqueAndSlope sliding(double v) const;
};

/// Torque of springs and counterbalances of a joint, Σ_k a_k sin(k q) + b_k cos(k q) for k = 1 … kMost, its slope by q, and the
/// stored energy ∫ τ dq, J.
struct Harmonics {
  static constexpr int kMost = 4;
  double a[kMost] = {}, b[kMost] = {};  // N.m
  bool present() const;
  TorqueAndSlope at(double q) const;
  double energy(double q) const;
};

/// Sigmoid friction of Gaz, Flacco, De Luca (ICRA 2014), identified for the LWR 4+ and, in the second form, for the Panda:
///   τ_f(v) = k + A / (1 + e^{−α (v + s)})
/// Smooth, without sticking; Coulomb friction of height A/2 about the offset k + A/2.
struct Sigmoid {
  double A = 0;      // N.m
  double alpha = 0;  // s/rad
  double s = 0;      // rad/s
  double k = 0;      // N.m
  TorqueAndSlope at(double v) const {
    if (A == 0) return {k, 0};
    const double logistic = 1 / (1 + std::exp(-(alpha * (v + s))));
    return {k + A * logistic, A * alpha * logistic * (1 - logistic)};
  }
};

/// A torque on a link with its derivatives.
struct LinkTorque {
  double torque = 0;    // N.m
  double by_speed = 0;  // N.m.s/rad
  double by_angle = 0;  // N.m/rad
};

/// Friction and springs on the link side of a joint, behind its torque sensor: τ_l in
///   M q̈ + C q̇ + g + τ_l = τ_J + τ_e                                          (2a)
///   τ_l = friction(q̇) + sigmoid(q̇) + load |g| tanh(q̇ / v_load) + spring(q)
/// The third term is friction that grows with the load of the gear, taken from the torque of gravity g.
struct LinkSideParameters {
  CoulombViscous friction;
  Sigmoid sigmoid;
  Harmonics spring;
  double load = 0;            // N.m per N.m of gravity
  double v_load = 1e-2;       // rad/s, > 0
  bool viscous_only = false;  // only friction.sigma2 and friction.tau_0 are present: at() skips the other terms

  CoulombViscous load_friction(double gravity) const { return {.tau_C = load * std::abs(gravity), .v_R = v_load}; }
  /// τ_l. `gravity`: g of the joint, N.m; used where load > 0. The slopes are at fixed gravity.
  LinkTorque at(double q, double dq, double gravity) const {
    const TorqueAndSlope f = friction.at(dq);
    if (viscous_only) return {f.torque, f.slope, 0};
    const TorqueAndSlope s = sigmoid.at(dq), l = load_friction(gravity).at(dq), k = spring.at(q);
    return {f.torque + s.torque + l.torque + k.torque, f.slope + s.slope + l.slope, k.slope};
  }
  /// The constant part of friction, N.m: it takes up work in one direction and gives it back in the other.
  double constant() const { return friction.tau_0 + sigmoid.at(0).torque; }
  /// Power lost in friction, without its constant part, W.
  double loss(double dq, double gravity) const {
    if (viscous_only) return friction.sigma2 * dq * dq;
    return (friction.at(dq).torque + sigmoid.at(dq).torque + load_friction(gravity).at(dq).torque - constant()) * dq;
  }
};

/// Parameters of a bristle between two surfaces, whose deflection z (rad) is a state:
///   τ_f = σ0 z + σ1 ż + σ2 v
///   g(v) = τ_C + (τ_S − τ_C) e^{−|v / v_S|^δ}         limit of σ0 |z| in sliding (Stribeck)
/// lugre() and elasto_plastic() give the two laws for ż.
struct Bristle {
  double sigma0 = 0;       // N.m/rad, stiffness of the bristle
  double sigma1 = 0;       // N.m.s/rad, its damping
  double sigma2 = 0;       // N.m.s/rad, viscous friction
  double tau_C = 0;        // N.m, Coulomb friction; at least kLeastSliding · tau_S is used
  double tau_S = 0;        // N.m, breakaway torque ≥ τ_C; 0: no bristle, only σ2 v
  double v_S = 0.1;        // rad/s, Stribeck speed
  double delta = 2;        // Stribeck exponent, 0.5 to 2 in the literature
  double breakaway = 0.7;  // z_ba / z_max in [0, 1): below this share of g(v)/σ0 the elasto-plastic bristle is purely elastic

  /// Keeps ż finite, which divides by g(v), where τ_C = 0.
  static constexpr double kLeastSliding = 1e-3;

  bool present() const { return sigma0 > 0 && (tau_C > 0 || tau_S > 0); }
  /// g and dg/dv.
  TorqueAndSlope stribeck(double v) const;
  /// Deflection in steady sliding, g(v) sign(v) / σ0; 0 at rest.
  double steady_deflection(double v) const;
};

/// τ_f and ż with their partial derivatives by v and z, for Jacobians. Where |v| has no derivative, the derivative from above
/// is used.
struct BristleRates {
  double torque = 0;
  double dz = 0;
  double torque_by_v = 0;
  double torque_by_z = 0;
  double dz_by_v = 0;
  double dz_by_z = 0;
};

/// LuGre: ż = v − σ0 |v| z / g(v) (Canudas de Wit, Olsson, Åström, Lischinsky, IEEE TAC 40(3), 1995). Drifts under a small
/// oscillating load about a constant load below breakaway.
BristleRates lugre(const Bristle& bristle, double v, double z);

/// z after a time h > 0 at constant v: the exact solution, stable for any σ0 |v| h / g and within ±max(|z|, g(v)/σ0).
double lugre_after(const Bristle& bristle, double v, double z, double h);

/// Elasto-plastic presliding: ż = v − a(z, v) σ0 |v| z / g(v) (Dupont, Hayward, Armstrong, Altpeter, IEEE TAC 47(5), 2002),
/// where a = 0 while |z| ≤ breakaway · g/σ0 or z and v have opposite signs, a = 1 from g/σ0 on, a half sine wave between. No
/// drift: a displacement below the breakaway deflection springs back. Fits the hysteresis of strain-wave gears better than
/// LuGre.
BristleRates elasto_plastic(const Bristle& bristle, double v, double z);

/// Coulomb, Stribeck and viscous friction with exact sticking: a mode, not a steep slope.
///   slipping in direction d = ±1:   τ_f = d g(v) + σ2 v          until v = 0
///   sticking:                       v = 0, |load| ≤ τ_S          until |load| > τ_S
/// The integrator finds the instants at which the mode changes.
struct StickSlip {
  /// The mode at v = 0 under `load`, the torque that friction has to hold: 0 sticks, ±1 slips in that direction.
  static int mode_at_rest(const Bristle& parameters, double load);
  /// Friction of slipping in `direction`, with its slope.
  static TorqueAndSlope slipping(const Bristle& parameters, double v, int direction);
};

/// The elastic torque of a gear over its torsion φ = θ − q: linear beyond a backlash of ±b, with a smooth dead zone
///   τ_J = K d(φ)                                                                              (2c)
///   d(φ) = φ + ½ (√((φ − b)² + ε²) − √((φ + b)² + ε²)),   ε = b / 10
/// For b = 0 this is K φ. Outside of the backlash it differs from K (φ − b) by at most K ε²/(2(φ − b)); its slope at φ = 0 is
/// 0.005 K.
struct Torsion {
  double K = 0;         // N.m/rad, > 0
  double backlash = 0;  // b, rad, ≥ 0: half of the play
  TorqueAndSlope at(double phi) const { return backlash == 0 ? TorqueAndSlope{K * phi, K} : with_backlash(phi); }
  /// ∫ τ_J dφ from 0, J.
  double energy(double phi) const;
  /// φ at which the torque is `torque`.
  double under(double torque) const { return backlash == 0 ? torque / K : under_with_backlash(torque); }

 private:
  TorqueAndSlope with_backlash(double phi) const;
  double under_with_backlash(double torque) const;
};

/// Torque of a hard stop at depth δ ≥ 0 and speed of approach δ̇: τ = k δ (1 + x δ̇ / v_0), never pulling (Hunt and Crossley,
/// 1975, with a linear spring). v_0 is the speed of the impact. With x = stop_damping(e) a free mass of any size leaves with e
/// v_0.
struct StopTorque {
  double torque = 0;    // N.m, pushing back
  double by_depth = 0;  // N.m/rad
  double by_speed = 0;  // N.m.s/rad
};
StopTorque stop_torque(double stiffness, double damping, double v_0, double depth, double speed);

/// Solves x (1 + e) = ln((1 + x) / (1 − e x)), the first integral of the stop over an impact, for x > 0; returns 0 for e = 1.
/// For 0.01 ≤ e ≤ 1.
double stop_damping(double restitution);

}  // namespace cotwin::robot
