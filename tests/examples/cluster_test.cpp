// examples/27_cluster: the study of the uncertain insertion on a real Slurm with two nodes, which the script of the example starts. Takes
// minutes and the packages of the group `cluster`: only with COTWIN_CLUSTER=1, otherwise skipped, as where Slurm cannot start. All that a
// cluster can do wrong is played in tests/master/farm/slurm_test.cpp.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/text.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cluster_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Process;
using cotwin::testing::run_command;
using cotwin::testing::run_program;
using cotwin::testing::RunOptions;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;
using cotwin::testing::TemporaryFolder;
using ::testing::HasSubstr;

const fs::path kExamples = fs::path(cotwin::places::source()) / "examples";
const fs::path kStudy = kExamples / "26_uncertain_insertion/uncertain_insertion.json";

bool waits(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + std::chrono::minutes(3);
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  return true;
}

/// The script of the example, until the end of the tests.
struct Slurm {
  TemporaryFolder folder{"cluster"};
  std::unique_ptr<Process> script;
  std::string missing;  // why there is none
  RunOptions options;   // of programs that use it
  fs::path files;       // of its processes

  Slurm() {
    if (std::getenv("COTWIN_CLUSTER") == nullptr) {
      missing = "takes minutes: COTWIN_CLUSTER=1 scripts/tests.sh build/release -R '^cluster_test'";
      return;
    }
    const std::string begun = (folder / "begun").string();
    script = std::make_unique<Process>(
        std::vector<std::string>{kExamples / "27_cluster/slurm.sh", "sh", "-c",
                                 "echo $CLUSTER >" + begun + "; while [ -e " + begun + " ]; do sleep 0.1; done"},
        RunOptions{.environment = {"COTWIN=" + cotwin::places::program(), "CPUS=1"}, .limit = std::chrono::seconds(900)});
    const fs::path status = "/proc/" + std::to_string(script->id()) + "/stat";
    waits([&] { return !content(begun).empty() || content(status).find(") Z ") != std::string::npos; });
    if (content(begun).empty()) {
      const RunResult ended = script->wait();
      script.reset();
      missing = "Slurm does not start here (" + std::to_string(ended.code) + "): " + ended.err;
      return;
    }
    files = std::string(cotwin::text::trim(content(begun)));
    options.environment = {"SLURM_CONF=" + (files / "slurm.conf").string()};
  }
  ~Slurm() {
    if (!script) return;
    fs::remove(folder / "begun");
    script->wait();
  }
  RunResult run(std::vector<std::string> command) const { return run_command(std::move(command), options); }
  pid_t process(const std::string& name) const { return std::stoi(content(files / (name + ".pid"))); }
};

class Cluster : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { slurm_ = std::make_unique<Slurm>(); }
  static void TearDownTestSuite() { slurm_.reset(); }
  void SetUp() override {
    if (!slurm_->missing.empty()) GTEST_SKIP() << slurm_->missing;
  }
  static const Slurm& slurm() { return *slurm_; }

  std::vector<std::string> farm(int runs, const fs::path& out, const std::vector<std::string>& more = {}) const {
    std::vector<std::string> words = {"farm", kStudy, "--runs", std::to_string(runs), "--out", out, "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  /// All runs, without wall time and session.
  std::map<std::string, std::vector<std::string>> runs(const fs::path& out) const {
    const RunResult found = run_program({"farm", "export", out});
    std::map<std::string, std::vector<std::string>> all;
    cotwin::csv::Reader reader(found.out, "export");
    while (reader.next()) {
      for (std::size_t k = 0; k < reader.names().size(); ++k) {
        if (reader.names()[k] != "seconds" && reader.names()[k] != "session")
          all[reader.names()[k]].emplace_back(reader.text(k));
      }
    }
    return all;
  }
  void expect_runs_of_threads(int number, const fs::path& out) const {
    ASSERT_EQ(run_program(farm(number, folder_ / "threads")).code, 0);
    const auto all = runs(out);
    EXPECT_EQ(all, runs(folder_ / "threads"));
    EXPECT_EQ(all.at("run").size(), static_cast<std::size_t>(number));
  }
  /// Processes that make chunks of the study, by its folder.
  std::vector<pid_t> makers(const fs::path& out) const {
    std::vector<pid_t> found;
    std::istringstream lines(slurm().run({"pgrep", "-f", "farm chunk " + out.string()}).out);
    for (pid_t process; lines >> process;) found.push_back(process);
    return found;
  }

  TemporaryFolder folder_{"farm"};

 private:
  static inline std::unique_ptr<Slurm> slurm_;
};

TEST_F(Cluster, GivesTheRegistryOfThreads) {
  const RunResult made = run_program(farm(40, folder_ / "slurm", {"--on", "slurm", "--partition", "all"}), slurm().options);
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_EQ(made.err, "");
  expect_runs_of_threads(40, folder_ / "slurm");
  const RunResult refused = run_program(farm(40, folder_ / "x", {"--on", "slurm", "--partition", "night"}), slurm().options);
  EXPECT_EQ(refused.code, 2);
  EXPECT_THAT(refused.err, HasSubstr("sinfo: knows no partition 'night'"));
  EXPECT_FALSE(fs::exists(folder_ / "x"));
}

TEST_F(Cluster, EndsCompleteAfterKillsAndCancellations) {
  const fs::path out = folder_ / "slurm";
  auto coordinator = start_program(farm(160, out, {"--on", "slurm"}), slurm().options);
  ASSERT_TRUE(waits([&] { return makers(out).size() == 2; }));
  kill(makers(out).at(0), SIGKILL);      // by the kernel, for want of memory
  kill(slurm().process("n1"), SIGKILL);  // the node; what runs on it goes on
  kill(slurm().process("slurmctld"), SIGTERM);
  std::this_thread::sleep_for(std::chrono::seconds(3));
  ASSERT_EQ(slurm().run({"sh", "-c", "PATH=$PATH:/usr/sbin; slurmctld && slurmd -N n1"}).code, 0);
  ASSERT_TRUE(waits([&] { return slurm().run({"squeue"}).code == 0; }));
  coordinator.signal(SIGKILL);
  coordinator.wait();
  const RunResult told = run_program({"farm", "status", out}, slurm().options);
  EXPECT_THAT(told.out, HasSubstr("chunks in Slurm: "));
  auto resumed = start_program({"farm", "resume", out, "--on", "slurm", "--quiet"}, slurm().options);
  ASSERT_TRUE(waits([&] { return !makers(out).empty(); }));
  slurm().run({"sh", "-c", "squeue --noheader --states=RUNNING --format=%A | head -n 1 | xargs scancel"});
  const RunResult ended = resumed.wait();
  EXPECT_EQ(ended.code, 0) << ended.err;
  EXPECT_THAT(ended.err, HasSubstr("runs are sent again, "));
  expect_runs_of_threads(160, out);
}

TEST_F(Cluster, IsCancelledAndResumed) {
  const fs::path out = folder_ / "slurm";
  auto coordinator = start_program(farm(100, out, {"--on", "slurm"}), slurm().options);
  ASSERT_TRUE(waits([&] { return !makers(out).empty(); }));
  EXPECT_EQ(run_program({"farm", "cancel", out}, slurm().options).code, 0);
  EXPECT_EQ(coordinator.wait().code, 128 + SIGTERM);
  EXPECT_TRUE(makers(out).empty());
  const RunResult resumed = run_program({"farm", "resume", out, "--on", "slurm", "--quiet"}, slurm().options);
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  expect_runs_of_threads(100, out);
}

}  // namespace
}  // namespace cluster_test
