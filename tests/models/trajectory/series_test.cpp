#include "models/trajectory/series/series.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

#include "models/foundation/support/error.h"
#include "models/trajectory/series/filter.h"
#include "models/trajectory/spline.h"

namespace cotwin::trajectory::series_test {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

/// Times that are irregular by a third of the step.
std::vector<double> irregular(std::size_t samples, double step, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> jitter(-step / 3, step / 3);
  std::vector<double> t(samples);
  for (std::size_t k = 0; k < samples; ++k) t[k] = static_cast<double>(k) * step + (k > 0 ? jitter(random) : 0);
  return t;
}

template <class Signal>
Series sample(std::vector<double> t, Signal signal) {
  Series series{std::move(t), 1, {}};
  for (const double instant : series.t) series.x.push_back(signal(instant));
  return series;
}

struct Values {
  double q, dq, ddq;
};
Values at(const Path& path, double t) {
  double q = 0, dq = 0, ddq = 0;
  path.at(t, std::span(&q, 1), std::span(&dq, 1), std::span(&ddq, 1));
  return {q, dq, ddq};
}

TEST(Series, InterpolationIsExactForPolynomialsUpToDegreeFiveOnIrregularInstants) {
  for (int degree = 0; degree <= 5; ++degree) {
    // Σ_k c_k tᵏ
    const double c[] = {0.3, -1, 0.5, 2, -1.5, 0.4};
    const auto polynomial = [&](double t, int derivative) {
      double sum = 0;
      for (int k = derivative; k <= degree; ++k) {
        double factor = c[k];
        for (int i = 0; i < derivative; ++i) factor *= k - i;
        sum += factor * std::pow(t, k - derivative);
      }
      return sum;
    };
    for (const std::size_t samples : {std::size_t{6}, std::size_t{7}, std::size_t{40}}) {
      const double step = 2.0 / static_cast<double>(samples);
      const Path path = interpolate(sample(irregular(samples, step, 5), [&](double t) { return polynomial(t, 0); }));
      for (double t = 0; t <= path.end(); t += 0.017) {
        const Values v = at(path, t);
        // Rounding of q (1e-15) over one and two steps.
        EXPECT_NEAR(v.q, polynomial(t, 0), 1e-13);
        EXPECT_NEAR(v.dq, polynomial(t, 1), 1e-12 / step);
        EXPECT_NEAR(v.ddq, polynomial(t, 2), 2e-11 / (step * step));
      }
    }
  }
}

TEST(Series, FewSamplesAreInterpolatedByThePolynomialThroughThem) {
  const Path line = interpolate({{0, 2}, 1, {1, 5}});
  EXPECT_NEAR(at(line, 0.5).q, 2, 1e-14);
  EXPECT_NEAR(at(line, 1.5).dq, 2, 1e-14);
  EXPECT_NEAR(at(line, 1.5).ddq, 0, 1e-14);
  const Path parabola = interpolate({{0, 1, 3}, 1, {0, 1, 9}});
  for (double t = 0; t <= 3; t += 0.1) {
    EXPECT_NEAR(at(parabola, t).q, t * t, 1e-13);
    EXPECT_NEAR(at(parabola, t).ddq, 2, 1e-12);
  }
}

TEST(Series, DerivativesConvergeWithTheFourthOrderOrBetter) {
  // sin(2π·0.5 t) over 6 s; halving the step must divide the error by 2⁴ at least, away from and at the ends.
  const double w = kTurn * 0.5;
  const auto errors = [&](double step) {
    std::vector<double> t(static_cast<std::size_t>(std::round(6 / step)) + 1);
    for (std::size_t k = 0; k < t.size(); ++k) t[k] = static_cast<double>(k) * step;
    const Path path = interpolate(sample(t, [&](double x) { return std::sin(w * x); }));
    Values worst{0, 0, 0};
    for (double x = 0; x <= 6; x += 0.00371) {
      const Values v = at(path, x);
      worst.q = std::max(worst.q, std::abs(v.q - std::sin(w * x)));
      worst.dq = std::max(worst.dq, std::abs(v.dq - w * std::cos(w * x)));
      worst.ddq = std::max(worst.ddq, std::abs(v.ddq + w * w * std::sin(w * x)));
    }
    return worst;
  };
  const Values coarse = errors(1 / 30.0), fine = errors(1 / 60.0);
  EXPECT_LT(coarse.q, 1e-7);
  EXPECT_LT(coarse.dq, 1e-4 * w);  // the ends have the largest errors; rates below are orders
  EXPECT_LT(coarse.ddq, 1e-3 * w * w);
  EXPECT_GT(std::log2(coarse.q / fine.q), 5.5);
  EXPECT_GT(std::log2(coarse.dq / fine.dq), 4.5);
  EXPECT_GT(std::log2(coarse.ddq / fine.ddq), 3.5);
}

TEST(Series, DifferentiationAddsNoPhase) {
  // The derivative of a sine on a regular grid is a cosine of some amplitude: its quadrature component is 0.
  const double step = 0.01, f = 12;  // eight samples a period
  std::vector<double> t(2001);
  for (std::size_t k = 0; k < t.size(); ++k) t[k] = static_cast<double>(k) * step;
  const Series sine = sample(t, [&](double x) { return std::sin(kTurn * f * x); });
  const std::vector<double> d = solve_spline(t, 1, sine.x, SplineEnds::kFree).dq;
  double in_phase = 0, quadrature = 0;
  for (std::size_t k = 500; k < 1500; ++k) {
    in_phase += d[k] * std::cos(kTurn * f * t[k]) / 500;
    quadrature += d[k] * std::sin(kTurn * f * t[k]) / 500;
  }
  EXPECT_NEAR(in_phase / (kTurn * f), 1, 1e-3);
  EXPECT_NEAR(quadrature, 0, 1e-9);
}

TEST(Series, PositionVelocityAndAccelerationBelongToOneAnotherEvenBetweenNoisySamples) {
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1e-3);
  const Path path = interpolate(sample(irregular(200, 0.03, 8), [&](double t) { return std::sin(t) + noise(random); }));
  // Simpson's rule over intervals that do not cross a knot: exact for q̇ up to degree three, otherwise h⁵ times its fourth
  // derivative.
  for (std::size_t k = 0; k + 1 < path.times().size(); ++k) {
    const double a = path.times()[k], b = path.times()[k + 1], h = (b - a) / 8;
    double dq = 0, ddq = 0;
    for (int i = 0; i < 8; ++i) {
      const Values x = at(path, a + i * h), y = at(path, a + (i + 0.5) * h), z = at(path, a + (i + 1) * h);
      dq += h / 6 * (x.dq + 4 * y.dq + z.dq);
      ddq += h / 6 * (x.ddq + 4 * y.ddq + z.ddq);
    }
    EXPECT_NEAR(dq, at(path, b).q - at(path, a).q, 1e-6);
    EXPECT_NEAR(ddq, at(path, b).dq - at(path, a).dq, 1e-9);
  }
}

TEST(Series, SmoothingAnIrregularRecordingActsAsTheFilterOnTheSignal) {
  // A slow and a fast sine, sampled irregularly at about 100 Hz. After the filter the slow one remains, the fast one is damped
  // by G(f).
  const double slow = 0.5, fast = 12;
  const Series raw =
      sample(irregular(2000, 0.01, 4), [&](double t) { return std::sin(kTurn * slow * t) + 0.1 * std::sin(kTurn * fast * t); });
  const Series smoothed = smooth(raw, 6, 2);
  EXPECT_NEAR(smoothed.t[1] - smoothed.t[0], median_step(raw.t), 1e-3 * 0.01);
  const double rate = 1 / (smoothed.t[1] - smoothed.t[0]);
  const auto gain = [&](double frequency) {  // filter.h: 1/(1 + (√2 − 1) r^(2N)), N = 2
    const double r = std::tan(0.5 * kTurn * frequency / rate) / std::tan(0.5 * kTurn * 6 / rate);
    return 1 / (1 + (std::numbers::sqrt2 - 1) * std::pow(r, 4));
  };
  for (std::size_t k = 300; k + 300 < smoothed.size(); ++k) {
    const double t = smoothed.t[k];
    const double expected = gain(slow) * std::sin(kTurn * slow * t) + 0.1 * gain(fast) * std::sin(kTurn * fast * t);
    // Resampling a sine of eight samples per period at irregular times is exact to some per mille of its 0.1.
    EXPECT_NEAR(smoothed.x[k], expected, 2e-3 * 0.1);
  }
}

TEST(Series, SmoothingBeforeDifferentiationRecoversTheDerivativesOfANoisyMotion) {
  std::mt19937 random(6);
  std::normal_distribution<double> noise(0, 2e-4);
  const double w = kTurn * 0.4;
  const Series raw = sample(irregular(3000, 0.008, 2), [&](double t) { return 0.7 * std::sin(w * t) + noise(random); });
  const Path path = interpolate(smooth(raw, 4, 2)), noisy = interpolate(raw);
  double error = 0, before = 0;
  int count = 0;
  for (double t = 1; t < 23; t += 0.0131, ++count) {
    error += std::pow(at(path, t).ddq + 0.7 * w * w * std::sin(w * t), 2);
    before += std::pow(at(noisy, t).ddq + 0.7 * w * w * std::sin(w * t), 2);
  }
  // White noise σ at the rate f_s, through G(f) of two passes and (2πf)²: ∫ ≈ σ² · 2/f_s ∫ (2πf)⁴ G² df, about 0.05 rad/s²
  // here.
  EXPECT_LT(std::sqrt(error / count), 0.1);
  EXPECT_GT(std::sqrt(before / count), 10);
}

TEST(Series, LinearInterpolationIsExactAtSamplesAndHeldOutside) {
  const Series series{{0, 1, 3}, 2, {0, 5, 2, 7, -2, 7}};
  std::vector<double> x(2);
  const auto at_time = [&](double t) {
    linear(series, t, x);
    return x;
  };
  EXPECT_EQ(at_time(-1), (std::vector<double>{0, 5}));
  EXPECT_EQ(at_time(1), (std::vector<double>{2, 7}));
  EXPECT_EQ(at_time(0.5), (std::vector<double>{1, 6}));
  EXPECT_EQ(at_time(2), (std::vector<double>{0, 7}));
  EXPECT_EQ(at_time(3), (std::vector<double>{-2, 7}));
  EXPECT_EQ(at_time(99), (std::vector<double>{-2, 7}));
}

TEST(Series, ACutPathIsThePathItself) {
  const Path whole = interpolate(sample(irregular(50, 0.1, 9), [](double t) { return std::cos(3 * t); }));
  const Path part = cut(whole, 0.77, 3.21);
  EXPECT_EQ(part.begin(), 0.77);
  EXPECT_EQ(part.end(), 3.21);
  for (double t = 0.77; t < 3.21; t += 0.0123) {
    EXPECT_NEAR(at(part, t).q, at(whole, t).q, 1e-14);
    EXPECT_NEAR(at(part, t).dq, at(whole, t).dq, 1e-12);
    EXPECT_NEAR(at(part, t).ddq, at(whole, t).ddq, 1e-10);
  }
  EXPECT_EQ(at(part, 0.5).dq, 0);
}

TEST(Series, ACutPathIsThePathItselfIfTheCutIsCloseToAKnot) {
  // As with a recording that was cut at 0.7 s, where the last time is 0.7000000000000002 s: over such a short segment, the
  // derivatives of a quintic would be rounding errors, divided by its length and its length squared.
  const std::vector<double> knots = irregular(50, 0.1, 9);
  const Path whole = interpolate(sample(knots, [](double t) { return std::cos(3 * t); }));
  for (const double sliver : {0.0, 4e-16, 1e-13, 1e-9, 1e-6, 1e-4, 1e-3}) {
    const double begin = knots[7] - sliver, end = knots[31] + sliver;
    const Path part = cut(whole, begin, end);
    for (int k = 0; k <= 200; ++k) {
      const double t = k < 200 ? begin + (end - begin) * k / 200 : end;
      for (const double x : {t, std::min(t + 0.5 * sliver, end)}) {
        EXPECT_NEAR(at(part, x).q, at(whole, x).q, 1e-12) << sliver << " " << x;
        EXPECT_NEAR(at(part, x).dq, at(whole, x).dq, 1e-9) << sliver << " " << x;
        EXPECT_NEAR(at(part, x).ddq, at(whole, x).ddq, 1e-6) << sliver << " " << x;
      }
    }
    EXPECT_LT(part.range(0, 2).largest().value, 9.1) << sliver;  // 9 cos 3t: limits are compared with it
  }
}

}  // namespace
}  // namespace cotwin::trajectory::series_test
