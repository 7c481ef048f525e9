#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "models/measurement/log.h"
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
  double gravity_correlation = 0;  // of the measured torque with the prior's gravity, −1 to 1; 0 where either is constant
  double frequency = 0;            // below which 95 % of the velocity's power lies, Hz
};

/// What one look at a whole log told.
struct Survey {
  std::size_t samples = 0;
  double step = 0;  // s, see typical_step
  double gap = 0;   // s; a longer step begins a segment
  double duration = 0;
  bool has_speeds = false;
  std::vector<Segment> segments;
  std::vector<JointSurvey> joints;  // n
  std::vector<std::string> warnings;
  double rate() const { return 1 / step; }
  bool moves(std::size_t joint) const { return joints[joint].q_max - joints[joint].q_min > 1e-3; }  // rad or m
  /// 10 times the median over the moving joints of their `frequency`, within 0.2 Hz and a fifth of the sampling rate.
  double cutoff() const;
};

struct SurveyOptions {
  /// What is no more than implausible becomes a warning: torques against gravity or far from it in size, positions and speeds
  /// far beyond the joint, a sampling step of half a second and more.
  bool accept = false;
};

/// Reads the log once, in memory that does not grow with it. Throws Error with file, line and column, and what was expected,
/// for cells that are no finite numbers, time that runs backwards, missing columns or another number of them, fewer samples
/// than can be used, torques that never change, files sampled at different rates, and what `accept` speaks of. Warns of gaps,
/// of positions and torques beyond the robot's limits, of joints that stand still, of velocities in the log that are not the
/// derivatives of its positions.
Survey survey(const Log& log, const robot::RobotModel& robot, const SurveyOptions& options = {});

/// The sampling step of a log from the times of some samples, in s: the median step where hardly a row is missing; else the
/// largest step of which nearly all are whole multiples, as where rows were lost; else, where time stamps say little about when
/// a sample was taken, the mean step between pauses.
double typical_step(std::span<const double> t);

}  // namespace cotwin::measurement
