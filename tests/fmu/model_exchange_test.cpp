// The model of fmus/ball.h, integrated by Cotwin, in both versions of FMI; its solutions are closed forms.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>

#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/allocations.h"

namespace cotwin::fmu::model_exchange_test {
namespace {

using namespace testing;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

constexpr double kTolerance = 1e-8;

/// Height at time t of a ball dropped from 1 m, and the number of bounces before.
std::pair<double, int> ball(double t, double g, double e) {
  double bounce = std::sqrt(2 / g), v = std::sqrt(2 * g);  // first impact, and its speed
  if (t < bounce) return {1 - 0.5 * g * t * t, 0};
  for (int n = 1;; ++n) {
    v *= e;
    const double flight = 2 * v / g;
    if (t < bounce + flight) {
      const double dt = t - bounce;
      return {v * dt - 0.5 * g * dt * dt, n};
    }
    bounce += flight;
  }
}

class ModelExchange : public ::testing::TestWithParam<const char*> {
 protected:
  Instance load_ball(const Edits& edits = {}) {
    LoadOptions options;
    options.tolerance = kTolerance;
    options.rollback = true;  // the states stay in the FMU
    return load(make_fmu(GetParam(), folder_.path(), edits), options);
  }
  TemporaryFolder folder_;
};

TEST_P(ModelExchange, FindsTheImpactsOfABall) {
  Instance instance = load_ball();
  instance.unit->initialise({});
  EXPECT_EQ(real(instance, "h"), 1);
  EXPECT_EQ(real(instance, "der(v)"), -9.81);
  for (int i = 0; i < 40; ++i) {
    ASSERT_EQ(step(instance, i * 0.05, 0.05), StepResult::kDone);
    const auto [h, bounces] = ball((i + 1) * 0.05, 9.81, 0.7);
    EXPECT_NEAR(real(instance, "h"), h, 1e-5) << i;  // an impact that is detected late by δ has an error of v δ
    EXPECT_EQ(integer(instance, "bounces"), bounces) << i;
  }
  EXPECT_GE(integer(instance, "bounces"), 3);
}

TEST_P(ModelExchange, StopsAtTimeEventsAndHandlesTheStepEventsThatAreAskedFor) {
  Instance instance = load_ball();
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 1.7, 0.34), StepResult::kDone);
  EXPECT_EQ(integer(instance, "ticks"), 6);                             // 0.25 … 1.5 s
  EXPECT_EQ(integer(instance, "asked"), integer(instance, "bounces"));  // once per rise
}

// x' = k (u − x), x(0) = 0
TEST_P(ModelExchange, FollowsALinearSystemThroughJumpsAndRampsOfItsInput) {
  Instance instance = load_ball();
  instance.unit->initialise({});
  const double k = 2;
  double x = 0;
  for (int i = 0; i < 100; ++i) {
    const double h = 0.01;
    const double u = i < 50 ? 1.0 : -3.0, rate = i < 25 ? 0.0 : 10.0;
    real(instance, "u") = u + (i < 25 ? 0 : (i % 25) * h * rate);
    instance.variables.at("u").rate[0] = rate;
    const double u0 = real(instance, "u");
    ASSERT_EQ(step(instance, i * h, h), StepResult::kDone);
    // Particular solution u0 − r/k + r t, homogeneous part from x(0).
    x = (x - u0 + rate / k) * std::exp(-k * h) + u0 - rate / k + rate * h;
    ASSERT_NEAR(real(instance, "x"), x, 1e-6) << i;
  }
}

TEST_P(ModelExchange, TakesStartValuesAndParametersAndBeginsAfresh) {
  Instance instance = load_ball();
  real(instance, "h") = 0.5;
  real(instance, "g") = 1.62;
  for (int round = 0; round < 2; ++round) {
    instance.unit->initialise({});
    EXPECT_EQ(real(instance, "h"), 0.5) << round;
    EXPECT_EQ(run(instance, 0, 0.5, 0.1), StepResult::kDone);
    EXPECT_NEAR(real(instance, "h"), 0.5 - 0.5 * 1.62 * 0.25, 1e-7);
  }
  real(instance, "h") = 0.8;
  instance.unit->initialise({});
  EXPECT_EQ(real(instance, "h"), 0.8);
}

TEST_P(ModelExchange, ContinuesEquallyAfterTakingAndRestoringASnapshot) {
  Instance instance = load_ball();
  instance.unit->initialise({});
  real(instance, "u") = 1;
  ASSERT_EQ(run(instance, 0, 0.4, 0.01), StepResult::kDone);
  Snapshot snapshot;
  snapshot.take(instance.variables, *instance.unit);
  real(instance, "u") = 2;
  ASSERT_EQ(run(instance, 0.4, 1, 0.01), StepResult::kDone);
  const double h = real(instance, "h"), x = real(instance, "x");
  snapshot.restore(instance.variables, *instance.unit);
  EXPECT_LT(real(instance, "x"), x);
  real(instance, "u") = 2;
  ASSERT_EQ(run(instance, 0.4, 1, 0.01), StepResult::kDone);
  EXPECT_EQ(real(instance, "h"), h);
  EXPECT_EQ(real(instance, "x"), x);
}

TEST_P(ModelExchange, DoesNotDependOnHowManyCommunicationStepsThereAre) {
  Instance fine = load_ball(), coarse = load_ball();
  fine.unit->initialise({});
  coarse.unit->initialise({});
  ASSERT_EQ(run(fine, 0, 1.5, 1e-3), StepResult::kDone);
  ASSERT_EQ(run(coarse, 0, 1.5, 0.5), StepResult::kDone);
  EXPECT_NEAR(real(fine, "h"), real(coarse, "h"), 1e-6);
  EXPECT_EQ(integer(fine, "bounces"), integer(coarse, "bounces"));
}

TEST_P(ModelExchange, IsAnErrorWhereTheFmuFailsOrNeverEndsItsEvents) {
  Instance wrong = load_ball();
  integer(wrong, "mode") = 1;
  wrong.unit->initialise({});
  EXPECT_THAT([&] { (void)run(wrong, 0, 1, 0.1); }, ThrowsMessage<Error>(HasSubstr("returned error")));
  EXPECT_THAT([&] { (void)run(wrong, 0, 1, 0.1); }, ThrowsMessage<Error>(HasSubstr("has failed")));
  Instance endless = load_ball();
  integer(endless, "mode") = 2;
  EXPECT_THAT([&] { endless.unit->initialise({}); }, ThrowsMessage<Error>(HasSubstr("did not converge in")));
}

TEST_P(ModelExchange, AllocatesNothingInAStep) {
  Instance instance = load_ball();
  instance.unit->initialise({});
  ASSERT_EQ(run(instance, 0, 0.1, 0.01), StepResult::kDone);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int i = 10; i < 100; ++i) {
    real(instance, "u") = i;
    (void)step(instance, i * 0.01, 0.01);
  }
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

INSTANTIATE_TEST_SUITE_P(Versions, ModelExchange, ::testing::Values("ball2", "ball3"),
                         [](const auto& subject) { return subject.param; });

TEST(ModelExchangeOfFmi3, RefusesTooManyStates) {
  TemporaryFolder folder;
  Instance instance = load(make_fmu("ball3", folder.path()));
  integer(instance, "mode") = 3;
  EXPECT_THAT([&] { instance.unit->initialise({}); }, ThrowsMessage<Error>(HasSubstr("1099511627776 states")));
}

}  // namespace
}  // namespace cotwin::fmu::model_exchange_test
