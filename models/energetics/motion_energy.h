#pragma once
#include <vector>

#include "models/energetics/books.h"
#include "models/robot/changes/loads.h"
#include "models/robot/drives/drive_parameters.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::energetics {

/// A robot with rigid transmissions for the energy of planned motions:
///   τ_m = (M(q) + B) q̈ + C(q, q̇) q̇ + g(q) − J_Fᵀ f + τ_C sgn q̇ + σ q̇ + τ_0
/// with the loads of robot::LoadedDynamics. τ_C, σ, τ_0: friction of motor and link together. Joints without a motor (passive) need no torque.
struct RigidRobot {
  /// B and friction from the drives' parameters: τ_C + link τ_C and so on. Stribeck effect, presliding, springs and friction by load
  /// are left out.
  RigidRobot(const robot::RobotModel& robot, const robot::DriveParameters& drives);
  /// Without friction and motor inertia.
  explicit RigidRobot(const robot::RobotModel& robot, const robot::Loads& loads = {});

  std::size_t n() const { return B.size(); }

  robot::LoadedDynamics dynamics;
  std::vector<double> B, tau_C, sigma, tau_0;
  std::vector<bool> passive;
};

/// How finely a motion is divided: intervals per knot interval of the path, each with four nodes of Gauss. It is also divided where
/// a joint reverses and where a load comes or goes.
struct MotionGrid {
  int intervals = 64;
};

/// The books of a motion and what is behind its mechanical part, J.
struct MotionEnergy {
  EnergyBooks books;
  double kinetic = 0,
         potential = 0;  // end minus beginning; kinetic with that of the motors; of payloads while they are carried
  double friction = 0;   // ∫ (τ_C |q̇| + σ q̇² + τ_0 q̇) dt
  double external = 0;   // work of the external wrench on the robot
  double V = 0;          // voltage of the link at the end
  double t_peak = 0;     // s, when the link's power was greatest
  /// Work of the motors and of the external wrench minus Δkinetic, Δpotential and friction: error of the quadrature.
  double residual() const { return books.mechanical() + external - kinetic - potential - friction; }
};

/// Energy of the motion `path`, run `stretch` times as long as it is described. `accountant`: drives, link and supply of the robot;
/// V: voltage of the link at the beginning (0: V_min). The servo is on. Throws Error for a stretch ≤ 0, another number of joints
/// or values out of range.
MotionEnergy energy_of_motion(const RigidRobot& robot, const trajectory::Path& path, Accountant& accountant,
                              const Standby& standby, double stretch = 1, double V = 0, MotionGrid grid = {});

}  // namespace cotwin::energetics
