#include "master/run/recorder.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <bit>
#include <cmath>
#include <csignal>
#include <fstream>
#include <random>
#include <sstream>

#include "models/foundation/support/text.h"
#include "tests/master/test_units.h"

namespace cotwin::master::recorder_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

/// A folder of this test, removed at the end.
class Recording : public ::testing::Test {
 protected:
  Recording() { std::filesystem::create_directories(folder_); }
  ~Recording() override { std::filesystem::remove_all(folder_); }

  static std::vector<std::string> lines(const std::filesystem::path& file) {
    std::ifstream in(file);
    std::vector<std::string> all;
    for (std::string line; std::getline(in, line);) all.push_back(line);
    return all;
  }
  static std::vector<double> numbers(const std::string& line) {
    std::vector<double> row;
    for (const std::string_view field : text::split(line, ',')) row.push_back(text::parse_real(field).value());
    return row;
  }
  static std::vector<Column> column_of(Variable& variable) {
    Column column{{}, {0, &variable, 0, variable.size(), "u." + variable.name}};
    for (std::size_t i = 0; i < variable.size(); ++i) column.names.push_back(element_name("u", variable, i));
    return {column};
  }

  const std::filesystem::path folder_ =
      std::filesystem::temp_directory_path() /
      ("cotwin_recorder_" + std::to_string(::getpid()) + "_" + ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(Recording, HasTimeFirstExactNamesAndEveryTick) {
  Build b;
  b.unit("a", "gain?n=2").with("bias", 0.5).unit("p", "probe").until(0.003);
  {
    Master master = b.load(folder_ / "deep" / "er");
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
    EXPECT_EQ(master.summary().rows, 4);
  }
  EXPECT_THAT(lines(folder_ / "deep" / "er" / "signals.csv"),
              ElementsAre("time,a.y[1],a.y[2],p.steps,p.now,p.h,p.t,p.odd",  //
                          "0,0.5,0.5,0,0,0,0,0", "0.001,0.5,0.5,1,0,0.001,0.001,1", "0.002,0.5,0.5,2,0.001,0.001,0.002,0",
                          "0.003,0.5,0.5,3,0.002,0.001,0.003,1"));
}

TEST_F(Recording, TakesEveryFewTicksAndTheLast) {
  Build b;
  b.unit("p", "probe").record("p.steps").until(0.01);
  b.scenario.decimation = 4;
  Master master = b.load(folder_);
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  EXPECT_THAT(lines(folder_ / "signals.csv"), ElementsAre("time,p.steps", "0,0", "0.004,4", "0.008,8", "0.01,10"));
}

TEST_F(Recording, ReadsBackToTheSameBits) {
  std::mt19937_64 random(7);
  std::array<double, 5> values{};
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(values);
  Recorder recorder(column_of(variable), folder_ / "bits.csv", {});
  std::vector<std::array<double, 5>> written;
  for (int row = 0; row < 20000; ++row) {
    for (double& v : values) {
      do {
        v = std::bit_cast<double>(random());
      } while (!std::isfinite(v));
    }
    if (row % 3 == 0) values[1] = 0.1;  // mostly at rest
    if (row % 5 == 0) values[2] = row % 2 == 0 ? 0.0 : -0.0;
    if (row % 2 == 1) values[3] = written.back()[0];  // an input that repeats an output
    if (row % 7 == 0) values[4] = values[0];
    written.push_back(values);
    recorder.sample(Time{row * std::int64_t{1'234'567}});
  }
  recorder.close();
  const auto rows = lines(folder_ / "bits.csv");
  ASSERT_EQ(rows.size(), written.size() + 1);
  for (std::size_t r = 0; r < written.size(); ++r) {
    const std::vector<double> read = numbers(rows[r + 1]);
    ASSERT_EQ(read[0], static_cast<double>(static_cast<std::int64_t>(r) * 1'234'567) / 1e9) << rows[r + 1];
    for (std::size_t i = 0; i < 5; ++i) {
      ASSERT_EQ(std::bit_cast<std::uint64_t>(read[i + 1]), std::bit_cast<std::uint64_t>(written[r][i])) << rows[r + 1];
    }
  }
}

TEST_F(Recording, HasNamesOfJointsInItsHeadingOnRequest) {
  Build b;
  b.unit("a", "arm").unit("g", "gain").record("a.y").record("a.u[2]").record("g.y").until(0.001);
  MasterOptions options;
  options.types = cotwin::testing::test_types();
  options.results = folder_;
  options.joint_names = true;
  Master master(b.scenario, std::move(options));
  master.initialise();
  master.finish();
  EXPECT_EQ(lines(folder_ / "signals.csv").at(0), "time,\"a.u[my, slide]\",a.y[elbow],\"a.y[my, slide]\",a.y[roll],g.y");
}

/// The rows of a file of view_heading() with `width` columns.
std::vector<std::pair<std::int64_t, std::vector<float>>> packed_rows(const std::filesystem::path& file, std::size_t width) {
  std::ifstream in(file, std::ios::binary);
  std::string heading;
  std::getline(in, heading);
  std::vector<std::pair<std::int64_t, std::vector<float>>> rows;
  std::int64_t ns = 0;
  while (in.read(reinterpret_cast<char*>(&ns), sizeof ns)) {
    std::vector<float> row(width);
    in.read(reinterpret_cast<char*>(row.data()), static_cast<std::streamsize>(width * sizeof(float)));
    rows.emplace_back(ns, row);
  }
  return rows;
}

// tick 1 ms: a row every 16 ticks, 62.5 times a second, and the last one.
TEST_F(Recording, HasBesideItWhatPagesShow) {
  Build b;
  b.unit("i", "integrator").with("u", 2.0).unit("hand", "shown").connect("i.y", "hand.u").record("hand.u").until(0.05);
  const auto run = [&](const char* folder, bool view) {
    MasterOptions options;
    options.types = cotwin::testing::test_types();
    options.results = folder_ / folder;
    options.view_data = view;
    Master master(b.scenario, std::move(options));
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
  };
  run("with", true);
  const auto rows = packed_rows(folder_ / "with/view.bin", 1);
  ASSERT_EQ(rows.size(), 5u);
  const std::vector<std::string> csv = lines(folder_ / "with/signals.csv");
  for (const auto& [ns, values] : rows) {
    const std::vector<double> row = numbers(csv.at(1 + static_cast<std::size_t>(ns / 1'000'000)));
    EXPECT_EQ(ns % 16'000'000 == 0 || ns == 50'000'000, true) << ns;
    EXPECT_EQ(values[0], static_cast<float>(2 * row[1]));
  }
  EXPECT_EQ(
      lines(folder_ / "with/view.bin").at(0),
      R"({"format":"cotwin view 1","columns":[{"name":"time","elements":1,"unit":"s"},{"name":"hand.q","elements":1,"unit":"rad"}]})");
  run("without", false);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "without/view.bin"));
  EXPECT_EQ(lines(folder_ / "without/signals.csv"), csv);
  b.record("hand.q");  // as often as pages want it
  run("recorded", true);
  EXPECT_FALSE(std::filesystem::exists(folder_ / "recorded/view.bin"));
  b.scenario.decimation = 17;
  run("seldom", true);
  EXPECT_TRUE(std::filesystem::exists(folder_ / "seldom/view.bin"));
}

TEST_F(Recording, DistinguishesAnIntegerFromTheRealOfTheSameValue) {
  std::array<double, 1> real{1e9};
  std::array<std::int32_t, 1> integer{1'000'000'000};
  Variable x, n;
  x.name = "x";
  x.storage = std::span<double>(real);
  n.name = "n";
  n.storage = std::span<std::int32_t>(integer);
  std::vector<Column> columns = column_of(x);
  columns.push_back(column_of(n).front());
  Recorder recorder(columns, folder_ / "kinds.csv", {});
  recorder.sample(Time{0});
  real[0] = 0;
  integer[0] = 1;
  recorder.sample(Time{1'000'000'000});
  real[0] = 1e9;
  integer[0] = 1'000'000'000;
  recorder.sample(Time{2'000'000'000});
  recorder.close();
  EXPECT_THAT(lines(folder_ / "kinds.csv"), ElementsAre("time,u.x,u.n", "0,1e+09,1000000000", "1,0,1", "2,1e+09,1000000000"));
}

TEST_F(Recording, WritesTimesExactly) {
  double x = 1;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  Recorder recorder(column_of(variable), folder_ / "t.csv", {});
  for (const std::int64_t ns : {std::int64_t{0}, std::int64_t{1}, std::int64_t{7'000'000}, std::int64_t{-1'500'000'000},
                                std::int64_t{12'000'000'000}, std::int64_t{99'999'999'999'999'999}}) {
    recorder.sample(Time{ns});
  }
  recorder.close();
  EXPECT_THAT(lines(folder_ / "t.csv"),
              ElementsAre("time,u.x", "0,1", "0.000000001,1", "0.007,1", "-1.5,1", "12,1", "99999999.999999999,1"));
}

TEST_F(Recording, ChoosesByGlobInTheOrderOfTheUnitsAndRefusesUnknownNames) {
  Build b;
  b.unit("a", "gain?n=2").unit("cell.b", "gain?n=2").unit("m", "mixed");
  const auto columns = [&](const std::vector<std::string>& patterns) {
    b.scenario.recording.clear();
    for (const std::string& p : patterns) b.record(p);
    const auto members = load_members(b.scenario, cotwin::testing::test_types(), {});
    std::vector<std::string> names;
    for (const Column& c : choose_columns(b.scenario, members)) names.insert(names.end(), c.names.begin(), c.names.end());
    return names;
  };
  EXPECT_THAT(columns({"*.u", "a.y"}), ElementsAre("a.u[1]", "a.u[2]", "a.y[1]", "a.y[2]", "cell.b.u[1]", "cell.b.u[2]"));
  EXPECT_THAT(columns({"a.*"}), ElementsAre("a.u[1]", "a.u[2]", "a.y[1]", "a.y[2]", "a.gain"));  // not the fixed parameter
  EXPECT_THAT(columns({"a.bias"}), ElementsAre("a.bias"));                                       // unless named
  EXPECT_THAT(columns({"cell.b.y[2]", "a.y[?]"}), ElementsAre("a.y[1]", "a.y[2]", "cell.b.y[2]"));
  EXPECT_THAT(columns({"m.*_out"}), ElementsAre("m.real_out", "m.integer_out", "m.boolean_out"));
  EXPECT_THAT(error_of([&] { columns({"q.*"}); }), HasSubstr("test.ssd:70: nothing to record matches 'q.*'"));
  EXPECT_THAT(error_of([&] { columns({"a.yy"}); }), HasSubstr("did you mean 'a.y'"));
  EXPECT_THAT(error_of([&] { columns({"m.string_out"}); }), HasSubstr("a String, which cannot be recorded"));
}

TEST_F(Recording, QuotesNamesThatWouldBreakTheTable) {
  double x = 1;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  std::vector<Column> columns = column_of(variable);
  columns[0].names[0] = "a,\"b\".x";
  Recorder(columns, folder_ / "q.csv", {}).close();
  EXPECT_THAT(lines(folder_ / "q.csv"), ElementsAre("time,\"a,\"\"b\"\".x\""));
}

TEST_F(Recording, WaitsForTheWriterIfAllowedAndLosesNothing) {
  std::array<double, 8> values{};
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(values);
  Recorder recorder(column_of(variable), folder_ / "full.csv", {true, 1024});  // 64 rows
  for (int row = 0; row < 50000; ++row) {
    values.fill(row + 0.125);
    recorder.sample(Time{row});
  }
  recorder.close();
  EXPECT_EQ(recorder.dropped(), 0);
  const auto rows = lines(folder_ / "full.csv");
  ASSERT_EQ(rows.size(), 50001u);
  for (std::size_t r = 1; r < rows.size(); ++r) ASSERT_EQ(numbers(rows[r])[8], static_cast<double>(r - 1) + 0.125);
}

TEST_F(Recording, DropsAndCountsRowsIfItMustNotWait) {
  std::array<double, 8> values{};
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(values);
  Recorder recorder(column_of(variable), folder_ / "drop.csv", {false, 1024});
  constexpr int kRows = 200000;
  for (int row = 0; row < kRows; ++row) {
    values.fill(row + 0.125);
    recorder.sample(Time{row});
  }
  recorder.close();
  EXPECT_GT(recorder.dropped(), 0);
  EXPECT_EQ(recorder.rows() + recorder.dropped(), kRows);
  EXPECT_EQ(lines(folder_ / "drop.csv").size(), static_cast<std::size_t>(recorder.rows()) + 1);
}

TEST_F(Recording, IsOnDiskSoonAlsoWithoutClosing) {
  double x = 1;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  Recorder recorder(column_of(variable), folder_ / "soon.csv", {});
  recorder.sample(Time{5});
  for (int i = 0; i < 500 && lines(folder_ / "soon.csv.part").size() < 2; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  EXPECT_THAT(lines(folder_ / "soon.csv.part"), ElementsAre("time,u.x", "0.000000005,1"));
}

TEST_F(Recording, ReportsAFullDisk) {
  double x = 0;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  EXPECT_THAT(error_of([&] { Recorder(column_of(variable), "/dev/full", {}); }),
              HasSubstr("/dev/full: cannot be written: No space left"));
}

TEST_F(Recording, ReportsADiskThatBecomesFullAndKeepsTheRows) {
  // A limit on the file's size stands for a full disk.
  rlimit before{};
  getrlimit(RLIMIT_FSIZE, &before);
  const auto old_handler = std::signal(SIGXFSZ, SIG_IGN);
  const rlimit limit{300'000, before.rlim_max};
  setrlimit(RLIMIT_FSIZE, &limit);
  double x = 0;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  const std::string message = error_of([&] {
    Recorder recorder(column_of(variable), folder_ / "limited.csv", {true, 1 << 16});
    for (int row = 0; row < 10'000'000; ++row, x += 0.1) recorder.sample(Time{row});
  });
  setrlimit(RLIMIT_FSIZE, &before);
  std::signal(SIGXFSZ, old_handler);
  EXPECT_THAT(message, HasSubstr("limited.csv: cannot be written: File too large; the recording is incomplete"));
  const auto size = std::filesystem::file_size(folder_ / "limited.csv.part");
  EXPECT_LE(size, 300'000u);
  EXPECT_GT(size, 300'000u - 64);
  std::ifstream in(folder_ / "limited.csv.part");
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  EXPECT_EQ(text.back(), '\n');  // complete rows only
}

TEST_F(Recording, ReportsAFileThatCannotBeOpened) {
  std::ofstream(folder_ / "file") << "in the way";
  double x = 0;
  Variable variable;
  variable.name = "x";
  variable.storage = std::span<double>(&x, 1);
  EXPECT_THAT(error_of([&] { Recorder(column_of(variable), folder_ / "file" / "signals.csv", {}); }),
              HasSubstr("Not a directory"));
}

TEST_F(Recording, KeepsWhatWasSampledBeforeAFailure) {
  Build b;
  b.unit("f", "faulty").with("after", 0.005).record("f.y").until(1);
  Master master = b.load(folder_);
  master.initialise();
  EXPECT_EQ(error_of([&] {
              while (master.step_tick()) {
              }
            }),
            "f.y[3] is nan at t = 0.006 s, expected a finite output");
  master.finish();
  EXPECT_EQ(lines(folder_ / "signals.csv").size(), 7u);  // header, t = 0 … 5 ms
}

}  // namespace
}  // namespace cotwin::master::recorder_test
