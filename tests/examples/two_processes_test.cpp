// examples/18_shared_states: a fast run and a slow one in two processes that share states over UDP. The replica of the slow one is
// compared with the recording of the fast one, bit for bit.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace {

namespace fs = std::filesystem;
using cotwin::testing::Process;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;

/// Rows of a recording: texts of the columns by name.
std::vector<std::map<std::string, std::string>> rows_of(const fs::path& file) {
  std::ifstream in(file);
  std::vector<std::string> names;
  std::vector<std::map<std::string, std::string>> rows;
  std::string line, cell;
  std::getline(in, line);
  for (std::istringstream header(line); std::getline(header, cell, ',');) names.push_back(cell);
  while (std::getline(in, line)) {
    std::map<std::string, std::string>& row = rows.emplace_back();
    std::size_t i = 0;
    for (std::istringstream values(line); i < names.size() && std::getline(values, cell, ','); ++i) row[names[i]] = cell;
  }
  return rows;
}

/// An address of the loopback device that no other test process has.
std::string address(int port) {
  const int id = static_cast<int>(getpid());
  return "127." + std::to_string(1 + id / 62'500 % 250) + "." + std::to_string(id / 250 % 250) + "." +
         std::to_string(1 + id % 250) + ":" + std::to_string(port);
}

Process start(const std::string& scenario, const std::string& component, int listen, int peer, const std::string& stop,
              const fs::path& out) {
  const fs::path file = fs::path(cotwin::places::source()) / "examples/18_shared_states" / (scenario + ".ssd");
  return start_program({"run", file.string(), "--quiet", "--stop", stop, "--out", (out / scenario).string(), "--set",
                        component + ".listen=" + address(listen), "--set", component + ".peer=" + address(peer)});
}

TEST(TwoProcesses, HaveTheSameBitsAtTheSameTime) {
  const cotwin::testing::TemporaryFolder folder("two_processes");
  // The control part runs until the slow part has ended.
  Process control = start("control", "beside", 30'200, 30'201, "600", folder.path());
  const RunResult slow = start("beside", "control", 30'201, 30'200, "0.5", folder.path()).wait();
  control.signal(SIGINT);
  const RunResult fast = control.wait();
  ASSERT_EQ(slow.code, 0) << slow.err;

  std::map<std::string, std::map<std::string, std::string>> by_time;
  for (auto& row : rows_of(folder.path() / "control/signals.csv")) by_time[row.at("time")] = row;
  ASSERT_FALSE(by_time.empty()) << fast.err;
  std::size_t compared = 0;
  for (auto& row : rows_of(folder.path() / "beside/signals.csv")) {
    if (row.at("control.fresh") != "1") continue;
    const auto then = by_time.find(row.at("control.peer_time"));
    ASSERT_NE(then, by_time.end()) << row.at("control.peer_time");
    for (int joint = 1; joint <= 7; ++joint) {
      const std::string element = "[" + std::to_string(joint) + "]";
      EXPECT_EQ(row.at("control.q" + element), then->second.at("drive.q" + element)) << row.at("time");
      EXPECT_EQ(row.at("control.dq" + element), then->second.at("drive.dq" + element)) << row.at("time");
    }
    ++compared;
  }
  EXPECT_GT(compared, 1u);
}

TEST(TwoProcesses, NameTheStatesThatDiffer) {
  const cotwin::testing::TemporaryFolder folder("two_processes");
  const fs::path file = fs::path(cotwin::places::source()) / "examples/18_shared_states/beside.ssd";
  Process control = start("control", "beside", 30'202, 30'203, "600", folder.path());
  const RunResult slow =
      start_program({"run", file.string(), "--quiet", "--set", "control.listen=" + address(30'203), "--set",
                     "control.peer=" + address(30'202), "--set", "control.subscribe=q:7:rad,dq:7:rad/s,ddq:7:rad/s2"})
          .wait();
  EXPECT_NE(slow.code, 0);
  EXPECT_NE(slow.err.find("publishes 'q:7:rad,dq:7:rad/s', expected 'q:7:rad,dq:7:rad/s,ddq:7:rad/s2' (setting subscribe)"),
            std::string::npos)
      << slow.err;
}

}  // namespace
