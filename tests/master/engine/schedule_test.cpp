#include "master/engine/wiring/schedule.h"
#include "master/engine/wiring/arrangement.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "tests/master/test_units.h"

namespace cotwin::master::schedule_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::HasSubstr;

TEST(Schedule, StagesInOneTickAreGaussSeidelAndOneStageIsJacobi) {
  // A chain of three gains with u = 1: in one stage a change takes one tick per unit, in three stages it arrives in the first
  // tick.
  for (const bool stages : {false, true}) {
    Build b;
    b.unit("a", "gain", 0).unit("b", "gain", stages ? 1 : 0).unit("c", "gain", stages ? 2 : 0);
    b.connect("a.y", "b.u").connect("b.y", "c.u");
    b.event(0, "a.u", "1");  // after initialisation
    Master master = b.load();
    master.initialise();
    std::vector<double> seen;
    for (int i = 0; i < 3; ++i) {
      ASSERT_TRUE(master.step_tick());
      seen.push_back(value(master, "c.y"));
    }
    EXPECT_EQ(seen, (stages ? std::vector<double>{1, 1, 1} : std::vector<double>{0, 0, 1}));
  }
}

TEST(Schedule, AUnitWithAPeriodStepsAtItsEndOverAllOfIt) {
  Build b;
  b.unit("p", "probe", 0, 4).until(0.01);
  Master master = b.load();
  master.initialise();
  for (int tick = 1; tick <= 10; ++tick) {
    ASSERT_TRUE(master.step_tick());
    const int last_end = tick == 10 ? 10 : tick / 4 * 4;  // the last tick ends the step of every unit
    EXPECT_DOUBLE_EQ(value(master, "p.t"), 1e-3 * last_end);
    EXPECT_EQ(value(master, "p.steps"), tick == 10 ? 3 : tick / 4);
  }
  EXPECT_DOUBLE_EQ(value(master, "p.h"), 2e-3);
  EXPECT_FALSE(master.step_tick());
}

TEST(Schedule, TheLastStepEndsAtTheStopTime) {
  Build b;
  b.unit("p", "probe").until(0.00725);
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.tick(), 8);
  EXPECT_EQ(master.now().ns, 7'250'000);
  EXPECT_DOUBLE_EQ(value(master, "p.now"), 0.007);
  EXPECT_DOUBLE_EQ(value(master, "p.h"), 0.00025);
}

TEST(Schedule, TimeIsTheNumberOfTheTickTimesTheTickAlsoAfterAMillion) {
  Build b;
  b.unit("p", "probe").until(1e6 * 1e-4);
  b.scenario.tick = Duration{100'000};
  b.scenario.start = Time{30};
  b.scenario.stop = Time{30 + 1'000'000 * std::int64_t{100'000}};
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) ASSERT_EQ(master.now().ns, 30 + master.tick() * 100'000);
  EXPECT_EQ(master.tick(), 1'000'000);
  EXPECT_EQ(value(master, "p.t"), master.now().seconds());
}

TEST(Schedule, RefusesNonsense) {
  const auto refusal = [](const std::function<void(Scenario&)>& change) {
    Build b;
    b.unit("p", "probe");
    change(b.scenario);
    return error_of([&] { b.load(); });
  };
  EXPECT_THAT(refusal([](Scenario& s) { s.stop = s.start; }), HasSubstr("give --stop"));
  EXPECT_THAT(refusal([](Scenario& s) { s.tick.ns = 0; }), HasSubstr("tick 0 s, expected > 0"));
  EXPECT_THAT(refusal([](Scenario& s) { s.components[0].period = 0; }), HasSubstr("period 0, expected >= 1"));
  EXPECT_THAT(refusal([](Scenario& s) { s.components[0].source = "plant.fmu"; }), HasSubstr("test.ssd:10"));
}

TEST(Schedule, CutsAnIntervalIntoPartsThatMeet) {
  const Time a{10}, b{17};
  EXPECT_EQ(cut(a, b, 0, 1), b);
  EXPECT_EQ(cut(a, b, 0, 2).ns, 13);
  EXPECT_EQ(cut(a, b, 1, 2), b);
  // 1023 ns in 1024 parts: the first is empty, all others have 1 ns. In 512 parts: 1 or 2 ns.
  for (int part = 0; part < 1024; ++part) EXPECT_EQ(cut(Time{}, Time{1023}, part, 1024).ns, part);
  Time last{-5};
  for (int part = 0; part < 512; ++part) {
    const Time end = cut(Time{-5}, Time{1018}, part, 512);
    EXPECT_GE((end - last).ns, 1);
    EXPECT_LE((end - last).ns, 2);
    last = end;
  }
  EXPECT_EQ(last.ns, 1018);
}

TEST(Schedule, CutsTheLongestIntervals) {
  const Time end{9'000'000'000'000'000'000};
  EXPECT_EQ(cut(Time{}, end, 2, 4).ns, 6'750'000'000'000'000'000);
  EXPECT_EQ(cut(Time{}, end, 1023, 1024), end);
  EXPECT_EQ(cut(Time{}, end, 2'999'999'999'999, 9'000'000'000'000).ns, 3'000'000'000'000'000'000);
}

TEST(Schedule, FindsThePartInWhichATimeLies) {
  const Time a{10}, b{17};  // halves [10, 13.5), [13.5, 17]
  EXPECT_EQ(part_at(a, b, Time{13}, 2), 0);
  EXPECT_EQ(part_at(a, b, Time{14}, 2), 1);
  EXPECT_EQ(part_at(a, b, b, 2), 1);
  EXPECT_EQ(part_at(Time::from_seconds(-9e9), Time::from_seconds(9e9), Time{}, 1000), 500);
}

/// The number of ticks of a scenario from `start` to `stop`, s.
std::int64_t ticks_of(double start, double stop, std::int64_t tick_ns) {
  Build b;
  b.unit("p", "probe");
  b.scenario.start = Time::from_seconds(start);
  b.scenario.stop = Time::from_seconds(stop);
  b.scenario.tick.ns = tick_ns;
  const auto members = load_members(b.scenario, ::cotwin::testing::test_types(), {});
  return Schedule(b.scenario, members, arrange_as_given(members)).ticks();
}

TEST(Schedule, CountsTheTicksOfTheLongestRuns) {
  EXPECT_EQ(ticks_of(0, 9e9, 1), 9'000'000'000'000'000'000);
  EXPECT_EQ(ticks_of(-9e9, 1, 1'000'000'000), 9'000'000'001);
  EXPECT_EQ(ticks_of(0, 9.2e9, 9'200'000'000'000'000'001), 1);
  EXPECT_EQ(ticks_of(0, 9.2e9, 9'199'999'999'999'999'999), 2);
}

TEST(Schedule, RefusesASpanThatNanosecondsIn64BitsCannotHold) {
  EXPECT_EQ(error_of([] { ticks_of(-9e9, 9e9, 1'000'000'000); }),
            "test.ssd: the run would last from -9000000000 s to 9000000000 s, 18000000000 s, expected at most "
            "9223372036.85 s");
  EXPECT_THAT(error_of([] { ticks_of(-1e9, 9e9, 1'000'000'000); }), HasSubstr("10000000000 s, expected at most"));
}

/// Energy after 2 s over energy at the start, of two masses and a spring between them (no friction: 1 is exact).
double energy_ratio(std::int64_t tick_ns, int stage_of_b) {
  Build b;
  b.unit("a", "oscillator_a", 0).unit("b", "oscillator_b", stage_of_b);
  b.connect("b.q", "a.q").connect("a.tau", "b.tau").until(2);
  b.scenario.tick = Duration{tick_ns};
  Master master = b.load();
  master.initialise();
  const auto energy = [&] {
    const double tau = value(master, "a.tau"), v = value(master, "a.dtheta"), w = value(master, "b.dq");
    return 0.5 * tau * tau / cotwin::testing::OscillatorA::kK + 0.5 * v * v + 0.5 * w * w;
  };
  const double at_start = energy();
  while (master.step_tick()) {
  }
  return energy() / at_start;
}

TEST(Schedule, RampedInputsInTwoStagesKeepTheEnergyOfAStiffPair) {
  // The remaining error is that of the first step, where the slope of q is not known yet.
  EXPECT_NEAR(energy_ratio(100'000, 1), 1, 1e-3);
  EXPECT_NEAR(energy_ratio(10'000, 1), 1, 1e-5);
}

TEST(Schedule, CouplingErrorFallsWithTheSquareOfTheTickOrFaster) {
  const double coarse = std::abs(energy_ratio(200'000, 1) - 1), fine = std::abs(energy_ratio(100'000, 1) - 1);
  EXPECT_LT(fine, coarse / 3.5);
}

}  // namespace
}  // namespace cotwin::master::schedule_test
