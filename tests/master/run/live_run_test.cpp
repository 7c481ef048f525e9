// A run that other threads watch and influence: bus::LiveRun.
#include "components/bus/live_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "models/foundation/support/text.h"
#include "tests/master/run/observed_run.h"
#include "tests/master/run/simulated_source.h"
#include "tests/master/test_units.h"
#include "tests/support/allocations.h"

namespace cotwin::master::live_run_test {
namespace {

using bus::LiveRun;
using bus::RunPhase;
using bus::RunReply;
using bus::RunVerb;
using testing::Build;
using testing::error_of;

/// A request that is answered by the next call of step_tick.
LiveRun::Answer ask(Master& master, LiveRun::Control& control) {
  master.step_tick();
  const auto answer = control.take();
  EXPECT_TRUE(answer);
  return answer.value_or(LiveRun::Answer{RunReply::kEnded, -1});
}

TEST(LiveRun, ListsTheVariablesOfTheRun) {
  Build b = gain_and_integral();
  b.unit("m", "mixed");
  Observer o;
  const Master master = load(b, o);
  const auto gain = o.run->find("g.gain");
  EXPECT_EQ(gain.signal->role, Role::kTunable);
  EXPECT_EQ(gain.signal->min, -1e6);
  EXPECT_TRUE(gain.signal->settable());
  EXPECT_EQ(gain.signal->start, std::vector<double>{1});
  EXPECT_FALSE(o.run->find("i.u").signal->settable());     // a connection feeds it
  EXPECT_FALSE(o.run->find("g.bias").signal->settable());  // a parameter
  EXPECT_EQ(o.run->find("i.u").signal->si, "rad/s");
  EXPECT_FALSE(o.run->find("m.string").signal->settable());
  EXPECT_EQ(o.run->facts().ticks, 1'000'000'000);
  EXPECT_EQ(o.run->position().phase, RunPhase::kRunning);
}

TEST(LiveRun, NobodyObservesARunWithoutObservers) {
  Master master = gain_and_integral(0.01).load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.summary().influence.count(), 0);
}

TEST(LiveRun, AWatchSeesEveryTickWithItsValues) {
  Build b = gain_and_integral();
  b.unit("p", "probe");
  Observer o;
  Master master = load(b, o);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y", "p.odd", "p.steps", "g.u"});
  LiveRun::Sample sample;
  for (int tick = 1; tick <= 100; ++tick) {
    master.step_tick();
    ASSERT_TRUE(watch.take(sample));
    EXPECT_EQ(sample.tick, tick);
    EXPECT_EQ(sample.time, Time{tick * 1'000'000});
    const std::vector<double> expected{testing::value(master, "i.y"), double(tick % 2), double(tick), 1};
    EXPECT_EQ(sample.values, expected);
    EXPECT_NEAR(sample.values[0], 1e-3 * tick, 1e-12);
    ASSERT_FALSE(watch.take(sample));
  }
}

TEST(LiveRun, AWatchAsksForEveryNthTickOrForSingleRecords) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  const std::vector<std::string> names{"i.y"};
  LiveRun::Watch third(o.run, names, 3), fifth(o.run, names, 5), asked(o.run, names, 0);
  std::vector<std::int64_t> thirds, fifths;
  LiveRun::Sample sample;
  for (int tick = 1; tick <= 30; ++tick) {
    master.step_tick();
    while (third.take(sample)) thirds.push_back(sample.tick);
    while (fifth.take(sample)) fifths.push_back(sample.tick);
  }
  // The first record comes at once, then one per interval.
  EXPECT_EQ(thirds, (std::vector<std::int64_t>{1, 3, 6, 9, 12, 15, 18, 21, 24, 27, 30}));
  EXPECT_EQ(fifths, (std::vector<std::int64_t>{1, 5, 10, 15, 20, 25, 30}));
  asked.request();
  master.step_tick();
  ASSERT_TRUE(asked.pop_newest(sample));
  EXPECT_EQ(sample.tick, 31);
}

TEST(LiveRun, OnlyRequestedRecordsCostTheLoopACopy) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y"}, 0);
  for (int i = 0; i < 100; ++i) master.step_tick();
  LiveRun::Sample sample;
  int records = 0;
  while (watch.take(sample)) ++records;
  EXPECT_EQ(records, 1);
}

TEST(LiveRun, WatchesComeAndGoAndKeepTheirValues) {
  Build b;
  b.unit("g", "gain?n=40").unit("p", "probe").until(1e6);
  Observer o;
  Master master = load(b, o);
  std::mt19937 random(7);
  std::vector<std::pair<std::unique_ptr<LiveRun::Watch>, std::vector<std::string>>> watches;
  for (int tick = 1; tick <= 2000; ++tick) {
    for (double& u : find_signal(master.members(), "g.u", "").reals()) u = double(random() % 1000);
    if (random() % 3 == 0 && watches.size() < 8) {
      std::vector<std::string> names;
      for (unsigned n = 0; n < 1 + random() % 20; ++n) names.push_back("g.y[" + std::to_string(1 + random() % 40) + "]");
      names.push_back("p.steps");
      watches.emplace_back(std::make_unique<LiveRun::Watch>(o.run, names), names);
    }
    if (random() % 4 == 0 && !watches.empty()) watches.erase(watches.begin() + std::ptrdiff_t(random() % watches.size()));
    master.step_tick();
    for (auto& [watch, names] : watches) {
      LiveRun::Sample sample;
      ASSERT_TRUE(watch->take(sample)) << tick;
      ASSERT_EQ(sample.tick, tick);
      for (std::size_t i = 0; i < names.size(); ++i) {
        const Signal s = find_signal(master.members(), names[i], "");
        const double expected = names[i] == "p.steps" ? tick : s.reals()[0];
        ASSERT_EQ(sample.values[i], expected) << names[i] << " at tick " << tick;
      }
    }
  }
}

TEST(LiveRun, ASlowReaderLosesRecordsAndIsToldHowMany) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  const std::vector<std::string> names{"i.y"};
  LiveRun::Watch slow(o.run, names), dead(o.run, names);
  constexpr int kTicks = 20'000;
  for (int i = 0; i < kTicks; ++i) master.step_tick();
  LiveRun::Sample sample;
  std::int64_t taken = 0;
  while (slow.take(sample)) ++taken;
  EXPECT_EQ(sample.tick, kTicks);
  EXPECT_EQ(taken + static_cast<std::int64_t>(slow.lost()), kTicks);
  EXPECT_GT(slow.lost(), 0u);
}

TEST(LiveRun, AValueHoldsFromTheAnsweredTickOn) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 10; ++i) master.step_tick();
  control.set(std::vector<LiveRun::Change>{{"g.gain", {3}}});
  const auto answer = ask(master, control);
  EXPECT_EQ(answer.reply, RunReply::kDone);
  EXPECT_EQ(answer.tick, 10);
  EXPECT_EQ(testing::value(master, "g.y"), 3);  // of the 11th tick
  EXPECT_NEAR(testing::value(master, "i.y"), 10e-3 + 3e-3, 1e-12);
  EXPECT_EQ(o.run->position().changes, 1);
  const Influence i = master.summary().influence;
  ASSERT_EQ(i.changes.size(), 1u);
  EXPECT_EQ(i.changes[0].tick, 10);
  EXPECT_EQ(i.changes[0].time, 0.01);
  EXPECT_EQ(i.changes[0].name, "g.gain");
  EXPECT_EQ(i.changes[0].value, 3);
}

TEST(LiveRun, AllKindsAndSingleElementsAreSet) {
  Build b;
  b.unit("m", "mixed").unit("g", "gain?n=3").until(1);
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  control.set(std::vector<LiveRun::Change>{{"m.real", {-2.5}}, {"m.integer", {-7}}, {"m.boolean", {1}}, {"g.u[2]", {9}}});
  EXPECT_EQ(ask(master, control).reply, RunReply::kDone);
  EXPECT_EQ(testing::value(master, "m.real_out"), -2.5);
  EXPECT_EQ(testing::value(master, "m.integer_out"), -7);
  EXPECT_EQ(testing::value(master, "m.boolean_out"), 1);
  EXPECT_EQ(testing::value(master, "g.y[1]"), 0);
  EXPECT_EQ(testing::value(master, "g.y[2]"), 9);
  control.set(std::vector<LiveRun::Change>{{"g.u", {4}}});  // one for all elements
  ask(master, control);
  EXPECT_EQ(testing::value(master, "g.y[3]"), 4);
  EXPECT_EQ(master.summary().influence.changes[3].name, "g.u[2]");
}

TEST(LiveRun, RefusesWhatCannotBeSet) {
  Build b = gain_and_integral();
  b.unit("m", "mixed").unit("v", "gain?n=3").unit("w", "gain?n=1000");
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  const auto refusal = [&](const std::string& name, std::vector<double> values) {
    return error_of([&] { control.set(std::vector<LiveRun::Change>{{name, std::move(values)}}); });
  };
  const double nan = std::nan(""), inf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(refusal("g.gian", {1}), "run: there is no signal 'g.gian'; did you mean 'g.gain'?");
  EXPECT_EQ(refusal("", {1}), "run: there is no signal ''");
  EXPECT_EQ(refusal("v.u[4]", {1}), "run: 'v.u[4]': v.u has elements 1 to 3");
  EXPECT_EQ(refusal("v.u[0]", {1}), "run: 'v.u[0]': v.u has elements 1 to 3");
  EXPECT_EQ(refusal("v.u", {1, 2}), "run: v.u: 2 values, expected 1 or 3");
  EXPECT_EQ(refusal("v.u", {}), "run: v.u: 0 values, expected 1 or 3");
  EXPECT_EQ(refusal("g.gain", {nan}), "run: g.gain = nan, expected a finite number");
  EXPECT_EQ(refusal("g.gain", {inf}), "run: g.gain = inf, expected a finite number");
  EXPECT_EQ(refusal("g.gain", {2e6}), "run: g.gain = 2e+06, expected -1e+06 to 1e+06 1");
  EXPECT_EQ(refusal("m.integer", {0.5}), "run: m.integer = 0.5, expected an integer of 32 bits");
  EXPECT_EQ(refusal("m.integer", {3e9}), "run: m.integer = 3e+09, expected an integer of 32 bits");
  EXPECT_EQ(refusal("m.boolean", {2}), "run: m.boolean = 2, expected true or false");
  EXPECT_EQ(refusal("i.u", {1}), "run: 'i.u' is fed by a connection, expected a tunable or a free input that is no text");
  EXPECT_EQ(refusal("g.y", {1}), "run: 'g.y' is an output (real), expected a tunable or a free input that is no text");
  EXPECT_EQ(refusal("g.bias", {1}), "run: 'g.bias' is a parameter (real), expected a tunable or a free input that is no text");
  EXPECT_EQ(refusal("m.string", {1}),
            "run: 'm.string' is an input (string), expected a tunable or a free input that is no text");
  EXPECT_EQ(refusal("w.u", {1}), "run: more than 256 values in one request");
  EXPECT_EQ(error_of([&] { control.set({}); }), "run: no values to set");
  EXPECT_EQ(error_of([&] { LiveRun::Watch(o.run, std::vector<std::string>{"m.string"}); }),
            "run: 'm.string' is a text, expected a number or a boolean to watch");
  // A refused request leaves nothing behind.
  master.step_tick();
  EXPECT_EQ(master.summary().influence.count(), 0);
  EXPECT_EQ(testing::value(master, "g.y"), 1);
}

TEST(LiveRun, WatchesShareTheirPlacesAndAreLimited) {
  Build b;
  for (int i = 0; i < 5; ++i) b.unit("g" + std::to_string(i), "gain?n=1000");
  Observer o;
  Master master = load(b.until(1), o);
  const std::vector<std::string> four{"g0.y", "g1.y", "g2.y", "g3.y"}, fifth{"g4.y"};
  LiveRun::Watch first(o.run, four), second(o.run, four);
  EXPECT_EQ(error_of([&] { LiveRun::Watch(o.run, fifth); }), "run: more than 4096 values are watched");
  LiveRun::Watch third(o.run, std::vector<std::string>{"g4.y[1]"});  // what was refused left no place taken
  master.step_tick();
  LiveRun::Sample sample;
  EXPECT_TRUE(second.take(sample));
}

/// Runs `b` with changes of the gain at random ticks, then the same as events of the scenario.
void expect_repeated_by_events(Build b) {
  Observer o;
  Master live = load(b, o);
  LiveRun::Control control(o.run);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y"});
  std::mt19937 random(3);
  std::vector<double> watched;
  while (true) {
    if (random() % 10 == 0) control.set(std::vector<LiveRun::Change>{{"g.gain", {1e-3 * double(random() % 5000)}}});
    if (!live.step_tick()) break;
    (void)control.take();
    LiveRun::Sample sample;
    ASSERT_TRUE(watch.take(sample));
    watched.push_back(sample.values[0]);
  }
  const Influence influence = live.summary().influence;
  ASSERT_GT(influence.changes.size(), 20u);
  b.scenario.events.clear();
  for (const Influence::Change& c : influence.changes) {
    EventSpec event;
    event.time = Time::from_seconds(c.time);
    event.variable = c.name;
    event.value = text::to_text(c.value);
    event.place = "test.ssd:61";
    b.scenario.events.push_back(event);
  }
  Master again = b.load();
  again.initialise();
  for (std::size_t tick = 0; again.step_tick(); ++tick) ASSERT_EQ(testing::value(again, "i.y"), watched[tick]) << tick;
}

TEST(LiveRun, TheSameChangesAtTheSameTicksGiveTheSameBits) { expect_repeated_by_events(gain_and_integral(0.5)); }

TEST(LiveRun, ChangesAreRepeatedByEventsWhereTicksAreRepeatedInParts) {
  Build b = gain_and_integral(0.5);
  b.unit("p", "picky").with("longest", 0.0003).with("from", 0.1).connect("g.y", "p.u").as_it_is();
  expect_repeated_by_events(b);
}

TEST(LiveRun, ChangesAreRepeatedByEventsInStepsToATolerance) {
  Build b;
  b.unit("g", "gain").with("u", 1.0).unit("i", "ramped", 1).connect("g.y", "i.u").as_it_is().until(0.5);
  b.unit("a", "oscillator_a").unit("b", "oscillator_b").connect("a.tau", "b.tau").connect("b.q", "a.q");
  b.scenario.tolerance = 1e-4;
  expect_repeated_by_events(b);
}

TEST(LiveRun, AChangeEndsARampOfTheScenario) {
  Build b = gain_and_integral(0.1).event(0.01, "g.gain", "100", 0.05);
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 30; ++i) master.step_tick();
  ASSERT_GT(testing::value(master, "g.gain"), 10);
  control.set(std::vector<LiveRun::Change>{{"g.gain", {-5}}});
  ask(master, control);
  while (master.step_tick()) {
  }
  EXPECT_EQ(testing::value(master, "g.gain"), -5);
}

TEST(LiveRun, AValueCanWaitForItsTime) {
  Observer o;
  Master master = load(gain_and_integral(0.1), o);
  LiveRun::Control control(o.run);
  const auto at = [&](double seconds, double gain) {
    control.set(std::vector<LiveRun::Change>{{"g.gain", {gain}}}, Time::from_seconds(seconds));
    return ask(master, control);
  };
  EXPECT_EQ(at(0.0205, 2).tick, 21);  // the first tick that begins then or later
  EXPECT_EQ(at(0.010, 3).tick, 10);
  EXPECT_EQ(at(0.001, 9).reply, RunReply::kPast);  // two ticks have ended
  EXPECT_EQ(error_of([&] { (void)at(0.2, 1); }), "run: values at 0.2 s, expected a time from 0 s to before 0.1 s");
  std::vector<double> gains;
  while (master.step_tick()) gains.push_back(testing::value(master, "g.y"));
  for (std::size_t i = 0; i < gains.size(); ++i) {
    const std::size_t tick = i + 3;
    EXPECT_EQ(gains[i], tick >= 21 ? 2 : tick >= 10 ? 3 : 1) << tick;
  }
  EXPECT_EQ(master.summary().influence.refused, 1);
}

TEST(LiveRun, TooManyWaitingValuesAreRefused) {
  Build b;
  b.unit("g", "gain?n=256").until(10);
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 5; ++i) {
    control.set(std::vector<LiveRun::Change>{{"g.u", {double(i)}}}, Time::from_seconds(5));
    EXPECT_EQ(ask(master, control).reply, i < 4 ? RunReply::kDone : RunReply::kFull);
  }
  while (master.now() < Time::from_seconds(5.01)) master.step_tick();
  EXPECT_EQ(testing::value(master, "g.y[256]"), 3);
}

TEST(LiveRun, PausesStepsResumesAndStops) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 5; ++i) master.step_tick();
  control.command(RunVerb::kPause);
  EXPECT_EQ(ask(master, control).tick, 5);
  EXPECT_EQ(o.run->position().phase, RunPhase::kPaused);
  EXPECT_EQ(master.tick(), 5);
  // Values are set and watched in the pause, too.
  control.set(std::vector<LiveRun::Change>{{"g.gain", {2}}});
  EXPECT_EQ(ask(master, control).tick, 5);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"g.gain", "g.y"});
  LiveRun::Sample sample;
  master.step_tick();
  ASSERT_TRUE(watch.take(sample));
  EXPECT_EQ(sample.values, (std::vector<double>{2, 1}));
  EXPECT_EQ(master.tick(), 5);

  EXPECT_EQ(error_of([&] { control.command(RunVerb::kStep, 0); }), "run: 0 ticks, expected 1 or more");
  control.command(RunVerb::kStep, 3);
  EXPECT_EQ(ask(master, control).tick, 8);
  for (int i = 0; i < 4; ++i) master.step_tick();
  EXPECT_EQ(master.tick(), 8);
  EXPECT_EQ(o.run->position().phase, RunPhase::kPaused);
  EXPECT_EQ(o.run->position().time, Time{8'000'000});

  control.command(RunVerb::kResume);
  EXPECT_EQ(ask(master, control).tick, 8);
  for (int i = 0; i < 10; ++i) master.step_tick();
  EXPECT_EQ(master.tick(), 19);

  control.command(RunVerb::kStop);
  EXPECT_FALSE(master.step_tick());
  EXPECT_EQ(control.take()->tick, 19);
  master.finish();
  EXPECT_EQ(o.run->position().phase, RunPhase::kEnded);
  const Summary s = master.summary();
  EXPECT_TRUE(s.influence.stopped);
  EXPECT_EQ(s.influence.pauses, 2);
  EXPECT_EQ(s.warnings.back(), "the end of the run was asked for from outside at t = 0.019 s");
  EXPECT_EQ(error_of([&] { control.command(RunVerb::kResume); }), "run: it has ended");
}

TEST(LiveRun, TheWallClockStandsStillInAPause) {
  cotwin::testing::SimulatedHost host;
  Observer o;
  Master master = load(gain_and_integral(), o, std::make_unique<RealTimeClock>(Clock::kLate, host), &host);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 10; ++i) master.step_tick();
  control.command(RunVerb::kPause);
  ask(master, control);
  host.sleep_until(host.now() + 5'000'000'000);
  control.command(RunVerb::kResume);
  ask(master, control);
  const std::int64_t resumed = host.now(), tick = master.tick();
  for (int i = 0; i < 20; ++i) master.step_tick();
  EXPECT_EQ(master.summary().overruns, 0);  // it does not catch up
  EXPECT_NEAR(double(host.now() - resumed), 1e6 * double(master.tick() - tick), 2e6);
}

TEST(LiveRun, FindsItsEndAndNobodyWaitsForAnswersAfterIt) {
  Observer o;
  std::optional<Master> master(load(gain_and_integral(0.01), o));
  LiveRun::Control control(o.run);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y"});
  while (master->step_tick()) {
  }
  control.set(std::vector<LiveRun::Change>{{"g.gain", {3}}});
  master->finish();
  EXPECT_EQ(control.wait(soon())->reply, RunReply::kEnded);
  master.reset();
  LiveRun::Sample sample, last;
  while (watch.take(sample)) last = sample;
  EXPECT_EQ(last.tick, 10);
  EXPECT_NEAR(last.values[0], 0.01, 1e-12);
  EXPECT_EQ(error_of([&] { control.set(std::vector<LiveRun::Change>{{"g.gain", {3}}}); }), "run: it has ended");
}

TEST(LiveRun, ARunThatIsNotFinishedEndsForItsWatchersWithItsMaster) {
  Observer o;
  {
    Master master = load(gain_and_integral(), o);
    master.step_tick();
  }
  EXPECT_EQ(o.run->position().phase, RunPhase::kEnded);
}

TEST(LiveRun, ARunOfThreeHundredYearsIsWatched) {
  Observer o;
  Master master = load(gain_and_integral(9e9), o);
  LiveRun::Watch watch(o.run, std::vector<std::string>{"i.y"});
  LiveRun::Control control(o.run);
  control.command(RunVerb::kStep, std::numeric_limits<std::int64_t>::max());
  ask(master, control);
  EXPECT_EQ(o.run->facts().ticks, 9'000'000'000'000);
  LiveRun::Sample sample;
  EXPECT_TRUE(watch.take(sample));
  EXPECT_EQ(o.run->position().phase, RunPhase::kRunning);
}

TEST(LiveRun, AComponentBesideTheLoopFollowsChanges) {
  Build b;
  b.unit("g", "gain").with("u", 1.0).until(0.1);
  b.scenario.components[0].beside = true;
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  for (int i = 0; i < 10; ++i) master.step_tick();
  control.set(std::vector<LiveRun::Change>{{"g.gain", {7}}});
  EXPECT_EQ(ask(master, control).tick, 10);
  master.step_tick();
  master.step_tick();
  EXPECT_EQ(testing::value(master, "g.y"), 7);
  master.finish();
}

TEST(LiveRun, AResumedRunKeepsTheChangesBeforeIt) {
  Build b = gain_and_integral(0.1);
  RunState state;
  std::vector<double> expected;
  std::int64_t saved = 0;
  {
    Observer o;
    Master master = load(b, o);
    LiveRun::Control control(o.run, "anna"), other(o.run, "bert");
    control.set(std::vector<LiveRun::Change>{{"g.gain", {3}}});
    ask(master, control);
    other.set(std::vector<LiveRun::Change>{{"g.gain", {4}}}, Time::from_seconds(0.05));
    ask(master, other);
    other.command(RunVerb::kStep, 1);
    ask(master, other);
    control.command(RunVerb::kResume);
    ask(master, control);
    for (int i = 0; i < 20; ++i) master.step_tick();
    saved = master.tick();
    master.save([&](RunState s) { state = std::move(s); });
    while (master.step_tick()) expected.push_back(testing::value(master, "i.y"));
  }
  ASSERT_FALSE(state.bytes.empty());
  Observer o;
  MasterOptions options;
  options.types = testing::test_types();
  options.observer = &o;
  options.resume = state;
  Master master(b.scenario, std::move(options));
  master.initialise();
  (void)o.run->number_of("anna");  // names have other numbers here
  EXPECT_EQ(master.tick(), saved);
  EXPECT_EQ(o.run->position().tick, saved);
  std::vector<double> again;
  while (master.step_tick()) again.push_back(testing::value(master, "i.y"));
  EXPECT_EQ(again, expected);
  const Influence i = master.summary().influence;
  ASSERT_EQ(i.changes.size(), 2u);
  EXPECT_EQ(i.changes[0].tick, 0);
  EXPECT_EQ(i.changes[1].tick, 50);
  EXPECT_EQ(i.changes[0].by, "anna");
  EXPECT_EQ(i.changes[1].by, "bert");
  ASSERT_EQ(i.commands.size(), 2u);
  EXPECT_EQ(i.commands[0].by, "bert");
  EXPECT_EQ(i.commands[0].verb, RunVerb::kStep);
  EXPECT_EQ(i.commands[1].by, "anna");
}

TEST(LiveRun, NamesThoseWhoSendRequestsInBoundedMemory) {
  Observer o;
  Master master = load(gain_and_integral(), o);
  EXPECT_EQ(o.run->names(), std::vector<std::string>{""});
  const std::uint32_t anna = o.run->number_of("anna");
  EXPECT_EQ(o.run->number_of("anna"), anna);
  for (int i = 0; i < 5000; ++i) (void)o.run->number_of(std::to_string(i));
  EXPECT_EQ(o.run->names().size(), LiveRun::kMostNames);
  EXPECT_EQ(o.run->names()[o.run->number_of("one more")], "others");
  EXPECT_EQ(o.run->number_of("anna"), anna);
}

TEST(LiveRun, ATickAllocatesNothingWhileItIsObserved) {
  Build b = gain_and_integral();
  b.unit("v", "gain?n=200");
  Observer o;
  Master master = load(b, o);
  LiveRun::Control control(o.run);
  std::optional<LiveRun::Watch> watch;
  std::uint64_t allocated = 0;
  for (int i = 0; i < 1000; ++i) {
    if (i % 7 == 0) watch.emplace(o.run, std::vector<std::string>{"v.y", "i.y"}, i % 3);
    const bool waits = i % 5 == 0;
    if (i % 2 == 0)
      control.set(std::vector<LiveRun::Change>{{"v.u", {double(i)}}},
                  waits ? std::optional(master.now() + Duration{3'000'000}) : std::nullopt);
    if (i % 22 == 3) control.command(RunVerb::kStep, 2);
    const std::uint64_t before = testing::allocations();
    master.step_tick();
    if (i > 300) allocated += testing::allocations() - before;
    (void)control.take();
    LiveRun::Sample sample;
    while (watch->take(sample)) {
    }
    if (o.run->position().phase == RunPhase::kPaused) {
      control.command(RunVerb::kResume);
      const std::uint64_t paused = testing::allocations();
      master.step_tick();
      allocated += testing::allocations() - paused;
      (void)control.take();
    }
  }
  EXPECT_EQ(allocated, 0u);
  EXPECT_GT(o.run->position().changes, 50'000);
}

}  // namespace
}  // namespace cotwin::master::live_run_test
