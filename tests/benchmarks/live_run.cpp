// The twin of example 02 with and without somebody who watches it: a viewer at 60 Hz, a reader of every tick, and a browser's stream of 60
// messages a second over a WebSocket of the gateway, with the time from a record to its arrival.
#include "tests/benchmarks/live_run.h"

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <string>
#include <thread>
#include <vector>

#include "components/bus/live_run.h"
#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "tests/benchmarks/measure.h"
#include "tests/support/http_client.h"
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
  explicit Run(bool observed, bool wall_clock = false, bus::RunObserver* gateway = nullptr) {
    master::Scenario scenario = master::load_scenario(places::source() + "/examples/02_free_motion_lwr4/twin.ssd");
    scenario.stop = Time::from_seconds(1e6);
    master::MasterOptions options;
    options.types = unit_types();
    options.folders = {places::source() + "/models"};
    options.threads = 1;
    if (observed) options.observer = gateway != nullptr ? gateway : &observer_;
    if (wall_clock) scenario.clock.kind = master::ClockKind::kWall;
    master_.emplace(std::move(scenario), std::move(options));
    master_->initialise();
  }
  void tick() { master_->step_tick(); }
  std::int64_t ticks() const { return master_->tick(); }
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
        if (watch_.wait(bus::monotonic_ns() + 100'000'000) && watch_.pop_newest(sample)) ++taken_;
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
}

/// The gateway of `cotwin run --view`.
class Gateway {
 public:
  Gateway() : instance_(make_unit("unit:gateway", {}, {places::source() + "/models"}, unit_types())) {
    ParameterSet set;
    set.values.push_back({"port", std::int64_t{0}, "", "benchmark"});
    apply(set, instance_.variables);
    instance_.unit->initialise(Time{});
  }
  ~Gateway() { instance_.unit->end(); }
  bus::RunObserver* observer() { return dynamic_cast<bus::RunObserver*>(instance_.unit.get()); }
  std::uint16_t port() {
    const std::string url = observer()->url();
    return static_cast<std::uint16_t>(std::stoi(url.substr(url.rfind(':') + 1)));
  }

 private:
  Instance instance_;
};

/// A thread that receives a stream as a browser does, and notes when the record of which tick came.
class Browser {
 public:
  struct Arrival {
    std::int64_t tick = 0;
    double time = 0;  // s, wall
  };

  Browser(std::uint16_t port, const std::string& names) : client_(port) {
    client_.send(testing::http_request("GET", "/run/stream?rate_hz=60&names=" + names, "",
                                       "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
                                       "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"));
    thread_ = std::thread([this] {
      const std::string mark = "\"event\":\"sample\"", tick = "\"tick\":";
      while (client_.receive()) {
        const double now = benchmark::wall_seconds();
        std::string& text = client_.received();
        for (std::size_t at = 0; (at = text.find(mark)) != std::string::npos;) {
          const std::size_t number = text.find(tick, at);
          if (number == std::string::npos || number + 24 > text.size()) break;
          arrivals_.push_back({std::strtoll(text.c_str() + number + tick.size(), nullptr, 10), now});
          text.erase(0, number + tick.size());
        }
      }
    });
  }
  /// Ends with the server's end of the stream.
  std::vector<Arrival> wait() {
    if (thread_.joinable()) thread_.join();
    return std::move(arrivals_);
  }
  ~Browser() { wait(); }

 private:
  testing::RawClient client_;
  std::vector<Arrival> arrivals_;
  std::thread thread_;
};

const std::string kPageNames =
    "drive.q,motion.q_d,compliance.q_c,drive.tau_J,drive.tau_f,compliance.tau_m,drive.theta,drive.dq";

/// A minute of a browser's stream, and the share of the loop's time that it takes.
void compare_browser(Run& alone) {
  std::optional<Gateway> gateway(std::in_place);
  Run viewed(true, false, gateway->observer());
  Browser browser(gateway->port(), kPageNames);
  const auto figures = benchmark::measure([&] { viewed.tick(); }, [&] { alone.tick(); }, 31, 1, benchmark::thread_seconds);
  gateway.reset();
  print({"share of the run, a browser of 56 values at 60 Hz over a WebSocket", "%", 100 * (figures.ours / figures.peer - 1), "",
         0, 3, false});
}

/// From the end of the tick that a record is of to its arrival at a client, of a run in real time.
void measure_latency() {
  const std::int64_t ticks = benchmark::shortened(20'000, 1'000);
  std::vector<double> ended(static_cast<std::size_t>(ticks) + 1);
  std::vector<Browser::Arrival> arrivals;
  {
    std::optional<Gateway> gateway(std::in_place);
    Run run(true, true, gateway->observer());
    Browser browser(gateway->port(), kPageNames);
    while (run.ticks() < ticks) {
      run.tick();
      ended[static_cast<std::size_t>(run.ticks())] = benchmark::wall_seconds();
    }
    gateway.reset();
    arrivals = browser.wait();
  }
  std::vector<double> delays;
  for (const Browser::Arrival& a : arrivals) {
    if (a.tick > 0 && a.tick <= ticks) delays.push_back(1e3 * (a.time - ended[static_cast<std::size_t>(a.tick)]));
  }
  std::ranges::sort(delays);
  if (delays.empty()) return;
  print({"from a record to a browser's WebSocket, median", "ms", delays[delays.size() / 2], "", 0, 50, false});
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
  compare_browser(alone);
  measure_latency();
}
