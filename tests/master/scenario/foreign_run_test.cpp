// Runs with FMUs that insist on the rules of FMI (tests/fmu/fmus/strict.h): going back, and loops at the start.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <optional>
#include <utility>

#include "models/foundation/support/choice.h"
#include "tests/fmu/foreign.h"
#include "tests/master/test_units.h"

namespace cotwin::master::foreign_run_test {
namespace {

using namespace cotwin::testing;
using fmu::testing::Edits;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class ForeignRun : public ::testing::TestWithParam<std::string> {
 protected:
  ForeignRun() { setenv("STRICT_CALLS", calls_.c_str(), 1); }
  ~ForeignRun() override { unsetenv("STRICT_CALLS"); }

  /// Adds an instance of the FMU; `query` as in a source.
  void fmu(Build& b, const std::string& name, const std::string& query = "", const Edits& edits = {}) {
    const std::filesystem::path file = folder_.path() / name;
    std::filesystem::create_directories(file);
    b.unit(name, "");
    b.scenario.components.back().source = fmu::testing::make_fmu(GetParam(), file, edits).string() + query;
  }
  /// A scenario of one second in ten ticks.
  static Build second() {
    Build b;
    b.scenario.tick = Duration{100'000'000};
    return b.until(1);
  }
  static void run(Master& master) {
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
  }
  /// The counts of all instances so far.
  std::string calls() const { return std::filesystem::exists(calls_) ? fmu::testing::read_text(calls_) : ""; }
  std::size_t count(const std::string& call) const {
    const std::string all = calls();
    std::size_t n = 0;
    for (std::size_t at = all.find(call + " "); at != std::string::npos; at = all.find(call + " ", at + 1)) ++n;
    return n;
  }
  Edits without_serialisation() const {
    return {{GetParam() == "strict2" ? " canSerializeFMUstate=\"true\"" : " canSerializeFMUState=\"true\"", ""}};
  }

  fmu::TemporaryFolder folder_;
  const std::filesystem::path calls_ = folder_.path() / "calls.txt";
};

// Continuing in another process

TEST_P(ForeignRun, IsSavedAtCheckpointsOfTheLoopAndResumesToTheSameBits) {
  for (const auto& [process, beside] : {std::pair{"", false}, std::pair{"?process=own", false}, std::pair{"", true}}) {
    Build b;
    b.until(0.4);
    fmu(b, "a", process);
    b.with("u", 1.0);
    b.scenario.components.back().beside = beside;
    Master straight = b.load();
    run(straight);
    std::optional<RunState> state;
    {
      Master first = b.load();
      first.initialise();
      while (first.tick() < 100 && first.step_tick()) {
      }
      first.save([&](RunState saved) { state = std::move(saved); });
      EXPECT_FALSE(state);
      while (!state && first.step_tick()) {
      }
    }
    ASSERT_TRUE(state);
    MasterOptions options;
    options.types = test_types();
    options.resume = std::move(state);
    Master resumed(b.scenario, std::move(options));
    resumed.initialise();
    EXPECT_EQ(resumed.tick(), 256);
    while (resumed.step_tick()) {
    }
    for (const char* name : {"a.x", "a.y"}) EXPECT_EQ(value(resumed, name), value(straight, name)) << name << process << beside;
  }
}

TEST_P(ForeignRun, ReportsStatesThatCannotBeSaved) {
  for (const auto& [query, beside] :
       {std::pair{"", false}, std::pair{"?rollback=true", false}, std::pair{"?rollback=true", true}}) {
    Build b = second();
    fmu(b, "a", query, without_serialisation());
    b.scenario.components.back().beside = beside;
    Master master = b.load();
    master.initialise();
    EXPECT_THAT(master.unsavable(), AllOf(HasSubstr("'a'"), HasSubstr("cannot")));
  }
}

// Going back

TEST_P(ForeignRun, AdvancesAnFmuThatKeepsAStateForAPossibleReturn) {
  for (const char* process : {"", "?process=own"}) {
    Build b = second();
    fmu(b, "a", process);
    b.with("u", 1.0);
    Master master = b.load();
    run(master);
    EXPECT_NEAR(value(master, "a.x"), 1, 1e-12) << process;
  }
}

TEST_P(ForeignRun, AnnouncesRollbackToTheFmuIfEveryTickIsRepeated) {
  Build b = second();
  fmu(b, "a");
  b.with("u", 1.0);
  b.scenario.tolerance = 0.5;
  Master master = b.load();
  run(master);  // the FMU would refuse to be set back if it had been promised otherwise
  EXPECT_LT(value(master, "a.x"), 1e-6) << "it was told and keeps its state";
  EXPECT_EQ(count("instantiate"), 1u);
}

TEST_P(ForeignRun, GoesBackWithNewInstancesWhereTheSourceForbidsRollback) {
  Build b = second();
  fmu(b, "a", "?rollback=false");
  b.with("u", 1.0);
  b.scenario.tolerance = 0.5;
  Master master = b.load();
  run(master);
  EXPECT_NEAR(value(master, "a.x"), 1, 1e-12);
  EXPECT_EQ(count("reset"), 0u);
}

TEST_P(ForeignRun, RepeatsADiscardedTickWithoutBreakingItsPromise) {
  for (const char* process : {"", "?process=own"}) {
    Build b = second();
    fmu(b, "steady", process);
    b.with("u", 1.0);
    fmu(b, "picky", process);
    b.with("u", 2.0).with("longest_step", 0.03).with("from", 0.45);  // from the sixth tick on: four parts
    Master master = b.load();
    run(master);
    EXPECT_NEAR(value(master, "steady.x"), 1, 1e-12) << process;
    EXPECT_NEAR(value(master, "picky.x"), 2, 1e-12) << process;
    EXPECT_EQ(master.summary().discarded, 5) << process;
    EXPECT_EQ(master.summary().most_parts, 4) << process;
  }
  EXPECT_GT(count("instantiate"), 4u) << "the states of earlier ticks went into new instances";
  EXPECT_EQ(count("instantiate"), count("free"));
  EXPECT_EQ(count("reset"), 0u);
}

TEST_P(ForeignRun, ReportsHowAnFmuWithoutSerialisationCanGoBack) {
  const auto discarding = [&](const char* query) {
    Build b = second();
    fmu(b, "picky", query, without_serialisation());
    b.with("u", 1.0).with("longest_step", 0.03).with("from", 0.45);
    return b;
  };
  Master promised = discarding("").load();
  EXPECT_THAT(error_of([&] { run(promised); }),
              AllOf(HasSubstr("'picky' discarded its step at t = 0.5 s"), HasSubstr("rollback=true in its source lets it")));
  Master announced = discarding("?rollback=true").load();
  run(announced);  // every step may be taken back, so this FMU completed none
  EXPECT_EQ(announced.summary().discarded, 5);
}

TEST_P(ForeignRun, RestoresAStateOfAnEarlierInstantInANewInstance) {
  for (const fmu::ProcessChoice process : {fmu::ProcessChoice::kShared, fmu::ProcessChoice::kOwn}) {
    fmu::LoadOptions options;
    options.process = process;
    Instance instance = fmu::load(fmu::testing::make_fmu(GetParam(), folder_.path()), options);
    fmu::testing::real(instance, "u") = 1;
    instance.unit->initialise({});
    Snapshot early, late;
    early.take(instance.variables, *instance.unit);
    EXPECT_EQ(fmu::testing::run(instance, 0, 0.3, 0.1), StepResult::kDone);
    late.take(instance.variables, *instance.unit);
    late.restore(instance.variables, *instance.unit);  // at the last point nothing was promised
    EXPECT_EQ(fmu::testing::run(instance, 0.3, 0.5, 0.1), StepResult::kDone);
    early.restore(instance.variables, *instance.unit);
    EXPECT_EQ(fmu::testing::run(instance, 0, 0.5, 0.1), StepResult::kDone);
    EXPECT_NEAR(fmu::testing::real(instance, "x"), 0.5, 1e-12) << text::word_of(process, fmu::kProcessWords);
  }
  EXPECT_EQ(count("instantiate"), 4u) << "one more for each process, only for the state of t = 0";
}

// The start

TEST_P(ForeignRun, InitialisesTheFmusOfAChainOnce) {
  Build b;
  fmu(b, "c");
  fmu(b, "b");
  fmu(b, "a");
  b.with("bias", 3.0).connect("a.y", "b.u").connect("b.y", "c.u");
  Master master = b.load();
  master.initialise();
  EXPECT_EQ(value(master, "c.y"), 3);
  EXPECT_EQ(master.summary().initialisation.rounds, 1);
  EXPECT_EQ(calls(), "instantiate instantiate instantiate enter exit enter exit enter exit ");
}

// y_a = y_b / 2 + 1, y_b = −3 y_a + 2 through a gain unit: y_a = 2 / 2.5
void close_loop(Build& b) {
  b.with("gain", 0.5).with("bias", 1.0);
  b.unit("b", "gain").with("gain", -3.0).with("bias", 2.0);
  b.connect("a.y", "b.u").as_it_is().connect("b.y", "a.u").as_it_is();
}

TEST_P(ForeignRun, IteratesALoopWithinInitializationMode) {
  Build b;
  fmu(b, "listener");
  fmu(b, "a");
  close_loop(b);
  b.connect("a.y", "listener.u");
  Master master = b.load();
  master.initialise();
  EXPECT_NEAR(value(master, "a.y"), 0.8, 1e-11);
  EXPECT_EQ(value(master, "listener.y"), value(master, "a.y"));
  EXPECT_THAT(master.summary().initialisation.loop, ElementsAre("a", "b"));
  EXPECT_EQ(count("instantiate"), 2u);
  EXPECT_EQ(count("enter"), 2u);
  EXPECT_EQ(count("exit"), 2u);
}

TEST_P(ForeignRun, IteratesALoopOfFmusAlone) {
  Build b;
  fmu(b, "a");
  b.with("gain", 0.5).with("bias", 1.0);
  fmu(b, "b");
  b.with("gain", -3.0).with("bias", 2.0);
  b.connect("a.y", "b.u").connect("b.y", "a.u");
  Master master = b.load();
  master.initialise();
  EXPECT_NEAR(value(master, "a.y"), 0.8, 1e-11);
  EXPECT_NEAR(value(master, "b.y"), -0.4, 1e-11);
  EXPECT_EQ(count("instantiate"), 2u);
}

TEST_P(ForeignRun, InitialisesAnewWhatCannotBeIteratedInInitializationMode) {
  for (const std::int64_t mode : {1, 2}) {  // outputs that cannot be read in that mode, or are updated only after it
    Build b;
    fmu(b, "a");
    b.with("mode", mode);
    close_loop(b);
    Master master = b.load();
    master.initialise();
    EXPECT_NEAR(value(master, "a.y"), 0.8, 1e-11) << mode;
    while (master.step_tick()) {
    }
    EXPECT_LT(std::abs(value(master, "a.x")), 1) << mode;
  }
  EXPECT_GT(count("instantiate"), 2u);
  EXPECT_EQ(count("reset"), 0u);
}

TEST_P(ForeignRun, IteratesAnFmuInItsOwnProcess) {
  Build b;
  fmu(b, "a", "?process=own");
  close_loop(b);
  Master master = b.load();
  master.initialise();
  EXPECT_NEAR(value(master, "a.y"), 0.8, 1e-11);
  EXPECT_EQ(count("reset"), 0u);
}

TEST_P(ForeignRun, BeginsAfreshWithANewInstanceAfterARun) {
  Instance instance = fmu::load(fmu::testing::make_fmu(GetParam(), folder_.path()));
  fmu::testing::real(instance, "u") = 1;
  for (int run = 0; run < 2; ++run) {
    instance.unit->initialise({});
    EXPECT_EQ(fmu::testing::real(instance, "y"), 1);
    EXPECT_EQ(fmu::testing::run(instance, 0, 1, 0.1), StepResult::kDone);
    EXPECT_NEAR(fmu::testing::real(instance, "x"), 1, 1e-12);
  }
  EXPECT_EQ(count("instantiate"), 2u);
  EXPECT_EQ(count("reset"), 0u);
}

INSTANTIATE_TEST_SUITE_P(Versions, ForeignRun, ::testing::Values("strict2", "strict3"),
                         [](const auto& version) { return version.param; });

// Event mode

const Edits kEventMode = {{"canGetAndSetFMUState", "hasEventMode=\"true\" canGetAndSetFMUState"}};

TEST(EventMode, IsNotUsedIfAnFmuDeclaresButRefusesIt) {
  const fmu::TemporaryFolder folder;
  Instance instance = fmu::load(fmu::testing::make_fmu("strict3", folder.path(), kEventMode));
  EXPECT_THAT(instance.warnings,
              ElementsAre(AllOf(HasSubstr("declares an event mode, but cannot be instantiated with it; it is used without"),
                                HasSubstr("Event Mode is not supported."))));
  fmu::testing::real(instance, "u") = 2;
  for (int run = 0; run < 2; ++run) {
    instance.unit->initialise({});
    EXPECT_EQ(fmu::testing::run(instance, 0, 1, 0.1), StepResult::kDone);
    EXPECT_NEAR(fmu::testing::real(instance, "x"), 2, 1e-12);
  }
  EXPECT_EQ(instance.warnings.size(), 1u);
}

}  // namespace
}  // namespace cotwin::master::foreign_run_test
