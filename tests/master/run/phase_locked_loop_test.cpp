#include "master/clock/phase_locked_loop.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <random>

#include "master/clock/histogram.h"
#include "tests/master/run/simulated_source.h"

namespace cotwin::master::phase_locked_loop_test {
namespace {

using testing::gaussian;
using testing::kMs;
using testing::kUs;

TEST(PhaseLockedLoop, WrapsIntoHalfACycle) {
  for (const std::int64_t cycle : {1, 2, 5, 1000, 1'000'001}) {
    for (std::int64_t x = -3 * cycle; x <= 3 * cycle; x += std::max<std::int64_t>(1, cycle / 7)) {
      const std::int64_t w = wrap(x, cycle);
      EXPECT_LE(2 * w, cycle) << x << " mod " << cycle;
      EXPECT_GT(2 * w, -cycle) << x << " mod " << cycle;
      EXPECT_EQ((x - w) % cycle, 0) << x << " mod " << cycle;
      EXPECT_EQ(wrap(static_cast<double>(x), static_cast<double>(cycle)), static_cast<double>(w)) << x << " mod " << cycle;
    }
  }
}

/// A source whose clock runs as c(t) = (1 + rate) t + begin, measured with jitter once per cycle.
struct Plant {
  PhaseLockedLoop loop;
  std::int64_t cycle;
  double rate, sigma;                            // 1, ns
  std::int64_t begin = 793'123'456'789'012'345;  // ns since 2000
  std::int64_t step = 0;                         // of the source's clock
  std::mt19937_64 random{7};
  std::int64_t host = 123'456'789;
  double sum = 0, squares = 0, worst = 0;
  int count = 0;

  Plant(PhaseLockedLoop::Settings s, double rate_of, double sigma_of)
      : loop(s), cycle(s.cycle), rate(rate_of), sigma(sigma_of) {
    loop.start(host);
  }
  std::int64_t source(std::int64_t t) const {
    return begin + step + t + static_cast<std::int64_t>(std::llround(rate * static_cast<double>(t)));
  }
  /// The true time by which the present instant is late.
  double error() const { return static_cast<double>(wrap(source(loop.instant()) % cycle, cycle)); }
  /// `n` cycles, of which `lost(i)` have no measurement.
  void run(
      int n, const std::function<bool(int)>& lost = [](int) { return false; }) {
    sum = squares = worst = 0;
    count = 0;
    for (int i = 0; i < n; ++i) {
      const std::int64_t read = loop.instant() + 300 * kUs;  // the source's clock is read here; the stamp of it has jitter
      if (!lost(i)) loop.measure({read + std::llround(sigma * gaussian(random)), source(read)});
      loop.advance(cycle);
      const double e = error();
      sum += e;
      squares += e * e;
      worst = std::max(worst, std::abs(e));
      ++count;
    }
  }
  double rms() const { return std::sqrt(squares / count); }
};

TEST(PhaseLockedLoop, ConvergesForBothSignsOfTheDriftAndForJitter) {
  for (const std::int64_t cycle : {kMs, 250 * kUs, 5 * kMs}) {
    for (const double ppm : {-100., 100., 0.}) {
      for (const double sigma : {0., 50e3}) {
        if (sigma > 0 && cycle < kMs) continue;  // jitter of a fifth of a cycle: outliers
        Plant p({.cycle = cycle}, 1e-6 * ppm, sigma);
        p.run(static_cast<int>(4'000 * kMs / cycle));
        EXPECT_TRUE(p.loop.locked()) << ppm << " ppm, cycle " << cycle << " ns, jitter " << sigma << " ns";
        p.run(static_cast<int>(10'000 * kMs / cycle));
        EXPECT_TRUE(p.loop.locked());
        // White jitter moves the instants by σ √(1.25 ωT); 30 % for the finite sample. Without jitter nanoseconds are left.
        const double expected = sigma * std::sqrt(1.25 * 2 * M_PI * 1e-9 * static_cast<double>(cycle));
        EXPECT_LE(p.rms(), 1.3 * expected + 1.5) << ppm << " ppm, cycle " << cycle;
        EXPECT_GE(p.rms(), 0.7 * expected) << ppm << " ppm, cycle " << cycle;
        // host time per source time is 1/(1 + rate)
        // and moves by σ √(T ω³) / 2
        const double moved = 0.5 * 1e-9 * sigma * std::sqrt(1e-9 * static_cast<double>(cycle) * std::pow(2 * M_PI, 3));
        EXPECT_NEAR(p.loop.drift(), 1 / (1 + 1e-6 * ppm) - 1, 4 * moved + 2e-9) << ppm << " ppm, cycle " << cycle;
        EXPECT_EQ(p.loop.steps(), 0);
      }
    }
  }
}

TEST(PhaseLockedLoop, AnErrorOfTheDriftDecaysWithThePoles) {
  // e(t) = δ t exp(−ωt) from f wrong by δ and e = 0, here without the averages of the beginning: 3 s in lock, then the drift changes.
  Plant p({.cycle = kMs, .bandwidth = 0.5}, 0, 0);
  p.run(3000);
  p.rate = 40e-6;
  p.begin -= std::llround(40e-6 * static_cast<double>(p.loop.instant()));
  const double omega = 2 * M_PI * 0.5;
  for (int n = 0; n < 2000; n += 100) {
    const double t = 1e-3 * n;
    EXPECT_NEAR(p.error(), 1e9 * 40e-6 * t * std::exp(-omega * t), 60)
        << t << " s";  // T/2 of the sampled loop: 40e-6 · 0.5 ms, ωT
    p.run(100);
  }
}

TEST(PhaseLockedLoop, KeepsTheShift) {
  for (const std::int64_t shift : {300 * kUs, -200 * kUs, 7300 * kUs}) {
    Plant p({.cycle = kMs, .shift = shift}, 30e-6, 0);
    p.run(5000);
    EXPECT_NEAR(p.error(), static_cast<double>(wrap(shift, kMs)), 2) << shift;
  }
}

TEST(PhaseLockedLoop, HoldsOverWhileMeasurementsAreLost) {
  Plant p({.cycle = kMs}, 100e-6, 0);
  p.run(5000);
  const double drift = p.loop.drift();
  p.run(10'000, [](int) { return true; });  // 10 s without a measurement
  EXPECT_EQ(p.loop.drift(), drift);
  EXPECT_LE(p.worst, 1e10 * 2e-9 + 2);  // the error of the drift, for 10 s
  // Half of all measurements lost at random: as good as all.
  Plant q({.cycle = kMs}, -100e-6, 50e3);
  std::mt19937_64 random(3);
  q.run(4000, [&](int) { return random() % 2 == 0; });
  q.run(10'000, [&](int) { return random() % 2 == 0; });
  EXPECT_TRUE(q.loop.locked());
  EXPECT_LE(q.rms(), 2 * 50e3 * std::sqrt(1.25 * 2 * M_PI * 1e-3));
}

TEST(PhaseLockedLoop, FollowsAStepOfTheSourceAtOnceAndIgnoresSingleOutliers) {
  for (const std::int64_t step : {5 * kMs + 400 * kUs, -5 * kMs - 300 * kUs, 5 * kMs}) {
    Plant p({.cycle = kMs}, 50e-6, 5e3);
    p.run(5000);
    ASSERT_TRUE(p.loop.locked());
    p.step = step;
    p.run(20);
    const bool visible = step % kMs != 0;  // a step by whole cycles does not change the phase
    EXPECT_EQ(p.loop.steps(), visible ? 1 : 0) << step;
    EXPECT_EQ(p.loop.locked(), !visible) << step;
    EXPECT_LE(std::abs(p.error()), 20e3) << step;
    EXPECT_NEAR(p.loop.drift(), -50e-6, 2e-6) << step;  // kept
    p.run(500);
    EXPECT_TRUE(p.loop.locked()) << step;
  }
  // Packets that come 2.5 cycles late, one in ten: they are left out.
  Plant p({.cycle = kMs}, 0, 0);
  p.run(1000);
  for (int i = 0; i < 1000; ++i) {
    if (i % 10 == 0) {
      EXPECT_EQ(p.loop.measure({p.loop.instant() + 2500 * kUs, p.source(p.loop.instant())}), PhaseLockedLoop::Use::kOutlier);
    }
    p.run(1);
    ASSERT_LE(std::abs(p.error()), 2) << i;
  }
  EXPECT_EQ(p.loop.steps(), 0);
}

TEST(PhaseLockedLoop, StaysBoundedForArbitraryTimes) {
  PhaseLockedLoop loop({.cycle = kMs});
  loop.start(0);
  std::mt19937_64 random(11);
  for (int i = 0; i < 100'000; ++i) {
    loop.measure({static_cast<std::int64_t>(random()), static_cast<std::int64_t>(random())});
    const std::int64_t before = loop.instant();
    loop.advance(kMs);
    ASSERT_NEAR(static_cast<double>(loop.instant() - before), 1e6, 1001) << i;
    ASSERT_TRUE(std::isfinite(loop.jitter()) && std::abs(loop.drift()) <= 1e-3) << i;
  }
}

TEST(Histogram, PutsEachDurationIntoTheBinOfItsEdges) {
  for (std::int64_t ns :
       {std::int64_t{0}, std::int64_t{1023}, std::int64_t{1024}, 50 * kUs, 999 * kMs, 5000 * kMs, INT64_MAX}) {
    const std::size_t bin = Histogram::bin_of(ns);
    ASSERT_LT(bin, Histogram::kBins);
    EXPECT_TRUE(ns < Histogram::edge(bin) || bin + 1 == Histogram::kBins) << ns;
    EXPECT_TRUE(bin == 0 || ns >= Histogram::edge(bin - 1)) << ns;
  }
  for (std::size_t bin = 1; bin < Histogram::kBins; ++bin) EXPECT_GT(Histogram::edge(bin), Histogram::edge(bin - 1));
  Histogram h;
  for (int i = 1; i <= 10'000; ++i) h.add(i * 10);  // 10 ns to 100 us, uniform
  EXPECT_EQ(h.count(), 10'000);
  EXPECT_EQ(h.max(), 100'000);
  EXPECT_DOUBLE_EQ(h.mean(), 50'005);
  for (const double p : {0.1, 0.5, 0.9, 0.99}) {  // a bin is at most 25 % wide
    EXPECT_GE(h.quantile(p), static_cast<std::int64_t>(1e5 * p));
    EXPECT_LE(h.quantile(p), static_cast<std::int64_t>(1.25 * 1e5 * p));
  }
  EXPECT_EQ(h.quantile(1), 100'000);
}

}  // namespace
}  // namespace cotwin::master::phase_locked_loop_test
