#pragma once
#include <Eigen/Core>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "master/workflows/tuning/progress.h"
#include "master/workflows/tuning/settings.h"
#include "models/identification/diagnosis.h"
#include "models/identification/measurement/smoothing.h"
#include "models/identification/measurement/survey.h"
#include "models/identification/torque_data/torque_data.h"

namespace cotwin::master::tuning {

/// The part of a sample: training for the first `split` samples, counted over all segments.
enum class Part { kTraining, kHeldOut };

/// The compressed samples of one part.
struct CompressedPart {
  identification::TorqueData data;
  std::size_t samples = 0;
  Eigen::VectorXd removed;  // n, N.m: RMS of the part of the torques that the low-pass removed
};

/// A robot and its log, checked and compressed.
struct Data {
  robot::RobotModel robot;
  robot::RobotModel load_robot;  // its gravity is the load of friction; with ModelOptions::load, a first estimate
  measurement::Survey survey;
  measurement::Smoothing smoothing;
  std::size_t split = 0;  // number of training samples on the grid of the log
  std::optional<CompressedPart> training, held_out;
  std::vector<identification::Finding> findings;  // of the training part, the one that explains most first
  identification::Hypothesis truth;               // with all of them
  std::vector<std::string> warnings;              // of the URDF, then of the survey
};

/// Thrown by a loop over a log when the user stops the program.
struct Stopped {};

/// Reads the robot and surveys the log: robot, survey and warnings of the result.
Data survey_log(const Settings& settings, const Hooks& hooks);
/// settings.model, and the joints of the log that stand still.
identification::ModelOptions model_of(const Settings& settings, const measurement::Survey& survey);
measurement::Smoothing smoothing_of(const Settings& settings, const measurement::Survey& survey);
/// Sets data.split from data.smoothing, and warns of segments without samples.
void split(const Settings& settings, Data& data);

/// Reads robot and log: survey, smoothing, compression. Throws Error for invalid files, and Stopped.
Data load_data(const Settings& settings, const Hooks& hooks);

/// Calls `take` for every smoothed block of the log, in order (points that are not block.measured are counted, too):
/// settings.data as kTraining (the first data.split samples are for training), then settings.held_out. `what` is reported as
/// progress. Throws Stopped.
void for_each_block(const Settings& settings, const Data& data, const Hooks& hooks, const char* what,
                    const std::function<void(const measurement::Block&, Part)>& take);

}  // namespace cotwin::master::tuning
