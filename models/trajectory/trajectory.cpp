#include "models/trajectory/trajectory.h"

#include <algorithm>
#include <array>
#include <cassert>

#include "models/trajectory/bernstein.h"

namespace cotwin::trajectory {

std::size_t interval(std::span<const double> times, double t) {
  const auto after = std::upper_bound(times.begin() + 1, times.end() - 1, t);
  return static_cast<std::size_t>(after - times.begin()) - 1;
}

Path::Path(std::size_t joints, std::vector<double> t, std::vector<double> q, std::vector<double> dq, std::vector<double> ddq)
    : joints_(joints), t_(std::move(t)), q_(std::move(q)), dq_(std::move(dq)), ddq_(std::move(ddq)) {
  assert(t_.size() >= 2 && q_.size() == joints_ * t_.size() && dq_.size() == q_.size() && ddq_.size() == q_.size());
}

Path::Path(std::size_t joints, std::vector<double> t, int degree, std::vector<double> control)
    : joints_(joints), degree_(degree), t_(std::move(t)), control_(std::move(control)) {
  assert(t_.size() >= 2 && degree_ >= 5 && degree_ <= bernstein::kMaxDegree);
  assert(control_.size() == (t_.size() - 1) * joints_ * static_cast<std::size_t>(degree_ + 1));
}

std::size_t Path::segment(double t) const { return interval(t_, t); }

std::span<const double> Path::control(std::size_t segment, std::size_t joint, std::span<double, 6> scratch) const {
  if (!control_.empty()) {
    const std::size_t size = static_cast<std::size_t>(degree_ + 1);
    return std::span(control_).subspan((segment * joints_ + joint) * size, size);
  }
  const double T = t_[segment + 1] - t_[segment];
  const std::size_t a = segment * joints_ + joint, b = a + joints_;
  const auto points = bernstein::quintic({q_[a], dq_[a] * T, ddq_[a] * T * T}, {q_[b], dq_[b] * T, ddq_[b] * T * T});
  std::copy(points.begin(), points.end(), scratch.begin());
  return scratch;
}

void Path::at(double t, std::span<double> q, std::span<double> dq, std::span<double> ddq, std::span<double> dddq) const {
  const bool within = t >= begin() && t <= end();
  const std::size_t k = segment(t);
  const double T = t_[k + 1] - t_[k];
  const double s = std::clamp((t - t_[k]) / T, 0.0, 1.0);
  const double rate = within ? 1 / T : 0;
  std::array<double, 6> scratch;
  for (std::size_t j = 0; j < joints_; ++j) {
    const auto p = bernstein::evaluate(control(k, j, scratch), s);
    q[j] = p[0];
    dq[j] = p[1] * rate;
    ddq[j] = p[2] * rate * rate;
    if (!dddq.empty()) dddq[j] = p[3] * rate * rate * rate;
  }
}

Path::Range Path::range(std::size_t joint, int derivative) const {
  Range range;
  std::array<double, 6> scratch;
  for (std::size_t k = 0; k + 1 < t_.size(); ++k) {
    const double T = t_[k + 1] - t_[k];
    double scale = 1;
    for (int i = 0; i < derivative; ++i) scale /= T;
    const auto b = control(k, joint, scratch);
    const auto hull = bernstein::hull(b, derivative);
    if (k > 0 && hull.min * scale >= range.min.value && hull.max * scale <= range.max.value) continue;
    const auto found = bernstein::extremes(b, derivative);
    if (k == 0 || found.min.value * scale < range.min.value) range.min = {found.min.value * scale, t_[k] + found.min.s * T};
    if (k == 0 || found.max.value * scale > range.max.value) range.max = {found.max.value * scale, t_[k] + found.max.s * T};
  }
  return range;
}

Path cut(const Path& path, double begin, double end) {
  assert(path.degree() == 5 && path.begin() <= begin && begin < end && end <= path.end());
  // A knot closer to an end than this share of the cut segment is omitted: over a short length h, rounding gives an error of q̈
  // of the order 1e-15/h². The error of q̈ from one quintic over both segments of a spline is of the order of the cube of this
  // share.
  constexpr double kSliver = 1e-3;
  const std::span<const double> knots = path.times();
  std::vector<double> t = {begin};
  for (std::size_t k = 1; k + 1 < knots.size(); ++k) {
    if (knots[k] - begin <= kSliver * (knots[k] - knots[k - 1]) || end - knots[k] <= kSliver * (knots[k + 1] - knots[k]))
      continue;
    t.push_back(knots[k]);
  }
  t.push_back(end);
  const std::size_t n = path.joints();
  std::vector<double> q(t.size() * n), dq(q.size()), ddq(q.size());
  for (std::size_t k = 0; k < t.size(); ++k) {
    const auto row = [&](std::vector<double>& x) { return std::span(x).subspan(k * n, n); };
    path.at(t[k], row(q), row(dq), row(ddq));
  }
  return Path(n, std::move(t), std::move(q), std::move(dq), std::move(ddq));
}

}  // namespace cotwin::trajectory
