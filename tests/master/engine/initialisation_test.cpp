#include "master/engine/coupling/initialisation.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include "fmu/export/package.h"
#include "master/engine/wiring/strong_components.h"
#include "master/twin/twin_package.h"
#include "tests/master/test_units.h"

namespace cotwin::master::initialisation_test {
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
  EXPECT_THAT(error_of([&] { master.initialise(); }), HasSubstr("algebraic loop between a, b: it has no solution"));
}

/// y = u² + c.
class Square final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "what comes in");
    v.output("y", y_, "rad", "its square plus c").start();
    v.parameter("c", c_, "rad", "offset");
  }
  void initialise(Time) override {
    y_ = u_ * u_ + c_;
    if (!(std::abs(y_) < 1e6)) throw Error("the square is out of range");
  }
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  double u_ = 0, y_ = 0, c_ = 0;
};

/// n is the integer next to u, w = u / 10. `follows` is 10 where the boolean `high` is true, else 0.
class Rounding final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "what comes in");
    v.input("high", high_, "switches");
    v.output("n", n_, "the integer next to u");
    v.output("is_high", is_high_, "whether u > 2");
    v.output("w", w_, "rad", "a tenth of u");
    v.output("follows", follows_, "rad", "10 where `high` is true");
  }
  void initialise(Time) override {
    n_ = static_cast<std::int32_t>(std::lround(u_));
    is_high_ = u_ > 2;
    w_ = u_ / 10;
    follows_ = high_ ? 10 : 0;
  }
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  double u_ = 0, w_ = 0, follows_ = 0;
  std::int32_t n_ = 0;
  bool high_ = false, is_high_ = false;
};

/// y = a + b.
class Sum final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("a", a_, "rad", "first summand");
    v.input("b", b_, "rad", "second summand");
    v.output("y", y_, "rad", "sum");
  }
  void initialise(Time) override { y_ = a_ + b_; }
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  double a_ = 0, b_ = 0, y_ = 0;
};

/// y = max(0, u): does not follow u < 0.
class Positive final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "what comes in");
    v.output("y", y_, "rad", "u if it is positive, else 0");
  }
  void initialise(Time) override { y_ = std::max(0.0, u_); }
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  double u_ = 0, y_ = 0;
};

std::span<const UnitType> types() {
  static const std::vector<UnitType> kTypes = [] {
    std::vector<UnitType> all(cotwin::testing::test_types().begin(), cotwin::testing::test_types().end());
    all.push_back({"square", "y = u² + c", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Square>(); }});
    all.push_back({"rounding", "integers", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Rounding>(); }});
    all.push_back({"sum", "y = a + b", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Sum>(); }});
    all.push_back({"positive", "max", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Positive>(); }});
    return all;
  }();
  return kTypes;
}

Master load(const Build& b) {
  MasterOptions options;
  options.types = types();
  return Master(b.scenario, std::move(options));
}

std::string refusal(const Build& b) {
  Master master = load(b);
  return error_of([&] { master.initialise(); });
}

/// n gains one after the other, the last one feeds the first: y_i = gain · y_(i−1) + i.
Build ring(int n, double gain, const std::string& source = "gain") {
  Build b;
  for (int i = 0; i < n; ++i) b.unit("g" + std::to_string(i), source).with("gain", gain).with("bias", 1.0 * i);
  for (int i = 0; i < n; ++i) b.connect("g" + std::to_string(i) + ".y", "g" + std::to_string((i + 1) % n) + ".u");
  return b;
}

/// y_0 of the ring: y_0 = gain · y_(n−1), y_i = gain · y_(i−1) + i.
double ring_solution(int n, double gain) {
  double sum = 0;  // y_(n−1) = gain^(n−1) y_0 + sum
  for (int i = 1; i < n; ++i) sum = gain * sum + i;
  return gain * sum / (1 - std::pow(gain, n));
}

TEST(Initialisation, SolvesRingsOfAnyNumberOfGains) {
  for (const double gain : {1.5, -3.0, 2.0, 0.5}) {
    for (const int n : {1, 2, 9, 14, 40, 100}) {
      Master master = load(ring(n, gain));
      master.initialise();
      const double expected = ring_solution(n, gain);
      EXPECT_NEAR(value(master, "g0.y"), expected, 1e-9 * (1 + std::abs(expected))) << n << " gains of " << gain;
      EXPECT_LE(master.summary().initialisation.iterations, 6);
    }
  }
}

TEST(Initialisation, SolvesVectorsOfFourteenElements) {
  // Each element is a loop of its own: y_0 = 1.5 y_2, y_1 = 1.5 y_0 + 1, y_2 = 1.5 y_1 + 2.
  Master master = load(ring(3, 1.5, "gain?n=14"));
  master.initialise();
  for (const char* element : {"[1]", "[8]", "[14]"}) {
    EXPECT_NEAR(value(master, "g0.y" + std::string(element)), ring_solution(3, 1.5), 1e-10);
  }
}

TEST(Initialisation, SolvesTwoLoopsOneBehindTheOther) {
  // Loop 1 of a and b, loop 2 of c and d, whose first elements only pass on what loop 1 gives: y_c2 = −3 y_d1 and so on. The
  // state of i closes the cycle of all, so that they are swept together; it does not follow its input.
  Build b;
  b.unit("a", "gain?n=2").with("gain", -3.0).with("bias", 1.0).unit("b", "gain").with("gain", 2.0);
  b.unit("c", "gain?n=2").with("gain", 1.5).unit("d", "gain").with("gain", 4.0).with("bias", 2.0);
  b.unit("i", "integrator").with("start", 0.5);
  b.connect("a.y[1]", "b.u").connect("b.y", "a.u[1]");                           // a1 = −3 b + 1, b = 2 a1
  b.connect("b.y", "c.u[1]").connect("c.y[2]", "d.u").connect("d.y", "c.u[2]");  // c1 = 1.5 b; c2 = 1.5 d, d = 4 c2 + 2
  b.connect("c.y[1]", "i.u").as_it_is().connect("i.y", "a.u[2]");                // a2 = −3 · 0.5 + 1
  Master master = load(b);
  master.initialise();
  EXPECT_NEAR(value(master, "a.y[1]"), 1.0 / 7, 1e-12);
  EXPECT_NEAR(value(master, "a.y[2]"), -0.5, 1e-12);
  EXPECT_NEAR(value(master, "i.u"), 1.5 * 2.0 / 7, 1e-12);
  EXPECT_NEAR(value(master, "d.y"), 2 / (1 - 6.0), 1e-12);
  EXPECT_THAT(master.summary().initialisation.loop, ElementsAre("a", "b", "c", "d"));
}

TEST(Initialisation, AUnitThatDoesNotFollowInTheSweepsCanBelongToTheLoop) {
  // y_a = 1.5 (y_c − 0.2 y_h) − 3, y_c = y_a, y_h = max(0, y_a). The sweeps fall from 0 and leave y_h at 0. Without h the solution
  // is y_a = 6; with it 15.
  Build b;
  b.unit("a", "gain").with("gain", 1.5).with("bias", -3.0).unit("c", "gain").unit("p", "positive").unit("h", "gain");
  b.unit("sum", "sum").connect("sum.y", "a.u").connect("a.y", "c.u").connect("a.y", "p.u").connect("p.y", "h.u");
  b.connect("c.y", "sum.a").connect("h.y", "sum.b", -0.2);
  Master master = load(b);
  master.initialise();
  EXPECT_NEAR(value(master, "a.y"), 15, 1e-10);
  EXPECT_NEAR(value(master, "h.y"), 15, 1e-10);
  EXPECT_NEAR(value(master, "sum.y"), 12, 1e-10);
}

TEST(Initialisation, RefusesALoopWithAGainOfOne) {
  for (const int n : {1, 2, 9, 40}) {
    Build b = ring(n, 1);
    if (n == 1) b.with("bias", 1.0);
    EXPECT_THAT(refusal(b), HasSubstr("it has no solution or no unique one, because the gain around it is 1")) << n;
  }
  EXPECT_THAT(refusal(ring(3, 1)), HasSubstr("initialisation: algebraic loop between g0, g1, g2: "));
}

/// y_s = u² + c, u = y_s through a gain of 1: 0.5 ± √(0.25 − c).
Build square_loop(double c) {
  Build b;
  b.unit("s", "square").with("c", c).unit("g", "gain").connect("s.y", "g.u").connect("g.y", "s.u");
  return b;
}

TEST(Initialisation, RefusesANonlinearLoopWithoutASolution) {
  const std::string error = refusal(square_loop(1));
  EXPECT_THAT(error, HasSubstr("initialisation: algebraic loop between s, g: no solution was found within 50 iterations: "));
  EXPECT_THAT(error, HasSubstr("give start values closer to a solution, for example for g.u, or break the loop"));
}

TEST(Initialisation, RefusesALoopWithTwoSolutionsAndNoStartValue) {
  for (const double c : {0.09, -2.31, -0.3, -20.0}) {
    const std::string error = refusal(square_loop(c));
    EXPECT_THAT(error, HasSubstr("algebraic loop between s, g: it has several solutions, for example ")) << c;
    EXPECT_THAT(error, HasSubstr("; give ")) << c;
  }
  const std::string error = refusal(square_loop(-2.31));
  EXPECT_THAT(error, HasSubstr("s.y = 2.1 rad"));
  EXPECT_THAT(error, HasSubstr("s.y = -1.1 rad"));
}

TEST(Initialisation, ANonlinearLoopWithOneSolutionNeedsNoStartValue) {
  // y = −2 max(0, y) + b: y = b / 3 where b > 0, else y = b.
  for (const double bias : {6.0, -6.0}) {
    Build b;
    b.unit("p", "positive").unit("g", "gain").with("gain", -2.0).with("bias", bias).connect("p.y", "g.u").connect("g.y", "p.u");
    Master master = load(b);
    master.initialise();
    EXPECT_NEAR(value(master, "g.y"), bias > 0 ? bias / 3 : bias, 1e-11);
  }
}

TEST(Initialisation, NamesTheUnitThatRefusesTheStartValueOfALoop) {
  Build b = square_loop(0.09);
  b.scenario.components[1].start_values.push_back({"u", 2000.0, "", ""});
  EXPECT_THAT(refusal(b), HasSubstr("component 's': the square is out of range"));
}

TEST(Initialisation, RefusesALoopOfTooManyUnknowns) {
  EXPECT_THAT(refusal(ring(4, 1.5, "gain?n=1000")), HasSubstr("it has 4000 unknowns, expected at most 3000"));
}

TEST(Initialisation, AStartValueChoosesTheSolution) {
  const auto solution = [](double c, const std::string& component, const std::string& variable, double start) {
    Build b = square_loop(c);
    b.scenario.components[component == "s" ? 0 : 1].start_values.push_back({variable, start, "", ""});
    Master master = load(b);
    master.initialise();
    EXPECT_NEAR(value(master, "s.u"), value(master, "s.y"), 1e-11);
    return value(master, "s.y");
  };
  for (const auto& [c, low, high] : {std::tuple{0.09, 0.1, 0.9}, {-2.0, -1.0, 2.0}, {0.0, 0.0, 1.0}}) {
    for (const auto& [component, variable] : {std::pair{"s", "u"}, {"s", "y"}, {"g", "u"}}) {
      EXPECT_NEAR(solution(c, component, variable, low + 0.1), low, 1e-11) << c << component << variable;
      EXPECT_NEAR(solution(c, component, variable, high - 0.1), high, 1e-11) << c << component << variable;
      EXPECT_NEAR(solution(c, component, variable, high), high, 1e-11) << c << component << variable;
    }
  }
}

TEST(Initialisation, AScenarioAsOneUnitKeepsTheChoiceInEveryInitialisation) {
  // As a Twin, and as it is stored in an FMU; the second initialisation begins with the values of the first.
  Build b = square_loop(0.09);
  b.scenario.components[0].start_values.push_back({"u", 0.8, "", ""});
  std::vector<Member> members = load_members(b.scenario, types(), {});
  TwinPackage package;
  package.scenario = b.scenario;
  package.outputs = {"s.y"};
  for (const Member& member : members) {
    fmu::Package unit;
    unit.unit = member.spec.source.substr(std::string("unit:").size());
    unit.start.take(member.variables());
    package.packages.push_back(fmu::serialise(unit));
    package.given.push_back(member.given);
  }
  const std::unique_ptr<Twin> stored = build_twin(deserialise_twin(serialise(package), "here"), {}, types());
  Twin direct(b.scenario, std::move(members), package.outputs);
  for (Twin* twin : {&direct, stored.get()}) {
    Variables v;
    twin->declare(v);
    for (int i = 0; i < 2; ++i) {
      twin->initialise(Time{});
      EXPECT_NEAR(v.at("s.y").reals()[0], 0.9, 1e-11);
      v.at("s.y").reals()[0] = 0;
    }
  }
}

TEST(Initialisation, AStartValueOfOneElementChoosesItsSolution) {
  // A gain with two elements, each of which closes a loop through a square.
  Build b;
  b.unit("s", "square").with("c", 0.09).unit("t", "square").with("c", 0.09);
  b.unit("g", "gain?n=2").with("u[1]", 0.0).with("u[2]", 0.85);
  b.connect("s.y", "g.u[1]").connect("t.y", "g.u[2]").connect("g.y[1]", "s.u").connect("g.y[2]", "t.u");
  Master master = load(b);
  master.initialise();
  EXPECT_NEAR(value(master, "s.y"), 0.1, 1e-11);
  EXPECT_NEAR(value(master, "t.y"), 0.9, 1e-11);
}

TEST(Initialisation, AStartValueOfAnInputPassesThroughItsConnectionBackwards) {
  // u = −2 y_g + 0.5 and y_g = −0.5 y_s + 0.25: u = y_s, as in square_loop. 50 deg is 0.87 rad.
  for (const double start : {5.0, 50.0}) {
    Build b;
    b.unit("s", "square").with("c", 0.09).unit("g", "gain").with("gain", -0.5).with("bias", 0.25);
    b.connect("s.y", "g.u").connect("g.y", "s.u", -2, 0.5);
    b.scenario.components[0].start_values.push_back({"u", start, "deg", ""});
    Master master = load(b);
    master.initialise();
    EXPECT_NEAR(value(master, "s.y"), start > 30 ? 0.9 : 0.1, 1e-11);
  }
}

TEST(Initialisation, SolvesALoopThroughUnitsOfMeasureAndOffsets) {
  // h.u = 180/π y_g + 2 (the number of degrees, then the connection's offset), y_g = −0.25 h.u + 3.
  Build b;
  b.unit("g", "gain").with("gain", -0.25).with("bias", 3.0).unit("h", "gain");
  b.connect("g.y", "h.u", 1, 2).as_it_is().connect("h.y", "g.u");
  b.scenario.connections[0].from.unit = "deg";
  Master master = load(b);
  master.initialise();
  const double k = 180 / M_PI;
  EXPECT_NEAR(value(master, "g.y"), (3 - 0.5) / (1 + 0.25 * k), 1e-11);
  EXPECT_NEAR(value(master, "h.u"), k * value(master, "g.y") + 2, 1e-11);
}

TEST(Initialisation, SolvesALoopThroughAnInteger) {
  // n = round(y_g), y_g = 0.1 n + 3.2: n = 4 and y_g = 3.6; other integers do not fit.
  Build b;
  b.unit("r", "rounding").unit("g", "gain").with("gain", 0.1).with("bias", 3.2);
  b.connect("r.n", "g.u").connect("g.y", "r.u");
  Master master = load(b);
  master.initialise();
  EXPECT_EQ(value(master, "r.n"), 4);
  EXPECT_NEAR(value(master, "g.y"), 3.6, 1e-12);
  EXPECT_NEAR(value(master, "r.w"), 0.36, 1e-12);
}

TEST(Initialisation, SolvesALoopOfRealsThatSwitchesABoolean) {
  // u = −2 · (u / 10) · 3 + 10 high + 1 with two gains in between: for high = (u > 2), u = 11 / 1.6 fits; u = 1 / 1.6 too, and is
  // where high = false leads. The boolean and the integer follow the solution.
  Build b;
  b.unit("r", "rounding").unit("g", "gain").with("gain", -20.0).with("bias", 11.0).unit("watch", "rounding").unit("m", "mixed");
  b.connect("r.w", "g.u").connect("g.y", "r.u").connect("r.n", "m.integer").connect("r.is_high", "watch.high");
  b.connect("r.is_high", "m.boolean");
  Master master = load(b);
  master.initialise();
  // u = −2 u + 11
  EXPECT_NEAR(value(master, "r.u"), 11.0 / 3, 1e-11);
  EXPECT_EQ(value(master, "r.n"), 4);
  EXPECT_EQ(value(master, "m.integer_out"), 4);
  EXPECT_EQ(value(master, "watch.follows"), 10);
}

TEST(Initialisation, ABooleanWithinALoopOfRealsFollowsTheSolution) {
  // r.follows = 10 where u > 2, through its own boolean; u = −2 u + 11 + 0.2 · follows by two gains in a row.
  Build b;
  b.unit("r", "rounding").unit("g", "gain?n=2").with("gain", -20.0).with("bias", 11.0);
  b.connect("r.w", "g.u[1]").connect("r.follows", "g.u[2]", 0.01).connect("g.y[1]", "r.u").connect("r.is_high", "r.high");
  Master master = load(b);
  master.initialise();
  EXPECT_NEAR(value(master, "r.u"), 11.0 / 3, 1e-11);
  EXPECT_EQ(value(master, "r.follows"), 10);
  EXPECT_NEAR(value(master, "g.y[2]"), -20 * 0.1 + 11, 1e-11);
}

TEST(Initialisation, NamesTheLoopWhoseIntegersOrBooleansDoNotSettle) {
  // n = round(y_g) and y_g = −n + 1, as an integer through the unit `mixed`: 0, 1, 0, 1, …
  Build b;
  b.unit("r", "rounding").unit("g", "gain").with("gain", -1.0).with("bias", 1.0).unit("m", "mixed");
  b.connect("r.n", "m.integer").connect("m.integer_out", "g.u").connect("g.y", "r.u");
  EXPECT_THAT(refusal(b), HasSubstr("algebraic loop between r, g, m: "));
}

TEST(Initialisation, AUnitThatRefusesTheGuessOfALaterSweepDoesNotEndTheSearch) {
  // u² − 2: the sweeps from 3 grow beyond the range of the unit (|y| < 1e6).
  Build b = square_loop(-2);
  b.scenario.components[1].start_values.push_back({"bias", 0.5, "", ""});
  b.scenario.components[0].start_values.push_back({"u", 3.0, "", ""});
  Master master = load(b);
  master.initialise();
  // y = (y + 0.5)² − 2: y² = 1.75
  EXPECT_NEAR(value(master, "s.y"), std::sqrt(1.75), 1e-11);
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
}  // namespace cotwin::master::initialisation_test
