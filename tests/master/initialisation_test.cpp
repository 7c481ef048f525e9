#include "master/run/initialisation.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/master/test_units.h"

namespace cotwin::master {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(Initialisation, PropagatesValuesAlongAChainInAnyFileOrder) {
  Build b;
  b.unit("d", "gain").unit("c", "gain").unit("b", "gain").unit("a", "gain").with("bias", 3.0);
  b.connect("a.y", "b.u").connect("b.y", "c.u").connect("c.y", "d.u");
  Master master = b.load();
  master.initialise();
  EXPECT_EQ(value(master, "d.y"), 3);
  EXPECT_EQ(master.summary().initialisation.rounds, 1);  // in the order of the flow
  EXPECT_THAT(master.summary().initialisation.loop, IsEmpty());
}

TEST(Initialisation, ALoopWithAStateIsNotAlgebraic) {
  Build b;
  b.unit("g", "gain").with("gain", -4.0).unit("i", "integrator").with("start", 2.0);
  b.connect("i.y", "g.u").connect("g.y", "i.u").as_it_is();
  Master master = b.load();
  master.initialise();
  EXPECT_EQ(value(master, "i.u"), -8);
  EXPECT_THAT(master.summary().initialisation.loop, IsEmpty());
}

/// x = gain_a · gain_b · x + …: a loop of two gains, and a unit after it.
Build circle(double gain_a, double gain_b) {
  Build b;
  b.unit("listener", "gain");
  b.unit("a", "gain").with("gain", gain_a).with("bias", 1.0).unit("b", "gain").with("gain", gain_b).with("bias", 2.0);
  b.connect("a.y", "b.u").connect("b.y", "a.u").connect("b.y", "listener.u");
  return b;
}

TEST(Initialisation, SolvesAContractingLoopAndNamesItsMembers) {
  Master master = circle(0.9, 0.9).load();
  master.initialise();
  // y_a = 0.9 y_b + 1, y_b = 0.9 y_a + 2
  const double y_a = (1 + 0.9 * 2) / (1 - 0.81);
  EXPECT_NEAR(value(master, "a.y"), y_a, 1e-10 * y_a);
  EXPECT_NEAR(value(master, "b.y"), 0.9 * y_a + 2, 1e-10 * y_a);
  EXPECT_EQ(value(master, "listener.y"), value(master, "b.y"));
  EXPECT_THAT(master.summary().initialisation.loop, ElementsAre("a", "b"));
  EXPECT_LT(master.summary().initialisation.iterations, 20);
}

TEST(Initialisation, SolvesALoopWherePlainIterationDiverges) {
  Master master = circle(-3, 2).load();
  master.initialise();
  // y_a = −3 y_b + 1, y_b = 2 y_a + 2
  EXPECT_NEAR(value(master, "a.y"), -5.0 / 7, 1e-11);
  EXPECT_NEAR(value(master, "b.y"), 4.0 / 7, 1e-11);
}

TEST(Initialisation, RefusesALoopWithoutASolution) {
  Master master = circle(1, 1).load();  // y = y + 3
  EXPECT_THAT(error_of([&] { master.initialise(); }), HasSubstr("algebraic loop between a, b: its inputs do not converge"));
}

TEST(Initialisation, NamesTheUnitWhoseParameterIsOutOfRange) {
  Build b;
  b.unit("h", "heavy").with("start", 2.0);
  Master master = b.load();
  EXPECT_THAT(error_of([&] { master.initialise(); }), HasSubstr("test.ssd:10: component 'h': start"));
}

TEST(StrongComponents, AreFoundSourcesFirst) {
  // 3 → {0, 2 ↔ 1} → 4, and 5 alone
  EXPECT_THAT(strong_components({{2}, {2}, {1, 4}, {0}, {}, {}}),
              ElementsAre(ElementsAre(5), ElementsAre(3), ElementsAre(0), ElementsAre(1, 2), ElementsAre(4)));
}

TEST(StrongComponents, ALongChainNeedsNoDeepStack) {
  std::vector<std::vector<std::size_t>> chain(200000);
  for (std::size_t i = 0; i + 1 < chain.size(); ++i) chain[i] = {i + 1};
  EXPECT_EQ(strong_components(chain).size(), chain.size());
  chain.back() = {0};
  EXPECT_EQ(strong_components(chain).size(), 1u);
}

}  // namespace
}  // namespace cotwin::master
