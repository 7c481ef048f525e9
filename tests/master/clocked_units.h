#pragma once
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "tests/master/simulated_source.h"
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
  StepResult step(Time, Duration) override { return StepResult::kDone; }
  TickSource* tick_source() override { return &world->source; }

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

}  // namespace cotwin::testing
