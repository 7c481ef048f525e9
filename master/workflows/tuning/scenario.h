#pragma once
#include <cstddef>
#include <optional>
#include <string>

#include "master/workflows/tuning/data.h"
#include "master/workflows/tuning/evaluation.h"

namespace cotwin::master::tuning {

/// The part of the log that twin.ssd replays: one segment, at most kReplayed rows of motion.csv, around the boundary between
/// training and held-out data if the segment contains it. Nothing if the log has no samples or a joint is passive.
std::optional<Replay> choose_replay(const Settings& settings, const Data& data);
inline constexpr std::size_t kReplayed = 60000;
/// Number of rows of motion.csv per step of the grid; recordings interpolate torques linearly.
std::size_t points_between(double step);

/// twin.ssd: motion.csv, a controller and the drive train with robot.urdf and drive_train.ssv, all in one folder. It compares
/// the torques of the twin with the smoothed measured ones, over the same samples and at the same place (motor or joint) as the
/// errors in `replay`.
std::string twin_scenario(const std::string& name, const Settings& settings, const Replay& replay);

}  // namespace cotwin::master::tuning
