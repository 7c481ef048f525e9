// Studies: what a run costs beside `cotwin run`, what a second core gains, and a question to a million rows.
#include <cstdint>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "components/services/json/json.h"
#include "components/services/json/request.h"
#include "components/unit/unit_table.h"
#include "master/farm/farm.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace {

using namespace cotwin;
using namespace cotwin::master;
using cotwin::testing::TemporaryFolder;

const std::filesystem::path kScenario = std::filesystem::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd";
const FarmHooks kHooks{[] { return false; }, [](std::int64_t, std::int64_t, const std::string&) {}};

Farm farm_of(int runs, double stop) {
  nlohmann::ordered_json study{{"scenario", kScenario.string()}, {"runs", runs}, {"stop_s", stop}};
  study["vary"]["drive.K[1]"]["uniform"] = {9000, 11000};
  return Farm(read_study(study, "study.json", "/"), unit_types());
}

struct Cost {
  double wall = 0, processor = 0;  // s
};

Cost run(const Farm& farm, int threads) {
  const TemporaryFolder folder("farm");
  Registry registry(folder.path(), {{"study", ""}}, {"drive.K[1]"}, farm.figures());
  const double wall = benchmark::wall_seconds(), processor = benchmark::seconds_of(CLOCK_PROCESS_CPUTIME_ID);
  farm.fill(registry, threads, kHooks);
  return {benchmark::wall_seconds() - wall, benchmark::seconds_of(CLOCK_PROCESS_CPUTIME_ID) - processor};
}

void starts() {
  const int runs = benchmark::shortened(1000, 2), programs = benchmark::shortened(40, 1);
  const TemporaryFolder folder("farm");
  double peer = 0;
  for (int i = 0; i < programs; ++i) {
    const auto ran = testing::run_program({"run", kScenario, "--stop", "0.1", "--set", "drive.K[1]=" + std::to_string(9000 + i),
                                           "--out", folder / "out", "--overwrite", "--quiet"});
    if (ran.code != 0) std::fprintf(stderr, "%s", ran.err.c_str());
    peer += ran.cpu;
  }
  const Cost ours = run(farm_of(runs, 0.1), 1);
  benchmark::print({"0.1 s of example 02, processor time of a run", "ms", ours.processor / runs * 1e3, "cotwin run",
                    peer / programs * 1e3, 0.05, true});
}

void second_core() {
  const Farm farm = farm_of(benchmark::shortened(400, 4), benchmark::shortened(0.5, 0.01));
  const double one = run(farm, 1).wall, two = run(farm, 2).wall;
  benchmark::print({"400 runs of 0.5 s of example 02 on two threads", "s", two, "one thread", one, 1 / 1.9, true});
}

void question() {
  const std::int64_t runs = benchmark::shortened(1'000'000, 100);
  const TemporaryFolder folder("farm");
  std::vector<std::string> names;
  for (int i = 0; i < 10; ++i) names.push_back("peak x" + std::to_string(i));
  Registry registry(folder.path(), {{"study", ""}}, {"a", "b", "c"}, names);
  const std::int64_t session = registry.begin_session(this_process(1));
  std::vector<RunRow> rows;
  for (std::int64_t run = 1; run <= runs; ++run) {
    RunRow row;
    row.run = run;
    row.values = {"0.1", "0.2", "0.3"};
    row.success = run % 3 == 0;
    row.figures.assign(10, 1.0 / static_cast<double>(run));
    rows.push_back(std::move(row));
    if (rows.size() < 10'000 && run < runs) continue;
    registry.add(rows, session);
    rows.clear();
  }
  const double begin = benchmark::wall_seconds();
  const Registry::Totals totals = registry.totals();
  const double seconds = benchmark::wall_seconds() - begin;
  if (totals.done != runs) std::fprintf(stderr, "rows are missing\n");
  benchmark::print({"successes, failures and time of 1e6 runs", "s", seconds, "", 0, 0.2, false});
}

}  // namespace

int main() {
  starts();
  second_core();
  question();
}
