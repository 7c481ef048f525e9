#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "models/identification/measurement/log.h"
#include "models/robot/robot_model.h"

namespace cotwin::measurement {

/// A stretch of the log without a gap.
struct Segment {
  std::string begin;        // "log.csv:2"
  std::size_t file = 0;     // of the log's
  std::size_t samples = 0;  // as measured
  double duration = 0;      // s, from the first sample to the last
};

struct JointSurvey {
  std::string q_column, tau_column;
  double q_min = 0, q_max = 0;      // rad
  double speed_max = 0;             // rad/s, between two samples
  double tau_min = 0, tau_max = 0;  // N.m
  double tau_rms = 0, gravity_rms = 0;
  double gravity_correlation =
      0;                 // of the measured torque with the gravity torque of the prior, −1 to 1; 0 where either is constant
  double frequency = 0;  // Hz, below which 95 % of the power of the velocity lies
};

/// The results of one pass over a log.
struct Survey {
  std::size_t samples = 0;
  double step = 0;  // s, see typical_step
  double gap = 0;   // s; a longer step starts a segment
  double duration = 0;
  bool has_speeds = false;
  std::vector<Segment> segments;
  std::vector<JointSurvey> joints;  // n
  std::vector<std::string> warnings;
  std::vector<std::string> damage;  // sentences: torques that are cut off, or stand still while their joint moves
  double rate() const { return 1 / step; }
  bool moves(std::size_t joint) const { return joints[joint].q_max - joints[joint].q_min > 1e-3; }  // rad or m
  /// 10 times the median of `frequency` over the moving joints, limited to 0.2 Hz and a fifth of the sampling rate.
  double cutoff() const;
};

/// The list of n scales for an option, those of `joints` times `factor`: "1,1,-1". `given`: n, or empty for ones.
std::string scales(std::vector<double> given, std::size_t n, const std::vector<int>& joints, double factor);

struct SurveyOptions {
  /// Implausible data cause warnings instead of errors: torques that contradict gravity in sign or size, positions and speeds
  /// far beyond the range of the joint, a sampling step of half a second or more.
  bool accept = false;
};

/// Reads the log once, in constant memory. Throws Error with file, line, column and expectation for cells that are not finite
/// numbers, time that runs backwards, missing or additional columns, too few samples, torques that never change, files with
/// different sampling rates, and for implausible data (`accept`). Warns of gaps, of positions and torques beyond the limits of
/// the robot, of joints that stand still, and of velocities that are not the derivatives of the positions.
Survey survey(const Log& log, const robot::RobotModel& robot, const SurveyOptions& options = {});

/// The sampling step of a log, s, from the times of some samples: the median step where few rows are missing; else the largest
/// step of which nearly all steps are multiples (lost rows); else, where time stamps are inaccurate, the mean step between
/// pauses.
double typical_step(std::span<const double> t);

}  // namespace cotwin::measurement
