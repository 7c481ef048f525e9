// cotwin plot: charts by gnuplot.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <regex>

#include "tests/support/files.h"
#include "tests/support/run_program.h"

namespace plot_command_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::run_command;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

bool has_gnuplot() {
  static const bool has = run_command({"sh", "-c", "command -v gnuplot"}).code == 0;
  return has;
}

class Plot : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!has_gnuplot()) GTEST_SKIP() << "needs gnuplot";
  }
  RunResult plot(std::vector<std::string> arguments, std::vector<std::string> environment = {}) {
    arguments.insert(arguments.begin(), "plot");
    return run_program(std::move(arguments), {.folder = folder_.path(), .environment = std::move(environment)});
  }
  /// A recording with two elements of a torque, a position and units of measure.
  void write_results() {
    std::string csv = "time,drive.tau_J[1],drive.tau_J[2],drive.q\n";
    for (int k = 0; k <= 100; ++k) {
      const double t = 0.01 * k;
      csv += std::to_string(t) + "," + std::to_string(std::sin(6 * t)) + "," +
             (k == 50 ? "nan" : std::to_string(std::cos(6 * t))) + "," + std::to_string(t * t) + "\n";
    }
    folder_.write("results/signals.csv", csv);
    folder_.write("results/run.json", R"({"recording": {"columns": [{"name": "time", "elements": 1, "unit": "s"},
      {"name": "drive.tau_J", "elements": 2, "unit": "N.m"}, {"name": "drive.q", "elements": 1, "unit": "rad"}]}})");
  }
  TemporaryFolder folder_{"plot"};
};

/// The number of curves in the SVG: gnuplot numbers them.
std::size_t curves_of(const std::string& svg) {
  const std::regex curve("<g id=\"gnuplot_plot_[0-9]+[a-z]?\"");
  return static_cast<std::size_t>(std::distance(std::sregex_iterator(svg.begin(), svg.end(), curve), {}));
}

TEST_F(Plot, DrawsTheElementsOfAVectorWithTheirUnit) {
  write_results();
  const RunResult result = plot({"results", "drive.tau_J"});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_EQ(result.out, "results/plot.svg\n");
  const std::string svg = content(folder_ / "results/plot.svg");
  EXPECT_EQ(curves_of(svg), 2u);
  for (const char* text : {"drive.tau_J[1]", "drive.tau_J[2]", "N.m", "time [s]"}) EXPECT_THAT(svg, HasSubstr(text));
  EXPECT_THAT(svg, Not(HasSubstr("drive.q")));
}

TEST_F(Plot, SignalsOfDifferentUnitsGetChartsOfTheirOwn) {
  write_results();
  ASSERT_EQ(plot({"results", "drive.*", "-o", "all.svg"}).code, 0);
  const std::string svg = content(folder_ / "all.svg");
  EXPECT_EQ(curves_of(svg), 3u);
  EXPECT_THAT(svg, HasSubstr("N.m"));
  EXPECT_THAT(svg, HasSubstr(">rad<"));
}

TEST_F(Plot, WritesPngAndPdf) {
  write_results();
  ASSERT_EQ(plot({"results", "drive.q", "-o", "q.png", "--width", "640", "--height", "480"}).code, 0);
  const std::string png = content(folder_ / "q.png");
  EXPECT_THAT(png, StartsWith("\x89PNG"));
  const auto number = [&](std::size_t at) {
    return static_cast<unsigned char>(png.at(at)) * 256 + static_cast<unsigned char>(png.at(at + 1));
  };
  EXPECT_EQ(number(18), 640);
  EXPECT_EQ(number(22), 480);
  ASSERT_EQ(plot({"results", "drive.q", "-o", "q.pdf"}).code, 0);
  EXPECT_THAT(content(folder_ / "q.pdf"), StartsWith("%PDF"));
}

TEST_F(Plot, TakesARunThatGoesOnACsvFileAndAPartOfTheTime) {
  write_results();
  fs::rename(folder_ / "results/signals.csv", folder_ / "results/signals.csv.part");
  ASSERT_EQ(plot({"results", "drive.q"}).code, 0);
  folder_.write("log.csv", "t;a\n0;1\n1;2\n2;9\n");
  ASSERT_EQ(plot({"log.csv", "a", "--from", "0", "--to", "1", "-o", "a.svg"}).code, 0);
  EXPECT_THAT(content(folder_ / "a.svg"), Not(HasSubstr("> 9<")));
  EXPECT_THAT(plot({"log.csv", "a", "--from", "5"}).err, HasSubstr("has no rows in this time"));
}

TEST_F(Plot, LeavesOutACutLastRowAndShowsEmptyCellsAsGaps) {
  folder_.write("r/signals.csv.part", "time,a,b\n0,1,1\n1,,1\n2,2,1\n3,9");
  const RunResult in_a_row = plot({"r", "a", "-o", "a.svg"});
  ASSERT_EQ(in_a_row.code, 0) << in_a_row.err;
  EXPECT_THAT(in_a_row.err, HasSubstr("signals.csv.part:5: 2 cells"));
  EXPECT_THAT(in_a_row.err, HasSubstr("signals.csv.part:3: column 'a'"));
  EXPECT_THAT(content(folder_ / "a.svg"), Not(HasSubstr("> 9<")));
  EXPECT_THAT(plot({"r", "b"}).err, Not(HasSubstr("column 'a'")));
  folder_.write("log.csv", "time_ms,a\n0,1\n500,2\n1000,9");
  const RunResult in_a_number = plot({"log.csv", "a", "--t-column", "time_ms", "--time-unit", "ms", "--to", "0.5"});
  ASSERT_EQ(in_a_number.code, 0) << in_a_number.err;
  EXPECT_THAT(in_a_number.err, HasSubstr("no line end"));
  folder_.write("comma.csv", "t;a\n0,1;1\n0,2;1\n");
  const RunResult comma = plot({"comma.csv", "a"});
  EXPECT_EQ(comma.code, 2);
  EXPECT_THAT(comma.err, HasSubstr("comma.csv:2: column 't': '0,1' has a decimal comma"));
}

TEST_F(Plot, NamesRunNoCommandsAndAreNoMarkup) {
  std::string name = "x'; system(\"touch pwned\"); `touch pwned` <script>alert(1)</script> & @y $(touch pwned) \\n {/:b} %s";
  name += "\x01\xff";
  std::string quoted = name;
  for (std::size_t at = 0; (at = quoted.find('"', at)) != std::string::npos; at += 2) quoted.insert(at, 1, '"');
  folder_.write("odd.csv", "t,\"" + quoted + "\"\n0,1\n1,2\n");
  const RunResult result = plot({"odd.csv", "*", "-o", "odd.svg", "--title", name});
  ASSERT_EQ(result.code, 0) << result.err;
  EXPECT_FALSE(fs::exists(folder_ / "pwned"));
  const std::string svg = content(folder_ / "odd.svg");
  EXPECT_THAT(svg, HasSubstr("touch pwned"));
  EXPECT_THAT(svg, Not(HasSubstr("<script>alert")));
  if (run_command({"sh", "-c", "command -v xmllint"}).code == 0) {
    EXPECT_EQ(run_command({"xmllint", "--noout", folder_ / "odd.svg"}).code, 0);
  }
  // gnuplot runs programs for names of files that begin with '|' or '<'.
  const RunResult piped = plot({"odd.csv", "*", "-o", "|touch pwned;.svg"});
  EXPECT_EQ(piped.code, 0) << piped.err;
  EXPECT_FALSE(fs::exists(folder_ / "pwned"));
  EXPECT_TRUE(fs::exists(folder_ / "|touch pwned;.svg"));
}

TEST_F(Plot, TheUsersConfigurationOfGnuplotIsNotRead) {
  write_results();
  folder_.write(".gnuplot", "set title 'FROM THE CONFIGURATION'\n");
  ASSERT_EQ(plot({"results", "drive.q"}, {"HOME=" + folder_.path().string()}).code, 0);
  EXPECT_THAT(content(folder_ / "results/plot.svg"), Not(HasSubstr("FROM THE CONFIGURATION")));
}

TEST_F(Plot, LongRecordingsBecomeSmallPicturesThatKeepPeaks) {
  std::string csv = "t,x\n";
  for (int k = 0; k < 200'000; ++k) csv += std::to_string(k) + (k == 123'457 ? ",777\n" : k % 2 == 0 ? ",1\n" : ",-1\n");
  folder_.write("long.csv", csv);
  ASSERT_EQ(plot({"long.csv", "x", "-o", "long.svg"}).code, 0);
  EXPECT_LT(fs::file_size(folder_ / "long.svg"), 200'000u);
  EXPECT_THAT(content(folder_ / "long.svg"), HasSubstr("> 800<"));  // the axis reaches the single peak
}

TEST(PlotErrors, NameWhatIsMissing) {
  const TemporaryFolder folder("plot");
  const auto plot = [&](std::vector<std::string> arguments, std::vector<std::string> environment = {}) {
    arguments.insert(arguments.begin(), "plot");
    return run_program(std::move(arguments), {.folder = folder.path(), .environment = std::move(environment)});
  };
  fs::create_directories(folder / "empty");
  EXPECT_THAT(plot({"empty", "x"}).err, HasSubstr("has no signals.csv"));
  EXPECT_EQ(plot({"nowhere", "x"}).code, 2);
  folder.write("log.csv", "t,drive.q\n0,1\n");
  const RunResult wrong = plot({"log.csv", "drive.p"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("no signal 'drive.p'; did you mean 'drive.q'?"));
  folder.write("vectors.csv", "time,drive.q[1],drive.q[2],drive.tau_J[1],drive.tau_J[2]\n0,1,2,3,4\n1,1,2,3,4\n");
  EXPECT_THAT(plot({"vectors.csv", "drive.tauJ"}).err, HasSubstr("no signal 'drive.tauJ'; did you mean 'drive.tau_J[1]'?"));
  EXPECT_THAT(plot({"twin.ssd", "drive.q"}).err, HasSubstr("twin.ssd: is a scenario, expected the folder of its results"));
  EXPECT_THAT(plot({"log.csv", "q"}).err, HasSubstr("no signal 'q'; did you mean 'drive.q'?"));
  folder.write("two.csv", "t,a.q[1],a.q[2],b.q\n0,1,2,3\n");
  EXPECT_THAT(plot({"two.csv", "q"}).err, HasSubstr("no signal 'q'; did you mean 'a.q' or 'b.q'?"));
  EXPECT_THAT(plot({"log.csv", "drive.q", "-o", "x.gif"}).err, HasSubstr("expected a name that ends in .svg, .png or .pdf"));
  folder.write("nan.csv", "t,x\n0,nan\n1,inf\n");
  EXPECT_THAT(plot({"nan.csv", "x"}).err, HasSubstr("'x' has no finite value"));
  EXPECT_THAT(plot({"log.csv", "drive.q", "--from", "2", "--to", "1"}).err, HasSubstr("expected a time and a later one"));
  fs::create_directories(folder / "bin");
  const RunResult without = plot({"log.csv", "drive.q"}, {"PATH=" + (folder / "bin").string()});
  EXPECT_EQ(without.code, 2);
  EXPECT_THAT(without.err, HasSubstr("gnuplot: the program 'gnuplot' is not installed (Debian: gnuplot-nox)"));
  folder.write("bin/gnuplot",
               "#!/bin/sh\n[ \"$1\" = --version ] && echo 'gnuplot 5.4' && exit\necho 'no such terminal' >&2\nexit 1\n");
  fs::permissions(folder / "bin/gnuplot", fs::perms::owner_all);
  EXPECT_THAT(plot({"log.csv", "drive.q"}, {"PATH=" + (folder / "bin").string() + ":/usr/bin:/bin"}).err,
              HasSubstr("gnuplot: no such terminal"));
  EXPECT_FALSE(fs::exists(folder / "plot.svg"));
}

}  // namespace
}  // namespace plot_command_test
