#pragma once
#include <vector>

#include "models/energetics/books.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/robot/dynamics.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::energetics {

/// A robot with rigid transmissions for the energy of planned motions:
///   τ_m = (M(q) + B) q̈ + C(q, q̇) q̇ + g(q) + τ_C sgn q̇ + σ q̇ + τ_0
/// τ_C, σ, τ_0: friction of motor and link together. Joints without a motor (passive) need no torque.
struct RigidRobot {
  /// B and friction from the drives' parameters: τ_C + link τ_C and so on. Stribeck effect, presliding, springs and friction by load
  /// are left out.
  RigidRobot(const robot::RobotModel& robot, const robot::DriveParameters& drives);
  /// Without friction and motor inertia.
  explicit RigidRobot(const robot::RobotModel& robot);

  std::size_t n() const { return B.size(); }

  robot::Mechanism mechanism;
  std::vector<double> B, tau_C, sigma, tau_0;
  std::vector<bool> passive;
};

/// How finely a motion is divided: intervals per knot interval of the path, each with four nodes of Gauss. It is also divided where
/// a joint reverses.
struct MotionGrid {
  int intervals = 64;
};

/// The books of a motion and what is behind its mechanical part, J.
struct MotionEnergy {
  EnergyBooks books;
  double kinetic = 0, potential = 0;  // end minus beginning; kinetic with that of the motors
  double friction = 0;                // ∫ (τ_C |q̇| + σ q̇² + τ_0 q̇) dt
  double V = 0;                       // voltage of the link at the end
  double t_peak = 0;                  // s, when the link's power was greatest
  /// Mechanical work of the motors minus Δkinetic, Δpotential and friction: error of the quadrature.
  double residual() const { return books.mechanical() - kinetic - potential - friction; }
};

/// Energy of the motion `path`, run `stretch` times as long as it is described. `accountant`: drives, link and supply of the robot;
/// V: voltage of the link at the beginning (0: V_min). The servo is on. Throws Error for a stretch ≤ 0, another number of joints
/// or values out of range.
MotionEnergy energy_of_motion(const RigidRobot& robot, const trajectory::Path& path, Accountant& accountant,
                              const Standby& standby, double stretch = 1, double V = 0, MotionGrid grid = {});

/// Energy of a motion as a function of the factor κ of its duration (q(t) = p(t/κ)), for a link that stores or feeds back all that
/// comes back:
///   E(κ) = c3/κ³ + c2/κ² + c1/κ + c0 + idle κ
/// With τ = a/κ² + σp′/κ + b, a = (M + B)p″ + C p′, b = τ_C sgn p′ + τ_0 + g, and r = m R/k_t²: c3 = ∫Σ r a², c2 = 2∫Σ r a σp′,
/// c1 = ∫Σ r (σ²p′² + 2ab) + ∫Σ (σ + k_e) p′², c0 = 2∫Σ r σp′b + Δpotential + ∫Σ (τ_C + k_h) |p′| + τ_0 Δp, idle = ∫Σ r b² + P T.
/// The losses V_0 |i| of converters are not polynomial and not included.
struct StretchEnergy {
  double c3 = 0, c2 = 0, c1 = 0, c0 = 0, idle = 0;
  double duration = 0;  // s, at κ = 1

  double at(double stretch) const;
  /// The least of at() in [low, high], 0 < low ≤ high (high may be infinite if idle > 0).
  double best(double low, double high) const;
};

/// The polynomial for the power `P` (W) that is drawn whether or not the robot moves. `only_torques`: ∫ Σ r τ² dt alone, without
/// mechanical work and P.
StretchEnergy stretch_energy(const RigidRobot& robot, const trajectory::Path& path, const Accountant& accountant, double P,
                             bool only_torques = false, MotionGrid grid = {});

/// The duration of least P T + A/T³: (3A/P)^(1/4), s.
double best_duration(double P, double A);

}  // namespace cotwin::energetics
