// The files of a program that is stopped, killed, refused or out of disk space.
#include <gmock/gmock-matchers.h>
#include <grp.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "master/run/checkpoint.h"
#include "models/foundation/support/atomic_file.h"
#include "tests/support/files.h"
#include "tests/support/run_program.h"

namespace durable_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::Process;
using cotwin::testing::RunOptions;
using cotwin::testing::RunResult;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

constexpr std::chrono::seconds kPatience(120);  // time limit for events that must happen, also on a busy machine

bool wait_for(const std::function<bool()>& condition) {
  const auto end = std::chrono::steady_clock::now() + kPatience;
  while (!condition()) {
    if (std::chrono::steady_clock::now() > end) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return true;
}

/// A motion and a drive, with a ramp and figures; `seconds` long.
std::string scenario_text(const std::string& seconds) {
  return R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="arm"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="arm">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=planar2" type="application/x-cotwin-unit"/>
      <ssd:Component name="drive" source="unit:drive_train?robot=planar2" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="motion" startConnector="q_d" endElement="drive" endConnector="tau_m" suppressUnitConversion="true"/>
    </ssd:Connections>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime=")" +
         seconds + R"("/>
  <ssd:Annotations><ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="1 ms">
    <cotwin:Event time="0.001" variable="drive.tau_e[1]" value="3" ramp="3"/>
    <cotwin:Recording><cotwin:Record variables="drive.*"/></cotwin:Recording>
    <cotwin:Comparison name="c" a="drive.q" b="motion.q_d"/>
    <cotwin:Report kind="energy" a="drive.tau_J" b="drive.dq"/>
    <cotwin:Report kind="difference" a="drive.q" b="motion.q_d"/>
  </cotwin:Master></ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>
)";
}

/// Runs the program in a folder of its own.
class Durable : public ::testing::Test {
 protected:
  Durable() {
    fs::create_directories(folder_);
    std::ofstream(folder_ / "arm.ssd") << scenario_text("2");
  }
  ~Durable() override { fs::remove_all(folder_); }

  Process start(std::vector<std::string> arguments, const std::function<bool()>& prepare = {}) {
    RunOptions options{.folder = folder_, .limit = kPatience};
    options.prepare = prepare;
    return cotwin::testing::start_program(std::move(arguments), options);
  }
  RunResult run(std::vector<std::string> arguments, const std::function<bool()>& prepare = {}) {
    return start(std::move(arguments), prepare).wait();
  }
  nlohmann::json record(const fs::path& results) const {
    return nlohmann::json::parse(content(folder_ / results / "run.json"));
  }
  bool has(const fs::path& file) const { return fs::exists(folder_ / file); }
  /// Starts a run in real time, two seconds long, and waits for its first checkpoint.
  Process start_and_wait_for_a_checkpoint(const std::string& out) {
    Process child = start({"run", "arm.ssd", "--real-time", "--out", out, "--checkpoint", "0.001"});
    EXPECT_TRUE(wait_for([&] { return has(fs::path(out) / "run.checkpoint"); }));
    return child;
  }
  /// The CSV and the figures of an uninterrupted run.
  std::pair<std::string, std::string> straight() {
    EXPECT_EQ(run({"run", "arm.ssd", "--out", "straight", "--json", "straight.json"}).code, 0);
    return {content(folder_ / "straight/signals.csv"), figures("straight.json")};
  }
  std::string figures(const fs::path& file) const {
    auto j = nlohmann::json::parse(content(folder_ / file));
    nlohmann::json kept;
    for (const char* key : {"state", "reached", "ticks", "signals", "comparisons", "energy", "rows", "dropped_rows"})
      kept[key] = j[key];
    return kept.dump(1);
  }
  static bool whole_lines(const std::string& csv) {
    const auto commas = std::count(csv.begin(), csv.begin() + static_cast<std::ptrdiff_t>(csv.find('\n')), ',');
    std::istringstream lines(csv);
    for (std::string line; std::getline(lines, line);) {
      if (std::count(line.begin(), line.end(), ',') != commas) return false;
    }
    return csv.back() == '\n';
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_durable_" + std::to_string(::getpid()) + "_" +
                                                        ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(Durable, TheSecondRunIntoAFolderIsRefusedAndNamesTheFirst) {
  Process first = start_and_wait_for_a_checkpoint("shared");
  const RunResult second = run({"run", "arm.ssd", "--out", "shared"});
  EXPECT_EQ(second.code, 2);
  EXPECT_THAT(second.err, AllOf(StartsWith("cotwin: shared: process " + std::to_string(first.id()) + " on "),
                                HasSubstr("is writing there; choose another folder")));
  EXPECT_EQ(run({"run", "--resume", "shared"}).code, 2);
  const RunResult ended = first.wait();
  EXPECT_EQ(ended.code, 0);
  EXPECT_FALSE(has("shared/cotwin.lock"));
  EXPECT_FALSE(has("shared/signals.csv.part"));
  EXPECT_EQ(content(folder_ / "shared/signals.csv"), straight().first);
}

TEST_F(Durable, RunJsonContainsTheOriginOfTheResults) {
  EXPECT_EQ(run({"run", "arm.ssd", "--out", "one", "--set", "drive.K=9000", "--stop", "0.5"}).code, 0);
  const nlohmann::json one = record("one");
  EXPECT_EQ(one["state"], "complete");
  EXPECT_EQ(one["scenario"]["name"], "arm");
  EXPECT_EQ(one["set"], nlohmann::json({"drive.K=9000"}));
  EXPECT_EQ(one["parameters"]["drive.K"]["value"], "9000");
  EXPECT_EQ(one["reached"], 0.5);
  EXPECT_EQ(one["rows"], 501);
  for (const char* key : {"program", "machine", "settings", "threads", "begun", "ended", "wall_seconds", "tick"})
    EXPECT_TRUE(one.contains(key)) << key;
  // The columns are those of the file, with their units of measure.
  std::string names;
  for (const auto& column : one["recording"]["columns"]) {
    const int n = column["elements"].get<int>();
    for (int i = 1; i <= n; ++i) {
      if (!names.empty()) names += ',';
      names += column["name"].get<std::string>() + (n > 1 ? "[" + std::to_string(i) + "]" : "");
    }
    if (column["name"] == "drive.tau_J") {
      EXPECT_EQ(column["unit"], "N.m");
    }
  }
  EXPECT_THAT(content(folder_ / "one/signals.csv"), StartsWith(names + "\n"));
  // The hash identifies the scenario with its values: equal for equal runs, different for another value.
  EXPECT_EQ(run({"run", "arm.ssd", "--out", "two", "--set", "drive.K=9000", "--stop", "0.5"}).code, 0);
  EXPECT_EQ(run({"run", "arm.ssd", "--out", "three", "--set", "drive.K=9001", "--stop", "0.5"}).code, 0);
  EXPECT_EQ(record("two")["scenario"]["hash"], one["scenario"]["hash"]);
  EXPECT_NE(record("three")["scenario"]["hash"], one["scenario"]["hash"]);
}

TEST_F(Durable, EarlierResultsAreKeptUnlessTheyMayBeOverwritten) {
  EXPECT_EQ(run({"run", "arm.ssd", "--stop", "0.01"}).code, 0);
  const std::string first = content(folder_ / "results/arm/signals.csv");
  const RunResult second = run({"run", "arm.ssd", "--stop", "0.02"});
  EXPECT_THAT(second.out, HasSubstr("earlier results: moved to results/arm/earlier-1"));
  EXPECT_EQ(content(folder_ / "results/arm/earlier-1/signals.csv"), first);
  EXPECT_EQ(record("results/arm/earlier-1")["reached"], 0.01);
  EXPECT_EQ(record("results/arm")["reached"], 0.02);
  EXPECT_EQ(run({"run", "arm.ssd", "--stop", "0.03", "--overwrite"}).code, 0);
  EXPECT_FALSE(has("results/arm/earlier-2"));
  EXPECT_EQ(record("results/arm")["reached"], 0.03);
}

TEST_F(Durable, AKilledRunGoesOnToTheSameBits) {
  Process child = start_and_wait_for_a_checkpoint("killed");
  child.signal(SIGKILL);
  EXPECT_EQ(child.wait().code, -SIGKILL);
  EXPECT_EQ(record("killed")["state"], "running");
  EXPECT_FALSE(has("killed/signals.csv"));
  const RunResult resumed = run({"run", "--resume", "killed", "--json", "killed.json"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  const auto [csv, figures_of_it] = straight();
  EXPECT_EQ(content(folder_ / "killed/signals.csv"), csv);
  EXPECT_EQ(content(folder_ / "killed/view.bin"), content(folder_ / "straight/view.bin"));
  EXPECT_EQ(figures("killed.json"), figures_of_it);
  EXPECT_EQ(record("killed")["state"], "complete");
  EXPECT_GT(record("killed")["resumed_at"], 0);
  EXPECT_FALSE(has("killed/run.checkpoint"));
  EXPECT_FALSE(has("killed/signals.csv.part"));
}

TEST_F(Durable, ARecordingThatWasChangedSinceTheCheckpointIsRefused) {
  Process child = start_and_wait_for_a_checkpoint("killed");
  child.signal(SIGKILL);
  EXPECT_EQ(child.wait().code, -SIGKILL);
  for (const char* file : {"signals.csv.part", "view.bin.part"}) {
    const fs::path changed = folder_ / "changed";
    fs::remove_all(changed);
    fs::copy(folder_ / "killed", changed, fs::copy_options::recursive);
    std::string bytes = content(changed / file);
    bytes[bytes.find('\n') + 3] ^= 1;  // in the first row
    cotwin::write_file(changed / file, bytes);
    const RunResult refused = run({"run", "--resume", "changed"});
    EXPECT_EQ(refused.code, 2) << file;
    EXPECT_THAT(refused.err, HasSubstr("cannot be resumed: what it had at the checkpoint was changed or damaged")) << file;
    EXPECT_EQ(content(changed / file), bytes);
  }
  EXPECT_EQ(run({"run", "--resume", "killed"}).code, 0);
}

TEST_F(Durable, ARunThatIsKilledAgainAndAgainGoesOnToTheSameBits) {
  Process child = start_and_wait_for_a_checkpoint("killed");
  for (int times = 0; times < 5; ++times) {
    child.signal(SIGKILL);
    if (child.wait().code != -SIGKILL) break;  // it had already ended
    const auto before = fs::last_write_time(folder_ / "killed/run.checkpoint");
    child = start({"run", "--resume", "killed", "--checkpoint", "0.001", "--json", "killed.json"});
    wait_for([&] { return !has("killed/run.checkpoint") || fs::last_write_time(folder_ / "killed/run.checkpoint") != before; });
  }
  EXPECT_EQ(child.wait().code, 0);
  EXPECT_EQ(content(folder_ / "killed/signals.csv"), straight().first);
  EXPECT_EQ(content(folder_ / "killed/view.bin"), content(folder_ / "straight/view.bin"));
}

TEST_F(Durable, AStoppedRunGoesOnFromWhereItWasStopped) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP, SIGXCPU}) {
    const std::string out = "stopped" + std::to_string(signal);
    Process child = start_and_wait_for_a_checkpoint(out);
    child.signal(signal);
    const RunResult stopped = child.wait();
    ASSERT_EQ(stopped.code, 128 + signal) << stopped.err;
    EXPECT_THAT(stopped.err, AllOf(HasSubstr("cotwin: stopped by SIG"), HasSubstr("cotwin run --resume " + out)));
    EXPECT_EQ(record(out)["state"], "stopped");
    EXPECT_THAT(record(out)["reason"].get<std::string>(), HasSubstr("stopped by SIG"));
    const std::string rows = content(folder_ / out / "signals.csv");
    EXPECT_TRUE(whole_lines(rows));
    const RunResult resumed = run({"run", "--resume", out, "--json", "resumed.json"});
    EXPECT_EQ(resumed.code, 0) << resumed.err;
    const auto [csv, figures_of_it] = straight();
    EXPECT_THAT(csv, StartsWith(rows));
    EXPECT_EQ(record(out)["resumed_at"], std::stod(rows.substr(rows.rfind('\n', rows.size() - 2) + 1)));
    EXPECT_EQ(content(folder_ / out / "signals.csv"), csv);
    EXPECT_EQ(content(folder_ / out / "view.bin"), content(folder_ / "straight/view.bin"));
    EXPECT_EQ(figures("resumed.json"), figures_of_it);
  }
}

TEST_F(Durable, ASignalThatWasIgnoredStaysIgnored) {
  Process child = start({"run", "arm.ssd", "--real-time", "--out", "nohup", "--checkpoint", "0.001"},
                        [] { return signal(SIGHUP, SIG_IGN) != SIG_ERR; });
  EXPECT_TRUE(wait_for([&] { return has("nohup/run.checkpoint"); }));
  child.signal(SIGHUP);
  EXPECT_EQ(child.wait().code, 0);
}

TEST_F(Durable, RefusesToGoOnWithAnotherScenarioProgramOrMachine) {
  Process child = start_and_wait_for_a_checkpoint("killed");
  child.signal(SIGKILL);
  child.wait();
  const auto expect_refused = [&](const std::string& what) {
    const RunResult result = run({"run", "--resume", "killed"});
    EXPECT_EQ(result.code, 2);
    EXPECT_THAT(result.err, AllOf(HasSubstr("run.checkpoint"), HasSubstr(what)));
    EXPECT_EQ(std::count(result.err.begin(), result.err.end(), '\n'), 1) << result.err;
    EXPECT_EQ(record("killed")["state"], "running");
  };
  std::ofstream(folder_ / "arm.ssd") << scenario_text("3");
  expect_refused("belongs to another scenario: arm.ssd or a file that it names has changed");
  std::ofstream(folder_ / "arm.ssd") << scenario_text("2");

  using cotwin::master::RunCheckpoint;
  const fs::path file = folder_ / "killed/run.checkpoint";
  const RunCheckpoint good = cotwin::master::load_checkpoint(file);
  const auto expect_refused_after = [&](const std::function<void(RunCheckpoint&)>& change, const std::string& what) {
    RunCheckpoint changed = good;
    change(changed);
    cotwin::write_file(file, to_bytes(changed));
    expect_refused(what);
  };
  expect_refused_after([](RunCheckpoint& c) { c.build.version = "0.0.1"; }, "was written by cotwin 0.0.1");
  expect_refused_after([](RunCheckpoint& c) { c.build.file ^= 1; }, "expected the same program");
  expect_refused_after([](RunCheckpoint& c) { c.build.cpu = "abacus"; }, "with the instruction set abacus");
  expect_refused_after([](RunCheckpoint& c) { c.models ^= 1; }, "or a file that it names has changed");
  expect_refused_after([](RunCheckpoint& c) { c.command = "[1"; }, "its options cannot be read");
  expect_refused_after([](RunCheckpoint& c) { c.folder = "/nowhere/at/all"; }, "/nowhere/at/all");
  cotwin::write_file(file, "CTWRUN3\nnonsense");
  expect_refused("damaged or cut short");
  cotwin::write_file(file, to_bytes(good));
  EXPECT_THAT(run({"run", "--resume", "nowhere"}).err, HasSubstr("nowhere/run.checkpoint: cannot be read: No such file"));
  EXPECT_THAT(run({"run", "arm.ssd", "--resume", "killed"}).err, HasSubstr("FILE: cannot be changed when a run is resumed"));
  EXPECT_EQ(run({"run", "--resume", "killed"}).code, 0);
}

TEST_F(Durable, SigtermDuringInitialisationEndsTheProgramWithAMessage) {
  // Many robots, so that loading takes long enough; the signal is sent as soon as the program has a handler for it.
  std::string text = scenario_text("2"), more;
  for (int i = 0; i < 4000; ++i)
    more += "<ssd:Component name=\"m" + std::to_string(i) +
            "\" source=\"unit:motion?robot=lwr4\" type=\"application/x-cotwin-unit\"/>\n";
  text.insert(text.find("</ssd:Elements>"), more);
  std::ofstream(folder_ / "many.ssd") << text;
  for (const int signal : {SIGTERM, SIGHUP}) {
    Process child = start({"run", "many.ssd", "--out", "many"});
    const auto caught = [&] {
      std::ifstream status("/proc/" + std::to_string(child.id()) + "/status");
      for (std::string line; std::getline(status, line);) {
        if (line.starts_with("SigCgt:")) return (std::stoull(line.substr(7), nullptr, 16) >> (signal - 1) & 1) != 0;
      }
      return false;
    };
    ASSERT_TRUE(wait_for(caught));
    child.signal(signal);
    const RunResult result = child.wait();
    EXPECT_EQ(result.code, 128 + signal);
    EXPECT_THAT(result.err, HasSubstr("while loading and initialising; no results were written"));
    EXPECT_FALSE(has("many"));
  }
}

TEST_F(Durable, AtTheFileSizeLimitTheRowsAreCompleteAndTheErrorIsReported) {
  const RunResult result = run({"run", "arm.ssd", "--out", "limited"}, [] {
    const rlimit limit{100'000, 100'000};
    return setrlimit(RLIMIT_FSIZE, &limit) == 0;
  });
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr("signals.csv: cannot be written: File too large"));
  EXPECT_EQ(record("limited")["state"], "failed");
  EXPECT_THAT(result.err, HasSubstr(record("limited")["reason"].get<std::string>()));
  EXPECT_GT(record("limited")["reached"], 0);
  const std::string csv = content(folder_ / "limited/signals.csv");
  EXPECT_GT(csv.size(), 50'000u);
  EXPECT_TRUE(whole_lines(csv));
  EXPECT_EQ(record("limited")["rows"], std::ranges::count(csv, '\n') - 1) << "those that the file has";
}

TEST_F(Durable, OnAFullDiskTheRowsAreCompleteAndRunJsonHasTheStateFailed) {
  fs::create_directory(folder_ / "small");
  if (unshare(CLONE_NEWNS) != 0 || mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      mount("tmpfs", (folder_ / "small").c_str(), "tmpfs", 0, "size=400k") != 0)
    GTEST_SKIP() << "file systems cannot be mounted here";
  const RunResult result = run({"run", "arm.ssd", "--out", "small/results", "--checkpoint", "0.001"});
  EXPECT_EQ(result.code, 1) << result.err;
  EXPECT_THAT(result.err, HasSubstr("signals.csv: cannot be written: No space left on device"));
  EXPECT_EQ(record("small/results")["state"], "failed");
  EXPECT_TRUE(whole_lines(content(folder_ / "small/results/signals.csv")));
  // With more space it continues, if it came as far as a checkpoint.
  ASSERT_EQ(mount("tmpfs", (folder_ / "small").c_str(), "tmpfs", MS_REMOUNT, "size=40m"), 0);
  if (has("small/results/run.checkpoint")) {
    EXPECT_EQ(run({"run", "--resume", "small/results"}).code, 0);
    EXPECT_EQ(content(folder_ / "small/results/signals.csv"), straight().first);
  }
  ASSERT_EQ(mount("tmpfs", (folder_ / "small").c_str(), "tmpfs", MS_REMOUNT | MS_RDONLY, nullptr), 0);
  EXPECT_THAT(run({"run", "arm.ssd", "--out", "small/other"}).err,
              HasSubstr("small/other: cannot be created: Read-only file system"));
  umount((folder_ / "small").c_str());
}

TEST_F(Durable, AFolderThatMayNotBeWrittenIsNamedWithTheSystemsReason) {
  fs::create_directory(folder_ / "closed");
  fs::permissions(folder_ / "closed", fs::perms::owner_read | fs::perms::owner_exec | fs::perms::group_read |
                                          fs::perms::group_exec | fs::perms::others_read | fs::perms::others_exec);
  const auto as_nobody = [] {
    return getuid() != 0 || (setgroups(0, nullptr) == 0 && setgid(65534) == 0 && setuid(65534) == 0);
  };
  const RunResult result = run({"run", "arm.ssd", "--out", "closed/results", "--stop", "0.01"}, as_nobody);
  EXPECT_EQ(result.code, 2);
  EXPECT_THAT(result.err,
              AllOf(HasSubstr("closed/results: cannot be created: Permission denied"), Not(HasSubstr("No such file"))));
}

}  // namespace
}  // namespace durable_test
