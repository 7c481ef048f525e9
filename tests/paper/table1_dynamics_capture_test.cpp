// VI-A in free space, Table I and Fig. 10: joint torques of a twin held against those that a real robot measured. The paper's
// robot is a KUKA LWR; the measurements here are of a Franka Panda and of a UR10 (examples/03_dynamics_capture says which).
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/master.h"

namespace cotwin::master {
namespace {

const std::filesystem::path kExample = std::filesystem::path(COTWIN_SOURCE_DIR) / "examples/03_dynamics_capture";

bool measurements_are_here() { return std::filesystem::exists(std::filesystem::path(COTWIN_SHARED_DIR) / "data/measurements"); }

std::vector<Compared> compare(const std::string& scenario_file, const std::vector<std::string>& assignments = {}) {
  Scenario scenario = load_scenario(kExample / scenario_file);
  for (const std::string& assignment : assignments) assign(scenario, assignment);
  MasterOptions options;
  options.types = unit_types();
  options.folders = {kExample, std::filesystem::path(COTWIN_SOURCE_DIR) / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  return master.summary().comparisons;
}

double worst_segment(const Compared& compared) {
  double worst = 0;
  for (const std::vector<double>& segment : compared.segment_rms) {
    for (const double rms : segment) worst = std::max(worst, rms);
  }
  return worst;
}

TEST(Table1, PandaIsCapturedWithinThePublishedValidationOfItsParameters) {
  if (!measurements_are_here()) GTEST_SKIP() << "needs the measurements beside the checkout";
  // RMS errors with which Gaz et al. (RA-L 2019) validate these parameters on trajectories of their own, N.m. Theirs is another
  // Panda: 1.1 of their error is allowed, which joints 4 and 6 need.
  const std::vector<double> published = {0.64, 1.01, 0.77, 0.65, 0.42, 0.20, 0.16};
  // Unconstrained least squares on the same data leaves this: better would be a bug.
  const std::vector<double> floor = {0.27, 0.17, 0.24, 0.22, 0.07, 0.06, 0.05};
  const std::vector<Compared> compared = compare("panda.ssd");
  ASSERT_EQ(compared.size(), 2u);
  for (const Compared& c : compared) {
    ASSERT_EQ(c.rms.size(), 7u);
    ASSERT_EQ(c.segment_rms.size(), 8u);
    for (std::size_t i = 0; i < 7; ++i) {
      EXPECT_LT(c.rms[i], 1.1 * published[i]) << c.name << ", joint " << i + 1;
      EXPECT_GT(c.rms[i], floor[i]) << c.name << ", joint " << i + 1;
    }
    // Fig. 10: R_i <= 1.52 N.m in all eight segments, < 1.13 N.m in six. Table I: at most 4.32 N.m at any time.
    EXPECT_LT(worst_segment(c), 1.13) << c.name;
    for (const double maximum : c.max) EXPECT_LT(maximum, 4.32) << c.name;
  }
}

TEST(Table1, TwinAndInverseDynamicsAgreeWhereTheTwinTracksWell) {
  if (!measurements_are_here()) GTEST_SKIP() << "needs the measurements beside the checkout";
  // Two ways to the same torque: K (θ − q) of the controlled elastic arm, and (2a) evaluated on the recorded motion.
  const std::vector<Compared> compared = compare("panda.ssd");
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(compared[0].rms[i], compared[1].rms[i], 0.01) << "joint " << i + 1;
}

TEST(Table1, LinkFrictionOfThePandaIsPartOfWhatItsSensorsMeasure) {
  if (!measurements_are_here()) GTEST_SKIP() << "needs the measurements beside the checkout";
  const std::vector<Compared> with = compare("panda.ssd"),
                              without = compare("panda.ssd", {"compliance.link_A=0", "compliance.link_k=0"});
  // Joints 5 to 7 carry little but friction.
  for (const std::size_t i : {4, 5, 6}) EXPECT_LT(with[1].rms[i], 0.8 * without[1].rms[i]) << "joint " << i + 1;
}

TEST(Table1, Ur10IsCapturedWithTheFrictionOfItsNearestRelative) {
  if (!measurements_are_here()) GTEST_SKIP() << "needs the measurements beside the checkout";
  const std::vector<Compared> compared = compare("ur10.ssd");
  ASSERT_EQ(compared.size(), 2u);
  // Nothing here was identified on this robot. Unconstrained least squares on the same data leaves 2.8 1.8 1.7 0.40 0.38 1.9
  // N.m.
  const std::vector<double> expected = {3.27, 3.75, 2.82, 1.11, 1.11, 1.90};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(compared[0].rms[i], expected[i], 0.05 * expected[i]) << "joint " << i + 1;
}

}  // namespace
}  // namespace cotwin::master
