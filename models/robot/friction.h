#pragma once

/// What stands between a motor's torque and a joint's: friction, and the torsion characteristic of the gear. Value types of one
/// joint; speeds v in rad/s, torques in N.m; everything seen behind the gear. A friction torque opposes the motion: it has the
/// sign of v and stands with a minus on the side of the driving torque, B θ̈ + τ_J = τ_m − τ_f (2b). Temperature and load are
/// not in here.
namespace cotwin::robot {

/// A torque and its derivative by the speed (or by the angle of a spring).
struct TorqueAndSlope {
  double torque = 0;  // N.m
  double slope = 0;   // N.m.s/rad, or N.m/rad
};

/// Coulomb and viscous friction with an offset, in which a robot's friction comes out asymmetric:
///   τ_f(v) = h(v) tanh(v / v_R) + σ2 v + τ_0,   h(v) = τ_C + max(τ_S − τ_C, 0) e^{−|v / v_S|^δ}
/// h is τ_C without a Stribeck effect (τ_S ≤ τ_C). tanh regularises sign(v): within ±v_R the joint creeps instead of sticking,
/// a load τ < τ_C moves it at v_R artanh(τ / τ_C). Where sticking matters, use exact stick–slip (StickSlip) or a bristle
/// (Bristle).
struct CoulombViscous {
  double tau_C = 0;   // N.m, ≥ 0
  double sigma2 = 0;  // N.m.s/rad, ≥ 0
  double tau_0 = 0;   // N.m
  double v_R = 1e-2;  // rad/s, > 0
  double tau_S = 0;   // N.m, breakaway torque; up to τ_C: no Stribeck effect
  double v_S = 0.1;   // rad/s, > 0, Stribeck speed
  double delta = 2;   // Stribeck exponent
  TorqueAndSlope at(double v) const;
};

/// The torque of springs and counterbalances of a joint, Σ_k a_k sin(k q) + b_k cos(k q) for k = 1 … kMost, its slope
/// by q, and the energy ∫ τ dq that it stores, J.
struct Harmonics {
  static constexpr int kMost = 4;
  double a[kMost] = {}, b[kMost] = {};  // N.m
  bool present() const;
  TorqueAndSlope at(double q) const;
  double energy(double q) const;
};

/// Sigmoid friction of Gaz, Flacco, De Luca (ICRA 2014), as identified for the LWR 4+ and, in the second form, for the Panda:
///   τ_f(v) = k + A / (1 + e^{−α (v + s)})
/// Smooth, no sticking; Coulomb friction of height A/2 about the offset k + A/2.
struct Sigmoid {
  double A = 0;      // N.m
  double alpha = 0;  // s/rad
  double s = 0;      // rad/s
  double k = 0;      // N.m
  TorqueAndSlope at(double v) const;
  /// The form of Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca (RA-L 2019), without torque at rest:
  ///   τ_f(v) = φ1 / (1 + e^{−φ2 (v + φ3)}) − φ1 / (1 + e^{−φ2 φ3})
  static Sigmoid without_torque_at_rest(double phi1, double phi2, double phi3);
};

/// Parameters of a bristle between two surfaces, whose deflection z (rad) is a state:
///   τ_f = σ0 z + σ1 ż + σ2 v
///   g(v) = τ_C + (τ_S − τ_C) e^{−|v / v_S|^δ}         what σ0 |z| tends to in sliding (Stribeck)
/// The two laws for ż are lugre() and elasto_plastic().
struct Bristle {
  double sigma0 = 0;  // N.m/rad, stiffness of the bristle
  double sigma1 = 0;  // N.m.s/rad, its damping
  double sigma2 = 0;  // N.m.s/rad, viscous friction
  double tau_C = 0;   // N.m, Coulomb friction; below kLeastSliding · tau_S that counts: a bristle slides against something
  double tau_S = 0;   // N.m, breakaway torque ≥ τ_C; 0: no bristle, only σ2 v
  double v_S = 0.1;   // rad/s, Stribeck speed
  double delta = 2;   // Stribeck exponent, 0.5 to 2 in the literature
  double breakaway = 0.7;  // z_ba / z_max in [0, 1): below this share of g(v)/σ0 the elasto-plastic bristle is purely elastic

  /// ż divides by g(v), which would tend to 0 where τ_C = 0.
  static constexpr double kLeastSliding = 1e-3;

  bool present() const { return sigma0 > 0 && (tau_C > 0 || tau_S > 0); }
  /// g and dg/dv.
  TorqueAndSlope stribeck(double v) const;
  /// Torque of steady sliding, g(v) sign(v) + σ2 v.
  double steady_torque(double v) const;
  /// The bristle's deflection in steady sliding, g(v) sign(v) / σ0; 0 at rest.
  double steady_deflection(double v) const;
  /// True where the map v → τ_f dissipates whatever the motion: σ2 ≥ σ1 (τ_S − τ_C) / τ_C (Barabanov and Ortega, IEEE TAC
  /// 45(4), 2000).
  bool passive() const;
};

/// τ_f and ż with their partial derivatives by v and z, for Jacobians. Where |v| has no derivative, that from above stands.
struct BristleRates {
  double torque = 0;
  double dz = 0;
  double torque_by_v = 0;
  double torque_by_z = 0;
  double dz_by_v = 0;
  double dz_by_z = 0;
};

/// LuGre: ż = v − σ0 |v| z / g(v) (Canudas de Wit, Olsson, Åström, Lischinsky, IEEE TAC 40(3), 1995). Drifts under a small load
/// that oscillates about a constant one below breakaway.
BristleRates lugre(const Bristle& bristle, double v, double z);

/// z after a time h > 0 in which v is constant: exact, hence stable for any σ0 |v| h / g, and never beyond ±max(|z|, g(v)/σ0).
double lugre_after(const Bristle& bristle, double v, double z, double h);

/// Elasto-plastic presliding: ż = v − a(z, v) σ0 |v| z / g(v) (Dupont, Hayward, Armstrong, Altpeter, IEEE TAC 47(5), 2002),
/// where a = 0 while |z| ≤ breakaway · g/σ0 or z and v have opposite signs, a = 1 from g/σ0 on, a half sine wave between. No
/// drift: what is moved by less than the breakaway deflection springs back. Fits the hysteresis of strain-wave gears better
/// than LuGre.
BristleRates elasto_plastic(const Bristle& bristle, double v, double z);

/// Coulomb, Stribeck and viscous friction of which sticking is exact: a mode, not a steep slope.
///   slipping in direction d = ±1:   τ_f = d g(v) + σ2 v          until v = 0
///   sticking:                       v = 0, |load| ≤ τ_S          until |load| > τ_S
/// Whoever integrates finds the instants at which the mode changes.
struct StickSlip {
  /// The mode at v = 0 under `load`, the torque that friction has to hold: 0 sticks, ±1 slips in that direction.
  static int mode_at_rest(const Bristle& parameters, double load);
  /// Friction of slipping in `direction`, with its slope.
  static TorqueAndSlope slipping(const Bristle& parameters, double v, int direction);
};

/// The elastic torque of a gear over its torsion φ = θ − q: linear beyond a backlash of ±b, with a smooth dead zone
///   τ_J = K d(φ),   d(φ) = φ + ½ (√((φ − b)² + ε²) − √((φ + b)² + ε²)),   ε = b / 10
/// which is K φ for b = 0, within K ε²/(2(φ − b)) of K (φ − b) outside, and has the slope 0.005 K at φ = 0.
struct Torsion {
  double K = 0;         // N.m/rad, > 0
  double backlash = 0;  // b, rad, ≥ 0: half of the play
  TorqueAndSlope at(double phi) const;
  /// ∫ τ_J dφ from 0, J.
  double energy(double phi) const;
  /// φ at which the torque is `torque`.
  double under(double torque) const;
};

/// A joint's hard stop, in depth δ ≥ 0 and speed of approach δ̇: τ = k δ (1 + x δ̇ / v_0), never pulling (Hunt and Crossley,
/// 1975, with a linear spring). v_0 is the speed of the impact. With x = stop_damping(e) a free mass of any size leaves with e
/// v_0.
struct StopTorque {
  double torque = 0;    // N.m, pushing back
  double by_depth = 0;  // N.m/rad
  double by_speed = 0;  // N.m.s/rad
};
StopTorque stop_torque(double stiffness, double damping, double v_0, double depth, double speed);

/// x > 0 of x (1 + e) = ln((1 + x) / (1 − e x)), the first integral of the stop above over an impact; 0 for e = 1. For 0.01 ≤ e
/// ≤ 1.
double stop_damping(double restitution);

}  // namespace cotwin::robot
