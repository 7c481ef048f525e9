#include "master/run/master.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>

#include "components/unit/unit_table.h"
#include "master/results/summary.h"
#include "tests/master/test_units.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace cotwin::master::master_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

/// A scenario that uses everything that the loop does.
Build busy() {
  Build b;
  b.unit("i", "integrator").with("u", 1.0).unit("r", "ramped", 1).unit("g", "gain?n=7", 1, 3).unit("m", "mixed");
  b.unit("a", "oscillator_a").unit("b", "oscillator_b", 1).connect("b.q", "a.q").connect("a.tau", "b.tau");
  b.connect("i.y", "r.u").as_it_is();
  b.connect("i.y", "g.u[3]");
  b.event(0.1, "i.u", "2").event(0.2, "i.u", "-1", 0.3).event(0.3, "m.boolean", "true").event(0.4, "g.gain", "3", 0.1);
  b.record("*").until(2);
  b.scenario.reports.push_back({"", ReportKind::kSignal, "g.y", "", ""});
  b.scenario.comparisons.push_back({"c", "i.y", "a.theta", 8, {}, {}, ""});
  b.scenario.bonds.push_back({"spring", "a.tau", "b.dq", "b.tau", "b.dq", 0, ""});
  return b;
}

TEST(Master, TheLoopAllocatesNothingAlsoWhileItRecords) {
  const auto folder = std::filesystem::temp_directory_path() / ("cotwin_master_" + std::to_string(::getpid()));
  Build b = busy();
  Master master = b.load(folder);
  master.initialise();
  const std::uint64_t before = cotwin::testing::allocations();
  while (master.step_tick()) {
  }
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
  EXPECT_EQ(master.tick(), 2000);
  master.finish();
  EXPECT_EQ(master.summary().rows, 2001);
  std::filesystem::remove_all(folder);
}

TEST(Master, TheLoopAllocatesNothingWithDiscardedStepsAndWithATolerance) {
  for (const double tolerance : {0.0, 1e-3}) {
    Build b = busy();
    b.unit("p", "picky").with("longest", 0.6e-3).with("from", 0.7);
    b.scenario.tolerance = tolerance;
    Master master = b.load();
    master.initialise();
    const std::uint64_t before = cotwin::testing::allocations();
    while (master.step_tick()) {
    }
    EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
    if (tolerance == 0) {
      EXPECT_GT(master.summary().discarded, 0);
    }
  }
}

// In a run of fewer than 1024 ticks every tick is timed and none is a plain one; in a longer one most are plain.
TEST(Master, PlainTicksGiveTheSameBitsAsOthers) {
  const auto after_900_ticks = [](double until) {
    Build b;
    b.unit("i", "integrator").unit("g", "gain").unit("p", "picky").with("longest", 0.3e-3).with("from", 0.7);
    b.unit("probe", "probe", 1).connect("i.y", "g.u").until(until);
    b.event(0.3, "i.u", "2").event(0.6, "i.u", "5", 0.1).event(0.8005, "i.u", "-1");
    Master master = b.load();
    master.initialise();
    for (int i = 0; i < 900; ++i) EXPECT_TRUE(master.step_tick());
    std::vector<double> seen = {value(master, "i.y"), value(master, "g.y"), value(master, "p.y"), value(master, "probe.steps")};
    const Summary s = master.summary();
    seen.push_back(static_cast<double>(s.discarded));
    for (const Tally& tally : s.tallies) seen.insert(seen.end(), {tally.total_rms, tally.total_max});
    return seen;
  };
  const std::vector<double> looked_at = after_900_ticks(0.9), plain = after_900_ticks(5);
  EXPECT_EQ(looked_at, plain);
  EXPECT_EQ(plain[4], 200) << "each tick from 0.7 s on is discarded";
}

TEST(Master, TimesTheStepsOfEveryPeriodAsOftenAsTheyAreDue) {
  constexpr int kTicks = 500'000;
  Build b;
  b.scenario.tick = Duration{1'000};
  b.unit("1", "gain").unit("2", "gain", 0, 2).unit("3", "gain", 0, 3).unit("4", "gain", 0, 4).unit("10", "gain", 0, 10);
  b.until(kTicks * 1e-6);
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.tick(), kTicks);
  const Summary s = master.summary();
  const auto all = static_cast<double>(s.units[0].samples);
  ASSERT_GE(all, kTicks / 1021 - 1);
  ASSERT_LT(all, kTicks / 10) << "most ticks are not timed";
  for (const Summary::Share& unit : s.units) {
    const double due = all / std::stod(unit.name);
    EXPECT_NEAR(static_cast<double>(unit.samples), due, 0.3 * due) << "period " << unit.name;
  }
}

TEST(Master, PlainTicksReportNanErrorsAndTheEndAsOthersDo) {
  for (const bool throws : {false, true}) {
    Build b;
    b.unit("f", "faulty").with("after", 2.3456).with("throws", throws).until(5);
    Master master = b.load();
    master.initialise();
    const std::string what = error_of([&] {
      while (master.step_tick()) {
      }
    });
    EXPECT_THAT(what, HasSubstr(throws ? "f at t = 2.346 s: the gear has broken" : "f.y[3] is nan at t = 2.347 s"));
  }
  Build b;
  b.unit("b", "brief").unit("p", "probe").until(5);
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(value(master, "p.steps"), 3);
}

TEST(Master, SeveralRunSideBySide) {
  Build b;
  b.unit("i", "integrator").with("u", 1.0).until(0.1);
  Master one = b.load(), two = b.load();
  one.initialise();
  two.initialise();
  while (one.step_tick()) two.step_tick();
  EXPECT_EQ(value(one, "i.y"), value(two, "i.y"));
}

TEST(Master, ANanEndsTheRunAndNamesItsSource) {
  // In stage order the faulty unit is first, although the unit that reads from it is before it in the file.
  Build b;
  b.unit("victim", "gain", 1).unit("f", "faulty").with("after", 0.004).connect("f.y[3]", "victim.u").as_it_is();
  const auto message = [&] {
    Master master = b.load();
    master.initialise();
    return error_of([&] {
      while (master.step_tick()) {
      }
    });
  }();
  EXPECT_EQ(message, "f.y[3] is nan at t = 0.005 s, expected a finite output");
}

// Unless nobody but a monitor hears it, who stops the robot for a body that is lost.
TEST(Master, ANanOfASensorEndsTheRunOnlyWhereSomebodyElseHearsIt) {
  std::vector<UnitType> types(unit_types().begin(), unit_types().end());
  types.push_back(find_type("faulty", testing::test_types()));
  types.push_back(find_type("gain", testing::test_types()));
  for (const bool others : {false, true}) {
    Build b;
    b.unit("f", "faulty").with("after", 0.004);
    b.unit("monitor",
           "monitor?robot=planar2&separation=person&scene=" + std::string(places::source()) +
               "/examples/20_safety_hulls/person.sdf",
           1);
    b.scenario.connections.push_back({{"f", "y", ""}, {"monitor", "person.p", ""}, 1, 0, true, "test.ssd:41"});
    if (others) b.unit("g", "gain", 1).connect("f.y[3]", "g.u").as_it_is();
    MasterOptions options;
    options.types = types;
    options.folders = {std::filesystem::path(places::source()) / "models"};
    Master master(b.scenario, std::move(options));
    master.initialise();
    const std::string message = error_of([&] {
      while (master.step_tick()) {
      }
    });
    EXPECT_EQ(message, others ? "f.y[3] is nan at t = 0.005 s, expected a finite output" : "");
    EXPECT_EQ(value(master, "monitor.zone"), 2);
    EXPECT_EQ(value(master, "monitor.event_code"), 13);
  }
}

// Its source may be the loop and not the unit that computes it first.
TEST(Master, ANanInALoopNamesTheLoop) {
  Build b;
  b.unit("g", "gain", 1).with("gain", 0.5).unit("i", "gain").with("gain", 0.5).connect("g.y", "i.u").connect("i.y", "g.u");
  b.scenario.coupling = CouplingChoice::kExplicit;
  Master master = b.load();
  master.initialise();
  EXPECT_TRUE(master.step_tick());
  for (Member& member : master.members()) {
    if (member.name() == "g") member.variables().at("y").reals()[0] = std::nan("");
  }
  master.values_changed();
  EXPECT_THAT(
      error_of([&] {
        while (master.step_tick()) {
        }
      }),
      AllOf(HasSubstr("is nan at t = "), HasSubstr("; it is in the loop g, i, which is stepped explicitly: if its values "
                                                   "grow, expected coupling=implicit or a smaller tick")));
}

TEST(Master, AUnitThatThrowsIsNamedWithItsTime) {
  Build b;
  b.unit("f", "faulty").with("after", 0.004).with("throws", true);
  Master master = b.load();
  master.initialise();
  EXPECT_EQ(error_of([&] {
              while (master.step_tick()) {
              }
            }),
            "f at t = 0.004 s: the gear has broken");
}

TEST(Master, EndsWhenAUnitRequestsItAndShowsItsWarning) {
  Build b;
  b.unit("b", "brief").unit("p", "probe", 1).until(1);
  b.scenario.warnings.push_back("test.ssd:3: something was read leniently");
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(master.tick(), 3);
  EXPECT_EQ(value(master, "p.steps"), 3);  // every unit completes the tick
  EXPECT_THAT(master.summary().warnings, ElementsAre("test.ssd:3: something was read leniently",
                                                     "'b' asked for the end of the run at t = 0.003 s", "b: three steps only"));
}

TEST(Master, ANanAtTheStartIsAnError) {
  Build b;
  b.unit("i", "integrator").with("start", std::numeric_limits<double>::infinity());
  Master master = b.load();
  EXPECT_THAT(error_of([&] { master.initialise(); }), HasSubstr("i.y is inf at t = 0 s"));
}

/// Records the deadlines; never waits.
class FakeClock final : public Clock {
 public:
  explicit FakeClock(std::vector<std::int64_t>& deadlines) : deadlines_(deadlines) {}
  void start(Time now) override { deadlines_.push_back(-1 - now.ns); }
  bool wait(Time now) override {
    deadlines_.push_back(now.ns);
    return true;
  }

 private:
  std::vector<std::int64_t>& deadlines_;
};

TEST(Master, WaitsForTheClockBeforeEveryTick) {
  Build b;
  b.unit("p", "probe").until(0.003);
  std::vector<std::int64_t> deadlines;
  MasterOptions options;
  options.types = cotwin::testing::test_types();
  options.clock = std::make_unique<FakeClock>(deadlines);
  Master master(b.scenario, std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_THAT(deadlines, ElementsAre(-1, 0, 1'000'000, 2'000'000));
}

TEST(RealTimeClock, KeepsAbsoluteDeadlinesAndCountsLateTicks) {
  using Steady = std::chrono::steady_clock;
  RealTimeClock clock;
  const auto begin = Steady::now();
  clock.start(Time{500});
  clock.wait(Time{500 + 20'000'000});
  EXPECT_GE(Steady::now() - begin, std::chrono::milliseconds(20));
  std::this_thread::sleep_for(std::chrono::milliseconds(30));
  const std::int64_t before = clock.overruns();
  clock.wait(Time{500 + 21'000'000});  // already past: no wait, but counted
  EXPECT_EQ(clock.overruns(), before + 1);
  EXPECT_GE(clock.worst_delay().ns, 25'000'000);
  clock.wait(Time{500 + 80'000'000});  // and the next deadline is unchanged
  EXPECT_GE(Steady::now() - begin, std::chrono::milliseconds(80));
}

TEST(Report, HasTheSameContentsAsTextAndJson) {
  Build b = busy();
  b.scenario.name = "a \"busy\" one";
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  const Summary s = master.summary();

  std::ostringstream json_text;
  write_json(json_text, s, {});
  const auto json = nlohmann::json::parse(json_text.str());
  EXPECT_EQ(json["state"], "done");
  EXPECT_EQ(json["scenario"], "a \"busy\" one");
  EXPECT_EQ(json["ticks"], 2000);
  EXPECT_EQ(json["reached"], 2.0);
  EXPECT_EQ(json["signals"][0]["rms"].size(), 7u);
  EXPECT_EQ(json["comparisons"][0]["segment_rms"].size(), 8u);
  EXPECT_EQ(json["units"].size(), 6u);
  EXPECT_GT(json["real_time_factor"], 0.0);
  double shares = 0;
  for (const auto& unit : json["units"]) shares += unit["share"].get<double>();
  for (const auto& [part, share] : json["master"].items()) shares += share.get<double>();
  EXPECT_NEAR(shares, 1, 1e-12);
  EXPECT_GT(json["master"]["checks"], 0.0);
  EXPECT_GT(json["master"]["recording"], 0.0);

  std::ostringstream table;
  write_report(table, s, {});
  EXPECT_THAT(table.str(), HasSubstr("a \"busy\" one: 2 s in 2000 ticks of 1 ms, run in "));
  EXPECT_THAT(table.str(), HasSubstr("times real time"));
  EXPECT_THAT(table.str(), HasSubstr("\ng.y [rad]\n"));
  EXPECT_THAT(table.str(), HasSubstr("       [1]       [2]"));
  EXPECT_THAT(table.str(), HasSubstr("c [rad]: i.y - a.theta, t = 0 to 2 s\n"));
  EXPECT_THAT(table.str(), HasSubstr("RMS, part 8"));
  EXPECT_THAT(table.str(), Not(HasSubstr("nan")));
}

TEST(Report, ListsAtMostTwentyUnitsInTheTableOfTime) {
  Summary s;
  for (int i = 0; i < 200; ++i)
    s.units.push_back({"unit_with_a_long_name_" + std::to_string(i), 1e-6, i == 150 ? 0.801 : 0.001});
  std::ostringstream table;
  write_report(table, s, {});
  const std::string text = table.str();
  EXPECT_THAT(text, HasSubstr("unit_with_a_long_name_150       1 us    80.1 %\n"));
  EXPECT_THAT(text, HasSubstr("180 others"));
  EXPECT_THAT(text, HasSubstr("18 %\n"));
  EXPECT_LT(std::count(text.begin(), text.end(), '\n'), 30);
}

TEST(Report, ShowsValuesThatARunDidNotReachAsUnknown) {
  Build b;
  b.unit("a", "gain").unit("b", "gain").until(1);
  b.scenario.comparisons.push_back({"c", "a.y", "b.y", 4, {}, {}, ""});
  Master master = b.load();
  master.initialise();
  for (int i = 0; i < 300; ++i) master.step_tick();
  master.finish();
  std::ostringstream json_text;
  write_json(json_text, master.summary(), {Outcome::State::kInterrupted, ""});
  const auto json = nlohmann::json::parse(json_text.str());
  EXPECT_EQ(json["state"], "interrupted");
  EXPECT_TRUE(json["comparisons"][0]["segment_rms"][3][0].is_null());
  std::ostringstream table;
  write_report(table, master.summary(), {Outcome::State::kInterrupted, ""});
  EXPECT_THAT(table.str(), HasSubstr("test: interrupted at t = 0.3 s; 0.3 s in 300 ticks"));
}

TEST(Master, RefusesAStartValueThatInitialisationReplaces) {
  // x of the integrator is computed from `start`.
  Build b;
  b.unit("i", "integrator").with("x", 3.0);
  Master master = b.load();
  EXPECT_EQ(error_of([&] { master.initialise(); }),
            "test.ssd:50: 'i.x' is a state that its unit computes when it is initialised: the start value has no effect, "
            "expected a parameter, a tunable or an input");
  Build same;
  same.unit("i", "integrator").with("x", 3.0).with("start", 3.0);
  Master honoured = same.load();
  honoured.initialise();
  EXPECT_EQ(value(honoured, "i.y"), 3);
}

}  // namespace
}  // namespace cotwin::master::master_test
