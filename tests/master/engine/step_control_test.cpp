#include "master/engine/step_control.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "master/twin/twin.h"
#include "tests/master/test_units.h"

namespace cotwin::master::step_control_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Pair;

void to_the_end(Master& master) {
  master.initialise();
  while (master.step_tick()) {
  }
}

TEST(StepControl, ADiscardedStepIsDividedForAllUnits) {
  // ẋ = −50 x by explicit Euler in steps of 0.25 ms from t = 5 ms on: 5 steps of 1 ms, then 4 per ms.
  Build b;
  b.unit("before", "probe").unit("p", "picky").with("longest", 0.3e-3).with("from", 0.005).unit("after", "probe").until(0.01);
  Master master = b.load();
  to_the_end(master);
  EXPECT_DOUBLE_EQ(value(master, "p.y"), std::pow(1 - 0.05, 5) * std::pow(1 - 0.0125, 20));
  EXPECT_EQ(value(master, "before.steps"), 5 + 20);
  EXPECT_EQ(value(master, "after.steps"), 5 + 20);
  EXPECT_DOUBLE_EQ(value(master, "after.t"), 0.01);
  const Summary s = master.summary();
  EXPECT_EQ(s.discarded, 5);
  EXPECT_THAT(s.discarded_by, ElementsAre(Pair("p", 5)));
  EXPECT_EQ(s.most_parts, 4);
}

// The same scenario as one unit, with an input that its host changes between the ticks: the ticks since the last checkpoint are
// repeated with the values that the host had written before each of them.
TEST(StepControl, OfAScenarioAsOneUnitIsThatOfTheMaster) {
  Build b;
  b.unit("i", "integrator").unit("p", "picky").with("longest", 0.3e-3).with("from", 0.045).until(1);
  Master master = b.load();
  Twin twin(b.scenario, load_members(b.scenario, ::cotwin::testing::test_types(), {}), {"i.y", "p.y"});
  Variables v;
  twin.declare(v);
  ASSERT_EQ(v.at("i.u").role, Role::kInput);
  master.initialise();
  twin.initialise(Time{});
  for (int n = 0; n < 100; ++n) {
    const double u = std::sin(0.1 * n);
    v.at("i.u").reals()[0] = u;
    find_signal(master.members(), "i.u", "").reals()[0] = u;
    master.step_tick();
    ASSERT_EQ(twin.step(Time{n * 1'000'000}, Duration{1'000'000}), StepResult::kDone);
    ASSERT_EQ(v.at("p.y").reals()[0], value(master, "p.y")) << n;
  }
  // ∫u of the host's steps, also with repeated ticks; the master of a run has no host that writes between its ticks.
  double expected = 0;
  for (int n = 0; n < 100; ++n) expected += 1e-3 * std::sin(0.1 * n);
  EXPECT_NEAR(v.at("i.y").reals()[0], expected, 1e-15);
  std::vector<std::string> notes;
  twin.append_notes(notes);
  EXPECT_THAT(notes, ElementsAre("p discarded 55 ticks, made in up to 4 parts"));
}

// The master repeats the ticks since its last checkpoint, which may be 256 ticks back. values_changed() makes it take a
// checkpoint with what its host has written.
TEST(StepControl, ARepeatedTickBeginsWithTheValuesThatTheHostHasSet) {
  Build b;
  b.unit("i", "integrator").unit("p", "picky").with("longest", 0.3e-3).with("from", 0.045).until(1);
  Master master = b.load();
  master.initialise();
  double expected = 0;  // ∫u, where u changes every 10 ticks
  for (int n = 0; n < 100; ++n) {
    const double u = std::sin(static_cast<double>(n / 10));
    if (n % 10 == 0) {
      find_signal(master.members(), "i.u", "").reals()[0] = u;
      master.values_changed();
    }
    master.step_tick();
    expected += 1e-3 * u;
    ASSERT_NEAR(value(master, "i.y"), expected, 1e-15) << n;
  }
  EXPECT_EQ(master.summary().discarded, 55);
}

TEST(StepControl, OfAScenarioAsOneUnitGivesUpWhereNoPartIsShortEnough) {
  Build b;
  b.unit("i", "integrator").with("u", 1.0).unit("p", "picky").with("longest", 1e-9).with("from", 0.002).until(1);
  Twin twin(b.scenario, load_members(b.scenario, ::cotwin::testing::test_types(), {}), {"i.y"});
  Variables v;
  twin.declare(v);
  twin.initialise(Time{});
  EXPECT_EQ(twin.step(Time{}, Duration{2'000'000}), StepResult::kDone);
  EXPECT_EQ(twin.step(Time{2'000'000}, Duration{1'000'000}), StepResult::kDiscard);
  EXPECT_DOUBLE_EQ(v.at("i.y").reals()[0], 0.002);  // as before the step
}

TEST(StepControl, ComesBackFromFarBehindTheLastCheckpoint) {
  // 700 ticks without discarded steps, with an event and a ramp; only the master's replay can go back.
  Build b;
  b.unit("i", "integrator").with("u", 1.0).unit("p", "picky").with("longest", 0.6e-3).with("from", 0.7);
  b.event(0.1, "i.u", "-3").event(0.6, "i.u", "5", 0.2).until(1);
  b.scenario.recording = {};
  Build plain;
  plain.unit("i", "integrator").with("u", 1.0).event(0.1, "i.u", "-3").event(0.6, "i.u", "5", 0.2).until(1);
  Master master = b.load(), reference = plain.load();
  master.initialise();
  reference.initialise();
  while (master.step_tick()) {
    reference.step_tick();
    // The ramp is sampled at the parts of a tick: equal until 0.7 s bit for bit, then within the rise of the ramp in half a
    // tick.
    if (master.now().seconds() <= 0.7) {
      ASSERT_EQ(value(master, "i.y"), value(reference, "i.y"));
    } else {
      ASSERT_NEAR(value(master, "i.y"), value(reference, "i.y"), 0.1 * 40 * 1e-3);
    }
  }
  EXPECT_EQ(master.summary().discarded, 300);
}

TEST(StepControl, AUnitThatCannotBeTakenBackMakesADiscardedStepAnError) {
  Build b;
  b.unit("robot", "picky?restorable=false").unit("p", "picky").with("longest", 0.3e-3).with("from", 0.005);
  Master master = b.load();
  EXPECT_EQ(error_of([&] { to_the_end(master); }),
            "'p' discarded its step at t = 0.005 s, which cannot be repeated: 'robot' cannot be restored");
}

TEST(StepControl, GivesUpWhenNoPartIsSmallEnough) {
  Build b;
  b.unit("p", "picky").with("longest", 1e-9);
  Master master = b.load();
  EXPECT_EQ(error_of([&] { to_the_end(master); }), "'p' discarded its step at t = 0 s even at 1/1024 of the tick");
}

TEST(StepControl, APartHasAtLeastOneNanosecond) {
  // 1023 ns in parts of at most 20 ns are 64 parts: 1 of 15 ns and 63 of 16 ns (explicit Euler of ẋ = −50 x).
  Build b;
  b.unit("p", "picky").with("longest", 20e-9).unit("n", "probe");
  b.scenario.tick.ns = 1023;
  b.scenario.stop.ns = 2 * 1023;
  Master master = b.load();
  to_the_end(master);
  EXPECT_EQ(master.summary().most_parts, 64);
  EXPECT_EQ(value(master, "n.steps"), 2 * 64);
  const double per_tick = (1 - 50 * 15e-9) * std::pow(1 - 50 * 16e-9, 63);
  EXPECT_NEAR(value(master, "p.y"), per_tick * per_tick, 1e-14);

  Build short_ticks;  // of 3 ns: at most two parts, of 1 and 2 ns
  short_ticks.unit("p", "picky").with("longest", 1.5e-9).unit("n", "probe");
  short_ticks.scenario.tick.ns = 3;
  short_ticks.scenario.stop.ns = 6;
  Master gives_up = short_ticks.load();
  EXPECT_THAT(error_of([&] { to_the_end(gives_up); }), HasSubstr("'p' discarded its step at t = 0 s"));
  EXPECT_EQ(value(gives_up, "n.steps"), 0);
}

TEST(StepControl, AToleranceMakesNoPartOfLessThanANanosecond) {
  // The loop of ATickIsCutUntilTheToleranceIsKept with a tolerance that is never kept: every step has one nanosecond.
  Build b;
  b.unit("i", "integrator").with("start", 1.0).unit("g", "gain").with("gain", -1e6).unit("n", "probe");
  b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is();
  b.scenario.tick.ns = 5;
  b.scenario.stop.ns = 11;
  b.scenario.tolerance = 1e-15;
  Master master = b.load();
  to_the_end(master);
  EXPECT_EQ(value(master, "n.steps"), 11);
  EXPECT_EQ(value(master, "n.h"), 1e-9);
  EXPECT_EQ(master.summary().most_parts, 5);
}

TEST(StepControl, AScenarioAsOneUnitCutsAStepIntoTicksOfEqualLength) {
  // 1,999,999 ns in ticks of at most 1000 ns: 2000 ticks of 999 or 1000 ns.
  Build b;
  b.unit("n", "probe").unit("p", "picky").with("longest", 1.0001e-6);
  b.scenario.tick.ns = 1000;
  Twin twin(b.scenario, load_members(b.scenario, ::cotwin::testing::test_types(), {}), {"n.h", "n.steps", "p.h"});
  Variables v;
  twin.declare(v);
  twin.initialise(Time{});
  ASSERT_EQ(twin.step(Time{}, Duration{1'999'999}), StepResult::kDone);
  EXPECT_EQ(v.at("n.steps").integers()[0], 2000);
  EXPECT_EQ(v.at("n.h").reals()[0], 1e-6);
}

TEST(StepControl, ATickIsCutUntilTheToleranceIsKept) {
  // A loop of two units in one stage: ẋ = u, u = −30 x one tick late. The exact solution is e^(−30 t); Jacobi's error decreases
  // with the length of the parts.
  const auto error_with = [](double tolerance) {
    Build b;
    b.unit("i", "integrator").with("start", 1.0).unit("g", "gain").with("gain", -30.0);
    b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is().until(0.1);
    b.scenario.tick = Duration{10'000'000};
    b.scenario.tolerance = tolerance;
    b.scenario.coupling = CouplingChoice::kExplicit;
    Master master = b.load();
    to_the_end(master);
    EXPECT_EQ(tolerance > 0, master.summary().mean_parts > 1);
    return std::abs(value(master, "i.y") - std::exp(-3.0));
  };
  const double held = error_with(0), loose = error_with(1e-2), tight = error_with(1e-3);
  EXPECT_LT(loose, held / 3);
  EXPECT_LT(tight, loose / 3);
}

TEST(StepControl, PartsGrowAgainAfterSuccessfulSteps) {
  Build b;
  b.unit("i", "integrator").with("start", 1.0).unit("g", "gain").with("gain", -30.0);
  b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is().until(20);
  b.scenario.tick = Duration{10'000'000};
  b.scenario.tolerance = 1e-3;
  Master master = b.load();
  to_the_end(master);
  EXPECT_GT(master.summary().most_parts, 8);
  EXPECT_LT(master.summary().mean_parts, 4);  // x has decayed after a hundredth of the run; two parts are the minimum
}

// It makes one step over each tick, whatever the others do; the summary says so.
TEST(StepControl, WithAToleranceAUnitThatCannotBeTakenBackStepsOnceInATick) {
  Build b;
  b.unit("robot", "picky?restorable=false").unit("i", "integrator").with("start", 1.0).unit("g", "gain").with("gain", -30.0);
  b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is().until(0.1);
  b.scenario.tick = Duration{10'000'000};
  b.scenario.tolerance = 1e-3;
  Master master = b.load();
  to_the_end(master);
  EXPECT_NEAR(value(master, "robot.y"), std::pow(1 - 0.5, 10), 1e-15);
  EXPECT_NEAR(value(master, "i.y"), std::exp(-3.0), 1e-3);
  EXPECT_GT(master.summary().mean_parts, 2);
  EXPECT_THAT(master.summary().notes,
              ::testing::Contains(HasSubstr("'robot' cannot be restored: it makes one step in each tick")));
}

/// x = ∫u, u linear over a step; it cannot be taken back.
class Robot final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "1", "what it follows").rate(du_);
    v.output("y", y_, "s", "integral");
  }
  void initialise(Time) override { y_ = 0; }
  StepResult step(Time, Duration h) override {
    y_ += h.seconds() * (u_ + du_ * h.seconds() / 2);
    return StepResult::kDone;
  }
  bool restorable() const override { return false; }

 private:
  double u_ = 0, du_ = 0, y_ = 0;
};

/// y = t, exactly.
class Watch final : public Unit {
 public:
  void declare(Variables& v) override { v.output("y", y_, "1", "time"); }
  void initialise(Time start) override { y_ = start.seconds(); }
  StepResult step(Time now, Duration h) override {
    y_ = (now + h).seconds();
    return StepResult::kDone;
  }

 private:
  double y_ = 0;
};

TEST(StepControl, AUnitThatCannotBeTakenBackFollowsItsInputs) {
  static const UnitType kTypes[] = {
      {"robot", "∫u", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Robot>(); }},
      {"watch", "t", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Watch>(); }}};
  for (const double tolerance : {0.0, 1e-3}) {
    for (const int stage : {0, 1}) {
      Build b;
      b.unit("robot", "robot", stage).unit("watch", "watch").connect("watch.y", "robot.u").until(1);
      b.scenario.tolerance = tolerance;
      MasterOptions options;
      options.types = kTypes;
      Master master(b.scenario, std::move(options));
      to_the_end(master);
      const double first_tick = stage == 0 || tolerance > 0 ? 1e-6 : 1e-12;  // its slope is not known before the first step
      EXPECT_NEAR(value(master, "robot.y"), 0.5, first_tick) << tolerance << " " << stage;
    }
  }
}

TEST(StepControl, ADiscardOnAnotherThreadIsNotLost) {
  Build b;
  b.unit("robot", "picky?restorable=false").with("longest", 1e-9).unit("other", "probe").unit("third", "probe");
  MasterOptions options;
  options.types = ::cotwin::testing::test_types();
  options.threads = 2;
  options.always_threads = true;
  Master master(b.scenario, std::move(options));
  EXPECT_THAT(error_of([&] { to_the_end(master); }), HasSubstr("'robot' discarded its step at t = 0 s"));
}

TEST(StepControl, WithAToleranceTheRunEndsWhereAUnitAsksForIt) {
  Build b;
  b.unit("brief", "brief").unit("i", "integrator").with("start", 1.0).unit("g", "gain").with("gain", -30.0);
  b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is().until(1);
  b.scenario.tick = Duration{100'000'000};
  b.scenario.tolerance = 1e-3;
  Master master = b.load();
  to_the_end(master);
  EXPECT_EQ(value(master, "brief.steps"), 3);
  EXPECT_EQ(master.tick(), 1);
}

TEST(StepControl, ARunWithoutDiscardedStepsIsNotChangedByIt) {
  Build b;
  b.unit("p", "picky").until(2);
  Master master = b.load();
  to_the_end(master);
  EXPECT_EQ(master.summary().discarded, 0);
  EXPECT_EQ(master.summary().most_parts, 1);
}

}  // namespace
}  // namespace cotwin::master::step_control_test
