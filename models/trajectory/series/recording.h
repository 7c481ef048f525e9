#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/trajectory/axes.h"
#include "models/trajectory/series/series.h"

namespace cotwin::trajectory {

/// Format of a CSV file (models/foundation/formats/csv.h) or ROS bag (models/bag) with a motion of n joints.
///
/// Columns are chosen by
///   a list        "J1 act,J2 act,…": as many as joints
///   a pattern     "q{}": joints numbered from 1, "q{0}": from 0, "{name}_pos": the joints' names in the URDF
///   "none"        not read
///   ""            detected: the columns that exist of q, dq (qd, qdot, velocity), tau (effort, torque), tau_e (tau_ext); plain
///                 or as q_1, q[1], numbered from 0 or 1; UR's actual_q_0; the URDF's joint names, also as position_<name>,
///                 <name>_position
struct RecordingFormat {
  std::string t_column;  // "": t, time or timestamp
  double t_unit = 1;     // s per unit of that column
  double rate = 0;       // Hz; > 0: no time column, samples at this rate
  std::string q_columns, dq_columns, tau_columns, tau_e_columns;
  std::string theta_columns;        // positions of the motors behind the gear, scaled as q; "": not read (RecordingReader only)
  double angle_unit = 1;            // rad per unit of the columns of revolute joints
  std::vector<double> q_scale;      // n (or empty: 1): sign or gear ratio; q = scale · column + offset, dq = scale · column
  std::vector<double> q_offset;     // n (or empty: 0), rad or m
  std::vector<double> tau_scale;    // n (or empty: 1): sign, gear ratio or torque constant, N.m per unit of the column
  std::vector<double> tau_e_scale;  // as tau_scale, for tau_e
  double max_gap = 5;               // a gap of more than this number of median steps is an error
  double max_speed = 0;             // rad/s or m/s; 0: four times the joint's limit; without limit 30 rad/s, 10 m/s
  char separator = 0;               // of the cells; 0: detected
  std::string topic;                // of a ROS bag; "": the only one with joints
  friend bool operator==(const RecordingFormat&, const RecordingFormat&) = default;
};

/// Unfiltered samples in SI. Time counts from the first one.
struct Recording {
  std::string file;
  std::string row, before;         // what `lines` count, and what stands before their numbers in a place, see csv::Source
  std::vector<std::size_t> lines;  // line of each sample
  std::vector<std::string> notes;  // see csv::Source
  Series q, dq, tau, tau_e;        // of n signals; empty (size() = 0) without columns
};

/// Reads a recording. Throws Error with file, line and column for cells that are empty, not numbers or not finite; for times
/// that do not increase; for gaps; and for positions and steps in q far beyond the joint's limits, as if degrees were read as
/// radians. Throws Error with the file for missing columns, a wrong number of columns, or fewer than two samples.
Recording load_recording(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format = {});

/// Returns a warning if the unit of the times `t` is doubtful: samples more than 0.1 s or less than 10 us apart, as if
/// milliseconds were read as seconds. Empty: no warning.
std::string time_unit_warning(const std::vector<double>& t);

}  // namespace cotwin::trajectory
