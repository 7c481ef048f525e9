#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "models/anomaly/anomaly.h"
#include "models/anomaly/constants.h"

namespace cotwin::anomaly {

namespace {

/// Factor from a deviation that was estimated from `number` correlated values to the upper end of its own standard deviation.
double doubtful(double number, const Whitening& white) {
  const double independent = number * (1 - white.rho * white.rho) / (1 + white.rho * white.rho);
  return std::sqrt(1 + std::sqrt(2 / std::max(independent, 1.0)));
}

}  // namespace

/// β, σ and the largest residual of joint j.
void Watch::fit(std::size_t j, std::size_t blocks) {
  double count = 0, squares = 0, telling = 0, greatest = 0, least = 0;
  Eigen::Matrix4d pairs = Eigen::Matrix4d::Zero();
  Eigen::Vector4d with = Eigen::Vector4d::Zero();
  static_assert(kFits == 4);
  for (std::size_t b = 0; b < blocks; ++b) {
    const double* const own = block(b) + 1 + kPerJoint * j;
    if (own[kCount] == 0) continue;
    greatest = telling > 0 ? std::max(greatest, own[kGreatest]) : own[kGreatest];
    least = telling > 0 ? std::min(least, own[kLeast]) : own[kLeast];
    count += own[kCount], squares += own[kSquares], telling += 1;
    for (Eigen::Index f = 0, pair = kPairs; f < 4; ++f) {
      with[f] += own[kWith + static_cast<std::size_t>(f)];
      for (Eigen::Index g = f; g < 4; ++g) pairs(f, g) += own[pair++];
    }
  }
  if (telling < kLeastBlocks) return;
  const double mean = with[0] / count;
  peak_[j] = std::max(greatest - mean, mean - least);
  pairs.triangularView<Eigen::StrictlyLower>() = pairs.transpose();
  for (Eigen::Index f = 1; f < 4; ++f) pairs(f, f) *= 1 + kRidge;
  Eigen::Map<Eigen::Vector4d> beta(beta_.data() + kFits * j);
  beta = pairs.ldlt().solve(with);
  if (!beta.allFinite()) beta << mean, 0, 0, 0;
  double left = 0;
  for (std::size_t b = 0; b < blocks; ++b) left += squares_of(block(b), j);
  sigma_[j] = std::max(std::sqrt(left / count), floor_[j]);
}

/// Mean, usual information and correlation of the matched filter of cause k.
void Watch::learn(int k, std::size_t blocks) {
  Chart& chart = charts_[static_cast<std::size_t>(k)];
  double d = 0, information = 0, squares = 0;
  for (std::size_t b = 0; b < blocks; ++b) {
    const Score s = score(block(b), k);
    d += s.d, information += s.information, squares += s.information * s.information;
  }
  if (!(information > 0) || information * information < kLeastBlocks * squares) return;
  chart.ready = 1;
  chart.information = information / closed_;
  const double theta = d / information;
  for (std::size_t b = 0; b < blocks; ++b) {
    const Score s = score(block(b), k);
    x_[b] = (s.d - theta * s.information) / std::sqrt(s.information + kSettled * chart.information);
  }
  chart.theta = theta;
  chart.rho = correlation(std::span(x_.data(), blocks));
  pooled_ += chart.rho;
}

double Watch::learnt() const {
  return static_cast<double>(std::count_if(charts_.begin(), charts_.begin() + static_cast<std::ptrdiff_t>(causes_),
                                           [](const Chart& c) { return c.ready != 0; }));
}

/// The threshold of a chart in which a shift of one unit gives `usual`.
void Watch::limit(Chart& chart, double usual) const {
  const double sides = 2 * learnt() + static_cast<double>(n_);  // spreads have one
  const double length = kFalseAlarm * 3600 / kBlock * sides;
  chart.limit = std::max(kLeastLimit, threshold(std::max(kLeastReference, 0.5 * chart.dead * usual), length));
}

/// Scale, autoregression, least change and threshold of cause k.
void Watch::standardise(int k, std::size_t blocks) {
  Chart& chart = charts_[static_cast<std::size_t>(k)];
  if (chart.ready == 0) return;
  double count = 0, weights = 0, squares = 0, total = 0, total_squares = 0;
  for (std::size_t b = 0; b < blocks; ++b) {
    const Score s = score(block(b), k);
    const double all = s.information + kSettled * chart.information;
    count += s.information >= kLittle * chart.information ? 1 : 0;
    weights += s.information / all;
    squares += s.d * s.d / all;
    total += s.information, total_squares += s.information * s.information;
  }
  const double number = total * total / total_squares;
  const Whitening white = whitening(chart.rho, pooled_ / learnt(), number);
  chart.scale = std::sqrt(std::max(squares / weights, 1e-12)) * doubtful(number, white);
  chart.rho = white.rho;
  chart.doubt = chart.scale / std::sqrt(total) / white.gain();
  chart.dead = std::numeric_limits<double>::infinity();
  each_joint(k, [&](std::size_t i) {
    double samples = 0, effect = 0;
    for (std::size_t b = 0; b < blocks; ++b) {
      samples += block(b)[1 + kPerJoint * i + kCount];
      effect += block(b)[term(k, i) + kEffect];
    }
    const double rms = std::sqrt(effect / std::max(samples, 1.0));
    if (rms > 1e-9 && sigma_[i] > 0) chart.dead = std::min(chart.dead, kLeastChange * limit_[i] / rms);
  });
  if (model_.cause(k) == Cause::kFriction && model_.has_friction(model_.joint(k))) chart.dead = kFriction;
  if (!std::isfinite(chart.dead)) chart.dead = 0;
  const double usual = total / std::max(count, 1.0);
  limit(chart, white.gain() * usual / (chart.scale * std::sqrt(usual + kSettled * chart.information)));
}

/// The chart of the spread of joint j.
void Watch::learn_spread(std::size_t j, std::size_t blocks) {
  Chart& chart = charts_[causes_ + j];
  std::size_t count = 0;
  for (std::size_t b = 0; b < blocks; ++b)
    if (tells(block(b), j)) x_[count++] = spread(block(b), j);
  const std::span<double> values(x_.data(), count);
  const double number = static_cast<double>(count);
  if (number < kLeastBlocks) return;
  mean_spread_[j] = std::accumulate(values.begin(), values.end(), 0.0) / number;
  double squares = 0;
  for (double& y : values) y -= mean_spread_[j], squares += y * y;
  chart.ready = 1;
  const Whitening white = whitening(correlation(values), pooled_ / std::max(learnt(), 1.0), number);
  chart.scale = std::max(std::sqrt(squares / number), 0.05) * doubtful(number, white);
  chart.rho = white.rho;
  chart.doubt = chart.scale / std::sqrt(number) / white.gain();
  chart.dead = std::log(kScatter);
  limit(chart, white.gain() / chart.scale);
}

/// One part of what a baseline takes to be complete, each short enough for a step of a run in real time.
void Watch::prepare() {
  const std::size_t blocks = static_cast<std::size_t>(closed_), part = static_cast<std::size_t>(preparing_) - 1,
                    learning = n_ + causes_;
  if (part < n_) {
    fit(part, blocks);
  } else if (part < learning) {
    learn(static_cast<int>(part - n_), blocks);
  } else if (part < learning + causes_) {
    standardise(static_cast<int>(part - learning), blocks);
  } else {
    learn_spread(part - learning - causes_, blocks);
  }
  preparing_ += 1;
  if (part + 1 < 2 * learning) return;
  preparing_ = 0;
  ready_ = 1;
  baselines_ += 1;
}

bool Watch::finish() {
  if (ready_ == 0 && closed_ >= kLeastBlocks) {
    preparing_ = std::max(preparing_, 1.0);
    while (preparing_ != 0) prepare();
  }
  return ready_ != 0;
}

}  // namespace cotwin::anomaly
