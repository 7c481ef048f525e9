// Correct and incorrect calls of a host to an exported unit, in both versions of FMI, with a unit for this test (probe.h).
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <malloc.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <thread>

#include "fmu/export/pack.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/driver.h"
#include "tests/fmu/probe.h"

namespace cotwin::fmu::interface_test {
namespace {

using ::testing::AllOf;
using testing::Driver;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::LoadedFmu;
using testing::Message;
using testing::references;

constexpr int kOk = 0, kWarning = 1, kDiscardStatus = 2, kErrorStatus = 3;

const UnitType kProbe{"probe", "shows what is done with a unit",
                      [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<probe::Probe>(s); },
                      &probe::Probe::declare_settings};

class Interface : public ::testing::TestWithParam<Version> {
 protected:
  void pack(const std::string& source = "unit:probe") {
    static TemporaryFolder archives;  // each is written once
    std::string name = source + (GetParam() == Version::k2 ? ".2.fmu" : ".3.fmu");
    std::replace(name.begin(), name.end(), ':', '_');
    if (!std::filesystem::exists(archives.path() / name)) {
      PackRequest request;
      request.source = source;
      request.types = std::span(&kProbe, 1);
      request.version = GetParam();
      request.libraries = COTWIN_PROBE_LIBRARIES;
      pack_unit(request, archives.path() / name);
    }
    loaded_.push_back(std::make_unique<LoadedFmu>(archives.path() / name, GetParam()));
    fmu_ = loaded_.back().get();
    Settings settings("probe", source.find('?') == std::string::npos ? "" : source.substr(source.find('?') + 1), {}, {});
    unit_ = construct(kProbe, settings);
    variables_ = {};
    unit_->declare(variables_);
  }
  void SetUp() override { pack(); }

  std::vector<unsigned> refs(const char* name) const { return references(variables_, name, GetParam()); }
  template <class T>
  std::vector<T> get(Driver& d, const char* name) const {
    std::vector<T> values(variables_.at(name).size());
    EXPECT_EQ(d.get(refs(name), std::span<T>(values)), kOk) << d.last_message();
    return values;
  }
  bool get_flag(Driver& d, const char* name) const {
    bool value = false;
    EXPECT_EQ(d.get(refs(name), std::span<bool>(&value, 1)), kOk) << d.last_message();
    return value;
  }
  template <class T>
  int set(Driver& d, const char* name, const std::vector<T>& values) const {
    return d.set(refs(name), std::span<const T>(values));
  }

  TemporaryFolder folder_;
  std::vector<std::unique_ptr<LoadedFmu>> loaded_;  // all of them, because drivers of an earlier one may still exist
  LoadedFmu* fmu_ = nullptr;                        // the last
  std::unique_ptr<Unit> unit_;
  Variables variables_;
};

TEST_P(Interface, NamesItsVersion) {
  if (GetParam() == Version::k2) {
    EXPECT_STREQ(fmu_->function<decltype(&fmi2GetVersion)>("fmi2GetVersion")(), "2.0");
    EXPECT_STREQ(fmu_->function<decltype(&fmi2GetTypesPlatform)>("fmi2GetTypesPlatform")(), "default");
  } else {
    EXPECT_STREQ(fmu_->function<decltype(&fmi3GetVersion)>("fmi3GetVersion")(), "3.0");
  }
}

TEST_P(Interface, SetsAndGetsValuesOfEveryKind) {
  Driver d(*fmu_);
  ASSERT_TRUE(d.alive()) << d.last_message();
  EXPECT_EQ(set<double>(d, "u", {1, 2, 3}), kOk);
  EXPECT_EQ(set<double>(d, "gain", {4, 5, 6}), kOk);
  EXPECT_EQ(set<std::string>(d, "word", {"größer"}), kOk);
  d.initialise();
  EXPECT_THAT(get<std::string>(d, "echo"), ElementsAre("größer"));
  EXPECT_EQ(d.step(0, 0.5), kOk);
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(2, 5, 9));  // gain · u · 0.5 s
  EXPECT_THAT(get<std::int32_t>(d, "h"), ElementsAre(500'000'000));
  EXPECT_TRUE(get_flag(d, "moved"));
  const bool off = false;
  EXPECT_EQ(d.set(refs("on"), std::span<const bool>(&off, 1)), kOk);
  EXPECT_EQ(d.step(0.5, 0.5), kOk);
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(2, 5, 9));
  EXPECT_FALSE(get_flag(d, "moved"));
  double time = -1;
  EXPECT_EQ(d.get(std::vector<unsigned>{0}, std::span(&time, 1)), kOk);
  EXPECT_EQ(time, 1.0);
  EXPECT_EQ(d.terminate(), kOk);
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(2, 5, 9)) << "results are readable after the end";
}

TEST_P(Interface, ComputesOutputsWhenTheyAreReadInInitializationMode) {
  Driver d(*fmu_);
  ASSERT_EQ(d.enter_initialisation(), kOk);
  EXPECT_EQ(set<double>(d, "x", {1, 1, 1}), kOk);
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(2, 2, 2));
  EXPECT_EQ(set<double>(d, "gain", {3, 3, 3}), kOk);
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(3, 3, 3));
  EXPECT_EQ(d.exit_initialisation(), kOk);
  EXPECT_THAT(get<std::int32_t>(d, "initialisations"), ElementsAre(2)) << "only as often as something has changed";
}

TEST_P(Interface, TakesTunablesAndInputsBetweenStepsButNoFixedParameters) {
  Driver d(*fmu_);
  d.initialise();
  EXPECT_EQ(set<double>(d, "gain", {1, 1, 1}), kOk);
  EXPECT_EQ(set<double>(d, "u", {1, 1, 1}), kOk);
  EXPECT_EQ(set<double>(d, "limit", {2}), kErrorStatus);
  EXPECT_THAT(d.last_message(), AllOf(HasSubstr("limit"), HasSubstr("fixed parameter")));
  EXPECT_EQ(set<double>(d, "x", {0, 0, 0}), kErrorStatus);
  EXPECT_EQ(set<double>(d, "y", {0, 0, 0}), kErrorStatus);
  EXPECT_EQ(d.step(0, 1), kOk) << "a wrong call has no effect";
  EXPECT_THAT(get<double>(d, "y"), ElementsAre(1, 1, 1));
}

TEST_P(Interface, RefusesParametersOutsideTheirRangeAndWritesNothing) {
  Driver d(*fmu_);
  EXPECT_EQ(set<double>(d, "gain", {1, 101, 1}), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("gain[2] = 101 N.m/rad, expected 0 to 100"));
  EXPECT_EQ(set<double>(d, "limit", {std::nan("")}), kErrorStatus);
  EXPECT_THAT(get<double>(d, "gain"), ElementsAre(2, 2, 2));
}

TEST_P(Interface, RefusesReferencesTypesAndSizesThatDoNotFit) {
  Driver d(*fmu_);
  double real = 0;
  std::int32_t integer = 0;
  EXPECT_EQ(d.get(std::vector<unsigned>{9999}, std::span(&real, 1)), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("no variable has the value reference 9999"));
  EXPECT_EQ(d.get(refs("limit"), std::span(&integer, 1)), kErrorStatus);
  EXPECT_THAT(d.last_message(), AllOf(HasSubstr("real variable limit"), HasSubstr("integer")));
  EXPECT_EQ(d.get(refs("demand"), std::span(&real, 1)), kErrorStatus);
  EXPECT_EQ(d.set(std::vector<unsigned>{0}, std::span<const double>(&real, 1)), kErrorStatus) << "time cannot be set";
  if (GetParam() == Version::k3) {
    std::vector<double> two(2), four(4);
    EXPECT_EQ(d.get(refs("u"), std::span(two)), kErrorStatus);
    EXPECT_EQ(d.get(refs("u"), std::span(four)), kErrorStatus);
    EXPECT_THAT(d.last_message(), HasSubstr("4 values, expected 3"));
    EXPECT_EQ(d.set(refs("u"), std::span<const double>(two)), kErrorStatus);
    EXPECT_EQ(d.set(refs("u"), std::span<const double>(four)), kErrorStatus);
  }
}

TEST_P(Interface, TakesNullForEmptyArraysAndForNothingElse) {
  Driver d(*fmu_);
  const std::vector<unsigned> none, one = refs("limit");
  EXPECT_EQ(d.get(none, std::span<double>()), kOk);
  EXPECT_EQ(d.set(none, std::span<const double>()), kOk);
  EXPECT_EQ(d.get(none, std::span<std::int32_t>()), kOk);
  EXPECT_EQ(d.set(none, std::span<const std::string>()), kOk);
  if (GetParam() == Version::k2) {
    EXPECT_EQ(d.get(one, std::span<double>(static_cast<double*>(nullptr), 1)), kErrorStatus);
    EXPECT_THAT(d.last_message(), HasSubstr("NULL"));
  } else {
    EXPECT_EQ(d.get(one, std::span<double>(static_cast<double*>(nullptr), 1)), kErrorStatus);
    EXPECT_EQ(fmu_->function<decltype(&fmi3GetBinary)>("fmi3GetBinary")(d.instance(), nullptr, 0, nullptr, nullptr, 0), fmi3OK);
    EXPECT_EQ(fmu_->function<decltype(&fmi3GetInt8)>("fmi3GetInt8")(d.instance(), one.data(), 1, nullptr, 0), fmi3Error);
    EXPECT_EQ(fmu_->function<decltype(&fmi3GetClock)>("fmi3GetClock")(d.instance(), nullptr, 0, nullptr), fmi3OK);
  }
}

TEST_P(Interface, AnswersEveryCallOutOfOrderWithAnErrorAndAMessage) {
  Driver d(*fmu_);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("must not be called before Initialization Mode"));
  EXPECT_EQ(d.exit_initialisation(), kErrorStatus);
  EXPECT_EQ(d.terminate(), kErrorStatus);
  EXPECT_EQ(d.enter_initialisation(), kOk);
  EXPECT_EQ(d.enter_initialisation(), kErrorStatus);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  EXPECT_EQ(d.exit_initialisation(), kOk);
  EXPECT_EQ(d.exit_initialisation(), kErrorStatus);
  EXPECT_EQ(d.step(0, 1), kOk) << "none of these calls has changed the instance";
  EXPECT_EQ(d.terminate(), kOk);
  EXPECT_EQ(d.step(1, 1), kErrorStatus);
  EXPECT_EQ(set<double>(d, "u", {1, 1, 1}), kErrorStatus);
  EXPECT_EQ(d.reset(), kOk);
  EXPECT_EQ(d.enter_initialisation(), kOk);
}

TEST_P(Interface, AnswersCallsWithoutAnInstance) {
  const char* const names2[] = {"fmi2EnterInitializationMode", "fmi2ExitInitializationMode",  "fmi2Terminate", "fmi2Reset",
                                "fmi2EnterEventMode",          "fmi2EnterContinuousTimeMode", "fmi2CancelStep"};
  const char* const names3[] = {"fmi3ExitInitializationMode",
                                "fmi3Terminate",
                                "fmi3Reset",
                                "fmi3EnterEventMode",
                                "fmi3EnterStepMode",
                                "fmi3EnterConfigurationMode",
                                "fmi3ExitConfigurationMode",
                                "fmi3EvaluateDiscreteStates"};
  for (const char* name :
       GetParam() == Version::k2 ? std::span<const char* const>(names2) : std::span<const char* const>(names3)) {
    EXPECT_EQ(fmu_->function<int (*)(void*)>(name)(nullptr), kErrorStatus) << name;
  }
  fmu_->function<void (*)(void*)>(GetParam() == Version::k2 ? "fmi2FreeInstance" : "fmi3FreeInstance")(nullptr);
}

TEST_P(Interface, ReportsFunctionsThatItDoesNotSupport) {
  Driver d(*fmu_);
  d.initialise();
  double x = 0;
  if (GetParam() == Version::k2) {
    EXPECT_EQ(fmu_->function<decltype(&fmi2EnterEventMode)>("fmi2EnterEventMode")(d.instance()), fmi2Error);
    EXPECT_THAT(d.last_message(), HasSubstr("Model Exchange"));
    EXPECT_EQ(fmu_->function<decltype(&fmi2GetDerivatives)>("fmi2GetDerivatives")(d.instance(), &x, 1), fmi2Error);
    const unsigned u = 1;
    const int order = 1;
    EXPECT_EQ(d.output_derivatives({&u, 1}, {&order, 1}, {&x, 1}), fmi2Error);
    EXPECT_THAT(d.last_message(), HasSubstr("u[1]: has no declared derivative"));
    EXPECT_EQ(d.directional({}, {}, {}, {}), fmi2Error);
    EXPECT_THAT(d.last_message(), HasSubstr("providesDirectionalDerivative=false"));
    EXPECT_EQ(fmu_->function<decltype(&fmi2Instantiate)>("fmi2Instantiate")("x", fmi2ModelExchange, fmu_->token().c_str(),
                                                                            nullptr, nullptr, 0, 1),
              nullptr);
  } else {
    EXPECT_EQ(fmu_->function<decltype(&fmi3EnterEventMode)>("fmi3EnterEventMode")(d.instance()), fmi3Error);
    EXPECT_THAT(d.last_message(), HasSubstr("hasEventMode=false"));
    EXPECT_EQ(fmu_->function<decltype(&fmi3GetContinuousStates)>("fmi3GetContinuousStates")(d.instance(), &x, 1), fmi3Error);
    EXPECT_EQ(fmu_->function<decltype(&fmi3EnterConfigurationMode)>("fmi3EnterConfigurationMode")(d.instance()), fmi3Error);
    EXPECT_EQ(fmu_->function<decltype(&fmi3InstantiateModelExchange)>("fmi3InstantiateModelExchange")(
                  "x", fmu_->token().c_str(), nullptr, false, false, nullptr, nullptr),
              nullptr);
  }
  EXPECT_EQ(d.step(0, 1), kOk);
}

TEST_P(Interface, RefusesAWrongToken) {
  Driver::Options options;
  options.token = "{00000000-0000-0000-0000-000000000000}";
  Driver d(*fmu_, options);
  EXPECT_FALSE(d.alive());
  EXPECT_THAT(d.last_message(), HasSubstr("token"));
}

TEST_P(Interface, FindsItsResourcesForEveryFormOfPath) {
  const std::string path = (fmu_->folder() / "resources").string();
  std::vector<std::string> places;
  if (GetParam() == Version::k2) {
    places = {"file://" + path, "file:" + path, "file://localhost" + path, "file://" + path + "/", path};
  } else {
    places = {path, path + "/"};
  }
  const std::filesystem::path moved = folder_.path() / "with blanks, 100% ünïcode";
  std::filesystem::copy(fmu_->folder() / "resources", moved);
  std::filesystem::remove_all(fmu_->folder() / "resources");
  std::filesystem::create_directory_symlink(moved, path);
  places.push_back(GetParam() == Version::k2 ? uri_from_path(moved) : moved.string());
  for (const std::string& place : places) {
    Driver::Options options;
    options.resources = place;
    EXPECT_TRUE(Driver(*fmu_, options).alive()) << place;
  }
}

TEST_P(Interface, FindsItsResourcesBesideTheLibraryIfTheHostPassesNoPath) {
  Driver::Options options;
  options.null_resources = true;
  EXPECT_TRUE(Driver(*fmu_, options).alive());
  std::filesystem::remove_all(fmu_->folder() / "resources");
  Driver lost(*fmu_, options);
  EXPECT_FALSE(lost.alive());
  EXPECT_THAT(lost.last_message(), AllOf(HasSubstr("no resource path was given"), HasSubstr("unit.bin")));
}

TEST_P(Interface, RefusesAPackageWithADamagedByte) {
  const std::filesystem::path package = fmu_->folder() / "resources/unit.bin";
  std::fstream file(package, std::ios::in | std::ios::out | std::ios::binary);
  file.seekp(100);
  file.put('\x5a');
  file.close();
  Driver d(*fmu_);
  EXPECT_FALSE(d.alive());
  EXPECT_THAT(d.last_message(), HasSubstr("is damaged"));
}

TEST_P(Interface, LogsOnlyDeclaredCategoriesAndOnlyWhenAskedTo) {
  Driver::Options quiet;
  quiet.logging = false;
  Driver d(*fmu_, quiet);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  EXPECT_THAT(d.log(), IsEmpty());
  EXPECT_EQ(d.choose_logging(true, {"logStatusDiscard"}), kOk);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  EXPECT_THAT(d.log(), IsEmpty());
  EXPECT_EQ(d.choose_logging(true, {}), kOk);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  ASSERT_EQ(d.log().size(), 1u);
  EXPECT_EQ(d.log().back().category, "logStatusError");
  EXPECT_EQ(d.log().back().status, kErrorStatus);
  EXPECT_EQ(d.choose_logging(true, {"logEverything"}), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("no log category 'logEverything'"));
  EXPECT_EQ(d.choose_logging(false, {}), kOk);
  EXPECT_EQ(d.step(0, 1), kErrorStatus);
  EXPECT_EQ(d.log().size(), 2u);
}

TEST_P(Interface, LogsTheUnitsWarningsOnce) {
  pack("unit:probe?warn=true");
  Driver d(*fmu_);
  ASSERT_EQ(d.log().size(), 1u);
  EXPECT_EQ(d.log()[0].category, "logStatusWarning");
  EXPECT_EQ(d.log()[0].text, "made to warn");
}

TEST_P(Interface, DiscardsAStepThatTheUnitDiscards) {
  Driver d(*fmu_);
  d.initialise();
  EXPECT_EQ(d.step(0, 0.25), kOk);
  void* before = nullptr;
  ASSERT_EQ(d.save(&before), kOk);
  EXPECT_EQ(set<std::int32_t>(d, "demand", {1}), kOk);
  EXPECT_EQ(d.step(0.25, 0.5), kDiscardStatus);
  EXPECT_EQ(d.log().back().category, "logStatusDiscard");
  EXPECT_EQ(d.reached(), 0.25);
  EXPECT_EQ(d.step(0.25, 0.25), kErrorStatus) << "a state must be restored first";
  EXPECT_EQ(d.restore(before), kOk);
  EXPECT_EQ(d.step(0.25, 0.25), kOk);
  EXPECT_EQ(d.reached(), 0.5);
}

TEST_P(Interface, TurnsWhatTheUnitThrowsIntoAnError) {
  for (const std::int32_t demand : {2, 4}) {
    Driver d(*fmu_);
    d.initialise();
    EXPECT_EQ(set<std::int32_t>(d, "demand", {demand}), kOk);
    EXPECT_EQ(d.step(0, 1), kErrorStatus);
    if (demand == 2) {
      EXPECT_THAT(d.last_message(), HasSubstr("thrown on demand"));
    }
    EXPECT_EQ(d.step(0, 1), kErrorStatus);
    EXPECT_EQ(d.reset(), kOk);
    d.initialise();
    EXPECT_EQ(d.step(0, 1), kOk);
  }
  Driver d(*fmu_);
  EXPECT_EQ(set<double>(d, "limit", {7}), kOk);
  EXPECT_EQ(d.enter_initialisation(), kOk);
  EXPECT_EQ(d.exit_initialisation(), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("not to my liking"));
}

TEST_P(Interface, ReportsThatTheUnitRequestsTheEndOfTheRun) {
  Driver d(*fmu_);
  d.initialise();
  EXPECT_EQ(d.step(0, 0.5), kOk);
  EXPECT_FALSE(d.terminated());
  EXPECT_EQ(set<std::int32_t>(d, "demand", {5}), kOk);
  EXPECT_EQ(d.step(0.5, 0.5), GetParam() == Version::k2 ? kDiscardStatus : kOk);  // FMI 2 cannot express it otherwise
  EXPECT_TRUE(d.terminated());
  EXPECT_EQ(d.reached(), 1.0);
  EXPECT_THAT(get<std::int32_t>(d, "steps"), ElementsAre(2)) << "this step was made";
  EXPECT_EQ(d.step(1, 0.5), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("has ended the run at 1 s"));
  EXPECT_EQ(d.terminate(), kOk);
}

TEST_P(Interface, NamesTheOutputThatBecameNaN) {
  Driver d(*fmu_);
  d.initialise();
  EXPECT_EQ(set<std::int32_t>(d, "demand", {3}), kOk);
  EXPECT_EQ(d.step(0, 0.25), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("y[1] is not finite at 0.25 s"));
}

TEST_P(Interface, KeepsExactTimeForAHostThatAddsUpItsSteps) {
  Driver d(*fmu_);
  d.initialise();
  double t = 0;
  for (int i = 0; i < 100'000; ++i) {  // the sum is 1.3e-9 s off at the end
    ASSERT_EQ(d.step(t, 1e-3), kOk) << d.last_message();
    ASSERT_THAT(get<std::int32_t>(d, "h"), ElementsAre(1'000'000)) << "step " << i;
    t += 1e-3;
  }
  EXPECT_NE(t, 100.0);
}

TEST_P(Interface, KeepsExactTimeForAHostThatTakesDifferencesOfTimes) {
  Driver d(*fmu_);
  d.initialise(1000);
  for (int i = 0; i < 10'000; ++i) {
    const double t = 1000 + i * 1e-3, next = 1000 + (i + 1) * 1e-3;
    ASSERT_EQ(d.step(t, next - t), kOk) << d.last_message();
    ASSERT_THAT(get<std::int32_t>(d, "h"), ElementsAre(1'000'000)) << "step " << i;
  }
}

TEST_P(Interface, LosesNoTimeInStepsThatAreNoWholeNanoseconds) {
  Driver d(*fmu_);
  d.initialise();
  std::int64_t sum = 0;
  for (int i = 0; i < 3000; ++i) {
    ASSERT_EQ(d.step(i / 3000.0, 1 / 3000.0), kOk) << d.last_message();
    sum += get<std::int32_t>(d, "h")[0];
  }
  EXPECT_EQ(sum, 1'000'000'000);
}

TEST_P(Interface, TreatsALastStepOfAFewUlpsAsZero) {
  Driver d(*fmu_);
  ASSERT_EQ(d.enter_initialisation(0, 0.3), kOk);
  ASSERT_EQ(d.exit_initialisation(), kOk);
  EXPECT_EQ(d.step(0, 0.1), kOk);
  EXPECT_EQ(d.step(0.1, 0.2 - 4e-17), kOk);
  EXPECT_EQ(d.step(0.3, 1.2e-16), kOk) << d.last_message();
  EXPECT_THAT(get<std::int32_t>(d, "steps"), ElementsAre(2));
}

TEST_P(Interface, RefusesStepsOfZeroLengthFromAnotherTimeOrBeyondTheEnd) {
  Driver d(*fmu_);
  ASSERT_EQ(d.enter_initialisation(0, 1.0), kOk);
  ASSERT_EQ(d.exit_initialisation(), kOk);
  for (const double h : {0.0, -0.1, std::nan(""), HUGE_VAL, 1e300}) EXPECT_EQ(d.step(0, h), kErrorStatus) << h;
  EXPECT_EQ(d.step(0.1, 0.1), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("currentCommunicationPoint = 0.1 s, expected 0 s"));
  EXPECT_EQ(d.step(std::nan(""), 0.1), kErrorStatus);
  EXPECT_EQ(d.step(0, 1.1), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("beyond stopTime = 1 s"));
  EXPECT_EQ(d.step(0, 1), kOk);
  Driver backwards(*fmu_);
  EXPECT_EQ(backwards.enter_initialisation(2, 1.0), kErrorStatus);
}

/// FMI 2 only.
class InterfaceOfFmi2 : public Interface {};

TEST_P(InterfaceOfFmi2, FollowsInputDerivatives) {
  Driver d(*fmu_);
  d.initialise();
  const std::vector<int> first(3, 1), second(3, 2);
  const std::vector<double> slopes = {1, 2, 3};
  EXPECT_EQ(d.set_rates(refs("u"), first, slopes), kOk);
  EXPECT_EQ(d.step(0, 2), kOk);
  EXPECT_THAT(get<double>(d, "x"), ElementsAre(2, 4, 6));  // ½ slope · t²
  EXPECT_EQ(d.set_rates(refs("gain"), first, slopes), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("gain[1]: expected a real input"));
  const std::vector<int> none(3, 0);
  EXPECT_EQ(d.set_rates(refs("u"), none, slopes), kErrorStatus);
}

TEST_P(InterfaceOfFmi2, IgnoresUnsupportedInputDerivativesAndLogsItOnce) {
  Driver d(*fmu_);
  d.initialise();
  const std::vector<int> first(3, 1), second(3, 2), one(1, 1);
  const std::vector<double> slopes = {1, 2, 3}, zero(3, 0.0), slope(1, 5.0);
  EXPECT_EQ(d.set_rates(refs("u"), second, zero), kOk);  // nothing is lost
  EXPECT_EQ(d.set_rates(refs("held"), one, slope), kWarning);
  EXPECT_THAT(d.last_message(), HasSubstr("held is constant over a step: its derivative is ignored"));
  EXPECT_EQ(d.set_rates(refs("u"), first, slopes), kOk);
  EXPECT_EQ(d.set_rates(refs("u"), second, slopes), kWarning);
  EXPECT_THAT(d.last_message(), HasSubstr("held is constant"));  // no second message
  EXPECT_EQ(d.step(0, 2), kOk);
  EXPECT_THAT(get<double>(d, "x"), ElementsAre(2, 4, 6));  // ½ slope · t², the slope of order 1
}

/// FMI 3 only.
class InterfaceOfFmi3 : public Interface {};

TEST_P(InterfaceOfFmi3, FollowsAnInputWhoseSlopeIsAnInput) {
  const unsigned slope = static_cast<unsigned>(variables_.size()) + 1;  // after all others, of which the first is time
  std::ifstream in(fmu_->folder() / "modelDescription.xml");
  const std::string description(std::istreambuf_iterator<char>(in), {});
  EXPECT_THAT(description, HasSubstr("name=\"der(u)\" valueReference=\"" + std::to_string(slope) + "\""));
  Driver d(*fmu_);
  d.initialise();
  const std::vector<double> slopes = {1, 2, 3};
  EXPECT_EQ(d.set(std::vector<unsigned>{slope}, std::span<const double>(slopes)), kOk);
  EXPECT_EQ(d.step(0, 2), kOk);
  EXPECT_THAT(get<double>(d, "x"), ElementsAre(2, 4, 6));  // ½ slope · t²
  void* state = nullptr;
  EXPECT_EQ(d.save(&state), kOk);
  EXPECT_EQ(d.set(std::vector<unsigned>{slope}, std::span<const double>(std::vector<double>(3, 0.0))), kOk);
  EXPECT_EQ(d.restore(state), kOk);
  EXPECT_EQ(d.step(2, 2), kOk);  // continues from u, which is still 0, with the slope of the state
  EXPECT_THAT(get<double>(d, "x"), ElementsAre(4, 8, 12));
}

TEST_P(Interface, RestoresASavedStateInTheMiddleOfARun) {
  Driver d(*fmu_);
  EXPECT_EQ(set<double>(d, "u", {1, 2, 3}), kOk);
  d.initialise();
  EXPECT_EQ(d.step(0, 1), kOk);
  void* state = nullptr;
  EXPECT_EQ(d.save(&state), kOk);
  void* const address = state;
  EXPECT_EQ(d.save(&state), kOk);
  EXPECT_EQ(state, address) << "the given state is reused";
  EXPECT_EQ(d.step(1, 1), kOk);
  EXPECT_EQ(set<double>(d, "gain", {0, 0, 0}), kOk);
  EXPECT_EQ(d.restore(state), kOk);
  EXPECT_THAT(get<double>(d, "gain"), ElementsAre(2, 2, 2));
  EXPECT_EQ(d.step(1, 2), kOk) << "time is back, too";
  EXPECT_THAT(get<double>(d, "x"), ElementsAre(3, 6, 9));
  EXPECT_EQ(d.free_state(&state), kOk);
  EXPECT_EQ(state, nullptr);
  EXPECT_EQ(d.free_state(&state), kOk) << "freeing NULL has no effect";
  EXPECT_EQ(d.save(&state), kOk);
  EXPECT_EQ(d.free_state(static_cast<void**>(state)), kOk) << "as fmusim 0.0.39 calls it";
  EXPECT_EQ(d.restore(state), kErrorStatus);
  EXPECT_EQ(d.restore(nullptr), kErrorStatus);
  int other = 0;
  EXPECT_EQ(d.restore(&other), kErrorStatus);
}

TEST_P(Interface, RestoresASerialisedStateInAFreshInstance) {
  Driver d(*fmu_);
  EXPECT_EQ(set<double>(d, "u", {1, 2, 3}), kOk);
  EXPECT_EQ(set<double>(d, "limit", {3}), kOk);
  EXPECT_EQ(set<std::string>(d, "word", {std::string(3000, 'x')}), kOk);
  d.initialise();
  EXPECT_EQ(d.step(0, 1), kOk);
  void* state = nullptr;
  EXPECT_EQ(d.save(&state), kOk);
  const std::vector<char> bytes = d.serialise(state);
  ASSERT_FALSE(bytes.empty());
  EXPECT_EQ(d.step(1, 1), kOk);

  Driver fresh(*fmu_);  // in which limit is still 1, and all values that the unit derives from it
  void* taken = nullptr;
  ASSERT_EQ(fresh.deserialise(bytes, &taken), kOk) << fresh.last_message();
  ASSERT_EQ(fresh.restore(taken), kOk) << fresh.last_message();
  EXPECT_EQ(fresh.step(1, 1), kOk) << fresh.last_message();
  EXPECT_EQ(get<double>(fresh, "y"), get<double>(d, "y"));
  EXPECT_EQ(get<std::string>(fresh, "echo"), get<std::string>(d, "echo"));

  Driver instantiated(*fmu_);
  void* early = nullptr;
  ASSERT_EQ(instantiated.save(&early), kOk);
  ASSERT_EQ(d.deserialise(instantiated.serialise(early), &taken), kOk);
  EXPECT_EQ(d.restore(taken), kOk) << "a state from before the initialisation is valid, too";
  EXPECT_EQ(d.step(2, 1), kErrorStatus);
  d.initialise();
  EXPECT_EQ(d.step(0, 1), kOk);
}

// With a correct hash: the state of a unit that was never initialised, whose values do not agree with its variables.
TEST_P(Interface, RefusesAStateThatStepsWithoutBeingInitialised) {
  constexpr std::size_t kHash = 8, kBody = 16, kInitialised = 28;
  Driver d(*fmu_);
  d.initialise();
  void *state = nullptr, *taken = nullptr;
  EXPECT_EQ(d.save(&state), kOk);
  std::vector<char> bytes = d.serialise(state);
  ASSERT_EQ(bytes[kInitialised], 1);
  bytes[kInitialised] = 0;
  const std::uint64_t hash = hash_of({bytes.data() + kBody, bytes.size() - kBody});
  std::memcpy(bytes.data() + kHash, &hash, sizeof hash);
  EXPECT_EQ(d.deserialise(bytes, &taken), kErrorStatus);
  EXPECT_THAT(d.last_message(), HasSubstr("is in a stepping state, but not initialised"));
}

TEST_P(Interface, RefusesInvalidStates) {
  Driver d(*fmu_);
  void *state = nullptr, *taken = nullptr;
  EXPECT_EQ(d.save(&state), kOk);
  const std::vector<char> bytes = d.serialise(state);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::vector<char> damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x10);
    EXPECT_EQ(d.deserialise(damaged, &taken), kErrorStatus) << "byte " << i;
    EXPECT_EQ(d.deserialise(std::span(bytes).first(i), &taken), kErrorStatus) << "cut at " << i;
  }
  EXPECT_EQ(taken, nullptr);
  pack("unit:probe?size=4");
  Driver other(*fmu_);
  EXPECT_EQ(other.deserialise(bytes, &taken), kErrorStatus);
  EXPECT_THAT(other.last_message(), HasSubstr("of another FMU"));
}

TEST_P(Interface, StartsAfreshAfterAReset) {
  Driver d(*fmu_);
  const auto run = [&] {
    std::vector<double> trace;
    EXPECT_EQ(set<double>(d, "u", {1, 2, 3}), kOk);
    d.initialise();
    for (int i = 0; i < 5; ++i) {
      EXPECT_EQ(d.step(0.5 * i, 0.5), kOk);
      for (const double y : get<double>(d, "y")) trace.push_back(y);
    }
    return trace;
  };
  const std::vector<double> first = run();
  EXPECT_EQ(set<double>(d, "gain", {9, 9, 9}), kOk);
  EXPECT_EQ(d.reset(), kOk);
  EXPECT_THAT(get<double>(d, "gain"), ElementsAre(2, 2, 2));
  EXPECT_EQ(run(), first);
}

TEST_P(Interface, GivesHundredsOfInstancesThatShareNothing) {
  std::vector<std::unique_ptr<Driver>> drivers;
  for (int i = 0; i < 300; ++i) {
    drivers.push_back(std::make_unique<Driver>(*fmu_));
    const double u = i;
    ASSERT_EQ(set<double>(*drivers.back(), "u", {u, u, u}), kOk);
    drivers.back()->initialise();
  }
  for (auto& d : drivers) ASSERT_EQ(d->step(0, 1), kOk);
  for (int i = 0; i < 300; ++i) ASSERT_EQ(get<double>(*drivers[static_cast<std::size_t>(i)], "x")[0], i);
}

TEST_P(Interface, FreesEverythingWhenItIsUnloaded) {
  if (std::string(COTWIN_SANITIZERS).size() > 0) GTEST_SKIP() << "the heap of the sanitizer cannot be measured";
  const std::filesystem::path archive = fmu_->archive();
  loaded_.clear();  // a library is unloaded when it is no longer used
  const auto load = [&] {
    LoadedFmu fmu(archive, GetParam());
    Driver d(fmu);
    d.initialise();
    void* state = nullptr;
    static_cast<void>(d.step(0, 1));
    static_cast<void>(d.step(0, 1));  // an error that is thrown as an exception inside
    static_cast<void>(d.save(&state));
  };
  load();
  const std::size_t before = mallinfo2().uordblks;
  for (int i = 0; i < 50; ++i) load();
  EXPECT_LT(mallinfo2().uordblks, before + 50 * 256) << "bytes are lost with every load";
}

TEST_P(Interface, RunsInSeveralThreadsAtOnce) {
  std::vector<std::vector<double>> results(8);
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < results.size(); ++k) {
    threads.emplace_back([&, k] {
      for (int repeat = 0; repeat < 20; ++repeat) {
        Driver d(*fmu_);
        set<double>(d, "u", {1, 2, 3});
        d.initialise();
        for (int i = 0; i < 50; ++i) static_cast<void>(d.step(0.01 * i, 0.01));
        results[k] = get<double>(d, "x");
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  for (const auto& result : results) EXPECT_EQ(result, results[0]);
  EXPECT_NEAR(results[0][0], 0.5, 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Fmi, Interface, ::testing::Values(Version::k2, Version::k3),
                         [](const auto& version) { return std::string(version.param == Version::k2 ? "2" : "3"); });

INSTANTIATE_TEST_SUITE_P(Fmi, InterfaceOfFmi2, ::testing::Values(Version::k2), [](const auto&) { return std::string("2"); });
INSTANTIATE_TEST_SUITE_P(Fmi, InterfaceOfFmi3, ::testing::Values(Version::k3), [](const auto&) { return std::string("3"); });

}  // namespace
}  // namespace cotwin::fmu::interface_test
