// The farm in this process: figures against closed forms and against a run alone, threads, stops, failures, limits.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "master/farm/farm.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/text.h"
#include "tests/master/farm/trial.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::master::farm_test {
namespace {

using cotwin::testing::columns;
using cotwin::testing::error_of;
using cotwin::testing::hooks;
using cotwin::testing::kBuild;
using cotwin::testing::kScenario;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::Trial;
using ::testing::HasSubstr;

double number(const std::string& text) { return text::parse_real(text).value_or(std::nan("")); }

TEST(Farm, KeepsFiguresOfEachRunByTheirClosedForms) {
  Trial trial(R"("runs": 40, "vary": {"tank.u": {"uniform": [-3, 3]}, "tank.start": {"normal": [0, 0.1]}},
    "keep": ["figures", "end tank.y", "min tank.y", "max tank.y", "peak tank.y"], "success": ["end tank.y>0", "peak tank.y<0.2"])");
  const Farm farm = trial.farm();
  EXPECT_EQ(farm.figures(),
            (std::vector<std::string>{"end tank.y", "min tank.y", "max tank.y", "peak tank.y", "rms level", "max level"}));
  Registry registry = trial.begin(farm);
  EXPECT_TRUE(farm.fill(registry, 2, hooks()));
  auto all = columns(registry);
  std::int64_t successes = 0;
  for (std::size_t i = 0; i < 40; ++i) {
    const double u = number(all["tank.u"][i]), start = number(all["tank.start"][i]), end = start + 0.05 * u;
    EXPECT_NEAR(number(all["end tank.y"][i]), end, 1e-12);
    EXPECT_NEAR(number(all["min tank.y"][i]), std::min(start, end), 1e-12);
    EXPECT_NEAR(number(all["max tank.y"][i]), std::max(start, end), 1e-12);
    EXPECT_NEAR(number(all["peak tank.y"][i]), std::max(std::abs(start), std::abs(end)), 1e-12);
    EXPECT_EQ(all["max level"][i], all["peak tank.y"][i]);
    double squares = 0;
    for (int k = 0; k <= 50; ++k) squares += std::pow(start + 0.001 * k * u, 2);
    EXPECT_NEAR(number(all["rms level"][i]), std::sqrt(squares / 51), 1e-9);
    const bool success = end > 0 && std::max(std::abs(start), std::abs(end)) < 0.2;
    EXPECT_EQ(all["success"][i], success ? "1" : "0");
    successes += success ? 1 : 0;
    EXPECT_EQ(all["time"][i], "0.05");
    EXPECT_EQ(all["state"][i], "done");
  }
  const Registry::Totals totals = registry.totals();
  EXPECT_EQ(totals.done, 40);
  EXPECT_EQ(totals.failed, 0);
  EXPECT_EQ(totals.judged, 40);
  EXPECT_EQ(totals.successes, successes);
  EXPECT_GT(successes, 0);
  EXPECT_LT(successes, 40);
  const auto spread = registry.spreads().front();
  EXPECT_EQ(spread.name, "end tank.y");
  EXPECT_EQ(spread.count, 40);
  EXPECT_LT(spread.min, spread.mean);
  EXPECT_LT(spread.mean, spread.max);
}

TEST(Farm, GivesTheSameBitsOnAnyThreadInAnyOrderAndResumed) {
  const char* members =
      R"("runs": 60, "vary": {"map.start": {"uniform": [0.1, 0.9]}}, "keep": ["end map.y", "peak map.y", "figures"])";
  std::map<std::string, std::vector<std::string>> first;
  for (const int threads : {1, 2, 5}) {
    const Trial trial(members);
    const Farm farm = trial.farm();
    Registry registry = trial.begin(farm);
    ASSERT_TRUE(farm.fill(registry, threads, hooks()));
    if (first.empty()) first = columns(registry);
    EXPECT_EQ(columns(registry), first) << threads;
  }
  // Each alone.
  const Trial trial(members);
  const Farm farm = trial.farm();
  for (const int run : {60, 1, 17}) {
    const RunRow row = farm.run(run, [] { return false; });
    EXPECT_EQ(text::to_text(row.figures[0]), first["end map.y"][static_cast<std::size_t>(run - 1)]);
  }
  // Stopped again and again.
  int sessions = 0;
  for (bool over = false; !over; ++sessions) {
    ASSERT_LT(sessions, 100);
    const std::unique_ptr<Registry> registry(sessions == 0 ? new Registry(trial.begin(farm))
                                                           : new Registry(trial.out(), false));
    std::atomic<int> asked = 0;
    over = farm.fill(*registry, 2, hooks([&asked] { return ++asked > 1000; }));
  }
  EXPECT_GT(sessions, 2);
  Registry registry(trial.out(), true);
  EXPECT_EQ(columns(registry), first);
}

TEST(Farm, KeepsRunsThatFailAndTellsOfTheFirst) {
  Trial trial(R"("set": [], "runs": 30, "vary": {"gear.after": {"uniform": [0, 0.1]}, "tank.u": {"uniform": [0, 1]}},
    "keep": ["end tank.y"], "success": "tank.y>0.02")");
  const Farm farm = trial.farm();
  Registry registry = trial.begin(farm);
  std::int64_t told = 0;
  EXPECT_TRUE(farm.fill(registry, 2,
                        {[] { return false; }, [&](std::int64_t, std::int64_t failed, const std::string&) { told = failed; }}));
  auto all = columns(registry);
  std::int64_t failed = 0;
  std::size_t first = 0;
  for (std::size_t i = 0; i < 30; ++i) {
    const double after = number(all["gear.after"][i]);
    const bool fails = after <= 0.049 + 1e-12;  // the last step begins there
    EXPECT_EQ(all["state"][i], fails ? "failed" : "done") << after;
    if (fails && failed == 0) first = i + 1;
    failed += fails ? 1 : 0;
    EXPECT_EQ(all["success"][i].empty(), fails);
    EXPECT_EQ(all["end tank.y"][i].empty(), fails);
    if (!fails) continue;
    EXPECT_THAT(all["message"][i], HasSubstr("gear.y[3] is nan"));
    EXPECT_NEAR(number(all["time"][i]), std::ceil(after * 1000) / 1000, 1.001e-3);
  }
  EXPECT_EQ(told, failed);
  EXPECT_EQ(registry.totals().failed, failed);
  EXPECT_EQ(registry.totals().judged, 30 - failed);
  const auto messages = registry.messages();
  ASSERT_EQ(messages.size(), 1u);  // they differ only in time
  EXPECT_TRUE(messages[0].failure);
  EXPECT_EQ(messages[0].runs, failed);
  EXPECT_EQ(messages[0].run, static_cast<std::int64_t>(first));
  EXPECT_EQ(messages[0].text, all["message"][first - 1]);
}

TEST(Farm, EndsARunWithoutEnd) {
  Trial trial(R"("runs": 2, "vary": {"tank.u": {"uniform": [0, 1]}}, "keep": ["end tank.y"], "limit_s": 0.05, "stop_s": 1e6,
    "set": "gear.after=1e9")");
  const RunRow row = trial.farm().run(1, [] { return false; });
  EXPECT_THAT(row.failure, HasSubstr("limit_s: the run has taken 0.05 s and is at t = "));
  EXPECT_TRUE(row.figures.empty());
  EXPECT_GT(row.time, 0);
}

TEST(Farm, CountsWarningsByKind) {
  std::string scenario = kScenario;
  scenario.replace(scenario.find("unit:faulty"), 11, "unit:brief");
  scenario.replace(scenario.find("0.05"), 4, "0.01");
  Trial trial(R"("runs": 5, "set": [], "vary": {"tank.u": {"uniform": [0, 1]}}, "keep": ["end tank.y"])", scenario);
  const Farm farm = trial.farm();
  Registry registry = trial.begin(farm);
  ASSERT_TRUE(farm.fill(registry, 2, hooks()));
  std::vector<std::string> texts;
  for (const auto& message : registry.messages()) {
    EXPECT_FALSE(message.failure);
    EXPECT_EQ(message.runs, 5);
    EXPECT_EQ(message.run, 1);
    texts.push_back(message.text);
  }
  EXPECT_THAT(texts, ::testing::Contains("gear: three steps only"));
  auto all = columns(registry);
  for (const std::string& count : all["warnings"]) EXPECT_EQ(count, std::to_string(texts.size()));
}

TEST(Farm, RefusesStudiesThatCannotRun) {
  const auto refused = [](const std::string& members, const std::string& scenario = kScenario) {
    return error_of([&] { Trial("\"runs\": 3, " + members, scenario).farm(); });
  };
  EXPECT_THAT(refused(R"("vary": {"tank.v": {"uniform": [0, 1]}})"),
              ::testing::AllOf(HasSubstr("tank.v=0.5: "), HasSubstr("'v'")));
  EXPECT_THAT(refused(R"("vary": {"tnak.u": {"uniform": [0, 1]}})"), HasSubstr("tnak"));
  EXPECT_THAT(refused(R"("vary": {"map.start": {"uniform": [0.5, 1.5]}})"), HasSubstr("map.start=1.5: "));
  EXPECT_THAT(refused(R"("vary": {"map.start": {"values": [0.5, 0.7, -2, 0.1]}})"), HasSubstr("map.start=-2: "));
  EXPECT_EQ(refused(R"("vary": {"map.start": {"normal": [0.5, 1]}})"), "");  // runs may fail
  EXPECT_THAT(refused(R"("vary": {"map.start": {"normal": [0.5, 1], "min": -1}})"), HasSubstr("map.start=-1: "));
  EXPECT_THAT(refused(R"("vary": {"tank.u": {"values": ["fast"]}})"), HasSubstr("fast"));
  const std::string vary = R"("vary": {"tank.u": {"uniform": [0, 1]}}, )";
  EXPECT_THAT(refused(vary + R"("keep": ["tank.y"])"), HasSubstr("keep tank.y: expected figures, or end, min, max or peak"));
  EXPECT_THAT(refused(vary + R"("keep": ["mean tank.y"])"), HasSubstr("'mean', expected one of end, min, max, peak"));
  EXPECT_THAT(refused(vary + R"("keep": ["end tank.z"])"), HasSubstr("keep end tank.z"));
  EXPECT_THAT(refused(vary + R"("keep": [])"), HasSubstr("nothing is kept"));
  EXPECT_THAT(refused(vary + R"("success": "gear.y>0")"),
              HasSubstr("has several elements, expected one of them, as in end gear.y[1]"));
  EXPECT_EQ(refused(vary + R"("success": "gear.y[2]>0")"), "");
  EXPECT_THAT(refused(vary + R"("success": "tank.y>")"), HasSubstr("success tank.y>"));
  EXPECT_THAT(refused(vary + R"("stop_s": 1e12)"), HasSubstr("stop_s"));
  std::string live = kScenario;
  live.replace(live.find("unit:faulty"), 11, "unit:picky?restorable=false");
  EXPECT_THAT(refused(R"("set": [], "vary": {"tank.u": {"uniform": [0, 1]}})", live),
              HasSubstr("component 'gear': reaches a robot, a bus or a network"));
}

TEST(Farm, OpensOneStudyForOneFarm) {
  const Trial trial(R"("runs": 3, "vary": {"tank.u": {"uniform": [0, 1]}})");
  const Farm farm = trial.farm();
  {
    Registry registry = trial.begin(farm);
    EXPECT_THAT(error_of([&] { Registry(trial.out(), false); }), HasSubstr("is in use by process"));
    Registry reader(trial.out(), true);
    EXPECT_EQ(reader.totals().done, 0);
    ASSERT_TRUE(farm.fill(registry, 1, hooks()));
    EXPECT_EQ(reader.totals().done, 3);
  }
  EXPECT_THAT(error_of([&] { trial.begin(farm); }), HasSubstr("has a study already"));
  EXPECT_THAT(error_of([&] { Registry(trial.folder.path(), true); }), HasSubstr("has no study"));
  // What a kill leaves at worst: an empty file, in which a study can begin.
  trial.folder.write("killed/farm.db", "");
  for (const bool reads : {true, false})
    EXPECT_THAT(error_of([&] { Registry(trial.folder / "killed", reads); }), HasSubstr("is empty, expected one of a study"));
  EXPECT_EQ(Registry(trial.folder / "killed", farm.facts(kBuild), {"tank.u"}, farm.figures()).totals().done, 0);
  EXPECT_EQ(Registry(trial.folder / "killed", false).totals().done, 0);
  trial.folder.write("other/farm.db", "this is no database, but long enough to be taken for one by its size alone");
  EXPECT_THAT(error_of([&] { Registry(trial.folder / "other", false); }), HasSubstr("is damaged or no SQLite database"));
}

TEST(Farm, TellsWhatHasChanged) {
  const Trial trial(R"("runs": 3, "vary": {"tank.u": {"uniform": [0, 1]}})");
  const Farm farm = trial.farm();
  Registry registry = trial.begin(farm);
  EXPECT_EQ(difference(registry.facts(), farm.facts(kBuild)), "");
  EXPECT_THAT(difference(registry.facts(), farm.facts({"0.2.0", 42, "test"})),
              HasSubstr("the program is cotwin 0.2.0 (build 000000000000002a), was cotwin 0.1.0"));
  EXPECT_EQ(difference(registry.facts(), farm.facts({"0.1.0", 42, "other"})), "the instruction set is other, was test");
  std::string changed = kScenario;
  changed.replace(changed.find("1 ms"), 4, "2 ms");
  trial.folder.write("plant.ssd", changed);
  EXPECT_THAT(difference(registry.facts(), trial.farm().facts(kBuild)), HasSubstr("the scenario is "));
}

TEST(Registry, NamesColumnsThatDifferOnlyInCase) {
  const TemporaryFolder folder("registry");
  Registry registry(folder.path(), {{"study", "s"}}, {"a.K", "a.k", "time"}, {"max a.K", "max a.K", "rms \"x\""});
  const std::int64_t session = registry.begin_session(this_process(1));
  RunRow row;
  row.run = 7;
  row.values = {"1", "text", "0.1"};
  row.figures = {1, std::nan(""), INFINITY};
  registry.add({&row, 1}, session);
  std::ostringstream out;
  registry.write(out);
  EXPECT_EQ(
      out.str(),
      "run,state,success,time,seconds,session,warnings,message,a.K,a.k (2),time (2),max a.K,max a.K (2),\"rms \"\"x\"\"\"\n"
      "7,done,,0,0,1,0,,1,text,0.1,1,,\n");
  EXPECT_THAT(error_of([&] { registry.over(6); }), HasSubstr("has a run 7, expected 1 to 6"));
  EXPECT_THAT(error_of([&] {
                Registry(folder / "large", {{"study", "s"}}, {}, std::vector<std::string>(2000, "x"));
              }),
              HasSubstr("gives 2000 figures of a run, expected at most 1900"));
}

}  // namespace
}  // namespace cotwin::master::farm_test
