// The course of a signal between two exchanges is declared with the output, and applies to the unit that writes it and to the
// unit that reads it.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <string_view>
#include <vector>

#include "components/unit/unit_table.h"
#include "fmu/description/describe.h"
#include "master/engine/wiring/members.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "tests/support/places.h"

namespace cotwin::master::held_signals_test {
namespace {

// A digital controller keeps its torque constant until its next step. The work of a constant torque is torque times way. With a
// ramped torque it would be off by half of the change times the way.
TEST(HeldSignals, TheMotorsGetTheTorqueThatTheControllerHolds) {
  Scenario scenario = load_scenario(std::filesystem::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  scenario.recording.clear();
  MasterOptions options;
  options.types = unit_types();
  options.folders = {std::filesystem::path(places::source()) / "models"};
  Master master(scenario, std::move(options));
  master.initialise();
  const auto signal = [&](const char* name) { return find_signal(master.members(), name, "").reals(); };
  const auto tau_m = signal("compliance.tau_m"), theta = signal("drive.theta"), work = signal("drive.work_m");
  std::vector<double> theta_before(theta.begin(), theta.end()), tau_before(tau_m.begin(), tau_m.end());
  double largest_change = 0;
  for (int n = 0; n < 3000; ++n) {
    const double work_before = work[0];
    ASSERT_TRUE(master.step_tick());
    double held = 0;
    for (std::size_t i = 0; i < theta.size(); ++i) {
      held += tau_m[i] * (theta[i] - theta_before[i]);
      largest_change = std::max(largest_change, std::abs(tau_m[i] - tau_before[i]));
    }
    ASSERT_NEAR(work[0] - work_before, held, 1e-9 + 1e-9 * std::abs(held)) << n;
    theta_before.assign(theta.begin(), theta.end());
    tau_before.assign(tau_m.begin(), tau_m.end());
  }
  EXPECT_GT(largest_change, 0.1);  // N.m in a tick: a ramp would be visible
}

TEST(HeldSignals, ATorqueIsDeclaredAsHeldAndAMotionIsNot) {
  const std::vector<std::filesystem::path> folders{std::filesystem::path(places::source()) / "models"};
  const Instance controller = make_unit("unit:compliance?robot=lwr4", {}, folders, unit_types());
  EXPECT_TRUE(controller.variables.at("tau_m").discrete);
  EXPECT_FALSE(controller.variables.at("q_c").discrete);
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) {  // and its FMUs declare it, too
    const auto type = std::find_if(unit_types().begin(), unit_types().end(),
                                   [](const UnitType& t) { return std::string_view(t.name) == "compliance"; });
    const fmu::ModelDescription description = fmu::describe(*type, *controller.unit, controller.variables, version);
    int found = 0;
    for (const fmu::ModelVariable& v : description.variables) {
      if (v.name == "tau_m" || v.name == "tau_m[1]") {
        EXPECT_EQ(v.variability, fmu::Variability::kDiscrete);
        ++found;
      }
      if (v.name == "q_c" || v.name == "q_c[1]") {
        EXPECT_EQ(v.variability, fmu::Variability::kContinuous);
        ++found;
      }
    }
    EXPECT_EQ(found, 2);
  }
  const Instance drive = make_unit("unit:drive_train?robot=lwr4", {}, folders, unit_types());
  EXPECT_FALSE(drive.variables.at("q").discrete);
}

}  // namespace
}  // namespace cotwin::master::held_signals_test
