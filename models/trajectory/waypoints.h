#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "models/trajectory/axes.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// N points that the joints reach at given times.
struct Waypoints {
  std::size_t joints = 0;
  std::vector<double> t;            // N, arrival, s
  std::vector<double> q;            // N·joints, point by point, rad
  std::vector<double> dwell;        // N, rest after the arrival, s; empty: no rests
  std::vector<std::string> places;  // N, for messages: "points.csv:3"; empty: "waypoint 2"
};

enum class Passing {
  kRest,    // the joints come to rest at every point
  kThrough  // they pass points without dwell on the spline of minimum jerk (C⁴)
};

/// Reads waypoints from a CSV file (models/foundation/formats/csv.h), one row per point: a column t (or time), position columns named as
/// in a recording (recording.h: `q_columns`), for revolute joints in units of `angle_unit` rad, and optionally a column dwell.
/// Times need not begin at 0. Throws Error `points.csv:3: …`.
Waypoints load_waypoints(const std::filesystem::path& file, std::span<const Axis> axes, const std::string& q_columns = {},
                         double angle_unit = 1);

/// The motion through the points: polynomials of `degree` with their redundant coefficients c_r, (N − 1)·joints·(degree − 5),
/// leg by leg, joint by joint; empty: zero. It begins and ends at rest. Throws Error for fewer than two points, a point that is
/// reached before the previous one is left, or a wrong number of c_r.
Path make_path(const Waypoints& points, Passing passing, int degree = 5, std::span<const double> c_r = {});

/// A calm duration from rest at `from` to rest at `to` by quintics, in s, a multiple of 0.1 s and at least 1 s: 30 % of the speed
/// limits (without a limit 0.5 rad/s or 0.1 m/s) and accelerations of 2 rad/s² or 0.5 m/s².
double calm_duration(std::span<const Axis> axes, std::span<const double> from, std::span<const double> to);

}  // namespace cotwin::trajectory
