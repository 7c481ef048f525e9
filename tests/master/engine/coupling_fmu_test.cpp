// Loops of FMUs that are solved within each step.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

#include "fmu/export/pack.h"
#include "fmu/import/load.h"
#include "master/twin/pack_twin.h"
#include "tests/fmu/foreign.h"
#include "tests/master/test_units.h"
#include "tests/support/allocations.h"
#include "tests/support/error_of.h"
#include "tests/support/linear_units.h"
#include "tests/support/places.h"

namespace cotwin::master::coupling_fmu_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::coupled_reference;
using ::cotwin::testing::error_of;
using ::cotwin::testing::two_masses;
using ::cotwin::testing::value;
using fmu::testing::Edits;
using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Not;

std::span<const UnitType> types() {
  static const std::vector<UnitType> kTypes = [] {
    std::vector<UnitType> all(cotwin::testing::test_types().begin(), cotwin::testing::test_types().end());
    all.insert(all.end(), cotwin::testing::linear_types().begin(), cotwin::testing::linear_types().end());
    return all;
  }();
  return kTypes;
}

class LoopOfFmus : public ::testing::TestWithParam<fmu::Version> {
 protected:
  LoopOfFmus() { setenv("STRICT_CALLS", calls_.c_str(), 1); }
  ~LoopOfFmus() override { unsetenv("STRICT_CALLS"); }

  std::string number() const { return GetParam() == fmu::Version::k2 ? "2" : "3"; }
  static Master load(const Build& b) {
    MasterOptions options;
    options.types = types();
    return Master(b.scenario, std::move(options));
  }
  static void to_the_end(Master& master) {
    master.initialise();
    while (master.step_tick()) {
    }
  }
  /// Replaces the linear units of a scenario by FMUs of them.
  Build as_fmus(Build b, const std::string& query) const {
    for (ComponentSpec& spec : b.scenario.components) {
      const std::filesystem::path file = folder_.path() / (spec.name + ".fmu");
      fmu::PackRequest request;
      request.source = spec.source;
      request.types = cotwin::testing::linear_types();
      request.version = GetParam();
      request.libraries = cotwin::places::linear_libraries();
      fmu::pack_unit(request, file);
      spec.source = file.string() + query;
    }
    return b;
  }
  /// Adds the FMU `type` ("strict") of tests/fmu/fmus.
  void foreign(Build& b, const std::string& name, const std::string& type, const std::string& query = "",
               const Edits& edits = {}) const {
    const std::filesystem::path place = folder_.path() / name;
    std::filesystem::create_directories(place);
    b.unit(name, "");
    b.scenario.components.back().source = fmu::testing::make_fmu(type + number(), place, edits).string() + query;
  }
  std::size_t count(const std::string& call) const {
    const std::string all = std::filesystem::exists(calls_) ? fmu::testing::read_text(calls_) : "";
    std::size_t n = 0;
    for (std::size_t at = all.find(call + " "); at != std::string::npos; at = all.find(call + " ", at + 1)) ++n;
    return n;
  }
  Edits without(const std::string& capability) const {
    return {{" " + capability + (GetParam() == fmu::Version::k2 ? "state=\"true\"" : "State=\"true\""), ""}};
  }
  /// a.y = −0.5 b.y + x, where x is about 0, and b.y = gain a.y + bias in ten ticks; b.gain jumps from 1 at 0.5 s.
  Build ring(const std::string& gain) const {
    Build b;
    b.scenario.tick = Duration{100'000'000};
    b.scenario.coupling = CouplingChoice::kImplicit;
    b.connect("a.y", "b.u").as_it_is().connect("b.y", "a.u").as_it_is().until(1);
    if (!gain.empty()) b.event(0.5, "b.gain", gain);
    return b;
  }

  fmu::TemporaryFolder folder_;
  const std::filesystem::path calls_ = folder_.path() / "calls.txt";
};

Build lc(bool held) {
  Build b;
  const std::string settings = held ? "?held=true" : "";
  b.unit("mass", "lc_mass" + settings).unit("spring", "lc_spring" + settings);
  b.connect("mass.v", "spring.v").connect("spring.F", "mass.F").until(2);
  b.scenario.tick = Duration{10'000'000};
  b.scenario.coupling = CouplingChoice::kImplicit;
  return b;
}

Build two_mass(double tolerance) {
  Build b;
  b.unit("a", "two_mass_1").unit("b", "two_mass_2");
  b.connect("a.x1", "b.x1").connect("a.v1", "b.v1").connect("b.F", "a.F").until(2);
  b.scenario.tick = Duration{40'000'000};
  b.scenario.coupling = CouplingChoice::kImplicit;
  b.scenario.tolerance = tolerance;
  return b;
}

TEST_P(LoopOfFmus, HasTheBitsOfTheSameUnitsWithoutFmus) {
  for (const char* process : {"?process=shared", "?process=own"}) {
    for (const Build& b : {lc(false), lc(true), two_mass(0), two_mass(1e-4)}) {
      Master units = load(b), fmus = load(as_fmus(b, process));
      units.initialise();
      fmus.initialise();
      const std::string name = b.scenario.components[0].name + (b.scenario.components[0].name == "mass" ? ".v" : ".x1");
      while (units.step_tick()) {
        ASSERT_TRUE(fmus.step_tick());
        ASSERT_EQ(value(fmus, name), value(units, name)) << units.tick() << process;
      }
      const LoopCounts one = units.summary().loops.at(0).counts, other = fmus.summary().loops.at(0).counts;
      EXPECT_EQ(one.evaluations, other.evaluations);
      EXPECT_GE(one.steps, units.ticks());
    }
  }
}

TEST_P(LoopOfFmus, AllocatesNothingInAStep) {
  for (const Build& b : {lc(false), lc(true)}) {
    Master master = load(as_fmus(b, ""));
    master.initialise();
    for (int i = 0; i < 10; ++i) master.step_tick();
    const std::uint64_t before = cotwin::testing::allocations();
    for (int i = 0; i < 100; ++i) master.step_tick();
    EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
    EXPECT_GT(master.summary().loops.at(0).counts.evaluations, 110 * 2);  // some steps are repeated from their beginning
  }
}

/// x' = 1 − 100 y and y' = x by two foreign FMUs that integrate inputs which change linearly.
Build oscillator() {
  Build b;
  b.connect("b.y", "a.u", -100, 1).as_it_is().connect("a.y", "b.u").as_it_is().until(1);
  b.scenario.tick = Duration{5'000'000};
  b.scenario.coupling = CouplingChoice::kImplicit;
  return b;
}

// The trapezoidal rule turns the oscillator by 2 atan(ωh/2) in each step.
TEST_P(LoopOfFmus, FollowsInputsWithinTheStepInForeignFmus) {
  Build b = oscillator();
  const Edits edits = GetParam() == fmu::Version::k2 ? Edits{{"der(position of &quot;it&quot;).y", "y"}} : Edits{};
  for (const char* name : {"a", "b"}) foreign(b, name, "rogue", "", edits);
  Master master = load(b);
  to_the_end(master);
  const double angle = 200 * 2 * std::atan(10 * 0.005 / 2);
  EXPECT_NEAR(value(master, GetParam() == fmu::Version::k2 ? "b.y" : "b.y[1]"), (1 - std::cos(angle)) / 100, 1e-12);
  EXPECT_NEAR(value(master, GetParam() == fmu::Version::k2 ? "a.y" : "a.y[1]"), std::sin(angle) / 10, 1e-11);
}

TEST_P(LoopOfFmus, GoesBackWithinItsInstances) {
  for (const char* process : {"", "?process=own"}) {
    for (const Edits& edits : {Edits{}, without("canSerializeFMU")}) {
      std::filesystem::remove(calls_);
      Build b = ring("-1");
      foreign(b, "a", "strict", process, edits);
      b.with("gain", -0.5);
      b.unit("b", "gain").with("bias", 1.0);
      Master master = load(b);
      to_the_end(master);
      EXPECT_NEAR(value(master, "b.y"), 2, 1e-8);  // b.y = 0.5 b.y + 1
      EXPECT_GT(master.summary().loops.at(0).counts.evaluations, 20);
      EXPECT_EQ(count("instantiate"), 1u) << process;
    }
  }
}

TEST_P(LoopOfFmus, StepsAnFmuThatCannotSaveItsStateOnceInATick) {
  Build b = ring("");
  foreign(b, "a", "strict", "", {without("canSerializeFMU")[0], without("canGetAndSetFMU")[0]});
  b.with("gain", -0.5);
  b.unit("b", "gain").with("bias", 1.5);
  Master master = load(b);
  to_the_end(master);
  EXPECT_THAT(master.summary().warnings,
              Contains(AllOf(HasSubstr("a, b"), HasSubstr("'a' cannot be restored"), HasSubstr("explicit"))));
  // Explicit steps need some to come near the solution 1.
  EXPECT_NEAR(value(master, "b.y"), 1, 1e-2);
}

TEST_P(LoopOfFmus, DividesAStepThatAnFmuDiscards) {
  for (const char* process : {"", "?process=own"}) {
    Build b = ring("-1");
    foreign(b, "a", "strict", process);
    b.with("gain", -0.5).with("longest_step", 0.03).with("from", 0.45);
    b.unit("b", "gain").with("bias", 1.0);
    Master master = load(b);
    to_the_end(master);
    EXPECT_NEAR(value(master, "b.y"), 2, 1e-8);
    const Summary s = master.summary();
    EXPECT_EQ(s.discarded, 0);
    EXPECT_GE(s.loops.at(0).counts.divided, 2);
    EXPECT_GE(s.loops.at(0).counts.steps, 5 + 5 * 4);
  }
}

// b.y rises by 0.2 in each tick, to 1.9. The first guess after that continues, to 2.1, which is beyond what the FMU accepts.
TEST_P(LoopOfFmus, DividesAStepWhereAnFmuReturnsAnErrorAtATrialInput) {
  for (const char* process : {"", "?process=own"}) {
    Build b = ring("");
    for (int tick = 0; tick <= 6; ++tick)  // y = 1/(1 + gain/2)
      b.event(0.1 * tick, "b.gain", std::to_string(2 / (0.7 + 0.2 * tick) - 2));
    foreign(b, "a", "strict", process);
    b.with("gain", -0.5).with("mode", std::int64_t{3});
    b.unit("b", "gain").with("bias", 1.0);
    Master master = load(b);
    to_the_end(master);
    EXPECT_NEAR(value(master, "b.y"), 1.9, 1e-5);  // six decimals of the gain
    EXPECT_GT(master.summary().loops.at(0).counts.divided, 0);
  }
}

TEST_P(LoopOfFmus, NamesTheFmuThatReturnsAnErrorAtTheSolution) {
  for (const Edits& edits : {Edits{}, without("canSerializeFMU")}) {
    Build b = ring("-1.5");
    foreign(b, "a", "strict", "", edits);
    b.with("gain", -0.5).with("mode", std::int64_t{3});
    b.unit("b", "gain").with("bias", 1.0);
    Master master = load(b);
    EXPECT_THAT(error_of([&] { to_the_end(master); }), AllOf(HasSubstr("a at t = 0.5"), HasSubstr("strict" + number())));
  }
}

// Such an FMU keeps its last states. Those of a step that is divided into many parts must not replace that of its beginning.
TEST_P(LoopOfFmus, KeepsTheStateAtTheBeginningOfALongStep) {
  for (const char* process : {"", "?process=own"}) {
    Build b = ring("-1");
    foreign(b, "a", "strict", process, without("canSerializeFMU"));
    b.with("gain", -0.5).with("longest_step", 0.001).with("from", 0.15);
    b.unit("b", "gain").with("bias", 1.0).unit("other", "picky").with("longest", 0.03).with("from", 0.6);
    Master master = load(b);
    to_the_end(master);
    EXPECT_NEAR(value(master, "b.y"), 2, 1e-8);
    EXPECT_GT(master.summary().discarded, 0);
  }
}

/// A scenario packed as one FMU.
Instance packed(const Build& b, fmu::Version version, const std::filesystem::path& file) {
  PackageOptions options;
  options.types = types();
  options.version = version;
  pack_twin(b.scenario, options, file);
  fmu::LoadOptions load;
  load.process = fmu::ProcessChoice::kShared;
  return fmu::load(file, load);
}

TEST_P(LoopOfFmus, HasTheBitsOfTheRunInAScenarioThatIsOneFmu) {
  for (const bool held : {false, true}) {
    const Build b = as_fmus(lc(held), "");
    Master master = load(b);
    Instance one = packed(b, GetParam(), folder_.path() / "twin.fmu"), other = fmu::load(folder_.path() / "twin.fmu", {});
    master.initialise();
    one.unit->initialise({});
    other.unit->initialise({});
    const Duration h = b.scenario.tick;
    Snapshot saved;
    for (int n = 0; n < 100; ++n) {
      if (n == 50) saved.take(one.variables, *one.unit);
      master.step_tick();
      ASSERT_EQ(one.unit->step(Time{} + n * h, h), StepResult::kDone);
      ASSERT_EQ(one.variables.at("mass.v").reals()[0], value(master, "mass.v")) << n;
    }
    EXPECT_NEAR(value(master, "mass.v"), std::cos(2 * 100 * std::atan(10 * 0.01 / 2)), 1e-11);
    const Snapshot anywhere = Snapshot::deserialise(saved.serialise());
    for (Instance* instance : {&one, &other}) {
      anywhere.restore(instance->variables, *instance->unit);
      for (int n = 50; n < 100; ++n) ASSERT_EQ(instance->unit->step(Time{} + n * h, h), StepResult::kDone);
      EXPECT_EQ(instance->variables.at("mass.v").reals()[0], value(master, "mass.v"));
    }
  }
}

TEST_P(LoopOfFmus, GoesBackWithinTheInstancesOfAScenarioThatIsOneFmu) {
  Build b = ring("");
  for (const char* name : {"a", "b"}) foreign(b, name, "strict");
  b.scenario.components[0].start_values.push_back({"gain", -0.5, "", ""});
  b.with("bias", 1.0);
  Master master = load(b);
  to_the_end(master);
  Instance one = packed(b, GetParam(), folder_.path() / "twin.fmu");
  one.unit->initialise({});
  const std::size_t before = count("instantiate");
  for (int n = 0; n < 10; ++n) ASSERT_EQ(one.unit->step(Time{} + n * b.scenario.tick, b.scenario.tick), StepResult::kDone);
  EXPECT_EQ(count("instantiate"), before);
  EXPECT_NEAR(value(master, "b.y"), 2.0 / 3, 1e-8);
  EXPECT_EQ(one.variables.at("b.y").reals()[0], value(master, "b.y"));
}

INSTANTIATE_TEST_SUITE_P(, LoopOfFmus, ::testing::Values(fmu::Version::k2, fmu::Version::k3),
                         [](const auto& version) { return version.param == fmu::Version::k2 ? "Fmi2" : "Fmi3"; });

}  // namespace
}  // namespace cotwin::master::coupling_fmu_test
