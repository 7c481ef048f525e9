// Drive train and contact world of example 04 as a loop: the world moves the links, the drive train the motors.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "tests/support/places.h"

namespace cotwin::master::coupling_twin_test {
namespace {

Scenario peg_in_hole(CouplingChoice coupling, const std::vector<std::string>& assignments) {
  Scenario scenario = load_scenario(places::source() + "/examples/04_peg_in_hole/twin.ssd");
  for (const std::string& assignment : assignments) assign(scenario, assignment, unit_types());
  scenario.coupling = coupling;
  scenario.stop = Time::from_seconds(1.5);
  return scenario;
}

Master load(Scenario scenario) {
  MasterOptions options;
  options.types = unit_types();
  options.folders = {places::source() + "/examples/04_peg_in_hole", places::source() + "/models"};
  return Master(std::move(scenario), std::move(options));
}

/// The largest joint torque after the first second, N.m; infinity if the run fails.
double largest_torque(Scenario scenario) {
  Master master = load(std::move(scenario));
  const Signal tau = find_real_signal(master.members(), "robot.tau_J", "");
  double largest = 0;
  try {
    master.initialise();
    while (master.step_tick()) {
      if (master.now().seconds() < 1) continue;
      for (const double t : tau.reals()) largest = std::max(largest, std::abs(t));
    }
  } catch (const Error&) {
    return std::numeric_limits<double>::infinity();
  }
  return largest;
}

const std::vector<std::string> kInside = {"robot.K=1e6", "robot.D=1000"};
const std::vector<std::string> kOutside = {"link_side=outside", "robot.K=1e6", "robot.D=0", "world.K=0", "world.D=0"};

// A gear of 1e6 N.m/rad and its link oscillate with some thousand rad/s; the tick is 1 ms. With the links inside of the drive
// train there is no loop, and with damped gears no oscillation: these torques are those of gravity and motion. Implicit steps of
// this length damp the oscillation of undamped gears, too.
TEST(CoupledTwin, IsQuietOnStiffGearsWithoutDamping) {
  const double inside = largest_torque(peg_in_hole(CouplingChoice::kExplicit, kInside));
  EXPECT_NEAR(largest_torque(peg_in_hole(CouplingChoice::kImplicit, kOutside)), inside, 0.02 * inside);
  EXPECT_GT(largest_torque(peg_in_hole(CouplingChoice::kExplicit, kOutside)), 100 * inside);
}

TEST(CoupledTwin, IsSolvedWithAutoWhereExplicitStepsWouldDiverge) {
  Master master = load(peg_in_hole(CouplingChoice::kAuto, kOutside));
  master.initialise();
  const Summary s = master.summary();
  ASSERT_EQ(s.loops.size(), 1u);
  EXPECT_EQ(s.loops[0].members, "robot, world");
  EXPECT_TRUE(s.loops[0].solved);
  EXPECT_FALSE(s.loops[0].algebraic);
  EXPECT_GT(s.loops[0].gain, 1);
}

TEST(CoupledTwin, HasTheSameBitsTwice) {
  const auto end = [] {
    Master master = load(peg_in_hole(CouplingChoice::kImplicit, {"link_side=outside"}));
    master.initialise();
    for (int i = 0; i < 300; ++i) master.step_tick();
    const auto tau = find_real_signal(master.members(), "robot.tau_J", "").reals();
    return std::vector<double>(tau.begin(), tau.end());
  };
  EXPECT_EQ(end(), end());
}

}  // namespace
}  // namespace cotwin::master::coupling_twin_test
