// The twin of example 02 on the wall clock at 1 kHz: delay of the start and run time of its ticks, overruns, page faults and
// allocations after the start.
//   real_time [TICKS [PRIORITY [CPU [LOAD]]]]   default: 3000 ticks, priority 0, any CPU; LOAD: threads that keep the machine busy
#include <atomic>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <string>
#include <thread>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
namespace fs = std::filesystem;

struct Arguments {
  std::int64_t ticks = benchmark::shortened(3000, 200);
  int priority = 0, load = 0;
  std::string cpus;
};

int whole(const char* text, double most) {
  const std::optional<double> number = text::parse_real(text);
  if (!number || !(*number >= 0 && *number <= most))
    throw Error(std::string("'") + text + "', expected a number from 0 to " + text::to_text(most));
  return static_cast<int>(*number);
}

/// A load with system calls and changing memory, as other programs have it.
void keep_busy(const std::atomic<bool>& end) {
  std::vector<double> memory(1 << 18);
  for (std::size_t i = 0; !end; i = (i + 4097) % memory.size()) {
    memory[i] += 1;
    if (i % 64 == 0) std::this_thread::yield();
  }
}

void print_histogram(const char* what, const master::Histogram& h) {
  std::fprintf(stderr, "%s (us, ticks):\n", what);
  for (std::size_t bin = 0; bin < master::Histogram::kBins; ++bin) {
    if (h.counts()[bin] == 0) continue;
    const bool last = bin + 1 == master::Histogram::kBins;
    std::fprintf(stderr, "  %s %9.1f %10lld\n", last ? ">=" : "< ",
                 1e-3 * static_cast<double>(master::Histogram::edge(bin - (last ? 1 : 0))),
                 static_cast<long long>(h.counts()[bin]));
  }
}

void print_delays(const std::string& what, const master::Histogram& h) {
  const auto us = [](std::int64_t ns) { return 1e-3 * static_cast<double>(ns); };
  benchmark::print({what + ", median", "us", us(h.quantile(0.5)), "", 0, 0, false});
  benchmark::print({what + ", largest", "us", us(h.max()), "", 0, 0, false});
}

void run(const Arguments& arguments, std::uint64_t& allocations, master::Summary& summary) {
  master::Scenario scenario = master::load_scenario(fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  scenario.stop = scenario.start + arguments.ticks * scenario.tick;
  scenario.clock.kind = master::ClockKind::kWall;
  scenario.clock.priority = arguments.priority;
  if (!arguments.cpus.empty()) scenario.clock.cpus = master::parse_cpus(arguments.cpus);
  master::MasterOptions options;
  options.types = unit_types();
  options.folders = {fs::path(places::source()) / "models"};
  options.threads = 1;
  master::Master twin(std::move(scenario), std::move(options));
  twin.initialise();
  twin.prepare_threads();
  const std::uint64_t before = testing::allocations();
  while (twin.step_tick()) {
  }
  allocations = testing::allocations() - before;
  twin.finish();
  summary = twin.summary();
}

}  // namespace

int main(int argc, char** argv) try {
  Arguments arguments;
  if (argc > 1) arguments.ticks = whole(argv[1], 1e9);
  if (argc > 2) arguments.priority = whole(argv[2], 99);
  if (argc > 3) arguments.cpus = argv[3];
  if (argc > 4) arguments.load = whole(argv[4], 1000);
  std::atomic<bool> end = false;
  std::vector<std::thread> load;
  for (int i = 0; i < arguments.load; ++i) load.emplace_back([&] { keep_busy(end); });
  std::uint64_t allocations = 0;
  master::Summary s;
  std::exception_ptr failure;
  std::thread([&] {
    try {
      run(arguments, allocations, s);
    } catch (...) {
      failure = std::current_exception();
    }
  }).join();
  end = true;
  for (std::thread& thread : load) thread.join();
  if (failure) std::rethrow_exception(failure);
  for (const std::string& warning : s.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
  print_histogram("delay of the start of ticks", s.clock.start_delays);
  print_histogram("run time of ticks", s.clock.run_times);
  const std::string name = "twin on the wall clock, " + std::to_string(s.ticks) + " ticks";
  print_delays(name + ": start", s.clock.start_delays);
  print_delays(name + ": run time", s.clock.run_times);
  benchmark::print({name + ": overruns", "", static_cast<double>(s.overruns), "", 0, 0, false});
  benchmark::print(
      {name + ": page faults after the start", "", static_cast<double>(s.clock.page_faults.value_or(-1)), "", 0, 0, false});
  benchmark::print({name + ": allocations after the start", "", static_cast<double>(allocations), "", 0, 0, false});
} catch (const std::exception& error) {
  std::fprintf(stderr, "real_time: %s\n", error.what());
  return 1;
}
