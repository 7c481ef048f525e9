#pragma once
#include <vector>

#include "models/robot/robot_model.h"

/// What stands in for inertias that are missing in a URDF or that no body can have (Unphysical::kEstimate).
namespace cotwin::robot {

/// The inertia of a body that is closest to `given`: its mass and centre of mass are kept. Moments of inertia belong to a body if the
/// second moments of mass, Σ = tr(I)/2 𝟙 − I, are positive; those below 10⁻³ of the largest are raised to this value. Without a positive
/// second moment the body is a solid sphere of aluminium. Nothing for a mass that is not positive, or numbers that are not finite.
Inertia repaired(const Inertia& given);

/// The inertia of each of the robot's bodies as a solid rod of aluminium (2700 kg/m³) from its joint to the farthest joint or frame that
/// it carries, as thick as a tenth of the robot's reach: about 20 kg for an arm of 1 m. Arms weigh half to five times that.
std::vector<Inertia> estimated_inertia(const RobotModel& robot);

/// Length of the longest chain from the first joint to a frame, m, without what prismatic joints add.
double reach_of(const RobotModel& robot);

}  // namespace cotwin::robot
