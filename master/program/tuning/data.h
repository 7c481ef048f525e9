#pragma once
#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "master/program/tuning/progress.h"
#include "master/program/tuning/settings.h"
#include "models/identification/torque_data.h"
#include "models/measurement/smoothing.h"
#include "models/measurement/survey.h"

namespace cotwin::master::tuning {

/// Which samples of a log are trained on: those before `split`, counted over all segments.
enum class Part { kTraining, kHeldOut };

/// What the samples of one part are, compressed.
struct CompressedPart {
  identification::TorqueData data;
  std::size_t samples = 0;
  Eigen::VectorXd removed;  // n, N.m: RMS of what the low-pass took from the torques
};

/// A robot and its log, checked and compressed.
struct Data {
  robot::RobotModel robot;
  robot::RobotModel load_robot;  // whose gravity is the load of friction: with ModelOptions::load, near to what will be found
  measurement::Survey survey;
  measurement::Smoothing smoothing;
  std::size_t split = 0;  // samples on the grid of the log that are trained on
  std::optional<CompressedPart> training, held_out;
  std::vector<std::string> warnings;  // of the URDF, then of the survey
};

/// Thrown out of a loop over a log when the user wants to stop.
struct Stopped {};

/// Reads the robot and looks through the log: robot, survey and warnings of the result.
Data survey_log(const Settings& settings, const Hooks& hooks);
/// settings.model, with the joints of the log that stand still.
identification::ModelOptions model_of(const Settings& settings, const measurement::Survey& survey);
measurement::Smoothing smoothing_of(const Settings& settings, const measurement::Survey& survey);
/// Decides with data.smoothing which samples are trained on: data.split, and warnings of segments that give none.
void split(const Settings& settings, Data& data);

/// Reads robot and log: survey, smoothing, compression. Throws Error for what is wrong with either; Stopped.
Data load_data(const Settings& settings, const Hooks& hooks);

/// Calls `take` for every smoothed block of the log, in order (points that are not block.measured are there to be counted):
/// those of settings.data as kTraining (of which the first data.split samples are), then those of settings.held_out. `what` is
/// told as progress. Throws Stopped.
void for_each_block(const Settings& settings, const Data& data, const Hooks& hooks, const char* what,
                    const std::function<void(const measurement::Block&, Part)>& take);

}  // namespace cotwin::master::tuning
