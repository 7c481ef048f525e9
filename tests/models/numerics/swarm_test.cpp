#include "models/numerics/swarm.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/numerics/kernels/kernels.h"
#include "models/numerics/random.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::numerics::swarm_test {
namespace {

using cotwin::testing::error_of;
using F = double (*)(const std::vector<double>&);

Swarm::Cost cost_of(F f, std::size_t dimensions) {
  return [=](std::size_t, std::size_t count, const double* x, std::size_t stride, double* cost) {
    thread_local std::vector<double> point;
    point.resize(dimensions);
    for (std::size_t k = 0; k < count; ++k) {
      for (std::size_t i = 0; i < dimensions; ++i) point[i] = x[i * stride + k];
      cost[k] = f(point);
    }
  };
}

double sphere(const std::vector<double>& x) {
  double f = 0;
  for (std::size_t i = 0; i < x.size(); ++i) f += (x[i] - 0.7) * (x[i] - 0.7);
  return f;
}
double rosenbrock(const std::vector<double>& x) {
  double f = 0;
  for (std::size_t i = 0; i + 1 < x.size(); ++i) f += 100 * std::pow(x[i + 1] - x[i] * x[i], 2) + std::pow(1 - x[i], 2);
  return f;
}
double rastrigin(const std::vector<double>& x) {
  double f = 0;
  for (const double v : x) f += 10 + v * v - 10 * std::cos(2 * std::numbers::pi * v);
  return f;
}
/// Its minimum in the box of the test is on a face.
double slope(const std::vector<double>& x) { return x[0] + 10 * (x[1] - 0.25) * (x[1] - 0.25) + 1; }

std::vector<double> all(std::size_t n, double x) { return std::vector<double>(n, x); }

TEST(Swarm, FindsTheMinimumOfASphereToRounding) {
  SwarmOptions options;
  options.particles = 50;
  options.rounds = 600;
  options.threshold = 1e-24;
  Swarm swarm(all(10, -5), all(10, 5), cost_of(sphere, 10), options);
  EXPECT_EQ(swarm.run(), SwarmStatus::kThreshold);
  EXPECT_LE(swarm.best_cost(), 1e-24);
  std::vector<double> x(10);
  swarm.best(x);
  for (const double v : x) EXPECT_NEAR(v, 0.7, 1e-10);
}

TEST(Swarm, FollowsTheCurvedValleyOfRosenbrock) {
  SwarmOptions options;
  options.rounds = 3000;
  options.threshold = 1e-5;
  options.stagnation_rounds = 0;
  Swarm swarm(all(5, -3), all(5, 3), cost_of(rosenbrock, 5), options);
  EXPECT_EQ(swarm.run(), SwarmStatus::kThreshold);  // the minimum is 0, at (1, …, 1)
  EXPECT_LE(swarm.best_cost(), 1e-5);
  EXPECT_LT(swarm.state().round, 3000u);
}

// Rastrigin's function in six dimensions has 11⁶ local minima in the box; a swarm that has converged to one of them leaves it
// only by reconfiguration.
TEST(Swarm, ThatStagnatesLeavesALocalMinimumOnceItIsReconfigured) {
  int better = 0, worse = 0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SwarmOptions options;
    options.particles = 24;
    options.seed = seed;
    Swarm restarted(all(6, -5), all(6, 5), cost_of(rastrigin, 6), options);
    options.stagnation_rounds = 0;
    Swarm plain(all(6, -5), all(6, 5), cost_of(rastrigin, 6), options);
    restarted.run();
    plain.run();
    EXPECT_GT(restarted.state().reconfigurations, 0u);
    EXPECT_EQ(plain.state().reconfigurations, 0u);
    better += restarted.best_cost() < plain.best_cost() - 1e-6;
    worse += restarted.best_cost() > plain.best_cost() + 1e-6;
  }
  EXPECT_GE(better, worse + 4) << better << " seeds better, " << worse << " worse";
}

TEST(Swarm, NeverForgetsItsBestAndStaysInTheBox) {
  SwarmOptions options;
  options.particles = 16;
  options.rounds = 300;
  Swarm swarm(all(4, -2), all(4, 5), cost_of(rastrigin, 4), options);
  double before = std::numeric_limits<double>::infinity();
  while (swarm.round() == SwarmStatus::kRunning) {
    ASSERT_LE(swarm.best_cost(), before);
    before = swarm.best_cost();
    for (const double x : swarm.state().x) ASSERT_TRUE(-2 <= x && x <= 5) << x;
  }
  EXPECT_GT(swarm.state().reconfigurations, 0u);
  ASSERT_EQ(swarm.state().history.size(), 300u);
  EXPECT_EQ(swarm.state().history.back(), swarm.best_cost());
}

TEST(Swarm, FindsAMinimumOnTheBoxsFace) {
  Swarm swarm({-1, -1}, {1, 1}, cost_of(slope, 2));
  swarm.run();
  std::vector<double> x(2);
  swarm.best(x);
  EXPECT_EQ(x[0], -1);
  EXPECT_NEAR(x[1], 0.25, 1e-8);
}

TEST(Swarm, BeginsWithAParticleAtTheStart) {
  SwarmOptions options;
  options.rounds = 1;
  const std::vector<double> start{0.5, -0.25, 1};
  Swarm swarm(all(3, -2), all(3, 2), start, all(3, 0.01), cost_of(sphere, 3), options);
  swarm.run();
  const SwarmState& s = swarm.state();
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(s.x[i * s.particles], start[i]);
  double variance = 0;
  for (std::size_t k = 1; k < s.particles; ++k) variance += std::pow(s.x[k] - 0.5, 2) / static_cast<double>(s.particles - 1);
  EXPECT_NEAR(std::sqrt(variance), 0.01, 0.0025);  // five standard errors of 199 samples
}

// (3) of Kennedy and Eberhart with r1, r2 from random.h, implemented independently: what the kernels compute in lanes.
TEST(Swarm, MovesByThePublishedRule) {
  SwarmOptions options;
  options.particles = 16;
  options.seed = 0x123456789abcdef0;
  options.neighbours = 2;
  Swarm swarm(all(3, -5), all(3, 5), cost_of(rosenbrock, 3), options);
  for (int i = 0; i < 3; ++i) swarm.round();
  const SwarmState before = swarm.state();
  swarm.round();
  const SwarmState& after = swarm.state();
  for (std::size_t k = 0; k < 16; ++k) {
    std::size_t informant = k;
    for (const std::size_t other : {(k + 14) % 16, (k + 15) % 16, (k + 1) % 16, (k + 2) % 16})
      if (before.best_cost[other] < before.best_cost[informant]) informant = other;
    for (std::size_t i = 0; i < 3; ++i) {
      const std::size_t at = i * 16 + k;
      const auto word = philox({static_cast<std::uint32_t>(i), static_cast<std::uint32_t>(k), before.round, kMoves},
                               {0x9abcdef0u, 0x12345678u});
      const auto unit = [&](int w) {
        return static_cast<double>((std::uint64_t{word[static_cast<std::size_t>(w)]} << 20) |
                                   (word[static_cast<std::size_t>(w) + 1] >> 12)) *
               0x1p-52;
      };
      double v = options.inertia * before.v[at] + options.cognitive * unit(0) * (before.best_x[at] - before.x[at]) +
                 options.social * unit(2) * (before.best_x[i * 16 + informant] - before.x[at]);
      double x = before.x[at] + v;
      if (x < -5 || x > 5) {
        v *= -0.5;
        x = x < -5 ? -5 : 5;
      }
      EXPECT_NEAR(after.v[at], v, 1e-13);
      EXPECT_NEAR(after.x[at], x, 1e-13);
    }
  }
}

TEST(Swarm, GivesTheSameBitsOnAnyNumberOfThreads) {
  const auto result = [](int count) {
    SwarmOptions options;
    options.rounds = 200;
    options.particles = 40;
    options.stagnation_rounds = 20;
    Threads threads(count);
    Swarm swarm(all(6, -5), all(6, 5), cost_of(rastrigin, 6), options);
    swarm.run(&threads);
    return swarm.state();
  };
  const SwarmState one = result(1);
  EXPECT_GT(one.reconfigurations, 0u);
  EXPECT_EQ(result(2), one);
  EXPECT_EQ(result(8), one);
}

TEST(Swarm, GivesTheSameBitsWhereARoundIsLookedAtTogether) {
  const Swarm::Cost cost = cost_of(rastrigin, 6);
  SwarmOptions options;
  options.rounds = 200;
  options.particles = 40;
  options.stagnation_rounds = 20;
  Swarm apart(all(6, -5), all(6, 5), cost, options);
  apart.run();
  std::vector<double> costs(40);
  std::atomic<int> prepared = 0;
  int rounds = 0;
  Threads threads(2);
  Swarm swarm(
      all(6, -5), all(6, 5),
      [&](std::size_t block, std::size_t count, const double*, std::size_t, double* result) {
        std::copy_n(costs.data() + block * kSwarmBlock, count, result);
      },
      options);
  swarm.set_together(
      [&](std::size_t block, const double* x, std::size_t stride) {
        cost(block, kSwarmBlock, x, stride, costs.data() + block * kSwarmBlock);
        ++prepared;
      },
      [&] { EXPECT_EQ(prepared, 5 * ++rounds); });
  swarm.run(&threads);
  EXPECT_EQ(rounds, 200);
  EXPECT_EQ(swarm.state(), apart.state());
}

TEST(Swarm, GoesOnFromASavedStateToTheSameBits) {
  SwarmOptions options;
  options.rounds = 200;
  options.particles = 40;
  options.stagnation_rounds = 20;
  Swarm whole(all(6, -5), all(6, 5), cost_of(rastrigin, 6), options);
  whole.run();
  for (const std::uint32_t stop : {1u, 37u, 90u}) {
    Swarm first(all(6, -5), all(6, 5), cost_of(rastrigin, 6), options);
    while (first.state().round < stop) first.round();
    const SwarmState read = SwarmState::from_bytes(first.state().bytes());
    ASSERT_EQ(read, first.state());
    Swarm second(read, cost_of(rastrigin, 6), options);
    second.run();
    EXPECT_EQ(second.state(), whole.state()) << "stopped after round " << stop;
  }
}

TEST(Swarm, DiffersBySeed) {
  SwarmOptions options;
  options.rounds = 2;
  Swarm a(all(2, -1), all(2, 1), cost_of(sphere, 2), options);
  options.seed = 2;
  Swarm b(all(2, -1), all(2, 1), cost_of(sphere, 2), options);
  a.run();
  b.run();
  EXPECT_NE(a.state().x, b.state().x);
}

TEST(Swarm, ARoundAllocatesNothing) {
  SwarmOptions options;
  options.rounds = 300;
  options.particles = 16;
  Swarm swarm(all(4, -5), all(4, 5), cost_of(rastrigin, 4), options);
  swarm.round();
  const auto before = testing::allocations();
  swarm.run();
  EXPECT_EQ(testing::allocations(), before);
  EXPECT_GT(swarm.state().reconfigurations, 0u);
}

TEST(Swarm, TreatsACostOfNaNAsTheWorst) {
  SwarmOptions options;
  options.rounds = 100;
  Swarm swarm(
      {-1}, {1},
      [](std::size_t, std::size_t count, const double* x, std::size_t, double* cost) {
        for (std::size_t k = 0; k < count; ++k) cost[k] = x[k] < 0 ? std::numeric_limits<double>::quiet_NaN() : 1 + x[k];
      },
      options);
  swarm.run();
  EXPECT_NEAR(swarm.best_cost(), 1, 1e-6);
}

// A rotation keeps distances, so the costs of a sphere in new coordinates must continue at the same values.
TEST(Swarm, KeepsItsPlaceWhenCoordinatesChange) {
  SwarmOptions options;
  options.rounds = 60;
  Swarm swarm(all(2, -5), all(2, 5), cost_of(sphere, 2), options);
  for (int i = 0; i < 10; ++i) swarm.round();
  const double before = swarm.best_cost();
  std::vector<double> old(2), now(2);
  swarm.best(old);
  const double c = std::cos(0.3), s = std::sin(0.3);
  swarm.change_coordinates(std::vector<double>{c, s, -s, c}, std::vector<double>{0.7, 0.7}, all(2, -8), all(2, 8), all(2, 0.1));
  swarm.best(now);
  EXPECT_NEAR(now[0] * now[0] + now[1] * now[1], before, 1e-12);
  EXPECT_NEAR(c * now[0] - s * now[1] + 0.7, old[0], 1e-12);
  EXPECT_NEAR(s * now[0] + c * now[1] + 0.7, old[1], 1e-12);
}

TEST(Swarm, RefusesInvalidProblemsWithAReason) {
  const auto cost = cost_of(sphere, 2);
  EXPECT_EQ(error_of([&] { Swarm(std::vector<double>{}, {}, cost); }),
            "swarm: 0 lower and 0 upper bounds, expected as many of both, at least 1");
  EXPECT_EQ(error_of([&] {
              Swarm({0, 1}, {1, 0.5}, cost);
            }),
            "swarm: bounds 1 and 0.5 of coordinate 2, expected finite ones in ascending order");
  EXPECT_EQ(error_of([&] {
              Swarm({0, 0}, {1, 1}, {0.5, 2}, {0.1, 0.1}, cost);
            }),
            "swarm: coordinate 2 starts at 2, expected within 0 to 1");
  SwarmOptions options;
  options.particles = 0;
  EXPECT_EQ(error_of([&] { Swarm({0, 0}, {1, 1}, cost, options); }), "swarm: 0 particles, expected at least 1");
}

TEST(Swarm, RefusesAnInconsistentState) {
  SwarmOptions options;
  options.rounds = 5;
  Swarm swarm(all(2, -1), all(2, 1), cost_of(sphere, 2), options);
  swarm.run();
  const auto go_on = [&](const std::function<void(SwarmState&)>& spoil) {
    SwarmState state = swarm.state();
    spoil(state);
    return error_of([&] { Swarm(state, cost_of(sphere, 2), options); });
  };
  EXPECT_EQ(go_on([](SwarmState&) {}), "");
  const std::string sizes = "swarm: the sizes of its state do not belong together";
  EXPECT_EQ(go_on([](SwarmState& s) { s.leader = s.particles; }), sizes);
  EXPECT_EQ(go_on([](SwarmState& s) { s.last_reconfiguration = 0xffffffff; }), sizes);
  EXPECT_EQ(go_on([](SwarmState& s) { s.history.pop_back(); }), sizes);
  EXPECT_EQ(go_on([](SwarmState& s) { s.best_x.pop_back(); }), sizes);
  EXPECT_EQ(go_on([](SwarmState& s) { s.best_cost[3] = std::numeric_limits<double>::quiet_NaN(); }),
            "swarm: a personal best in its state costs NaN, expected a number");
}

TEST(SwarmState, RefusesInvalidBytes) {
  SwarmOptions options;
  options.rounds = 3;
  Swarm swarm(all(2, -1), all(2, 1), cost_of(sphere, 2), options);
  swarm.run();
  const std::string good = swarm.state().bytes();
  for (std::size_t length = 0; length < good.size(); length += 13)  // every truncation is detected
    EXPECT_THROW(SwarmState::from_bytes(good.substr(0, length)), Error) << length;
  std::string longer = good;
  longer.push_back(0);
  EXPECT_THROW(SwarmState::from_bytes(longer), Error);
  std::string other = good;
  other[0] ^= 1;
  EXPECT_THROW(SwarmState::from_bytes(other), Error);
  std::string huge = good;  // a count that would overflow
  for (std::size_t i = 64; i < 72; ++i) huge[i] = static_cast<char>(0xff);
  EXPECT_THROW(SwarmState::from_bytes(huge), Error);
}

TEST(Threads, DoEveryBlockOnceAndPassOnTheFirstFailure) {
  for (const int count : {1, 2, 5}) {
    Threads threads(count);
    EXPECT_EQ(threads.threads(), count);
    std::vector<std::atomic<int>> done(1000);
    for (int pass = 0; pass < 20; ++pass) threads.run(1000, [&](std::size_t block) { ++done[block]; });
    for (const auto& d : done) ASSERT_EQ(d, 20);
    const std::string what = error_of([&] {
      threads.run(100, [](std::size_t block) {
        if (block >= 7) throw Error("block " + std::to_string(block));
      });
    });
    EXPECT_EQ(what, "block 7");
  }
}

}  // namespace
}  // namespace cotwin::numerics::swarm_test
