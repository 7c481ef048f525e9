#include "master/results/curve.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace cotwin::report {

void Figures::add(double t, double y) {
  if (!std::isfinite(y)) {
    ++missing;
    return;
  }
  if (count++ == 0) {
    min = max = first = y;
    t_of_min = t_of_max = t;
  }
  last = y;
  if (y < min) {
    min = y;
    t_of_min = t;
  }
  if (y > max) {
    max = y;
    t_of_max = t;
  }
  sum += y;
  squares += y * y;
}

double Figures::mean() const { return sum / static_cast<double>(count); }
double Figures::rms() const { return std::sqrt(squares / static_cast<double>(count)); }
double Figures::largest() const { return std::max(std::abs(min), std::abs(max)); }
double Figures::t_of_largest() const { return std::abs(min) > std::abs(max) ? t_of_min : t_of_max; }

void Curve::join(Interval& a, const Interval& b) {
  if (b.count > 0) {
    if (a.count == 0) {
      a.first = b.first;
      a.low = b.low;
      a.high = b.high;
      a.low_at = b.low_at;
      a.high_at = b.high_at;
    } else {
      if (b.low.y < a.low.y) {
        a.low = b.low;
        a.low_at = b.low_at;
      }
      if (b.high.y > a.high.y) {
        a.high = b.high;
        a.high_at = b.high_at;
      }
    }
    a.last = b.last;
  }
  a.count += b.count;
  a.interrupted = a.interrupted || b.interrupted;
}

void Curve::add(double t, double y) {
  figures_.add(t, y);
  if (!with_points_) return;
  if (intervals_.empty() || in_last_ == length_) {
    if (intervals_.size() == 2 * kIntervals) {
      for (std::size_t i = 0; i < kIntervals; ++i) {
        intervals_[i] = intervals_[2 * i];
        join(intervals_[i], intervals_[2 * i + 1]);
      }
      intervals_.resize(kIntervals);
      length_ *= 2;
    }
    intervals_.emplace_back();
    in_last_ = 0;
  }
  ++in_last_;
  Interval sample;
  if (std::isfinite(y)) {
    sample.first = sample.low = sample.high = sample.last = {t, y};
    sample.low_at = sample.high_at = samples_;
    sample.count = 1;
  } else {
    sample.interrupted = true;
  }
  ++samples_;
  join(intervals_.back(), sample);
}

std::vector<Point> Curve::points() const {
  std::vector<Point> all;
  const auto put = [&](const Point& p) {
    if (all.empty() || std::isnan(all.back().y) || all.back().t != p.t || all.back().y != p.y) all.push_back(p);
  };
  for (const Interval& i : intervals_) {
    if (i.count > 0) {
      put(i.first);
      put(i.low_at <= i.high_at ? i.low : i.high);
      put(i.low_at <= i.high_at ? i.high : i.low);
      put(i.last);
    }
    if (i.interrupted && !all.empty() && !std::isnan(all.back().y))
      all.push_back({all.back().t, std::numeric_limits<double>::quiet_NaN()});
  }
  return all;
}

namespace {

/// Distance of `p` from the line through a and b, or from a if they coincide.
double distance(const Point& p, const Point& a, const Point& b, double t_scale, double y_scale) {
  const double dx = t_scale * (b.t - a.t), dy = y_scale * (b.y - a.y);
  const double px = t_scale * (p.t - a.t), py = y_scale * (p.y - a.y);
  const double squared = dx * dx + dy * dy;
  if (!(squared > 0)) return std::hypot(px, py);
  const double along = std::clamp((px * dx + py * dy) / squared, 0.0, 1.0);
  return std::hypot(px - along * dx, py - along * dy);
}

}  // namespace

std::vector<Point> simplified(const std::vector<Point>& points, double t_scale, double y_scale, double tolerance) {
  std::vector<bool> kept(points.size(), false);
  std::vector<std::pair<std::size_t, std::size_t>> open;  // parts of the curve between two points that stay
  std::size_t begin = 0;
  for (std::size_t i = 0; i <= points.size(); ++i) {
    if (i < points.size() && !std::isnan(points[i].y)) continue;
    if (i < points.size()) kept[i] = true;
    if (i > begin) {
      kept[begin] = kept[i - 1] = true;
      open.emplace_back(begin, i - 1);
    }
    begin = i + 1;
  }
  while (!open.empty()) {
    const auto [a, b] = open.back();
    open.pop_back();
    double most = tolerance;
    std::size_t farthest = a;
    for (std::size_t i = a + 1; i < b; ++i) {
      const double d = distance(points[i], points[a], points[b], t_scale, y_scale);
      if (d > most) {
        most = d;
        farthest = i;
      }
    }
    if (farthest == a) continue;
    kept[farthest] = true;
    open.emplace_back(a, farthest);
    open.emplace_back(farthest, b);
  }
  std::vector<Point> result;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (kept[i]) result.push_back(points[i]);
  }
  return result;
}

}  // namespace cotwin::report
