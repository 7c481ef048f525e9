// The twin of example 02 with and without somebody who watches it: a viewer at 60 Hz, and a reader of every tick.
#include "tests/benchmarks/live_run.h"

#include <atomic>
#include <string>
#include <thread>

#include "components/bus/live_run.h"
#include "master/run/master.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/places.h"

namespace {

using namespace cotwin;
using benchmark::print;
using bus::LiveRun;

struct Observer final : bus::RunObserver {
  void observe(std::shared_ptr<LiveRun> observed) override { run = std::move(observed); }
  std::shared_ptr<LiveRun> run;
};

/// The run of example 02 without an end.
class Run {
 public:
  explicit Run(bool observed) {
    master::Scenario scenario = master::load_scenario(places::source() + "/examples/02_free_motion_lwr4/twin.ssd");
    scenario.stop = Time::from_seconds(1e6);
    master::MasterOptions options;
    options.types = unit_types();
    options.folders = {places::source() + "/models"};
    options.threads = 1;
    if (observed) options.observer = &observer_;
    master_.emplace(std::move(scenario), std::move(options));
    master_->initialise();
  }
  void tick() { master_->step_tick(); }
  const std::shared_ptr<LiveRun>& live() const { return observer_.run; }

 private:
  Observer observer_;
  std::optional<master::Master> master_;
};

/// All real signals of the run, up to a number of elements.
std::vector<std::string> names(const LiveRun& run, std::size_t most) {
  std::vector<std::string> all;
  std::size_t n = 0;
  for (const bus::LiveSignal& s : run.signals()) {
    if (s.kind != Kind::kReal || n + s.size > most) continue;
    n += s.size;
    all.push_back(s.name);
  }
  return all;
}

/// A thread that takes records.
class Viewer {
 public:
  Viewer(const std::shared_ptr<LiveRun>& run, std::int64_t every) : watch_(run, names(*run, 200), every) {
    thread_ = std::thread([this, every] {
      LiveRun::Sample sample;
      while (!done_) {
        if (every == 0) {
          std::this_thread::sleep_for(std::chrono::microseconds(16'667));
          watch_.request();
        }
        if (watch_.wait(bus::monotonic_ns() + 100'000'000) && watch_.take_newest(sample)) ++taken_;
      }
    });
  }
  ~Viewer() {
    done_ = true;
    thread_.join();
  }
  std::size_t values() const { return watch_.size(); }

 private:
  LiveRun::Watch watch_;
  std::atomic<bool> done_ = false;
  std::atomic<std::int64_t> taken_ = 0;
  std::thread thread_;
};

void compare(const std::string& name, Run& watched, Run& alone) {
  const auto figures = benchmark::measure([&] { watched.tick(); }, [&] { alone.tick(); }, 31, 0.05, benchmark::thread_seconds);
  print({"a tick of example 02, " + name, "us", figures.ours * 1e6, "nobody may watch", figures.peer * 1e6});
  print({"share of the run, " + name, "%", 100 * (figures.ours / figures.peer - 1), "", 0});
}

}  // namespace

void live_run_costs() {
  Run alone(false), observed(true);
  compare("observed, nobody watches", observed, alone);
  {
    const Viewer viewer(observed.live(), 0);
    compare("a viewer of " + std::to_string(viewer.values()) + " values at 60 Hz", observed, alone);
  }
  {
    LiveRun::Watch dead(observed.live(), names(*observed.live(), 200), 1);
    compare("every tick for a reader that does not read", observed, alone);
  }
  {
    const Viewer viewer(observed.live(), 1);
    compare("every tick for a thread that sleeps between", observed, alone);
  }
}
