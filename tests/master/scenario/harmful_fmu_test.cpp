// The program with FMUs that crash, exit, hang, allocate or write without end: fmu/fmus/harm2.cpp.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/fmu/foreign.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::master::harmful_fmu_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::RunResult;
using cotwin::testing::words;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr bool kSanitized = std::string_view(COTWIN_SANITIZERS) != "";

class HarmfulFmu : public ::testing::Test {
 protected:
  HarmfulFmu() {
    fs::create_directories(folder_);
    fmu::testing::make_fmu("harm2", folder_);
  }
  ~HarmfulFmu() override { fs::remove_all(folder_); }

  /// Runs the program while the FMU does `harm` in the function `where`.
  RunResult program(const std::vector<std::string>& arguments, const std::string& harm, const std::string& where,
                    const std::vector<std::string>& environment = {}) {
    testing::RunOptions options{.folder = folder_, .environment = environment, .limit = std::chrono::seconds(60)};
    options.environment.insert(options.environment.end(), {"COTWIN_HARM=" + harm, "COTWIN_HARM_AT=" + where});
    return testing::run_program(arguments, options);
  }
  RunResult run_fmu(const std::string& process, const std::string& harm, const std::string& where) {
    const std::string timeout = harm == "hang" || harm == "flood" ? "1" : "60";
    return program(words("run harm2.fmu --quiet --timeout " + timeout + " --memory 200e6 --process " + process), harm, where);
  }
  /// 'pump' is the FMU.
  std::vector<std::string> scenario(const std::string& process, const std::string& harm) {
    std::ofstream(folder_ / "plant.ssd") << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="plant"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="plant">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=lwr4" type="application/x-cotwin-unit"/>
      <ssd:Component name="pump" source="harm2.fmu?timeout=)"
                                         << (harm == "hang" || harm == "flood" ? 1 : 60)
                                         << R"(&amp;memory=200e6" type="application/x-fmu-sharedlibrary"/>
    </ssd:Elements>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="1">
    <ssd:Annotations><ssc:Annotation type="cotwin.master">
      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1" tick="0.01"><cotwin:Component name="pump" process=")"
                                         << process << R"("/></cotwin:Master>
    </ssc:Annotation></ssd:Annotations>
  </ssd:DefaultExperiment>
</ssd:SystemStructureDescription>
)";
    return {"run", "plant.ssd", "--quiet"};
  }
  /// The number of complete rows without the header; 0 if the last row is incomplete.
  static std::size_t whole_rows(const std::string& csv) {
    std::size_t rows = 0;
    std::istringstream in(csv);
    std::string line;
    std::getline(in, line);
    const auto columns = std::count(line.begin(), line.end(), ',');
    while (std::getline(in, line)) {
      if (std::count(line.begin(), line.end(), ',') == columns) ++rows;
    }
    return csv.ends_with('\n') ? rows : 0;
  }
  std::string recording() const {
    const fs::path file = folder_ / "results/plant/signals.csv";
    return content(fs::exists(file) ? file : fs::path(file.string() + ".part"));
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_harm_" + std::to_string(::getpid()));
};

const char* const kEnds[] = {"exit", "exit-3", "quick_exit", "thread-exit", "abort",     "segv",    "bus",
                             "fpe",  "ill",    "null",       "throw",       "throw-int", "overflow"};

TEST_F(HarmfulFmu, IsPackedWithAWarning) {
  scenario("auto", "abort");
  const RunResult result = program(words("pack plant.ssd -o plant.ssp"), "abort", "fmi2EnterInitializationMode");
  EXPECT_EQ(result.code, 0);
  EXPECT_THAT(result.err, AllOf(HasSubstr("warning: connected inputs have the start values of their units"), HasSubstr("pump"),
                                HasSubstr("fmi2EnterInitializationMode")));
  EXPECT_TRUE(fs::exists(folder_ / "plant.ssp"));
}

TEST_F(HarmfulFmu, EndsTheRunWithAMessageAndKeepsTheRowsInTheSharedProcess) {
  for (const std::string harm : kEnds) {
    const RunResult ran = run_fmu("shared", harm, "fmi2DoStep");
    EXPECT_EQ(ran.code, 1) << harm;
    EXPECT_THAT(ran.err, AllOf(HasSubstr("fmu"), HasSubstr("at t = 0.5 s: harm2.fmu: fmi2DoStep"))) << harm;
    EXPECT_EQ(whole_rows(content(folder_ / "harm2_out.csv")), 51u) << harm;
    fs::remove(folder_ / "harm2_out.csv");

    const RunResult twin = program(scenario("shared", harm), harm, "fmi2DoStep");
    EXPECT_EQ(twin.code, 1) << harm;
    EXPECT_THAT(twin.err, AllOf(HasSubstr("pump"), HasSubstr("at t = 0.5 s: harm2.fmu: fmi2DoStep"))) << harm;
    EXPECT_EQ(whole_rows(recording()), 51u) << harm;
    fs::remove_all(folder_ / "results");
  }
}

TEST_F(HarmfulFmu, EndsTheRunWithAMessageAndKeepsTheRowsInItsOwnProcess) {
  std::vector<std::string> harms(std::begin(kEnds), std::end(kEnds));
  harms.insert(harms.end(), {"_exit", "kill", "hang", "memory", "flood"});
  for (const std::string& harm : harms) {
    const RunResult ran = run_fmu("own", harm, "fmi2DoStep");
    EXPECT_EQ(ran.code, 1) << harm;
    EXPECT_THAT(ran.err, AllOf(HasSubstr("fmu at t = 0.5 s: harm2.fmu: "), HasSubstr("fmi2DoStep"))) << harm;
    EXPECT_EQ(whole_rows(content(folder_ / "harm2_out.csv")), 51u) << harm;
    fs::remove(folder_ / "harm2_out.csv");

    const RunResult twin = program(scenario("own", harm), harm, "fmi2DoStep");
    EXPECT_EQ(twin.code, 1) << harm;
    EXPECT_THAT(twin.err, AllOf(HasSubstr("pump at t = 0.5 s: harm2.fmu: "), HasSubstr("fmi2DoStep"))) << harm;
    EXPECT_EQ(whole_rows(recording()), 51u) << harm;
    fs::remove_all(folder_ / "results");
  }
}

// These end the process in ways that it cannot handle itself: the watching process reports them and completes the results.
TEST_F(HarmfulFmu, FailsRunsOfAStudyAndNotTheStudy) {
  scenario("shared", "kill");
  const RunResult farm =
      program(words("farm plant.ssd --vary motion.time_scale=1:2 --runs 4 --threads 2 --out study"), "kill", "fmi2DoStep");
  EXPECT_EQ(farm.code, 1);  // no run is done
  EXPECT_THAT(farm.out,
              AllOf(HasSubstr("plant: 4 of 4 runs, 4 failed\n  failed: 4 runs, first 1: pump at t = 0.5 s: harm2.fmu: "),
                    HasSubstr("fmi2DoStep")));
  const RunResult safe = program(words("farm plant.ssd --vary motion.time_scale=1:2 --runs 4 --threads 2 --out safe"), "", "");
  EXPECT_EQ(safe.code, 0) << safe.err;
  EXPECT_THAT(safe.out, HasSubstr("plant: 4 of 4 runs, 0 failed"));
}

TEST_F(HarmfulFmu, NeverEndsARunInSilence) {
  for (const std::string harm : {"_exit", "_Exit", "exit_group", "kill", "alarm", "file size", "file size signal"}) {
    const RunResult twin = program(scenario("shared", harm), harm, "fmi2DoStep");
    EXPECT_EQ(twin.code, 1) << harm << ": " << twin.err;
    const bool own_error = harm == "file size";  // and not in a call
    if (!own_error) {
      EXPECT_THAT(twin.err, AllOf(HasSubstr("'pump' at t = 0."), HasSubstr("harm2.fmu"))) << harm;
    }
    EXPECT_FALSE(fs::exists(folder_ / "results/plant/signals.csv.part")) << harm;
    if (harm == "exit_group" || harm == "kill") {
      const std::string csv = recording(), last = csv.substr(csv.rfind('\n', csv.size() - 2) + 1);
      EXPECT_THAT(twin.err,
                  HasSubstr(whole_rows(csv) == 0 ? "; no row was written yet"
                                                 : "; the rows up to t = " + last.substr(0, last.find(',')) + " s are in"))
          << harm;
    }
    EXPECT_TRUE(recording().ends_with('\n')) << harm;
    if (harm == "alarm" || (harm.starts_with("_") && !kSanitized)) {
      EXPECT_EQ(whole_rows(recording()), 51u) << harm;
    }
    EXPECT_THAT(content(folder_ / "results/plant/run.json"), HasSubstr("\"state\": \"failed\"")) << harm;
    EXPECT_FALSE(fs::exists(folder_ / "results/plant/cotwin.lock")) << harm;
    fs::remove_all(folder_ / "results");

    const RunResult ran = run_fmu("shared", harm, "fmi2DoStep");
    EXPECT_EQ(ran.code, 1) << harm << ": " << ran.err;
    if (!own_error) {
      EXPECT_THAT(ran.err, AllOf(HasSubstr("'fmu' at t = 0."), HasSubstr("harm2.fmu"))) << harm;
    }
    EXPECT_TRUE(content(folder_ / "harm2_out.csv").ends_with('\n')) << harm;
    fs::remove(folder_ / "harm2_out.csv");
  }
}

TEST_F(HarmfulFmu, LeavesResultsWhereTheyBelongWhenItChangesTheFolder) {
  for (const char* function : {"load", "fmi2Instantiate", "fmi2EnterInitializationMode", "fmi2DoStep"}) {
    const RunResult twin = program(scenario("shared", ""), "chdir", function);
    EXPECT_EQ(twin.code, 0) << function << ": " << twin.err;
    EXPECT_EQ(whole_rows(recording()), 101u) << function;
    for (const char* file : {"run.json", "summary.json"}) EXPECT_TRUE(fs::exists(folder_ / "results/plant" / file)) << function;
    EXPECT_FALSE(fs::exists("/results"));
    fs::remove_all(folder_ / "results");
    EXPECT_EQ(run_fmu("shared", "chdir", function).code, 0) << function;
    EXPECT_EQ(whole_rows(content(folder_ / "harm2_out.csv")), 101u) << function;
    fs::remove(folder_ / "harm2_out.csv");
  }
}

TEST_F(HarmfulFmu, IsFoundInEveryRunOfASearchWhenItChangesTheFolder) {
  scenario("shared", "");
  std::vector<std::string> search = words("search plant.ssd --until motion.q_d[1]>9 --vary");
  search.emplace_back("motion.t_start=0:1");
  EXPECT_THAT(program(search, "chdir", "fmi2DoStep").err, Not(HasSubstr("no such file")));
}

TEST_F(HarmfulFmu, MaySendSignalsWhileItsEndIsHandled) {
  for (const std::string harm : {"alarms", "alarms and exit"}) {
    for (int attempt = 0; attempt < 3; ++attempt) {
      const RunResult twin = program(scenario("shared", ""), harm, "fmi2DoStep");
      EXPECT_EQ(twin.code, 1) << harm;
      EXPECT_THAT(twin.err, HasSubstr("'pump' at t = 0.5 s: harm2.fmu: fmi2DoStep")) << harm;
      EXPECT_EQ(whole_rows(recording()), 51u) << harm;
      fs::remove_all(folder_ / "results");
    }
  }
}

TEST_F(HarmfulFmu, NeverEndsASearchInSilence) {
  scenario("shared", "exit_group");
  std::vector<std::string> search = words("search plant.ssd --until motion.q_d[1]>9 --vary");
  search.emplace_back("motion.t_start=0:1");
  const RunResult searched = program(search, "exit_group", "fmi2DoStep");
  EXPECT_EQ(searched.code, 1) << searched.err;
  EXPECT_THAT(searched.err, HasSubstr("component 'pump' at t = 0.5 s: harm2.fmu: fmi2DoStep: the process of the run exited"));
}

// The values before it was noticed cannot be trusted, but the run does not end as if nothing had happened. On one thread: threads
// that share the units may wait for each other for ever when the memory by which they do is damaged.
TEST_F(HarmfulFmu, MayNotDamageTheHeapInSilence) {
  if (kSanitized) GTEST_SKIP() << "its own heap is checked by the sanitizer";
  for (const std::string process : {"shared", "own"}) {
    std::vector<std::string> on_one_thread = scenario(process, "");
    on_one_thread.insert(on_one_thread.end(), {"--threads", "1"});
    EXPECT_EQ(program(on_one_thread, "heap", "fmi2DoStep").code, 1) << process;
    EXPECT_EQ(run_fmu(process, "heap", "fmi2DoStep").code, 1) << process;
  }
}

// Processes that have left the group of the run, too.
TEST_F(HarmfulFmu, EndsWithAllProcessesThatItHasStarted) {
  for (const std::string process : {"shared", "own"}) {
    for (const std::string harm : {"daemon", "daemon and exit"}) {
      const std::string mark = "COTWIN_MARK=" + std::to_string(::getpid()) + process;
      EXPECT_EQ(program(scenario(process, ""), harm, "fmi2DoStep", {mark}).code, harm == "daemon" ? 0 : 1);
      for (const auto& entry : fs::directory_iterator("/proc"))
        EXPECT_THAT(content(entry.path() / "environ"), Not(HasSubstr(mark))) << process << ' ' << harm;
    }
  }
}

// A shell that is replaced by the program leaves its children to it: cotwin run plant.ssd > >(tee log).
TEST_F(HarmfulFmu, DoesNotEndProcessesThatWereThereBeforeTheRun) {
  scenario("shared", "");
  const std::string script =
      "exec > >(cat; sleep 0.2; echo survived > survived); exec " + places::program() + " run plant.ssd --quiet";
  EXPECT_EQ(testing::run_command({"bash", "-c", script}, {.folder = folder_, .limit = std::chrono::seconds(60)}).code, 0);
  for (int i = 0; i < 2000 && !fs::exists(folder_ / "survived"); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_TRUE(fs::exists(folder_ / "survived"));
}

TEST_F(HarmfulFmu, EndsARunThatWasStartedWithIgnoredSignalsOfChildren) {
  testing::RunOptions options{.folder = folder_, .limit = std::chrono::seconds(60)};
  options.environment = {"COTWIN_HARM=kill", "COTWIN_HARM_AT=fmi2DoStep"};
  options.prepare = [] { return ::signal(SIGCHLD, SIG_IGN) != SIG_ERR; };
  const RunResult ran = testing::run_program(scenario("shared", ""), options);
  EXPECT_EQ(ran.code, 1);
  EXPECT_THAT(ran.err, HasSubstr("'pump' at t = 0.5 s: harm2.fmu: fmi2DoStep: the process of the run was killed by signal 9"));
}

// Its code would be unmapped below it.
TEST_F(HarmfulFmu, MayLeaveAThreadRunning) {
  for (const std::string process : {"shared", "own"}) {
    const RunResult twin = program(scenario(process, ""), "thread left", "fmi2DoStep");
    EXPECT_EQ(twin.code, 0) << twin.err;
    EXPECT_EQ(whole_rows(recording()), 101u);
    fs::remove_all(folder_ / "results");
    EXPECT_EQ(run_fmu(process, "thread left", "fmi2DoStep").code, 0);
    fs::remove(folder_ / "harm2_out.csv");
  }
}

TEST_F(HarmfulFmu, MayForkAndItsChildrenEndAsUsual) {
  for (const std::string process : {"shared", "own"}) {
    const RunResult twin = program(scenario(process, ""), "forks", "fmi2EnterInitializationMode");
    EXPECT_EQ(twin.code, 0) << twin.err;
    EXPECT_THAT(twin.err, Not(HasSubstr("harm2.fmu")));
    EXPECT_EQ(whole_rows(recording()), 101u);
    fs::remove_all(folder_ / "results");
  }
}

// The watching process passes signals on, and the run does not survive it.
TEST_F(HarmfulFmu, IsStoppedAndKilledWithTheProgram) {
  for (const int signal : {SIGTERM, SIGKILL}) {
    std::vector<std::string> arguments = scenario("shared", "");
    arguments.insert(arguments.end(), {"--real-time", "--stop", "1e5"});
    testing::Process program = testing::start_program(arguments, {.folder = folder_, .limit = std::chrono::seconds(60)});
    const fs::path record = folder_ / "results/plant/run.json";
    const auto state = [&] { return content(record).find("\"running\"") != std::string::npos; };
    for (int i = 0; i < 6000 && !state(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    ASSERT_TRUE(state());
    std::string text = content(record);
    const pid_t run = std::stoi(text.substr(text.find("\"process\": ") + 11));
    EXPECT_NE(run, program.id());
    program.signal(signal);
    EXPECT_EQ(program.wait().code, signal == SIGTERM ? 128 + SIGTERM : -SIGKILL);
    for (int i = 0; i < 1000 && kill(run, 0) == 0; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
    EXPECT_NE(kill(run, 0), 0);
    if (signal == SIGTERM) {
      EXPECT_THAT(content(record), HasSubstr("\"state\": \"stopped\""));
    }
    fs::remove_all(folder_ / "results");
  }
}

TEST_F(HarmfulFmu, IsStoppedDuringItsInitialisationEvenIfItIgnoresSignals) {
  const std::vector<std::string> arguments = scenario("shared", "");
  testing::RunOptions options{.folder = folder_, .limit = std::chrono::seconds(60)};
  options.environment = {"COTWIN_HARM=deaf", "COTWIN_HARM_AT=fmi2EnterInitializationMode"};
  testing::Process program = testing::start_program(arguments, options);
  // Until it hangs in the FMU: it ignores SIGTERM.
  const auto deaf = [&] {
    const std::string children =
        content("/proc/" + std::to_string(program.id()) + "/task/" + std::to_string(program.id()) + "/children");
    const std::string status = children.empty() ? "" : content("/proc/" + std::to_string(std::stoi(children)) + "/status");
    const std::size_t at = status.find("SigIgn:\t");
    return at != std::string::npos && (std::stoull(status.substr(at + 8), nullptr, 16) >> (SIGTERM - 1) & 1u) != 0;
  };
  for (int i = 0; i < 6000 && !deaf(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  ASSERT_TRUE(deaf());
  program.signal(SIGTERM);
  const RunResult ran = program.wait();
  EXPECT_EQ(ran.code, 128 + SIGTERM);
  EXPECT_THAT(ran.err, HasSubstr("SIGTERM while loading and initialising, in component 'pump' at t = 0 s: harm2.fmu: "
                                 "fmi2EnterInitializationMode, which had to be killed; no results were written"));
}

TEST_F(HarmfulFmu, LeavesNoTemporaryFolderBehind) {
  const std::size_t before = fmu::testing::temporary_folders();
  for (const std::string harm : {"exit", "segv", "exit_group", "kill"}) {
    EXPECT_EQ(program(scenario("shared", harm), harm, "fmi2DoStep").code, 1) << harm;
    EXPECT_EQ(fmu::testing::temporary_folders(), before) << harm;
  }
}

TEST_F(HarmfulFmu, IsNamedForAnyFunction) {
  for (const std::string process : {"shared", "own"}) {
    for (const std::string harm : {"exit", "abort", "segv"}) {
      for (const std::string where :
           {"load", "fmi2Instantiate", "fmi2EnterInitializationMode", "fmi2Terminate", "fmi2FreeInstance", "unload"}) {
        const RunResult ran = run_fmu(process, harm, where);
        const std::string named = where == "load"     ? "the loading of its library"
                                  : where == "unload" ? "the unloading of its library"
                                                      : where;
        EXPECT_THAT(ran.err, AllOf(HasSubstr("harm2.fmu"), HasSubstr(named))) << process << ' ' << harm << ' ' << where;
        const bool late = where == "fmi2Terminate" || where == "fmi2FreeInstance" || where == "unload";
        EXPECT_EQ(ran.code, late || process == "shared" ? 1 : 2) << process << ' ' << harm << ' ' << where;
        EXPECT_EQ(whole_rows(content(folder_ / "harm2_out.csv")), late ? 101u : 0u) << process << ' ' << harm << ' ' << where;
        fs::remove(folder_ / "harm2_out.csv");
      }
    }
  }
}

TEST_F(HarmfulFmu, RunsInItsOwnProcessUnlessItIsOfCotwinOrAnOptionSaysOtherwise) {
  EXPECT_THAT(run_fmu("auto", "_exit", "fmi2DoStep").err,
              HasSubstr("the FMU's own process exited with status 0 in fmi2DoStep"));
  ASSERT_EQ(program(words("pack unit:motion?robot=lwr4 --fmi 2 -o motion.fmu"), "", "").code, 0);
  const std::vector<std::string> without_host = {"COTWIN_FMU_HOST=/nowhere"};
  EXPECT_EQ(program(words("run motion.fmu --quiet"), "", "", without_host).code, 0);
  EXPECT_THAT(program(words("run harm2.fmu --quiet"), "", "", without_host).err, HasSubstr("/nowhere: cannot be started"));
  EXPECT_EQ(program(words("run harm2.fmu --quiet --process shared"), "", "", without_host).code, 0);
}

TEST_F(HarmfulFmu, IsCheckedInAProcessOfItsOwn) {
  for (const std::string harm : {"exit", "_exit", "abort", "throw"}) {
    scenario("auto", harm);
    const RunResult plant = program(words("check plant.ssd"), harm, "fmi2Instantiate");
    EXPECT_EQ(plant.code, 2) << harm;
    EXPECT_THAT(plant.out, AllOf(HasSubstr("component 'pump': harm2.fmu: "), HasSubstr("fmi2Instantiate"))) << harm;
    const RunResult checked = program(words("check harm2.fmu"), harm, "fmi2EnterInitializationMode");
    EXPECT_EQ(checked.code, 2) << harm;
    EXPECT_THAT(checked.out, AllOf(HasSubstr("error: Co-Simulation: harm2.fmu: "), HasSubstr("fmi2EnterInitializationMode")))
        << harm;
  }
}

TEST_F(HarmfulFmu, CannotDisturbTheOutputOfTheProgram) {
  const RunResult ran = program(words("run harm2.fmu --json - --process own"), "stdout", "fmi2DoStep");
  EXPECT_EQ(ran.code, 0);
  EXPECT_THAT(ran.out, AllOf(::testing::StartsWith("{"), Not(HasSubstr("of five thousand")), HasSubstr("\"done\"")));
  EXPECT_THAT(ran.err.substr(0, 100), ::testing::StartsWith("line 0 of five thousand"));
  EXPECT_LT(ran.err.size(), 70'000u);
}

TEST_F(HarmfulFmu, GivesTheSameResultsInItsOwnProcess) {
  EXPECT_EQ(run_fmu("shared", "", "").code, 0);
  const std::string here = content(folder_ / "harm2_out.csv");
  EXPECT_EQ(run_fmu("own", "", "").code, 0);
  EXPECT_EQ(content(folder_ / "harm2_out.csv"), here);
  EXPECT_EQ(whole_rows(here), 101u);
}

}  // namespace
}  // namespace cotwin::master::harmful_fmu_test
