#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "fmu/import/watched_calls.h"
#include "tests/fmu/foreign.h"
#include "tests/support/error_of.h"

// Callbacks of FMUs that do not pass back the environment that they were given, as those of Overture and Maestro do not, and what
// is known of calls into FMUs that damage memory.
namespace cotwin::fmu::callbacks_test {
namespace {

using namespace cotwin::fmu::testing;
using cotwin::testing::error_of;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

enum { kError2 = 1, kFlood2 = 4, kRefusesUpdates3 = 6 };  // modes of rogue2.c and rogue3.c

class StrayEnvironment : public ::testing::TestWithParam<const char*> {
 protected:
  StrayEnvironment() { setenv("COTWIN_STRAY", GetParam(), 1); }
  ~StrayEnvironment() override { unsetenv("COTWIN_STRAY"); }
  Instance load_named(const std::string& fmu, const std::string& name, int mode) {
    LoadOptions options;
    options.instance_name = name;
    Instance instance = load(make_fmu(fmu, folder_.path(), edits_), options);
    integer(instance, "mode") = mode;
    instance.unit->initialise({});
    return instance;
  }
  Edits edits_;
  TemporaryFolder folder_;
};

// The instance is found by the call that its thread makes, or by its name.
TEST_P(StrayEnvironment, StillBringsMessagesToTheInstanceThatLogs) {
  Instance noisy = load_named("rogue2", "noisy", kFlood2), failing = load_named("rogue2", "failing", kError2);
  EXPECT_EQ(step(noisy, 0, 0.001), StepResult::kDone);
  EXPECT_THAT(error_of([&] { (void)step(failing, 0, 1); }),
              AllOf(HasSubstr("[error, logStatusError] the sum does not converge"), Not(HasSubstr("drops"))));
}

TEST_P(StrayEnvironment, StillBringsTheReasonOfARefusedInstance) {
  const Instance other = load_named("rogue2", "other", 0);
  EXPECT_THAT(error_of([&] { load_named("rogue2", "refused", 0); }),
              AllOf(HasSubstr("fmi2Instantiate returned no instance"), HasSubstr("100% sure")));
}

// Without the instance the slope of u would be lost: x' = u, u = t.
TEST_P(StrayEnvironment, StillSetsInputsInIntermediateUpdates) {
  Instance other = load_named("rogue3", "other", 0), instance = load_named("rogue3", "ramped", 0);
  instance.variables.at("u").rate[0] = 1;
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDone);
  EXPECT_NEAR(instance.variables.at("y").reals()[0], 0.005, 1e-15);
  EXPECT_EQ(other.variables.at("y").reals()[0], 0);
}

TEST_P(StrayEnvironment, StillBringsTheErrorOfAnIntermediateUpdate) {
  const Instance other = load_named("rogue3", "other", 0);
  edits_ = {{"providesIntermediateUpdate=\"true\"",
             "providesIntermediateUpdate=\"true\" canReturnEarlyAfterIntermediateUpdate=\"true\""}};
  Instance instance = load_named("rogue3", "refusing", kRefusesUpdates3);
  instance.variables.at("u").rate[0] = 1;
  EXPECT_THAT(error_of([&] { (void)step(instance, 0, 0.1); }), HasSubstr("u is not to my liking"));
}

INSTANTIATE_TEST_SUITE_P(Kinds, StrayEnvironment, ::testing::Values("null", "1", "2", "thread"),
                         [](const auto& kind) { return "of_" + std::string(kind.param); });

// An FMU may damage the memory of the process it is in: pointers to names that its watching process finds lead nowhere.
TEST(WatchedCalls, NameOnlyWhatWasStored) {
  WatchedCalls* const calls = WatchedCalls::make();  // for as long as this thread
  ASSERT_NE(calls, nullptr);
  calls->begin();
  const CallPlace place{"pump.fmu", "pump"};
  calls->add(place);
  const char* const step = known_function("fmi2DoStep");
  set_call_place(place, 500'000'000);
  const char* const wild = reinterpret_cast<const char*>(0x7878787878787878);
  under_way().function = step;
  EXPECT_EQ(calls->last_calls(), "component 'pump' at t = 0.5 s: pump.fmu: fmi2DoStep");
  under_way().function = wild;
  EXPECT_EQ(calls->last_calls(), "component 'pump' at t = 0.5 s: pump.fmu");
  under_way().place = reinterpret_cast<const CallPlace*>(wild);
  EXPECT_EQ(calls->last_calls(), "");
  under_way() = {};
  EXPECT_EQ(calls->last_calls(), "");
  watched_calls = nullptr;
  watched_call = nullptr;
}

}  // namespace
}  // namespace cotwin::fmu::callbacks_test
