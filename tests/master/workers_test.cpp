#include "master/workers.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "tests/master/test_units.h"

namespace cotwin::master {
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
    std::vector<int> done(thread_of.size());  // not atomic: the thread sanitizer would see two threads at one
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

TEST(Balance, SpreadsExpensiveUnitsAndLeavesLightOnesAlone) {
  constexpr double kBarrier = 5e-6;
  Balance light({true, true, true, true}, 2, kBarrier, false), heavy({true, true, true, true}, 2, kBarrier, false);
  for (int i = 0; i < 100; ++i) {
    light.sampled(std::vector<double>(4, 50e-9), 200e-9);
    heavy.sampled(std::vector<double>(4, 50e-6), heavy.parallel() ? 105e-6 : 200e-6);
  }
  EXPECT_FALSE(light.parallel());
  EXPECT_TRUE(heavy.parallel());
  EXPECT_EQ(std::count(heavy.thread_of().begin(), heavy.thread_of().end(), 0), 2);
}

TEST(Balance, GivesUpWhereSpreadingDoesNotPay) {
  Balance balance({true, true}, 2, 5e-6, false);
  int spread = 0;
  for (int i = 0; i < 5000; ++i) {
    balance.sampled(std::vector<double>(2, 50e-6), balance.parallel() ? 300e-6 : 100e-6);  // a machine whose cores are taken
    spread += balance.parallel();
  }
  EXPECT_GT(spread, 0);    // it was tried
  EXPECT_LT(spread, 200);  // more and more rarely
}

TEST(Balance, PutsTheLongestFirstAndKeepsWhatMustNotMove) {
  Balance balance({false, true, true, true}, 3, 1e-6, true);
  for (int i = 0; i < 10; ++i) balance.sampled(std::vector<double>{10e-6, 90e-6, 50e-6, 45e-6}, 100e-6);
  EXPECT_TRUE(balance.parallel());
  EXPECT_EQ(balance.thread_of()[0], 0);
}

/// All outputs at the end of a run of coupled chaotic maps in two stages: a difference in the last bit anywhere grows to one
/// here.
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

TEST(Threads, TellTheFirstFaultInTheOrderOfTheScenario) {
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
}  // namespace cotwin::master
