// Compares the errors that cotwin tune reports with those of the twin that it writes: twin.ssd is run unchanged.
#include <gtest/gtest.h>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "models/foundation/formats/csv.h"
#include "tests/master/workflows/tune_fixture.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::master::tuning::tune_twin_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::TunedRobot;
using identification::FrictionLaw;

std::vector<Compared> run_twin(const fs::path& folder) {
  MasterOptions options;
  options.types = unit_types();
  options.folders = {folder, fs::path(places::source()) / "models"};
  Master master(load_scenario(folder / "twin.ssd"), std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  master.finish();
  return master.summary().comparisons;
}

/// The twin compares every reported part, and its errors are the reported ones to 1 % per joint. The additional tolerance
/// covers errors far below the torques: half a tick of 0.5 ms of a motion below 1 Hz.
void expect_promise(const fs::path& folder, const Replay& promise) {
  const std::vector<Compared> compared = run_twin(folder);
  std::size_t parts = 0;
  for (const auto& [name, errors] : {std::pair{"training", &promise.training}, std::pair{"held out", &promise.held_out}}) {
    if (errors->samples == 0) continue;
    ASSERT_LT(parts, compared.size());
    const Compared& c = compared[parts++];
    EXPECT_EQ(c.name, std::string("twin against robot, ") + name);
    ASSERT_EQ(c.rms.size(), static_cast<std::size_t>(errors->rms.size()));
    for (std::size_t j = 0; j < c.rms.size(); ++j) {
      const double expected = errors->rms[static_cast<Eigen::Index>(j)], torque = errors->torque[static_cast<Eigen::Index>(j)];
      EXPECT_NEAR(c.rms[j], expected, 0.01 * expected + 5e-4 * torque) << c.name << ", joint " << j + 1;
    }
  }
  EXPECT_EQ(parts, compared.size());
}

TEST(TunedTwin, HasTheReportedErrorsForEveryFormOfFrictionOnBothSidesOfTheGears) {
  const TunedRobot robot;
  for (const FrictionLaw law : {FrictionLaw::kNone, FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    for (const bool motor : {true, false}) {
      for (const bool load : {false, true}) {
        SCOPED_TRACE(std::string(identification::to_text(law)) + (motor ? ", motor" : ", joint") + (load ? ", load" : ""));
        cotwin::testing::SyntheticLog log = robot.log;
        log.duration = 16;
        log.joint = !motor;
        log.load = load ? 0.08 : 0;
        log.write(robot.folder / "twin.csv", robot.truth);
        Settings settings = robot.settings();
        settings.data = {robot.folder / "twin.csv"};
        settings.method = Method::kFeasible;
        settings.model.friction = law;
        settings.model.motor_inertia = motor;
        settings.model.load = load;
        settings.model.v_R = log.v_R;
        const Result result = robot.tune(settings, "twin");
        ASSERT_TRUE(result.evaluation.replay);
        expect_promise(robot.folder / "twin", *result.evaluation.replay);
      }
    }
  }
}

TEST(TunedTwin, HasTheSpringsOfItsRobot) {
  const TunedRobot robot;
  cotwin::testing::SyntheticLog log = robot.log;
  log.duration = 16;
  const auto spring = [&](std::size_t, std::vector<double>& cells) {  // of joints 2 and 4: cells t, q1 …, tau1 …
    cells[1 + 7 + 1] += 12 * std::sin(cells[2]) - 5 * std::cos(cells[2]) + 3 * std::sin(2 * cells[2]);
    cells[1 + 7 + 3] += 4 * std::cos(cells[4]);
  };
  log.write(robot.folder / "springs.csv", robot.truth, spring);
  Settings settings = robot.settings();
  settings.data = {robot.folder / "springs.csv"};
  settings.method = Method::kFeasible;
  settings.model.harmonics = {0, 2, 0, 1, 0, 0, 0};
  const Result result = robot.tune(settings, "springs");
  ASSERT_TRUE(result.evaluation.replay);
  EXPECT_LT(result.evaluation.replay->held_out.rms.maxCoeff(), 0.3);
  expect_promise(robot.folder / "springs", *result.evaluation.replay);
}

TEST(TunedTwin, UsesMotorsThatWereMeasuredBesideTheLinks) {
  const TunedRobot robot;
  cotwin::testing::SyntheticLog log = robot.log;
  log.duration = 16;
  log.K = 1e4;
  log.write(robot.folder / "motors.csv", robot.truth);
  Settings settings = robot.settings();
  settings.data = {robot.folder / "motors.csv"};
  settings.method = Method::kFeasible;
  settings.format.theta_columns = "theta{}";
  const Result result = robot.tune(settings, "motors");
  ASSERT_TRUE(result.evaluation.replay);
  expect_promise(robot.folder / "motors", *result.evaluation.replay);
}

TEST(TunedTwin, ReplaysAHeldOutLog) {
  const TunedRobot robot;
  cotwin::testing::SyntheticLog other = robot.log;
  other.duration = 16;
  other.seed = 7;
  other.write(robot.folder / "other.csv", robot.truth);
  Settings settings = robot.settings();
  settings.held_out = {robot.folder / "other.csv"};
  settings.method = Method::kFeasible;
  const Result result = robot.tune(settings, "other");
  ASSERT_TRUE(result.evaluation.replay);
  EXPECT_EQ(result.evaluation.replay->training.samples, 0u);
  EXPECT_EQ(result.evaluation.replay->held_out.samples, result.evaluation.held_out->samples);
  expect_promise(robot.folder / "other", *result.evaluation.replay);
}

struct RealLog {
  const char* name;
  std::string urdf, csv;
  bool motor, load;
  double cutoff, prior_weight;
};

TEST(TunedTwin, HasTheReportedErrorsOfRealRobots) {
  const std::string panda = places::public_data("measurements/panda_unisa.csv"),
                    ur10 = places::public_data("measurements/ur10_unisa.csv");
  if (!fs::exists(panda) || !fs::exists(ur10)) GTEST_SKIP() << "needs public measurements (scripts/fetch_logs.py)";
  const cotwin::testing::TemporaryFolder folder("real_twins");
  for (const RealLog& log :
       {RealLog{"panda", places::public_data("models/panda_franka_ros.urdf"), panda, false, false, 1.17, 10},
        RealLog{"ur10", places::source() + "/models/robots/ur10/robot.urdf", ur10, true, true, 2.1, 1}}) {
    for (const FrictionLaw law : {FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
      SCOPED_TRACE(std::string(log.name) + ", " + identification::to_text(law));
      Settings settings;
      settings.robot = log.urdf;
      settings.data = {log.csv};
      settings.method = Method::kFeasible;
      settings.model.friction = law;
      settings.model.motor_inertia = log.motor;
      settings.model.load = log.load;
      settings.cutoff = log.cutoff;
      settings.prior_weight = log.prior_weight;
      const Result result = tune(settings, {folder.path(), 1, {}}, {}, load_data(settings, {}));
      ASSERT_TRUE(result.evaluation.replay);
      expect_promise(folder.path(), *result.evaluation.replay);
    }
  }
}

}  // namespace
}  // namespace cotwin::master::tuning::tune_twin_test
