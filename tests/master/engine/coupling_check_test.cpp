// What check finds about the coupling of loops.
#include "master/workflows/coupling_check.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "components/unit/declared_dependencies.h"
#include "master/engine/engine.h"
#include "master/workflows/check.h"
#include "tests/master/test_units.h"
#include "tests/support/linear_units.h"

namespace cotwin::master::coupling_check_test {
namespace {

using ::cotwin::testing::Build;
using fmu::Finding;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// y = u / 2; like an FMU without rollback.
class OneWay final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "input");
    v.output("y", y_, "rad", "half of it");
  }
  void initialise(Time) override { y_ = u_ / 2; }
  StepResult step(Time, Duration) override {
    y_ = u_ / 2;
    return StepResult::kDone;
  }
  bool has_cheap_rollback() const override { return false; }

 private:
  double u_ = 0, y_ = 0;
};

/// y1 = u1 without delay and y2 = u2 after a step, as it declares; like an FMU without rollback, or one that cannot be restored.
class Declared final : public Unit, public DeclaredDependencies {
 public:
  explicit Declared(bool restorable) : restorable_(restorable) {}
  void declare(Variables& v) override {
    v.input("u1", u1_, "rad", "input");
    v.input("u2", u2_, "rad", "input");
    v.output("y1", y1_, "rad", "first input");
    v.output("y2", y2_, "rad", "second input");
  }
  void initialise(Time) override { y1_ = u1_; }
  StepResult step(Time, Duration) override {
    y1_ = u1_;
    y2_ = u2_;
    return StepResult::kDone;
  }
  bool restorable() const override { return restorable_; }
  bool has_cheap_rollback() const override { return false; }
  bool follows(const Variable& output, std::size_t, const Variable& input, std::size_t) const override {
    return output.name == "y1" && input.name == "u1";
  }

 private:
  bool restorable_;
  double u1_ = 0, u2_ = 0, y1_ = 0, y2_ = 0;
};

std::span<const UnitType> types() {
  static const std::vector<UnitType> kTypes = [] {
    std::vector<UnitType> all;
    for (const UnitType& type : cotwin::testing::test_types()) all.push_back(type);
    for (const UnitType& type : cotwin::testing::linear_types()) all.push_back(type);
    all.push_back({"declared", "", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Declared>(true); }});
    all.push_back({"fixed_declared", "", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Declared>(false); }});
    all.push_back({"one_way", "y = u / 2", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<OneWay>(); }});
    return all;
  }();
  return kTypes;
}

Build lc(CouplingChoice coupling, double tick, const std::string& settings = "") {
  Build b;
  b.unit("mass", "lc_mass" + settings).unit("spring", "lc_spring" + settings).until(10);
  b.connect("mass.v", "spring.v").connect("spring.F", "mass.F");
  b.scenario.tick = Duration::from_seconds(tick);
  b.scenario.coupling = coupling;
  return b;
}

/// Stable in explicit steps of any length.
Build lags(CouplingChoice coupling) {
  Build b;
  b.unit("a", "lag").unit("b", "lag").connect("a.y", "b.u").connect("b.y", "a.u").until(10);
  b.scenario.tick = Duration::from_seconds(0.5);
  b.scenario.coupling = coupling;
  return b;
}

Build gains(double gain, CouplingChoice coupling = CouplingChoice::kAuto, const std::string& settings = "") {
  Build b;
  b.unit("a", "gain" + settings).with("gain", gain).with("bias", 1.0).unit("b", "gain" + settings);
  b.connect("a.y", "b.u").connect("b.y", "a.u");
  b.scenario.coupling = coupling;
  return b;
}

std::vector<Finding> findings_of(const Build& b) {
  std::vector<Member> members = load_members(b.scenario, types(), {});
  return check_coupling(b.scenario, members);
}

::testing::Matcher<const Finding&> note(const std::string& text) {
  return AllOf(::testing::Field(&Finding::level, Finding::Level::kNote), ::testing::Field(&Finding::text, HasSubstr(text)));
}
::testing::Matcher<const Finding&> warning(const std::string& text) {
  return AllOf(::testing::Field(&Finding::level, Finding::Level::kWarning), ::testing::Field(&Finding::text, HasSubstr(text)));
}

LoopReport measured(const Build& b) {
  std::vector<Member> members = load_members(b.scenario, types(), {});
  Engine engine(b.scenario, members, 1, false);
  engine.initialise(b.scenario.start);
  const std::vector<LoopReport> loops = engine.measure_loops(b.scenario.start, 200);
  EXPECT_EQ(loops.size(), 1u);
  return loops.at(0);
}

// With linear inputs the gain of the oscillator is ωh/2, ω = 10 rad/s.
TEST(LoopGain, OfAnOscillatorGrowsWithTheTick) {
  for (const double tick : {1e-3, 1e-2, 0.15, 0.2, 0.3, 5.0}) {
    for (const auto coupling : {CouplingChoice::kAuto, CouplingChoice::kExplicit, CouplingChoice::kImplicit}) {
      const LoopReport loop = measured(lc(coupling, tick));
      EXPECT_NEAR(loop.gain, 10 * tick / 2, 1e-3 * tick);
      EXPECT_EQ(loop.unknowns, 2u);
    }
  }
}

TEST(StabilityBorder, IsInfinityOrZeroWhereNoTickChangesTheGain) {
  EXPECT_EQ(measured(gains(0.5)).border, std::numeric_limits<double>::infinity());
  EXPECT_EQ(measured(gains(-3)).border, 0);
}

TEST(StabilityBorder, LeavesTheUnitsAsTheyAre) {
  const Build b = lc(CouplingChoice::kImplicit, 0.01);
  std::vector<Member> members = load_members(b.scenario, types(), {});
  Engine engine(b.scenario, members, 1, false);
  engine.initialise(b.scenario.start);
  const auto v = find_signal(members, "mass.v", "").reals();
  const auto F = find_signal(members, "spring.F", "").reals();
  const double v_before = v[0], F_before = F[0];
  const std::vector<LoopReport> first = engine.measure_loops(Time{}, 200), second = engine.measure_loops(Time{}, 200);
  EXPECT_EQ(first[0].border, second[0].border);
  EXPECT_EQ(v[0], v_before);
  EXPECT_EQ(F[0], F_before);
  ASSERT_EQ(engine.step(engine.schedule.tick(0)), Engine::kNoSlot);  // and the run begins as without it
  EXPECT_NEAR(v[0], std::cos(2 * std::atan(10 * 0.01 / 2)), 1e-12);
}

TEST(CheckCoupling, NamesMembersConnectionsGainAndBorder) {
  EXPECT_THAT(findings_of(lc(CouplingChoice::kAuto, 0.01)),
              ElementsAre(note("loop mass, spring (mass.v -> spring.v, spring.F -> mass.F): gain 0.05 in a tick of 10 ms, "
                               "explicit steps diverge above ")));
  EXPECT_THAT(findings_of(lc(CouplingChoice::kAuto, 0.01)), ElementsAre(note("; coupling=auto steps it so")));
  EXPECT_THAT(
      findings_of(lc(CouplingChoice::kAuto, 0.3)),
      ElementsAre(AllOf(note("gain 1.5 in a tick of 300 ms, explicit steps diverge above "), note("coupling=auto solves it"))));
}

TEST(CheckCoupling, ListsConnectionsOfElementsAsOne) {
  Build b;
  b.unit("a", "gain?n=9").unit("b", "gain?n=9");
  for (int i = 1; i <= 9; ++i) b.connect("a.y[" + std::to_string(i) + "]", "b.u[" + std::to_string(i) + "]");
  b.connect("b.y[2]", "a.u[2]");
  EXPECT_THAT(findings_of(b), ElementsAre(note("loop a, b (a.y -> b.u, b.y[2] -> a.u[2]): ")));
}

TEST(CheckCoupling, WarnsOfExplicitStepsThatDiverge) {
  EXPECT_THAT(findings_of(lc(CouplingChoice::kExplicit, 0.3)),
              ElementsAre(warning("expected coupling=auto or implicit, or a tick well below that")));
  EXPECT_THAT(findings_of(lags(CouplingChoice::kExplicit)), ElementsAre(note("coupling=auto would solve it")));
  EXPECT_THAT(findings_of(lc(CouplingChoice::kExplicit, 0.01)), ElementsAre(note("coupling=explicit is good for it")));
  EXPECT_THAT(findings_of(lc(CouplingChoice::kImplicit, 0.01)), ElementsAre(note("which it does not need")));
  EXPECT_THAT(findings_of(lc(CouplingChoice::kImplicit, 0.3)), ElementsAre(note("coupling=implicit solves it")));
}

// The spectral radius of a loop of two is the root of the product of its gains.
TEST(CheckCoupling, WarnsOfExplicitStepsWithoutDelay) {
  EXPECT_THAT(findings_of(gains(-3)),
              ElementsAre(note("gain 1.73 in a tick of 1 ms, its values depend on one another without delay, explicit steps "
                               "diverge (also in 1/1024 tick); coupling=auto solves it")));
  EXPECT_THAT(findings_of(gains(-3, CouplingChoice::kExplicit)), ElementsAre(warning("expected coupling=auto or implicit")));
  EXPECT_THAT(findings_of(gains(0.5, CouplingChoice::kExplicit)),
              ElementsAre(warning("gain 0.707 in a tick of 1 ms, its values depend on one another without delay, explicit "
                                  "steps are stable (also in 1024 ticks); expected coupling=auto or implicit")));
  EXPECT_THAT(findings_of(gains(0.5)), ElementsAre(note("coupling=auto solves it")));
}

TEST(CheckCoupling, FindsNothingWithoutALoop) {
  Build b;
  b.unit("a", "gain").unit("b", "gain").unit("c", "gain").connect("a.y", "b.u").connect("b.y", "c.u");
  EXPECT_THAT(findings_of(b), IsEmpty());
}

TEST(CheckCoupling, MeasuresNoLargeLoop) {
  EXPECT_THAT(findings_of(gains(0.5, CouplingChoice::kAuto, "?n=101")),
              ElementsAre(note("it has 202 unknowns, more than 200")));
}

TEST(CheckCoupling, RunsNoUnitThatCannotGoBack) {
  Build b = gains(0.5);
  b.unit("p", "picky?restorable=false");
  EXPECT_THAT(findings_of(b), ElementsAre(note("because 'p' has no cheap way back and check does not run it")));
}

TEST(CheckCoupling, SaysWhatAnFmuWithoutRollbackNeeds) {
  for (const auto& [coupling, expected] :
       {std::pair{CouplingChoice::kAuto, "coupling=auto steps it explicitly, expected rollback=true in the source of 'f'"},
        {CouplingChoice::kImplicit, "in every iteration, expected rollback=true"},
        {CouplingChoice::kExplicit, "expected rollback=true in its source, and coupling=auto or implicit"}}) {
    Build b;
    b.unit("f", "one_way").unit("g", "gain").connect("f.y", "g.u").connect("g.y", "f.u");
    b.scenario.coupling = coupling;
    EXPECT_THAT(findings_of(b), ElementsAre(note(expected)));
  }
}

// The values are at rest, so that they tell nothing.
TEST(CheckCoupling, FindsLoopsWithoutDelayByTheDeclaredDependencies) {
  const auto findings = [](const std::string& type, const std::string& from, const std::string& to, CouplingChoice coupling) {
    Build b;
    b.unit("a", type).unit("b", type).connect("a." + from, "b." + to).connect("b." + from, "a." + to);
    b.scenario.coupling = coupling;
    return findings_of(b);
  };
  const std::string without_delay = "its values depend on one another without delay, and each step uses those of the last one";
  for (const auto coupling : {CouplingChoice::kAuto, CouplingChoice::kExplicit}) {
    EXPECT_THAT(findings("declared", "y1", "u1", coupling), ElementsAre(warning(without_delay)));
    EXPECT_THAT(findings("declared", "y2", "u2", coupling), ElementsAre(note("its gain is not measured")));
    EXPECT_THAT(findings("declared", "y1", "u2", coupling), ElementsAre(note("its gain is not measured")));
    EXPECT_THAT(findings("fixed_declared", "y1", "u1", coupling), ElementsAre(warning(without_delay)));
    EXPECT_THAT(findings("fixed_declared", "y2", "u2", coupling), ElementsAre(note("'a' cannot be restored")));
  }
  EXPECT_THAT(findings("declared", "y1", "u1", CouplingChoice::kImplicit),
              ElementsAre(note("makes such an instance in every iteration")));
}

class CheckCouplingOfAFile : public ::testing::Test {
 protected:
  void TearDown() override { std::filesystem::remove(file_); }

  std::vector<Finding> check(const std::string& gain, const std::string& connections) {
    std::ofstream(file_) << R"(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription version="1.0" name="two" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription">
  <ssd:System name="two">
    <ssd:Elements>
      <ssd:Component name="a" source="unit:gain" type="application/x-cotwin-unit">
        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="a"><ssv:Parameters>
          <ssv:Parameter name="gain"><ssv:Real value=")"
                         << gain << R"("/></ssv:Parameter>
          <ssv:Parameter name="bias"><ssv:Real value="1"/></ssv:Parameter>
        </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
      </ssd:Component>
      <ssd:Component name="b" source="unit:gain" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="a" startConnector="y" endElement="b" endConnector="u"/>)"
                         << connections << R"(
    </ssd:Connections>
  </ssd:System>
</ssd:SystemStructureDescription>)";
    return check_scenario(file_, types(), {});
  }
  static constexpr const char* kBack =
      R"(<ssd:Connection startElement="b" startConnector="y" endElement="a" endConnector="u"/>)";
  const std::filesystem::path file_ = std::filesystem::path(::testing::TempDir()) / "coupling_check_test.ssd";
};

TEST_F(CheckCouplingOfAFile, IsQuietWithoutALoop) { EXPECT_THAT(check("0.5", ""), IsEmpty()); }

TEST_F(CheckCouplingOfAFile, AddsANoteThatIsNoError) {
  const std::vector<Finding> findings = check("0.5", kBack);
  EXPECT_THAT(findings, ElementsAre(note("loop a, b (a.y -> b.u, b.y -> a.u): gain 0.707")));
  std::ostringstream out;
  EXPECT_TRUE(fmu::write_findings(out, findings));
}

TEST_F(CheckCouplingOfAFile, ReportsAnInitialisationThatFails) {
  const std::vector<Finding> findings = check("1", kBack);  // y = y + 1
  ASSERT_EQ(findings.size(), 1u);
  EXPECT_EQ(findings[0].level, Finding::Level::kError);
  EXPECT_THAT(findings[0].text, AllOf(HasSubstr("a"), HasSubstr("gain"), Not(HasSubstr("measured"))));
}

}  // namespace
}  // namespace cotwin::master::coupling_check_test
