#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/measurement/log.h"
#include "models/trajectory/filter.h"
#include "models/trajectory/series.h"

namespace cotwin::measurement {

struct Smoothing {
  double step = 0;    // s, of the regular grid
  double cutoff = 0;  // Hz, zero-phase low-pass of positions and torques alike (trajectory/filter.h)
  int order = 4;      // of one pass
  double margin = 0;  // s at both ends of a segment that are left out: there the filter knows one side only
};

/// Smoothed samples on a regular grid, row by row.
struct Block {
  std::size_t segment = 0;
  std::size_t count = 0;
  std::vector<double> t;                       // count, s in the file's time
  std::vector<double> q, dq, ddq;              // count·n: smoothed positions and their derivatives by a quintic spline
  std::vector<double> theta, dtheta, ddtheta;  // count·n, of the motors; empty where the log has none
  std::vector<double> tau;                     // count·n, through the same low-pass
  std::vector<double> tau_measured;            // count·n, as measured
  std::vector<char> measured;                  // count; 0: no sample was taken here, or too near to a long gap to tell anything
};

/// Zero-phase smoothing of a log that may be larger than memory: block by block, where each block is filtered together with as
/// many samples on either side as the filter remembers. What comes out is what filtering each segment as a whole would give, to
/// 1e-7 of the signals. Every segment gets its grid from its first sample on; samples that are regular to 1e-3 of the step are
/// taken as they are, others go through a quintic spline. Where rows are missing (a step above 1.5) the low-pass is that of the
/// samples there are: y with y_k as smooth as the filter makes it and Σ (x(t_s) − y(t_s))² least, x(t_s) as measured at its own
/// time (for the Butterworth filter of order N this is the penalised least squares with ∫ (y⁽ᴺ⁾)², which for complete samples
/// is the filter itself). It is found by filling the missing points with y again and again.
class SmoothedLog {
 public:
  /// `block`: samples that next() gives at most. Throws Error for a cutoff that the rate cannot have.
  SmoothedLog(const Log& log, std::span<const trajectory::Axis> axes, const Smoothing& smoothing, double gap,
              std::size_t block = 4096);

  /// The next samples, valid until the next call; null at the end.
  const Block* next();

 private:
  bool open_segment();
  void push();
  void fill(double until);
  bool is_regular(std::size_t k_begin) const;
  void put_on_grid(std::size_t k_begin, std::size_t count);
  bool is_complete() const;
  void mark_measured(std::size_t k_begin, std::size_t count);
  void fill_missing(const trajectory::Series& raw, std::size_t k_begin, trajectory::Series& even) const;
  trajectory::Series smoothed(const trajectory::Series& measured) const;
  void deliver(std::size_t k_begin, std::size_t count);
  void forget_before(double t);

  LogReader reader_;
  std::size_t n_;
  double gap_;
  Smoothing smoothing_;
  trajectory::ZeroPhaseLowPass filter_;
  std::size_t block_, overlap_, margin_;  // samples
  bool has_theta_;
  // The window: the segment's samples that still matter, as measured, and the same on the grid.
  trajectory::Series q_raw_, theta_raw_, tau_raw_, q_, theta_, tau_;
  std::vector<char> measured_;         // of the grid points in the window
  bool ahead_ = false;                 // the reader stands on the first sample of the next segment
  bool open_ = false, ended_ = false;  // a segment is being read; its last sample is in the window
  std::size_t segments_ = 0;
  double t_first_ = 0;      // of the segment
  std::size_t k_next_ = 0;  // the next grid point to give
  Block result_;
};

/// How many grid points a segment of `duration` s gives.
std::size_t grid_points(double duration, const Smoothing& smoothing);

}  // namespace cotwin::measurement
