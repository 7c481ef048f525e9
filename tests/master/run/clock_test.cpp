// Clocks of the loop against simulated time: nothing here depends on the speed of the machine.
#include "master/clock/clock.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <cmath>
#include <random>

#include "master/run/master.h"
#include "models/foundation/support/choice.h"
#include "tests/master/run/clocked_units.h"
#include "tests/support/allocations.h"

namespace cotwin::master::clock_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::ClockedRun;
using ::cotwin::testing::error_of;
using ::cotwin::testing::gaussian;
using ::cotwin::testing::kMs;
using ::cotwin::testing::kUs;
using ::cotwin::testing::value;
using ::cotwin::testing::World;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

const char* text_of(ClockKind kind) { return text::word_of(kind, kClockWords); }

using Step = World::Step;

TEST_F(ClockedRun, CatchUpRunsLateTicksAtOnce) {
  build_.until(0.009);
  world_.work[3 * kMs] = 3400 * kUs;
  const Summary s = run();
  EXPECT_THAT(world_.steps,
              ElementsAre(Step{0, kMs, 0}, Step{kMs, kMs, kMs}, Step{2 * kMs, kMs, 2 * kMs}, Step{3 * kMs, kMs, 3 * kMs},
                          Step{4 * kMs, kMs, 6400 * kUs}, Step{5 * kMs, kMs, 6400 * kUs}, Step{6 * kMs, kMs, 6400 * kUs},
                          Step{7 * kMs, kMs, 7 * kMs}, Step{8 * kMs, kMs, 8 * kMs}));
  EXPECT_EQ(s.overruns, 3);  // 2.4, 1.4 and 0.4 ms late; more than 0.2 ms counts
  EXPECT_DOUBLE_EQ(s.worst_delay, 2.4e-3);
  EXPECT_EQ(s.clock.state.skipped, 0);
  EXPECT_EQ(s.clock.start_delays.count(), 9);
  EXPECT_EQ(s.clock.run_times.max(), 3400 * kUs);
}

TEST_F(ClockedRun, SkipLeavesOutWholeTicksInOneLongerStep) {
  build_.unit("p", "probe", 0, 2).until(0.010);
  clock().overrun = OverrunPolicy::kSkip;
  world_.work[3 * kMs] = 3400 * kUs;
  Master master = load();
  const Summary s = run(master);
  // Tick 4 begins 2.4 ms late: ticks 5 and 6 are in its step, and tick 7 is on time again.
  EXPECT_THAT(world_.steps, ElementsAre(Step{0, kMs, 0}, Step{kMs, kMs, kMs}, Step{2 * kMs, kMs, 2 * kMs},
                                        Step{3 * kMs, kMs, 3 * kMs}, Step{4 * kMs, 3 * kMs, 6400 * kUs},
                                        Step{7 * kMs, kMs, 7 * kMs}, Step{8 * kMs, kMs, 8 * kMs}, Step{9 * kMs, kMs, 9 * kMs}));
  EXPECT_EQ(s.overruns, 1);
  EXPECT_EQ(s.clock.state.skipped, 2);
  EXPECT_EQ(s.ticks, 10);
  EXPECT_EQ(value(master, "p.steps"), 5);  // to 2, 4, 7 (with the longer step), 8 and 10 ms
  EXPECT_DOUBLE_EQ(value(master, "p.t"), 0.010);
}

TEST_F(ClockedRun, SkipEndsALongerStepBeforeAnEventAndKeepsTheLastTick) {
  build_.unit("i", "integrator").event(0.0055, "i.u", "1").until(0.010);
  clock().overrun = OverrunPolicy::kSkip;
  world_.work[3 * kMs] = 4400 * kUs;
  world_.work[8 * kMs] = 50 * kMs;
  Master master = load();
  const Summary s = run(master);
  // The event acts from tick 6 on: 4 ms in u = 1, as in time.
  EXPECT_DOUBLE_EQ(value(master, "i.y"), 0.004);
  EXPECT_THAT(world_.steps, ::testing::Contains(Step{4 * kMs, 2 * kMs, 7400 * kUs}));
  EXPECT_THAT(world_.steps, ::testing::Contains(Step{6 * kMs, 2 * kMs, 7400 * kUs}));
  EXPECT_EQ(world_.steps.back(), (Step{9 * kMs, kMs, 58 * kMs}));  // 49 ticks late, but there are none left
  EXPECT_EQ(s.clock.state.skipped, 2);
}

TEST_F(ClockedRun, SkipCutsALongerStepThatAUnitDiscardsAndReplaysLaterOnes) {
  // ẋ = −50 x by explicit Euler: 4 steps of 1 ms, one of 3 ms in 4 parts, then discards at 1 ms from the 9th tick on.
  build_.unit("p", "picky").with("longest", 1.2e-3).until(0.012);
  clock().overrun = OverrunPolicy::kSkip;
  world_.work[3 * kMs] = 3400 * kUs;
  Master master = load();
  const Summary s = run(master);
  EXPECT_DOUBLE_EQ(value(master, "p.y"), std::pow(1 - 0.05, 4) * std::pow(1 - 50 * 0.75e-3, 4) * std::pow(1 - 0.05, 5));
  EXPECT_EQ(s.most_parts, 4);

  Build plain;
  World other;
  plain.unit("busy", "busy")
      .unit("io", "connected")
      .unit("p", "picky")
      .with("longest", 0.7e-3)
      .with("from", 0.0085)
      .until(0.012);
  plain.scenario.clock = clock();
  other.work[3 * kMs] = 3400 * kUs;
  Master again = load(other, plain);
  run(again);  // the replay of the ticks before must not repeat those that were left out
  EXPECT_DOUBLE_EQ(value(again, "p.y"), std::pow(1 - 0.05, 4) * (1 - 0.15) * std::pow(1 - 0.05, 2) * std::pow(1 - 0.025, 6));
}

TEST_F(ClockedRun, StopEndsTheRunAtTheFirstLateTick) {
  clock().overrun = OverrunPolicy::kStop;
  world_.work[3 * kMs] = 1150 * kUs;  // 0.15 ms late: tolerated
  world_.work[6 * kMs] = 3400 * kUs;
  Master master = load();
  EXPECT_EQ(error_of([&] { run(master); }),
            "test.ssd:5: tick 7 at t = 0.007 s began 2.4 ms late, more than 0.2 ms (overrun=stop)");
  EXPECT_EQ(master.tick(), 7);
  EXPECT_EQ(world_.steps.size(), 7u);
}

TEST_F(ClockedRun, ASignalWhileTheClockWaitsReturnsWithoutATick) {
  for (const ClockKind kind : {ClockKind::kWall, ClockKind::kArrivals, ClockKind::kLocked}) {
    world_.steps.clear();
    clock().kind = kind;
    Master master = load(world_, build_);
    world_.begin = world_.host.now();
    send(20);
    master.initialise();
    while (master.tick() < 3) ASSERT_TRUE(master.step_tick());
    world_.host.interrupt_next();
    EXPECT_TRUE(master.step_tick());
    EXPECT_EQ(master.tick(), 3) << text_of(kind);  // the caller checks for signals now
    EXPECT_TRUE(master.step_tick());
    EXPECT_EQ(master.tick(), 4) << text_of(kind);
  }
}

TEST_F(ClockedRun, ALongWaitComesBackNowAndThenForSignalsThatCameBeforeIt) {
  build_.scenario.tick = Duration{1000 * kMs};
  build_.until(3);
  Master master = load();
  master.initialise();
  EXPECT_TRUE(master.step_tick());
  for (int i = 0; i < 9; ++i) {
    EXPECT_TRUE(master.step_tick());
    EXPECT_EQ(master.tick(), 1) << i;
  }
  EXPECT_TRUE(master.step_tick());
  EXPECT_EQ(master.tick(), 2);
}

TEST_F(ClockedRun, ArrivalsBeginTicksWhenTheirPacketsCome) {
  std::mt19937_64 random(5);
  std::vector<std::int64_t> delays;
  for (int i = 0; i < 2000; ++i) delays.push_back(static_cast<std::int64_t>(random() % (100 * kUs)));
  for (const bool with_time : {true, false}) {
    for (const double rate : {100e-6, -100e-6}) {
      World fresh;
      Build b;
      b.unit("busy", "busy").unit("io", "connected").until(2);
      b.scenario.clock = {.kind = ClockKind::kArrivals};
      for (int i = 0; i < 2000; ++i)
        fresh.source.send(fresh.begin + std::llround((i + 1) * 1e6 / (1 + rate)) + delays[static_cast<std::size_t>(i)],
                          with_time ? kEpoch + i * kMs : 0);
      Master master = load(fresh, b);
      const Summary s = run(master);
      ASSERT_EQ(fresh.steps.size(), 2000u);
      for (std::size_t i = 0; i < 2000; ++i)
        ASSERT_EQ(fresh.steps[i].host, std::llround((static_cast<double>(i) + 1) * 1e6 / (1 + rate)) + delays[i]) << i;
      EXPECT_TRUE(s.clock.state.locked);
      EXPECT_EQ(s.overruns, 0);
      EXPECT_EQ(s.clock.state.missed, 0);
      EXPECT_NEAR(s.clock.state.jitter, 100e-6 / std::sqrt(12.), 10e-6);  // uniform over 100 us
    }
  }
}

TEST_F(ClockedRun, PacketsFromBeforeTheStartBeginNoTick) {
  clock().kind = ClockKind::kArrivals;
  clock().overrun = OverrunPolicy::kStop;
  for (int i = -3; i < 20; ++i) world_.source.send(world_.begin + i * kMs - 300 * kUs, kEpoch + i * kMs);
  const Summary s = run();
  EXPECT_EQ(s.ticks, 10);
  EXPECT_EQ(world_.steps[0].host, 700 * kUs);
}

TEST_F(ClockedRun, ArrivalsThatAreLostDelayOneTickByHalfACycleAndNoneIsForgotten) {
  clock().kind = ClockKind::kArrivals;
  build_.until(5);
  std::mt19937_64 random(9);
  std::vector<bool> gone;
  int count = 0;
  for (int i = 0; i < 6000; ++i) gone.push_back(i > 0 && random() % 20 == 0);
  for (int i = 0; i < 5000; ++i) count += gone[static_cast<std::size_t>(i)];
  send(
      6000, 0, [](int) { return 0; }, [&](int i) { return gone[static_cast<std::size_t>(i)]; }, false);
  const Summary s = run();
  ASSERT_EQ(world_.steps.size(), 5000u);
  for (std::size_t i = 0; i < 5000; ++i)
    ASSERT_EQ(world_.steps[i].host, static_cast<std::int64_t>(i + 1) * kMs + (gone[i] ? kMs / 2 : 0)) << i;
  EXPECT_EQ(s.clock.state.missed, count);
  EXPECT_EQ(s.overruns, 0);
}

TEST_F(ClockedRun, ArrivalsKeepTheNumberOfCyclesAlsoWithJitterLossAndAStepOfTheSource) {
  clock().kind = ClockKind::kArrivals;
  build_.until(5);
  std::mt19937_64 random(2);
  for (int i = 0; i < 6000; ++i) {
    if (i > 0 && random() % 10 == 0) continue;
    const std::int64_t step = i > 2500 ? 5 * kMs : 0;  // of the source's clock: no tick is made up
    world_.source.send(world_.begin + (i + 1) * kMs + static_cast<std::int64_t>(random() % (300 * kUs)),
                       kEpoch + i * kMs + step);
  }
  const Summary s = run();
  EXPECT_LE(std::abs(world_.steps.back().host - 5000 * kMs), kMs);
  EXPECT_EQ(s.overruns, 0);
}

TEST_F(ClockedRun, ArrivalsOfALateLoopAreCaughtUpOrSkipped) {
  for (const OverrunPolicy policy : {OverrunPolicy::kCatchUp, OverrunPolicy::kSkip}) {
    World fresh;
    clock().kind = ClockKind::kArrivals;
    clock().overrun = policy;
    fresh.work[3 * kMs] = 3400 * kUs;
    for (int i = 0; i < 20; ++i) fresh.source.send(fresh.begin + i * kMs, 0);
    build_.until(0.009);
    Master master = load(fresh, build_);
    run(master);
    if (policy == OverrunPolicy::kSkip) {
      EXPECT_EQ(fresh.steps[4], (Step{4 * kMs, 3 * kMs, 6400 * kUs}));
      EXPECT_EQ(fresh.steps[5], (Step{7 * kMs, kMs, 7 * kMs}));
    } else {
      for (const std::size_t i : {4u, 5u, 6u})
        EXPECT_EQ(fresh.steps[i], (Step{static_cast<std::int64_t>(i) * kMs, kMs, 6400 * kUs}));
      EXPECT_EQ(fresh.steps[7], (Step{7 * kMs, kMs, 7 * kMs}));
    }
  }
}

TEST_F(ClockedRun, TicksThatDivideACycleOrHaveSeveralFollowArrivalsToo) {
  clock().kind = ClockKind::kArrivals;
  build_.scenario.tick = Duration{250 * kUs};
  world_.source.period_ = kMs;
  build_.until(0.004);
  send(10, 0, [](int i) { return i == 2 ? 100 * kUs : 0; });
  run();
  ASSERT_EQ(world_.steps.size(), 16u);
  for (std::size_t i = 0; i < 16; ++i)
    EXPECT_EQ(world_.steps[i].host, kMs + static_cast<std::int64_t>(i) * 250 * kUs + (i / 4 == 2 ? 100 * kUs : 0)) << i;

  World fresh;
  Build b;
  b.unit("busy", "busy").unit("io", "connected").until(0.050);
  b.scenario.tick = Duration{5 * kMs};
  b.scenario.clock = {.kind = ClockKind::kArrivals, .cycle = Duration{kMs}};
  for (int i = 0; i < 60; ++i) fresh.source.send(fresh.begin + i * kMs, 0);
  Master master = load(fresh, b);
  run(master);
  for (std::size_t i = 0; i < 10; ++i) EXPECT_EQ(fresh.steps[i].host, static_cast<std::int64_t>(i) * 5 * kMs) << i;
}

TEST_F(ClockedRun, ASilentSourceIsReplacedByTheWallClockUntilItIsBack) {
  for (const ClockKind kind : {ClockKind::kArrivals, ClockKind::kLocked}) {
    World fresh;
    clock().kind = kind;
    build_.until(2);
    for (int i = 0; i < 3000; ++i) {
      if (i >= 500 && i < 1000) continue;                    // half a second
      const std::int64_t later = i >= 1000 ? 300 * kUs : 0;  // … after which it is at another phase
      fresh.source.send(fresh.begin + (i + 1) * kMs + later, kEpoch + i * kMs);
    }
    Master master = load(fresh, build_);
    master.initialise();
    bool was_silent = false;
    while (master.step_tick()) was_silent |= master.summary().clock.state.silent;
    const Summary s = master.summary();
    EXPECT_TRUE(was_silent);
    EXPECT_FALSE(s.clock.state.silent);
    EXPECT_TRUE(s.clock.state.locked);
    ASSERT_EQ(fresh.steps.size(), 2000u);
    for (std::size_t i = 700; i < 999; ++i)
      ASSERT_NEAR(static_cast<double>(fresh.steps[i + 1].host - fresh.steps[i].host), 1e6, 2) << i;
    EXPECT_NEAR(static_cast<double>(fresh.steps[1999].host), 2000.3e6, 1e6) << text_of(kind);
    EXPECT_NEAR(static_cast<double>(wrap(fresh.steps[1999].host - 300 * kUs, kMs)), 0, 100) << text_of(kind);
    EXPECT_EQ(s.overruns, 0) << text_of(kind);
  }
}

// A program that was stopped and goes on, as by SIGSTOP: its clock and its numbers go on where they were. It is followed from its first packet on, and
// not only when its clock has made up for the pause.
TEST_F(ClockedRun, ASourceThatPausedIsFollowedAtOnce) {
  for (const ClockKind kind : {ClockKind::kArrivals, ClockKind::kLocked}) {
    for (const std::int64_t pause : {50 * kMs, 500 * kMs, 1500 * kMs}) {
      World fresh;
      clock().kind = kind;
      build_.until(3);
      for (int i = 0; i < 3000; ++i) {
        const std::int64_t later = i >= 500 ? pause + 300 * kUs : 0;
        fresh.source.send(fresh.begin + (i + 1) * kMs + later, kEpoch + i * kMs);
      }
      Master master = load(fresh, build_);
      const Summary s = run(master);
      EXPECT_EQ(s.ticks, 3000);
      ASSERT_EQ(fresh.steps.size(), 3000u);
      for (std::size_t i = 1; i < 3000; ++i) {
        ASSERT_LE(fresh.steps[i].host - fresh.steps[i - 1].host, 3 * kMs) << text_of(kind) << ' ' << pause << ' ' << i;
      }
      EXPECT_NEAR(static_cast<double>(fresh.steps[2999].host), 3000.3e6, 2e6) << text_of(kind) << ' ' << pause;
      EXPECT_TRUE(s.clock.state.locked) << text_of(kind) << ' ' << pause;
      EXPECT_EQ(s.overruns, 0) << text_of(kind) << ' ' << pause;
    }
  }
}

// A program that was kept from running for a while and then sends what is overdue at once: no cycle is counted twice. What they do not make up
// for was a pause.
TEST_F(ClockedRun, ASourceThatCatchesUpIsNotCountedTwice) {
  for (const std::int64_t stall : {10, 20, 60, 300}) {  // cycles
    for (const std::int64_t apart : {50 * kUs, 100 * kUs, 300 * kUs}) {
      for (const std::string kind : {"late", "late and paused", "late and lost"}) {
        SCOPED_TRACE(std::to_string(stall) + " cycles " + kind + ", then every " + std::to_string(apart) + " ns");
        World fresh;
        Build b;
        b.unit("busy", "busy").unit("io", "connected").until(3);
        b.scenario.clock = {.kind = ClockKind::kArrivals};
        std::int64_t last = 0;
        for (int i = 0; i < 3100; ++i) {
          if (kind == "late and lost" && i >= 500 && i < 505) continue;
          const std::int64_t pause = kind == "late and paused" && i >= 500 ? 5 * kMs : 0;
          last = std::max({(i + 1) * kMs + pause, i < 500 ? 0 : (500 + stall) * kMs, last + apart});
          fresh.source.send(fresh.begin + last, kEpoch + i * kMs);
        }
        Master master = load(fresh, b);
        const Summary s = run(master);
        ASSERT_EQ(fresh.steps.size(), 3000u);
        for (std::size_t i = 1; i < 3000; ++i) ASSERT_LE(fresh.steps[i].host - fresh.steps[i - 1].host, 3 * kMs) << i;
        EXPECT_NEAR(static_cast<double>(fresh.steps[2999].host), 3000e6, 1e6);
        EXPECT_TRUE(s.clock.state.locked);
      }
    }
  }
}

TEST_F(ClockedRun, ASilentSourceStopsTheRunOrPausesItIfTheScenarioSaysSo) {
  for (const ClockKind kind : {ClockKind::kArrivals, ClockKind::kLocked}) {
    World fresh;
    clock().kind = kind;
    clock().silence = SilencePolicy::kStop;
    clock().timeout = Duration{20 * kMs};
    for (int i = 0; i < 50; ++i) fresh.source.send(fresh.begin + (i + 1) * kMs, kEpoch + i * kMs);
    build_.until(2);
    Master stopped = load(fresh, build_);
    const std::string error = error_of([&] { run(stopped); });
    EXPECT_THAT(error, HasSubstr("test.ssd:5: no packet from 'io' for 2"));
    EXPECT_THAT(error, HasSubstr("more than the clock's timeout of 20 ms (silence=stop)"));
    EXPECT_NEAR(static_cast<double>(stopped.tick()), 70, 2);
  }
  for (const ClockKind kind : {ClockKind::kArrivals, ClockKind::kLocked}) {
    World fresh;
    clock().kind = kind;
    clock().silence = SilencePolicy::kWait;
    for (int i = 0; i < 1500; ++i) {
      if (i < 50 || i >= 1000) fresh.source.send(fresh.begin + (i + 1) * kMs, kEpoch + i * kMs);
    }
    build_.until(0.2);
    Master paused = load(fresh, build_);
    const Summary s = run(paused);
    ASSERT_EQ(fresh.steps.size(), 200u);
    // Arrivals: 50 ticks, then 150 from packet 1000 on. Locked: 50 and 20 ms more until the time-out.
    if (kind == ClockKind::kArrivals) {
      EXPECT_EQ(fresh.steps[49].host, 50 * kMs);
      EXPECT_EQ(fresh.steps[50].host, 1001 * kMs);
      EXPECT_EQ(fresh.steps[199].host, 1150 * kMs);
    }
    EXPECT_GE(fresh.steps[199].host, 1001 * kMs + 128 * kMs);
    EXPECT_EQ(s.overruns, 0);
  }
}

TEST_F(ClockedRun, TicksThatWaitGoOnWithASourceThatHasBegunAnew) {
  for (const std::int64_t jump : {std::int64_t{-30}, std::int64_t{5000}}) {  // cycles
    World fresh;
    clock().kind = ClockKind::kArrivals;
    clock().silence = SilencePolicy::kWait;
    // Faster than their period from packet 50 on, so that the time that has passed tells nothing.
    const auto host = [](int i) { return i < 50 ? (i + 1) * kMs : 50 * kMs + (i - 49) * 300 * kUs; };
    for (int i = 0; i < 600; ++i) fresh.source.send(fresh.begin + host(i), kEpoch + (i < 50 ? i : i + jump) * kMs);
    build_.until(0.1);
    Master master = load(fresh, build_);
    run(master);
    ASSERT_EQ(fresh.steps.size(), 100u);
    for (int i = 0; i < 100; ++i) EXPECT_EQ(fresh.steps[static_cast<std::size_t>(i)].host, host(i)) << i;
  }
}

TEST_F(ClockedRun, ASourceWithoutAnyPacketIsWaitedForUntilTheTimeOut) {
  clock().kind = ClockKind::kArrivals;
  run();
  ASSERT_EQ(world_.steps.size(), 10u);
  EXPECT_NEAR(static_cast<double>(world_.steps[0].host), 100e6, 2);  // the time-out
  for (std::size_t i = 1; i < 10; ++i) EXPECT_EQ(world_.steps[i].host - world_.steps[i - 1].host, kMs);
}

TEST_F(ClockedRun, ALockedClockStandsAtThePhaseOfTheSource) {
  for (const double rate : {100e-6, -100e-6}) {
    World fresh;
    Build b;
    b.unit("busy", "busy").unit("io", "connected").until(6);
    b.scenario.clock = {.kind = ClockKind::kLocked, .shift = Duration{200 * kUs}};
    std::mt19937_64 random(4);
    std::vector<std::int64_t> cycles;  // host time of their beginnings
    for (int i = 0; i < 7000; ++i) {
      cycles.push_back(std::llround((i + 1) * 1e6 / (1 + rate)) + 123'456);
      if (random() % 20 == 0) continue;
      // A packet from the middle of the cycle, with its time and 50 us of jitter on its way.
      const std::int64_t jitter = std::llround(50e3 * gaussian(random));
      fresh.source.send(fresh.begin + cycles.back() + kMs / 2 + jitter, kEpoch + i * kMs + kMs / 2);
    }
    Master master = load(fresh, b);
    const Summary s = run(master);
    EXPECT_TRUE(s.clock.state.locked);
    EXPECT_NEAR(s.clock.state.drift, -rate, 50e-6);
    EXPECT_NEAR(s.clock.rms_offset, 50e-6, 10e-6);
    double squares = 0;
    for (std::size_t i = 3000; i < 6000; ++i) {
      const auto next = std::lower_bound(cycles.begin(), cycles.end(), fresh.steps[i].host - 700 * kUs);
      squares += std::pow(static_cast<double>(fresh.steps[i].host - *next - 200 * kUs), 2);
    }
    EXPECT_LE(std::sqrt(squares / 3000), 1.5 * 50e3 * std::sqrt(1.25 * 2 * M_PI * 1e-3));
  }
}

TEST_F(ClockedRun, ALockedClockFollowsABusThatOnlyAnswersTheFramesOfSteps) {
  for (const double rate : {50e-6, -50e-6}) {
    World fresh;
    build_.until(6);
    clock().kind = ClockKind::kLocked;
    clock().overrun = OverrunPolicy::kStop;
    clock().silence = SilencePolicy::kStop;
    const auto bus = [&](std::int64_t host) {
      const auto passed = static_cast<double>(host - fresh.begin);
      return kEpoch + 321'987 + host - fresh.begin + std::llround(rate * passed);
    };
    // The frame passes the reference clock 20 us after it was sent and is back after 50 us.
    fresh.answer = [&] { fresh.source.send(fresh.host.now() + 50 * kUs, bus(fresh.host.now() + 20 * kUs)); };
    Master master = load(fresh, build_);
    const Summary s = run(master);
    EXPECT_TRUE(s.clock.state.locked);
    EXPECT_NEAR(s.clock.state.drift, -rate, 1e-8);
    // Steps begin at the multiples of the bus's cycle, but for the 30 us from reading to receiving.
    const std::int64_t phase = bus(fresh.begin + fresh.steps.back().host) % kMs;
    EXPECT_NEAR(static_cast<double>(wrap(phase - 30 * kUs, kMs)), 0, 20) << rate;
  }
}

TEST_F(ClockedRun, ASourceThatOnlyAnswersNeitherBeginsTicksNorIsWaitedFor) {
  world_.source.answers_only_ = true;
  clock().kind = ClockKind::kArrivals;
  const std::string arrivals = error_of([&] { load(); });
  EXPECT_THAT(arrivals, HasSubstr("test.ssd:5: 'io' only gets answers to what its steps send"));
  EXPECT_THAT(arrivals, HasSubstr("(kind=arrivals), expected kind=locked"));
  clock().kind = ClockKind::kLocked;
  clock().silence = SilencePolicy::kWait;
  EXPECT_THAT(error_of([&] { load(); }), HasSubstr("(silence=wait), expected silence=wall or stop"));
  clock().silence = SilencePolicy::kWall;
  EXPECT_EQ(error_of([&] { load(); }), "");
}

TEST_F(ClockedRun, UnitsAreEndedOnceTheRunIsOverAlsoAfterAnError) {
  clock().kind = ClockKind::kFree;
  run();
  EXPECT_EQ(world_.ended, 1);
  World fresh;
  Master failed = load(fresh, build_);
  failed.initialise();
  fresh.answer = [] { throw Error("a step that fails"); };
  EXPECT_THAT(error_of([&] {
                while (failed.step_tick()) {
                }
              }),
              HasSubstr("a step that fails"));
  EXPECT_EQ(fresh.ended, 0);
  failed.finish();
  failed.finish();
  EXPECT_EQ(fresh.ended, 1);
}

TEST_F(ClockedRun, ALockedClockThatMovesATickIntoThePastIsNoOverrun) {
  for (const std::int64_t phase : {100 * kUs, 450 * kUs, 550 * kUs, 900 * kUs}) {
    World fresh;
    build_.until(1);
    clock().kind = ClockKind::kLocked;
    clock().overrun = OverrunPolicy::kStop;
    clock().late = Duration{1 * kUs};
    for (int i = 0; i < 1000; ++i) {
      // At 200 ms silence, at 600 ms a step.
      if (i < 200 || i > 400)
        fresh.source.send(fresh.begin + i * kMs + 700 * kUs, kEpoch + i * kMs + phase + (i > 600 ? 300 * kUs : 0));
    }
    Master master = load(fresh, build_);
    const Summary s = run(master);
    EXPECT_EQ(s.ticks, 1000) << phase;
    EXPECT_EQ(s.clock.state.steps, 1) << phase;
  }
}

TEST_F(ClockedRun, ArrivalsIgnorePacketsThatComeTwiceOrInAnotherOrder) {
  clock().kind = ClockKind::kArrivals;
  build_.until(1);
  for (const bool with_time : {true, false}) {
    World fresh;
    std::mt19937_64 random(8);
    for (int i = 0; i < 1100; ++i) {
      const std::int64_t at = fresh.begin + (i + 1) * kMs, time = with_time ? kEpoch + i * kMs : 0;
      fresh.source.send(at, time);
      if (random() % 4 == 0) fresh.source.send(at + static_cast<std::int64_t>(random() % (400 * kUs)), time);
      if (with_time && i > 0 && random() % 10 == 0) fresh.source.send(at + 600 * kUs, time - kMs);  // the one before, again
    }
    Master master = load(fresh, build_);
    const Summary s = run(master);
    ASSERT_EQ(fresh.steps.size(), 1000u);
    for (std::size_t i = 0; i < 1000; ++i) ASSERT_EQ(fresh.steps[i].host, static_cast<std::int64_t>(i + 1) * kMs) << i;
    EXPECT_EQ(s.overruns, 0);
  }
}

TEST_F(ClockedRun, NoClockAllocatesAlsoWithOverrunsAndThreads) {
  for (const ClockKind kind : {ClockKind::kWall, ClockKind::kArrivals, ClockKind::kLocked}) {
    for (const OverrunPolicy policy : {OverrunPolicy::kCatchUp, OverrunPolicy::kSkip}) {
      World fresh;
      Build b;
      b.unit("busy", "busy")
          .unit("io", "connected")
          .unit("h1", "heavy")
          .unit("h2", "heavy")
          .record("*")
          .record("clock.*")
          .until(1);
      b.scenario.clock = {.kind = kind, .overrun = policy};
      for (int i = 0; i < 50; ++i) fresh.work[i * 17 * kMs] = 5 * kMs;
      for (int i = 0; i < 900; ++i) fresh.source.send(fresh.begin + (i + 1) * kMs, kEpoch + i * kMs);
      MasterOptions options;
      options.results = folder_;
      options.threads = 2;
      options.always_threads = true;
      Master master = load(fresh, b, std::move(options));
      master.initialise();
      const std::uint64_t before = cotwin::testing::allocations();
      while (master.step_tick()) {
      }
      EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
      master.finish();
      EXPECT_GT(master.summary().overruns, 0);
      EXPECT_EQ(master.summary().threads, 2);
    }
  }
}

}  // namespace
}  // namespace cotwin::master::clock_test
