#pragma once
#include <filesystem>
#include <string>
#include <vector>

#include "models/trajectory/axes.h"
#include "models/trajectory/series.h"

namespace cotwin::trajectory {

/// How a CSV (models/support/csv.h) holds the motion of n joints.
///
/// Columns are chosen by
///   a list        "J1 act,J2 act,…": as many as joints
///   a pattern     "q{}" counts the joints from 1, "q{0}" from 0, "{name}_pos" stands for the joints' names in the URDF
///   "none"        not read
///   ""            found by name: q, dq (qd, qdot, velocity), tau (effort, torque), tau_e (tau_ext), bare or as q_1, q[1],
///                 counted from 0 or 1; UR's actual_q_0; the URDF's joint names, also as position_<name>,
///                 <name>_position
struct RecordingFormat {
  std::string t_column;  // "": t, time or timestamp
  double t_unit = 1;     // s per unit of that column
  double rate = 0;       // Hz; > 0: there is no time column, samples follow one another at this rate
  std::string q_columns, dq_columns, tau_columns, tau_e_columns;
  std::string theta_columns;        // positions of the motors behind the gear, scaled as q; "": none (RecordingReader only)
  double angle_unit = 1;            // rad per unit of the columns of revolute joints
  std::vector<double> q_scale;      // n (or empty: 1): sign or gear ratio; q = scale · column + offset, dq = scale · column
  std::vector<double> q_offset;     // n (or empty: 0), rad or m
  std::vector<double> tau_scale;    // n (or empty: 1): sign, gear ratio or torque constant, N.m per unit of the column
  std::vector<double> tau_e_scale;  // the same for tau_e
  double max_gap = 5;               // a pause of more than so many times the median step is an error
  double max_speed = 0;             // rad/s or m/s; 0: four times the joint's limit, or 30 rad/s, 10 m/s where there is none
  char separator = 0;               // of the cells; 0: found
  friend bool operator==(const RecordingFormat&, const RecordingFormat&) = default;
};

/// The samples as they were measured, in SI. Time counts from the first one.
struct Recording {
  std::string file;
  std::vector<std::size_t> lines;  // of the samples
  Series q, dq, tau, tau_e;        // of n signals; empty (size() = 0) where the file has no such columns
};

/// Reads a recording. Throws Error that names file and line (and column) for: cells that are empty, not numbers or not finite;
/// time that stands still or runs backwards; gaps; positions and steps in q far beyond the joint, which hint at degrees taken
/// for radians; and that names the file for columns that are missing or not as many as joints, or fewer than two samples.
Recording load_recording(const std::filesystem::path& file, std::span<const Axis> axes, const RecordingFormat& format = {});

/// What makes the unit of measure of a robot's times `t` doubtful: samples that are more than 0.1 s or less than 10 us apart,
/// as where milliseconds are read as seconds. Empty: nothing.
std::string doubt_about_times(const std::vector<double>& t);

}  // namespace cotwin::trajectory
