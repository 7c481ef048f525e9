#include "models/trajectory/series/series.h"

#include <algorithm>
#include <cassert>
#include <cmath>

#include "models/trajectory/series/filter.h"
#include "models/trajectory/spline.h"

namespace cotwin::trajectory {

double median_step(std::span<const double> t) {
  assert(t.size() >= 2);
  std::vector<double> steps(t.size() - 1);
  for (std::size_t k = 0; k < steps.size(); ++k) steps[k] = t[k + 1] - t[k];
  const auto middle = steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2);
  std::nth_element(steps.begin(), middle, steps.end());
  return *middle;
}

Path interpolate(const Series& series) {
  SplineKnots knots = solve_spline(series.t, series.width, series.x, SplineEnds::kFree);
  return Path(series.width, series.t, series.x, std::move(knots.dq), std::move(knots.ddq));
}

Series resample(const Series& series, double step) {
  const double begin = series.t.front(), length = series.t.back() - begin;
  const std::size_t intervals = static_cast<std::size_t>(std::max(1.0, std::round(length / step)));
  const Path path = interpolate(series);
  Series even;
  even.width = series.width;
  even.t.resize(intervals + 1);
  even.x.resize(even.t.size() * even.width);
  std::vector<double> dx(even.width), ddx(even.width);
  for (std::size_t k = 0; k <= intervals; ++k) {
    even.t[k] = k == intervals ? series.t.back() : begin + length * static_cast<double>(k) / static_cast<double>(intervals);
    path.at(even.t[k], std::span(even.x).subspan(k * even.width, even.width), dx, ddx);
  }
  return even;
}

Series smooth(const Series& series, double cutoff, int order) {
  Series even = resample(series, median_step(series.t));
  const double rate = static_cast<double>(even.size() - 1) / (even.t.back() - even.t.front());
  const ZeroPhaseLowPass filter(cutoff, rate, order);
  std::vector<double> column(even.size());
  for (std::size_t c = 0; c < even.width; ++c) {
    for (std::size_t k = 0; k < even.size(); ++k) column[k] = even.x[k * even.width + c];
    filter.apply(column);
    for (std::size_t k = 0; k < even.size(); ++k) even.x[k * even.width + c] = column[k];
  }
  return even;
}

void linear(const Series& series, double t, std::span<double> x) {
  const std::size_t k = interval(series.t, t);
  const double s = std::clamp((t - series.t[k]) / (series.t[k + 1] - series.t[k]), 0.0, 1.0);
  const double* const a = series.x.data() + k * series.width;
  for (std::size_t c = 0; c < series.width; ++c) x[c] = (1 - s) * a[c] + s * a[c + series.width];
}

}  // namespace cotwin::trajectory
