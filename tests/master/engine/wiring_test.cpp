#include "master/engine/wiring/wiring.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include "tests/master/test_units.h"

namespace cotwin::master::wiring_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::HasSubstr;

void run(Master& master, int ticks) {
  master.initialise();
  for (int i = 0; i < ticks; ++i) ASSERT_TRUE(master.step_tick());
}

TEST(Wiring, CopiesWholeVectorsAndSingleElements) {
  Build b;
  b.unit("a", "gain?n=3").with("bias", 1.5);
  b.unit("b", "gain?n=3", 1).connect("a.y", "b.u");
  b.unit("c", "gain", 2).connect("b.y[2]", "c.u");
  b.event(0, "a.u", "1,2,3");
  Master master = b.load();
  run(master, 1);
  EXPECT_EQ(value(master, "b.u[1]"), 2.5);
  EXPECT_EQ(value(master, "b.u[3]"), 4.5);
  EXPECT_EQ(value(master, "c.y"), 3.5);
}

TEST(Wiring, ScalesAndShifts) {
  Build b;
  b.unit("a", "gain").with("bias", 4.0).unit("b", "gain", 1).connect("a.y", "b.u", 2, -1);
  Master master = b.load();
  run(master, 1);
  EXPECT_EQ(value(master, "b.u"), 7);
}

TEST(Wiring, ConvertsTheMeasuresThatTheConnectorsState) {
  // a.y = 4 rad leaves the connector in degrees, is doubled and shifted there (2·229.18° + 10°) and enters b.u in rad.
  Build b;
  b.unit("a", "gain").with("bias", 4.0).unit("b", "gain", 1).connect("a.y", "b.u", 2, 10);
  b.scenario.connections[0].from.unit = "deg";
  b.scenario.connections[0].to.unit = "deg";
  Master master = b.load();
  run(master, 1);
  EXPECT_NEAR(value(master, "b.u"), 8 + 10 * std::acos(-1.0) / 180, 1e-14);
}

TEST(Wiring, ComparesMeasuresElementByElement) {
  const auto wired = [](const std::string& from, const std::string& to,
                        const std::function<void(ConnectionSpec&)>& change = {}) {
    Build b;
    b.unit("a", "arm").unit("c", "arm", 1).unit("g", "gain?n=3", 2).connect(from, to);
    if (change) change(b.scenario.connections[0]);
    return error_of([&] { b.load(); });
  };
  EXPECT_EQ(wired("a.y", "c.u"), "");
  EXPECT_EQ(wired("a.y[3]", "g.u[2]"), "");
  EXPECT_THAT(wired("a.y", "g.u"), HasSubstr("a.y -> g.u, element 2: m cannot feed rad"));
  EXPECT_THAT(wired("g.y", "a.u"), HasSubstr("element 2: rad cannot feed m"));
  EXPECT_THAT(wired("a.y[2]", "g.u[2]"), HasSubstr("m cannot feed rad"));
  EXPECT_EQ(wired("a.y", "g.u", [](ConnectionSpec& c) { c.suppress_unit_conversion = true; }), "");
  EXPECT_THAT(wired("a.y", "c.u", [](ConnectionSpec& c) { c.from.unit = "deg"; }), HasSubstr("element 2: m cannot feed deg"));
  EXPECT_EQ(wired("a.y[1]", "c.u[1]", [](ConnectionSpec& c) { c.from.unit = "deg"; }), "");
}

TEST(Wiring, StartValuesInAUnitOfMeasureAreForSingleElementsOfVectorsThatDiffer) {
  Build b;
  b.unit("a", "arm");
  const auto error = [&](ParameterValue value) {
    b.scenario.components[0].start_values = {std::move(value)};
    return error_of([&] { b.load(); });
  };
  EXPECT_EQ(error({"u[1]", 90.0, "deg", ""}), "");
  EXPECT_EQ(error({"u[2]", 5.0, "mm", ""}), "");
  EXPECT_EQ(error({"u", 5.0, "", ""}), "");
  EXPECT_THAT(error({"u[2]", 90.0, "deg", ""}), HasSubstr("deg cannot give m"));
  EXPECT_THAT(error({"u", 90.0, "deg", ""}), HasSubstr("its elements are in rad, m, rad"));
}

TEST(Wiring, UsesUnitsOfMeasureThatTheScenarioDefines) {
  Build b;
  b.unit("a", "gain").with("bias", 4.0).unit("b", "gain", 1).connect("a.y", "b.u");
  UnitDefinition turn;
  turn.name = "turn";
  turn.rad = 1;
  turn.factor = 2 * std::acos(-1.0);
  b.scenario.units.push_back(turn);
  b.scenario.connections[0].from.unit = "turn";
  b.scenario.connections[0].suppress_unit_conversion = true;  // the number of turns is taken as rad
  Master master = b.load();
  run(master, 1);
  EXPECT_NEAR(value(master, "b.u"), 4 / (2 * std::acos(-1.0)), 1e-15);
}

TEST(Wiring, TakesNoOffsetForADifference) {
  UnitDefinition shifted;  // rad = 2 · number + 10
  shifted.name = "shifted";
  shifted.rad = 1;
  shifted.factor = 2;
  shifted.offset = 10;
  const auto arrives = [&](const std::string& from, const std::string& to) {
    Build b;
    b.unit("a", from).with("bias", 4.0).unit("b", to, 1).connect("a.y", "b.u");
    b.scenario.units.push_back(shifted);
    b.scenario.connections[0].from.unit = "shifted";
    b.scenario.connections[0].suppress_unit_conversion = true;  // the number is taken as rad
    Master master = b.load();
    run(master, 1);
    return value(master, "b.u");
  };
  EXPECT_DOUBLE_EQ(arrives("gain", "gain"), -3);
  EXPECT_DOUBLE_EQ(arrives("difference", "difference"), 2);
}

TEST(Wiring, CopiesEveryKindAndConvertsIntegersToReals) {
  Build b;
  b.unit("a", "mixed").with("integer", std::int64_t{7}).with("boolean", true).with("string", std::string("hello"));
  b.unit("b", "mixed", 1);
  b.connect("a.integer_out", "b.integer").connect("a.boolean_out", "b.boolean").connect("a.string_out", "b.string");
  b.connect("a.integer_out", "b.real", 0.5);
  Master master = b.load();
  run(master, 1);
  EXPECT_EQ(value(master, "b.integer_out"), 7);
  EXPECT_EQ(value(master, "b.boolean_out"), 1);
  EXPECT_EQ(value(master, "b.real_out"), 3.5);
  EXPECT_EQ(find_signal(master.members(), "b.string_out", "").variable->strings()[0], "hello");
}

TEST(Wiring, LeavesUnconnectedInputsAtTheirStartValues) {
  Build b;
  b.unit("a", "gain?n=2").with("u[2]", 3.0).with("gain", 2.0);
  Master master = b.load();
  run(master, 5);
  EXPECT_EQ(value(master, "a.y[1]"), 0);
  EXPECT_EQ(value(master, "a.y[2]"), 6);
}

TEST(Wiring, AParameterFollowsAnOutputOnlyWhileTheSystemIsInitialised) {
  // The integrator starts at the initial output of the gain; later changes do not reach the parameter.
  Build b;
  b.unit("i", "integrator").unit("g", "gain").with("bias", 2.5).connect("g.y", "i.start").event(0, "g.u", "7");
  Master master = b.load();
  run(master, 5);
  EXPECT_EQ(value(master, "i.y"), 2.5);
  EXPECT_EQ(value(master, "g.y"), 9.5);
  EXPECT_EQ(value(master, "i.start"), 2.5);
}

TEST(Wiring, RefusesInvalidConnectionsWithTheirPlace) {
  const auto refusal = [](const std::string& from, const std::string& to) {
    Build b;
    b.unit("a", "gain?n=3").unit("i", "integrator").unit("m", "mixed").unit("b", "gain?n=2").connect(from, to);
    return error_of([&] { b.load(); });
  };
  EXPECT_EQ(refusal("i.y", "i.u"), "test.ssd:41: i.y -> i.u: rad cannot feed rad/s");
  EXPECT_EQ(refusal("a.y", "b.u"), "test.ssd:41: a.y -> b.u: 3 elements cannot feed 2");
  EXPECT_EQ(refusal("m.real_out", "m.integer"), "test.ssd:41: m.real_out -> m.integer: real cannot feed integer");
  EXPECT_THAT(refusal("m.boolean_out", "m.real"), HasSubstr("boolean cannot feed real"));
  EXPECT_THAT(refusal("a.u", "b.u"), HasSubstr("a.u is a"));
  EXPECT_THAT(refusal("a.y", "b.y"), HasSubstr("expected an input or a parameter"));
  EXPECT_THAT(refusal("a.z", "b.u"), HasSubstr("component 'a' has no variable 'a.z'; did you mean"));
  EXPECT_THAT(refusal("a.y[4]", "b.u[1]"), HasSubstr("y has 3 elements"));
  EXPECT_THAT(refusal("x.y", "b.u[1]"), HasSubstr("there is no variable 'x.y'"));
}

TEST(Wiring, RefusesAnInputWithTwoSourcesAlsoForOneElement) {
  Build b;
  b.unit("a", "gain?n=3").unit("b", "gain?n=3").connect("a.y", "b.u").connect("a.y[1]", "b.u[3]");
  EXPECT_EQ(error_of([&] { b.load(); }), "test.ssd:41: a.y[1] -> b.u[3]: the input b.u[3] is already fed by a.y (test.ssd:41)");
  Build written_in_reverse;
  written_in_reverse.unit("a", "gain?n=3").unit("b", "gain?n=3").connect("b.u", "a.y").connect("a.y[1]", "b.u[3]");
  EXPECT_EQ(error_of([&] { written_in_reverse.load(); }),
            "test.ssd:41: a.y[1] -> b.u[3]: the input b.u[3] is already fed by a.y (test.ssd:41)");
}

// A connection would overwrite it. Values of files are those of an exported scenario, where inputs have start values.
TEST(Wiring, RefusesAValueThatTheUserGivesForAConnectedInput) {
  const auto load = [](const std::string& variable, bool by_user) {
    Build b;
    b.unit("a", "gain?n=3").unit("b", "gain?n=3").connect("a.y[1]", "b.u[2]");
    b.scenario.components[1].start_values.push_back({variable, "2", "", "--set b." + variable + "=2", by_user});
    return error_of([&] { b.load(); });
  };
  EXPECT_EQ(load("u", true),
            "--set b.u=2: b.u is connected to a.y[1], which sets it, expected a variable without a connection");
  EXPECT_THAT(load("u[2]", true), HasSubstr("b.u[2] is connected to a.y[1]"));
  EXPECT_EQ(load("u[1]", true), "");
  EXPECT_EQ(load("u", false), "");
}

TEST(Wiring, RefusesConnectorsThatTheUnitDoesNotHave) {
  const auto refusal = [](ConnectorSpec connector) {
    Build b;
    b.unit("a", "gain?n=3");
    connector.place = "test.ssd:7";
    b.scenario.components[0].connectors.push_back(connector);
    return error_of([&] { b.load(); });
  };
  EXPECT_EQ(refusal({"y", ConnectorKind::kOutput, "Real", "deg", ""}), "");
  EXPECT_EQ(refusal({"u[2]", ConnectorKind::kInput, "Real", "", ""}), "");
  EXPECT_THAT(refusal({"yy", ConnectorKind::kOutput, "Real", "", ""}), HasSubstr("test.ssd:7: connector 'a.yy'"));
  EXPECT_THAT(refusal({"y", ConnectorKind::kInput, "Real", "", ""}), HasSubstr("is of kind 'input'"));
  EXPECT_THAT(refusal({"y", ConnectorKind::kOutput, "Integer", "", ""}), HasSubstr("is Integer, but the variable is real"));
  EXPECT_THAT(refusal({"y", ConnectorKind::kOutput, "Real", "N.m", ""}),
              HasSubstr("N.m is not a measure of a variable in rad"));
}

TEST(Wiring, ReportsSettingsThatNoUnitHas) {
  Build b;
  b.unit("a", "gain");
  b.scenario.settings["nn"] = "3";
  EXPECT_THAT(error_of([&] { b.load(); }), HasSubstr("setting 'nn' = '3': no unit of this scenario has it; did you mean 'n'?"));
}

TEST(Wiring, ReportsASharedSettingThatEveryUnitOverrides) {
  Build b;
  b.unit("a", "gain?n=2");
  b.scenario.settings["n"] = "3";
  EXPECT_THAT(error_of([&] { b.load(); }), HasSubstr("setting 'n' = '3' has no effect: 'a' has its own value"));
}

TEST(Wiring, ReportsANameThatIsASettingAndNotAVariable) {
  Build b;
  b.unit("a", "gain").with("n", std::int64_t{2});
  EXPECT_THAT(error_of([&] { b.load(); }),
              HasSubstr("test.ssd:50: 'n' is a setting of unit:gain and no variable, expected it in the source"));
  Build other;
  other.unit("a", "picky").with("restoreable", true);
  EXPECT_THAT(error_of([&] { other.load(); }),
              HasSubstr("a: no variable and no setting 'restoreable'; did you mean 'restorable'?"));
}

TEST(Wiring, NamesTheComponentThatHasWhatAnotherLacks) {
  Build b;  // before and after the component that it was given to
  b.unit("a", "gain").unit("i", "integrator").with("gain", 2.0).unit("p", "picky");
  EXPECT_THAT(error_of([&] { b.load(); }), HasSubstr("i: no variable 'gain'; there is a.gain"));
  Build other;
  other.unit("a", "gain").with("restorable", true).unit("p", "picky");
  EXPECT_THAT(error_of([&] { other.load(); }),
              HasSubstr("a: no variable and no setting 'restorable'; there is p.restorable (a setting)"));
}

TEST(Wiring, RampsAnInputToTheValueThatAnEarlierStageHasReached) {
  // a integrates 2 rad/s to y = 2t; b follows y linearly over each step, so that ∫y is t² to rounding.
  Build b;
  b.unit("a", "integrator").with("u", 2.0);
  b.unit("b", "ramped", 1);
  b.connect("a.y", "b.u").as_it_is();
  b.until(0.1);
  Master master = b.load();
  run(master, 100);
  EXPECT_NEAR(value(master, "b.y"), 0.01, 1e-15);
}

TEST(Wiring, ExtrapolatesAnInputWhoseSourceStepsLater) {
  // The same with b first: from the second step on the slope is that of the step before, which is exact for y = 2t; only the
  // first step, without a known slope, has an error of h².
  Build b;
  b.unit("b", "ramped", 0).unit("a", "integrator", 1).with("u", 2.0);
  b.connect("a.y", "b.u").as_it_is();
  b.until(0.1);
  Master master = b.load();
  run(master, 100);
  EXPECT_NEAR(value(master, "b.y"), 0.01 - 1e-6, 1e-15);
}

TEST(Wiring, ExtrapolatesWithTheDeclaredDerivativeOfTheSource) {
  // As before, with dy/dt = 2 as an output of its own: the first step knows the slope, too.
  Build b;
  b.unit("b", "ramped", 0).unit("a", "telling_integrator", 1).with("u", 2.0);
  b.connect("a.y", "b.u").as_it_is();
  b.until(0.1);
  Master master = b.load();
  run(master, 100);
  EXPECT_NEAR(value(master, "b.y"), 0.01, 1e-15);
}

TEST(Wiring, HoldsAnInputWhoseSourceStepsMoreRarely) {
  Build b;
  b.unit("b", "ramped").unit("a", "integrator", 0, 10).with("u", 2.0);
  b.connect("a.y", "b.u").as_it_is();
  b.until(0.1);
  Master master = b.load();
  master.initialise();
  while (master.step_tick()) EXPECT_EQ(value(master, "b.du_seen"), 0);
}

TEST(Messages, NameAComponentOnce) {
  EXPECT_EQ(without_component("drive", "drive.K: is -1"), "K: is -1");
  EXPECT_EQ(without_component("drive", "drive: no robot"), "no robot");
  EXPECT_EQ(without_component("drive", "drives.K: is -1"), "drives.K: is -1");
  EXPECT_EQ(without_component("drive", "robot 'drive': no frame"), "robot 'drive': no frame");
}

}  // namespace
}  // namespace cotwin::master::wiring_test
