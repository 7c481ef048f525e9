#pragma once
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "tests/master/run/simulated_source.h"
#include "tests/master/test_units.h"

namespace cotwin::testing {

/// What the units of a run share.
struct World {
  SimulatedHost host;
  SimulatedSource source{host};
  std::map<std::int64_t, std::int64_t> work;  // begin of a step, ns → how long it takes
  struct Step {
    std::int64_t now, h, host;  // ns; host: since the beginning of the run
    bool operator==(const Step&) const = default;
  };
  std::vector<Step> steps = [] {
    std::vector<Step> empty;
    empty.reserve(10'000);
    return empty;
  }();
  std::int64_t begin = host.now();
  std::function<void()> answer;  // called by each step of the connected unit
  int ended = 0;                 // times that the connected unit was ended
};
inline World* world = nullptr;

/// Notes its steps, and takes a while for some.
class Busy final : public Unit {
 public:
  void declare(Variables& v) override { v.output("steps", steps_, "number of steps"); }
  void initialise(Time) override { steps_ = 0; }
  StepResult step(Time now, Duration h) override {
    if (world->steps.size() < world->steps.capacity()) world->steps.push_back({now.ns, h.ns, world->host.now() - world->begin});
    if (const auto found = world->work.find(now.ns); found != world->work.end()) {
      world->host.work(found->second);
      world->work.erase(found);  // not again when the step is repeated
    }
    ++steps_;
    return StepResult::kDone;
  }

 private:
  std::int32_t steps_ = 0;
};

/// Is connected to the simulated source.
class Connected final : public Unit {
 public:
  void declare(Variables& v) override { v.output("y", y_, "1", "nothing"); }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override {
    if (world->answer) world->answer();
    return StepResult::kDone;
  }
  TickSource* tick_source() override { return &world->source; }
  void end() noexcept override { ++world->ended; }

 private:
  double y_ = 0;
};

inline std::span<const UnitType> clocked_types() {
  static const std::vector<UnitType> kAll = [] {
    std::vector<UnitType> all(cotwin::testing::test_types().begin(), cotwin::testing::test_types().end());
    all.push_back({"busy", "takes a while", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Busy>(); }});
    all.push_back(
        {"connected", "has a clock", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Connected>(); }});
    return all;
  }();
  return kAll;
}

/// A run in simulated time of a unit that is busy and of one with a clock.
class ClockedRun : public ::testing::Test {
 protected:
  ClockedRun() {
    world = &world_;
    build_.unit("busy", "busy").unit("io", "connected");
    clock().kind = master::ClockKind::kWall;
    clock().place = "test.ssd:5";
  }
  ~ClockedRun() override {
    world = nullptr;
    std::filesystem::remove_all(folder_);
  }
  master::ClockSpec& clock() { return build_.scenario.clock; }
  master::Master load(master::MasterOptions options = {}) { return load(world_, build_, std::move(options)); }
  /// The units of the master use `of` from now on.
  static master::Master load(World& of, const Build& build, master::MasterOptions options = {}) {
    world = &of;
    options.types = clocked_types();
    options.host = &of.host;
    return master::Master(build.scenario, std::move(options));
  }
  master::Summary run(master::Master& master) {
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
    return master.summary();
  }
  master::Summary run() {
    master::Master master = load();
    return run(master);
  }
  /// Packets every `period` of the source's clock, which runs (1 + rate) times as fast as the host's.
  void send(
      int n, double rate = 0, const std::function<std::int64_t(int)>& delay = [](int) { return 0; },
      const std::function<bool(int)>& lost = [](int) { return false; }, bool with_time = true) {
    for (int i = 0; i < n; ++i) {
      const double exact = static_cast<double>(i + 1) * static_cast<double>(kPeriod) / (1 + rate);
      if (!lost(i)) world_.source.send(world_.begin + std::llround(exact) + delay(i), with_time ? kEpoch + i * kPeriod : 0);
    }
  }
  static constexpr std::int64_t kPeriod = kMs, kEpoch = 793'000'000'000 * kMs;

  World world_;
  Build build_;
  std::filesystem::path folder_ = std::filesystem::temp_directory_path() / ("cotwin_clock_" + std::to_string(::getpid()));
};

}  // namespace cotwin::testing
