// Co-Simulation of FMUs with unusual behaviour; their sources and models are in fmus/rogue2.c and rogue3.c.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#ifdef __SANITIZE_ADDRESS__
#include <sanitizer/lsan_interface.h>
#endif

#include <cmath>
#include <cstdlib>

#include "fmu/import/foreign.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"

namespace cotwin::fmu::import_test {
namespace {

using namespace testing;
using cotwin::testing::error_of;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::ThrowsMessage;

// mode of rogue2.c
enum { kPolite2, kError2, kCrash2, kHang2, kFlood2, kNoInitialisation2, kTerminate2, kFatal2, kPending2, kHugeState2 };
// mode of rogue3.c
enum {
  kPolite3,
  kStandsStill3,
  kReturnsFromTheFuture3,
  kEndlessEvents3,
  kTerminates3,
  kDiscards3,
  kRefusesUpdates3,
  kNeedsCallback3
};

constexpr const char* kPosition = "der(position of \"it\").y";

class Import : public ::testing::Test {
 protected:
  Instance load2(int mode = kPolite2, const LoadOptions& options = {}, const Edits& edits = {}) {
    Instance instance = load(make_fmu("rogue2", folder_.path(), edits), options);
    integer(instance, "mode") = mode;
    return instance;
  }
  Instance load3(int mode = kPolite3, const LoadOptions& options = {}, const Edits& edits = {}) {
    Instance instance = load(make_fmu("rogue3", folder_.path(), edits), options);
    integer(instance, "mode") = mode;
    return instance;
  }
  TemporaryFolder folder_;
};

TEST_F(Import, DeclaresVariablesByTheirOwnNamesWithRolesAndMeasures) {
  const Instance instance = load2();
  const Variables& v = instance.variables;
  EXPECT_EQ(v.at("u").role, Role::kInput);
  EXPECT_EQ(v.at("u").si, "m/s");
  EXPECT_EQ(v.at("u").rate.size(), 1u);
  EXPECT_EQ(v.at(kPosition).role, Role::kOutput);
  EXPECT_EQ(v.at("y in mm").role, Role::kState);
  EXPECT_EQ(v.at("y in mm").si, "m");
  EXPECT_EQ(v.at("longest_step").role, Role::kParameter);
  EXPECT_EQ(v.at("longest_step").si, "");
  EXPECT_EQ(v.at("longest_step").reals()[0], 1e9);
  EXPECT_EQ(v.at("off").kind(), Kind::kBoolean);
  EXPECT_EQ(v.at("reversed").kind(), Kind::kString);
  EXPECT_EQ(find_element(v, kPosition).variable, &v.at(kPosition));
  EXPECT_THAT(instance.warnings, ElementsAre(HasSubstr("unit 'furlong' is not defined")));
}

TEST_F(Import, ConvertsToSiByTheDescriptionsOwnUnits) {
  Instance instance = load2();
  instance.unit->initialise({});
  real(instance, "u") = 2;
  EXPECT_EQ(step(instance, 0, 0.5), StepResult::kDone);
  EXPECT_DOUBLE_EQ(real(instance, kPosition), 1.0);
  EXPECT_DOUBLE_EQ(real(instance, "y in mm"), 1e-3);  // the same number, in millimetres
}

TEST_F(Import, ConvertsInputsToTheUnitOfTheFmu) {
  Instance instance = load2(kPolite2, {}, {{"<Real start=\"0\" unit=\"m/s\"/>", "<Real start=\"7.2\" unit=\"km/h\"/>"}});
  EXPECT_EQ(instance.variables.at("u").si, "m/s");
  EXPECT_DOUBLE_EQ(real(instance, "u"), 2);
  real(instance, "u") = 5;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 1), StepResult::kDone);
  EXPECT_DOUBLE_EQ(real(instance, kPosition), 18);  // 5 m/s are 18 km/h
}

TEST_F(Import, PassesRatesOnAsInputDerivatives) {
  Instance instance = load2();
  instance.unit->initialise({});
  real(instance, "u") = 1;
  instance.variables.at("u").rate[0] = 4;
  EXPECT_EQ(step(instance, 0, 0.5), StepResult::kDone);
  EXPECT_DOUBLE_EQ(real(instance, kPosition), 1 * 0.5 + 4 * 0.125);
  // The FMU has changed its input to 3 by itself, so 1 must be set again.
  instance.variables.at("u").rate[0] = 0;
  EXPECT_EQ(step(instance, 0.5, 0.5), StepResult::kDone);
  EXPECT_DOUBLE_EQ(real(instance, kPosition), 1.0 + 0.5);
}

const Edits kSlopes2 = {{"canInterpolateInputs", "maxOutputDerivativeOrder=\"1\" canInterpolateInputs"}};
const Edits kSlopes3 = {{"hasEventMode", "maxOutputDerivativeOrder=\"1\" hasEventMode"}};

TEST_F(Import, GetsTheSlopesOfOutputsOnRequest) {
  const LoadOptions slopes = read_query("slopes=true", {});
  const std::string name = "der(" + std::string(kPosition) + ")";
  EXPECT_EQ(load2(kPolite2, {}, kSlopes2).variables.find(name), nullptr) << "not requested";
  for (const ProcessChoice process : {ProcessChoice::kShared, ProcessChoice::kOwn}) {
    LoadOptions options = slopes;
    options.process = process;
    Instance instance = load2(kPolite2, options, kSlopes2);
    const Variable& slope = instance.variables.at(name);
    EXPECT_EQ(slope.role, Role::kState);
    EXPECT_EQ(slope.si, "m/s");
    EXPECT_EQ(slope.derivative_of, kPosition);
    for (int run = 0; run < 2; ++run) {
      instance.unit->initialise({});
      EXPECT_EQ(slope.reals()[0], 0) << "an FMU reports it after a step";
      real(instance, "u") = 2;
      EXPECT_EQ(step(instance, 0, 0.5), StepResult::kDone);
      EXPECT_EQ(slope.reals()[0], 2);  // y' = u
      real(instance, "u") = -3;
      EXPECT_EQ(step(instance, 0.5, 0.5), StepResult::kDone);
      EXPECT_EQ(slope.reals()[0], -3);
    }
  }
}

TEST_F(Import, AsksForTheSlopesOfArraysInFmi3) {
  Instance instance = load3(kPolite3, read_query("slopes=true&structural.n=2", {}), kSlopes3);
  const Variable& slope = instance.variables.at("der(y)");
  ASSERT_EQ(slope.size(), 2u);
  EXPECT_EQ(slope.derivative_of, "y");
  instance.unit->initialise({});
  real(instance, "u", 0) = 4;
  real(instance, "u", 1) = 5;
  EXPECT_EQ(run(instance, 0, 0.4, 0.1), StepResult::kDone);  // with an event during the step
  EXPECT_EQ(slope.reals()[0], 4);
  EXPECT_EQ(slope.reals()[1], 5);
}

// z is first, so that calls after the refusal go to another instance.
const Edits kSlopesOfSome2 = {
    kSlopes2.front(),
    {"<ModelVariables>",
     "<ModelVariables><ScalarVariable name=\"z\" valueReference=\"4\" causality=\"output\" variability=\"continuous\" "
     "initial=\"calculated\"><Real unit=\"m\"/></ScalarVariable>"},
    {"<Outputs><Unknown index=\"2\"/><Unknown index=\"7\"/><Unknown index=\"9\"/>",
     "<Outputs><Unknown index=\"1\"/><Unknown index=\"3\"/><Unknown index=\"8\"/><Unknown index=\"10\"/>"},
    {"<InitialUnknowns><Unknown index=\"2\"/><Unknown index=\"7\"/><Unknown index=\"9\"/>",
     "<InitialUnknowns><Unknown index=\"1\"/><Unknown index=\"3\"/><Unknown index=\"8\"/><Unknown index=\"10\"/>"}};

TEST_F(Import, UsesTheSlopeOfTheLastStepIfAnFmuRefusesToProvideIt) {
  LoadOptions options = read_query("slopes=true", {});
  for (const ProcessChoice process : {ProcessChoice::kShared, ProcessChoice::kOwn}) {
    options.process = process;
    Instance instance = load2(kPolite2, options, kSlopesOfSome2);
    const Variable &z = instance.variables.at("der(z)"), &y = instance.variables.at("der(" + std::string(kPosition) + ")");
    EXPECT_EQ(z.derivative_of, "z");
    const auto expect_step = [&](double from, double u, double du, const char* when) {
      real(instance, "u") = u;
      instance.variables.at("u").rate[0] = du;
      ASSERT_EQ(step(instance, from, 0.5), StepResult::kDone) << when;
      EXPECT_NEAR(z.reals()[0], 2 * (u + 0.25 * du), 1e-12) << when << ": the mean of z' = 2 u over the step";
      EXPECT_NEAR(y.reals()[0], u + 0.5 * du, 1e-12) << when << ": y' = u at its end, as the FMU reports it";
    };
    for (int run = 0; run < 2; ++run) {
      instance.unit->initialise({});
      EXPECT_EQ(z.reals()[0], 0);
      expect_step(0, 2, 0, "first");
      Snapshot snapshot;
      snapshot.take(instance.variables, *instance.unit);
      expect_step(0.5, -3, 4, "second");
      snapshot.restore(instance.variables, *instance.unit);
      EXPECT_EQ(z.reals()[0], 4);
      expect_step(0.5, 5, 0, "after going back");
    }
    if (options.process == ProcessChoice::kOwn) continue;
    std::vector<std::string> notes;
    instance.unit->append_notes(notes);
    EXPECT_THAT(notes,
                ElementsAre(HasSubstr("the FMU gives no derivative of 'z' (fmi2GetRealOutputDerivatives returned error")));
    const std::uint64_t before = cotwin::testing::allocations();
    for (int i = 2; i < 10; ++i) EXPECT_EQ(step(instance, 0.5 * i, 0.5), StepResult::kDone);
    EXPECT_EQ(cotwin::testing::allocations(), before);
  }
}

TEST_F(Import, RefusesSlopesThatAnFmuDoesNotProvide) {
  const LoadOptions slopes = read_query("slopes=true", {});
  EXPECT_THAT([&] { load2(kPolite2, slopes); },
              ThrowsMessage<Error>(HasSubstr("rogue2.fmu: slopes=true: the FMU gives no derivatives of outputs, expected")));
  const Edits promises = {{"hasEventMode", "maxOutputDerivativeOrder=\"1\" hasEventMode"},
                          {"\"pushed\" valueReference=\"16\" causality=\"output\" variability=\"discrete\"",
                           "\"pushed\" valueReference=\"16\" causality=\"output\" variability=\"continuous\""}};
  EXPECT_THAT([&] { load(make_fmu("clocks3", folder_.path(), promises), slopes); },
              ThrowsMessage<Error>(HasSubstr("fmi3GetOutputDerivatives")));
}

TEST_F(Import, CarriesBooleansAndTexts) {
  Instance instance = load2();
  instance.variables.at("on").booleans()[0] = true;
  instance.variables.at("text").strings()[0] = "robot";
  instance.unit->initialise({});
  EXPECT_FALSE(instance.variables.at("off").booleans()[0]);
  EXPECT_EQ(instance.variables.at("reversed").strings()[0], "tobor");
  instance.variables.at("on").booleans()[0] = false;
  instance.variables.at("text").strings()[0] = "twin";
  EXPECT_EQ(step(instance, 0, 1e-3), StepResult::kDone);
  EXPECT_TRUE(instance.variables.at("off").booleans()[0]);
  EXPECT_EQ(instance.variables.at("reversed").strings()[0], "niwt");
}

TEST_F(Import, GivesADiscardedStepBackToTheMaster) {
  Instance instance = load2();
  real(instance, "longest_step") = 0.01;
  instance.unit->initialise({});
  real(instance, "u") = 1;
  ASSERT_TRUE(instance.unit->restorable());
  Snapshot before;
  before.take(instance.variables, *instance.unit);
  EXPECT_EQ(step(instance, 0, 0.02), StepResult::kDiscard);
  before.restore(instance.variables, *instance.unit);
  EXPECT_EQ(run(instance, 0, 0.02, 0.01), StepResult::kDone);
  EXPECT_DOUBLE_EQ(real(instance, kPosition), 0.02);
}

TEST_F(Import, ReportsTheLogOfTheFmuWithItsError) {
  Instance instance = load2(kError2);
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.9, 0.1), StepResult::kDone);
  EXPECT_THAT([&] { (void)step(instance, 0.9, 0.1); },
              ThrowsMessage<Error>(::testing::AllOf(HasSubstr("rogue2.fmu: fmi2DoStep returned error"),
                                                    HasSubstr("[error, logStatusError] the sum does not converge"))));
  EXPECT_THAT([&] { (void)step(instance, 0.9, 0.1); }, ThrowsMessage<Error>(HasSubstr("has failed")));
  integer(instance, "mode") = kPolite2;
  instance.unit->initialise({});
  real(instance, "u") = 1;
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
  EXPECT_NEAR(real(instance, kPosition), 1, 1e-12);
}

TEST_F(Import, ReportsWhyInstantiationFailsAndLeavesNoFiles) {
  const std::size_t before = temporary_folders();
  LoadOptions options;
  options.instance_name = "refused";
  EXPECT_THAT(
      [&] { load2(kPolite2, options); },
      ThrowsMessage<Error>(::testing::AllOf(HasSubstr("fmi2Instantiate returned no instance"), HasSubstr("100% sure"))));
  EXPECT_EQ(temporary_folders(), before);
  EXPECT_THAT(
      [&] {
        load2(kPolite2, {}, {{"guid=\"{rogue}\"", "guid=\"{another}\""}});
      },
      ThrowsMessage<Error>(HasSubstr("no instance")));
}

TEST_F(Import, ReportsWhyInitialisationFails) {
  Instance instance = load2(kNoInitialisation2);
  EXPECT_THAT([&] { instance.unit->initialise({}); }, ThrowsMessage<Error>(HasSubstr("no initial values can be found")));
  integer(instance, "mode") = kPolite2;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDone);
}

// fmi2FreeInstance of rogue2.c aborts in this case. The memory of the FMU is lost, which a sanitizer would report.
TEST_F(Import, CallsNothingAfterAFatalError) {
#ifdef __SANITIZE_ADDRESS__
  const __lsan::ScopedDisabler lost;
#endif
  Instance instance = load2(kFatal2);
  instance.unit->initialise({});
  EXPECT_THAT([&] { (void)step(instance, 0, 1); },
              ThrowsMessage<Error>(HasSubstr("returned fatal; messages of the FMU: [fatal")));
}

TEST_F(Import, EndsTheRunWhenTheFmuRequestsIt) {
  Instance instance = load2(kTerminate2);
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.9, 0.1), StepResult::kDone);
  real(instance, "u") = 1;
  EXPECT_EQ(step(instance, 0.9, 0.1), StepResult::kFinished);
  EXPECT_NEAR(real(instance, kPosition), 0.1, 1e-12);  // the time that was reached is kept
  EXPECT_THAT([&] { (void)step(instance, 1, 0.1); }, ThrowsMessage<Error>(HasSubstr("ended the simulation")));
}

TEST_F(Import, WaitsForAStepThatIsPending) {
  Instance instance = load2(kPending2);
  instance.unit->initialise({});
  real(instance, "u") = 1;
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
  EXPECT_NEAR(real(instance, kPosition), 1, 1e-12);
}

TEST_F(Import, UsesAConstantStepIfTheFmuRequiresIt) {
  Instance instance = load2(
      kPolite2, {}, {{"canHandleVariableCommunicationStepSize=\"true\"", "canHandleVariableCommunicationStepSize=\"false\""}});
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.5, 0.1), StepResult::kDone);
  EXPECT_THAT([&] { (void)step(instance, 0.5, 0.05); },
              ThrowsMessage<Error>(HasSubstr("equal communication steps, got 0.05 s after 0.1 s")));
}

TEST_F(Import, StartsAgainWithAnotherInstance) {
  for (const char* name : {"any", "no reset"}) {
    LoadOptions options;
    options.instance_name = name;
    Instance instance = load2(kPolite2, options);
    for (int round = 0; round < 3; ++round) {
      real(instance, "u") = 0;
      instance.unit->initialise({});
      EXPECT_EQ(real(instance, kPosition), 0) << name;
      real(instance, "u") = 1;
      EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
      EXPECT_NEAR(real(instance, kPosition), 1, 1e-12);
    }
  }
}

TEST_F(Import, ContinuesInAFreshInstanceFromASnapshotsBytes) {
  for (const double u : {0.7, 0.0}) {  // 0 was already set in a fresh instance, but not in the instance that provides the state
    Instance one = load2(), other = load2();
    one.unit->initialise({});
    real(one, "u") = 0.3;
    ASSERT_EQ(run(one, 0, 0.5, 0.1), StepResult::kDone);
    real(one, "u") = u;  // set, but not yet passed to the FMU
    Snapshot snapshot;
    snapshot.take(one.variables, *one.unit);
    const std::string bytes = snapshot.serialise();
    Snapshot::deserialise(bytes).restore(other.variables, *other.unit);
    ASSERT_EQ(run(one, 0.5, 1, 0.1), StepResult::kDone);
    ASSERT_EQ(run(other, 0.5, 1, 0.1), StepResult::kDone);
    EXPECT_EQ(real(one, kPosition), real(other, kPosition));
    EXPECT_NEAR(real(one, kPosition), 0.15 + 0.5 * u, 1e-12);
  }
}

TEST_F(Import, RefusesAStateThatIsTooLarge) {
  Instance instance = load2(kHugeState2);
  instance.unit->initialise({});
  Snapshot snapshot;
  EXPECT_THAT([&] { snapshot.take(instance.variables, *instance.unit); },
              ThrowsMessage<Error>(HasSubstr("1152921504606846976 bytes")));
}

TEST_F(Import, RefusesASnapshotWithoutTheFmusState) {
  Instance instance = load2();
  instance.unit->initialise({});
  Snapshot snapshot;
  snapshot.take(instance.variables);
  EXPECT_THAT([&] { snapshot.restore(instance.variables, *instance.unit); },
              ThrowsMessage<Error>(HasSubstr("no state of this FMU")));
}

TEST_F(Import, LimitsAFloodOfMessages) {
  Instance instance = load2(kFlood2);
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 0.2, 1e-3), StepResult::kDone);  // 200 000 messages of 3000 characters
}

TEST(ForeignMessages, AreLimitedInNumberAndLengthAndHaveNoControlCharacters) {
  Messages messages;
  for (int i = 0; i < 10'000; ++i) messages.add("warning", "all", std::to_string(i) + std::string(100'000, 'x'));
  messages.add("error", "", "\x1b[2Jlast\n");
  const std::string all = messages.take();
  EXPECT_LT(all.size(), 5000u);
  EXPECT_THAT(all, HasSubstr("(the last of 10001)"));
  EXPECT_THAT(all, HasSubstr("[error]  [2Jlast"));
  EXPECT_EQ(messages.take(), "");
  EXPECT_EQ(messages.count(), 10'001u);
}

TEST_F(Import, AllocatesNothingInAStep) {
  Instance instance = load2();
  instance.variables.at("text").strings()[0] = "text";
  instance.unit->initialise({});
  for (int i = 0; i < 5; ++i) EXPECT_EQ(step(instance, i * 0.1, 0.1), StepResult::kDone);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int i = 5; i < 50; ++i) {
    real(instance, "u") = i;
    instance.variables.at("on").booleans()[0] = i % 2 == 0;
    (void)step(instance, i * 0.1, 0.1);
  }
  EXPECT_EQ(cotwin::testing::allocations(), before);
}

TEST_F(Import, HasArraysAsVectorsOfTheSizeThatStructuralParametersGive) {
  Instance three = load3();
  EXPECT_EQ(three.variables.at("u").size(), 3u);
  LoadOptions options;
  options.structural["n"] = 5;
  Instance five = load3(kPolite3, options);
  ASSERT_EQ(five.variables.at("y").size(), 5u);
  EXPECT_EQ(five.variables.at("n").reals()[0], 5);
  five.unit->initialise({});
  for (std::size_t i = 0; i < 5; ++i) real(five, "u", i) = static_cast<double>(i);
  EXPECT_EQ(run(five, 0, 1, 0.01), StepResult::kDone);
  for (std::size_t i = 0; i < 5; ++i) EXPECT_NEAR(real(five, "y", i), static_cast<double>(i), 1e-12);
  EXPECT_NEAR(real(five, "position", 4), 4, 1e-12);  // the alias
  options.structural = {{"m", 5}};
  EXPECT_THAT([&] { load3(kPolite3, options); }, ThrowsMessage<Error>(HasSubstr("no structural parameter")));
  three.variables.at("n").reals()[0] = 4;
  EXPECT_THAT([&] { three.variables.check_ranges(); }, ThrowsMessage<Error>(HasSubstr("expected 3 to 3")));
}

TEST_F(Import, ShortIntegersHaveTheRangeOfTheirTypeAndNeverWrap) {
  Instance instance = load3();
  instance.unit->initialise({});
  double t = 0;
  for (const auto& [given, expected] : {std::pair(-128, -128), {127, 127}, {128, 127}, {-129, -128}, {1'000'000, 127}}) {
    integer(instance, "tiny") = given;
    EXPECT_EQ(step(instance, t, 0.01), StepResult::kDone);
    EXPECT_EQ(integer(instance, "tiny_out"), expected);
    t += 0.01;
  }
  EXPECT_THAT([&] { instance.variables.check_ranges(); }, ThrowsMessage<Error>(HasSubstr("expected -128 to 127")));
}

// As in Roberts of the Reference FMUs: it changes the structure and no size.
TEST_F(Import, SetsStructuralParametersThatAreNoSizesInTheConfigurationMode) {
  for (const bool mirrored : {false, true}) {
    LoadOptions options;
    if (mirrored) options.structural["n"] = 2;
    Instance instance = load3(kPolite3, options);
    instance.variables.at("mirrored").booleans()[0] = mirrored;
    instance.unit->initialise({});
    real(instance, "u") = 1;
    EXPECT_EQ(run(instance, 0, 1, 0.01), StepResult::kDone);
    EXPECT_NEAR(real(instance, "y"), mirrored ? -1 : 1, 1e-12);
  }
  LoadOptions options;
  options.structural["mirrored"] = 1;
  EXPECT_THAT([&] { load3(kPolite3, options); }, ThrowsMessage<Error>(HasSubstr("'mirrored': is Boolean and not a size")));
}

// Every step of 10 ms is divided into two, and at 0.3, 0.6 and 0.9 s there is an event.
TEST_F(Import, ContinuesAfterEarlyReturnsAndHandlesEventsOnTheWay) {
  Instance instance = load3();
  instance.unit->initialise({});
  real(instance, "u") = 2;
  EXPECT_EQ(run(instance, 0, 1, 0.01), StepResult::kDone);
  EXPECT_NEAR(real(instance, "y"), 2, 1e-12);
  EXPECT_EQ(integer(instance, "events"), 3);
  EXPECT_EQ(run(instance, 1, 1.7, 0.7), StepResult::kDone);  // over 1.2 and 1.5 s in one step
  EXPECT_EQ(integer(instance, "events"), 5);
  EXPECT_NEAR(real(instance, "y"), 3.4, 1e-12);
}

TEST_F(Import, SetsDiscreteInputsInEventMode) {
  Instance instance = load3();
  instance.unit->initialise({});
  integer(instance, "d") = 7;
  EXPECT_EQ(run(instance, 0, 0.1, 0.01), StepResult::kDone);
  integer(instance, "d") = 8;
  EXPECT_EQ(step(instance, 0.1, 0.01), StepResult::kDone);
}

// The FMU integrates by the midpoint rule and gets its inputs there: exact for a ramp.
TEST_F(Import, RampsInputsInIntermediateUpdates) {
  Instance instance = load3();
  instance.unit->initialise({});
  real(instance, "u", 1) = 1;
  instance.variables.at("u").rate[1] = 3;
  EXPECT_EQ(step(instance, 0, 0.2), StepResult::kDone);
  EXPECT_NEAR(real(instance, "y", 1), 1 * 0.2 + 3 * 0.02, 1e-15);
  instance.variables.at("u").rate[1] = 0;
  EXPECT_EQ(step(instance, 0.2, 0.2), StepResult::kDone);
  EXPECT_NEAR(real(instance, "y", 1), 0.26 + 0.2, 1e-15);
}

TEST_F(Import, AsksForAnEarlyReturnWhereAnIntermediateUpdateIsRefused) {
  const Edits edits = {{"providesIntermediateUpdate=\"true\"",
                        "providesIntermediateUpdate=\"true\" canReturnEarlyAfterIntermediateUpdate=\"true\""}};
  Instance instance = load(make_fmu("rogue3", folder_.path(), edits));
  integer(instance, "mode") = kRefusesUpdates3;
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDone);  // nothing to set in between
  instance.variables.at("u").rate[0] = 1;
  EXPECT_THAT([&] { (void)step(instance, 0.1, 0.1); },
              ThrowsMessage<Error>(::testing::AllOf(HasSubstr("an intermediate update of the step from 0.1 s failed"),
                                                    HasSubstr("u is not to my liking"),
                                                    HasSubstr("returns early as it was asked to"))));
}

TEST_F(Import, PassesTheCallbackToAnFmuThatNeedsItEvenIfNoInputIsSetInIt) {
  Instance instance = load(make_fmu("rogue3", folder_.path(), {{" intermediateUpdate=\"true\"", ""}}));
  integer(instance, "mode") = kNeedsCallback3;
  instance.unit->initialise({});
  EXPECT_TRUE(instance.variables.at("u").rate.empty());
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDone);
}

TEST_F(Import, ReportsTheRequestsOfTheFmuAfterwards) {
  Instance polite = load3(), discards = load3(kDiscards3);
  polite.unit->initialise({});
  EXPECT_EQ(run(polite, 0, 1, 0.01), StepResult::kDone);
  std::vector<std::string> notes;
  polite.unit->append_notes(notes);
  EXPECT_THAT(
      notes, ElementsAre("100 early returns from a step; the step was continued from there", "3 events handled in event mode"));
  discards.unit->initialise({});
  Snapshot before;
  before.take(discards.variables, *discards.unit);
  EXPECT_EQ(step(discards, 0, 0.1), StepResult::kDiscard);
  notes.clear();
  discards.unit->append_notes(notes);
  EXPECT_THAT(notes, ElementsAre("1 step discarded, the last one at 0 s"));
}

TEST_F(Import, CarriesBinariesAsHexadecimalDigitsAndLargeIntegersAsReals) {
  Instance instance = load3();
  instance.variables.at("bytes").strings()[0] = "00ff7E";
  real(instance, "big") = 9007199254740992.0;  // 2^53
  real(instance, "small") = 0.1;
  instance.variables.at("flags").booleans()[1] = true;
  instance.unit->initialise({});
  EXPECT_EQ(instance.variables.at("echo").strings()[0], "00ff7e");
  EXPECT_EQ(real(instance, "big_out"), 9007199254740992.0);
  EXPECT_EQ(real(instance, "twice"), static_cast<double>(2 * 0.1f));
  real(instance, "big") = -9223372036854775808.0;
  instance.variables.at("bytes").strings()[0] = "";
  EXPECT_EQ(step(instance, 0, 0.01), StepResult::kDone);
  EXPECT_EQ(real(instance, "big_out"), -9223372036854775808.0);
  EXPECT_EQ(instance.variables.at("echo").strings()[0], "");
  instance.variables.at("bytes").strings()[0] = "0g";
  EXPECT_THAT([&] { (void)step(instance, 0.01, 0.01); }, ThrowsMessage<Error>(HasSubstr("hexadecimal")));
}

TEST_F(Import, RefusesIntegersThatRealsDoNotHave) {
  for (const auto& [start, exact] : {std::pair{"9007199254740993", false},
                                     {"-9007199254740993", false},
                                     {"9007199254740994", true},
                                     {"9223372036854775807", false},
                                     {"-9223372036854775808", true}}) {
    setenv("COTWIN_BIG", start, 1);
    Instance instance = load3();
    instance.unit->initialise({});
    const std::string message = error_of([&] { (void)step(instance, 0, 0.01); });
    if (exact) {
      EXPECT_EQ(message, "");
      EXPECT_EQ(real(instance, "big_out"), std::strtod(start, nullptr));
    } else {
      EXPECT_THAT(message, HasSubstr(std::string("'big_out': ") + start + " cannot be recorded exactly"));
    }
  }
  unsetenv("COTWIN_BIG");
  for (const double value : {1e30, 9223372036854775808.0, std::nan("")}) {
    Instance instance = load3();
    instance.unit->initialise({});
    real(instance, "big") = value;
    EXPECT_THAT(error_of([&] { (void)step(instance, 0, 0.01); }), HasSubstr("expected a number that Int64 has"));
  }
}

// 2^53 + 1, which double does not have, and the largest ones: what the FMU gets is read back as text.
TEST_F(Import, SendsStartValuesOf64BitsExactly) {
  for (const std::string start : {"9007199254740993", "-9007199254740993", "9223372036854775807", "9007199254740992", "7"}) {
    const bool exact = std::to_string(static_cast<long long>(std::strtod(start.c_str(), nullptr))) == start;
    const auto read_back = [&](Instance& instance) {
      return error_of([&] {
        instance.unit->initialise({});
        (void)step(instance, 0, 0.01);
      });
    };
    Instance given = load3();
    assign_text(given.variables.at("big"), start);
    const std::string message = read_back(given);
    if (exact) {
      EXPECT_EQ(message, "");
      EXPECT_EQ(real(given, "big_out"), std::strtod(start.c_str(), nullptr));
    } else {
      EXPECT_THAT(message, HasSubstr("'big_out': " + start + " cannot be recorded exactly"));
    }
    Instance described = load3(kPolite3, {},
                               {{R"(<Int64 name="big" valueReference="8" causality="input" start="0"/>)",
                                 R"(<Int64 name="big" valueReference="8" causality="input" start=")" + start + R"("/>)"}});
    EXPECT_EQ(read_back(described), message);
  }
  Instance instance = load3();
  const Variable& big = instance.variables.at("big");
  EXPECT_THAT(error_of([&] { assign_text(big, "1.5"); }), HasSubstr("big: 1.5, expected an integer"));
  EXPECT_THAT(error_of([&] { assign_text(big, "99999999999999999999"); }), HasSubstr("expected an integer of 64 bits"));
  assign_text(big, "9007199254740993");
  real(instance, "big") = 3;  // by a connection or an event
  instance.unit->initialise({});
  EXPECT_EQ(step(instance, 0, 0.01), StepResult::kDone);
  EXPECT_EQ(real(instance, "big_out"), 3);
  ParameterSet set;
  set.values.emplace_back();
  set.values.back().name = "big";
  set.values.back().value = std::int64_t{9007199254740993};
  apply(set, instance.variables);
  EXPECT_TRUE(big.exact->contains(big.reals().data()));
  // The largest UInt64 is that number, not 2^64.
  for (const std::string start : {"18446744073709551615", "18446744073709551614"}) {
    Instance largest = load3();
    assign_text(largest.variables.at("largest"), start);
    EXPECT_EQ(error_of([&] { largest.unit->initialise({}); }).empty(), start.back() == '5') << start;
  }
}

TEST_F(Import, RefusesAnFmuThatDoesNotAdvanceOrPassesTheEndOfItsStep) {
  Instance still = load3(kStandsStill3);
  still.unit->initialise({});
  EXPECT_THAT([&] { (void)step(still, 0, 0.01); },
              ThrowsMessage<Error>(HasSubstr("too often without completing the step: at 0 s, expected 0.01 s")));
  Instance future = load3(kReturnsFromTheFuture3);
  future.unit->initialise({});
  EXPECT_THAT([&] { (void)step(future, 0, 0.01); }, ThrowsMessage<Error>(HasSubstr("reports to have reached 0.02 s")));
  Instance endless = load3(kEndlessEvents3);
  EXPECT_THAT([&] { endless.unit->initialise({}); }, ThrowsMessage<Error>(HasSubstr("did not converge in")));
}

TEST_F(Import, EndsWhereAnFmi3FmuTerminates) {
  Instance instance = load3(kTerminates3);
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 2, 0.1), StepResult::kFinished);
}

// This FMU cannot serialise its states: they stay in it, and snapshots refer to them by number.
TEST_F(Import, RestoresStatesThatStayInTheFmuAsLongAsTheyAreKept) {
  Instance instance = load3(kDiscards3, read_query("rollback=true", {}));
  EXPECT_FALSE(load3(kDiscards3).unit->restorable()) << "the FMU was promised that no state is restored";
  instance.unit->initialise({});
  real(instance, "u") = 1;
  Snapshot early, late;
  early.take(instance.variables, *instance.unit);
  EXPECT_EQ(step(instance, 0, 0.1), StepResult::kDiscard);
  early.restore(instance.variables, *instance.unit);
  EXPECT_EQ(run(instance, 0, 0.1, 0.01), StepResult::kDone);
  EXPECT_NEAR(real(instance, "y"), 0.1, 1e-12);
  for (int i = 0; i < 20; ++i) late.take(instance.variables, *instance.unit);  // each replaces the one before
  early.restore(instance.variables, *instance.unit);
  std::vector<Snapshot> others(15);
  for (Snapshot& other : others) other.take(instance.variables, *instance.unit);
  late.restore(instance.variables, *instance.unit);
  EXPECT_THAT([&] { early.restore(instance.variables, *instance.unit); }, ThrowsMessage<Error>(HasSubstr("no longer kept")));
}

TEST_F(Import, KeepsUnchangedStartValuesInANewInstance) {
  // `y` of rogue2 with a start value: exact, and changed by the steps.
  Instance instance =
      load2(kPolite2, {}, {{"initial=\"calculated\"><Real unit=\"m\"/>", "initial=\"approx\"><Real start=\"0\" unit=\"m\"/>"}});
  EXPECT_TRUE(instance.variables.at(kPosition).has_start);
  real(instance, "u") = 1;
  instance.unit->initialise({});
  EXPECT_EQ(run(instance, 0, 1, 0.1), StepResult::kDone);
  EXPECT_NEAR(real(instance, kPosition), 1, 1e-12);
  instance.unit->initialise({});  // fmi2SetReal would refuse it if 1 were taken for a start value
  EXPECT_EQ(real(instance, kPosition), 0);
}

}  // namespace
}  // namespace cotwin::fmu::import_test
