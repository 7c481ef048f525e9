// Clocks in Co-Simulation: fmus/clocks3.c checks that each of its clocks ticks at the right time, and returns an error
// otherwise.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>

#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/allocations.h"

namespace cotwin::fmu::clocks_test {
namespace {

using namespace testing;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::ThrowsMessage;

class Clocks : public ::testing::Test {
 protected:
  Instance load_clocks(const LoadOptions& options = {}, const Edits& edits = {}) {
    return load(make_fmu("clocks3", folder_.path(), edits), options);
  }
  static bool ticked(const Instance& instance, const char* clock) { return instance.variables.at(clock).booleans()[0]; }
  static std::vector<std::int32_t> counts(const Instance& instance) {
    const auto all = instance.variables.at("counts").integers();
    return {all.begin(), all.end()};
  }
  TemporaryFolder folder_;
};

TEST_F(Clocks, AreBooleansOfTheUnit) {
  const Instance instance = load_clocks();
  EXPECT_THAT(instance.warnings, IsEmpty());
  for (const char* name : {"sample", "fixed", "tuned", "growing", "alarm"}) {
    EXPECT_EQ(instance.variables.at(name).kind(), Kind::kBoolean) << name;
    EXPECT_EQ(instance.variables.at(name).role, Role::kState) << name;
  }
  EXPECT_EQ(instance.variables.at("kick").role, Role::kInput);
  EXPECT_EQ(instance.variables.at("full").role, Role::kOutput);
}

// sample: 0.05 + 0.1 k ≤ 1; fixed: 0.25 k; tuned: 0.2 k; growing: 0.1 k(k + 1)/2; alarm: after samples 3, 6 and 9.
TEST_F(Clocks, TickAtTheirTimesWhateverTheStep) {
  for (const double h : {0.01, 0.05, 0.1, 0.25, 1.0, 0.007}) {
    Instance instance = load_clocks();
    instance.unit->initialise({});
    EXPECT_THAT(counts(instance), ElementsAre(0, 1, 1, 0, 0, 0)) << h;  // at the start already
    const int n = static_cast<int>(1.0 / h);
    for (int i = 0; i < n; ++i) ASSERT_EQ(step(instance, i * h, h), StepResult::kDone) << h;
    if (n * h < 1) {
      ASSERT_EQ(step(instance, n * h, 1 - n * h), StepResult::kDone) << h;
    }
    EXPECT_THAT(counts(instance), ElementsAre(10, 5, 6, 4, 3, 0)) << h;
  }
}

TEST_F(Clocks, ReportWhichTickedInTheLastStep) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  EXPECT_TRUE(ticked(instance, "fixed"));
  EXPECT_FALSE(ticked(instance, "sample"));
  EXPECT_EQ(step(instance, 0, 0.05), StepResult::kDone);
  EXPECT_FALSE(ticked(instance, "fixed"));
  EXPECT_TRUE(ticked(instance, "sample"));
  EXPECT_EQ(step(instance, 0.05, 0.05), StepResult::kDone);
  EXPECT_FALSE(ticked(instance, "sample"));
  EXPECT_TRUE(ticked(instance, "growing"));
}

TEST_F(Clocks, ExchangeTheirVariablesWhenTheyTick) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  double expected = 0;
  for (int i = 0; i < 10; ++i) {  // one sample in the middle of each step
    real(instance, "u") = i + 1;
    expected += i + 1;
    ASSERT_EQ(step(instance, i * 0.1, 0.1), StepResult::kDone);
    EXPECT_EQ(real(instance, "sum"), expected);
    const bool fourth = (i + 1) % 4 == 0;
    EXPECT_EQ(ticked(instance, "full"), fourth);
    if (fourth) {
      EXPECT_NEAR(real(instance, "full_at"), 0.1 * i + 0.05, 1e-12);
    }
  }
}

TEST_F(Clocks, AreTriggeredByABooleanInput) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  real(instance, "push") = 2;
  EXPECT_EQ(step(instance, 0, 0.01), StepResult::kDone);
  EXPECT_EQ(real(instance, "pushed"), 0);
  instance.variables.at("kick").booleans()[0] = true;
  EXPECT_EQ(step(instance, 0.01, 0.01), StepResult::kDone);
  real(instance, "push") = 3;
  EXPECT_EQ(step(instance, 0.02, 0.01), StepResult::kDone);
  instance.variables.at("kick").booleans()[0] = false;
  EXPECT_EQ(step(instance, 0.03, 0.01), StepResult::kDone);
  EXPECT_EQ(real(instance, "pushed"), 5);
  EXPECT_EQ(counts(instance)[5], 2);
}

// The new interval starts at the event in which it was set: 0, 0.2 s, then 0.3 + 0.05 k.
TEST_F(Clocks, ContinueWithANewIntervalOfATunableClock) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.3, 0.1), StepResult::kDone);
  EXPECT_EQ(counts(instance)[2], 2);
  real(instance, "period") = 0.05;
  EXPECT_EQ(step(instance, 0.3, 0.1), StepResult::kDone);
  EXPECT_EQ(counts(instance)[2], 4);
}

TEST_F(Clocks, RefuseAnIntervalThatGoesBack) {
  Instance instance = load_clocks();
  real(instance, "longest_interval") = 0.2;  // then the FMU returns −1 s
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.2, 0.1), StepResult::kDone);
  EXPECT_THAT([&] { (void)step(instance, 0.2, 0.1); },
              ThrowsMessage<Error>(HasSubstr("clock 'growing': interval -1 s at 0.3 s")));
}

TEST_F(Clocks, ContinueInAFreshInstanceFromASnapshotsBytes) {
  Instance one = load_clocks(), other = load_clocks();
  one.unit->initialise({});
  real(one, "u") = 1;
  ASSERT_EQ(run(one, 0, 0.36, 0.01), StepResult::kDone);  // during the countdown and every interval
  Snapshot snapshot;
  snapshot.take(one.variables, *one.unit);
  Snapshot::deserialise(snapshot.serialise()).restore(other.variables, *other.unit);
  for (Instance* instance : {&one, &other}) {
    for (int i = 36; i < 100; ++i) ASSERT_EQ(step(*instance, i * 0.01, 0.01), StepResult::kDone);
    EXPECT_THAT(counts(*instance), ElementsAre(10, 5, 6, 4, 3, 0));
    EXPECT_EQ(real(*instance, "sum"), 10);
  }
}

TEST_F(Clocks, TickInAProcessOfTheirOwn) {
  LoadOptions options;
  options.process = ProcessChoice::kOwn;
  Instance instance = load_clocks(options);
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
  EXPECT_THAT(counts(instance), ElementsAre(10, 5, 6, 4, 3, 0));
  EXPECT_FALSE(ticked(instance, "sample") && ticked(instance, "alarm"));
}

TEST_F(Clocks, AreReportedAfterTheRun) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
  std::vector<std::string> notes;
  instance.unit->append_notes(notes);
  EXPECT_THAT(notes, Contains("28 ticks of its input clocks"));
}

TEST_F(Clocks, DoNotTickWithoutEventModeAndReportIt) {
  const Instance instance = load_clocks({}, {{" hasEventMode=\"true\"", ""}});
  EXPECT_THAT(instance.warnings, Contains(HasSubstr("tick only in Co-Simulation with event mode")));
}

TEST_F(Clocks, AllocateNothingInAStep) {
  Instance instance = load_clocks();
  instance.unit->initialise({});
  for (int i = 0; i < 50; ++i) ASSERT_EQ(step(instance, i * 0.01, 0.01), StepResult::kDone);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int i = 50; i < 100; ++i) (void)step(instance, i * 0.01, 0.01);
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

TEST_F(Clocks, OfScheduledExecutionOnlyAreAnError) {
  const Edits edits = {
      {"<CoSimulation modelIdentifier=\"clocks\" canHandleVariableCommunicationStepSize=\"true\" "
       "canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" hasEventMode=\"true\" "
       "mightReturnEarlyFromDoStep=\"false\"/>",
       "<ScheduledExecution modelIdentifier=\"clocks\"/>"}};
  EXPECT_THAT([&] { load_clocks({}, edits); },
              ThrowsMessage<Error>(HasSubstr("the FMU offers Scheduled Execution, expected Co-Simulation")));
}

}  // namespace
}  // namespace cotwin::fmu::clocks_test
