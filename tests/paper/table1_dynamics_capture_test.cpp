// VI-A in free space, Table I and Fig. 10: joint torques of a twin compared with those measured on a real robot. The paper's
// robot is a KUKA LWR; the measurements here are of a Franka Panda and a UR10 (sources: examples/03_dynamics_capture).
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>
#include <vector>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/foundation/formats/csv.h"
#include "models/numerics/random.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"

namespace cotwin::master::table1_dynamics_capture_test {
namespace {

const std::filesystem::path kExample = std::filesystem::path(places::source()) / "examples/03_dynamics_capture";

const std::string kPanda = places::public_data("measurements/panda_unisa.csv"),
                  kUr10 = places::public_data("measurements/ur10_unisa.csv");
constexpr const char* kNeeds = "needs public measurements (scripts/fetch_logs.py)";

std::vector<Compared> compare(const std::filesystem::path& scenario_file, const std::vector<std::string>& assignments = {}) {
  Scenario scenario = load_scenario(kExample / scenario_file);
  for (const std::string& assignment : assignments) assign(scenario, assignment);
  MasterOptions options;
  options.types = unit_types();
  options.folders = {(kExample / scenario_file).parent_path(), std::filesystem::path(places::source()) / "models"};
  Master master(std::move(scenario), std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  return master.summary().comparisons;
}

/// The Panda of the example, on its measurements.
std::vector<Compared> compare_panda(std::vector<std::string> assignments = {}) {
  assignments.insert(assignments.begin(),
                     {"robot=" + places::public_data("models/panda_franka_ros.urdf"), "recording.file=" + kPanda});
  return compare("panda.ssd", assignments);
}

double worst_segment(const Compared& compared) {
  double worst = 0;
  for (const std::vector<double>& segment : compared.segment_rms) {
    for (const double rms : segment) worst = std::max(worst, rms);
  }
  return worst;
}

/// The signals of a run as a log, with seeded noise on positions and torques.
void add_noise(const std::filesystem::path& signals, const std::filesystem::path& log) {
  const csv::Table table = csv::load(signals);
  std::ofstream out(log);
  csv::Writer writer(out, table.names);
  std::vector<double> row(table.names.size());
  for (std::size_t k = 0; k < table.rows(); ++k) {
    for (std::size_t c = 0; c < row.size(); ++c) {
      const numerics::Key key{22, 0, static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(c), 0};
      const std::string& name = table.names[c];
      const double sigma = name.rfind("drive.q", 0) == 0            ? 1e-5
                           : name.rfind("compliance.tau_m", 0) == 0 ? 0.05
                                                                    : 0;  // rad, N.m
      row[c] = table.columns[c][k] + (sigma > 0 ? sigma * numerics::normal(key) : 0);
    }
    writer.row(row);
  }
}

// Without external data: the robot is a perturbed LWR 4+ with masses and moments that differ by up to 20 %, and with unknown
// friction. Its log is that of its own twin on an exciting motion, with noise.
TEST(Table1, ATwinTunedToAnotherSpecimenCapturesItsTorques) {
  const cotwin::testing::TemporaryFolder folder("specimen");
  const auto run = [&](std::vector<std::string> arguments) {
    return cotwin::testing::run_program(std::move(arguments), {.folder = folder.path()}).code;
  };
  using cotwin::testing::words;
  ASSERT_EQ(run(words("excite --robot lwr4 --out motion.csv --rounds 5 --particles 8 --periods 2 --quiet")), 0);
  ASSERT_EQ(run(words("perturb --robot lwr4 --inertia 0.2 --seed 3 --out specimen")), 0);
  std::vector<std::string> record = {"run",   kExample / "own_robot.ssd",
                                     "--set", "robot=specimen/robot.urdf",
                                     "--set", "recording.file=" + (folder / "motion.csv").string()};
  for (const std::string unit : {"compliance", "drive"}) {
    for (const char* value : {"link_tau_C=3", "link_sigma2=2", "link_v_R=0.05"})
      record.insert(record.end(), {"--set", unit + "." + value});
  }
  record.insert(record.end(), {"--stop", "20", "--out", "recorded"});
  ASSERT_EQ(run(record), 0);
  add_noise(folder / "recorded/signals.csv", folder / "log.csv");
  ASSERT_EQ(
      run(words("tune --robot lwr4 --data log.csv --t-column time --q-columns drive.q[{}] --dq-columns none --tau-columns "
                "compliance.tau_m[{}] --method feasible --out tuned --quiet")),
      0);
  const std::vector<Compared> compared = compare(folder / "tuned/twin.ssd");
  ASSERT_EQ(compared.size(), 2u);  // training, held out
  for (const Compared& c : compared) {
    ASSERT_EQ(c.rms.size(), 7u);
    for (std::size_t i = 0; i < 7; ++i) {
      // Fig. 10: R_i <= 1.52 N.m in all segments, < 1.13 N.m in most. Table I: at most 4.32 N.m at any time. Torques here are 4
      // to 21 N.m RMS.
      EXPECT_LT(c.rms[i], 0.5) << c.name << ", joint " << i + 1;
      EXPECT_LT(c.max[i], 4.32) << c.name << ", joint " << i + 1;
    }
    EXPECT_LT(worst_segment(c), 1.13) << c.name;
  }
}

TEST(Table1, PandaIsCapturedWithinThePublishedValidationOfItsParameters) {
  if (!std::filesystem::exists(kPanda)) GTEST_SKIP() << kNeeds;
  // RMS errors of the validation of these parameters by Gaz et al. (RA-L 2019) on their trajectories, N.m. Theirs is another
  // Panda: 1.1 of their error is allowed, which joints 4 and 6 need.
  const std::vector<double> published = {0.64, 1.01, 0.77, 0.65, 0.42, 0.20, 0.16};
  // The error of unconstrained least squares on the same data: a smaller one would be a bug.
  const std::vector<double> floor = {0.27, 0.17, 0.24, 0.22, 0.07, 0.06, 0.05};
  const std::vector<Compared> compared = compare_panda();
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
  if (!std::filesystem::exists(kPanda)) GTEST_SKIP() << kNeeds;
  // Two ways to compute the same torque: K (θ − q) of the controlled elastic arm, and (2a) evaluated on the recorded motion.
  const std::vector<Compared> compared = compare_panda();
  for (std::size_t i = 0; i < 7; ++i) EXPECT_NEAR(compared[0].rms[i], compared[1].rms[i], 0.01) << "joint " << i + 1;
}

TEST(Table1, LinkFrictionOfThePandaIsPartOfWhatItsSensorsMeasure) {
  if (!std::filesystem::exists(kPanda)) GTEST_SKIP() << kNeeds;
  const std::vector<Compared> with = compare_panda(), without = compare_panda({"compliance.link_A=0", "compliance.link_k=0"});
  // The torques of joints 5 to 7 are mostly friction.
  for (const std::size_t i : {4, 5, 6}) EXPECT_LT(with[1].rms[i], 0.8 * without[1].rms[i]) << "joint " << i + 1;
}

TEST(Table1, Ur10IsCapturedWithTheFrictionOfItsNearestRelative) {
  if (!std::filesystem::exists(kUr10)) GTEST_SKIP() << kNeeds;
  const std::vector<Compared> compared = compare("ur10.ssd", {"recording.file=" + kUr10});
  ASSERT_EQ(compared.size(), 2u);
  // No parameter was identified on this robot. Unconstrained least squares on the same data has errors of 2.8 1.8 1.7 0.40 0.38
  // 1.9 N.m.
  const std::vector<double> expected = {3.27, 3.75, 2.82, 1.11, 1.11, 1.90};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(compared[0].rms[i], expected[i], 0.05 * expected[i]) << "joint " << i + 1;
}

}  // namespace
}  // namespace cotwin::master::table1_dynamics_capture_test
