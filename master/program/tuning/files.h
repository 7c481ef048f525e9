#pragma once
#include <filesystem>
#include <string>

#include "master/program/tuning/evaluation.h"
#include "models/support/atomic_file.h"
#include "models/support/parameter_set.h"

namespace cotwin::master::tuning {

/// Where the drive train has the friction that was identified.
///   link    measured behind the gear, by a joint torque sensor: link_tau_C … or, sigmoid, link_A …; no motor
///   motor   measured at the motor: B, sigma2, tau_C … of the motor; a sigmoid, which its laws have not, as the link's
///   both    link_load (friction that grows with the load), spring_sin, spring_cos (harmonics of the joint's position)
/// `robot`: the prior, whose inertia says which B is none: the drive train needs one. Bristles (sigma0, sigma1; not used by
/// friction=smooth) are chosen, not identified: 1 mrad of sliding deflection, damped to stay passive.
ParameterSet drive_parameters(const std::string& name, const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const Settings& settings, const std::vector<identification::Torsion>& torsion);

/// The tuned robot: bodies of the estimate with an entry each in the history, <dynamics> from its friction.
robot::RobotModel tuned_robot(const robot::RobotModel& robot, const identification::Estimate& estimate,
                              const std::string& reason);
/// The URDF file that it was read from with its values in it, and `comment` at the head.
std::string tuned_urdf(const std::filesystem::path& file, const robot::RobotModel& robot, const std::string& comment);

}  // namespace cotwin::master::tuning
