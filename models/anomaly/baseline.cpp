#include <Eigen/Cholesky>
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

bool Watch::finish() {
  const std::size_t blocks = static_cast<std::size_t>(closed_);
  if (ready_ != 0 || closed_ < kLeastBlocks) return ready_ != 0;
  for (std::size_t j = 0; j < n_; ++j) fit(j, blocks);
  // Matched filters: mean, information, and what the blocks have beyond it.
  double pooled = 0, sides = 0;
  for (int k = 0; k < static_cast<int>(causes_); ++k) {
    Chart& chart = charts_[static_cast<std::size_t>(k)];
    double d = 0, information = 0, squares = 0;
    for (std::size_t b = 0; b < blocks; ++b) {
      const Score s = score(block(b), k);
      d += s.d, information += s.information, squares += s.information * s.information;
    }
    if (!(information > 0) || information * information < kLeastBlocks * squares) continue;
    chart.ready = 1;
    chart.theta = d / information;
    chart.information = information / closed_;
    for (std::size_t b = 0; b < blocks; ++b) {
      const Score s = score(block(b), k);
      x_[b] = s.d / std::sqrt(s.information + kSettled * chart.information);
    }
    raw_[static_cast<std::size_t>(k)] = correlation(std::span(x_.data(), blocks));
    pooled += raw_[static_cast<std::size_t>(k)];
    sides += 1;
  }
  pooled /= std::max(sides, 1.0);
  sides = 2 * sides + static_cast<double>(n_);
  const auto limit_of = [&](Chart& chart, double usual) {
    chart.limit = std::max(
        kLeastLimit, threshold(std::max(kLeastReference, 0.5 * chart.dead * usual), options_.interval * 3600 / kBlock * sides));
  };
  for (int k = 0; k < static_cast<int>(causes_); ++k) {
    Chart& chart = charts_[static_cast<std::size_t>(k)];
    if (chart.ready == 0) continue;
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
    const Whitening white = whitening(raw_[static_cast<std::size_t>(k)], pooled, number);
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
      if (rms > 1e-9 && sigma_[i] > 0) chart.dead = std::min(chart.dead, options_.least * limit_[i] / rms);
    });
    if (model_.cause(k) == Cause::kFriction && model_.has_friction(model_.joint(k))) chart.dead = kFriction;
    if (!std::isfinite(chart.dead)) chart.dead = 0;
    limit_of(chart, white.gain() * total / std::max(count, 1.0) /
                        (chart.scale * std::sqrt(total / std::max(count, 1.0) + kSettled * chart.information)));
  }
  for (std::size_t j = 0; j < n_; ++j) {
    Chart& chart = charts_[causes_ + j];
    std::size_t count = 0;
    for (std::size_t b = 0; b < blocks; ++b)
      if (tells(block(b), j)) x_[count++] = spread(block(b), j);
    if (static_cast<double>(count) < kLeastBlocks) continue;
    const std::span<double> values(x_.data(), count);
    const double number = static_cast<double>(count);
    mean_spread_[j] = std::accumulate(values.begin(), values.end(), 0.0) / number;
    double squares = 0;
    for (double& y : values) y -= mean_spread_[j], squares += y * y;
    chart.ready = 1;
    const Whitening white = whitening(correlation(values), pooled, number);
    chart.scale = std::max(std::sqrt(squares / number), 0.05) * doubtful(number, white);
    chart.rho = white.rho;
    chart.doubt = chart.scale / std::sqrt(number) / white.gain();
    chart.dead = std::log(kScatter);
    limit_of(chart, white.gain() / chart.scale);
  }
  ready_ = 1;
  baselines_ += 1;
  return true;
}

}  // namespace cotwin::anomaly
