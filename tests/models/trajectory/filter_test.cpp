#include "models/trajectory/series/filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::trajectory::filter_test {
namespace {

constexpr double kRate = 100;  // Hz
constexpr double kTurn = 2 * std::numbers::pi;

std::vector<double> sine(double frequency, std::size_t samples) {
  std::vector<double> x(samples);
  for (std::size_t k = 0; k < samples; ++k) x[k] = std::sin(kTurn * frequency * static_cast<double>(k) / kRate + 0.3);
  return x;
}

/// Amplitude and phase of a filtered sine, far from the ends, over whole periods.
struct Response {
  double gain, phase;
};
Response response(const ZeroPhaseLowPass& filter, double frequency) {
  constexpr std::size_t kSamples = 8000, kFrom = 3000, kOver = 2000;  // 20 s: whole periods of multiples of 0.05 Hz
  std::vector<double> y = sine(frequency, kSamples);
  filter.apply(y);
  double in_phase = 0, quadrature = 0;
  for (std::size_t k = kFrom; k < kFrom + kOver; ++k) {
    const double angle = kTurn * frequency * static_cast<double>(k) / kRate + 0.3;
    in_phase += y[k] * std::sin(angle) * 2 / kOver;
    quadrature += y[k] * std::cos(angle) * 2 / kOver;
  }
  return {std::hypot(in_phase, quadrature), std::atan2(quadrature, in_phase)};
}

TEST(ZeroPhaseLowPass, TheCutoffIsThe3DecibelPointOfBothPasses) {
  for (int order = 1; order <= 8; ++order) {
    for (const double cutoff : {2.0, 10.0, 30.0, 45.0}) {
      const ZeroPhaseLowPass filter(cutoff, kRate, order);
      EXPECT_NEAR(response(filter, cutoff).gain, std::sqrt(0.5), 1e-9) << order << ", " << cutoff;
    }
  }
}

TEST(ZeroPhaseLowPass, GainIsTheDocumentedFunctionAndPhaseIsZero) {
  for (int order = 1; order <= 8; ++order) {
    const ZeroPhaseLowPass filter(8, kRate, order);
    for (const double frequency : {0.5, 2.0, 5.0, 8.0, 11.0, 20.0}) {
      const Response r = response(filter, frequency);
      // G = 1/(1 + (√2 − 1) r^(2N)), written independently from the header's text
      const double ratio = std::tan(std::numbers::pi * frequency / kRate) / std::tan(std::numbers::pi * 8 / kRate);
      const double gain = 1 / (1 + (std::numbers::sqrt2 - 1) * std::pow(ratio, 2 * order));
      EXPECT_NEAR(r.gain, gain, 1e-9) << order << ", " << frequency;
      if (gain > 1e-6) {
        EXPECT_NEAR(r.phase, 0, 1e-9 / gain) << order << ", " << frequency;
      }
    }
  }
}

TEST(ZeroPhaseLowPass, ConstantsAndStraightLinesPassUnchangedUpToTheEnds) {
  for (int order = 1; order <= 8; ++order) {
    const ZeroPhaseLowPass filter(5, kRate, order);
    std::vector<double> x(2000);
    for (std::size_t k = 0; k < x.size(); ++k) x[k] = 3 - 0.01 * static_cast<double>(k);
    std::vector<double> y = x;
    filter.apply(y);
    for (std::size_t k = 0; k < x.size(); ++k) ASSERT_NEAR(y[k], x[k], 1e-7) << "order " << order << ", sample " << k;
  }
}

TEST(ZeroPhaseLowPass, ARecordingRunBackwardsIsFilteredAlike) {
  std::mt19937 random(1);
  std::normal_distribution<double> noise;
  std::vector<double> x(3000);
  for (double& value : x) value = noise(random);
  const ZeroPhaseLowPass filter(7, kRate, 3);
  std::vector<double> forwards = x, backwards(x.rbegin(), x.rend());
  filter.apply(forwards);
  filter.apply(backwards);
  std::reverse(backwards.begin(), backwards.end());
  // The ends differ because the filter's memory is longer than its padding.
  for (std::size_t k = 0; k < x.size(); ++k) ASSERT_NEAR(forwards[k], backwards[k], 1e-6) << k;
}

TEST(ZeroPhaseLowPass, ShortRecordingsArePossible) {
  const ZeroPhaseLowPass filter(1, kRate, 4);
  for (std::size_t n = 0; n < 6; ++n) {
    std::vector<double> x(n, 2.5);
    filter.apply(x);
    for (const double value : x) EXPECT_NEAR(value, 2.5, 1e-12);
  }
}

TEST(ZeroPhaseLowPass, CutoffsBeyondTheNyquistFrequencyAndOtherNonsenseAreErrors) {
  EXPECT_THROW(ZeroPhaseLowPass(50, 100, 2), Error);
  EXPECT_THROW(ZeroPhaseLowPass(0, 100, 2), Error);
  EXPECT_THROW(ZeroPhaseLowPass(std::nan(""), 100, 2), Error);
  EXPECT_THROW(ZeroPhaseLowPass(5, 100, 0), Error);
  EXPECT_THROW(ZeroPhaseLowPass(5, 100, 9), Error);
}

}  // namespace
}  // namespace cotwin::trajectory::filter_test
