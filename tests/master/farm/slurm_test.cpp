// Runs of a study on Slurm, whose programs are small scripts here and whose nodes are played by the test: lost, refused, damaged, repeated
// and foreign chunks, a controller that does not answer, and what the coordinator tells. A real Slurm: cluster_test.cpp.
#include "master/farm/slurm.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <optional>
#include <set>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "components/services/json/json.h"
#include "tests/master/farm/trial.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"

namespace cotwin::master::slurm_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::columns;
using cotwin::testing::content;
using cotwin::testing::error_of;
using cotwin::testing::hooks;
using cotwin::testing::kBuild;
using cotwin::testing::TemporaryFolder;
using cotwin::testing::Trial;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

const auto kNever = [] { return false; };

/// The programs of Slurm. They answer what the files `refuses` (sbatch), `down` (all), `queue` (squeue), `most` (scontrol) say.
class Programs {
 public:
  Programs() : path_(std::getenv("PATH")) {
    const std::string here = folder.path().string();
    const std::string begin =
        "#!/bin/sh\ncd '" + here +
        "'\nif [ -e down ]; then echo \"${0##*/}: error: Unable to contact slurm controller\" >&2; exit 1; fi\n";
    program("sbatch", begin +
                          "if [ -e refuses ]; then echo \"sbatch: error: $(cat refuses)\" >&2; exit 1; fi\n"
                          "printf '%s\\n' \"$@\" >>sbatch.arguments; cat >sbatch.script; echo 7\n");
    program("squeue", begin + "if [ -e queue ]; then cat queue; fi\n");
    program("sinfo", begin + "[ ! -e busy ] || { echo 'Socket error' >&2; exit 1; }\necho 2/2/3/7\n");
    program("scontrol", begin + "echo 'MaxArraySize            = '$(cat most || echo 1001)\n");
    program("scancel", begin + "echo \"$@\" >>scancel.arguments\n");
    setenv("PATH", (here + ":" + path_).c_str(), 1);
  }
  ~Programs() { setenv("PATH", path_.c_str(), 1); }
  void forget(const std::string& file) const { fs::remove(folder / file); }
  std::string arguments(const std::string& of) const { return content(folder / (of + ".arguments")); }

  TemporaryFolder folder{"slurm"};

 private:
  void program(const std::string& name, const std::string& script) const {
    fs::permissions(folder.write(name, script), fs::perms::owner_all);
  }
  std::string path_;
};

/// A study on a cluster, whose nodes do with each chunk what `node` does, when it is sent.
struct Cluster {
  Programs programs;
  Trial trial;
  Farm farm = trial.farm();
  Registry registry = trial.begin(farm);
  Facts facts = farm.facts(kBuild);
  SlurmOptions options;
  fs::path chunks = trial.out() / kChunksFolder;
  std::function<void(const Batch&, std::size_t)> node = [this](const Batch& batch, std::size_t k) { make(batch, k); };
  std::function<void()> each_time = [] {};
  std::function<bool()> stops = kNever;
  std::vector<std::string> told;
  std::vector<Chunk> sent;
  std::set<std::pair<std::string, std::size_t>> seen;

  explicit Cluster(const std::string& members = R"("runs": 60, "vary": {"map.start": {"uniform": [0.1, 0.9]}},
    "keep": ["end map.y", "figures"])")
      : trial(members) {
    options.program = "/opt/cotwin";
    options.look = options.ask = std::chrono::milliseconds(1);
    options.grace = std::chrono::milliseconds(20);
    options.patience = std::chrono::minutes(5);
  }

  void make(const Batch& batch, std::size_t k, const std::function<bool()>& until = kNever) const {
    make_chunk(farm, batch, k, chunks, until);
  }
  void play() {
    for (const fs::path& file : files_of_batches(chunks)) {
      if (file.stem() == "torn") continue;
      const Batch batch = read_batch(file);
      for (std::size_t k = 0; k < batch.chunks.size(); ++k) {
        if (!seen.emplace(batch.name, k).second) continue;
        sent.push_back(batch.chunks[k]);
        node(batch, k);
      }
    }
    each_time();
  }
  bool fill() {
    return fill_on_slurm(farm, facts, registry, trial.out(), options,
                         {stops, [this](std::int64_t, std::int64_t, const std::string&) { play(); }},
                         [this](const std::string& what) { told.push_back(what); });
  }
  /// The registry of the same study on threads.
  std::map<std::string, std::vector<std::string>> on_threads() const {
    const Trial other("\"runs\": 1, \"vary\": {\"map.start\": {\"uniform\": [0, 1]}}");
    std::vector<std::string> factors;
    for (const Factor& factor : trial.study.design.factors) factors.push_back(factor.name);
    Registry made(other.out(), farm.facts(kBuild), factors, farm.figures());
    EXPECT_TRUE(farm.fill(made, 2, hooks()));
    return columns(made);
  }
  void expect_complete() {
    EXPECT_EQ(columns(registry), on_threads());
    EXPECT_FALSE(fs::exists(chunks));
  }
};

std::int64_t runs_of(const std::vector<Chunk>& chunks) {
  std::int64_t all = 0;
  for (const Chunk& chunk : chunks) {
    for (const auto& [first, last] : chunk.ranges) all += last - first + 1;
  }
  return all;
}

TEST(Slurm, GivesTheRegistryOfThreads) {
  Cluster cluster(R"("runs": 60, "vary": {"map.start": {"uniform": [0.1, 0.9]}, "gear.after": {"uniform": [0, 0.1]}}, "set": [],
    "keep": ["end map.y", "figures"], "success": "end map.y>0.3")");
  cluster.options.partition = "night";
  cluster.options.threads = 2;
  cluster.options.environment = {{"COTWIN_MODELS", "it's"}};
  cluster.registry.add(cluster.farm.sample(kNever), cluster.registry.begin_session({"here", 1, 1}));
  cluster.programs.folder.write("most", "3");
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_EQ(cluster.sent.size(), 1u) << "brief runs are one chunk";
  EXPECT_EQ(runs_of(cluster.sent), 57);
  EXPECT_THAT(cluster.sent[0].ranges, ElementsAre(std::pair(2, 29), std::pair(31, 59)));
  EXPECT_THAT(cluster.told, IsEmpty());
  EXPECT_THAT(cluster.programs.arguments("sbatch"),
              AllOf(HasSubstr("--partition=night\n"), HasSubstr("--array=0-0\n"), HasSubstr("--cpus-per-task=2\n"),
                    HasSubstr("--no-requeue\n"), Not(HasSubstr("--exclude"))));
  EXPECT_THAT(content(cluster.programs.folder / "sbatch.script"),
              AllOf(HasSubstr("export COTWIN_MODELS='it'\\''s'\n"), HasSubstr("export COTWIN_CPU='test'\n"),
                    HasSubstr("exec '/opt/cotwin' farm chunk ")));
}

TEST(Slurm, SendsNoMoreChunksThanAnArrayMayHave) {
  Cluster cluster;
  std::vector<RunRow> rows = {cluster.farm.run(1, kNever)};
  rows[0].seconds = 10;  // so that three runs are a chunk
  cluster.registry.add(rows, 1);
  cluster.programs.folder.write("most", "7");
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_EQ(cluster.sent.size(), 20u);
  const std::string arguments = cluster.programs.arguments("sbatch");
  EXPECT_THAT(arguments, AllOf(HasSubstr("--array=0-6\n"), HasSubstr("--array=0-5\n"), Not(HasSubstr("--array=0-7\n"))));
}

TEST(Slurm, SizesChunksByTheCostOfARun) {
  EXPECT_EQ(runs_of_chunk(1, 100'000, 100, 1), 250);      // a quarter of the 1000 s that 100 processors need
  EXPECT_EQ(runs_of_chunk(1, 1'000'000, 100, 1), 600);    // at most 10 min
  EXPECT_EQ(runs_of_chunk(0.1, 1000, 100, 1), 50);        // at least 5 s
  EXPECT_EQ(runs_of_chunk(3600, 1000, 100, 1), 1);        // at least one run
  EXPECT_EQ(runs_of_chunk(3600, 1000, 100, 8), 8);        // for each thread
  EXPECT_EQ(runs_of_chunk(1, 100'000, 128, 64), 12'500);  // a quarter of 781 s, by 64 threads
  EXPECT_EQ(runs_of_chunk(0, 1000, 100, 1), 1000);
  EXPECT_EQ(runs_of_chunk(1e-9, 10, 100, 1), 10);
}

TEST(Slurm, SendsLostChunksAgainAndTellsWhatIsMissing) {
  for (const int losses : {1, 2, 3}) {
    Cluster cluster;
    cluster.node = [&](const Batch& batch, std::size_t k) {
      if (batch.chunks[k].attempt > losses) return cluster.make(batch, k);
      cluster.programs.folder.write("queue", batch.name + "|" + std::to_string(k) + "|TIMEOUT|n4|None\n");
      std::ofstream(cluster.chunks / (batch.name + "_" + std::to_string(k) + ".log")) << "first\nkilled in the night\n\n";
    };
    EXPECT_EQ(cluster.fill(), losses < 3);
    ASSERT_EQ(cluster.told.size(), losses < 3 ? static_cast<std::size_t>(losses) : 4u);
    EXPECT_EQ(cluster.told[0], "runs are sent again, they were lost, TIMEOUT on n4, killed in the night: 1 to 60");
    if (losses < 3) {
      cluster.expect_complete();
    } else {
      EXPECT_THAT(cluster.told[2], HasSubstr("runs are given up, they were lost, TIMEOUT on n4"));
      EXPECT_THAT(cluster.told.back(), HasSubstr("60 runs are missing: 1 to 60; what their chunks printed is in"));
      EXPECT_THAT(files_of_batches(cluster.chunks), IsEmpty());
      EXPECT_EQ(cluster.sent.size(), 3u);
      cluster.node = [&](const Batch& batch, std::size_t k) { cluster.make(batch, k); };
      EXPECT_TRUE(cluster.fill()) << "resumed";
      cluster.expect_complete();
    }
  }
}

TEST(Slurm, KeepsWhatALostChunkSentAndGoesOn) {
  Cluster cluster;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    int asked = 0;
    cluster.make(batch, k, [&] { return ++asked > 150; });  // some three runs of 50 steps
  };
  EXPECT_TRUE(cluster.fill()) << "though more than three chunks are lost, because each made some";
  cluster.expect_complete();
  EXPECT_GT(cluster.sent.size(), 5u);
  EXPECT_THAT(cluster.told.at(0), HasSubstr("runs are sent again, "));
}

TEST(Slurm, WaitsNotForAChunkThatIsCompletingForEver) {
  Cluster cluster;
  std::string queue;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    if (batch.chunks[k].attempt == 2) return cluster.make(batch, k);
    cluster.programs.folder.write("queue", batch.name + "|" + std::to_string(k) + "|COMPLETING|n1|None\n");
  };
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_THAT(cluster.told, ElementsAre(HasSubstr("they were lost, COMPLETING on n1")));
  EXPECT_THAT(cluster.programs.arguments("scancel"), HasSubstr("--name=study-")) << "it may still run";
}

TEST(Slurm, WaitsForAChunkThatRuns) {
  Cluster cluster;
  cluster.options.grace = std::chrono::milliseconds(2);
  std::optional<std::pair<Batch, std::size_t>> held;
  int looks = 0;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    held.emplace(batch, k);
    cluster.programs.folder.write("queue", batch.name + "|" + std::to_string(k) + "|RUNNING|n1|None\n");
  };
  cluster.each_time = [&] {
    if (held && ++looks == 40) cluster.make(held->first, held->second);  // much later than `grace`
  };
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_EQ(cluster.sent.size(), 1u);
  EXPECT_THAT(cluster.told, IsEmpty());
}

TEST(Slurm, CountsARunOnceHoweverOftenItComes) {
  Cluster cluster;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    cluster.make(batch, k);
    fs::copy(cluster.chunks / (batch.name + "_0_0.rows"), cluster.chunks / "again.rows");
    std::string twice = content(cluster.chunks / "again.rows");  // and twice in a part
    const std::size_t rows = twice.find("\"rows\":[") + 8, end = twice.rfind(']');
    twice.insert(end, "," + twice.substr(rows, end - rows));
    std::ofstream(cluster.chunks / "twice.rows") << twice;
  };
  EXPECT_TRUE(cluster.fill());
  EXPECT_THAT(cluster.told, IsEmpty());
  cluster.expect_complete();
}

TEST(Slurm, UsesNoDamagedPart) {
  Cluster cluster;
  const Batch batch{"b", 1, cluster.facts, {{{{1, 2}}, 1}}};
  fs::create_directories(cluster.chunks);
  make_chunk(cluster.farm, batch, 0, cluster.chunks, kNever);
  const std::string whole = content(cluster.chunks / "b_0_0.rows");
  const Part part = read_part(whole, cluster.farm, cluster.facts);
  ASSERT_EQ(part.rows.size(), 2u);
  EXPECT_EQ(part.rows[1].figures, cluster.farm.run(2, kNever).figures);
  int refused = 0, read = 0;
  const auto attempt = [&](const std::string& damaged) {
    try {
      for (const RunRow& row : read_part(damaged, cluster.farm, cluster.facts).rows) {
        EXPECT_TRUE(row.run >= 1 && row.run <= 60) << damaged;
        EXPECT_EQ(row.figures.size(), row.failure.empty() ? cluster.farm.figures().size() : 0) << damaged;
        EXPECT_EQ(row.values, cluster.trial.study.design.point(row.run));
      }
      ++read;
    } catch (const services::RequestError&) {
      ++refused;
    }
  };
  for (std::size_t size = 0; size + 2 < whole.size(); ++size) attempt(whole.substr(0, size));
  EXPECT_EQ(read, 0) << "none that ends early is read";
  for (std::size_t at = 0; at < whole.size(); ++at) {
    for (const char c : {'\0', '9', '-', '"', '}', '[', 'e', '\xff'}) attempt(std::string(whole).replace(at, 1, 1, c));
  }
  EXPECT_GT(read, 0);
  EXPECT_GT(refused, 1000);
  // The coordinator tells of one, and sends its runs again.
  std::ofstream(cluster.chunks / "b_0_0.rows") << whole.substr(0, whole.size() / 2);
  std::ofstream(cluster.chunks / "other.rows") << std::string(whole).replace(whole.find(":\"") + 2, 1, "x");
  std::ofstream(cluster.chunks / "torn.json") << "{\"threads\": 1, \"chunks\": [{\"attempt\": 1, \"runs\": [[5, 4]]}]}";
  EXPECT_TRUE(cluster.fill());
  EXPECT_THAT(cluster.told,
              ElementsAre(HasSubstr("torn.json: /facts: is missing; its runs are sent again"),
                          AllOf(HasSubstr("b_0_0.rows is not used: "), HasSubstr("JSON")),
                          HasSubstr("other.rows is not used: /study: is another one, expected runs of this study")));
  cluster.expect_complete();
}

TEST(Slurm, LeavesOutANodeThatCannotMakeRuns) {
  Cluster cluster;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    if (cluster.sent.size() > 1) return cluster.make(batch, k);
    std::ofstream(cluster.chunks / (batch.name + "_" + std::to_string(k) + ".refused")) << "n3\ncotwin: not found\n";
  };
  cluster.options.grace = std::chrono::hours(1);  // a refusal is known at once
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_THAT(cluster.told, ElementsAre("runs are sent again, the node n3 cannot make them, cotwin: not found: 1 to 60"));
  EXPECT_THAT(cluster.programs.arguments("sbatch"), HasSubstr("--exclude=n3\n"));
}

TEST(Slurm, GivesUpWhereNoNodeIsLeft) {
  Cluster cluster;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    setenv("SLURMD_NODENAME", "n1", 1);
    refuse_chunk(batch, k, cluster.chunks, "another program");
    unsetenv("SLURMD_NODENAME");
    cluster.programs.folder.write("refuses", "Requested node configuration is not available");
  };
  EXPECT_FALSE(cluster.fill());
  EXPECT_THAT(cluster.told,
              ElementsAre(HasSubstr("the node n1 cannot make them, another program"),
                          "sbatch: Requested node configuration is not available", HasSubstr("60 runs are missing: 1 to 60")));
}

TEST(Slurm, GoesOnWhenTheControllerIsBack) {
  Cluster cluster;
  int looks = 0;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    int asked = 0;
    cluster.make(batch, k, [&] { return batch.chunks[k].ranges.front().first == 1 && ++asked > 150; });
    if (cluster.sent.size() == 1) cluster.programs.folder.write("down", "");
  };
  cluster.each_time = [&] {
    if (++looks == 50) cluster.programs.forget("down");
  };
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_THAT(cluster.told, ElementsAre("squeue: Unable to contact slurm controller", HasSubstr("runs are sent again, ")));
}

TEST(Slurm, SendsLostChunksWhenSlurmAnswersAgain) {
  Cluster cluster;
  int looks = 0;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    if (cluster.sent.size() > 1) return cluster.make(batch, k);
    std::ofstream(cluster.chunks / (batch.name + "_" + std::to_string(k) + ".refused")) << "n3\ncotwin: not found\n";
    cluster.programs.folder.write("busy", "");
  };
  cluster.each_time = [&] {
    if (++looks == 30) cluster.programs.forget("busy");
  };
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_THAT(cluster.told, ElementsAre(HasSubstr("the node n3 cannot make them"), "sinfo: Socket error"));
}

TEST(Slurm, EndsWithAnErrorWhenTheControllerStaysAway) {
  Cluster cluster;
  cluster.options.patience = std::chrono::milliseconds(100);
  cluster.node = [&](const Batch&, std::size_t) { cluster.programs.folder.write("down", ""); };
  EXPECT_EQ(error_of([&] { cluster.fill(); }), "Slurm: has not answered for 0.1 s: squeue: Unable to contact slurm controller");
  EXPECT_THAT(cluster.told.back(), HasSubstr("the chunks in the queue: scancel: Unable to contact slurm controller"));
}

TEST(Slurm, RefusesWhatSlurmRefusesAtFirst) {
  {
    Cluster cluster;
    cluster.programs.folder.write("refuses", "invalid partition specified: day");
    EXPECT_EQ(error_of([&] { cluster.fill(); }), "sbatch: invalid partition specified: day");
    EXPECT_THAT(files_of_batches(cluster.chunks), IsEmpty());
  }
  {
    Cluster cluster;
    cluster.programs.folder.write("most", "0");
    EXPECT_EQ(error_of([&] { cluster.fill(); }), "MaxArraySize: of Slurm is 0, expected job arrays");
  }
  {
    Cluster cluster;
    setenv("PATH", cluster.trial.folder.path().c_str(), 1);
    EXPECT_EQ(error_of([&] { cluster.fill(); }),
              "scontrol: is not installed, expected the programs of Slurm (Debian: slurm-client)");
  }
}

TEST(Slurm, CancelsItsChunksWhenItIsStopped) {
  Cluster cluster;
  bool is_stopped = false;
  std::string name;
  cluster.stops = [&] { return is_stopped; };
  cluster.node = [&](const Batch& batch, std::size_t k) {
    name = batch.name;
    int asked = 0;
    cluster.make(batch, k, [&] { return ++asked > 150; });
    cluster.programs.folder.write("queue", batch.name + "|" + std::to_string(k) + "|CANCELLED|n1|None\n");
    is_stopped = true;
  };
  EXPECT_FALSE(cluster.fill());
  EXPECT_GT(cluster.registry.totals().done, 0) << "what was over by then is kept";
  EXPECT_LT(cluster.registry.totals().done, 60);
  EXPECT_EQ(cluster.programs.arguments("scancel"), "--name=" + name + "\n");
  EXPECT_THAT(files_of_batches(cluster.chunks), IsEmpty());
}

TEST(Slurm, TakesOverTheChunksOfACoordinatorThatWasKilled) {
  Cluster cluster;
  fs::create_directories(cluster.chunks);
  const Batch before{"before", 1, cluster.facts, {{{{1, 20}}, 1}, {{{21, 25}, {30, 30}}, 3}}};
  write_batch(cluster.chunks, before);
  EXPECT_EQ(read_batch(cluster.chunks / "before.json").chunks[1].ranges, before.chunks[1].ranges);
  cluster.programs.folder.write("queue", "before|0|RUNNING|n1|None\nbefore|1|PENDING||Priority\n");
  EXPECT_EQ(chunks_in_slurm(cluster.trial.out()), "1 PENDING (Priority), 1 RUNNING");
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  ASSERT_EQ(cluster.sent.size(), 3u);
  EXPECT_EQ(runs_of(cluster.sent), 60) << "none is sent twice";
  write_batch(cluster.trial.folder.path(), {"left", 1, cluster.facts, {{{{1, 61}}, 1}}});
  EXPECT_THAT(
      error_of([&] { make_chunk(cluster.farm, read_batch(cluster.trial.folder / "left.json"), 0, cluster.chunks, kNever); }),
      HasSubstr("has the run 61, expected 1 to 60"));
}

TEST(Slurm, SendsNothingThatCameAfterAll) {
  Cluster cluster;
  std::optional<std::pair<Batch, std::size_t>> late;
  cluster.node = [&](const Batch& batch, std::size_t k) {
    if (late) return cluster.make(batch, k);
    late.emplace(batch, k);
    cluster.programs.folder.write("busy", "");  // so that the chunk is lost, and not sent again yet
  };
  cluster.each_time = [&] {
    int asked = 0;
    if (!cluster.told.empty() && cluster.registry.totals().done == 0)
      cluster.make(late->first, late->second, [&] { return ++asked > 1000; });
    if (cluster.registry.totals().done > 0) cluster.programs.forget("busy");
  };
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  ASSERT_EQ(cluster.sent.size(), 2u);
  EXPECT_LT(runs_of({cluster.sent[1]}), 50);
}

TEST(Slurm, TakesOverNothingThatIsNotOfItsStudy) {
  Cluster cluster;
  fs::create_directories(cluster.chunks);
  write_batch(cluster.chunks, {"beyond", 1, cluster.facts, {{{{60, 61}}, 1}}});
  Facts others = cluster.facts;
  others.back().second = "other";
  write_batch(cluster.chunks, {"other", 1, others, {{{{1, 60}}, 1}}});
  cluster.seen = {{"beyond", 0}, {"other", 0}};
  EXPECT_TRUE(cluster.fill());
  cluster.expect_complete();
  EXPECT_THAT(cluster.told, ElementsAre(HasSubstr("beyond: has the run 61, expected 1 to 60; its runs are sent again"),
                                        HasSubstr("other.json: is of another study; its runs are sent again")));
}

TEST(Slurm, TellsRangesInOrder) {
  EXPECT_EQ(text_of({}), "");
  EXPECT_EQ(text_of({{7, 9}, {1, 1}, {2, 3}, {10, 10}, {12, 12}}), "1 to 3, 7 to 10, 12");
  Ranges many;
  for (int k = 1; k < 30; ++k) add(many, 2 * k);
  EXPECT_EQ(text_of(many), "2, 4, 6, 8, 10, 12, 14, 16, 18, 20, and others");
}

}  // namespace
}  // namespace cotwin::master::slurm_test
