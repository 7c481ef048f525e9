// Waypoints and events on the command line, completion by shells, and manual pages.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "master/scenario/event_text.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"

namespace command_line_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::error_of;
using cotwin::testing::read_recording;
using cotwin::testing::run_command;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::TemporaryFolder;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;
using ::testing::Not;

/// planar2 moves through waypoints: motion, compliance, drive; written by `cotwin new`, which connects drive.q0.
class CommandLine : public ::testing::Test {
 protected:
  CommandLine() {
    const RunResult made = run({"new", "--robot", "planar2", "--out", "own"});
    EXPECT_EQ(made.code, 0) << made.err;
  }
  RunResult run(std::vector<std::string> arguments) { return run_program(std::move(arguments), {.folder = folder_.path()}); }
  RunResult run_scenario(const std::string& scenario, std::vector<std::string> options) {
    std::vector<std::string> all = {"run", scenario, "--out", "results", "--overwrite", "--json", "summary.json", "--quiet"};
    all.insert(all.end(), options.begin(), options.end());
    return run(std::move(all));
  }
  RunResult run_own(std::vector<std::string> options) { return run_scenario("own/twin.ssd", std::move(options)); }
  std::map<std::string, std::vector<double>> recording() const { return read_recording(folder_ / "results/signals.csv"); }
  double reached() const { return nlohmann::json::parse(content(folder_ / "summary.json"))["reached"]; }
  TemporaryFolder folder_{"command_line"};
};

TEST_F(CommandLine, PointsReplaceTheWaypoints) {
  const RunResult result = run_own({"--waypoints", "0: 0.1 0.2; 2: 0.5, -0.4", "--stop", "3"});
  ASSERT_EQ(result.code, 0) << result.err;
  const auto columns = recording();
  EXPECT_NEAR(columns.at("motion.q_d[1]").front(), 0.1, 1e-12);
  EXPECT_NEAR(columns.at("motion.q_d[2]").back(), -0.4, 1e-12);
  EXPECT_NEAR(columns.at("drive.q[1]").front(), 0.1, 1e-9);
  EXPECT_NEAR(columns.at("drive.q[2]").back(), -0.4, 1e-3);
  // Half of the way after half of the time.
  EXPECT_NEAR(columns.at("motion.q_d[1]").at(100), 0.3, 1e-9);
  EXPECT_EQ(columns.at("time").at(100), 1);
}

TEST_F(CommandLine, PointsWithoutTimesAreReachedCalmlyAndTheRunLastsAsLong) {
  ASSERT_EQ(run_own({"--waypoints", "0 0; 1 -1; 0.5 0.5; -1 1; 1 1; -1 -1; 1 0; -1 0"}).code, 0);
  const auto columns = recording();
  EXPECT_GT(reached(), 10);
  EXPECT_NEAR(columns.at("motion.q_d[1]").back(), -1, 1e-9);
  const auto& speed = columns.at("drive.dq[1]");
  EXPECT_GT(*std::ranges::max_element(speed), 0.1);
}

TEST_F(CommandLine, AFileReplacesTheWaypoints) {
  folder_.write("points.csv", "t,q1,q2,dwell\n0,0.3,0.1,0\n1.5,0.2,0,1\n");
  ASSERT_EQ(run_own({"--waypoints", "points.csv"}).code, 0);
  EXPECT_NEAR(recording().at("drive.q[1]").front(), 0.3, 1e-9);
  EXPECT_NEAR(recording().at("motion.q_d[1]").back(), 0.2, 1e-12);
}

TEST_F(CommandLine, DrivesBeginAtTheFirstWaypointAlsoWhereTheScenarioGivesTheirStart) {
  const std::string example = cotwin::places::source() + "/examples/01_joint_admittance/arm.ssd";
  ASSERT_EQ(run_scenario(example, {"--waypoints", "-0.2 0.7; 0 0", "--stop", "0.1"}).code, 0);
  EXPECT_NEAR(recording().at("drive.q[1]").front(), -0.2, 1e-9);
  EXPECT_NEAR(recording().at("drive.q[2]").front(), 0.7, 1e-9);
  ASSERT_EQ(run_scenario(example, {"--waypoints", "-0.2 0.7; 0 0", "--stop", "0.1", "--set", "drive.q0=0.1 0.7"}).code, 0);
  EXPECT_NEAR(recording().at("drive.q[1]").front(), 0.1, 1e-9);
}

TEST_F(CommandLine, WrongWaypointsAreNamed) {
  const auto error = [&](const std::string& points) {
    const RunResult result = run_own({"--waypoints", points});
    EXPECT_EQ(result.code, 2) << points;
    return result.err;
  };
  EXPECT_THAT(error("0 0; 1"), HasSubstr("--waypoints 0 0; 1: point 2 has 1 numbers, expected 2, one per joint"));
  EXPECT_THAT(error("0 0; 1 x"), HasSubstr("point 2: 'x', expected a number"));
  EXPECT_THAT(error("0 0; 1 nan"), HasSubstr("point 2: 'nan', expected a number"));
  EXPECT_THAT(error("0 0"), HasSubstr("two points or more"));
  EXPECT_THAT(error("0: 0 0; 1 1"), HasSubstr("expected all or none"));
  EXPECT_THAT(error("2: 0 0; 1: 1 1"), HasSubstr("waypoint 2"));
  EXPECT_THAT(error("nowhere.csv"), HasSubstr("no file nowhere.csv"));
  EXPECT_THAT(error("drive=0 0; 1 1"), HasSubstr("expected a unit:motion"));
  EXPECT_THAT(error("0 0; 99 0"), HasSubstr("99"));  // outside the joint's limits
  const RunResult csv = run_own({"--waypoints", "0 0; 1 1", "--set", "motion.kind=csv"});
  EXPECT_THAT(csv.err, HasSubstr("component 'motion' has kind=csv, expected kind=waypoints"));
  const std::string twins = cotwin::places::source() + "/examples/11_cheaper_motion/twins.ssd";
  EXPECT_THAT(run_scenario(twins, {"--waypoints", "0 0; 1 1"}).err, HasSubstr("expected the name of one before '='"));
  EXPECT_FALSE(fs::exists(folder_ / "results/signals.csv"));
}

TEST_F(CommandLine, EventsChangeVariables) {
  const RunResult result = run_own({"--event", "t=0.2 drive.tau_e[2]=3", "--event", "t=0.5 drive.tau_e=1 2 ramp=100 ms",
                                    "--record", "drive.tau_e", "--stop", "1"});
  ASSERT_EQ(result.code, 0) << result.err;
  const auto columns = recording();
  const auto& first = columns.at("drive.tau_e[1]");
  const auto& second = columns.at("drive.tau_e[2]");
  EXPECT_EQ(second.at(19), 0);
  EXPECT_EQ(second.at(40), 3);
  EXPECT_NEAR(first.at(55), 0.5, 0.02);
  EXPECT_EQ(first.back(), 1);
  EXPECT_EQ(second.back(), 2);
  const nlohmann::json record = nlohmann::json::parse(content(folder_ / "results/run.json"));
  EXPECT_THAT(record["event"].get<std::vector<std::string>>(),
              ElementsAre("t=0.2 drive.tau_e[2]=3", "t=0.5 drive.tau_e=1 2 ramp=100 ms"));
}

TEST_F(CommandLine, WrongEventsAreNamed) {
  const auto error = [&](const std::string& event) {
    const RunResult result = run_own({"--event", event});
    EXPECT_EQ(result.code, 2) << event;
    return result.err;
  };
  EXPECT_THAT(error("drive.tau_e=1"),
              HasSubstr("--event drive.tau_e=1: has no time, expected 't=TIME COMPONENT.VARIABLE=VALUE'"));
  EXPECT_THAT(error("t=1"), HasSubstr("changes no variable"));
  EXPECT_THAT(error("now t=1 drive.tau_e=1"), HasSubstr("'now'"));
  EXPECT_THAT(error("t=1 t=2 drive.tau_e=1"), HasSubstr("'t' stands there twice"));
  EXPECT_THAT(error("t=soon drive.tau_e=1"), HasSubstr("'soon', expected a time"));
  EXPECT_THAT(error("t=1 drivw.tau_e=1"), HasSubstr("did you mean 'drive.tau_e'?"));
  EXPECT_THAT(error("t=1 drive.q=1"), HasSubstr("expected an input or a tunable parameter"));
  EXPECT_THAT(error("t=1 drive.tau_m=1"), HasSubstr("which a connection feeds"));
  EXPECT_THAT(error("t=1 drive.tau_e=hard"), HasSubstr("hard"));
}

TEST(Events, OneTextChangesSeveralVariablesAtOnce) {
  cotwin::master::Scenario scenario;
  scenario.components.push_back(
      {.name = "drive", .source = "unit:drive_train", .type = {}, .place = {}, .connectors = {}, .start_values = {}});
  cotwin::master::add_event(scenario, "t=2 drive.a=1 2  3 drive.b=x ramp=10 ms");
  cotwin::master::add_event(scenario, "t=1 ms drive.c=7");
  ASSERT_EQ(scenario.events.size(), 3u);
  EXPECT_EQ(scenario.events[0].variable, "drive.c");  // by time
  EXPECT_EQ(scenario.events[0].time.ns, 1'000'000);
  EXPECT_EQ(scenario.events[1].variable, "drive.a");
  EXPECT_EQ(scenario.events[1].value, "1 2 3");
  EXPECT_EQ(scenario.events[2].value, "x");
  EXPECT_EQ(scenario.events[2].ramp.ns, 10'000'000);
  EXPECT_THAT(error_of([&] { cotwin::master::add_event(scenario, ""); }), HasSubstr("has no time"));
}

TEST_F(CommandLine, AResumedRunHasItsWaypointsAndEvents) {
  // The checkpoint at the end of an interrupted run; the run itself is in durable_test.cpp.
  const std::vector<std::string> options = {"--waypoints", "0 0; 1 -1", "--event", "t=0.2 drive.tau_e=1", "--stop", "5"};
  ASSERT_EQ(run_own(options).code, 0);
  const std::string whole = content(folder_ / "results/signals.csv");
  std::vector<std::string> all = {"run", "own/twin.ssd", "--out", "broken", "--real-time", "--quiet"};
  all.insert(all.end(), options.begin(), options.end());
  cotwin::testing::Process child = cotwin::testing::start_program(all, {.folder = folder_.path()});
  const fs::path growing = folder_ / "broken/signals.csv.part";
  for (int i = 0; i < 6000 && cotwin::testing::size_of(growing) < 500; ++i) run_command({"sleep", "0.01"});
  child.signal(SIGINT);
  ASSERT_EQ(child.wait().code, 130);
  const RunResult resumed = run({"run", "--resume", "broken", "--quiet"});
  ASSERT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(content(folder_ / "broken/signals.csv"), whole);
}

std::vector<std::string> lines_of(const std::string& text) {
  std::vector<std::string> lines;
  std::istringstream in(text);
  for (std::string line; std::getline(in, line);) lines.push_back(line);
  return lines;
}

TEST_F(CommandLine, CandidatesComeFromTheDescriptionOfTheCommandLine) {
  const auto candidates = [&](const std::string& line) { return lines_of(run({"completion", "candidates", line}).out); };
  EXPECT_THAT(candidates("cotwin "), IsSupersetOf({"run", "new", "plot", "completion", "manual"}));
  EXPECT_THAT(candidates("cotwin run --"), IsSupersetOf({"--set", "--waypoints", "--event", "--output-file"}));
  EXPECT_THAT(candidates("cotwin new --kind "), ElementsAre("motion", "compliance", "contact"));
  EXPECT_THAT(candidates("cotwin run --coupling "), IsSupersetOf({"auto", "explicit", "implicit"}));
  EXPECT_THAT(candidates("cotwin completion "), IsSupersetOf({"bash", "candidates"}));
  EXPECT_THAT(candidates("cotwin new --robot "), IsSupersetOf({"lwr4", "planar2"}));
  EXPECT_THAT(candidates("cotwin run own/twin.ssd --set "), IsSupersetOf({"drive.K=", "compliance.S_a="}));
  ASSERT_EQ(run_own({"--stop", "0.01"}).code, 0);
  EXPECT_THAT(candidates("cotwin plot results "), IsSupersetOf({"drive.q", "motion.q_d"}));
  EXPECT_THAT(candidates("cotwin run "), ElementsAre());  // files, which the shell completes
  EXPECT_THAT(candidates("cotwin nonsense "), ElementsAre());
}

bool has(const std::string& program) { return run_command({"sh", "-c", "command -v " + program}).code == 0; }

/// The environment in which shells find the program of this build.
std::vector<std::string> path() {
  const char* const inherited = std::getenv("PATH");
  return {"PATH=" + fs::path(cotwin::places::program()).parent_path().string() + ":" +
          (inherited ? inherited : "/usr/bin:/bin")};
}

TEST_F(CommandLine, BashCompletes) {
  const RunResult result = run_command({"bash", "-c",
                                        "source <(cotwin completion bash) && COMP_LINE='cotwin pl' COMP_POINT=9 "
                                        "COMP_WORDS=(cotwin pl); _cotwin; echo ${COMPREPLY[@]}"},
                                       {.folder = folder_.path(), .environment = path()});
  EXPECT_EQ(result.out, "plot\n") << result.err;
}

TEST_F(CommandLine, ManualPagesListEveryCommandAndOption) {
  ASSERT_EQ(run({"manual", "man"}).code, 0);
  const std::string program = content(folder_ / "man/cotwin.1");
  std::size_t commands = 0;
  for (const std::string& command : lines_of(run({"completion", "candidates", "cotwin "}).out)) {
    ++commands;
    std::string page = content(folder_ / ("man/cotwin-" + command + ".1"));
    EXPECT_THAT(page, HasSubstr(".SH \"NAME\"")) << command;
    EXPECT_THAT(program, HasSubstr(".BR cotwin\\-" + [&] {
                  std::string name = command;
                  for (std::size_t at = 0; (at = name.find('-', at)) != std::string::npos; at += 2) name.insert(at, 1, '\\');
                  return name;
                }() + " (1)"));
    for (std::string option : lines_of(run({"completion", "candidates", "cotwin " + command + " --"}).out)) {
      for (std::size_t at = 0; (at = option.find('-', at)) != std::string::npos; at += 2) option.insert(at, 1, '\\');
      EXPECT_THAT(page, HasSubstr(option)) << command;
    }
    if (has("groff")) {
      const RunResult checked =
          run_command({"groff", "-man", "-Tutf8", "-ww", "-Kutf8", folder_ / ("man/cotwin-" + command + ".1")});
      EXPECT_EQ(checked.err, "") << command;
    }
  }
  EXPECT_GT(commands, 15u);
  EXPECT_THAT(program, HasSubstr("COTWIN_MODELS"));
  EXPECT_THAT(program, HasSubstr("Exit codes: 0 done"));
}

}  // namespace
}  // namespace command_line_test
