// cotwin robot: the emulated robot as users start it, with a client that was written from the wire tables alone
// (tests/components/fri_client.py). The client's speed does not matter: it has a minute.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

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
  const fs::path script = fs::path(cotwin::places::source()) / "tests/components/fri_client.py";
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
  EXPECT_THAT(message({"--fri", "sunrise-3"}), HasSubstr("protocol=sunrise-3, expected one of lwr, sunrise-1.11,"));
  EXPECT_THAT(message({"--fri", "lwr", "--robot", "planar2"}), HasSubstr("protocol lwr with 2 joints, expected 7"));
  EXPECT_THAT(message({"--fri", "lwr", "--robot", "nobody"}), HasSubstr("robot 'nobody'"));
  EXPECT_THAT(message({"--fri", "lwr", "--period", "0.2"}), HasSubstr("expected 0.001 to 0.1"));
  EXPECT_THAT(message({"--fri", "lwr", "--address", "host"}), HasSubstr("unit:io?link=fri_controller: address"));
  EXPECT_THAT(message({"--fri", "sunrise", "--address", "192.0.2.1"}), HasSubstr("UDP socket at 192.0.2.1:30200"));
}

}  // namespace
