// Example 10, carrying.ssd: a KUKA LWR 4+ and a UR5e hold one block between them and carry it.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/scenario/scenario.h"
#include "tests/support/places.h"

namespace cotwin::master::carrying_test {
namespace {

const std::filesystem::path kSource = places::source();
constexpr double kMass = 1, kWeight = kMass * 9.81;                                // kg, N: block.sdf
constexpr double kFoundation = 5e6 / 0.05 * 3.14159265358979323846 * 0.01 * 0.01;  // N/m under a punch of 20 mm: block.sdf
constexpr double kInside = 0.02;  // m, by which the paths together are inside the block

Master load(const std::vector<std::string>& set) {
  Scenario scenario = load_scenario(kSource / "examples/10_cooperation/carrying.ssd");
  for (const std::string& assignment : set) assign(scenario, assignment, unit_types());
  scenario.recording.clear();
  MasterOptions options;
  options.types = unit_types();
  options.folders = {scenario.folder, kSource / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  return master;
}

Eigen::Map<const Eigen::Vector3d> vector(Master& master, const std::string& name) {
  const Signal s = find_signal(master.members(), name + "[1]", "");
  return Eigen::Map<const Eigen::Vector3d>(s.variable->reals().data());
}

void run_to(Master& master, double t) {
  while (master.now().seconds() < t - 1e-9) ASSERT_TRUE(master.step_tick());
}

/// The force in four springs in series: both arms, and the block under both punches.
double internal_force(double S_left, double S_right) { return kInside / (1 / S_left + 1 / S_right + 2 / kFoundation); }

// Newton for the block in each tick: the forces of both hands are its weight and its inertia. The path of the block is that of the hands, less what
// the compliance of both arms gives way. The velocity of a free body is a running sum over the sweeps, its forces are not; the two differ by 2e-11 N in 99
// ticks of 100 and by up to 2e-9 N in one of 4800, whatever the solver's tolerance (measured for stiffnesses changed by 1e-7 N/m, 1e-9 to 1e-14 m/s).
TEST(Carrying, TheForcesOfBothHandsMoveTheBlockAlongTheirPath) {
  Master master = load({});
  const auto left = vector(master, "world.left.f_c"), right = vector(master, "world.right.f_c"),
             on_block = vector(master, "world.block.f_c");
  const auto v = vector(master, "world.block.v"), p = vector(master, "world.block.p");
  const auto p_left = vector(master, "left_motion.p_d"), p_right = vector(master, "right_motion.p_d");
  run_to(master, 5.2);  // off the table
  const double F = internal_force(2000, 1500), h = 1e-3;
  const double sag = kWeight / 2 * (1 / 2000.0 + 1 / 1500.0) / 2, aside = F / 2 * (1 / 1500.0 - 1 / 2000.0);
  double newton = 0, squares = 0, hands = 0, path = 0, squeeze = 0, largest = 0;
  int ticks = 0, beyond = 0;
  while (master.now().seconds() < 10) {
    const Eigen::Vector3d before = v;
    ASSERT_TRUE(master.step_tick());
    const Eigen::Vector3d a = (v - before) / h, weight(0, 0, -kWeight);
    const double missing = (on_block + weight - kMass * a).norm();
    newton = std::max(newton, missing);
    squares += missing * missing;
    ++ticks;
    beyond += missing > 1e-9;
    hands = std::max(hands, (on_block + left + right).norm());
    largest = std::max(largest, a.norm());
    const Eigen::Vector3d middle = (p_left + p_right) / 2 + Eigen::Vector3d(aside, 0, 0.23 - 0.2297293649 - sag);
    path = std::max(path, (p - middle).norm());
    squeeze = std::max({squeeze, std::abs(left.x() + F), std::abs(right.x() - F)});
  }
  EXPECT_LT(hands, 1e-12);
  EXPECT_LT(std::sqrt(squares / ticks), 1e-10);
  EXPECT_LE(beyond, ticks / 1000);
  EXPECT_LT(newton, 1e-8);
  EXPECT_GT(largest, 0.05);  // m/s²: it is moved
  EXPECT_LT(path, 3e-4);     // the arms' inertia M_T of 10 kg leaves both behind their paths
  EXPECT_LT(squeeze, 0.1);
}

TEST(Carrying, TheMismatchOfThePathsAndTheStiffnessOfBothArmsGiveTheInternalForce) {
  for (const auto& [S_left, S_right] : {std::pair{3000, 2000}, {1000, 1000}}) {
    SCOPED_TRACE(std::to_string(S_left) + " and " + std::to_string(S_right) + " N/m");
    Master master = load({"left_compliance.S_T=" + std::to_string(S_left), "right_compliance.S_T=" + std::to_string(S_right)});
    run_to(master, 6.45);
    const double F = internal_force(S_left, S_right);
    EXPECT_NEAR(vector(master, "world.left.f_c").x(), -F, 2e-3 * F);
    EXPECT_NEAR(vector(master, "world.right.f_c").x(), F, 2e-3 * F);
    EXPECT_NEAR(vector(master, "world.left.f_c").z() + vector(master, "world.right.f_c").z(), -kWeight, 5e-3 * kWeight);
  }
}

// Held at rest for two seconds, nothing may feed the closed chain of floor, arm, block, arm and floor: no energy is gained, and the block's motion stays that of
// creeping patches (0.01 mm/s) and of rounding in the sweeps.
TEST(Carrying, GainsNoEnergyInTheClosedChain) {
  const std::string later = "motion.waypoint_t=0 1.5 4 6 18.5 21 22.5 23.5",
                    longer = "motion.waypoint_dwell=0 0 0.5 10 0.5 0.5 0 0.5";
  Master master = load({"left_" + later, "right_" + later, "left_" + longer, "right_" + longer});
  run_to(master, 6.2);
  const auto v = vector(master, "world.block.v"), w = vector(master, "world.block.w"), p = vector(master, "world.block.p");
  const double& energy = *find_signal(master.members(), "world.energy", "").variable->reals().data();
  const double before = energy, height = p.z();
  double fastest = 0, turning = 0, most = before;
  while (master.now().seconds() < 8.2 && master.step_tick()) {
    fastest = std::max(fastest, v.norm());
    turning = std::max(turning, w.norm());
    most = std::max(most, energy);
  }
  EXPECT_LT(most - before, 1e-4);  // J, of 91
  EXPECT_LT(fastest, 2e-4);
  EXPECT_LT(turning, 3e-3);
  EXPECT_NEAR(p.z(), height, 4e-5);
}

}  // namespace
}  // namespace cotwin::master::carrying_test
