#pragma once
#include <filesystem>
#include <span>
#include <vector>

#include "components/services/verification.h"
#include "components/unit/unit_table.h"

namespace cotwin::master {

/// Runs a move in the twin with ticks of 1 ms: unit:motion runs the polynomial, unit:compliance tracks it, unit:drive_train is the robot
/// with elastic joints and friction, and unit:energy measures it where the robot has an energy.ssv. The joints are rigid, without motor
/// inertia and friction, for a robot without drive_train.ssv and with VerificationOptions::rigid. Locked joints stand still. Bounds are
/// those of the move; the controller cuts its torques at these. `types`: the units; `folders`: where they find named data. Throws Error
/// for a robot without a file and for moves longer than 1000 s.
services::Verification verify(std::span<const UnitType> types, const std::vector<std::filesystem::path>& folders,
                              const services::Robot& robot, const services::Move& move, double T,
                              const services::VerificationOptions& options);

}  // namespace cotwin::master
