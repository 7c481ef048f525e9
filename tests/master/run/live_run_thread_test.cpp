// A run on one thread, and those who watch and influence it on others.
#include <gtest/gtest.h>

#include <atomic>
#include <thread>
#include <vector>

#include "tests/master/run/observed_run.h"

namespace cotwin::master::live_run_thread_test {
namespace {

using bus::LiveRun;
using bus::RunReply;
using bus::RunVerb;
using testing::Build;

TEST(LiveRunThread, ClientsComeGoAndFloodWhileTheRunGoesOn) {
  Build b = gain_and_integral();
  b.unit("v", "gain?n=100").unit("heavy", "heavy");
  Observer o;
  Master master = load(b, o);
  std::atomic<bool> done = false;
  std::thread loop([&] {
    while (!done) ASSERT_TRUE(master.step_tick());
  });
  std::atomic<std::int64_t> set = 0;
  std::vector<std::thread> clients;
  for (int c = 0; c < 4; ++c) {
    clients.emplace_back([&, c] {
      for (int round = 0; round < 8; ++round) {
        LiveRun::Control control(o.run);
        LiveRun::Watch watch(o.run, std::vector<std::string>{"v.u[" + std::to_string(c + 1) + "]", "i.y"}, round % 3);
        LiveRun::Sample sample;
        for (int i = 0; i < 10; ++i) {
          const double value = 100 * round + i;
          control.set(std::vector<LiveRun::Change>{{"v.u[" + std::to_string(c + 1) + "]", {value}}});
          const auto answer = control.wait(soon());
          ASSERT_TRUE(answer);
          ASSERT_EQ(answer->reply, RunReply::kDone);
          ++set;
          // A record of a tick that began with the value has it.
          do {
            watch.request();
            ASSERT_TRUE(watch.wait(soon()));
          } while (!watch.take(sample) || sample.tick <= answer->tick);
          ASSERT_EQ(sample.values[0], value);
        }
      }
    });
  }
  for (std::thread& client : clients) client.join();
  done = true;
  loop.join();
  master.finish();
  EXPECT_EQ(master.summary().influence.count(), set);
  EXPECT_EQ(set, 320);
}

TEST(LiveRunThread, APausedRunAnswersAndIsResumedByAnotherThread) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  std::thread loop([&] {
    while (master.step_tick()) {
    }
  });
  LiveRun::Control control(o.run);
  for (int i = 0; i < 20; ++i) {
    control.command(RunVerb::kPause);
    const std::int64_t tick = control.wait(soon())->tick;
    LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y"}, 0);
    ASSERT_TRUE(watch.wait(soon()));
    LiveRun::Sample sample;
    ASSERT_TRUE(watch.pop_newest(sample));
    ASSERT_EQ(sample.tick, tick);
    control.command(RunVerb::kResume);
    ASSERT_EQ(control.wait(soon())->tick, tick);
  }
  control.command(RunVerb::kStop);
  ASSERT_TRUE(control.wait(soon()));
  loop.join();
  master.finish();
}

}  // namespace
}  // namespace cotwin::master::live_run_thread_test
