#pragma once
#include <cstdint>
#include <memory>
#include <utility>

#include "components/bus/live_run.h"
#include "tests/master/test_units.h"

/// A run that a test observes.
namespace cotwin::master {

inline constexpr std::int64_t kLimit = 60'000'000'000;  // ns, for what must come
inline std::int64_t soon() { return bus::monotonic_ns() + kLimit; }

/// Keeps the run that it observes.
struct Observer final : bus::RunObserver {
  void observe(std::shared_ptr<bus::LiveRun> observed) override { run = std::move(observed); }
  std::shared_ptr<bus::LiveRun> run;
};

inline Master load(const testing::Build& b, Observer& observer, std::unique_ptr<Clock> clock = nullptr,
                   HostTime* host = nullptr) {
  MasterOptions options;
  options.types = testing::test_types();
  options.observer = &observer;
  options.clock = std::move(clock);
  options.host = host;
  Master master(b.scenario, std::move(options));
  master.initialise();
  return master;
}

/// y = gain · 1, z = ∫y, in ticks of 1 ms.
inline testing::Build gain_and_integral(double seconds = 1e6) {
  testing::Build b;
  b.unit("g", "gain").with("u", 1.0).unit("i", "integrator", 1).connect("g.y", "i.u").as_it_is().until(seconds);
  return b;
}

}  // namespace cotwin::master
