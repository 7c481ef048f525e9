// cotwin farm: figures beside those of cotwin run, kills, full disks, changed files, repeats.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

#include "models/foundation/formats/csv.h"
#include "models/foundation/support/text.h"
#include "tests/support/files.h"
#include "tests/support/patience.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace farm_program_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::run_program;
using cotwin::testing::RunResult;
using cotwin::testing::start_program;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::within_patience;
using nlohmann::json;
using ::testing::HasSubstr;

const fs::path kArm = fs::path(cotwin::places::source()) / "examples/01_joint_admittance/arm.ssd";

std::map<std::string, std::vector<std::string>> exported(const fs::path& folder) {
  const RunResult found = run_program({"farm", "export", folder});
  EXPECT_EQ(found.code, 0) << found.err;
  std::map<std::string, std::vector<std::string>> all;
  cotwin::csv::Reader reader(found.out, "export");
  while (reader.next()) {
    for (std::size_t k = 0; k < reader.names().size(); ++k) all[reader.names()[k]].emplace_back(reader.text(k));
  }
  return all;
}

TEST(FarmProgram, GivesTheFiguresOfARunWithTheSameValues) {
  const TemporaryFolder folder("farm");
  const RunResult made = run_program({"farm", kArm, "--vary", "compliance.S_a[1]=log_uniform:50:5000", "--vary",
                                      "compliance.tau_e=2,5,9", "--runs", "6", "--design", "sobol", "--stop", "1.2", "--keep",
                                      "figures", "--keep", "peak compliance.Delta[1]", "--out", folder / "out"});
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_THAT(made.out, HasSubstr("arm: 6 of 6 runs, 0 failed"));
  auto all = exported(folder / "out");
  ASSERT_EQ(all["run"].size(), 6u);
  for (const int run : {2, 5}) {
    const auto at = static_cast<std::size_t>(run - 1);
    const RunResult alone =
        run_program({"run", kArm, "--stop", "1.2", "--set", "compliance.S_a[1]=" + all["compliance.S_a[1]"][at], "--set",
                     "compliance.tau_e=" + all["compliance.tau_e"][at], "--out", folder / "alone", "--overwrite", "--quiet"});
    ASSERT_EQ(alone.code, 0) << alone.err;
    const RunResult again = run_program({"farm", "repeat", folder / "out", std::to_string(run), "--out", folder / "again"});
    ASSERT_EQ(again.code, 0) << again.err;
    EXPECT_THAT(again.out, HasSubstr("--set 'compliance.S_a[1]=" + all["compliance.S_a[1]"][at] + "'"));
    EXPECT_EQ(content(folder / "again/signals.csv"), content(folder / "alone/signals.csv"));
    const json summary = json::parse(content(folder / "alone/summary.json"));
    std::size_t compared = 0;
    for (const json& signal : summary.at("signals")) {
      const std::string name = signal.at("name");
      EXPECT_EQ(all.at("rms " + name)[at], cotwin::text::to_text(signal.at("total_rms").get<double>())) << name;
      EXPECT_EQ(all.at("max " + name)[at], cotwin::text::to_text(signal.at("total_max").get<double>())) << name;
      ++compared;
    }
    EXPECT_GT(compared, 0u);
  }
}

/// A study of many runs in a folder of its own.
struct Many {
  TemporaryFolder folder{"farm"};
  fs::path study, out = folder / "out";
  explicit Many(int runs, const std::string& more = "") {
    fs::copy(kArm, folder / "arm.ssd");
    study = folder.write(
        "many.json", R"({"scenario": "arm.ssd", "vary": {"compliance.S_a[1]": {"uniform": [50, 5000]}}, "runs": )" +
                         std::to_string(runs) +
                         R"(, "stop_s": 0.1, "keep": ["end compliance.Delta[1]", "peak compliance.tau_e[1]"])" + more + "}");
  }
};

TEST(FarmProgram, LosesNoRunAndRepeatsNoneWhenItIsKilled) {
  const Many many(300);
  std::map<std::string, std::string> seconds;  // by run: wall time tells one run from its repetition
  int kills = 0;
  for (;; ++kills) {
    const std::size_t before = seconds.size();
    auto farm = kills == 0 ? start_program({"farm", many.study, "--out", many.out, "--threads", "2", "--quiet"})
                           : start_program({"farm", "resume", many.out, "--threads", "2", "--quiet"});
    const bool is_last = kills == 3;
    if (!is_last) {
      ASSERT_TRUE(within_patience([&] {
        if (!fs::exists(many.out / "farm.db")) return false;
        const RunResult status = run_program({"farm", "status", many.out, "--json", "-"});
        return status.code == 0 && json::parse(status.out).at("done").get<std::size_t>() > before;
      }));
      farm.signal(SIGKILL);
    }
    const RunResult ended = farm.wait();
    EXPECT_EQ(ended.code, is_last ? 0 : ended.code) << ended.err;
    auto all = exported(many.out);
    ASSERT_GT(all["run"].size(), before);
    for (std::size_t i = 0; i < all["run"].size(); ++i) {
      const auto [known, is_new] = seconds.emplace(all["run"][i], all["seconds"][i]);
      EXPECT_EQ(known->second, all["seconds"][i]) << "run " << all["run"][i] << " was repeated";
    }
    if (is_last) break;
  }
  EXPECT_EQ(seconds.size(), 300u);
  const RunResult again = run_program({"farm", "resume", many.out, "--json", "-"});
  EXPECT_EQ(again.code, 0) << again.err;
  EXPECT_EQ(json::parse(again.out).at("done"), 300);
}

TEST(FarmProgram, EndsInOrderOnASignal) {
  const Many many(100'000);
  auto farm = start_program({"farm", many.study, "--out", many.out, "--quiet"});
  ASSERT_TRUE(within_patience([&] {
    return fs::exists(many.out / "farm.db") && run_program({"farm", "status", many.out}).code == 0;
  }));
  farm.signal(SIGTERM);
  const RunResult ended = farm.wait();
  EXPECT_EQ(ended.code, 128 + SIGTERM);
  EXPECT_THAT(ended.err, HasSubstr("continue with: cotwin farm resume " + many.out.string()));
}

TEST(FarmProgram, RefusesToMixRunsOfChangedFiles) {
  const Many many(3);
  ASSERT_EQ(run_program({"farm", many.study, "--out", many.out, "--quiet"}).code, 0);
  const auto resumed = [&] { return run_program({"farm", "resume", many.out}); };
  EXPECT_EQ(resumed().code, 0);
  const std::string study = content(many.study), scenario = content(many.folder / "arm.ssd");
  std::string changed = study;
  changed.replace(changed.find("5000"), 4, "6000");
  many.folder.write("many.json", changed);
  const RunResult other_study = resumed();
  EXPECT_EQ(other_study.code, 2);
  EXPECT_THAT(other_study.err, HasSubstr("cannot be resumed, its runs would not belong together: vary is "));
  many.folder.write("many.json", study);
  changed = scenario;
  changed.replace(changed.find("tick=\"1 ms\""), 11, "tick=\"2 ms\"");
  many.folder.write("arm.ssd", changed);
  const RunResult other_scenario = resumed();
  EXPECT_EQ(other_scenario.code, 2);
  EXPECT_THAT(other_scenario.err, HasSubstr("the scenario is "));
  many.folder.write("arm.ssd", scenario);
  EXPECT_EQ(resumed().code, 0);
  const RunResult begun = run_program({"farm", many.study, "--out", many.out});
  EXPECT_EQ(begun.code, 2);
  EXPECT_THAT(begun.err, HasSubstr("has a study already"));
}

TEST(FarmProgram, NoticesARobotThatHasChanged) {
  const TemporaryFolder folder("farm");
  const fs::path examples = fs::path(cotwin::places::source()) / "examples";
  fs::copy(examples / "04_peg_in_hole/lwr4_peg.urdf", folder / "robot.urdf");
  const fs::path free = examples / "02_free_motion_lwr4/twin.ssd";
  const RunResult made =
      run_program({"farm", free, "--set", "robot=" + (folder / "robot.urdf").string(), "--vary", "drive.K[1]=9000:11000",
                   "--runs", "2", "--stop", "0.01", "--out", folder / "out", "--quiet"});
  ASSERT_EQ(made.code, 0) << made.err;
  ASSERT_EQ(run_program({"farm", "resume", folder / "out", "--quiet"}).code, 0);
  std::string urdf = content(folder / "robot.urdf");
  urdf.replace(urdf.find("mass value=\"") + 12, 1, "3");
  folder.write("robot.urdf", urdf);
  const RunResult resumed = run_program({"farm", "resume", folder / "out"});
  EXPECT_EQ(resumed.code, 2);
  EXPECT_THAT(resumed.err, HasSubstr("the models is "));
}

TEST(FarmProgram, EndsOnAFullDiskAndGoesOnAfterwards) {
  const Many many(400);
  cotwin::testing::RunOptions options;
  options.prepare = [] {
    const rlimit limit{60'000, 60'000};  // bytes of a file: as on a full disk, a write fails
    return setrlimit(RLIMIT_FSIZE, &limit) == 0;
  };
  const RunResult full = run_program({"farm", many.study, "--out", many.out, "--quiet"}, options);
  EXPECT_EQ(full.code, 2) << full.err;
  EXPECT_THAT(full.err, HasSubstr("farm.db"));
  const std::size_t kept = exported(many.out)["run"].size();
  EXPECT_LT(kept, 400u);
  const RunResult resumed = run_program({"farm", "resume", many.out, "--quiet"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(exported(many.out)["run"].size(), 400u);
}

TEST(FarmProgram, TellsWhatAStudyNeedsBeforeItBegins) {
  const Many many(10'000'000);
  const RunResult told = run_program({"farm", many.study, "--dry-run", "--threads", "2"});
  EXPECT_EQ(told.code, 0) << told.err;
  EXPECT_THAT(told.out, HasSubstr("many: 10000000 runs of "));
  EXPECT_THAT(told.out, HasSubstr("on 2 threads; disk "));
  EXPECT_THAT(told.out, HasSubstr("a twin\n  kept: end compliance.Delta[1], peak compliance.tau_e[1]\n"));
  EXPECT_FALSE(fs::exists(many.out));
}

TEST(FarmProgram, RefusesBadInput) {
  const Many many(3, R"(, "keep": [])");
  const auto says = [&](std::vector<std::string> arguments, const std::string& what) {
    arguments.insert(arguments.begin(), "farm");
    const RunResult result = run_program(arguments);
    EXPECT_EQ(result.code, 2) << what;
    EXPECT_THAT(result.err, HasSubstr(what));
  };
  says({many.study}, "has the member 'keep' twice");
  says({}, "FILE");
  says({many.folder / "none.json"}, "none.json");
  says({kArm, "--runs", "3"}, "/vary: is missing");
  says({kArm, "--vary", "x", "--runs", "3"}, "--vary x: expected NAME=LOW:HIGH");
  says({kArm, "--vary", "compliance.S_a[9]=0:1", "--runs", "3"}, "S_a");
  says({"status", many.folder.path()}, "has no study");
  says({"resume", many.folder / "none"}, "has no study");
  const fs::path live = fs::path(cotwin::places::source()) / "examples/04_peg_in_hole/over_fri_twin.ssd";
  says({live, "--vary", "twin.K[1]=9000:11000", "--runs", "3"}, "reaches a robot, a bus or a network");
  ASSERT_EQ(run_program({"farm", kArm, "--vary", "compliance.S_a[1]=50:60", "--runs", "2", "--stop", "0.01", "--out", many.out,
                         "--quiet"})
                .code,
            0);
  says({"repeat", many.out, "3"}, "RUN: 3, expected 1 to 2");
}

TEST(FarmProgram, IsCancelledFromElsewhere) {
  const Many many(100'000);
  auto farm = start_program({"farm", many.study, "--out", many.out, "--quiet"});
  ASSERT_TRUE(within_patience([&] {
    return fs::exists(many.out / "farm.db") && run_program({"farm", "status", many.out}).code == 0;
  }));
  const RunResult cancelled = run_program({"farm", "cancel", many.out});
  EXPECT_EQ(cancelled.code, 0) << cancelled.err;
  EXPECT_THAT(cancelled.out, HasSubstr("continue with: cotwin farm resume " + many.out.string()));
  const RunResult ended = farm.wait();
  EXPECT_EQ(ended.code, 128 + SIGTERM);
  EXPECT_THAT(ended.err, HasSubstr("stopped by cotwin farm cancel; continue with: cotwin farm resume"));
  EXPECT_FALSE(fs::exists(many.out / "cancel"));
  EXPECT_EQ(run_program({"farm", "cancel", many.out}).code, 0) << "nothing runs";
  const RunResult none = run_program({"farm", "cancel", many.folder / "nothing"});
  EXPECT_EQ(none.code, 2);
  EXPECT_THAT(none.err, HasSubstr("has no study"));
  EXPECT_FALSE(fs::exists(many.folder / "nothing"));
}

/// Programs of Slurm in place of it: jobs run at once, on nodes n0 to n2 by their number, and squeue knows none.
struct Queue {
  TemporaryFolder folder{"queue"};
  cotwin::testing::RunOptions options;
  Queue() {
    write("sbatch",
          R"(for word; do case $word in --array=0-*) last=${word#--array=0-} ;; --output=*) log=${word#--output=} ;; esac; done
script=$(mktemp) && cat >"$script"
for k in $(seq 0 "$last"); do SLURM_ARRAY_TASK_ID=$k SLURMD_NODENAME=n$((k % 3)) sh "$script" >/dev/null 2>"$script.$k" & done
echo "$log" >"$0.log"; echo 1
)");
    write("squeue", "");
    write("scancel", "");
    write("sinfo", "echo 1/1/0/2\n");
    write("scontrol", "echo 'MaxArraySize = 5'\n");
    options.environment = {"PATH=" + folder.path().string() + ":" + std::getenv("PATH")};
  }
  void write(const std::string& name, const std::string& script) const {
    fs::permissions(folder.write(name, "#!/bin/sh\n" + script), fs::perms::owner_all);
  }
};

TEST(FarmProgram, MakesTheSameRunsAsJobsOfSlurm) {
  const Many many(90, R"(, "name": "many runs, 100 % of them")");
  ASSERT_EQ(run_program({"farm", many.study, "--out", many.out, "--quiet"}).code, 0);
  const Queue queue;
  const fs::path out = many.folder / "it's a % folder";
  const RunResult made =
      run_program({"farm", many.study, "--out", out, "--on", "slurm", "--threads", "2", "--json", "-"}, queue.options);
  ASSERT_EQ(made.code, 0) << made.err;
  EXPECT_EQ(json::parse(made.out).at("done"), 90);
  auto expected = exported(many.out), found = exported(out);
  for (const char* column : {"seconds", "session"}) {
    expected.erase(column);
    found.erase(column);
  }
  EXPECT_EQ(found, expected);
  EXPECT_THAT(content(queue.folder / "sbatch.log"), HasSubstr("it's a %% folder/chunks/many_runs__100___of_them-"));
  const fs::path none = many.folder / "none";
  EXPECT_EQ(run_program({"farm", many.study, "--out", none, "--partition", "night"}).code, 2) << "of what?";
  queue.write("sinfo", "");
  const RunResult lacking =
      run_program({"farm", many.study, "--out", none, "--on", "slurm", "--partition", "night"}, queue.options);
  EXPECT_EQ(lacking.code, 2);
  EXPECT_THAT(lacking.err, HasSubstr("sinfo: knows no partition 'night'"));
  const RunResult missing =
      run_program({"farm", many.study, "--out", none, "--on", "slurm"}, {.environment = {"PATH=/nowhere"}});
  EXPECT_EQ(missing.code, 2);
  EXPECT_THAT(missing.err, HasSubstr("is not installed, expected the programs of Slurm (Debian: slurm-client)"));
  EXPECT_FALSE(fs::exists(none));
}

TEST(FarmProgram, RefusesChunksThatWouldNotBelongToTheOthers) {
  const Many many(90);
  const Queue queue;
  queue.write("sbatch", "exit 0\n");  // takes the chunks, and nobody makes them
  auto farm = start_program({"farm", many.study, "--out", many.out, "--on", "slurm"}, queue.options);
  const fs::path chunks = many.out / "chunks";
  const auto batches = [&] {
    std::vector<fs::path> files;
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(chunks, none)) {
      if (entry.path().extension() == ".json") files.push_back(entry.path());
    }
    return files;
  };
  ASSERT_TRUE(within_patience([&] { return !batches().empty(); }));
  farm.signal(SIGKILL);
  farm.wait();
  const fs::path batch = batches().at(0);
  const RunResult elsewhere = run_program({"farm", "resume", many.out});
  EXPECT_EQ(elsewhere.code, 2);
  EXPECT_THAT(elsewhere.err,
              HasSubstr("has chunks in Slurm, expected --on slurm, or first: cotwin farm cancel " + many.out.string()));

  EXPECT_EQ(run_program({"farm", "chunk", batch, "1000"}).code, 2);
  const fs::path refusal = chunks / (batch.stem().string() + "_0.refused");
  EXPECT_FALSE(fs::exists(refusal));
  const RunResult other =
      run_program({"farm", "chunk", batch, "0"}, {.environment = {"COTWIN_CPU=x86-64-v2", "SLURMD_NODENAME=n7"}});
  if (other.code != 0) {  // a machine with no other instruction set makes the chunk
    EXPECT_THAT(content(refusal),
                HasSubstr("n7\nits runs would not belong to the others: the instruction set is x86-64-v2, was "));
  }
  fs::remove(refusal);
  fs::remove(many.folder / "arm.ssd");
  EXPECT_EQ(run_program({"farm", "chunk", batch, "0"}, {.environment = {"SLURMD_NODENAME=n7"}}).code, 2);
  EXPECT_THAT(content(refusal), HasSubstr("arm.ssd"));
  fs::copy(kArm, many.folder / "arm.ssd");
  const RunResult chunk = run_program({"farm", "chunk", batch, "0"});
  ASSERT_EQ(chunk.code, 0) << chunk.err;
  EXPECT_EQ(run_program({"farm", "cancel", many.out}, queue.options).code, 0);
  const RunResult resumed = run_program({"farm", "resume", many.out, "--json", "-"});
  EXPECT_EQ(resumed.code, 0) << resumed.err;
  EXPECT_EQ(json::parse(resumed.out).at("done"), 90);
  auto all = exported(many.out);
  EXPECT_EQ(std::set(all["session"].begin(), all["session"].end()).size(), 2u)
      << "the runs of the sample and of the chunk are used";
}

}  // namespace
}  // namespace farm_program_test
