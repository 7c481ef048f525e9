#pragma once
#include <filesystem>
#include <span>
#include <vector>

#include "components/unit/unit_table.h"
#include "models/services/verification.h"

namespace cotwin::master {

/// The scenario of a verification as SSD text: unit:motion runs the polynomial, unit:compliance tracks it, unit:drive_train is the robot
/// with elastic joints and friction, and unit:energy measures it where the robot has an energy.ssv. Throws Error for a robot without
/// a file, with locked joints, or without a drive_train.ssv beside it.
std::string verification_scenario(const services::Robot& robot, const services::Move& move, double T,
                                  const services::VerificationOptions& options);

/// Runs it with ticks of 1 ms. `types`: the units; `folders`: where they find named data. Bounds are those of the move.
services::Verification verify(std::span<const UnitType> types, const std::vector<std::filesystem::path>& folders,
                              const services::Robot& robot, const services::Move& move, double T,
                              const services::VerificationOptions& options);

}  // namespace cotwin::master
