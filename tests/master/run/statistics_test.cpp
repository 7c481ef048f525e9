#include "master/run/statistics.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>
#include <sstream>

#include "master/results/summary.h"
#include "tests/master/test_units.h"

namespace cotwin::master::statistics_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

Summary run(const Build& b) {
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  return master.summary();
}

TEST(Statistics, RmsAndLargestMagnitudeOfASignal) {
  // y is −1 at t = 0 … 4 ms and 3 at 5 … 10 ms (an event at 4 ms acts on the tick that ends at 5 ms): 11 samples.
  Build b;
  b.unit("a", "gain?n=2").with("u[1]", -1.0).event(0.004, "a.u[1]", "3");
  b.scenario.reports.push_back({"", ReportKind::kSignal, "a.y", "", ""});
  const Tally t = run(b).tallies.at(0);
  EXPECT_EQ(t.name, "a.y");
  EXPECT_EQ(t.si, "rad");
  EXPECT_DOUBLE_EQ(t.rms[0], std::sqrt((5 * 1 + 6 * 9) / 11.0));
  EXPECT_EQ(t.rms[1], 0);
  EXPECT_EQ(t.max[0], 3);
  EXPECT_DOUBLE_EQ(t.time_of_max[0], 0.005);
  EXPECT_DOUBLE_EQ(t.total_rms, std::sqrt((5 * 1 + 6 * 9) / 22.0));
  EXPECT_EQ(t.total_max, 3);
}

TEST(Statistics, OfElementsThatDifferThereIsNoTotalButOnePerKind) {
  Build b;
  b.unit("a", "arm").with("u[1]", 3.0).with("u[2]", 100.0).with("u[3]", 4.0).unit("c", "arm").unit("g", "gain?n=3");
  b.scenario.reports = {{"", ReportKind::kSignal, "a.y", "", ""}, {"slide", ReportKind::kDifference, "a.y[2]", "c.y[2]", ""}};
  ComparisonSpec comparison;
  comparison.name = "both";
  comparison.a = "a.y";
  comparison.b = "c.y";
  b.scenario.comparisons = {comparison};
  const Summary s = run(b);
  const Tally& t = s.tallies.at(0);
  EXPECT_EQ(t.si, "");
  EXPECT_THAT(t.elements.si, ElementsAre("rad", "m", "rad"));
  EXPECT_TRUE(std::isnan(t.total_rms) && std::isnan(t.total_max));
  EXPECT_EQ(s.tallies.at(1).si, "m");
  EXPECT_THAT(s.tallies.at(1).elements.names, ElementsAre("my, slide"));
  EXPECT_EQ(s.tallies.at(1).total_max, 100);
  std::ostringstream text, json;
  write_report(text, s, {});
  EXPECT_THAT(text.str(), HasSubstr("a.y [rad]\n" + std::string(25, ' ') +
                                    "elbow      roll       all\n  RMS                        3         4     3.536\n"));
  EXPECT_THAT(text.str(), HasSubstr("a.y [m]\n" + std::string(20, ' ') + "  my, slide\n  RMS                       100\n"));
  EXPECT_THAT(text.str(), HasSubstr("both [m]: a.y - c.y, t = "));
  write_json(json, s, {});
  const auto signal = nlohmann::json::parse(json.str()).at("signals").at(0);
  EXPECT_TRUE(signal.at("total_rms").is_null());
  EXPECT_EQ(signal.at("totals").at(1), nlohmann::json({{"unit", "m"}, {"rms", 100.0}, {"max", 100.0}}));
  b.scenario.reports = {{"", ReportKind::kDifference, "a.y", "g.y", "place"}};
  EXPECT_THAT(error_of([&] { b.load(); }), HasSubstr("place: a.y - g.y: m cannot be compared with rad"));
}

TEST(Statistics, ADifferenceIsTakenInTheMeasureOfTheFirst) {
  Build b;
  b.unit("a", "probe").unit("b", "gain").unit("c", "gain").with("u", 2.0);
  b.scenario.reports.push_back({"error", ReportKind::kDifference, "c.y", "b.y", ""});
  const Tally t = run(b).tallies.at(0);
  EXPECT_EQ(t.name, "error");
  EXPECT_EQ(t.what, "c.y - b.y");
  EXPECT_EQ(t.max[0], 2);
}

// A turn about x by 0.6, then one about the new z by 0.4, the second one seen from the first; a quaternion of the other sign or length is the same attitude.
TEST(Statistics, AnAttitudeIsTheRotationVectorBetweenTwoQuaternions) {
  Build b;
  b.unit("b", "gain?n=4").with("u[1]", std::cos(0.3)).with("u[2]", std::sin(0.3));
  b.unit("a", "gain?n=4").with("u[1]", -2 * std::cos(0.3) * std::cos(0.2)).with("u[2]", -2 * std::sin(0.3) * std::cos(0.2));
  b.with("u[3]", 2 * std::sin(0.3) * std::sin(0.2)).with("u[4]", -2 * std::cos(0.3) * std::sin(0.2));
  b.scenario.reports.push_back({"", ReportKind::kAttitude, "a.y", "b.y", ""});
  b.scenario.reports.push_back({"none", ReportKind::kAttitude, "b.y", "b.y", ""});
  const Summary s = run(b);
  const Tally& t = s.tallies.at(0);
  EXPECT_EQ(t.name, "attitude of a.y against b.y");
  EXPECT_EQ(t.si, "rad");
  ASSERT_EQ(t.max.size(), 3u);
  EXPECT_NEAR(t.max[0], 0, 1e-15);
  EXPECT_NEAR(t.max[1], 0, 1e-15);
  EXPECT_NEAR(t.max[2], 0.4, 1e-15);
  EXPECT_NEAR(t.rms[2], 0.4, 1e-15);
  EXPECT_EQ(s.tallies.at(1).total_max, 0);
}

TEST(Statistics, EnergyIsTheIntegralOfEffortTimesFlow) {
  // Two masses and a spring: the work of the spring torque on side b is the kinetic energy of b.
  Build b;
  b.unit("a", "oscillator_a").unit("b", "oscillator_b", 1).connect("b.q", "a.q").connect("a.tau", "b.tau").until(0.3);
  b.scenario.tick = Duration{10'000};
  b.scenario.reports.push_back({"work", ReportKind::kEnergy, "b.tau", "b.dq", ""});
  b.scenario.bonds.push_back({"spring", "a.tau", "b.dq", "b.tau", "b.dq", 1e-3, ""});
  b.scenario.bonds.push_back({"wrong", "a.tau", "a.dtheta", "b.tau", "b.dq", 1e-3, ""});
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  const Summary s = master.summary();
  const double v = cotwin::testing::value(master, "b.dq");
  const double amplitude = 0.5 * cotwin::testing::OscillatorA::kK * 1e-4;  // J: the energy at the start
  EXPECT_NEAR(s.works.at(0).value, 0.5 * v * v, 1e-4 * amplitude);
  EXPECT_NEAR(s.bonds.at(0).leak, 0, 1e-6 * amplitude);
  EXPECT_GT(std::abs(s.bonds.at(1).leak), 1e-3);  // the speed of a is not the speed at the far end of the spring
  EXPECT_THAT(s.warnings, ElementsAre(HasSubstr("power bond 'wrong' leaks")));
}

TEST(Statistics, WorkOfAnOscillatorIsPositiveOnTheWayInAndNegativeOnTheWayOut) {
  // The spring torque on mass b is a cosine, its speed a sine: each quarter of the oscillation gives or takes the same energy.
  Build b;
  b.unit("a", "oscillator_a").unit("b", "oscillator_b", 1).connect("b.q", "a.q").connect("a.tau", "b.tau").until(0.3);
  b.scenario.tick = Duration{10'000};
  b.scenario.reports.push_back({"work", ReportKind::kEnergy, "b.tau", "b.dq", ""});
  const Work w = run(b).works.at(0);
  EXPECT_GT(w.positive, 0);
  EXPECT_LT(w.negative, -0.2 * w.positive);
  EXPECT_DOUBLE_EQ(w.value, w.positive + w.negative);
}

TEST(Statistics, PowerOfDrivingAndBrakingJointsIsCountedSeparately) {
  // 6 W and −6 W over 10 ms.
  Build b;
  b.unit("arm", "joints").with("tau_in", 2.0).with("dq_in[1]", 3.0).with("dq_in[2]", -3.0);
  b.scenario.reports.push_back({"work", ReportKind::kEnergy, "arm.tau", "arm.dq", ""});
  const Work w = run(b).works.at(0);
  EXPECT_NEAR(w.positive, 0.06, 1e-15);
  EXPECT_NEAR(w.negative, -0.06, 1e-15);
  EXPECT_EQ(w.value, 0);
}

TEST(Statistics, APowerThatChangesItsSignWithinATickCountsOnBothSides) {
  // Joint 1 changes from 6 to −2 W between 5 and 6 ms: triangles of 6 W · 0.75 ms / 2 and −2 W · 0.25 ms / 2.
  Build b;
  b.unit("arm", "joints").with("tau_in", 1.0).with("dq_in[1]", 6.0).event(0.005, "arm.dq_in[1]", "-2");
  b.scenario.reports.push_back({"work", ReportKind::kEnergy, "arm.tau", "arm.dq", ""});
  const Work w = run(b).works.at(0);
  EXPECT_NEAR(w.positive, 6 * 0.005 + 0.5 * 6 * 0.75e-3, 1e-15);
  EXPECT_NEAR(w.negative, -2 * 0.004 - 0.5 * 2 * 0.25e-3, 1e-15);
}

TEST(Statistics, ComparesTwoSignalsOverAllAndInSegments) {
  // a − b is 0 until 2 ms, then 1, from 6 ms on −2; five segments of 2 ms contain the samples at [0,2), [2,4), …, [8,10] ms.
  Build b;
  b.unit("a", "gain").unit("b", "gain").event(0.002, "a.u", "1").event(0.006, "a.u", "-2");
  b.scenario.comparisons.push_back({"torque", "a.y", "b.y", 5, {}, {}, ""});
  const Compared c = run(b).comparisons.at(0);
  EXPECT_EQ(c.name, "torque");
  EXPECT_EQ(c.max[0], 2);
  EXPECT_DOUBLE_EQ(c.time_of_max[0], 0.007);
  ASSERT_EQ(c.segment_rms.size(), 5u);
  EXPECT_EQ(c.segment_rms[0][0], 0);
  EXPECT_DOUBLE_EQ(c.segment_rms[1][0], std::sqrt(1 / 2.0));  // 0 at 2 ms, 1 at 3 ms
  EXPECT_EQ(c.segment_rms[2][0], 1);
  EXPECT_DOUBLE_EQ(c.segment_rms[3][0], std::sqrt((1 + 4) / 2.0));
  EXPECT_EQ(c.segment_rms[4][0], 2);
  EXPECT_DOUBLE_EQ(c.rms[0], std::sqrt((4 * 1 + 4 * 4) / 11.0));
}

TEST(Statistics, ComparesInAThousandSegmentsOverThreeHundredYears) {
  // a − b is 0 until 4.5e9 s, then 3: half of the segments, each of 9e6 s and one sample.
  Build b;
  b.unit("a", "gain").unit("b", "gain").event(4.5e9, "a.u", "3").until(9e9);
  b.scenario.tick = Duration::from_seconds(9e6);
  b.scenario.comparisons.push_back({"torque", "a.y", "b.y", 1000, {}, {}, ""});
  const Compared c = run(b).comparisons.at(0);
  ASSERT_EQ(c.segment_rms.size(), 1000u);
  EXPECT_EQ(c.segment_rms[500][0], 0);  // the event acts on the tick that begins then
  EXPECT_EQ(c.segment_rms[501][0], 3);
  EXPECT_EQ(c.segment_rms[999][0], 3);
}

TEST(Statistics, AComparisonMayBeginLateAndEndEarly) {
  Build b;
  b.unit("a", "gain").unit("b", "gain").event(0.002, "a.u", "1").event(0.006, "a.u", "-2");
  b.scenario.comparisons.push_back({"torque", "a.y", "b.y", 1, Time{3'000'000}, Time{6'000'000}, ""});
  const Compared c = run(b).comparisons.at(0);
  EXPECT_EQ(c.max[0], 1);
  EXPECT_EQ(c.rms[0], 1);
}

TEST(Statistics, RefusesSignalsThatCannotBeCompared) {
  const auto refusal = [](const std::function<void(Scenario&)>& change) {
    Build b;
    b.unit("a", "gain?n=3").unit("b", "gain?n=2").unit("m", "mixed").unit("o", "oscillator_a");
    change(b.scenario);
    return error_of([&] { b.load(); });
  };
  const auto compare = [&](const std::string& x, const std::string& y, int segments = 8) {
    return refusal([&](Scenario& s) { s.comparisons.push_back({"c", x, y, segments, {}, {}, "test.ssd:80"}); });
  };
  EXPECT_EQ(compare("a.y", "b.y"), "test.ssd:80: a.y - b.y: 3 elements cannot be compared with 2");
  EXPECT_THAT(compare("a.y[1]", "o.tau"), HasSubstr("rad cannot be compared with N.m"));
  EXPECT_THAT(compare("a.y[1]", "m.integer_out"), HasSubstr("'m.integer_out' is integer, expected a real variable"));
  EXPECT_THAT(compare("a.y", "a.u", 0), HasSubstr("0 segments"));
  EXPECT_THAT(compare("a.y", "a.u", 1001), HasSubstr("1001 segments"));
  EXPECT_THAT(refusal([](Scenario& s) {
                s.comparisons.push_back({"c", "a.y", "a.u", 8, Time::from_seconds(500), {}, "test.ssd:80"});
              }),
              HasSubstr("test.ssd:80: comparison 'c' would last from 500 s to "));
  EXPECT_THAT(refusal([](Scenario& s) {
                s.reports.push_back({"", ReportKind::kEnergy, "a.y", "a.u", "test.ssd:81"});
              }),
              HasSubstr("is not a power"));
  EXPECT_THAT(refusal([](Scenario& s) {
                s.reports.push_back({"", ReportKind::kAttitude, "a.y", "a.u", "test.ssd:82"});
              }),
              HasSubstr("test.ssd:82: a.y has 3 elements, expected a quaternion"));
}

}  // namespace
}  // namespace cotwin::master::statistics_test
