#include "master/engine/events.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "tests/master/test_units.h"
#include "tests/support/growth.h"

namespace cotwin::master::events_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::HasSubstr;

/// The variable's value after each tick.
std::vector<double> follow(const Build& b, const std::string& variable) {
  Master master = b.load();
  master.initialise();
  std::vector<double> seen;
  while (master.step_tick()) seen.push_back(value(master, variable));
  return seen;
}

TEST(Events, JumpAtExactlyTheirTick) {
  Build b;
  b.unit("a", "gain").event(0.003, "a.u", "2").event(0.006, "a.gain", "-1").event(0.0075, "a.u", "5");
  EXPECT_EQ(follow(b, "a.y"), (std::vector<double>{0, 0, 0, 2, 2, 2, -2, -2, -5, -5}));
}

TEST(Events, RampFromTheValueThatTheyFindToExactlyTheTarget) {
  Build b;
  b.unit("a", "gain").with("u", 1.0).event(0.002, "a.u", "5", 0.004);
  EXPECT_EQ(follow(b, "a.y"), (std::vector<double>{1, 1, 1, 2, 3, 4, 5, 5, 5, 5}));
}

TEST(Events, ALaterEventTakesOverOnlyItsElements) {
  Build b;
  b.unit("a", "gain?n=2").event(0.0, "a.u", "8", 0.008).event(0.004, "a.u[2]", "100");
  EXPECT_EQ(follow(b, "a.y[1]"), (std::vector<double>{0, 1, 2, 3, 4, 5, 6, 7, 8, 8}));
  EXPECT_EQ(follow(b, "a.y[2]"), (std::vector<double>{0, 1, 2, 3, 100, 100, 100, 100, 100, 100}));
}

TEST(Events, ARampIsExactForAnInputThatIsFollowedWithinTheStep) {
  // u = 1000·t from 2 ms to 5 ms, then 3: ∫u = 4.5e-3 + 3·5e-3 at 10 ms.
  Build b;
  b.unit("a", "ramped").event(0.002, "a.u", "3", 0.003);
  EXPECT_NEAR(follow(b, "a.y").back(), 4.5e-3 + 15e-3, 1e-15);
}

TEST(Events, ReachEveryKind) {
  Build b;
  b.unit("m", "mixed").event(0.002, "m.integer", "-7").event(0.002, "m.boolean", "true").event(0.002, "m.string", "on, and on");
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) {
  }
  EXPECT_EQ(value(master, "m.integer_out"), -7);
  EXPECT_EQ(value(master, "m.boolean_out"), 1);
  EXPECT_EQ(find_signal(master.members(), "m.string_out", "").variable->strings()[0], "on, and on");
}

TEST(Events, AreRefusedForVariablesThatCannotChange) {
  const auto refusal = [](const std::string& variable, const std::string& value, double ramp = 0) {
    Build b;
    b.unit("a", "gain?n=3").unit("b", "gain?n=3").unit("m", "mixed").connect("a.y", "b.u").event(0.1, variable, value, ramp);
    return error_of([&] { b.load(); });
  };
  EXPECT_THAT(refusal("b.u", "1"), HasSubstr("test.ssd:60: event on 'b.u', which a connection feeds"));
  EXPECT_THAT(refusal("a.y", "1"), HasSubstr("expected an input or a tunable parameter"));
  EXPECT_THAT(refusal("a.bias", "1"), HasSubstr("expected an input or a tunable parameter"));
  EXPECT_THAT(refusal("a.gain", "2e6"), HasSubstr("a.gain = 2e+06, expected -1e+06 to 1e+06"));
  EXPECT_THAT(refusal("a.gain", "nan"), HasSubstr("a.gain = nan, expected"));
  EXPECT_THAT(refusal("a.u", "1,2"), HasSubstr("test.ssd:60"));
  EXPECT_THAT(refusal("m.integer", "1", 0.5), HasSubstr("a ramp needs a real variable"));
  EXPECT_THAT(refusal("a.uu", "1"), HasSubstr("did you mean"));
}

// With a linear search over events, connections or components this would take hours.
TEST(Events, TheTimeTheyTakeGrowsWithTheirNumberAndNotWithItsSquare) {
  constexpr int kUnits = 1000;
  const double ratio = testing::growth(25'000, [](int events) {
    Build b;
    for (int i = 0; i < kUnits; ++i) b.unit("a" + std::to_string(i), "gain").unit("b" + std::to_string(i), "gain");
    for (int i = 0; i < kUnits; ++i) b.connect("b" + std::to_string(i) + ".y", "b" + std::to_string((i + 1) % kUnits) + ".u");
    for (int i = 0; i < events; ++i) {
      const double time = 0.009 * i / events;
      b.event(time, "a" + std::to_string(i % kUnits) + ".u", std::to_string(i), i % 3 == 0 ? 1.0 : 0.0);
    }
    EXPECT_EQ(follow(b, "a" + std::to_string(kUnits - 2) + ".u").back(), events - 2);
  });
  EXPECT_LT(ratio, 8);
}

TEST(Events, ARampThatALaterOneReplacedDoesNotResume) {
  Build b;
  b.unit("a", "gain")
      .event(0.0, "a.u", "8", 0.008)
      .event(0.002, "a.u", "100", 0.004)
      .event(0.004, "a.u", "1")
      .event(0.004, "a.gain", "2");
  EXPECT_EQ(follow(b, "a.u"), (std::vector<double>{0, 1, 1, 25.75, 1, 1, 1, 1, 1, 1}));
}

}  // namespace
}  // namespace cotwin::master::events_test
