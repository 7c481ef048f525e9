#include "master/engine/workers.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "tests/master/test_units.h"

namespace cotwin::master::workers_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;

TEST(Workers, DoEveryTaskOnceOnItsThread) {
  for (int threads = 1; threads <= 8; ++threads) {
    Workers workers(threads);
    EXPECT_EQ(workers.threads(), threads);
    std::vector<std::uint8_t> thread_of(50);
    for (std::size_t i = 0; i < thread_of.size(); ++i)
      thread_of[i] = static_cast<std::uint8_t>(i % static_cast<std::size_t>(threads));
    std::vector<int> done(thread_of.size());  // not atomic: the thread sanitizer would report access by two threads
    std::vector<std::thread::id> ids(thread_of.size());
    struct Context {
      std::vector<int>& done;
      std::vector<std::thread::id>& ids;
    } context{done, ids};
    for (int round = 0; round < 1000; ++round) {
      workers.run(
          thread_of,
          [](void* c, std::size_t i) {
            static_cast<Context*>(c)->done[i] += 1;
            static_cast<Context*>(c)->ids[i] = std::this_thread::get_id();
          },
          &context);
      ASSERT_EQ(std::accumulate(done.begin(), done.end(), 0), 50 * (round + 1));
    }
    for (std::size_t i = 0; i < ids.size(); ++i) {
      EXPECT_EQ(ids[i] == std::this_thread::get_id(), thread_of[i] == 0);
      EXPECT_EQ(ids[i], ids[thread_of[i]]);
    }
  }
}

TEST(Workers, EndAlsoWhileTheySleep) {
  Workers workers(4);
  std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

/// Runs `ticks` ticks of four units of 50 us each, whose times are `alone(tick)` and `together(tick)`. Returns the share of
/// ticks in the second half of the run that used several threads.
template <class Alone, class Together>
double share_spread(int ticks, Alone alone, Together together) {
  Balance balance({true, true, true, true}, 2, 5e-6, false);
  for (int i = 0; i < 8; ++i) balance.sampled(std::vector<double>(4, 50e-6));
  int spread = 0;
  for (int tick = 0; tick < ticks; ++tick) {
    if (!balance.on_trial() && tick >= balance.next_trial()) balance.begin_trial();
    const bool parallel = balance.parallel();
    spread += parallel && tick >= ticks / 2;
    if (balance.on_trial()) balance.trial_tick(tick, parallel ? together(tick) : alone(tick));
  }
  return spread / (ticks / 2.0);
}

TEST(Balance, ChoosesTheFasterWayIfItIsFivePerCentFaster) {
  const auto constant = [](double seconds) { return [seconds](int) { return seconds; }; };
  EXPECT_GT(share_spread(100'000, constant(200e-6), constant(190e-6)), 0.97);
  EXPECT_LT(share_spread(100'000, constant(200e-6), constant(210e-6)), 0.03);
}

TEST(Balance, IsRobustAgainstNoiseAndExpensiveTicks) {
  // Ticks that cost three times as much for a while (a contact), random variation by a third, and a delay of 2 ms by another
  // process in every 50th tick.
  for (const bool pays : {false, true}) {
    std::mt19937 random(7);
    const auto noisy = [&](double seconds) {
      return [&, seconds](int tick) {
        const double chance = std::uniform_real_distribution<>(0.67, 1.33)(random);
        const double delay = random() % 50 == 0 ? 2e-3 : 0;
        return seconds * (tick / 1000 % 2 == 0 ? 1 : 3) * chance + delay;
      };
    };
    const double share = share_spread(400'000, noisy(200e-6), noisy(pays ? 150e-6 : 250e-6));
    if (pays) {
      EXPECT_GT(share, 0.95);
    } else {
      EXPECT_LT(share, 0.05);
    }
  }
}

TEST(Balance, AdaptsWhenTheMachineChanges) {
  const auto together = [](int tick) { return tick < 50'000 ? 120e-6 : 300e-6; };  // then the second core is occupied
  EXPECT_LT(share_spread(
                300'000, [](int) { return 200e-6; }, together),
            0.05);
}

TEST(Balance, MakesNoTrialsWhereThreadsCannotHelp) {
  Balance light({true, true, true, true}, 2, 5e-6, false), single({true, true}, 1, 5e-6, false);
  for (int i = 0; i < 100; ++i) {
    light.sampled(std::vector<double>(4, 50e-9));
    single.sampled(std::vector<double>(2, 50e-6));
  }
  EXPECT_EQ(light.next_trial(), std::numeric_limits<std::int64_t>::max());
  EXPECT_EQ(single.next_trial(), std::numeric_limits<std::int64_t>::max());
}

TEST(Balance, AssignsTheLongestFirstAndKeepsPinnedUnits) {
  Balance balance({false, true, true, true}, 3, 1e-6, true);
  for (int i = 0; i < 10; ++i) balance.sampled(std::vector<double>{10e-6, 90e-6, 50e-6, 45e-6});
  EXPECT_TRUE(balance.parallel());
  EXPECT_EQ(balance.thread_of()[0], 0);
}

/// All outputs at the end of a run of coupled chaotic maps in two stages: a difference in the last bit anywhere grows to order
/// 1.
std::vector<double> chaos(int threads, bool always) {
  Build b;
  constexpr int kUnits = 12;
  for (int i = 0; i < kUnits; ++i) {
    b.unit("u" + std::to_string(i), "heavy", i % 2, i % 3 == 2 ? 2 : 1).with("start", 0.1 + 0.05 * i);
    b.with("rounds", std::int64_t{20 + 10 * i});
    b.connect("u" + std::to_string((i + 5) % kUnits) + ".y", "u" + std::to_string(i) + ".u", 10);
  }
  b.until(2).event(0.5, "u0.u", "0.25");
  b.scenario.events.clear();
  MasterOptions options;
  options.types = cotwin::testing::test_types();
  options.threads = threads;
  options.always_threads = always;
  Master master(b.scenario, std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.summary().threads, always && threads > 1 ? std::min(threads, 6) : master.summary().threads);
  std::vector<double> y;
  for (int i = 0; i < kUnits; ++i) y.push_back(cotwin::testing::value(master, "u" + std::to_string(i) + ".y"));
  return y;
}

TEST(Threads, DoNotChangeABit) {
  const std::vector<double> alone = chaos(1, false);
  for (const int threads : {2, 3, 8}) EXPECT_EQ(chaos(threads, true), alone) << threads << " threads";
  EXPECT_EQ(chaos(0, false), alone);
}

TEST(Threads, ReportTheFirstFaultInTheOrderOfTheScenario) {
  for (const bool always : {false, true}) {
    Build b;
    for (int i = 0; i < 6; ++i) b.unit("u" + std::to_string(i), "faulty").with("after", 0.002).with("throws", i == 1 || i == 4);
    MasterOptions options;
    options.types = cotwin::testing::test_types();
    options.threads = 3;
    options.always_threads = always;
    Master master(b.scenario, std::move(options));
    master.initialise();
    EXPECT_EQ(error_of([&] {
                while (master.step_tick()) {
                }
              }),
              "u1 at t = 0.002 s: the gear has broken");
  }
}

}  // namespace
}  // namespace cotwin::master::workers_test
