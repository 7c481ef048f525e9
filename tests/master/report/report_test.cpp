// cotwin report: the page, what it is made of, and hostile results.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "master/report/compare.h"
#include "master/report/energy_flow.h"
#include "master/report/gnuplot.h"
#include "master/report/page.h"
#include "master/report/plot.h"
#include "master/report/report.h"
#include "master/results/recording.h"
#include "models/foundation/support/error.h"
#include "tests/master/workflows/tune_fixture.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace report_test {
namespace {

namespace fs = std::filesystem;
using namespace cotwin::report;  // NOLINT: everything here is of the report
using cotwin::testing::content;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// What is wrong with a page; "" if nothing.
std::string wrong_in(const fs::path& page) {
  const RunResult checked =
      cotwin::testing::run_command({"python3", cotwin::places::source() + "/tests/master/report/check_page.py", page.string()});
  return checked.code == 0 ? "" : checked.out + checked.err + "exit code " + std::to_string(checked.code);
}

/// A page of these results; checks it.
std::string page_of(const std::vector<fs::path>& results, const fs::path& out) {
  const WrittenPage written = write_page({results, out, {}, "1.2.3"});
  EXPECT_EQ(wrong_in(written.file), "");
  return content(written.file);
}

std::size_t count(const std::string& text, const std::string& what) {
  std::size_t n = 0;
  for (std::size_t at = text.find(what); at != std::string::npos; at = text.find(what, at + 1)) ++n;
  return n;
}

const Gnuplot& gnuplot() {
  static const Gnuplot all;
  return all;
}
#define NEEDS_GNUPLOT() \
  if (!gnuplot().available()) GTEST_SKIP() << gnuplot().lacking()

// ---- curves

TEST(Curve, KeepsEveryPointOfAShortSignal) {
  Curve curve;
  for (int i = 0; i < 100; ++i) curve.add(i, i * i);
  const std::vector<Point> points = curve.points();
  ASSERT_EQ(points.size(), 100u);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_EQ(points[i].y, static_cast<double>(i * i));
}

TEST(Curve, KeepsTheExtremesOfAMillionSamplesInFewPoints) {
  Curve curve;
  for (int i = 0; i < 1'000'000; ++i) {
    const double y = i == 123'456 ? 5 : i == 700'001 ? -7 : std::sin(1e-4 * i);
    curve.add(1e-3 * i, y);
  }
  const std::vector<Point> points = curve.points();
  EXPECT_LE(points.size(), 10 * Curve::kIntervals);
  double high = 0, low = 0, t_high = 0, t_low = 0, before = -1;
  for (const Point& p : points) {
    EXPECT_GE(p.t, before);
    before = p.t;
    if (p.y > high) high = p.y, t_high = p.t;
    if (p.y < low) low = p.y, t_low = p.t;
  }
  EXPECT_EQ(high, 5);
  EXPECT_EQ(low, -7);
  EXPECT_DOUBLE_EQ(t_high, 123.456);
  EXPECT_DOUBLE_EQ(t_low, 700.001);
  EXPECT_EQ(points.front().t, 0);
  EXPECT_DOUBLE_EQ(points.back().t, 999.999);
  EXPECT_EQ(curve.figures().count, 1'000'000u);
}

TEST(Curve, IsInterruptedWhereSamplesAreNotFinite) {
  Curve curve;
  for (const double y : {1.0, 2.0, kNaN, std::numeric_limits<double>::infinity(), 3.0})
    curve.add(static_cast<double>(curve.figures().count), y);
  const std::vector<Point> points = curve.points();
  ASSERT_EQ(points.size(), 4u);
  EXPECT_EQ(points[1].y, 2);
  EXPECT_TRUE(std::isnan(points[2].y));
  EXPECT_EQ(points[3].y, 3);
  EXPECT_EQ(curve.figures().missing, 2u);
  EXPECT_EQ(curve.figures().mean(), 2);

  Curve none;
  none.add(0, kNaN);
  EXPECT_THAT(none.points(), IsEmpty());
  EXPECT_TRUE(std::isnan(none.figures().largest()));
}

TEST(Curve, SimplifiedStaysWithinTheTolerance) {
  std::vector<Point> points;
  for (int i = 0; i <= 1000; ++i) points.push_back({0.01 * i, std::sin(0.01 * i)});
  points.push_back({10.01, kNaN});
  points.push_back({11, 0});
  const double tolerance = 1e-3;
  const std::vector<Point> fewer = simplified(points, 1, 1, tolerance);
  EXPECT_LT(fewer.size(), 120u);
  std::size_t k = 0;
  for (const Point& p : points) {
    if (std::isnan(p.y) || p.t > 10) continue;
    while (fewer[k + 1].t < p.t) ++k;
    const double share = (p.t - fewer[k].t) / (fewer[k + 1].t - fewer[k].t);
    EXPECT_LE(std::abs((1 - share) * fewer[k].y + share * fewer[k + 1].y - p.y),
              1.5 * tolerance);  // along y, not across the line
  }
  EXPECT_EQ(fewer.back().t, 11);
  EXPECT_TRUE(std::isnan(fewer[fewer.size() - 2].y));
}

// ---- text and plots

TEST(ReportPage, EscapesMarkupControlCharactersAndBytesThatAreNotUtf8) {
  EXPECT_EQ(escaped("<script>alert('\"')</script> & more"), "&lt;script&gt;alert(&#39;&quot;&#39;)&lt;/script&gt; &amp; more");
  EXPECT_EQ(escaped(std::string("a\0b", 3)),
            "a\xEF\xBF\xBD"
            "b");
  EXPECT_EQ(escaped("\xC3"), "\xEF\xBF\xBD");
  EXPECT_EQ(escaped("τ_J\n2"), "τ_J 2");
  EXPECT_EQ(escaped("ab\xC3\xBC", 3), "ab…");  // not half of a character
  EXPECT_EQ(number(-1.5e-7), "−1.5e−07");
  EXPECT_EQ(number(kNaN), "–");
}

TEST(ReportPlot, LeavesOnlyWhatPlotsConsistOf) {
  const std::string svg = R"svg(<?xml version="1.0"?>
<!DOCTYPE svg PUBLIC "x" "http://example.invalid/x.dtd">
<svg viewBox="0 0 100 50" xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" onload="alert(1)">
<script>alert(2)</script><style>* { background: url(http://example.invalid) }</style>
<a xlink:href="http://example.invalid"><path stroke="rgb(10,10,10)" d="M1.04,2 L3,-4.56  "/></a>
<image xlink:href="http://example.invalid/x.png"/>
<g stroke="rgb(1,1,1)"><path d="M0,0 L1,1" style="x" onclick="alert(3)"/></g>
<path stroke="red" d="M0,0 L9,9"/><path stroke="rgb(1,1,1)" d="M0,0 nan,1"/><path stroke="rgb(1,1,1)" d="M0 0&quot; onload=&quot;x"/>
<g transform="translate(1.5,2.25)" text-anchor="end&quot; onload=&quot;x"><text>&lt;b&gt;&amp;</text></g>
</svg>)svg";
  const std::string clean = cleaned_svg(svg, "a \"plot\"");
  EXPECT_EQ(clean,
            "<svg class=\"plot\" viewBox=\"0 0 100 50\" role=\"img\" aria-label=\"a &quot;plot&quot;\">\n"
            "<path class=\"k k0\" d=\"M1 2 3-4.6\"/>\n<path class=\"axis\" d=\"M0 0 1 1\"/>\n"
            "<text class=\"faint\" transform=\"translate(1.5 2.3)\" font-size=\"11\">&lt;b&gt;&amp;</text>\n</svg>");
  EXPECT_THROW(cleaned_svg("<svg viewBox='0 0 1 1'>", ""), cotwin::Error);
  EXPECT_THROW(cleaned_svg("nothing", ""), cotwin::Error);
}

TEST(ReportPlot, DrawsTheCurveWhereItsValuesAre) {
  NEEDS_GNUPLOT();
  Plot plot;
  plot.lines = {{"a", {{0, -1}, {1, 1}, {2, -1}}, 3}, {"b", {{0, 0}, {1, kNaN}, {2, 0}}, 0}};
  plot.y_label = "N.m";
  const std::string svg = draw(gnuplot(), plot);
  EXPECT_THAT(svg, AllOf(HasSubstr(">N.m</text>"), HasSubstr(">t [s]</text>"), HasSubstr("class=\"grid\"")));
  const std::size_t at = svg.find("class=\"k k3\" d=\"M");
  ASSERT_NE(at, std::string::npos);
  std::array<double, 6> xy{};
  ASSERT_EQ(std::sscanf(svg.c_str() + at, "class=\"k k3\" d=\"M%lf %lf %lf %lf %lf %lf", &xy[0], &xy[1], &xy[2], &xy[3], &xy[4],
                        &xy[5]),
            6);
  EXPECT_NEAR(xy[2] - xy[0], xy[4] - xy[2], 0.2);  // equal times
  EXPECT_NEAR(xy[1], xy[5], 0.1);
  EXPECT_LT(xy[3], xy[1] - 100);  // y of SVG points down
}

TEST(ReportPlot, GnuplotReplacesNothingInLabels) {
  NEEDS_GNUPLOT();
  const TemporaryFolder folder("report");
  const std::string touched = (folder / "touched").string();
  Plot plot;
  plot.lines = {{"a", {{0, 0}, {1, 1}}, 0}};
  for (const std::string& label : {"`touch " + touched + "`", "'; system('touch " + touched + "') #", "\n!touch " + touched,
                                   "''; system('touch " + touched + "')", "a''b'''; !touch " + touched,
                                   std::string("@GPVAL_X \\n {/Symbol a} \"$(x)\"")}) {
    plot.y_label = label;
    std::string shown = escaped(label);
    for (std::size_t at; (at = shown.find("&#39;")) != std::string::npos;) shown.replace(at, 5, "’");
    const std::string svg = draw(gnuplot(), plot);
    EXPECT_FALSE(fs::exists(touched)) << label;
    if (label.front() != '\n') {
      EXPECT_THAT(svg, HasSubstr(">" + shown + "</text>"));
    }
  }
}

TEST(ReportPlot, DrawsWhatIsHardToDraw) {
  NEEDS_GNUPLOT();
  const std::vector<std::vector<Point>> all = {{{0, 1}},
                                               {{0, 3}, {1, 3}, {2, 3}},
                                               {{0, 1e20}, {1, 1e20}, {2, std::nextafter(1e20, 1e21)}},
                                               {{0, -1e299}, {1, 1e299}},
                                               {{0, 1e-310}, {1, 2e-310}},
                                               {{0, 1}, {1, std::numeric_limits<double>::max()}, {2, 2}},
                                               {{1.7e9, 1}, {1.7e9 + 0.001, 2}},
                                               {{5, 1}, {4, 2}, {3, 1}}};
  for (const std::vector<Point>& points : all) {
    Plot plot;
    plot.lines = {{"a", points, 0}};
    ASSERT_TRUE(has_points(plot));
    EXPECT_NO_THROW(EXPECT_THAT(draw(gnuplot(), plot), Not(AnyOf(HasSubstr("nan"), HasSubstr("inf"))))) << points.front().y;
  }
  Plot nothing;
  nothing.lines = {{"a", {{0, kNaN}}, 0}, {"b", {}, 1}};
  EXPECT_FALSE(has_points(nothing));
}

TEST(ReportPlot, AMissingOrBrokenGnuplotIsNamed) {
  ::setenv("COTWIN_GNUPLOT", "/nonexistent/gnuplot", 1);
  EXPECT_THAT(Gnuplot().lacking(), HasSubstr("/nonexistent/gnuplot' is not installed"));
  ::setenv("COTWIN_GNUPLOT", "/bin/false", 1);
  const Gnuplot broken;
  EXPECT_FALSE(broken.available());
  EXPECT_THAT(broken.lacking(), HasSubstr("expected gnuplot"));
  EXPECT_THROW(static_cast<void>(broken.run("plot x")), cotwin::Error);
  ::unsetenv("COTWIN_GNUPLOT");
  NEEDS_GNUPLOT();
  EXPECT_THROW(static_cast<void>(gnuplot().run("plot nothing\n")), cotwin::Error);
  EXPECT_THROW(static_cast<void>(gnuplot().run("pause 100\n", std::chrono::seconds(1))), cotwin::Error);
}

// ---- recordings

LoadedRecording loaded(const std::string& text, RecordingOptions options = {}) {
  const TemporaryFolder folder("report");
  return load_recording(folder.write("signals.csv", text), std::move(options));
}

TEST(ReportRecording, GroupsTheElementsOfVectorsAndScalarsOfAKind) {
  const LoadedRecording r = loaded(
      "time,drive.q[1],drive.q[2],drive.energy_kinetic,drive.energy_potential,world.contacts,\"a[1,1]\",\"a[1,2]\"\n0,1,2,3,4,"
      "5,6,"
      "7\n",
      {column_facts(json::parse(R"({"recording": {"columns": [{"name": "drive.q", "elements": 2, "unit": "rad"},
         {"name": "drive.energy_kinetic", "elements": 1, "unit": "J"}, {"name": "drive.energy_potential", "elements": 1, "unit": "J"}]}})")),
       {},
       {},
       {}});
  std::vector<std::string> names;
  for (const ColumnGroup& group : r.groups) names.push_back(group.name);
  EXPECT_THAT(names, ElementsAre("drive.q", "drive.energy_…", "world.contacts", "a"));
  EXPECT_EQ(r.groups[0].unit, "rad");
  EXPECT_THAT(r.groups[1].columns, ElementsAre(2, 3));
  EXPECT_EQ(vector_of("x["), "x[");
  EXPECT_EQ(vector_of("[1]"), "[1]");
  EXPECT_EQ(vector_of("x[<b>]"), "x[<b>]");
}

TEST(ReportRecording, ColumnsWithTheNamesOfJointsAreThoseWithNumbersAndKindsAreApart) {
  const json record =
      json::parse(R"({"recording": {"joint_names": true, "columns": [{"name": "time", "elements": 1, "unit": "s"},
      {"name": "a.q", "elements": 3, "unit": "", "units": ["rad", "m", "rad"], "joints": ["2", "my, slide", "roll"]},
      {"name": "a.E", "elements": 1, "unit": "J"}]}})");
  RecordingOptions options{column_facts(record), {}, {}, {}};
  options.residuals = {{"error", "", "a.q", "a.q", 1, 0, {}, {}, false, {"rad", "m", "rad"}}};
  const LoadedRecording r = loaded("time,a.q[2],\"a.q[my, slide]\",a.q[roll],a.E\n0,1,2,3,4\n", std::move(options));
  EXPECT_THAT(r.names, ElementsAre("a.q[1]", "a.q[2]", "a.q[3]", "a.E"));  // joint "2" is the first one
  ASSERT_EQ(r.groups.size(), 3u);
  EXPECT_EQ(r.groups[0].unit, "rad");
  EXPECT_THAT(r.groups[0].columns, ElementsAre(0, 2));
  EXPECT_EQ(r.groups[1].unit, "m");
  EXPECT_EQ(r.columns[1].joint, "my, slide");
  EXPECT_EQ(r.residuals[0].curves.size(), 3u);
  EXPECT_EQ(misfit(record, "signals.csv", r.names, 1, 0), "");
  EXPECT_EQ(shown_name({{"a.q[2]", {"a.q[2]", "m", "my, slide"}}}, "a.q[2]"), "a.q my, slide");
  EXPECT_EQ(shown_name({}, "a.q[2]"), "a.q[2]");
  EXPECT_TRUE(
      column_facts(json::parse(R"({"recording": {"columns": [{"name": "x", "elements": 1e300}, 7, {"elements": -1}]}})"))
          .empty());
}

TEST(ReportRecording, ACutFileIsReadUpToItsLastWholeRow) {
  const LoadedRecording cells = loaded("time,a,b\n0,1,2\n1,2,3\n2,3");
  EXPECT_EQ(cells.rows, 2u);
  EXPECT_THAT(cells.notes, ElementsAre(HasSubstr("signals.csv:4: 2 cells")));
  const LoadedRecording digits = loaded("time,a,b\n0,1,2\n1,2,3\n2,3,1");  // 1 of 12.5
  EXPECT_EQ(digits.rows, 2u);
  EXPECT_THAT(digits.notes, ElementsAre(HasSubstr("no line end")));
  EXPECT_EQ(loaded("time,a\n0,1\n1,2\n").rows, 2u);
  EXPECT_THAT(loaded("time,a\n0,1\n1,2\n").notes, IsEmpty());
  EXPECT_THAT(loaded("time,a").notes, ElementsAre("The recording has no rows."));
  EXPECT_THAT(loaded("time,a\n").notes, ElementsAre("The recording has no rows."));
  EXPECT_THROW(loaded(""), cotwin::Error);
}

TEST(ReportRecording, CountsWhatIsNoNumber) {
  const LoadedRecording r = loaded("time,a,b\n0,nan,x\n1,inf,2\nnan,1,1\n1,,3\n");
  EXPECT_EQ(r.rows, 3u);
  EXPECT_THAT(r.notes, ElementsAre(HasSubstr("1 row has no finite time"), HasSubstr("2 cells are not numbers"),
                                   HasSubstr("4 values are not finite, first in column 'a'")));
  EXPECT_THAT(loaded("time,a\n1,1\n0,2\n2,2\n").notes, ElementsAre(HasSubstr("time goes back in 1 row")));
}

TEST(ReportRecording, HasTheTimeThatIsFoundByItsNameOrGiven) {
  EXPECT_EQ(loaded("a,Time\n5,1\n5,2\n").end, 2);
  EXPECT_THROW(loaded("time_ms,a\n0,1\n"), cotwin::Error);
  RecordingOptions options;
  options.time = {"time_ms", 1e-3};
  EXPECT_DOUBLE_EQ(loaded("time_ms,a\n0,1\n500,1\n", options).end, 0.5);
}

TEST(ReportRecording, OfWhichNoRowCanBeReadIsAnErrorWithTheReason) {
  const auto error = [](const std::string& text) { return cotwin::testing::error_of([&] { loaded(text); }); };
  EXPECT_THAT(error("t;x\n0,01;1,5\n0,02;1,6\n"), HasSubstr(":2: column 't': '0,01' has a decimal comma"));
  EXPECT_THAT(error("t,x\n2026-11-22T10:00:00,1\n"), HasSubstr("'2026-11-22T10:00:00', expected a number"));
  EXPECT_THAT(error("t,x\n0,1,2\n1,2,3\n"), HasSubstr(":2: 3 cells"));
  EXPECT_EQ(loaded("t,x,y\n0,1").rows, 0u);
}

TEST(ReportRecording, ComputesResidualsOfSignalsThatWereRecorded) {
  Residual r{"error", "rad", "a.q", "b.q", 2, 1, {}, {}}, missing{"other", "", "a.q", "c.q", 1, 0, {}, {}};
  const LoadedRecording recording =
      loaded("time,a.q[1],a.q[2],b.q[1],b.q[2]\n0,5,6,1,2\n1,5,9,1,2\n", {{}, {}, {r, missing}, {}});
  ASSERT_EQ(recording.residuals.size(), 2u);
  EXPECT_EQ(recording.residuals[0].curves[0].figures().largest(), 2);  // 5 − (2 · 1 + 1)
  EXPECT_EQ(recording.residuals[0].curves[1].figures().last, 4);       // 9 − (2 · 2 + 1)
  EXPECT_THAT(recording.residuals[1].curves, IsEmpty());
}

TEST(ReportRecording, ComputesRotationVectorsBetweenQuaternions) {
  Residual r{"turn", "rad", "a.Q", "b.Q", 1, 0, {}, {}, true}, short_one{"other", "rad", "a.q", "b.q", 1, 0, {}, {}, true};
  const LoadedRecording recording = loaded(
      "time,a.Q[1],a.Q[2],a.Q[3],a.Q[4],b.Q[1],b.Q[2],b.Q[3],b.Q[4],a.q,b.q\n0,1,0,0,0,1,0,0,0,1,1\n1,0.8,0,0.6,0,1,0,0,0,1,"
      "1\n",
      {{}, {}, {r, short_one}, {}});
  ASSERT_EQ(recording.residuals[0].curves.size(), 3u);
  EXPECT_EQ(recording.residuals[0].curves[0].figures().largest(), 0);
  EXPECT_NEAR(recording.residuals[0].curves[1].figures().last, 2 * std::asin(0.6), 1e-15);
  EXPECT_THAT(recording.residuals[1].curves, IsEmpty());
}

TEST(ReportRecording, FindsContacts) {
  const LoadedRecording r = loaded(
      "time,world.contacts,world.force,world.penetration,other.f_c[1],other.f_c[2]\n"
      "0,0,0,0,0,0\n1,1,5,1e-3,0,0\n2,2,9,2e-3,3,4\n3,0,0,0,0,0\n4,1,2,1e-4,0,0\n");
  ASSERT_EQ(r.contacts.size(), 3u);
  EXPECT_EQ(r.contacts[0].component, "world");
  EXPECT_EQ(r.contacts[0].begin, 1);
  EXPECT_EQ(r.contacts[0].end, 2);
  EXPECT_EQ(r.contacts[0].force, 9);
  EXPECT_EQ(r.contacts[0].penetration, 2e-3);
  EXPECT_EQ(r.contacts[1].component, "other");
  EXPECT_EQ(r.contacts[1].force, 5);
  EXPECT_TRUE(std::isnan(r.contacts[1].penetration));
  EXPECT_TRUE(r.contacts[2].open);
  EXPECT_FALSE(r.contacts[0].open);
}

TEST(ReportRecording, ComparesAtTheTimesOfTheReference) {
  const TemporaryFolder folder("report");
  const LoadedRecording a = load_recording(folder.write("a.csv", "time,x,y,z\n0,0,1,1\n1,1,1,1\n2,2,1,1\n9,0,1,1\n"), {});
  const LoadedRecording b = load_recording(folder.write("b.csv", "time,y,x,w\n0,1,0,0\n0.5,1,1,0\n2.5,1,5,0\n"), {});
  const RecordingComparison c = compare_recordings(a, b);
  EXPECT_EQ(c.rows, 3u);  // 9 s is after the end of b
  EXPECT_THAT(c.only_in_reference, ElementsAre("z"));
  EXPECT_THAT(c.only_in_other, ElementsAre("w"));
  ASSERT_EQ(c.signals.size(), 2u);
  const std::vector<Point> x = c.signals[0].curves[0].points();
  ASSERT_EQ(x.size(), 3u);
  EXPECT_EQ(x[0].y, 0);
  EXPECT_EQ(x[1].y, 1);  // (1 + 0.25 · 4) − 1
  EXPECT_EQ(x[2].y, 2);  // (1 + 0.75 · 4) − 2
  EXPECT_EQ(c.signals[1].largest(), 0);
}

// ---- energy

TEST(ReportEnergy, SourcesEqualSinks) {
  Results results;
  results.summary = json::parse(R"({"end": {
    "m.drawn": {"values": [100]}, "m.work_positive": {"values": [30, 20]}, "m.work_negative": {"values": [-10, -5]},
    "m.copper": {"values": [8, 2]}, "m.converter": {"values": [1, 1]}, "m.iron": {"values": [0, 3]}, "m.idle": {"values": [20]},
    "m.chopped": {"values": [4]}, "m.stored": {"values": [-2]}, "m.supply_losses": {"values": [13]},
    "m.controller_energy": {"values": [15]}, "m.friction": {"values": [33]}, "other.drawn": {"values": [1]}}})");
  const std::vector<EnergyFlow> flows = energy_flows(results);
  ASSERT_EQ(flows.size(), 1u);  // other has no books
  double in = 0, out = 0;
  for (const FlowEntry& entry : flows[0].sources) in += entry.joules;
  for (const FlowEntry& entry : flows[0].sinks) out += entry.joules;
  EXPECT_DOUBLE_EQ(in, 117);  // mains 100, motors that brake 15, capacitor 2
  EXPECT_DOUBLE_EQ(out, 117);
  EXPECT_DOUBLE_EQ(flows[0].motor_work, 35);
  EXPECT_EQ(flows[0].friction, 33);
  EXPECT_THAT(flow_svg(flows[0]),
              AllOf(HasSubstr("mains 100 J (85.5 %)"), HasSubstr("motors that brake 15 J"), Not(HasSubstr("nan"))));
  EXPECT_EQ(flow_svg({}), "");
}

// ---- pages

TEST(ReportPage, ItsColoursDifferAlsoForTheColourBlind) {
  const std::string root = cotwin::places::source();
  const RunResult checked = cotwin::testing::run_command(
      {"python3", root + "/tests/master/report/check_colours.py", root + "/master/report/page.css"});
  EXPECT_EQ(checked.code, 0) << checked.out << checked.err;
}

TEST(ReportPage, OfARunHasItsFiguresPlotsAndParameters) {
  const TemporaryFolder folder("report");
  const RunResult run = run_program({"run", cotwin::places::source() + "/examples/02_free_motion_lwr4/twin.ssd", "--stop", "1",
                                     "--set", "compliance.sigma0=0", "--out", folder / "out", "--report"});
  ASSERT_EQ(run.code, 0) << run.err;
  EXPECT_THAT(run.out, HasSubstr("report: " + (folder / "out").string() + "/report.html"));
  EXPECT_EQ(wrong_in(folder / "out" / "report.html"), "");
  const std::string page = content(folder / "out" / "report.html");
  for (const char* text :
       {"Run of free_motion_lwr4", "complete", "given with --set", "compliance.sigma0=0", "tracking error [rad]",
        "work of the joints", "unit:drive_train", "compliance.tau_m [N.m]", "drive.energy_…", "hash of the scenario"})
    EXPECT_THAT(page, HasSubstr(text));
  std::size_t at = 0;  // what happened comes first, and where it ran last
  for (const char* text : {"complete, 0 s to 1 s simulated", ">Figures of the run</h3>", ">Signals</h3>", ">Energy</h3>",
                           ">Parameters</h3>", ">Origin and machine</h3>"}) {
    const std::size_t found = page.find(text, at);
    ASSERT_NE(found, std::string::npos) << text;
    at = found;
  }
  if (gnuplot().available()) {
    EXPECT_GE(count(page, "<svg class=\"plot\""), 11u);  // ten groups and the tracking error
  }
  const json summary = json::parse(content(folder / "out" / "summary.json"));
  EXPECT_EQ(summary["state"], "done");
  EXPECT_EQ(summary["end"]["drive.q"]["values"].size(), 7u);
  EXPECT_EQ(summary["signals"][2]["a"], "drive.q");
  EXPECT_EQ(summary["signals"][2]["b"], "motion.q_d");
  EXPECT_EQ(json::parse(content(folder / "out" / "run.json"))["components"][2]["name"], "drive");
}

TEST(ReportPage, TheSameResultsGiveTheSameBytes) {
  const TemporaryFolder folder("report");
  folder.write("r/signals.csv", "time,a[1],a[2]\n0,1,2\n1,2,1\n");
  const std::string first = page_of({folder / "r"}, folder / "1.html"), second = page_of({folder / "r"}, folder / "2.html");
  EXPECT_EQ(first, second);
}

TEST(ReportPage, ComparesRuns) {
  const TemporaryFolder folder("report");
  const std::string scenario = cotwin::places::source() + "/examples/02_free_motion_lwr4/twin.ssd";
  ASSERT_EQ(run_program({"run", scenario, "--stop", "1", "--quiet", "--out", folder / "a"}).code, 0);
  ASSERT_EQ(
      run_program({"run", scenario, "--stop", "1.5", "--quiet", "--out", folder / "b", "--set", "compliance.sigma0=0"}).code,
      0);
  const RunResult report = run_program({"report", folder / "a", folder / "b"});
  ASSERT_EQ(report.code, 0) << report.err;
  EXPECT_THAT(report.out, HasSubstr("comparison.html"));
  EXPECT_EQ(wrong_in(folder / "a" / "comparison.html"), "");
  const std::string page = content(folder / "a" / "comparison.html");
  EXPECT_THAT(page,
              AllOf(HasSubstr("Comparison of 2 results"), HasSubstr("Signals that differ"), HasSubstr("Parameters that differ"),
                    HasSubstr("compliance.sigma0"), HasSubstr("at 101 rows of the reference"), HasSubstr("signals are equal")));
}

TEST(ReportPage, NamesWithMarkupAreText) {
  const TemporaryFolder folder("report");
  const std::string evil = "<script>alert(1)</script>\"'><img src=x onerror=alert(2)>";
  json record = {{"state", evil},
                 {"reason", evil},
                 {"scenario", {{"name", evil}, {"file", evil}, {"hash", evil}}},
                 {"program", {{"version", evil}, {"build", evil}}},
                 {"set", {evil}},
                 {"settings", {{evil, evil}}},
                 {"components", {{{"name", evil}, {"source", evil}, {"stage", evil}}}},
                 {"parameters", {{evil, {{"value", evil}, {"unit", evil}}}}},
                 {"warnings", {evil}},
                 {"recording", {{"columns", {{{"name", evil}, {"unit", evil}}}}}}};
  json summary = {{"notes", {evil}},
                  {"signals", {{{"name", evil}, {"what", evil}, {"unit", evil}, {"rms", {1}}, {"a", evil}, {"b", evil}}}},
                  {"units", {{{"name", evil}}}},
                  {"energy", {{{"name", evil}, {"what", evil}}}},
                  {"bonds", {{{"name", evil}}}},
                  {"loops", {{{"members", evil}}}},
                  {"end", {{evil + ".drawn", {{"values", {1}}}}}}};
  folder.write("r/run.json", record.dump());
  folder.write("r/summary.json", summary.dump());
  std::string quoted = evil;
  for (std::size_t at = quoted.find('"'); at != std::string::npos; at = quoted.find('"', at + 2)) quoted.insert(at, "\"");
  folder.write("r/signals.csv", "time,\"" + quoted + "\",\"" + quoted + ".contacts\",\x01\xFF[1]\n0,1,1,2\n1,2,0,3\n");
  const std::string page = page_of({folder / "r"}, folder / "page.html");
  EXPECT_THAT(page, AllOf(Not(HasSubstr("<script")), Not(HasSubstr("<img")), HasSubstr("&lt;script&gt;alert(1)")));
  const std::string both = page_of({folder / "r", folder / "r"}, folder / "both.html");
  EXPECT_THAT(both, AllOf(Not(HasSubstr("<script")), Not(HasSubstr("<img"))));
}

TEST(ReportPage, OddJsonIsNoReasonToFail) {
  const TemporaryFolder folder("report");
  folder.write("r/signals.csv", "time,a\n0,1\n1,2\n");
  for (const std::string text :
       {R"({"signals": 5, "energy": {"a": 1}, "end": [1], "comparisons": [[]], "units": ["x", null]})",
        R"({"signals": [{"rms": ["x", null, {}], "max": 3}], "end": {"m.drawn": 3}, "warnings": "w"})", R"([1, 2])",
        R"({"signals": [)", "", "\xFF\xFE", R"({"scenario": [], "program": 4, "parameters": [1], "state": {}})"}) {
    folder.write("r/summary.json", text);
    folder.write("r/run.json", text);
    folder.write("r/figures.json", text);
    folder.write("r/resume.json", text);
    EXPECT_THAT(page_of({folder / "r"}, folder / "page.html"), HasSubstr("<main>")) << text;
    EXPECT_THAT(page_of({folder / "r", folder / "r"}, folder / "page.html"), HasSubstr("Comparison")) << text;
  }
}

TEST(ReportPage, WhatIsMissingIsNamed) {
  const TemporaryFolder folder("report");
  folder.write("part/run.json", R"({"state": "running", "recording": {"file": "signals.csv"}})");
  folder.write("part/signals.csv.part", "time,a\n0,1\n1,2\n2,");
  EXPECT_THAT(page_of({folder / "part"}, folder / "p.html"),
              AllOf(HasSubstr("signals.csv.part"), HasSubstr("its program was killed"), HasSubstr("no line end")));
  folder.write("none/run.json", R"({"state": "failed", "reason": "NaN", "recording": {"file": "signals.csv"}})");
  EXPECT_THAT(page_of({folder / "none"}, folder / "p.html"), AllOf(HasSubstr("The recording signals.csv is missing"),
                                                                   HasSubstr("failed: NaN"), HasSubstr("has no recording")));
  folder.write("empty/run.json", "{}");
  folder.write("empty/signals.csv", "");
  EXPECT_THAT(page_of({folder / "empty"}, folder / "p.html"), HasSubstr("The recording cannot be read: "));
  folder.write("nan/signals.csv", "time,a[1],a[2]\n0,nan,nan\n1,nan,nan\n");
  EXPECT_THAT(page_of({folder / "nan"}, folder / "p.html"), HasSubstr("4 values are not finite"));
}

TEST(ReportPage, BadInputIsAnErrorThatNamesIt) {
  const TemporaryFolder folder("report");
  const RunResult missing = run_program({"report", folder / "nowhere"});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, HasSubstr("nowhere: does not exist, expected a folder with results"));
  fs::create_directories(folder / "empty");
  EXPECT_THAT(run_program({"report", folder / "empty"}).err, HasSubstr("has no results that can be read, expected run.json"));
  folder.write("bad/run.json", "{");
  EXPECT_THAT(run_program({"report", folder / "bad"}).err, HasSubstr("run.json is damaged"));
  folder.write("r/signals.csv", "time,a\n0,1\n");
  EXPECT_EQ(run_program({"report", folder / "r", "-o", folder / "no/folder/x.html"}).code, 2);
  const RunResult over = run_program({"report", folder / "r/signals.csv", "-o", folder / "r/signals.csv"});
  EXPECT_EQ(over.code, 2);
  EXPECT_THAT(over.err, HasSubstr("is one of the results"));
  EXPECT_EQ(content(folder / "r/signals.csv"), "time,a\n0,1\n");
}

TEST(ReportPage, ARecordThatIsNotOfTheRecordingIsNamed) {
  const TemporaryFolder folder("report");
  const std::string record =
      R"({"state": "complete", "tick": 0.5, "reached": 2, "rows": 3, "dropped_rows": 0, "recording": {"file": "signals.csv", "every": 2,
          "columns": [{"name": "time", "elements": 1}, {"name": "a.q", "elements": 2}, {"name": "b", "elements": 1}]}})";
  folder.write("r/run.json", record);
  const auto notes_of = [&](const std::string& recording) {
    folder.write("r/signals.csv", recording);
    const RunResult report = run_program({"report", folder / "r"});
    EXPECT_EQ(report.code, 0);
    if (!report.err.empty()) {
      EXPECT_THAT(content(folder / "r/report.html"), HasSubstr("run.json does not fit"));
    }
    return report.err;
  };
  EXPECT_THAT(notes_of("time,a.q[1],a.q[2],b\n0,1,1,1\n1,1,1,1\n2,1,1,1\n"), Not(HasSubstr("fit")));
  EXPECT_THAT(notes_of("time,a.q[1],a.q[2],b\n0,1,1,1\n1,1,1,1\n"),
              HasSubstr("note: run.json does not fit signals.csv, which has 2 rows, expected 3"));
  EXPECT_THAT(notes_of("time,a.q[1],a.q[2],b\n0,1,1,1\n1,1,1,1\n3,1,1,1\n"), HasSubstr("its end at 3 s, expected 2 s"));
  EXPECT_THAT(notes_of("time,a.q[1],a.q[2],c\n0,1,1,1\n1,1,1,1\n2,1,1,1\n"), HasSubstr("a column 'c', expected one of 'b'"));
  EXPECT_THAT(notes_of("time,b\n0,1\n1,1\n2,1\n"), HasSubstr("1 column besides the time, expected 3"));
}

TEST(ReportPage, TellsOfDamagedDataAlsoOnStderr) {
  const TemporaryFolder folder("report");
  folder.write("log.csv", "time_ms,a\n0,1\n500,x\n1000,2\n");
  const RunResult without = run_program({"report", folder / "log.csv"});
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.err, HasSubstr("has no column 't', 'time' or 'timestamp', expected one or --t-column NAME"));
  const RunResult report = run_program({"report", folder / "log.csv", "--t-column", "time_ms", "--time-unit", "ms"});
  EXPECT_EQ(report.code, 0);
  EXPECT_THAT(report.err, HasSubstr("cotwin: note: 1 cell is not a number"));
  const RunResult unknown = run_program({"report", folder / "log.csv", "--t-column", "time_ms", "--signals", "nix*"});
  EXPECT_EQ(unknown.code, 2);
  EXPECT_THAT(unknown.err, HasSubstr("--signals: no signal 'nix*'"));
  fs::create_directories(folder / "r");
  EXPECT_THAT(run_program({"report", folder / "r", "--time-unit", "ms"}).err, HasSubstr("expected a CSV file"));
}

TEST(ReportPage, WithoutGnuplotHasTablesAndSaysSo) {
  const TemporaryFolder folder("report");
  folder.write("r/signals.csv", "time,a\n0,1\n1,5\n");
  const RunResult report = run_program({"report", folder / "r"}, {.environment = {"COTWIN_GNUPLOT=/nonexistent"}});
  EXPECT_EQ(report.code, 0);
  EXPECT_THAT(report.err, HasSubstr("tables and no plots"));
  EXPECT_EQ(wrong_in(folder / "r/report.html"), "");
  const std::string page = content(folder / "r/report.html");
  EXPECT_THAT(
      page, AllOf(HasSubstr("Plots are missing"), HasSubstr("<td class=\"n\">5</td>"), Not(HasSubstr("<svg class=\"plot\""))));
}

TEST(ReportPage, AMillionSamplesStaySmall) {
  const TemporaryFolder folder("report");
  fs::create_directories(folder / "r");
  {
    std::ofstream out(folder / "r/signals.csv");
    out << "time,noise[1],noise[2]\n";
    unsigned x = 1;
    for (int i = 0; i < 1'000'000; ++i) {
      x = 1664525u * x + 1013904223u;
      out << i << ',' << (x >> 20) << ',' << (x >> 24) << '\n';
    }
  }
  EXPECT_LT(page_of({folder / "r"}, folder / "page.html").size(),
            200'000u);  // a curve of noise has at most 4000 points of 12 bytes
}

TEST(ReportPage, ChoosesSignals) {
  const TemporaryFolder folder("report");
  folder.write("r/signals.csv", "time,a.q[1],a.q[2],b.q\n0,1,2,3\n1,2,1,4\n");
  ASSERT_EQ(run_program({"report", folder / "r", "--signals", "b.*"}).code, 0);
  EXPECT_THAT(content(folder / "r/report.html"), AllOf(HasSubstr("<h4>b.q</h4>"), Not(HasSubstr("<h4>a.q</h4>"))));
  std::string wide = "time", row = "0";
  for (int i = 0; i < 3000; ++i) wide += ",c" + std::to_string(i) + ".x", row += ",1";
  folder.write("wide/signals.csv", wide + "\n" + row + "\n");
  EXPECT_THAT(page_of({folder / "wide"}, folder / "wide.html"),
              AllOf(HasSubstr("Only the first 400 of 3000 columns are plotted"), HasSubstr("a page has at most")));
}

TEST(ReportPage, OfATuningShowsTorquesConvergenceAndParameters) {
  const cotwin::testing::TunedRobot robot;
  cotwin::master::tuning::Settings settings = robot.settings();
  settings.rounds = 20;
  robot.tune(settings, "out");
  const std::string page = page_of({robot.folder / "out"}, robot.folder / "page.html");
  for (const char* text : {"Tuning of ", "Held out, which no solver has seen", "Convergence of the swarm", "20 rounds",
                           "Parameters before and after", "mass [kg]", "viscous friction", "standard deviation", "(written)"})
    EXPECT_THAT(page, HasSubstr(text));
  if (gnuplot().available()) {
    EXPECT_EQ(count(page, "<svg class=\"plot\""), 15u);  // two for each joint, and the convergence
  }
  fs::remove(robot.folder / "out/torques.csv");
  EXPECT_THAT(page_of({robot.folder / "out", robot.folder / "out"}, robot.folder / "page.html"),
              AllOf(HasSubstr("There is no torques.csv"), HasSubstr("errors of the robots that were written")));
}

}  // namespace
}  // namespace report_test
