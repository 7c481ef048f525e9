#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/identification/measurement/log.h"
#include "models/trajectory/series/filter.h"
#include "models/trajectory/series/series.h"

namespace cotwin::measurement {

struct Smoothing {
  double step = 0;    // s, of the regular grid
  double cutoff = 0;  // Hz, zero-phase low-pass of positions and torques alike (trajectory/filter.h)
  int order = 4;      // of one pass
  double margin = 0;  // s at both ends of a segment that are left out, because the filter has data on one side only
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
  std::vector<char> measured;                  // count; 0: no sample here, or too near to a long gap
};

/// Zero-phase smoothing of a log of any length, block by block. Each block is filtered with as many samples on either side as
/// the memory of the filter; the result is that of filtering each segment as a whole, to 1e-7 of the signals. The grid of a
/// segment starts at its first sample. Samples that are regular to 1e-3 of the step are used as they are, others are
/// interpolated by a quintic spline. Where rows are missing (a step above 1.5), the low-pass is formulated on the existing
/// samples: y minimises Σ (x(t_s) − y(t_s))² plus the roughness that the filter penalises, with x(t_s) as measured at its own
/// time (for the Butterworth filter of order N the penalty is ∫ (y⁽ᴺ⁾)²; for complete samples the result is that of the
/// filter). It is computed by filling the missing points with y repeatedly.
class SmoothedLog {
 public:
  /// `block`: greatest number of samples of next(). Throws Error for a cutoff that the sampling rate does not allow.
  SmoothedLog(const Log& log, std::span<const trajectory::Axis> axes, const Smoothing& smoothing, double gap,
              std::size_t block = 4096);

  /// Returns the next samples, valid until the next call; null at the end.
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
  // The window: samples of the segment that are still needed, as measured and on the grid.
  trajectory::Series q_raw_, theta_raw_, tau_raw_, q_, theta_, tau_;
  std::vector<char> measured_;         // of the grid points in the window
  bool ahead_ = false;                 // the reader stands on the first sample of the next segment
  bool open_ = false, ended_ = false;  // a segment is being read; its last sample is in the window
  std::size_t segments_ = 0;
  double t_first_ = 0;      // of the segment
  std::size_t k_next_ = 0;  // the next grid point to give
  Block result_;
};

/// Number of grid points of a segment of `duration` s.
std::size_t grid_points(double duration, const Smoothing& smoothing);

}  // namespace cotwin::measurement
