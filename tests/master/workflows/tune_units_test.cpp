// The units read the files of cotwin tune: the drive train finds robot.urdf and the drive_train.ssv beside it.
#include <gtest/gtest.h>

#include <algorithm>

#include "components/unit/snapshot.h"
#include "components/unit/unit_table.h"
#include "master/engine/wiring/members.h"
#include "master/scenario/scenario.h"
#include "master/twin/twin.h"
#include "models/foundation/formats/csv.h"
#include "models/identification/torque_data/motor_inertia.h"
#include "models/identification/torque_data/torque_model.h"
#include "tests/master/workflows/tune_fixture.h"
#include "tests/support/places.h"
#include "tests/support/run_program.h"

namespace cotwin::master::tuning::tune_units_test {
namespace {

using cotwin::testing::TunedRobot;
using identification::FrictionLaw;

TEST(TuneUnits, TheDriveTrainTakesEveryKindOfFrictionAndSteps) {
  const TunedRobot robot;
  for (const FrictionLaw law : {FrictionLaw::kNone, FrictionLaw::kCoulomb, FrictionLaw::kSigmoid, FrictionLaw::kStribeck}) {
    for (const bool motor : {true, false}) {
      SCOPED_TRACE(std::string(identification::to_text(law)) + (motor ? ", motor" : ", joint"));
      Settings settings = robot.settings();
      settings.method = Method::kFeasible;
      settings.model.friction = law;
      settings.model.motor_inertia = motor;
      const Result result = robot.tune(settings, "drive");
      const Instance drive =
          make_unit("unit:drive_train?robot=" + (robot.folder / "drive/robot.urdf").string(), {}, {}, unit_types());
      const auto& found = result.candidates[result.tuned].estimate.drive;
      const auto value = [&](const char* name, std::size_t j) { return drive.variables.at(name).reals()[j]; };
      for (std::size_t j = 0; j < 7; ++j) {
        EXPECT_EQ(value(motor ? "sigma2" : "link_sigma2", j), found[j].sigma2);
        if (motor && found[j].B > 0) {
          EXPECT_EQ(value("B", j), found[j].B);
        }
        // At speeds beyond presliding, the unit's friction for these parameters is the identified friction.
        const double v = 0.4, A = value("link_A", j);
        const double link =
            A / (1 + std::exp(-value("link_alpha", j) * (v + value("link_s", j)))) + value("link_k", j) +
            (value("link_tau_C", j) + std::max(0.0, value("link_tau_S", j) - value("link_tau_C", j)) *
                                          std::exp(-std::pow(v / value("link_v_S", j), value("link_delta", j)))) *
                std::tanh(v / value("link_v_R", j)) +
            value("link_tau_0", j) + value("link_sigma2", j) * v;
        const double fade = std::exp(-std::pow(v / value("v_S", j), value("delta", j)));
        const double of_motor =
            value("tau_C", j) + (value("tau_S", j) - value("tau_C", j)) * fade + value("tau_0", j) + value("sigma2", j) * v;
        EXPECT_NEAR(link + of_motor, found[j].friction(v), 1e-6) << j;
      }
      ASSERT_NO_THROW(drive.unit->initialise(Time{}));
      EXPECT_EQ(drive.unit->step(Time{}, Duration::from_seconds(1e-3)), StepResult::kDone);
    }
  }
}

// Noise decides whether a motor without inertia is identified as 0; then the unit's default would be 1 kg·m² too much.
TEST(TuneUnits, AMotorWithoutInertiaHasASmallOneInTheDriveTrain) {
  const TunedRobot robot;
  cotwin::testing::SyntheticLog log = robot.log;
  log.B = 0;
  log.write(robot.folder / "light.csv", robot.truth);
  Settings settings = robot.settings();
  settings.method = Method::kFeasible;
  settings.data = {robot.folder / "light.csv"};
  const Result result = robot.tune(settings, "light");
  const Instance drive =
      make_unit("unit:drive_train?robot=" + (robot.folder / "light/robot.urdf").string(), {}, {}, unit_types());
  const std::vector<double> least = identification::least_motor_inertia(robot::load_urdf(settings.robot));
  const auto& found = result.candidates[result.tuned].estimate.drive;
  EXPECT_TRUE(std::ranges::any_of(found, [](const identification::JointDrive& d) { return d.B == 0; }));
  for (std::size_t j = 0; j < 7; ++j) {
    EXPECT_GT(least[j], 0) << j;
    EXPECT_LT(least[j], 0.01) << j;
    EXPECT_EQ(drive.variables.at("B").reals()[j], std::max(found[j].B, least[j])) << j;
  }
  ASSERT_NO_THROW(drive.unit->initialise(Time{}));
}

TEST(TuneUnits, TheMotionUnitMovesAsAnExcitingMotionSays) {
  const cotwin::testing::TemporaryFolder folder("excite");
  const std::string file = (folder / "motion.csv").string();
  const auto excited = cotwin::testing::run_program(
      {"excite", "--robot", "lwr4", "--rounds", "5", "--particles", "8", "--quiet", "--out", file});
  ASSERT_EQ(excited.code, 0) << excited.err;
  const Instance motion =
      make_unit("unit:motion?robot=lwr4&kind=csv", {}, {std::filesystem::path(places::source()) / "models"}, unit_types());
  motion.variables.at("file").strings()[0] = file;
  motion.unit->initialise(Time{});
  const csv::Table table = csv::load(file);
  for (std::size_t row = 0; row < 2500; ++row) {
    for (std::size_t j = 0; j < 7; ++j) {
      ASSERT_NEAR(motion.variables.at("q_d").reals()[j], table.columns[1 + j][row], 1e-9) << row;
      // q̇ and q̈ of a quintic spline through samples 4 ms apart of sines below 0.5 Hz
      ASSERT_NEAR(motion.variables.at("dq_d").reals()[j], table.columns[8 + j][row], 1e-7) << row;
      ASSERT_NEAR(motion.variables.at("ddq_d").reals()[j], table.columns[15 + j][row], 1e-3) << row;
    }
    ASSERT_EQ(motion.unit->step(Time::from_seconds(0.004 * static_cast<double>(row)), Duration::from_seconds(0.004)),
              StepResult::kDone);
  }
}

// Example 05, where robot and twin run beside a tuner, as one unit: saved during the search and continued in another unit.
TEST(TuneUnits, ATwinWithATunerContinuesToTheSameBitsAfterRestoring) {
  Scenario scenario = load_scenario(places::source() + "/examples/05_maturation/twin.ssd");
  for (ComponentSpec& component : scenario.components) {
    if (component.name != "tuner") continue;
    component.start_values.push_back({"interval", 1.0, "s", "test"});
    component.start_values.push_back({"latency", 0.5, "s", "test"});
    component.start_values.push_back({"settle", 0.2, "s", "test"});
    component.start_values.push_back({"least_samples", std::int64_t{100}, "", "test"});
    component.start_values.push_back({"rounds", std::int64_t{50}, "", "test"});
  }
  const std::vector<std::filesystem::path> folders = {places::source() + "/examples/05_maturation",
                                                      places::source() + "/models"};
  struct Running {
    Running(const Scenario& scenario, const std::vector<std::filesystem::path>& folders)
        : twin(scenario, load_members(scenario, unit_types(), folders), {"twin.tau_J", "tuner.tunings"}) {
      twin.declare(variables);
      twin.initialise(Time{});
    }
    void run(int from, int to) {
      for (std::int64_t n = from; n < to; ++n)
        ASSERT_EQ(twin.step(Time{n * 1'000'000}, Duration{1'000'000}), StepResult::kDone) << n;
    }
    Snapshot save() {
      Snapshot snapshot;
      snapshot.take(variables, twin);
      return snapshot;
    }
    Twin twin;
    Variables variables;
  };
  Running one(scenario, folders);
  ASSERT_TRUE(one.twin.restorable());
  one.run(0, 1300);
  EXPECT_TRUE(one.variables.at("tuner.estimating").booleans()[0]);
  const Snapshot middle = one.save();
  one.run(1300, 2700);
  EXPECT_EQ(one.variables.at("tuner.tunings").integers()[0], 2);
  const Snapshot end = one.save();

  Running fresh(scenario, folders);
  Snapshot::deserialise(middle.serialise()).restore(fresh.variables, fresh.twin);
  fresh.run(1300, 2700);
  EXPECT_EQ(fresh.save(), end);

  middle.restore(one.variables, one.twin);  // and back in the same one
  one.run(1300, 2700);
  EXPECT_EQ(one.save(), end);
}

}  // namespace
}  // namespace cotwin::master::tuning::tune_units_test
