#include "models/identification/measurement/spectrum.h"

#include <algorithm>
#include <cassert>
#include <cmath>
#include <numbers>

namespace cotwin::measurement {

using std::numbers::pi;

void fourier_transform(std::span<std::complex<double>> x) {
  const std::size_t N = x.size();
  assert(N > 0 && (N & (N - 1)) == 0);
  for (std::size_t i = 1, j = 0; i < N; ++i) {  // the order of reversed bits
    std::size_t bit = N >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j ^= bit;
    if (i < j) std::swap(x[i], x[j]);
  }
  for (std::size_t half = 1; half < N; half *= 2) {
    for (std::size_t k = 0; k < half; ++k) {
      const std::complex<double> turn = std::polar(1.0, -pi * static_cast<double>(k) / static_cast<double>(half));
      for (std::size_t i = k; i < N; i += 2 * half) {
        const std::complex<double> odd = turn * x[i + half];
        x[i + half] = x[i] - odd;
        x[i] += odd;
      }
    }
  }
}

MotionSpectrum::MotionSpectrum(std::size_t n, double rate) : n_(n), window_(4096), sum_(n), q_(n) {
  constexpr double kRate = 50;  // Hz
  decimation_ = std::max<std::size_t>(1, static_cast<std::size_t>(std::lround(rate / kRate)));
  rate_ = rate / static_cast<double>(decimation_);
  v_.reserve(window_ * n);
  power_.resize((window_ / 2 + 1) * n);
}

void MotionSpectrum::add(std::span<const double> q, bool begins) {
  if (begins) {
    has_q_ = false;
    in_group_ = 0;
  }
  if (in_group_ == 0) std::fill(sum_.begin(), sum_.end(), 0.0);
  for (std::size_t j = 0; j < n_; ++j) sum_[j] += q[j];
  if (++in_group_ < decimation_) return;
  in_group_ = 0;
  for (double& s : sum_) s /= static_cast<double>(decimation_);
  add_velocity(sum_);
}

void MotionSpectrum::add_velocity(std::span<const double> q) {
  if (has_q_) {
    for (std::size_t j = 0; j < n_; ++j) v_.push_back((q[j] - q_[j]) * rate_);
  }
  std::copy(q.begin(), q.end(), q_.begin());
  has_q_ = true;
  if (v_.size() == window_ * n_) transform();
}

// Adds the power of the window (Hann, without its mean, padded with zeros) to `power_`.
void MotionSpectrum::transform() {
  const std::size_t N = v_.size() / n_;
  std::vector<std::complex<double>> x(window_);
  for (std::size_t j = 0; j < n_; ++j) {
    double mean = 0;
    for (std::size_t i = 0; i < N; ++i) mean += v_[i * n_ + j];
    mean /= static_cast<double>(N);
    std::fill(x.begin(), x.end(), 0.0);
    for (std::size_t i = 0; i < N; ++i) {
      const double hann = 0.5 - 0.5 * std::cos(2 * pi * (static_cast<double>(i) + 0.5) / static_cast<double>(N));
      x[i] = hann * (v_[i * n_ + j] - mean);
    }
    fourier_transform(x);
    const std::size_t bins = window_ / 2 + 1;
    for (std::size_t k = 0; k < bins; ++k) power_[j * bins + k] += std::norm(x[k]);
  }
  ++windows_;
  v_.clear();
}

std::vector<double> MotionSpectrum::frequency_of_share(double share) {
  if (v_.size() > (windows_ == 0 ? n_ : window_ / 2 * n_)) transform();
  const std::size_t bins = window_ / 2 + 1;
  std::vector<double> frequency(n_);
  for (std::size_t j = 0; j < n_; ++j) {
    const std::span<const double> power = std::span(power_).subspan(j * bins, bins);
    double total = 0, sum = 0;
    for (const double p : power) total += p;
    for (std::size_t k = 0; k < bins && total > 0; ++k) {
      sum += power[k];
      frequency[j] = rate_ * static_cast<double>(k) / static_cast<double>(window_);
      if (sum >= share * total) break;
    }
  }
  return frequency;
}

}  // namespace cotwin::measurement
