// The scripts of the examples that run several processes (examples/common.sh): however one ends, no process is left and the
// results up to then are whole; several run at the same time.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <string>
#include <vector>

#include "models/foundation/net/udp_socket.h"
#include "tests/support/files.h"
#include "tests/support/free_port.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/recording.h"
#include "tests/support/run_program.h"

namespace scripts_test {
namespace {

namespace fs = std::filesystem;
using cotwin::net::UdpSocket;
using cotwin::testing::Process;
using cotwin::testing::RunResult;
using cotwin::testing::size_of;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;
using ::testing::HasSubstr;

/// A script in a process group of its own, in a folder whose name has a blank.
Process start_script(const std::string& script, const fs::path& out, int port, std::vector<std::string> options,
                     const std::string& variable = "LC_ALL=C") {
  const fs::path file = fs::path(cotwin::places::source()) / "examples" / script;
  std::vector<std::string> command{file.string(), "--quiet"};
  command.insert(command.end(), options.begin(), options.end());
  return Process(std::move(command), {.environment = {"COTWIN=" + cotwin::places::program(), "OUT=" + out.string(),
                                                      "PORT=" + std::to_string(port), variable},
                                      .merge = true,
                                      .prepare = [] { return setpgid(0, 0) == 0; }});
}

/// Whether no process of the group is left. Ended ones may wait for init to collect them.
bool group_ends(pid_t group) {
  return within_patience([group] { return kill(-group, 0) != 0 && errno == ESRCH; });
}

/// A recording that ends with a whole row.
void expect_whole(const fs::path& file) {
  const std::string text = cotwin::testing::content(file);
  ASSERT_FALSE(text.empty()) << file;
  EXPECT_EQ(text.back(), '\n') << file;
  const std::string header = text.substr(0, text.find('\n'));
  const std::size_t last = text.rfind('\n', text.size() - 2);
  ASSERT_NE(last, std::string::npos) << file;
  EXPECT_EQ(std::count(text.begin() + static_cast<std::ptrdiff_t>(last), text.end(), ','),
            std::count(header.begin(), header.end(), ','))
      << file;
}

struct ProcessScript {
  const char* name;
  const char* script;
  std::vector<std::string> parts;    // folders of results, below OUT
  std::vector<std::string> options;  // for a run that does not end by itself
  bool namespaces = false;
};

class Script : public ::testing::TestWithParam<ProcessScript> {};

TEST_P(Script, LeavesNoProcessAndWholeResultsWhenItIsInterrupted) {
  const ProcessScript& s = GetParam();
  if (s.namespaces && std::system("unshare --net true 2>/dev/null") != 0)
    GTEST_SKIP() << "needs the permission for network namespaces (root)";
  for (const bool from_keyboard : {true, false}) {
    const TemporaryFolder folder("script");
    const fs::path out = folder.path() / "my results";
    Process process = start_script(s.script, out, cotwin::testing::free_ports(2), s.options);
    const pid_t group = process.id();
    const bool results = within_patience([&] {
      return std::ranges::all_of(s.parts, [&](const auto& part) { return size_of(out / part / "signals.csv.part") > 10'000; });
    });
    if (!results) {
      kill(-group, SIGKILL);
      FAIL() << "no results come:\n" << process.wait().out;
    }
    // Ctrl-C in a terminal goes to all processes of the group, `kill` only to the script.
    if (from_keyboard) {
      kill(-group, SIGINT);
    } else {
      process.signal(SIGTERM);
    }
    const RunResult result = process.wait();
    EXPECT_EQ(result.code, from_keyboard ? 130 : 143) << result.out;
    EXPECT_TRUE(group_ends(group)) << "processes are left";
    kill(-group, SIGKILL);
    for (const std::string& part : s.parts) {
      expect_whole(out / part / "signals.csv");
      std::vector<std::string> files;
      for (const auto& entry : fs::directory_iterator(out / part)) files.push_back(entry.path().filename());
      std::erase(files, "view.bin");  // where pages need it
      EXPECT_THAT(files, ::testing::UnorderedElementsAre("run.json", "signals.csv", "summary.json")) << "nothing half-written";
    }
  }
}

INSTANTIATE_TEST_SUITE_P(
    Examples, Script,
    ::testing::Values(ProcessScript{"PegInHole", "04_peg_in_hole/over_fri.sh", {"robot", "twin"}, {"--stop", "1000"}},
                      ProcessScript{"Guidance", "15_guidance_over_fri/run.sh", {"robot", "twin"}, {"--stop", "1000"}},
                      ProcessScript{"Cell", "16_ethercat_cell/run.sh", {"cell", "twin"}, {"--stop", "1000"}, true},
                      ProcessScript{"Shadow", "17_shadow/run.sh", {"robot", "twin"}, {"--stop", "1000"}},
                      ProcessScript{"States", "18_shared_states/run.sh", {"beside", "control"}, {"--stop", "1000"}}),
    [](const auto& script) { return std::string(script.param.name); });

TEST(Script, RunsTwiceAtTheSameTimeOnOtherPorts) {
  const TemporaryFolder folder("script");
  const auto start = [&](const std::string& out) {
    return start_script("15_guidance_over_fri/run.sh", folder.path() / out, cotwin::testing::free_ports(2), {"--stop", "1"});
  };
  Process first = start("first run"), second = start("second run");
  const RunResult one = first.wait(), two = second.wait();
  ASSERT_EQ(one.code, 0) << one.out;
  ASSERT_EQ(two.code, 0) << two.out;
  for (const char* part : {"robot/signals.csv", "twin/signals.csv"}) {
    EXPECT_EQ(cotwin::testing::content(folder.path() / "first run" / part),
              cotwin::testing::content(folder.path() / "second run" / part))
        << part;
  }
}

TEST(Script, EndsAllProcessesWithAMessageIfThePortIsInUse) {
  const TemporaryFolder folder("script");
  const UdpSocket other({0x7f000001, 0}, "test");
  const std::string port = std::to_string(other.local().port);
  Process process = start_script("15_guidance_over_fri/run.sh", folder.path() / "out", other.local().port, {"--stop", "1000"});
  const pid_t group = process.id();
  const RunResult result = process.wait();
  EXPECT_EQ(result.code, 2) << result.out;
  EXPECT_THAT(result.out, HasSubstr("UDP socket at 127.0.0.1:" + port + ": bind: Address already in use"));
  EXPECT_TRUE(group_ends(group));
  kill(-group, SIGKILL);
}

// Example 14: the script compares the recordings bit by bit.
TEST(Plant, IsTheSameWithUnitsWithFmusAndAsAPackage) {
  const TemporaryFolder folder("plant");
  const fs::path out = folder.path() / "my plant";
  const RunResult result = start_script("14_plant/run.sh", out, 0, {}).wait();
  ASSERT_EQ(result.code, 0) << result.out;
  EXPECT_THAT(result.out, HasSubstr("the same as plant.ssp"));
  auto columns = cotwin::testing::read_recording(out / "package/signals.csv");
  const auto &time = columns.at("time"), &run = columns.at("cell.run"), &travel = columns.at("conveyor.travel");
  const auto &state = columns.at("cell.state"), &taken = columns.at("cell.taken");
  const std::vector<double> home = {0, 0.3, 0, -1.2, 0, 0.9, 0}, part = {0.9, 0.8, 0.3, -0.9, -0.4, 1.1, 0.5};
  const auto expect_at = [&](std::size_t row, const std::vector<double>& q) {
    for (std::size_t i = 0; i < q.size(); ++i)
      EXPECT_NEAR(columns.at("robot.drive.q[" + std::to_string(i + 1) + "]")[row], q[i], 2e-3) << time[row];
  };
  std::vector<double> arrivals;
  for (std::size_t k = 1; k < time.size(); ++k) {
    if (k > 1 && run[k] == run[k - 1] && run[k] == run[k - 2]) {  // a row is ten ticks; the belt follows a tick later
      EXPECT_NEAR(travel[k] - travel[k - 1], 0.0025 * run[k], 1e-9) << time[k];
    }
    if (taken[k] > taken[k - 1]) expect_at(k, part);
    if (state[k] == 1 && state[k - 1] != 1) expect_at(k, home);
    if (state[k] == 1 && state[k - 1] != 1) arrivals.push_back(time[k]);
  }
  // The belt needs 1 s to the first part, and goes on while the robot returns in 1.2 s: from then on the robot is what takes 2.4 s a part.
  ASSERT_EQ(arrivals.size(), 4U);
  for (std::size_t k = 0; k < arrivals.size(); ++k) EXPECT_NEAR(arrivals[k], 1 + 2.4 * static_cast<double>(k), 0.02);
  EXPECT_EQ(taken.back(), 4);
}

TEST(Plant, NamesAMissingCompiler) {
  const TemporaryFolder folder("plant");
  const RunResult result = start_script("14_plant/run.sh", folder.path() / "out", 0, {}, "CC=no-such-compiler").wait();
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.out, HasSubstr("no C compiler 'no-such-compiler', expected one for conveyor.c and cell.c"));
  EXPECT_FALSE(fs::exists(folder.path() / "out"));
}

}  // namespace
}  // namespace scripts_test
