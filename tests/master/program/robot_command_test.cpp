// cotwin robot: the emulated robot as users start it, with a client that was written from the wire tables alone
// (tests/components/io/fri/client.py). The client's speed does not matter: it has a minute.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace robot_command_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::Process;
using cotwin::testing::run_command;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;
using cotwin::testing::TemporaryFolder;

bool has_python() {
  static const bool has = run_command({"sh", "-c", "command -v python3"}).code == 0;
  return has;
}

/// The first line of a file that another process writes.
std::string first_line(const fs::path& file) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (std::chrono::steady_clock::now() < end) {
    std::ifstream in(file);
    std::string line;
    if (std::getline(in, line) && !in.eof()) return line;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return "";
}

class RobotCommand : public ::testing::TestWithParam<const char*> {};

TEST_P(RobotCommand, ServesAClientWrittenFromTheWireTables) {
  if (!has_python()) GTEST_SKIP() << "needs python3";
  const std::string protocol = GetParam();
  const TemporaryFolder folder("robot");
  cotwin::testing::RunOptions options;
  options.out = folder.path() / "client.txt";
  const fs::path script = fs::path(cotwin::places::source()) / "tests/components/io/fri/client.py";
  Process client({"python3", script, protocol, "--seconds", "0.4", "--amplitude", "0.02", "--frequency", "2.5"}, options);
  const std::string line = first_line(options.out);
  ASSERT_THAT(line, ::testing::StartsWith("port "));
  Process robot =
      start_program({"robot", "--fri", protocol == "lwr" ? "lwr" : "sunrise-" + protocol, "--address", "127.0.0.1", "--port",
                     "0", "--client", "127.0.0.1:" + line.substr(5), "--period", "20", "--set", "controller.window=20",
                     "--quiet", "--out", folder.path() / "robot", "--q0", "0 0.3 0 -1.2 0 0.9 0"});
  EXPECT_EQ(client.wait().code, 0);
  robot.signal(SIGINT);
  EXPECT_EQ(robot.wait().code, 128 + SIGINT);
  std::ifstream told_file(options.out);
  std::string told_line;
  for (std::string each; std::getline(told_file, each);) told_line = each;
  const auto told = nlohmann::json::parse(told_line);
  EXPECT_EQ(told.at("gaps"), 0) << told;
  EXPECT_EQ(told.at("wrong_reflections"), 0) << told;
  EXPECT_THAT(told.at("states").get<std::vector<std::string>>(), ::testing::Contains("MONITORING_READY"));
  EXPECT_THAT(told.at("states").get<std::vector<std::string>>(), ::testing::Contains("COMMANDING_ACTIVE"));
  EXPECT_NEAR(told.at("period").get<double>(), 0.02, 1e-6);
  // One period of the sine: the robot reached its amplitude, to the lag of its position control and the distance of the samples.
  EXPECT_GT(told.at("largest").get<double>(), 0.015) << told;
  EXPECT_LT(told.at("largest").get<double>(), 0.0205) << told;
}

INSTANTIATE_TEST_SUITE_P(Protocols, RobotCommand, ::testing::Values("lwr", "1.11", "1.15", "2.5", "2.7"),
                         [](const auto& protocol) {
                           std::string name = protocol.param;
                           std::erase(name, '.');
                           return "Fri" + name;
                         });

/// An address of the loopback device that no other test process has.
std::string own_address() {
  const int id = static_cast<int>(getpid());
  return "127." + std::to_string(1 + id / 62'500 % 250) + "." + std::to_string(id / 250 % 250) + "." +
         std::to_string(1 + id % 250);
}

/// `cotwin robot --rtde`, which tolerates a machine that stands still for a while.
Process start_rtde_robot(const std::string& address, const fs::path& out, std::vector<std::string> options = {}) {
  options.insert(options.begin(),
                 {"robot", "--rtde", "--address", address, "--quiet", "--out", out, "--set", "controller.loss_time=30"});
  return start_program(options);
}

class RtdeCommand : public ::testing::TestWithParam<const char*> {};

TEST_P(RtdeCommand, ServesAClientWrittenFromTheDocumentation) {
  if (!has_python()) GTEST_SKIP() << "needs python3";
  const TemporaryFolder folder("robot");
  const std::string address = own_address();
  Process robot = start_rtde_robot(address, folder.path() / "robot", {"--robot", "ur10e"});
  const fs::path script = fs::path(cotwin::places::source()) / "tests/components/io/rtde/client.py";
  const RunResult client = run_command({"python3", script, address + ":30004", "--seconds", "0.6", "--version", GetParam()});
  robot.signal(SIGINT);
  EXPECT_EQ(robot.wait().code, 128 + SIGINT);
  ASSERT_EQ(client.code, 0) << client.err;
  const auto told = nlohmann::json::parse(client.out);
  const bool second = std::string(GetParam()) == "2";
  EXPECT_EQ(told.at("controller").at(0), 5);
  EXPECT_EQ(told.at("unknown").at(1), nlohmann::json({"DOUBLE", "NOT_FOUND"}));
  if (second) {
    EXPECT_EQ(told.at("unknown").at(0), 0);
  }
  EXPECT_EQ(told.at("rival"), nlohmann::json({0, {"IN_USE"}}));
  EXPECT_EQ(told.at("wrong"), 0);
  EXPECT_EQ(told.at("runtime"), 2);
  EXPECT_EQ(told.at("joint_mode"), 253);
  EXPECT_EQ(told.at("digital"), 2);
  EXPECT_EQ(told.at("speed"), 0.75);
  EXPECT_EQ(told.at("states").back(), 2) << told;
  EXPECT_LE(told.at("reflected").get<int>(), 50) << told;
  EXPECT_EQ(told.at("pause"), 1);
  // One period of the sine, behind the smoothing of 30 ms and the steps of the commands.
  EXPECT_GT(told.at("largest").get<double>(), 0.02) << told;
  EXPECT_LT(told.at("largest").get<double>(), 0.055) << told;
}

INSTANTIATE_TEST_SUITE_P(Versions, RtdeCommand, ::testing::Values("1", "2"),
                         [](const auto& version) { return std::string("Rtde") + version.param; });

TEST(RtdeRobot, FollowsATwinInAnotherProcess) {
  const TemporaryFolder folder("robot");
  const std::string address = own_address();
  Process robot = start_rtde_robot(address, folder.path() / "robot");
  const RunResult twin =
      run_program({"run", fs::path(cotwin::places::source()) / "examples/19_ur_over_rtde/twin.ssd", "--quiet", "--stop", "1.1",
                   "--set", "link.controller=" + address, "--set", "link.timeout=30", "--out", folder.path() / "twin"});
  robot.signal(SIGINT);
  EXPECT_EQ(robot.wait().code, 128 + SIGINT);
  ASSERT_EQ(twin.code, 0) << twin.err;
  std::ifstream file(folder.path() / "twin/signals.csv");
  std::string header, line, last;
  std::getline(file, header);
  while (std::getline(file, line)) last = line;
  std::map<std::string, double> end;
  std::istringstream names(header), values(last);
  for (std::string name, value; std::getline(names, name, ',') && std::getline(values, value, ',');)
    end[name] = std::stod(value);
  EXPECT_EQ(end.at("link.commanding"), 1);
  EXPECT_GT(end.at("motion.q_d[1]"), 0.3);
  EXPECT_NEAR(end.at("link.q[1]"), end.at("motion.q_d[1]"), 0.15);
  EXPECT_GT(end.at("link.q[1]"), 0.2);
}

/// The program for a robot is run in Python, whose blocks are those of URScript but for `end`.
TEST(RtdeRobot, ItsProgramStopsWhenTheRobotWasMovedInAPauseAndNeverGoesOnByItself) {
  if (!has_python()) GTEST_SKIP() << "needs python3";
  const TemporaryFolder folder("script");
  std::ofstream(folder.path() / "script") << run_program({"robot", "--rtde-script"}).out;
  std::ofstream(folder.path() / "run.py") << R"(
import sys
lines = [l for l in open(sys.argv[1]) if l.strip() != "end"]
robot, goal, states, stops, cycle, last, request = [0.0] * 6, [0.0] * 6, {}, [], 0, 0, 1
class Done(Exception): pass
def step():
    global cycle, last, request
    cycle += 1
    if cycle == 10: request = 0                 # it was there when the program began
    if cycle == 12: request = 1
    if 20 <= cycle < 70: goal[2] += 0.002       # 1 rad/s
    if cycle == 100: robot[2] += 0.5            # by hand, while the program was paused
    if cycle == 150: goal[2] = robot[2]         # the client comes near, but does not ask again
    if cycle == 195: request = 0
    if cycle == 198: request = 1
    if cycle == 200: goal[2] = last = robot[2] + 0.05
    if cycle == 300: goal[2] = float("nan")
    if cycle == 400: robot[2] += 0.02; robot[1] += 0.02   # less than `near`, but a jump
    if cycle == 450: raise Done
def servoj(q, a, v, t, lookahead, gain):
    for i in range(6): robot[i] += min(t / lookahead, 1) * (q[i] - robot[i])
    step()
env = dict(get_steptime=lambda: 0.002, norm=abs, sync=step, servoj=servoj,
           get_target_joint_positions=lambda: list(robot), stopj=lambda a: stops.append(cycle),
           read_input_integer_register=lambda i: cycle if i == 24 else request, read_input_float_register=lambda i: goal[i - 24],
           write_output_integer_register=lambda i, x: states.__setitem__((cycle, i), x))
try:
    exec("".join(lines), env)
except Done:
    pass
print(*[states[(k, 25)] for k in (5, 11, 50, 99, 101, 194, 197, 250, 399, 401, 449)], *stops, last > 0.5, abs(robot[2] - last - 0.02) < 1e-4)
)";
  const RunResult run = run_command({"python3", folder.path() / "run.py", folder.path() / "script"});
  EXPECT_EQ(run.out, "5 1 2 2 4 4 1 2 2 4 4 100 400 True True\n") << run.err;
}

TEST(RtdeRobot, PrintsTheProgramForARobot) {
  const RunResult run = run_program({"robot", "--rtde-script"});
  EXPECT_EQ(run.code, 0);
  EXPECT_THAT(run.out, ::testing::HasSubstr("def cotwin_follow():"));
  // Blocks are balanced: def, if, while, each with an end.
  int open = 0;
  std::istringstream lines(run.out);
  for (std::string line; std::getline(lines, line);) {
    const std::string word = line.substr(std::min(line.find_first_not_of(' '), line.size()));
    if (word.starts_with("def ") || word.starts_with("if ") || word.starts_with("while ")) ++open;
    if (word == "end") --open;
    EXPECT_GE(open, 0) << line;
  }
  EXPECT_EQ(open, 0);
}

// In each state: waiting for a client, and following one.
TEST(RobotCommand, EndsWithWholeResultsAtASignal) {
  for (const bool follows : {false, true}) {
    if (follows && !has_python()) continue;
    const TemporaryFolder folder("robot");
    cotwin::testing::RunOptions options;
    options.out = folder.path() / "client.txt";
    std::string port = "9";
    std::optional<Process> client;
    if (follows) {
      const fs::path script = fs::path(cotwin::places::source()) / "tests/components/io/fri/client.py";
      client.emplace(std::vector<std::string>{"python3", script, "lwr", "--seconds", "1000", "--limit", "5"}, options);
      port = first_line(options.out).substr(5);
    }
    const fs::path out = folder.path() / "robot";
    Process robot = start_program({"robot", "--fri", "lwr", "--client", "127.0.0.1:" + port, "--period", "20", "--set",
                                   "controller.window=10", "--out", out});
    const auto rows = [&] {
      std::ifstream in(out / "signals.csv");
      std::vector<std::string> all;
      for (std::string line; std::getline(in, line);) all.push_back(line);
      return all;
    };
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    while (!fs::exists(out / "signals.csv.part") && std::chrono::steady_clock::now() < end)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    std::this_thread::sleep_for(std::chrono::milliseconds(600));  // commanding begins after 10 answers, if the machine is free
    robot.signal(SIGTERM);
    const RunResult result = robot.wait();
    EXPECT_EQ(result.code, 128 + SIGTERM);
    EXPECT_THAT(result.err, ::testing::HasSubstr("stopped by SIGTERM"));
    const std::vector<std::string> lines = rows();
    ASSERT_GE(lines.size(), 2u);
    for (const std::string& line : lines) EXPECT_EQ(std::ranges::count(line, ','), std::ranges::count(lines[0], ',')) << line;
    std::ifstream record_file(out / "run.json");
    EXPECT_NO_THROW(static_cast<void>(nlohmann::json::parse(record_file)));
    if (client) client->signal(SIGTERM);
  }
}

TEST(RobotCommand, NamesWhatItCannotEmulate) {
  const auto message = [](std::vector<std::string> options) {
    const TemporaryFolder folder("robot");
    options.insert(options.begin(), "robot");
    options.insert(options.end(), {"--quiet", "--seconds", "0.1", "--out", folder.path() / "out"});
    const RunResult run = run_program(options);
    EXPECT_EQ(run.code, 2);
    return run.err;
  };
  using ::testing::HasSubstr;
  EXPECT_THAT(message({}), HasSubstr("expected either --fri or --rtde"));
  EXPECT_THAT(message({"--rtde", "--fri", "lwr"}), HasSubstr("expected either --fri or --rtde"));
  EXPECT_THAT(message({"--rtde", "--period", "2"}), HasSubstr("--rtde excludes --period"));
  EXPECT_THAT(message({"--fri", "lwr", "--frequency", "125"}), HasSubstr("--fri excludes --frequency"));
  EXPECT_THAT(message({"--rtde", "--robot", "lwr4"}), HasSubstr("7 joints, expected 6"));
  EXPECT_THAT(message({"--rtde", "--address", "192.0.2.1"}), HasSubstr("TCP socket at 192.0.2.1:30004"));
  EXPECT_THAT(message({"--fri", "sunrise-3"}), HasSubstr("protocol=sunrise-3, expected one of lwr, sunrise-1.11,"));
  EXPECT_THAT(message({"--fri", "lwr", "--robot", "planar2"}), HasSubstr("protocol lwr with 2 joints, expected 7"));
  EXPECT_THAT(message({"--fri", "lwr", "--robot", "nobody"}), HasSubstr("robot 'nobody'"));
  EXPECT_THAT(message({"--fri", "lwr", "--mode", "torque"}),
              HasSubstr("'torque' with --fri lwr, expected it only with sunrise"));
  EXPECT_THAT(message({"--fri", "lwr", "--period", "0.2"}), HasSubstr("expected 0.001 to 0.1"));
  EXPECT_THAT(message({"--fri", "sunrise", "--period", "nan"}), HasSubstr("expected 0.001 to 0.1"));
  EXPECT_THAT(message({"--fri", "sunrise", "--period", "2.5"}), HasSubstr("expected whole milliseconds for Sunrise"));
  EXPECT_THAT(message({"--fri", "sunrise", "--mode", "pose"}), HasSubstr("expected sunrise-2.5 or -2.7"));
  EXPECT_THAT(message({"--fri", "lwr", "--client", "0.0.0.0"}), HasSubstr("expected the address and the port"));
  EXPECT_THAT(message({"--fri", "lwr", "--set", "controller.good=0.5"}), HasSubstr("rating.fair is 0.75, expected 0 to 0.5"));
  EXPECT_THAT(message({"--fri", "lwr", "--address", "host"}), HasSubstr("unit:io?link=fri_controller: address"));
  EXPECT_THAT(message({"--fri", "sunrise", "--address", "192.0.2.1"}), HasSubstr("UDP socket at 192.0.2.1:30200"));
  EXPECT_THAT(message({"--fri", "sunrise", "--port", "30207", "--address", "192.0.2.1"}),
              HasSubstr("UDP socket at 192.0.2.1:30207"));
}

}  // namespace
}  // namespace robot_command_test
