// The whole twin of example 02 (20 s at 1 ms, recorded as its scenario says) on one thread: its cost per simulated millisecond,
// and the share of each part. And the fixed cell and the free twins of example 24, with latches and contacts.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
namespace fs = std::filesystem;

constexpr double kRealTime = 1000;  // us per simulated ms

master::Summary run_once(const fs::path& results, const char* scenario = "02_free_motion_lwr4/twin.ssd") {
  master::MasterOptions options;
  options.types = unit_types();
  const fs::path file = fs::path(cotwin::places::source()) / "examples" / scenario;
  options.folders = {file.parent_path(), fs::path(cotwin::places::source()) / "models"};
  options.results = results;
  options.threads = 1;
  master::Master master(master::load_scenario(file), std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  return master.summary();
}

void print(const std::string& name, double us, double goal) {
  benchmark::print({"whole twin (example 02), " + name + ", per simulated ms", "us", us, "real time", kRealTime, goal, true});
}

}  // namespace

int main() try {
  const fs::path results = fs::temp_directory_path() / "cotwin_benchmark_twin";
  std::vector<master::Summary> runs;
  for (int i = 0; i < benchmark::shortened(7, 1); ++i) runs.push_back(run_once(results));
  const master::Summary servicing = run_once(results, "24_satellite_servicing/servicing.ssd");
  fs::remove_all(results);
  std::sort(runs.begin(), runs.end(), [](const auto& a, const auto& b) { return a.wall_seconds < b.wall_seconds; });
  const master::Summary& median = runs[runs.size() / 2];
  const double us = kRealTime / median.real_time_factor;
  print("all", us, 0.05);  // at least 20 times real time
  for (const auto& unit : median.units) print(unit.name, unit.share * us, 0);
  print("exchange, checks and recording", (median.exchange_share + median.check_share + median.observe_share) * us, 0);
  benchmark::print({"fixed cell and free twins (example 24), per simulated ms", "us", kRealTime / servicing.real_time_factor,
                    "real time", kRealTime, 1.0 / 3, true});
} catch (const std::exception& error) {
  std::fprintf(stderr, "twin: %s\n", error.what());
  return 1;
}
