// Example 23, latch.ssd: what the latch holds reaches the drive train without connections of its own in the scenario.
#include <gtest/gtest.h>

#include <algorithm>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "tests/support/places.h"

namespace cotwin::master::latch_test {
namespace {

TEST(LatchExample, TellsTheDriveTrainWhatTheLatchHolds) {
  const std::filesystem::path source = places::source();
  Scenario scenario = load_scenario(source / "examples/23_latch/latch.ssd");
  scenario.recording.clear();
  MasterOptions options;
  options.types = unit_types();
  options.folders = {scenario.folder, source / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  const auto values = [&](const std::string& name, std::size_t size) {
    const Signal first = find_signal(master.members(), size > 1 ? name + "[1]" : name, "");
    const auto all = first.variable->reals();
    return std::vector<double>(all.begin(), all.end());
  };
  const auto largest = [](const std::vector<double>& all) { return *std::ranges::max_element(all); };
  EXPECT_EQ(values("world.takes_loads", 1), std::vector{1.0});
  const auto run_to = [&](double t) {
    while (master.now().seconds() < t - 1e-9) ASSERT_TRUE(master.step_tick());
  };
  run_to(1.5);
  EXPECT_EQ(largest(values("drive.load_factor", 49)), 0);
  run_to(3);
  EXPECT_GT(largest(values("drive.load_factor", 49)), 0.5);  // 2 kg at 0.7 m
  for (const char* name : {"load_factor", "load_torque", "load_damping"}) {
    EXPECT_EQ(values(std::string("drive.") + name, 7), values(std::string("world.") + name, 7)) << name;
  }
  run_to(8);
  EXPECT_EQ(largest(values("drive.load_factor", 49)), 0);
}

}  // namespace
}  // namespace cotwin::master::latch_test
