#pragma once
#include <cstddef>
#include <optional>
#include <string>

#include "master/program/tuning/data.h"
#include "master/program/tuning/evaluation.h"

namespace cotwin::master::tuning {

/// The part of the log that twin.ssd replays: one segment, or as much of it as kReplayed rows of motion.csv hold, about the
/// boundary between training and held-out data where that lies within. Nothing where the log gives no samples.
std::optional<Replay> choose_replay(const Settings& settings, const Data& data);
inline constexpr std::size_t kReplayed = 60000;
/// How many rows of motion.csv a step of the grid becomes: recordings are read with straight lines between torques.
std::size_t points_between(double step);

/// twin.ssd: motion.csv, a controller and the drive train with robot.urdf and drive_train.ssv, all of the same folder. Its
/// comparisons hold the twin's torques against the smoothed measured ones, over the same samples and at the same place (motor
/// or joint) as the errors in `replay`.
std::string twin_scenario(const std::string& name, const Settings& settings, const Replay& replay);

}  // namespace cotwin::master::tuning
