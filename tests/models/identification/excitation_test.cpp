// Exciting motions: at rest at their ends, within limits, better conditioned than random ones, the same for the same seed.
#include "models/identification/excitation/design.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "models/foundation/support/error.h"
#include "models/foundation/support/threads.h"
#include "models/robot/dynamics.h"
#include "models/robot/urdf/urdf.h"
#include "tests/support/places.h"

namespace cotwin::excitation::excitation_test {
namespace {

robot::RobotModel lwr4() { return robot::load_urdf(places::source() + "/models/robots/lwr4/robot.urdf"); }

DesignOptions quick() {
  DesignOptions options;
  options.rounds = 10;
  options.particles = 16;
  return options;
}

TEST(FourierSeries, VelocityAndAccelerationAreDerivativesOfThePosition) {
  FourierSeries series{1, 3, 4.0, {0.3, -0.2, 0.5}, {0.1, 0.7, -0.4}, {0.2}};
  const double h = 1e-4;
  for (const double t : {0.3, 1.1, 2.9}) {
    const auto at = series.at(0, t), before = series.at(0, t - h), after = series.at(0, t + h);
    EXPECT_NEAR(at.dq, (after.q - before.q) / (2 * h), 1e-7);  // h² q⃛/6 with q⃛ < 20
    EXPECT_NEAR(at.ddq, (after.dq - before.dq) / (2 * h), 1e-6);
  }
}

TEST(FourierSeries, RestsWhereItBeginsAndEndsAfterBringToRest) {
  FourierSeries series{1, 5, 10.0, {0.3, -0.2, 0.5, 1, 2}, {0.1, 0.7, -0.4, 3, 1}, {0.2}};
  bring_to_rest(series.a, series.b);
  for (const double t : {0.0, 10.0, 20.0}) {
    const auto at = series.at(0, t);
    EXPECT_NEAR(at.q, 0.2, 1e-13);
    EXPECT_NEAR(at.dq, 0, 1e-13);
    EXPECT_NEAR(at.ddq, 0, 1e-12);
  }
  const std::vector<double> a = series.a, b = series.b;
  bring_to_rest(series.a, series.b);  // joints at rest stay at rest
  for (std::size_t l = 0; l < 5; ++l) {
    EXPECT_NEAR(series.a[l], a[l], 1e-15);
    EXPECT_NEAR(series.b[l], b[l], 1e-15);
  }
}

TEST(Excitation, StaysWithinItsShareOfEveryLimitBetweenSamplesToo) {
  const robot::RobotModel robot = lwr4();
  DesignOptions options = quick();
  options.share = 0.8;
  options.ddq_max = 4;
  const Design design = design_excitation(robot, options);
  const robot::Mechanism mechanism(robot);
  robot::Data data(mechanism);
  Eigen::VectorXd q(7), dq(7), ddq(7), tau(7);
  for (int k = 0; k <= 20011; ++k) {  // a grid that has no sample in common with the design's
    const double t = 10.0 * k / 20011;
    for (int j = 0; j < 7; ++j) {
      const auto at = design.series.at(static_cast<std::size_t>(j), t);
      q[j] = at.q;
      dq[j] = at.dq;
      ddq[j] = at.ddq;
    }
    robot::inverse_dynamics(mechanism, data, q, dq, ddq, tau);
    for (int j = 0; j < 7; ++j) {
      const robot::Joint& joint = robot.joints[static_cast<std::size_t>(j)];
      EXPECT_LE(std::abs(q[j] - 0.5 * (joint.q_min + joint.q_max)), 0.8 * 0.5 * (joint.q_max - joint.q_min) + 1e-12);
      EXPECT_LE(std::abs(dq[j]), 0.8 * joint.dq_max);
      EXPECT_LE(std::abs(ddq[j]), 0.8 * 4);
      EXPECT_LE(std::abs(tau[j]), joint.tau_max);
    }
  }
  for (const Margins& m : design.margins) EXPECT_LE(std::max({m.q, m.dq, m.ddq}), 0.8 + 1e-9);
}

TEST(Excitation, ExcitesEveryBaseParameterAndGetsBetterByTheRounds) {
  const Design design = design_excitation(lwr4(), quick());
  EXPECT_EQ(design.base, 43);  // of an arm of seven joints on a fixed base
  EXPECT_EQ(design.rank, 43);
  EXPECT_LT(design.condition, 200);
  EXPECT_LT(design.cost_history.back(), design.cost_history.front() - 0.05);         // decades
  EXPECT_NEAR(design.cost_history.back() - 20, std::log10(design.condition), 0.01);  // evaluated on a finer grid at the end
}

TEST(Excitation, TheDeterminantCriterionGivesTheGreaterDeterminant) {
  DesignOptions options = quick();
  const Design condition = design_excitation(lwr4(), options);
  options.criterion = Criterion::kDeterminant;
  const Design determinant = design_excitation(lwr4(), options);
  EXPECT_GT(determinant.log_determinant, condition.log_determinant);
}

TEST(Excitation, IsTheSameForTheSameSeedOnAnyNumberOfThreads) {
  const DesignOptions options = quick();
  numerics::Threads threads(4);
  const Design one = design_excitation(lwr4(), options), four = design_excitation(lwr4(), options, &threads);
  EXPECT_EQ(one.series.a, four.series.a);
  EXPECT_EQ(one.series.b, four.series.b);
  EXPECT_EQ(one.series.q_start, four.series.q_start);
  DesignOptions other = options;
  other.seed = 2;
  EXPECT_NE(one.series.a, design_excitation(lwr4(), other).series.a);
}

TEST(Excitation, NarrowerPositionLimitsAreKeptAndLimitsWithoutRoomAreAnError) {
  DesignOptions options = quick();
  options.q_min.assign(7, -0.3);
  options.q_max.assign(7, 0.2);
  const Design design = design_excitation(lwr4(), options);
  for (std::size_t j = 0; j < 7; ++j) {
    for (int k = 0; k < 1000; ++k) {
      const double q = design.series.at(j, 0.01 * k).q;
      EXPECT_GE(q, -0.3);
      EXPECT_LE(q, 0.2);
    }
  }
  options.q_max[3] = -0.4;
  EXPECT_THROW(
      {
        try {
          design_excitation(lwr4(), options);
        } catch (const Error& error) {
          EXPECT_THAT(error.what(), ::testing::HasSubstr("joint_4: may move from -0.3 to -0.4, expected room"));
          throw;
        }
      },
      Error);
}

TEST(Excitation, TorquesThatTheRobotDoesNotHaveAreAnError) {
  robot::RobotModel weak = lwr4();
  weak.joints[1].tau_max = 1;  // its own weight needs 47 N.m
  EXPECT_THROW(design_excitation(weak, quick()), Error);
}

}  // namespace
}  // namespace cotwin::excitation::excitation_test
