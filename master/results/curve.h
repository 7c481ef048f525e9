#pragma once
#include <cstddef>
#include <limits>
#include <vector>

/// A signal over time, reduced while it is read, so that recordings of any length need little memory.
namespace cotwin::report {

/// y is NaN where the curve is interrupted.
struct Point {
  double t = 0, y = 0;
};

/// Figures of all samples that are finite.
struct Figures {
  std::size_t count = 0, missing = 0;  // samples that are finite; the others
  double min = std::numeric_limits<double>::quiet_NaN(), max = min, first = min, last = min;
  double t_of_min = 0, t_of_max = 0;
  double sum = 0, squares = 0;

  void add(double t, double y);
  double mean() const;
  double rms() const;
  double largest() const;       // of |y|
  double t_of_largest() const;  // s
};

/// Keeps of each interval of equally many samples the first, smallest, largest and last one. No extreme is lost. When there are
/// 2 kIntervals intervals, neighbours are joined.
class Curve {
 public:
  static constexpr std::size_t kIntervals = 500;

  /// `with_points`: false: only figures.
  explicit Curve(bool with_points = true) : with_points_(with_points) {}

  void add(double t, double y);
  const Figures& figures() const { return figures_; }
  /// At most 10 kIntervals points and interruptions, in the order of the samples.
  std::vector<Point> points() const;

 private:
  struct Interval {
    Point first, low, high, last;
    std::size_t low_at = 0, high_at = 0, count = 0;  // count: finite samples; the others interrupt the curve after it
    bool interrupted = false;
  };
  static void join(Interval& a, const Interval& b);

  bool with_points_;
  Figures figures_;
  std::vector<Interval> intervals_;
  std::size_t samples_ = 0, length_ = 1, in_last_ = 0;  // length_: samples of an interval
};

/// Leaves out points that are closer than `tolerance` to the line between their neighbours that stay (Douglas and Peucker), after
/// a scaling of t and y. Interruptions stay.
std::vector<Point> simplified(const std::vector<Point>& points, double t_scale, double y_scale, double tolerance);

}  // namespace cotwin::report
