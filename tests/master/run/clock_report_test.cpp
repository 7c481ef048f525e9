// Errors, recording, packages and figures of clocks, in simulated time.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "master/results/summary.h"
#include "master/twin/ssd_write.h"
#include "tests/master/run/clocked_units.h"

namespace cotwin::master::clock_report_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::ClockedRun;
using ::cotwin::testing::error_of;
using ::cotwin::testing::kMs;
using ::cotwin::testing::kUs;
using ::cotwin::testing::World;
using ::testing::HasSubstr;

TEST_F(ClockedRun, RecordsTheClockOnRequestOnly) {
  build_.until(0.008);
  build_.scenario.decimation = 2;
  clock().overrun = OverrunPolicy::kSkip;
  world_.work[3 * kMs] = 3400 * kUs;
  build_.record("busy.steps").record("clock.overruns").record("clock.l*");
  MasterOptions options;
  options.results = folder_;
  Master master = load(std::move(options));
  run(master);
  std::ifstream in(folder_ / "signals.csv");
  const std::string csv((std::istreambuf_iterator<char>(in)), {});
  // Rows every second tick, without those in the longer step from 4 to 7 ms.
  EXPECT_EQ(csv,
            "time,busy.steps,clock.lateness,clock.locked,clock.overruns\n"
            "0,0,0,0,0\n0.002,2,0,0,0\n0.004,4,0,0,0\n0.007,5,0.0024,0,1\n0.008,6,0,0,1\n");
  build_.scenario.recording.clear();
  EXPECT_EQ(load().columns().size(), 2u);  // busy.steps, io.y
  build_.record("clock.nothing");
  EXPECT_THAT(error_of([&] { load(); }), HasSubstr("test.ssd:70: there is no variable 'clock.nothing'"));
}

TEST_F(ClockedRun, GoesOnAfterAResumption) {
  for (const ClockKind kind : {ClockKind::kWall, ClockKind::kArrivals, ClockKind::kLocked}) {
    World fresh;
    clock().kind = kind;
    build_.until(0.020);
    for (int i = 0; i < 100; ++i) fresh.source.send(fresh.begin + i * kMs, kEpoch + i * kMs);
    std::optional<RunState> saved;
    for (const bool again : {false, true}) {
      MasterOptions options;
      if (again) options.resume = saved;
      Master master = load(fresh, build_, std::move(options));
      master.initialise();
      EXPECT_EQ(master.tick(), again ? 10 : 0);
      while (master.tick() < 10) master.step_tick();
      if (!again) master.save([&](RunState state) { saved = std::move(state); });
      while (again && master.step_tick()) {
      }
      if (!again) fresh.host.work(25 * kMs);  // between the two processes
    }
    ASSERT_EQ(fresh.steps.size(), 20u);
    for (std::size_t i = 0; i < 20; ++i) EXPECT_EQ(fresh.steps[i].now, static_cast<std::int64_t>(i) * kMs);
    for (std::size_t i = 12; i < 20; ++i)
      EXPECT_NEAR(static_cast<double>(fresh.steps[i].host - fresh.steps[i - 1].host), 1e6, 2e5);
  }
}

TEST_F(ClockedRun, NamesClocksThatDoNotFit) {
  clock().kind = ClockKind::kArrivals;
  clock().component = "busy";
  EXPECT_EQ(error_of([&] { load(); }),
            "test.ssd:5: 'busy' has no clock of a robot or bus that ticks can follow; those that have one: 'io'");
  clock().component = "nobody";
  EXPECT_THAT(error_of([&] { load(); }), HasSubstr("'nobody' is not a component"));
  clock().component = "";
  build_.unit("io2", "connected");
  EXPECT_EQ(error_of([&] { load(); }),
            "test.ssd:5: several components have a clock that ticks can follow: 'io', 'io2', expected one to be named");
  build_.scenario.components.erase(build_.scenario.components.begin() + 1, build_.scenario.components.end());
  EXPECT_THAT(error_of([&] { load(); }), HasSubstr("no component has the clock of a robot or bus"));
  build_.unit("io", "connected");
  clock().cycle = Duration{1'500'000};
  EXPECT_THAT(error_of([&] { run(); }),
              HasSubstr("'io' has cycles of 1.5 ms and a tick lasts 1 ms, expected one of them to be a multiple of the other"));
  clock().cycle = Duration{4 * kMs};
  clock().timeout = Duration{7 * kMs};
  EXPECT_THAT(error_of([&] { run(); }), HasSubstr("the clock's timeout is 7 ms, expected at least two cycles of 'io' of 4 ms"));
  clock() = {.kind = ClockKind::kWall, .cpus = {1'000'000}, .place = "test.ssd:5"};
  EXPECT_THAT(error_of([&] { load(); }), HasSubstr("test.ssd:5: CPU 1000000, expected 0 to "));
}

TEST_F(ClockedRun, SetsUpItsThreadsOrSaysWhatIsNotPermitted) {
  build_.unit("h1", "heavy").unit("h2", "heavy");
  clock().priority = 1;
  clock().cpus = {0};
  MasterOptions options;
  options.threads = 2;
  options.always_threads = true;
  Master master = load(std::move(options));
  std::thread([&] { run(master); }).join();  // so that the thread of the other tests stays as it is
  const Summary s = master.summary();
  for (const std::string& warning : s.warnings)
    EXPECT_TRUE(warning.find("cannot be given (SCHED_FIFO") != std::string::npos ||
                warning.find("mlockall") != std::string::npos || warning.find("cannot be used") != std::string::npos)
        << warning;
  EXPECT_EQ(s.ticks, 10);
  ASSERT_TRUE(s.clock.page_faults.has_value());
  EXPECT_GE(*s.clock.page_faults, 0);
}

TEST_F(ClockedRun, APackageKeepsItsClock) {
  clock() = {.kind = ClockKind::kLocked,
             .component = "io",
             .overrun = OverrunPolicy::kStop,
             .late = Duration{123'457},
             .silence = SilencePolicy::kWait,
             .timeout = Duration{30 * kMs},
             .cycle = Duration{500 * kUs},
             .shift = Duration{-7},
             .bandwidth = 0.3,
             .within = Duration{11},
             .priority = 42,
             .cpus = {1, 0}};
  const std::vector<Member> members = load_members(build_.scenario, cotwin::testing::clocked_types(), {});
  std::filesystem::create_directories(folder_);
  std::ofstream(folder_ / "p.ssd") << to_ssd(build_.scenario, members, {}, {{"busy.fmu", ""}, {"io.fmu", ""}}, false);
  const ClockSpec read = load_scenario(folder_ / "p.ssd").clock, &given = clock();
  EXPECT_EQ(read.kind, given.kind);
  EXPECT_EQ(read.component, given.component);
  EXPECT_EQ(read.overrun, given.overrun);
  EXPECT_EQ(read.silence, given.silence);
  for (const auto span : {&ClockSpec::late, &ClockSpec::timeout, &ClockSpec::cycle, &ClockSpec::shift, &ClockSpec::within})
    EXPECT_EQ(read.*span, given.*span);
  EXPECT_EQ(read.bandwidth, given.bandwidth);
  EXPECT_EQ(read.priority, given.priority);
  EXPECT_EQ(read.cpus, given.cpus);
}

TEST_F(ClockedRun, ReportsItsFigures) {
  clock().kind = ClockKind::kLocked;
  build_.until(1);
  send(2000, 20e-6);
  const Summary s = run();
  std::ostringstream text, json_text;
  write_report(text, s, {});
  EXPECT_THAT(text.str(), HasSubstr("clock of the source: locked, offset "));
  EXPECT_THAT(text.str(), HasSubstr("delay of the start of ticks: median "));
  EXPECT_THAT(text.str(), HasSubstr("page faults after the start"));
  write_json(json_text, s, {});
  const auto json = nlohmann::json::parse(json_text.str())["clock"];
  EXPECT_EQ(json["kind"], "locked");
  EXPECT_EQ(json["locked"], true);
  EXPECT_NEAR(json["drift"].get<double>(), -20e-6, 1e-6);
  EXPECT_EQ(json["start_delay"]["count"], 1000);
  std::int64_t sum = 0;
  for (const auto& bin : json["run_time"]["bins"]) sum += bin[1].get<std::int64_t>();
  EXPECT_EQ(sum, 1000);
}

}  // namespace
}  // namespace cotwin::master::clock_report_test
