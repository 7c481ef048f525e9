#include "models/identification/measurement/smoothing.h"

#include <algorithm>
#include <cmath>

#include "models/trajectory/spline.h"

namespace cotwin::measurement {

namespace {

constexpr std::size_t kSplineReach =
    32;  // knots after which the effect of the ends of a quintic spline (0.43 a knot) is below 1e-11

/// Grid points from the first sample to the last one, both included.
std::size_t points_within(double duration, double step) {
  return static_cast<std::size_t>(std::floor(duration / step + 1e-3)) + 1;
}

std::size_t margin_points(const Smoothing& smoothing) {
  return static_cast<std::size_t>(std::ceil(smoothing.margin / smoothing.step - 1e-6));
}

}  // namespace

std::size_t grid_points(double duration, const Smoothing& smoothing) {
  const std::size_t all = points_within(duration, smoothing.step), ends = 2 * margin_points(smoothing);
  return all > ends ? all - ends : 0;
}

SmoothedLog::SmoothedLog(const Log& log, std::span<const trajectory::Axis> axes, const Smoothing& smoothing, double gap,
                         std::size_t block)
    : reader_(log, axes, gap, smoothing.step),
      n_(axes.size()),
      gap_(gap),
      smoothing_(smoothing),
      filter_(smoothing.cutoff, 1 / smoothing.step, smoothing.order),
      block_(std::max(block, 2 * filter_.memory())),
      overlap_(filter_.memory() + kSplineReach),
      margin_(margin_points(smoothing)) {
  has_theta_ = reader_.sample().theta().present();
  for (trajectory::Series* series : {&q_raw_, &theta_raw_, &tau_raw_, &q_, &theta_, &tau_}) series->width = n_;
}

bool SmoothedLog::open_segment() {
  if (!ahead_ && !reader_.next()) return false;
  for (trajectory::Series* series : {&q_raw_, &theta_raw_, &tau_raw_}) {
    series->t.clear();
    series->x.clear();
  }
  open_ = true;
  ended_ = ahead_ = false;
  ++segments_;
  t_first_ = reader_.sample().t();
  k_next_ = margin_;
  push();
  return true;
}

// Adds the current sample of the reader to the window.
void SmoothedLog::push() {
  const trajectory::RecordingReader& sample = reader_.sample();
  const auto add = [&](trajectory::Series& series, const std::vector<double>& x) {
    series.t.push_back(sample.t());
    series.x.insert(series.x.end(), x.begin(), x.end());
  };
  add(q_raw_, sample.q().value);
  add(tau_raw_, sample.tau().value);
  if (has_theta_) add(theta_raw_, sample.theta().value);
}

// Reads until the window extends beyond `until` or the segment ends.
void SmoothedLog::fill(double until) {
  while (!ended_ && q_raw_.t.back() < until) {
    if (!reader_.next()) {
      ended_ = true;
      return;
    }
    if (reader_.begins()) {
      ended_ = ahead_ = true;
      return;
    }
    push();
  }
}

bool SmoothedLog::is_regular(std::size_t k_begin) const {
  const double begin = t_first_ + static_cast<double>(k_begin) * smoothing_.step;
  for (std::size_t i = 0; i < q_raw_.size(); ++i) {
    const double expected = begin + static_cast<double>(i) * smoothing_.step;
    if (std::abs(q_raw_.t[i] - expected) > 1e-3 * smoothing_.step) return false;
  }
  return true;
}

// Positions and torques as measured, at `count` grid points from k_begin on.
void SmoothedLog::put_on_grid(std::size_t k_begin, std::size_t count) {
  const double h = smoothing_.step;
  const double raw_begin = std::round((q_raw_.t.front() - t_first_) / h);
  const std::size_t k_raw = static_cast<std::size_t>(std::max(0.0, raw_begin));
  const bool regular = is_regular(k_raw) && k_raw <= k_begin && k_begin + count <= k_raw + q_raw_.size();
  q_.t.resize(count);
  for (std::size_t i = 0; i < count; ++i) q_.t[i] = t_first_ + static_cast<double>(k_begin + i) * h;
  tau_.t = theta_.t = q_.t;
  measured_.assign(count, 1);
  const bool complete = regular || is_complete();
  if (!complete) mark_measured(k_begin, count);
  for (auto [raw, even] : {std::pair{&q_raw_, &q_}, std::pair{&theta_raw_, &theta_}, std::pair{&tau_raw_, &tau_}}) {
    if (raw->t.empty()) continue;
    even->x.resize(count * n_);
    if (regular) {
      const auto from = raw->x.begin() + static_cast<std::ptrdiff_t>((k_begin - k_raw) * n_);
      std::copy_n(from, count * n_, even->x.begin());
      continue;
    }
    if (!complete) {
      fill_missing(*raw, k_begin, *even);
      continue;
    }
    const trajectory::Path path = trajectory::interpolate(*raw);
    std::vector<double> dx(n_), ddx(n_);
    for (std::size_t i = 0; i < count; ++i)
      path.at(std::min(even->t[i], raw->t.back()), std::span(even->x).subspan(i * n_, n_), dx, ddx);
  }
}

bool SmoothedLog::is_complete() const {
  for (std::size_t i = 1; i < q_raw_.size(); ++i)
    if (q_raw_.t[i] - q_raw_.t[i - 1] > 1.5 * smoothing_.step) return false;
  return true;
}

void SmoothedLog::mark_measured(std::size_t k_begin, std::size_t count) {
  measured_.assign(count, 0);
  for (const double t : q_raw_.t) {
    const double k = std::round((t - t_first_) / smoothing_.step) - static_cast<double>(k_begin);
    if (k >= 0 && k < static_cast<double>(count)) measured_[static_cast<std::size_t>(k)] = 1;
  }
  // Beside a gap of more than half of 1/cutoff the filter has no support on one side.
  const double beside = 0.25 / smoothing_.cutoff;
  for (std::size_t i = 1; i < q_raw_.size(); ++i) {
    if (q_raw_.t[i] - q_raw_.t[i - 1] < 2 * beside) continue;
    for (std::size_t k = 0; k < count; ++k)
      if (q_.t[k] > q_raw_.t[i - 1] - beside && q_.t[k] < q_raw_.t[i] + beside) measured_[k] = 0;
  }
}

void SmoothedLog::fill_missing(const trajectory::Series& raw, std::size_t k_begin, trajectory::Series& even) const {
  constexpr int kMost = 400;
  constexpr double kNear = 1e-9;  // change by an iteration, relative to the range of the signal
  const std::size_t count = even.t.size();
  struct Place {
    std::size_t sample, k;  // the grid point next to a sample,
    double offset;          // and how far behind it that was taken, in steps
  };
  std::vector<Place> places;
  std::vector<double> samples_at(count);
  for (std::size_t s = 0; s < raw.size(); ++s) {
    const double at = (raw.t[s] - t_first_) / smoothing_.step - static_cast<double>(k_begin), k = std::round(at);
    if (!(k >= 0 && k < static_cast<double>(count))) continue;
    places.push_back({s, static_cast<std::size_t>(k), at - k});
    samples_at[places.back().k] += 1;
  }
  std::vector<double> z(count), y(count), sum(count);
  for (std::size_t c = 0; c < n_; ++c) {
    double low = raw.x[c], high = low;
    for (std::size_t s = 0; s < raw.size(); ++s) {
      low = std::min(low, raw.x[s * n_ + c]);
      high = std::max(high, raw.x[s * n_ + c]);
    }
    for (std::size_t k = 0, s = 0; k < count; ++k) {  // straight lines between the samples
      while (s + 1 < raw.size() && raw.t[s + 1] < even.t[k]) ++s;
      const std::size_t next = std::min(s + 1, raw.size() - 1);
      const double span = raw.t[next] - raw.t[s];
      const double share = span > 0 ? std::clamp((even.t[k] - raw.t[s]) / span, 0.0, 1.0) : 0.0;
      z[k] = (1 - share) * raw.x[s * n_ + c] + share * raw.x[next * n_ + c];
    }
    for (int repetition = 0; repetition < kMost; ++repetition) {
      y = z;
      filter_.apply(y);
      std::fill(sum.begin(), sum.end(), 0.0);
      for (const Place& p : places) {
        const double before = y[p.k > 0 ? p.k - 1 : 0], here = y[p.k], after = y[std::min(p.k + 1, count - 1)];
        const double away = p.offset * (0.5 * (after - before) + 0.5 * p.offset * (after - 2 * here + before));
        sum[p.k] += raw.x[p.sample * n_ + c] - away;
      }
      double change = 0;
      for (std::size_t k = 0; k < count; ++k) {
        const double next = samples_at[k] > 0 ? sum[k] / samples_at[k] : y[k];
        change = std::max(change, std::abs(next - z[k]));
        z[k] = next;
      }
      if (change <= kNear * (high - low)) break;
    }
    for (std::size_t k = 0; k < count; ++k) even.x[k * n_ + c] = z[k];
  }
}

trajectory::Series SmoothedLog::smoothed(const trajectory::Series& measured) const {
  trajectory::Series smooth = measured;
  std::vector<double> column(smooth.size());
  for (std::size_t c = 0; c < n_; ++c) {
    for (std::size_t k = 0; k < column.size(); ++k) column[k] = smooth.x[k * n_ + c];
    filter_.apply(column);
    for (std::size_t k = 0; k < column.size(); ++k) smooth.x[k * n_ + c] = column[k];
  }
  return smooth;
}

// Smooths the window on the grid, which starts at k_begin, and delivers `count` points from k_next_ on.
void SmoothedLog::deliver(std::size_t k_begin, std::size_t count) {
  const auto cut = [&](const std::vector<double>& from, std::vector<double>& to, std::size_t width) {
    const auto begin = from.begin() + static_cast<std::ptrdiff_t>((k_next_ - k_begin) * width);
    to.assign(begin, begin + static_cast<std::ptrdiff_t>(count * width));
  };
  const auto differentiate = [&](const trajectory::Series& measured, std::vector<double>& x, std::vector<double>& dx,
                                 std::vector<double>& ddx) {
    const trajectory::Series smooth = smoothed(measured);
    const auto knots = trajectory::solve_spline(smooth.t, n_, smooth.x, trajectory::SplineEnds::kFree);
    cut(smooth.x, x, n_);
    cut(knots.dq, dx, n_);
    cut(knots.ddq, ddx, n_);
  };
  result_.segment = segments_ - 1;
  result_.count = count;
  cut(q_.t, result_.t, 1);
  const auto first = measured_.begin() + static_cast<std::ptrdiff_t>(k_next_ - k_begin);
  result_.measured.assign(first, first + static_cast<std::ptrdiff_t>(count));
  differentiate(q_, result_.q, result_.dq, result_.ddq);
  if (has_theta_) differentiate(theta_, result_.theta, result_.dtheta, result_.ddtheta);
  cut(tau_.x, result_.tau_measured, n_);
  cut(smoothed(tau_).x, result_.tau, n_);
}

void SmoothedLog::forget_before(double t) {
  const auto keep = std::lower_bound(q_raw_.t.begin(), q_raw_.t.end(), t);
  const auto samples = keep - q_raw_.t.begin();
  for (trajectory::Series* series : {&q_raw_, &theta_raw_, &tau_raw_}) {
    if (series->t.empty()) continue;
    series->t.erase(series->t.begin(), series->t.begin() + samples);
    series->x.erase(series->x.begin(), series->x.begin() + samples * static_cast<std::ptrdiff_t>(n_));
  }
}

const Block* SmoothedLog::next() {
  const double h = smoothing_.step;
  for (;;) {
    if (!open_ && !open_segment()) return nullptr;
    fill(t_first_ + static_cast<double>(k_next_ + block_ + overlap_ + kSplineReach) * h);
    const std::size_t known = points_within(q_raw_.t.back() - t_first_, h);
    const std::size_t stop = !ended_ ? k_next_ + block_ : known > margin_ ? known - margin_ : 0;
    if (stop <= k_next_ || q_raw_.size() < 2) {
      open_ = false;
      continue;
    }
    const std::size_t count = std::min(block_, stop - k_next_);
    const std::size_t k_begin = k_next_ > overlap_ ? k_next_ - overlap_ : 0;
    const std::size_t k_end = std::min(known, k_next_ + count + overlap_);
    put_on_grid(k_begin, k_end - k_begin);
    deliver(k_begin, count);
    k_next_ += count;
    const double keep = static_cast<double>(k_next_) - static_cast<double>(overlap_ + kSplineReach);
    forget_before(t_first_ + (keep - 0.5) * h - gap_);
    return &result_;
  }
}

}  // namespace cotwin::measurement
