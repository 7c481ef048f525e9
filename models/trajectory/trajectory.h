#pragma once
#include <cstddef>
#include <span>
#include <string>
#include <vector>

/// Desired and recorded motions of joints and frames as functions of time.
///   trajectory.h    Path: the common representation, q(t) with its derivatives q̇, q̈ and jerk
///   polynomial.h    polynomials of degree 5 and more with redundant coefficients c_r (V-B)
///   waypoints.h     rest to rest, or through the points with minimum jerk
///   time_scaling.h  stretching to limits; soft start and stop
///   series.h        measured samples: zero-phase smoothing, differentiation, interpolation
///   recording.h     measured samples from a CSV file
///   pose_path.h     poses: lines, arcs and rotations between waypoints
///   joint_path.h    the joints that follow a path of poses
namespace cotwin::trajectory {

/// The value of largest magnitude of one joint's q, q̇, q̈ or jerk, and its time.
struct Peak {
  double value = 0;
  double t = 0;  // s
};

/// A motion of n joints: polynomials between knots in time, with continuous q, q̇ and q̈.
class Path {
 public:
  Path() = default;
  /// Quintics between the knots `t` (N, increasing, s); q, dq, ddq at the knots (N·n, row by row: all joints of a knot
  /// together).
  Path(std::size_t joints, std::vector<double> t, std::vector<double> q, std::vector<double> dq, std::vector<double> ddq);
  /// Polynomials of any degree from 5 to bernstein::kMaxDegree: `control` has (N − 1)·n·(degree + 1) control points, segment by
  /// segment, joint by joint.
  Path(std::size_t joints, std::vector<double> t, int degree, std::vector<double> control);

  std::size_t joints() const { return joints_; }
  int degree() const { return degree_; }
  std::span<const double> times() const { return t_; }
  double begin() const { return t_.front(); }
  double end() const { return t_.back(); }

  /// Values at t; at rest at the first point before the beginning and at the last point after the end. The spans have n
  /// elements; `dddq` may be empty. Allocates nothing.
  void at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq, std::span<double> dddq = {}) const;

  /// Least and greatest value of q (derivative 0), q̇ (1), q̈ (2) or jerk (3) of a joint, by bernstein::extremes.
  struct Range {
    Peak min, max;
    const Peak& largest() const { return -min.value > max.value ? min : max; }
  };
  Range range(std::size_t joint, int derivative) const;

 private:
  std::size_t segment(double t) const;
  std::span<const double> control(std::size_t segment, std::size_t joint, std::span<double, 6> scratch) const;

  std::size_t joints_ = 0;
  int degree_ = 5;
  std::vector<double> t_;
  std::vector<double> q_, dq_, ddq_;  // of quintics
  std::vector<double> control_;       // of higher degrees
};

/// The part of a path of quintics from `begin` to `end`, within its times; the parts are quintics again. If a cut is very close
/// to a knot, one quintic replaces both segments, which is accurate because the spline is C⁴.
Path cut(const Path& path, double begin, double end);

/// Index of the start of the interval of `times` (increasing, at least two) that contains t; the last interval for all later t.
std::size_t interval(std::span<const double> times, double t);

}  // namespace cotwin::trajectory
