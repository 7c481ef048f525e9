// examples/18_shared_states: a fast run and a slow one in two processes that share states over UDP. The replica of the slow one is
// compared with the recording of the fast one, bit for bit.
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/support/files.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace two_processes_test {
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

fs::path example(const std::string& scenario) {
  return fs::path(cotwin::places::source()) / "examples/18_shared_states" / (scenario + ".ssd");
}

Process start(const std::string& scenario, const std::string& component, int listen, int peer, const std::string& stop,
              const fs::path& out, fs::path file = {}) {
  if (file.empty()) file = example(scenario);
  return start_program({"run", file.string(), "--quiet", "--stop", stop, "--out", (out / scenario).string(), "--set",
                        component + ".listen=" + address(listen), "--set", component + ".peer=" + address(peer)});
}

/// Compares the states in the recording of the slow run with those that the fast run had at that time. Returns the rows of the slow
/// run and how many of them had new states.
std::pair<std::size_t, std::size_t> compare(const fs::path& folder) {
  std::map<std::string, std::map<std::string, std::string>> by_time;
  for (auto& row : rows_of(folder / "control/signals.csv")) by_time[row.at("time")] = row;
  const auto slow = rows_of(folder / "beside/signals.csv");
  std::size_t compared = 0;
  for (const auto& row : slow) {
    if (row.at("control.fresh") != "1") continue;
    const auto then = by_time.find(row.at("control.peer_time"));
    if (then == by_time.end()) {
      ADD_FAILURE() << "no tick at " << row.at("control.peer_time");
      continue;
    }
    for (int joint = 1; joint <= 7; ++joint) {
      const std::string element = "[" + std::to_string(joint) + "]";
      EXPECT_EQ(row.at("control.q" + element), then->second.at("drive.q" + element)) << row.at("time");
      EXPECT_EQ(row.at("control.dq" + element), then->second.at("drive.dq" + element)) << row.at("time");
    }
    ++compared;
  }
  return {slow.size(), compared};
}

/// Number of rows with new states in the unfinished recording of the slow run.
std::ptrdiff_t fresh_rows(const fs::path& folder) {
  const fs::path file = folder / "beside/signals.csv.part";
  if (!fs::exists(file)) return 0;
  const auto rows = rows_of(file);
  return std::ranges::count_if(rows, [](const auto& row) {
    const auto fresh = row.find("control.fresh");  // the last row may be incomplete
    return fresh != row.end() && fresh->second == "1";
  });
}

// On a loaded machine the fast run may begin long after the slow one: both run until enough states have been exchanged.
TEST(TwoProcesses, HaveTheSameBitsAtTheSameTime) {
  const cotwin::testing::TemporaryFolder folder("two_processes");
  Process control = start("control", "beside", 30'200, 30'201, "600", folder.path());
  Process beside = start("beside", "control", 30'201, 30'200, "600", folder.path());
  EXPECT_TRUE(cotwin::testing::within_patience([&] { return fresh_rows(folder.path()) > 20; }));
  beside.signal(SIGINT);
  const RunResult slow = beside.wait();
  control.signal(SIGINT);
  const RunResult fast = control.wait();
  ASSERT_EQ(slow.code, 128 + SIGINT) << slow.err;
  ASSERT_EQ(fast.code, 128 + SIGINT) << fast.err;
  const auto [rows, compared] = compare(folder.path());
  const double end = std::stod(rows_of(folder.path() / "beside/signals.csv").back().at("time"));
  EXPECT_EQ(static_cast<double>(rows), std::round(end / 0.01) + 1) << "a tick is missing";
  EXPECT_GT(compared, 20u);
}

// A tick of the slow run does not begin before the fast one has published the states of that time, whatever the speed.
TEST(TwoProcesses, CanBePacedByOneOfThem) {
  const cotwin::testing::TemporaryFolder folder("two_processes");
  std::string scenario = cotwin::testing::content(example("beside"));
  const std::string attribute = " clock=\"real-time\"", recording = "<cotwin:Recording>";
  scenario.erase(scenario.find(attribute), attribute.size());
  scenario.insert(scenario.find(recording),
                  "<cotwin:Clock kind=\"arrivals\" component=\"control\" cycle=\"1 ms\" silence=\"wait\"/>");
  Process control = start("control", "beside", 30'204, 30'205, "600", folder.path());
  const RunResult slow =
      start("beside", "control", 30'205, 30'204, "0.3", folder.path(), folder.write("beside.ssd", scenario)).wait();
  control.signal(SIGINT);
  const RunResult fast = control.wait();
  ASSERT_EQ(slow.code, 0) << slow.err;
  const auto [rows, compared] = compare(folder.path());
  EXPECT_EQ(rows, 31u) << fast.err;
  EXPECT_GT(compared, 1u);
  std::optional<double> first;
  for (const auto& row : rows_of(folder.path() / "beside/signals.csv")) {
    const double peer_time = std::stod(row.at("control.peer_time")), begin = std::stod(row.at("time")) - 0.01;
    if (!first) first = peer_time;
    EXPECT_GE(peer_time, *first + begin - 1e-9);
  }
}

// Of the same scenario with the indices in the loop, the indices are seen one of their steps earlier; the control part is the same.
TEST(OneProcess, HasTheIndicesOfTheLoopOneStepLater) {
  const cotwin::testing::TemporaryFolder folder("one_process");
  const std::string beside = cotwin::testing::content(example("one_process")), attribute = " beside=\"true\"";
  std::string inside = beside;
  inside.erase(inside.find(attribute), attribute.size());
  for (const auto& [name, text] : {std::pair{"beside", beside}, std::pair{"inside", inside}}) {
    const RunResult run = start_program({"run", folder.write(std::string(name) + ".ssd", text).string(), "--quiet", "--clock",
                                         "free", "--out", (folder.path() / name).string()})
                              .wait();
    ASSERT_EQ(run.code, 0) << run.err;
  }
  const auto later = rows_of(folder.path() / "beside/signals.csv"), loop = rows_of(folder.path() / "inside/signals.csv");
  ASSERT_EQ(later.size(), 3601u);
  ASSERT_EQ(loop.size(), 3601u);
  for (std::size_t n = 0; n < later.size(); ++n) {
    for (const auto& [column, text] : later[n]) {
      const bool of_indices = column.rfind("indices.", 0) == 0;
      EXPECT_EQ(text, loop[of_indices && n >= 10 ? n - 10 : of_indices ? 0 : n].at(column)) << n << ' ' << column;
    }
  }
}

TEST(TwoProcesses, NameTheStatesThatDiffer) {
  const cotwin::testing::TemporaryFolder folder("two_processes");
  Process control = start("control", "beside", 30'202, 30'203, "600", folder.path());
  const RunResult slow =
      start_program({"run", example("beside").string(), "--quiet", "--set", "control.listen=" + address(30'203), "--set",
                     "control.peer=" + address(30'202), "--set", "control.subscribe=q:7:rad,dq:7:rad/s,ddq:7:rad/s2"})
          .wait();
  EXPECT_NE(slow.code, 0);
  EXPECT_NE(slow.err.find("publishes 'q:7:rad,dq:7:rad/s', expected 'q:7:rad,dq:7:rad/s,ddq:7:rad/s2' (setting subscribe)"),
            std::string::npos)
      << slow.err;
}

}  // namespace
}  // namespace two_processes_test
