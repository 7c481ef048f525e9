#pragma once
#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "models/optimisation/evaluation/problem.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::services {

/// Vectors are in the axes of B0: the robot's base frame as the motion begins, at rest in an inertial frame.
struct ReactionOptions {
  Eigen::Vector3d momentum = Eigen::Vector3d::Zero();  // of the whole robot, N s
  Eigen::Vector3d spin = Eigen::Vector3d::Zero();      // its angular momentum about its centre of mass, N m s
  optimisation::DriveTerms drives;
  std::size_t samples = 101;  // of the series
};

/// The base B at a time.
struct BaseAt {
  double t = 0;                  // s
  Eigen::Quaterniond attitude;   // of B in B0, w >= 0
  double turn = 0;               // angle of this rotation, 0 to π rad
  Eigen::Vector3d rate;          // angular velocity, rad/s
  Eigen::Vector3d displacement;  // of B's origin, m
};

struct Reaction {
  double mass = 0;  // of the whole robot, kg
  BaseAt end;
  BaseAt most_turned, fastest, farthest;
  std::optional<BaseAt> drift;            // with momentum: the end if the joints stood still in the first posture
  std::vector<trajectory::Peak> torques;  // of largest magnitude, per joint, N m or N
  double torque = 0, work = 0, jerk = 0;  // ∫ Σ τ² dt, ∫ Σ max(τ q̇, 0) dt in J, and ∫ Σ (d³q/dt³)² dt
  std::vector<BaseAt> series;
};

/// What a joint motion does to the base of a robot that floats freely (V-C): ω = Z q̇ + I_C⁻¹ Rᵀ L, of which the attitude R is integrated
/// (Munthe-Kaas' Runge–Kutta method of order 4, with steps that are halved until it changes by less than 1e-10 rad, with 250 000 steps by less than 1e-6 rad); the position follows from the centre of mass. Torques are
/// M* q̈ + b* and those of the motors. Throws Error for a base without physical mass distribution, and where the base turns too fast to be
/// followed.
Reaction reaction(const robot::RobotModel& robot, const trajectory::Path& path, const ReactionOptions& options);

}  // namespace cotwin::services
