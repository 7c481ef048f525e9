// The whole twin of example 02 (20 s at 1 ms, recorded as its scenario says) on one thread: its cost per simulated millisecond,
// and the share of each part. And the fixed cell and the free twins of example 24, with latches and contacts;
// the robots of example 25, which a monitor slows; what a motion costs that can be slowed, and what view.bin costs.
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <optional>
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

/// `view_data`: whether view.bin is written; then only the first 3 s are run.
master::Summary run_once(const fs::path& results, const char* scenario = "02_free_motion_lwr4/twin.ssd",
                         std::optional<bool> view_data = {}) {
  master::MasterOptions options;
  options.types = unit_types();
  const fs::path file = fs::path(cotwin::places::source()) / "examples" / scenario;
  options.folders = {file.parent_path(), fs::path(cotwin::places::source()) / "models"};
  options.results = results;
  options.threads = 1;
  master::Scenario loaded = master::load_scenario(file);
  if (view_data) loaded.stop = Time::from_seconds(3);
  options.view_data = view_data.value_or(false);
  master::Master master(std::move(loaded), std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  return master.summary();
}

double process_seconds() { return benchmark::seconds_of(CLOCK_PROCESS_CPUTIME_ID); }

void print(const std::string& name, double us, double goal) {
  benchmark::print({"whole twin (example 02), " + name + ", per simulated ms", "us", us, "real time", kRealTime, goal, true});
}

/// What `override=true` adds to a step of a motion of 7 joints at varying speed, s.
double override_seconds() {
  const auto motion = [](const char* source) {
    Instance unit = make_unit(source, {}, {cotwin::places::source() + "/models"}, unit_types());
    assign_text(unit.variables.at("waypoint_t"), "0 2");
    assign_text(unit.variables.at("waypoint_q"), "-2 -0.5 0 1.5 0 -1.1 0  -0.4 -0.9 0 1.1 0 -1.1 0");
    assign_text(unit.variables.at("loop"), "there_and_back");
    unit.unit->initialise(Time{});
    return unit;
  };
  Instance planned = motion("unit:motion?robot=lwr4&points=2"),
           slowed = motion("unit:motion?robot=lwr4&points=2&override=true");
  const Duration h{1'000'000};
  Time t, t_slowed;
  double& speed = slowed.variables.at("speed").reals()[0];
  int k = 0;
  const auto step = [h](Instance& unit, Time& at) {
    benchmark::keep(unit.unit->step(at, h));
    at = at + h;
  };
  const benchmark::Figures found = benchmark::measure(
      [&] {
        speed = 0.01 * (k = (k + 37) % 101);
        step(slowed, t_slowed);
      },
      [&] { step(planned, t); });
  return found.ours - found.peer;
}

}  // namespace

int main() try {
  const fs::path results = fs::temp_directory_path() / "cotwin_benchmark_twin";
  std::vector<master::Summary> runs;
  for (int i = 0; i < benchmark::shortened(7, 1); ++i) runs.push_back(run_once(results));
  const master::Summary servicing = run_once(results, "24_satellite_servicing/servicing.ssd");
  const master::Summary cell = run_once(results, "25_shared_cell/cell.ssd");
  const auto cooperation = [&](bool view_data) { run_once(results, "10_cooperation/carrying.ssd", view_data); };
  const benchmark::Figures shown =
      benchmark::measure([&] { cooperation(true); }, [&] { cooperation(false); }, 31, 0, process_seconds);
  fs::remove_all(results);
  std::sort(runs.begin(), runs.end(), [](const auto& a, const auto& b) { return a.wall_seconds < b.wall_seconds; });
  const master::Summary& median = runs[runs.size() / 2];
  const double us = kRealTime / median.real_time_factor;
  print("all", us, 0.05);  // at least 20 times real time
  for (const auto& unit : median.units) print(unit.name, unit.share * us, 0);
  print("exchange, checks and recording", (median.exchange_share + median.check_share + median.observe_share) * us, 0);
  benchmark::print({"fixed cell and free twins (example 24), per simulated ms", "us", kRealTime / servicing.real_time_factor,
                    "real time", kRealTime, 1.0 / 3, true});
  benchmark::print({"two robots, a person and a monitor that slows them (example 25), per simulated ms", "us",
                    kRealTime / cell.real_time_factor, "real time", kRealTime, 0.2, true});
  benchmark::print(
      {"slowing a motion of 7 joints along its path, a step", "ns", 1e9 * override_seconds(), "none", 0, 50, false});
  benchmark::print({"3 s of example 10 with view.bin, processor time of all threads", "ms", 1e3 * shown.ours, "without",
                    1e3 * shown.peer, 1.01, true});
} catch (const std::exception& error) {
  std::fprintf(stderr, "twin: %s\n", error.what());
  return 1;
}
