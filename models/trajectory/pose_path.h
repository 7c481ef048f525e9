#pragma once
#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "models/trajectory/taylor.h"
#include "models/trajectory/time_scaling.h"
#include "models/trajectory/trajectory.h"

/// Motions of a frame E in a reference frame R: lines, arcs and rotations between waypoints.
///   σ(t)        the part of a leg that is done, from 0 to 1
///   position    p = p_k + Σ d_j(σ_j)            d_j: displacement by leg j along its line, arc or helix
///   orientation Q = Q_k ⊗ Π exp(ψ_j σ_j)        ψ_j: rotation vector of leg j in the frame of waypoint j, the shortest
/// with the sum and the product over the legs under way after waypoint k. A leg whose σ is at its end is replaced by its
/// waypoint, so that errors do not add up. The three laws of passing a waypoint are those of PosePassing.
namespace cotwin::trajectory {

/// A pose with its derivatives at one instant, in the reference frame R.
struct PoseMotion {
  Eigen::Vector3d p, v, dv, ddv;  // p_RE, m; velocity, acceleration, jerk
  Eigen::Vector4d Q;              // unit quaternion (w, x, y, z) of R_RE; its sign is continuous along the path
  Eigen::Vector3d w, dw, ddw;     // rad/s and its derivatives
};

enum class PosePassing {
  kRest,    // E rests at every waypoint: σ is the quintic without speed and acceleration at both ends
  kBlend,   // σ is linear between ramps of the duration `blend`; the ramps of two legs at a waypoint without dwell coincide,
            // so E rounds the corner without stopping. Lines and rotations are exact between the ramps
  kThrough  // E passes waypoints without dwell exactly: the position on the spline of minimum jerk (C⁴), the orientation by
            // quintics in rotation vectors, with angular velocity and acceleration continuous (C²)
};

/// The path of one leg.
struct LegShape {
  enum class Kind {
    kLine,
    kArc,    // through the point `point`
    kCircle  // about the axis through `point` along `axis` by `angle`; a helix if the waypoints differ along the axis
  };
  Kind kind = Kind::kLine;
  Eigen::Vector3d point = Eigen::Vector3d::Zero();  // m
  Eigen::Vector3d axis = Eigen::Vector3d::UnitZ();
  double angle = 0;  // rad, by the right-hand rule; also above 2π and negative
};

/// N poses that E reaches at given times.
struct PoseWaypoints {
  std::vector<double> t;            // N, arrival, s
  std::vector<Eigen::Vector3d> p;   // N, m
  std::vector<Eigen::Vector4d> Q;   // N, quaternions (w, x, y, z) of any sign
  std::vector<double> dwell;        // N, rest after the arrival, s
  std::vector<LegShape> legs;       // N − 1
  std::vector<double> speed;        // N − 1, greatest speed of the leg (without ramps), m/s; 0: duration from t
  std::vector<double> turn_speed;   // N − 1, the same for the rotation, rad/s; the slower of both counts
  std::vector<std::string> places;  // N, for messages: "points.csv:3"; empty: "waypoint 2"
};

/// Reads waypoints from a CSV file, one row per waypoint: columns t, x, y, z and optionally qw, qx, qy, qz, dwell; of the leg that
/// ends at the row: speed, turn_speed, and via_x, via_y, via_z (empty cells: a line). The column t may be left out if speeds are
/// given. Throws Error `points.csv:3: …`.
PoseWaypoints load_pose_waypoints(const std::filesystem::path& file);

/// A motion of E for t in [begin, end]; at rest before and after.
class PosePath {
 public:
  double begin() const { return knots_.front(); }
  double end() const { return knots_.back(); }
  /// Times at which the third derivatives may jump, with both ends; increasing.
  std::span<const double> knots() const { return knots_; }
  /// Allocates nothing.
  PoseMotion at(double t) const;

 private:
  friend PosePath make_pose_path(const PoseWaypoints&, PosePassing, double);

  /// Displacement (σ · line) + (cos(angle σ) − 1) radius + sin(angle σ) normal × radius.
  struct Leg {
    double begin = 0, end = 0, blend = 0;  // s
    Eigen::Vector3d line, radius, normal_times_radius, psi;
    double angle = 0;
  };
  Taylor1 progress(const Leg& leg, double t) const;
  void add(const Leg& leg, double t, Taylor3& p, Taylor4& Q) const;

  PosePassing passing_ = PosePassing::kRest;
  std::vector<double> knots_;
  std::vector<Eigen::Vector3d> p_;  // waypoints
  std::vector<Eigen::Vector4d> Q_;  // with continuous sign
  std::vector<Leg> legs_;           // N − 1
  // kThrough: between knots, positions and rotation vectors from the orientation at the knot.
  Path positions_;
  std::vector<Eigen::Vector4d> Q_at_knot_;
  std::vector<std::array<std::array<double, 6>, 3>> rotation_;  // control points by component
};

/// The motion through the waypoints; it begins and ends at rest. `blend`: duration of the ramps of PosePassing::kBlend, s.
/// Throws Error for fewer than two waypoints, times that do not increase, zero quaternions, arcs through points on one line,
/// circles that do not lead to the next waypoint, curves with kThrough, and ramps that are too long for a leg.
PosePath make_pose_path(const PoseWaypoints& points, PosePassing passing, double blend = 0);

/// Limits of the motion of E; infinite: none.
struct PoseLimits {
  static constexpr double kNone = std::numeric_limits<double>::infinity();
  std::array<double, 3> linear{kNone, kNone, kNone};   // |v|, m/s; |v̇|, m/s²; |v̈|, m/s³
  std::array<double, 3> angular{kNone, kNone, kNone};  // |ω|, rad/s; |ω̇|, rad/s²; |ω̈|, rad/s³
  friend bool operator==(const PoseLimits&, const PoseLimits&) = default;
};

/// Greatest magnitudes on the path, in the order of PoseLimits, by sampling and refinement: they are found to 1e-6 if the
/// magnitude has no more than 50 extremes between two knots.
struct PosePeaks {
  std::array<Peak, 3> linear, angular;
};
PosePeaks find_peaks(const PosePath& path);

/// The least factor on all durations with which the motion meets its limits, as stretch_to() for joints; 0 without limits.
double stretch_to(const PosePeaks& peaks, const Phase& phase, const PoseLimits& limits);
/// The first violation as a sentence, or an empty string.
std::string limit_violation(const PosePeaks& peaks, const PosePath& path, const Phase& phase, const PoseLimits& limits,
                            double tolerance = 1e-6);

}  // namespace cotwin::trajectory
