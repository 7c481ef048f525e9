#pragma once
#include <cstddef>
#include <span>
#include <vector>

#include "models/trajectory/trajectory.h"

namespace cotwin::trajectory {

/// N samples of `width` signals at increasing instants, regular or not.
struct Series {
  std::vector<double> t;  // N, s
  std::size_t width = 0;
  std::vector<double> x;  // N·width, sample by sample

  std::size_t size() const { return t.size(); }
};

/// The median time between two samples; `t` has at least two.
double median_step(std::span<const double> t);

/// The interpolating quintic spline (spline.h) through the samples: C⁴, so that a signal and its first two derivatives are
/// smooth and belong to one another. It adds no phase: what the derivatives of noise may do is decided by smooth() before.
Path interpolate(const Series& series);

/// The same signals on a regular grid from the first to the last instant, with a step as near to `step` as fits, by the spline.
Series resample(const Series& series, double step);

/// Zero-phase low-pass (filter.h: −3 dB at `cutoff` Hz after both passes, `order` of one pass) on the regular grid of the
/// median step.
Series smooth(const Series& series, double cutoff, int order);

/// First time derivatives at the same instants, by the spline: zero phase.
Series differentiate(const Series& series);

/// Straight lines between the samples: exact at them, and no overshoot between. Held outside. Allocates nothing.
void linear(const Series& series, double t, std::span<double> x);

}  // namespace cotwin::trajectory
