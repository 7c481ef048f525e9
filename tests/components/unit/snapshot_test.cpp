#include "components/unit/snapshot.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <random>

#include "models/foundation/support/error.h"

namespace cotwin::snapshot_test {
namespace {

/// Counts its steps; stores a word.
class Counter final : public Unit {
 public:
  explicit Counter(std::size_t n = 2) : values(n) {}
  void declare(Variables& v) override {
    v.input("u", input, "m", "what is added in a step").rate(rate);
    v.state("values", values, "m", "the sums so far");
    v.state("steps", steps, "number of steps so far");
    v.state("odd", odd, "whether that number is odd");
    v.state("word", word, "a text");
  }
  void initialise(Time) override { steps = 0; }
  StepResult step(Time, Duration) override {
    for (double& value : values) value += input + rate;
    odd = ++steps % 2 != 0;
    return StepResult::kDone;
  }
  void restored() override { ++restores; }

  double input = 0, rate = 0;
  std::vector<double> values;
  std::int32_t steps = 0;
  bool odd = false;
  std::string word;
  int restores = 0;
};

TEST(Snapshot, BringsBackEveryKindOfValue) {
  Counter unit;
  Variables variables;
  unit.declare(variables);
  unit.input = 0.1;
  unit.rate = 0.2;
  unit.word = "before";
  (void)unit.step({}, {});
  Snapshot snapshot;
  snapshot.take(variables);

  unit.input = unit.rate = 9;
  unit.word = "after, and longer than it was before";
  (void)unit.step({}, {});
  snapshot.restore(variables, unit);
  EXPECT_EQ(unit.input, 0.1);
  EXPECT_EQ(unit.rate, 0.2);
  EXPECT_EQ(unit.values[0], 0.1 + 0.2);
  EXPECT_EQ(unit.steps, 1);
  EXPECT_TRUE(unit.odd);
  EXPECT_EQ(unit.word, "before");
  EXPECT_EQ(unit.restores, 1);
}

TEST(Snapshot, ReadsBackFromItsBytes) {
  Counter unit;
  Variables variables;
  unit.declare(variables);
  unit.word = "grüezi";
  (void)unit.step({}, {});
  Snapshot snapshot;
  snapshot.take(variables);
  EXPECT_EQ(Snapshot::deserialise(snapshot.serialise()), snapshot);
}

TEST(Snapshot, RefusesAUnitWithOtherVariables) {
  Counter two(2), three(3);
  Variables of_two, of_three;
  two.declare(of_two);
  three.declare(of_three);
  Snapshot snapshot;
  snapshot.take(of_two);
  EXPECT_THROW(snapshot.restore(of_three, three), Error);
  EXPECT_EQ(three.restores, 0);
}

TEST(Snapshot, RefusesBytesThatAreCutShortOrDamaged) {
  Counter unit;
  Variables variables;
  unit.declare(variables);
  unit.word = "word";
  Snapshot snapshot;
  snapshot.take(variables);
  const std::string whole = snapshot.serialise();
  for (std::size_t n = 0; n < whole.size(); ++n) {
    EXPECT_THROW(Snapshot::deserialise(whole.substr(0, n)), Error) << n << " bytes of " << whole.size();
  }
  std::mt19937 random(1);
  for (int i = 0; i < 10000; ++i) {
    std::string damaged = whole;
    damaged[random() % damaged.size()] = static_cast<char>(random());
    try {
      const Snapshot read = Snapshot::deserialise(damaged);
      Counter fresh;
      Variables of_fresh;
      fresh.declare(of_fresh);
      read.restore(of_fresh, fresh);  // values may differ, the layout may not
    } catch (const Error&) {
    }
  }
}

}  // namespace
}  // namespace cotwin::snapshot_test
