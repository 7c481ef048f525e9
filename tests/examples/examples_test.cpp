// Runs every example that has expected figures with the built program and compares the results with these figures. A file
// examples/<folder>/<scenario>.expected.json is a test:
//   {
//     "needs": ["measurements/…"],                 public data (examples/public_data.md) without which the test is skipped
//     "scenario": "twin.ssd",                      if it is not <scenario>.ssd
//     "command": "search",                         or farm, in place of run; its JSON is the summary
//     "script": "run.sh",                          in place of run: a script of several processes, with a free UDP port in PORT and
//                                                  the folder for results in OUT; figures have "of": a folder in it, and perhaps
//                                                  "minus_of" for the signal that is subtracted
//     "options": ["--set", "a.b=1"],               of the command; a file {data}/… in one is public data
//     "figures": [
//       {"what": "…", "summary": "/ticks", …},                                     a JSON pointer into the summary
//       {"what": "…", "signal": "a.x[1]", "minus": "b.x[1]", "at": 2.5, …},        the recorded sample nearest to an instant
//       {"what": "…", "signal": "a.x[1]", "from": 0, "to": 3, …}                   all samples within an interval
//     ]
//   }
// where … is one or several of "is" with "within", "below", "above".
//
// To find bounds: COTWIN_PRINT_FIGURES=1 prints the minimum and the maximum of each figure, and COTWIN_EXAMPLE_SET=a.b=c
// changes the scenario slightly (scripts/sensitivity.sh).
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/free_port.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"

namespace examples_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using nlohmann::json;

std::vector<std::string> expectations() {
  std::vector<std::string> found;
  for (const fs::directory_entry& entry : fs::recursive_directory_iterator(fs::path(cotwin::places::source()) / "examples")) {
    const std::string name = entry.path().string();
    if (name.ends_with(".expected.json"))
      found.push_back(fs::relative(entry.path(), cotwin::places::source()).generic_string());
  }
  std::sort(found.begin(), found.end());
#if defined(__SANITIZE_ADDRESS__)
  // One of each folder: the others run the same code with other numbers.
  const auto folder = [](const std::string& file) { return fs::path(file).parent_path(); };
  found.erase(std::unique(found.begin(), found.end(), [&](const auto& a, const auto& b) { return folder(a) == folder(b); }),
              found.end());
#endif
  return found;
}

void add_options(std::vector<std::string>& command, const json& expected) {
  for (std::string option : expected.value("options", std::vector<std::string>{})) {
    if (const std::size_t at = option.find("{data}/"); at != std::string::npos)
      option.replace(at, std::string::npos, cotwin::places::public_data(option.substr(at + 7)));
    command.push_back(option);
  }
}

/// A recording: time and columns by name.
struct Table {
  std::map<std::string, std::vector<double>> columns;

  const std::vector<double>* find(const std::string& name) const {
    auto found = columns.find(name);
    return found == columns.end() ? nullptr : &found->second;
  }
};

Table read_table(const fs::path& file) { return {cotwin::testing::read_recording(file)}; }

/// The values that a figure refers to. Empty, with a test failure, if there are none.
std::vector<double> values_of(const json& figure, const json& summary, const Table& table) {
  if (figure.contains("summary")) {
    const json::json_pointer pointer(figure.at("summary").get<std::string>());
    if (summary.contains(pointer) && summary.at(pointer).is_number()) return {summary.at(pointer).get<double>()};
    ADD_FAILURE() << "the summary has no number " << pointer.to_string();
    return {};
  }
  const auto* time = table.find("time");
  const auto* signal = table.find(figure.at("signal").get<std::string>());
  const auto* minus = figure.contains("minus") ? table.find(figure.at("minus").get<std::string>()) : nullptr;
  if (time == nullptr || signal == nullptr || (figure.contains("minus") && minus == nullptr)) {
    ADD_FAILURE() << "the recording lacks a column of this figure";
    return {};
  }
  const auto value = [&](std::size_t k) { return (*signal)[k] - (minus != nullptr ? (*minus)[k] : 0); };
  std::vector<double> values;
  if (figure.contains("at")) {
    const double at = figure.at("at").get<double>();
    const auto nearest =
        std::min_element(time->begin(), time->end(), [&](double a, double b) { return std::abs(a - at) < std::abs(b - at); });
    if (nearest != time->end()) values.push_back(value(static_cast<std::size_t>(nearest - time->begin())));
  } else {
    const double from = figure.at("from").get<double>(), to = figure.at("to").get<double>();
    for (std::size_t k = 0; k < time->size(); ++k) {
      if ((*time)[k] >= from && (*time)[k] <= to) values.push_back(value(k));
    }
  }
  if (values.empty()) ADD_FAILURE() << "no sample at that time";
  return values;
}

void check(const json& figure, const json& summary, const Table& table) {
  SCOPED_TRACE(figure.dump());
  ASSERT_TRUE(figure.contains("is") || figure.contains("below") || figure.contains("above"))
      << "a figure without an expectation";
  const std::vector<double> values = values_of(figure, summary, table);
  if (getenv("COTWIN_PRINT_FIGURES") != nullptr && !values.empty()) {
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    std::printf("figure\t%s\t%.9g\t%.9g\n", figure.at("what").get<std::string>().c_str(), *least, *most);
  }
  for (const double value : values) {
    ASSERT_TRUE(std::isfinite(value));
    if (figure.contains("is")) {
      ASSERT_NEAR(value, figure.at("is").get<double>(), figure.at("within").get<double>());
    }
    if (figure.contains("below")) {
      ASSERT_LT(value, figure.at("below").get<double>());
    }
    if (figure.contains("above")) {
      ASSERT_GT(value, figure.at("above").get<double>());
    }
  }
}

/// Runs the script of an example and checks the figures.
void run_processes(const fs::path& script, const json& expected) {
  const TemporaryFolder results("example");
  const std::vector<std::string> environment = {"COTWIN=" + cotwin::places::program(), "OUT=" + results.path().string(),
                                                "PORT=" + std::to_string(cotwin::testing::free_ports())};
  std::vector<std::string> command = {script, "--quiet"};
  add_options(command, expected);
  const RunResult ran = cotwin::testing::run_command(command, {.environment = environment, .merge = true});
  ASSERT_EQ(ran.code, 0) << ran.out;
  std::map<std::string, Table> tables;
  for (json figure : expected.at("figures")) {
    const auto of = figure.at("of").get<std::string>();
    if (of.ends_with(".json")) {
      check(figure, json::parse(std::ifstream(results.path() / of)), {});
      continue;
    }
    if (!tables.contains(of)) tables[of] = read_table(results.path() / of / "signals.csv");
    Table& table = tables[of];
    if (figure.contains("minus_of")) {
      const auto other = figure.at("minus_of").get<std::string>(), minus = figure.at("minus").get<std::string>();
      const Table source = read_table(results.path() / other / "signals.csv");
      ASSERT_NE(source.find(minus), nullptr) << minus;
      const std::string column = other + "/" + minus;
      table.columns[column] = *source.find(minus);
      for (auto& [name, values] : table.columns) values.resize(std::min(values.size(), table.columns[column].size()));
      figure["minus"] = column;
    }
    check(figure, {}, table);
  }
}

class Example : public testing::TestWithParam<std::string> {};

TEST_P(Example, RunsAndGivesTheExpectedFigures) {
  const fs::path file = fs::path(cotwin::places::source()) / GetParam();
  const json expected = json::parse(std::ifstream(file));
  for (const std::string& need : expected.value("needs", std::vector<std::string>{})) {
    if (!fs::exists(cotwin::places::public_data(need))) GTEST_SKIP() << "needs " << need << " (examples/public_data.md)";
  }
  if (expected.contains("script"))
    return run_processes(file.parent_path() / expected.at("script").get<std::string>(), expected);
  std::string scenario = file.string();
  scenario.replace(scenario.size() - std::string(".expected.json").size(), std::string::npos, ".ssd");
  if (expected.contains("scenario")) scenario = file.parent_path() / expected.at("scenario").get<std::string>();

  const TemporaryFolder results("example");
  const fs::path summary = results.path() / "summary.json";
  const std::string name = expected.value("command", "run");
  std::vector<std::string> command = {name, scenario, "--quiet", "--json", summary};
  if (name != "search") command.insert(command.end(), {"--out", results.path()});
  add_options(command, expected);
  if (const char* set = getenv("COTWIN_EXAMPLE_SET")) command.insert(command.end(), {"--set", set});
  const RunResult ran = run_program(command);
  ASSERT_EQ(ran.code, 0) << ran.err;

  const json results_json = json::parse(std::ifstream(summary));
  const Table table = read_table(results.path() / "signals.csv");
  ASSERT_FALSE(expected.at("figures").empty());
  for (const json& figure : expected.at("figures")) check(figure, results_json, table);
}

// The twin of example 01 is used as an unknown robot and its recording as the log, with the measured external torques. Except
// at jumps, own_robot.ssd computes the joint torques of that log from the motion alone.
TEST(OwnRobot, TheTorquesOfAnotherTwinsLogAreFoundFromItsMotion) {
  const TemporaryFolder folder("example");
  const fs::path examples = fs::path(cotwin::places::source()) / "examples", summary = folder.path() / "summary.json";
  const RunResult robot =
      run_program({"run", examples / "01_joint_admittance/arm.ssd", "--quiet", "--out", folder.path() / "log", "--record",
                   "drive.q", "--record", "drive.tau_J", "--record", "drive.tau_e"});
  ASSERT_EQ(robot.code, 0) << robot.err;
  const RunResult twin = run_program({"run",
                                      examples / "03_dynamics_capture/own_robot.ssd",
                                      "--quiet",
                                      "--out",
                                      folder.path() / "twin",
                                      "--json",
                                      summary,
                                      "--stop",
                                      "27.9",
                                      "--set",
                                      "robot=planar2",
                                      "--set",
                                      "recording.file=" + (folder.path() / "log/signals.csv").string(),
                                      "--set",
                                      "recording.q_cutoff=20",
                                      "--set",
                                      "recording.q_columns=drive.q[{}]",
                                      "--set",
                                      "recording.tau_columns=drive.tau_J[{}]",
                                      "--set",
                                      "recording.tau_e_columns=drive.tau_e[{}]"});
  ASSERT_EQ(twin.code, 0) << twin.err;
  const json results_json = json::parse(std::ifstream(summary));
  for (const json& comparison : results_json.at("comparisons")) {
    for (const int part : {2, 5, 7}) {  // no jump within, nor just before
      for (const json& rms : comparison.at("segment_rms").at(part)) EXPECT_LT(rms.get<double>(), 1e-4) << comparison.at("name");
    }
    for (const json& rms : comparison.at("rms")) EXPECT_LT(rms.get<double>(), 0.5) << comparison.at("name");
  }
  EXPECT_GT(results_json.at("signals").at(0).at("total_rms"), 10.0);  // N.m: the torques are not small
}

/// Runs a script of the examples in `folder` with `environment` and nothing else.
RunResult run_script(std::vector<std::string> environment, const std::string& script, const TemporaryFolder& folder) {
  environment.push_back("PATH=/usr/bin:/bin");
  return cotwin::testing::run_command(
      {fs::path(cotwin::places::source()) / "examples" / script, "panda"},
      {.folder = folder.path(), .environment = environment, .only_this_environment = true, .merge = true});
}

class Script : public ::testing::TestWithParam<std::string> {};

TEST_P(Script, ReportsAMissingProgramAndMissingPublicData) {
  const TemporaryFolder folder("example");
  const RunResult no_program = run_script({"COTWIN=/nowhere/cotwin"}, GetParam(), folder);
  EXPECT_EQ(no_program.code, 2);
  EXPECT_THAT(no_program.out, ::testing::HasSubstr("no program '/nowhere/cotwin', expected it in"));
  const RunResult no_data = run_script({"COTWIN=" + cotwin::places::program(), "DATA=/nowhere"}, GetParam(), folder);
  EXPECT_EQ(no_data.code, 2);
  EXPECT_THAT(no_data.out, ::testing::HasSubstr("not in /nowhere: models/panda_franka_ros.urdf measurements/panda_unisa.csv"));
  EXPECT_THAT(no_data.out, ::testing::HasSubstr("scripts/fetch_logs.py"));
  EXPECT_THAT(no_data.out, ::testing::HasSubstr("examples/public_data.md"));
}

TEST_P(Script, RunsInAFolderWithABlankInItsName) {
  const TemporaryFolder folder("example");
  fs::create_directories(folder.path() / "my data/models");
  fs::create_directories(folder.path() / "my data/measurements");
  std::ofstream(folder.path() / "my data/models/panda_franka_ros.urdf") << "x";
  std::ofstream(folder.path() / "my data/measurements/panda_unisa.csv") << "x";
  std::ofstream(folder.path() / "program") << "#!/bin/sh\nfor word; do echo \"<$word>\"; done\n";
  fs::permissions(folder.path() / "program", fs::perms::owner_all);
  const RunResult run = run_script({"COTWIN=./program", "DATA=my data"}, GetParam(), folder);
  EXPECT_EQ(run.code, 0) << run.out;
  EXPECT_THAT(run.out, ::testing::HasSubstr("my data/models/panda_franka_ros.urdf>"));
}

INSTANTIATE_TEST_SUITE_P(Examples, Script, testing::Values("03_dynamics_capture/run.sh", "06_real_robots/run.sh"),
                         [](const auto& script) { return script.param.substr(3, script.param.find('/') - 3); });

std::string name_of(const testing::TestParamInfo<std::string>& file) {
  std::string name = fs::path(file.param).parent_path().filename().string() + "_" + fs::path(file.param).filename().string();
  name.resize(name.size() - std::string(".expected.json").size());
  std::replace_if(
      name.begin(), name.end(), [](unsigned char c) { return std::isalnum(c) == 0; }, '_');
  return name;
}

INSTANTIATE_TEST_SUITE_P(Folder, Example, testing::ValuesIn(expectations()), name_of);

}  // namespace
}  // namespace examples_test
