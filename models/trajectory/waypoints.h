#pragma once
#include <cstddef>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "models/trajectory/axes.h"
#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// N points that the joints reach at given instants.
struct Waypoints {
  std::size_t joints = 0;
  std::vector<double> t;            // N, arrival, s
  std::vector<double> q;            // N·joints, point by point, rad
  std::vector<double> dwell;        // N, rest after the arrival, s; empty: none
  std::vector<std::string> places;  // N, for messages: "points.csv:3"; empty: "waypoint 2"
};

enum class Passing {
  kRest,    // the joints come to rest at every point
  kThrough  // they move through points without dwell, on the spline of least jerk (C⁴)
};

/// Reads waypoints from a CSV (models/support/csv.h), a row a point: a column t (or time), positions in columns named as in a
/// recording (recording.h: `q_columns`), in `angle_unit` rad for revolute joints, and perhaps a column dwell. Times need not
/// begin at 0. Throws Error `points.csv:3: …`.
Waypoints load_waypoints(const std::filesystem::path& file, std::span<const Axis> axes, const std::string& q_columns = {},
                         double angle_unit = 1);

/// The motion through the points: polynomials of `degree` with their redundant coefficients c_r, (N − 1)·joints·(degree − 5):
/// leg by leg, joint by joint; none stands for zero. It begins and ends at rest. Throws Error for fewer than two points, a
/// point that is reached before the one before it is left, or a number of c_r that does not fit.
Path make_path(const Waypoints& points, Passing passing, int degree = 5, std::span<const double> c_r = {});

}  // namespace cotwin::trajectory
