// examples/04_peg_in_hole over FRI with a network that loses datagrams between the two processes: Table I and Fig. 10 (VI-A) are
// those of one process.
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/free_port.h"
#include "tests/support/lossy_relay.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace lossy_network_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::LossyRelay;
using cotwin::testing::Process;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;
using cotwin::testing::TemporaryFolder;
using nlohmann::json;

// s; "23" includes the first insertion.
constexpr const char* kStop = "2";

/// RMS of the discrepancy of joint torques, of the whole run and of its parts (N·m).
json discrepancies(const fs::path& summary) { return json::parse(std::ifstream(summary)).at("comparisons").at(0); }

TEST(LossyNetwork, TableIOverFriIsThatOfOneProcess) {
  const TemporaryFolder folder("lossy_network");
  const fs::path here = fs::path(cotwin::places::source()) / "examples/04_peg_in_hole";
  const auto summary = [&](const std::string& name) { return (folder.path() / (name + ".json")).string(); };
  const RunResult one = cotwin::testing::run_program({"run", (here / "twin.ssd").string(), "--quiet", "--stop", kStop, "--out",
                                                      (folder.path() / "one").string(), "--json", summary("one")});
  ASSERT_EQ(one.code, 0) << one.err;

  const std::uint16_t port = cotwin::testing::free_ports();
  LossyRelay relay;
  cotwin::testing::Disturbance disturbance;
  disturbance.loss = 0.01;
  relay.set(disturbance);
  std::atomic<bool> end = false;
  std::thread thread([&] { relay.run({0x7f000001, port}, end); });
  Process twin = start_program({"run", (here / "over_fri_twin.ssd").string(), "--quiet", "--stop", kStop, "--out",
                                (folder.path() / "twin").string(), "--json", summary("twin"), "--set",
                                "link.port=" + std::to_string(port)});
  Process robot = start_program({"run", (here / "over_fri_robot.ssd").string(), "--quiet", "--stop", "600", "--out",
                                 (folder.path() / "robot").string(), "--set", "fri.client=" + to_text(relay.client())});
  const RunResult twin_result = twin.wait();
  robot.signal(SIGINT);
  const RunResult robot_result = robot.wait();
  end = true;
  thread.join();
  ASSERT_EQ(twin_result.code, 0) << twin_result.err << robot_result.err;
  EXPECT_GT(relay.down().lost, 5);
  EXPECT_GT(relay.up().lost, 5);

  const json a = discrepancies(summary("one")), b = discrepancies(summary("twin"));
  for (std::size_t i = 0; i < 7; ++i) {
    const double rms_one = a.at("rms").at(i).get<double>(), rms_two = b.at("rms").at(i).get<double>();
    EXPECT_NEAR(rms_two, rms_one, 0.01) << "joint " << i + 1;  // torques change by up to 10 N·m/s: 0.01 in a tick
  }
}

/// The robot's recording of example 15 up to 0.4 s, through a relay that loses a share of the datagrams of each direction.
std::string recorded(double loss, const TemporaryFolder& folder) {
  const fs::path here = fs::path(cotwin::places::source()) / "examples/15_guidance_over_fri";
  const std::uint16_t port = cotwin::testing::free_ports();
  LossyRelay relay;
  cotwin::testing::Disturbance disturbance;
  disturbance.loss = loss;
  relay.set(disturbance);
  std::atomic<bool> end = false;
  std::thread thread([&] { relay.run({0x7f000001, port}, end); });
  const fs::path out = folder.path() / std::to_string(loss);
  const auto start = [&](const char* side, const std::string& setting) {
    return start_program({"run", (here / (std::string(side) + ".ssd")).string(), "--quiet", "--out", (out / side).string(),
                          "--stop", "0.4", "--set", setting});
  };
  Process twin = start("twin", "link.port=" + std::to_string(port));
  Process robot = start("robot", "controller.client=" + to_text(relay.client()));
  const RunResult robot_result = robot.wait();
  const RunResult twin_result = twin.wait();
  end = true;
  thread.join();
  EXPECT_EQ(robot_result.code, 0) << robot_result.err;
  EXPECT_EQ(twin_result.code, 0) << twin_result.err;
  EXPECT_GE(relay.down().lost, loss > 0 ? 5 : 0);
  EXPECT_GE(relay.up().lost, loss > 0 ? 5 : 0);
  return cotwin::testing::content(out / "robot/signals.csv");
}

// The second robot sends the number 1 again, from the port of the first one or from another.
TEST(TwoProcessesOverFri, ATwinThatWaitsGoesOnWithARobotThatWasStartedAgain) {
  const TemporaryFolder folder("restarted_robot");
  const fs::path here = fs::path(cotwin::places::source()) / "examples/15_guidance_over_fri";
  for (const bool same_port : {true, false}) {
    const std::uint16_t port = cotwin::testing::free_ports(2);
    const fs::path out = folder.path() / (same_port ? "same" : "other");
    const auto start = [&](const char* side, const char* stop, const std::vector<std::string>& set) {
      std::vector<std::string> words{
          "run", (here / (std::string(side) + ".ssd")).string(), "--quiet", "--out", (out / side).string(), "--stop", stop};
      for (const std::string& setting : set) words.insert(words.end(), {"--set", setting});
      return start_program(words);
    };
    const std::string client = "controller.client=127.0.0.1:" + std::to_string(port),
                      from = "controller.port=" + std::to_string(same_port ? port + 1 : 0);
    Process twin = start("twin", "0.3", {"link.port=" + std::to_string(port)});
    Process first = start("robot", "0.1", {client, from});
    const RunResult first_result = first.wait();
    EXPECT_EQ(first_result.code, 0) << first_result.err;
    Process second = start("robot", "600", {client, from});
    const RunResult twin_result = twin.wait();
    second.signal(SIGINT);
    second.wait();
    EXPECT_EQ(twin_result.code, 0) << twin_result.err;
  }
}

TEST(LossyNetwork, ARobotAndATwinInStepGiveTheSameBitsAsWithoutLoss) {
  const TemporaryFolder folder("lossy_network");
  EXPECT_TRUE(recorded(0.05, folder) == recorded(0, folder));
}

}  // namespace
}  // namespace lossy_network_test
