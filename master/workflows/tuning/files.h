#pragma once
#include <filesystem>
#include <string>

#include "master/workflows/tuning/evaluation.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/atomic_file.h"

namespace cotwin::master::tuning {

/// The parameters of the drive train for the identified friction.
///   link    torques measured behind the gear, by a joint torque sensor: link_tau_C … or, sigmoid, link_A …; no motor
///   motor   torques measured at the motor: B, sigma2, tau_C … of the motor; a sigmoid, which the motor laws lack, at the link
///   both    link_load (friction that grows with the load), spring_sin, spring_cos (harmonics of the joint position)
/// `robot`: the prior; its inertia gives the least B, because the drive train needs B > 0. Bristles (sigma0, sigma1; not used
/// by friction=smooth) are chosen, not identified: 1 mrad of sliding deflection, with damping that keeps them passive.
ParameterSet drive_parameters(const std::string& name, const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const Settings& settings, const std::vector<identification::Torsion>& torsion);

/// The tuned robot: bodies of the estimate, one entry per body in the history, <dynamics> from its friction.
robot::RobotModel tuned_robot(const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const std::string& reason);
/// The URDF file of the prior with the values of `robot`, and `comment` at its start.
std::string tuned_urdf(const std::filesystem::path& file, const robot::RobotModel& robot, const std::string& comment);

}  // namespace cotwin::master::tuning
