#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// N samples of `width` signals at increasing times, regular or not.
struct Series {
  std::vector<double> t;  // N, s
  std::size_t width = 0;
  std::vector<double> x;  // N·width, sample by sample

  std::size_t size() const { return t.size(); }
};

/// Median time between two samples; `t` has at least two elements.
double median_step(std::span<const double> t);

/// The interpolating quintic spline (spline.h) through the samples: C⁴, so the signal and its first two derivatives are smooth
/// and consistent. It adds no phase; smooth() limits the noise of the derivatives beforehand.
Path interpolate(const Series& series);

/// Resamples by the spline on a regular grid from the first to the last time, with the step closest to `step` that fits.
Series resample(const Series& series, double step);

/// Zero-phase low-pass (filter.h: −3 dB at `cutoff` Hz for both passes together, `order` of each pass) on the regular grid of
/// the median step.
Series smooth(const Series& series, double cutoff, int order);

/// Linear interpolation, constant outside of the samples. Allocates nothing.
void linear(const Series& series, double t, std::span<double> x);

}  // namespace cotwin::trajectory
