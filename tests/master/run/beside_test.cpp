// Components that step on threads of their own, beside the loop (master/engine/beside.h).
#include "master/engine/threaded_unit.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <optional>
#include <thread>
#include <vector>

#include "master/clock/clock.h"
#include "master/twin/twin.h"
#include "tests/master/test_units.h"
#include "tests/support/allocations.h"

namespace cotwin::master::beside_test {
namespace {

using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::HasSubstr;

/// Its steps wait until the test opens the gate.
class Gate final : public Unit {
 public:
  static inline std::atomic<bool> open = true;
  static inline std::atomic<int> entered = 0;

  void declare(Variables& v) override {
    v.input("u", u_, "1", "what comes in");
    v.output("y", y_, "1", "the input");
    v.output("h", h_, "s", "length of the last step");
    v.output("t", t_, "s", "end of the last step");
    v.output("text", text_, "the number of steps");
  }
  void initialise(Time) override {}
  StepResult step(Time now, Duration h) override {
    ++entered;
    open.wait(false);
    for (std::size_t i = 0; i < 3; ++i) y_[i] = u_[i];
    h_ = h.seconds();
    t_ = (now + h).seconds();
    text_ = std::to_string(++steps_);
    return StepResult::kDone;
  }

 private:
  std::array<double, 3> u_{}, y_{};
  double h_ = 0, t_ = 0;
  int steps_ = 0;
  std::string text_;
};

/// In mode "position" it acts on its input q_d. Notes that it was ended, and whether a step ran then; x waits for the gate.
class Robot final : public Unit {
 public:
  static inline std::vector<std::string> ended;

  explicit Robot(std::string name) : name_(std::move(name)) {}
  void declare(Variables& v) override {
    auto q_d = v.input("q_d", q_d_, "rad", "where it moves to");
    if (mode_ == "position") q_d.required();
    if (mode_ == "impedance") q_d.essential();
    v.output("q", q_, "rad", "position");
    v.output("dq", dq_, "rad/s", "velocity").derivative_of("q");
    v.parameter("mode", mode_, "what it follows");
  }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override {
    stepping_ = true;
    if (name_ == "x") Gate::open.wait(false);
    stepping_ = false;
    return StepResult::kDone;
  }
  void end() noexcept override { ended.push_back(stepping_ ? name_ + " in a step" : name_); }

 private:
  const std::string name_;
  std::array<double, 2> q_d_{}, q_{}, dq_{};
  std::string mode_ = "monitor";
  bool stepping_ = false;
};

/// Follows q_d and dq_d.
class Follower final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("q_d", q_d_, "rad", "desired position");
    v.input("dq_d", dq_d_, "rad/s", "its velocity");
  }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  std::array<double, 2> q_d_{}, dq_d_{};
};

/// Has the clock of a robot that never sends.
class Silent final : public Unit, public TickSource {
 public:
  void declare(Variables& v) override { v.output("y", y_, "1", "nothing"); }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override { return StepResult::kDone; }
  TickSource* tick_source() override { return this; }
  std::optional<Arrival> wait(std::int64_t) override { return std::nullopt; }

 private:
  double y_ = 0;
};

std::vector<UnitType> types() {
  std::vector<UnitType> all(testing::test_types().begin(), testing::test_types().end());
  all.push_back({"gate", "waits", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Gate>(); }});
  all.push_back({"robot", "moves",
                 [](Settings& s) -> std::unique_ptr<Unit> { return std::make_unique<Robot>(s.text("called")); },
                 [](SettingList& s) { s.text("called", "", "its name"); }});
  all.push_back({"follower", "follows", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Follower>(); }});
  all.push_back({"silent", "has a clock", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Silent>(); }});
  return all;
}

/// A clock that does not wait, but says that it might: the loop must not wait for others then.
class Hurried final : public Clock {
 public:
  Hurried() : Clock(HostTime::system()) {}
  void start(Time) override {}
  bool wait(Time) override { return true; }
};

Master load(const Build& build, bool paced = false, std::optional<RunState> resume = {}) {
  static const std::vector<UnitType> kTypes = types();
  MasterOptions options;
  options.types = kTypes;
  if (paced) options.clock = std::make_unique<Hurried>();
  options.resume = std::move(resume);
  return {build.scenario, std::move(options)};
}

Build& beside(Build& build, const std::string& name) {
  for (ComponentSpec& spec : build.scenario.components) spec.beside = spec.beside || spec.name == name;
  return build;
}

std::vector<double> values_of(Master& master, const std::vector<std::string>& names) {
  std::vector<double> row;
  for (const std::string& name : names) row.push_back(value(master, name));
  return row;
}

/// Rows of a run, the first one at the start.
std::vector<std::vector<double>> run(Master master, const std::vector<std::string>& names) {
  master.initialise();
  std::vector<std::vector<double>> rows = {values_of(master, names)};
  while (master.step_tick()) rows.push_back(values_of(master, names));
  return rows;
}

// A chain without feedback: the same steps with the same inputs, seen one step later.
TEST(ThreadedUnit, OutputsAreThoseOfTheLoopOneStepLater) {
  for (const int period : {1, 4}) {
    Build b;
    b.unit("source", "heavy").unit("sum", "integrator", 1, period).with("start", 0.25).unit("copy", "gain", 2).until(0.04);
    b.connect("source.y", "sum.u").as_it_is().connect("sum.y", "copy.u");
    const auto inside = run(load(b), {"sum.y", "copy.y", "sum.x"});
    const auto outside = run(load(beside(b, "sum")), {"sum.y", "copy.y", "sum.x"});
    ASSERT_EQ(inside.size(), 41u);
    ASSERT_EQ(outside.size(), 41u);
    for (std::size_t n = 0; n < outside.size(); ++n)
      EXPECT_EQ(outside[n], inside[n < static_cast<std::size_t>(period) ? 0 : n - static_cast<std::size_t>(period)]) << n;
    EXPECT_NE(inside[40], inside[36]);
  }
}

/// Two chaotic units, in the loop and beside it, that disturb each other.
Build chaos() {
  Build b;
  b.unit("in", "heavy").with("start", 0.3).unit("slow", "heavy", 0, 3).with("start", 0.6).with("rounds", std::int64_t{5000});
  b.unit("out", "heavy").with("start", 0.7).until(1.998);
  b.connect("in.y", "slow.u").connect("slow.y", "in.u").connect("in.y", "out.u");
  beside(b, "slow");
  return beside(b, "out");
}

TEST(ThreadedUnit, GivesTheSameBitsWithAThreadAndWithout) {
  const Build b = chaos();
  const std::vector<std::string> names = {"in.y", "slow.y", "out.y"};
  const auto rows = run(load(b), names);
  ASSERT_EQ(rows.size(), 1999u);
  EXPECT_EQ(run(load(b), names), rows);
  // As one FMU: the same steps on the thread of the caller.
  Twin twin(b.scenario, load_members(b.scenario, testing::test_types(), {}), {});
  Variables v;
  twin.declare(v);
  twin.initialise(Time{});
  for (std::size_t n = 1; n < rows.size(); ++n) {
    ASSERT_EQ(twin.step(Time{static_cast<std::int64_t>(n - 1) * 1'000'000}, Duration{1'000'000}), StepResult::kDone);
    ASSERT_EQ(v.at("in.y").reals()[0], rows[n][0]) << n;
    ASSERT_EQ(v.at("slow.y").reals()[0], rows[n][1]) << n;
    ASSERT_EQ(v.at("out.y").reals()[0], rows[n][2]) << n;
  }
}

TEST(ThreadedUnit, CanBeSavedAndResumedToTheSameBits) {
  const Build b = chaos();
  const std::vector<std::string> names = {"in.y", "slow.y", "out.y"};
  const auto rows = run(load(b), names);
  std::optional<RunState> state;
  {
    Master first = load(b);
    first.initialise();
    EXPECT_EQ(first.unsavable(), "");
    for (int i = 0; i < 301; ++i) ASSERT_TRUE(first.step_tick());
    first.save([&](RunState s) { state = std::move(s); });
    ASSERT_TRUE(state);
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(first.step_tick());
    EXPECT_EQ(values_of(first, names), rows[311]) << "saving changes nothing";
  }
  Master second = load(b, false, state);
  second.initialise();
  ASSERT_EQ(second.tick(), 301);
  for (std::size_t n = 302; n < rows.size(); ++n) {
    ASSERT_TRUE(second.step_tick());
    ASSERT_EQ(values_of(second, names), rows[n]) << n;
  }
}

// The discarded tick is made in parts, after a replay from the last checkpoint.
TEST(ThreadedUnit, StepsAgainWhenAnotherUnitDiscardsATick) {
  Build b = chaos();
  b.until(0.5).unit("picky", "picky?restorable=true", 0).with("longest", 0.0004).with("from", 0.3);
  const std::vector<std::string> names = {"in.y", "slow.y", "out.y", "picky.y"};
  const auto rows = run(load(b), names);
  EXPECT_EQ(rows.size(), 501u);
  EXPECT_EQ(run(load(b), names), rows);
  const Build undisturbed = chaos();
  const auto without = run(load(undisturbed), {"in.y", "slow.y", "out.y"});
  for (std::size_t n = 0; n <= 300; ++n) EXPECT_EQ(std::vector(rows[n].begin(), rows[n].begin() + 3), without[n]) << n;
}

/// Steps until the condition holds; the limit is generous.
template <class Condition>
void step_until(Master& master, const Condition& condition) {
  const auto limit = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!condition()) {
    ASSERT_LT(std::chrono::steady_clock::now(), limit);
    ASSERT_TRUE(master.step_tick());
    std::this_thread::yield();
  }
}

TEST(ThreadedUnit, ALoopOnAClockNeverWaitsAndSeesWholeSteps) {
  Build b;
  b.unit("probe", "probe").unit("gate", "gate", 1).until(1e6);
  for (const char* element : {"[1]", "[2]", "[3]"}) b.connect("probe.t", std::string("gate.u") + element).as_it_is();
  Master master = load(beside(b, "gate"), true);
  EXPECT_FALSE(master.members()[1].instance.unit->restorable());
  master.initialise();
  Gate::open = false;
  Gate::entered = 0;
  for (int i = 0; i < 100; ++i) ASSERT_TRUE(master.step_tick());
  EXPECT_EQ(value(master, "gate.t"), 0);
  EXPECT_DOUBLE_EQ(value(master, "probe.t"), 0.1);
  Gate::open = true;
  Gate::open.notify_all();
  step_until(master, [&] { return value(master, "gate.h") > 0.05; });
  // The first step had the inputs of the first tick; the next one begins where it ended, and ends at the present.
  EXPECT_GE(value(master, "gate.t"), 0.1);
  EXPECT_NEAR(value(master, "gate.t") - value(master, "gate.h"), 0.001, 1e-12);
  EXPECT_EQ(value(master, "gate.y[1]"), value(master, "gate.t"));
  EXPECT_EQ(value(master, "gate.y[3]"), value(master, "gate.y[1]"));
  for (int i = 0; i < 20'000; ++i) {
    ASSERT_TRUE(master.step_tick());
    // The inputs of a step are of one tick and its outputs of one step, whenever the thread was interrupted.
    ASSERT_EQ(value(master, "gate.y[1]"), value(master, "gate.t"));
    ASSERT_EQ(value(master, "gate.y[2]"), value(master, "gate.t"));
    ASSERT_EQ(value(master, "gate.y[3]"), value(master, "gate.t"));
  }
  master.finish();
  EXPECT_THAT(master.summary().notes, ::testing::Contains(HasSubstr("gate: beside the loop: ")));
}

TEST(ThreadedUnit, AllocatesNothingInTheLoop) {
  for (const bool paced : {false, true}) {
    Build b;
    b.unit("a", "heavy").unit("b", "heavy", 1).unit("c", "gain?n=40", 1).connect("a.y", "b.u").until(1);
    beside(b, "c");
    Master master = load(beside(b, "b"), paced);
    master.initialise();
    for (int i = 0; i < 10; ++i) ASSERT_TRUE(master.step_tick());
    const std::uint64_t before = testing::allocations();
    for (int i = 0; i < 200; ++i) ASSERT_TRUE(master.step_tick());
    EXPECT_EQ(testing::allocations(), before);
  }
}

TEST(ThreadedUnit, ErrorsAreThoseOfTheComponent) {
  const auto error = [](Build b) { return error_of([&] { run(load(beside(b, "x")), {}); }); };
  Build broken, picky, tolerant;
  broken.unit("x", "faulty").with("throws", true).with("after", 0.003);
  EXPECT_THAT(error(broken), ::testing::AllOf(HasSubstr("x at t = "), HasSubstr("the gear has broken")));
  picky.unit("x", "picky").with("longest", 0.0001);
  EXPECT_THAT(error(picky), HasSubstr("discarded its step of 0.001 s from t = 0 s, which is not repeated beside the loop"));
  tolerant.unit("x", "integrator");
  tolerant.scenario.tolerance = 1e-3;
  EXPECT_EQ(error(tolerant),
            "test.ssd:10: component 'x' with beside=\"true\" in a scenario with a tolerance, expected steps of whole ticks: "
            "tolerance 0");
  Build nan;
  nan.unit("x", "faulty").with("after", 0.003);
  EXPECT_THAT(error(nan), HasSubstr("x.y[3]"));
}

/// The error of the end of the run, whose ticks have none.
std::string error_of_the_end(Master& master) {
  master.initialise();
  while (master.step_tick()) {
  }
  const std::string error = error_of([&] { master.finish(); });
  EXPECT_EQ(error_of([&] { master.finish(); }), "") << "it is thrown once";
  return error;
}

TEST(ThreadedUnit, TheEndOfTheRunThrowsTheErrorOfTheLastStep) {
  for (const bool paced : {false, true}) {
    const auto one_tick = [&](Build b) {
      for (ComponentSpec& spec : b.scenario.components) spec.beside = true;
      Master master = load(b.until(0.001), paced);
      return error_of_the_end(master);
    };
    Build broken, picky, both;
    broken.unit("x", "faulty").with("throws", true);
    EXPECT_EQ(one_tick(broken), "x at t = 0.001 s: the gear has broken");
    picky.unit("x", "picky").with("longest", 0.0005);
    EXPECT_THAT(one_tick(picky), HasSubstr("x at t = 0.001 s: discarded its step of 0.001 s from t = 0 s"));
    both.unit("x", "faulty").with("throws", true).unit("y", "faulty").with("throws", true);
    EXPECT_EQ(one_tick(both), "x at t = 0.001 s: the gear has broken; y at t = 0.001 s: the gear has broken");
  }
  // As one FMU, whose end cannot be an error, the step itself fails.
  Build b;
  b.unit("x", "faulty").with("throws", true).with("after", 0.009);
  beside(b, "x");
  Twin twin(b.scenario, load_members(b.scenario, testing::test_types(), {}), {});
  Variables v;
  twin.declare(v);
  twin.initialise(Time{});
  for (std::int64_t n = 0; n < 9; ++n) ASSERT_EQ(twin.step(Time{n * 1'000'000}, Duration{1'000'000}), StepResult::kDone);
  EXPECT_THAT(error_of([&] { (void)twin.step(Time{9'000'000}, Duration{1'000'000}); }), HasSubstr("the gear has broken"));
}

TEST(ThreadedUnit, AStateWithAFailedStepIsNotSaved) {
  Build b;
  b.unit("x", "faulty").with("throws", true).with("after", 0.003);
  Master master = load(beside(b, "x"));
  master.initialise();
  for (int i = 0; i < 4; ++i) ASSERT_TRUE(master.step_tick());
  bool saved = false;
  EXPECT_EQ(error_of([&] { master.save([&](RunState) { saved = true; }); }), "x at t = 0.004 s: the gear has broken");
  EXPECT_FALSE(saved);
}

TEST(ThreadedUnit, ValuesThatTheUnitWouldActOnAreRequiredAsInTheLoop) {
  const auto robot = [](const std::string& mode, bool outside) {
    Build b;
    b.unit("source", "joints").unit("robot", "robot", 1).with("mode", mode);
    return outside ? beside(b, "robot") : b;
  };
  for (const bool outside : {false, true}) {
    Build given = robot("position", outside), monitor = robot("monitor", outside), impedance = robot("impedance", outside);
    EXPECT_THAT(error_of([&] { load(robot("position", outside)); }),
                HasSubstr("robot.q_d (where it moves to) is not connected and has no value, but the unit would act on it"));
    given.with("q_d", std::string("0.1 0.2"));
    EXPECT_EQ(error_of([&] { load(given); }), "");
    EXPECT_THAT(load(monitor).warnings(), ::testing::Not(::testing::Contains(HasSubstr("robot.q_d"))));
    EXPECT_THAT(load(impedance).warnings(), ::testing::Contains(HasSubstr("robot.q_d (where it moves to) is not connected")));
  }
}

TEST(ThreadedUnit, AForgottenDerivativeIsReportedAsInTheLoop) {
  for (const bool outside : {false, true}) {
    Build b;
    b.unit("robot", "robot").unit("follower", "follower", 1).connect("robot.q", "follower.q_d");
    if (outside) beside(b, "robot");
    EXPECT_THAT(load(b).warnings(), ::testing::Contains(HasSubstr("expected a connection from robot.dq, or a value")));
  }
}

TEST(ThreadedUnit, CannotBeTheSourceOfTheClock) {
  for (const char* named : {"", "x"}) {
    Build b;
    b.unit("x", "silent");
    b.scenario.clock.kind = ClockKind::kArrivals;
    b.scenario.clock.component = named;
    EXPECT_EQ(error_of([&] { load(beside(b, "x")); }),
              "test.ssd:10: component 'x' with beside=\"true\" is the source of the clock, expected another component, or "
              "beside=\"false\"");
  }
}

// Robots in the loop go to their safe state at once, however long a step beside the loop lasts.
TEST(ThreadedUnit, UnitsInTheLoopAreEndedBeforeTheLastStepBesideItIsWaitedFor) {
  Build b;
  b.unit("x", "robot?called=x").unit("y", "robot?called=y", 1).until(0.001);
  const std::vector<UnitType> all = types();
  MasterOptions options;
  options.types = all;
  options.clock = std::make_unique<Hurried>();
  std::vector<std::string> waited_for, ended_before;
  options.waiting = [&](const std::vector<std::string>& names) {
    waited_for = names;
    ended_before = Robot::ended;
    Gate::open = true;
    Gate::open.notify_all();
  };
  Robot::ended.clear();
  Master master(beside(b, "x").scenario, std::move(options));
  master.initialise();
  Gate::open = false;
  ASSERT_TRUE(master.step_tick());
  master.finish();
  EXPECT_THAT(waited_for, ::testing::ElementsAre("x"));
  EXPECT_THAT(ended_before, ::testing::ElementsAre("y"));
  EXPECT_THAT(Robot::ended, ::testing::ElementsAre("y", "x"));
}

TEST(ThreadedUnit, AUnitThatRequestsTheEndEndsTheRun) {
  Build b;
  b.unit("x", "brief").until(1);
  const auto rows = run(load(beside(b, "x")), {"x.steps"});
  EXPECT_EQ(rows.back(), std::vector<double>{3});
  EXPECT_EQ(rows.size(), 1u + 4u) << "three steps, and the one in which the third is seen";
}

TEST(ThreadedUnit, EventsAndKindsOfValuesReachTheUnit) {
  Build b;
  b.unit("m", "mixed").with("integer", std::int64_t{7}).with("boolean", true).with("string", std::string("word"));
  b.unit("g", "gain").with("u", 1.0).event(0.004, "g.gain", "5");
  beside(b, "m");
  Master master = load(beside(b, "g"));
  master.initialise();
  for (int i = 0; i < 2; ++i) ASSERT_TRUE(master.step_tick());
  EXPECT_EQ(value(master, "m.integer_out"), 7);
  EXPECT_EQ(master.members()[0].variables().at("string_out").strings()[0], "word");
  EXPECT_TRUE(master.members()[0].variables().at("boolean_out").booleans()[0]);
  for (int i = 2; i < 5; ++i) ASSERT_TRUE(master.step_tick());
  EXPECT_EQ(value(master, "g.y"), 1) << "the event was at the beginning of the last tick";
  ASSERT_TRUE(master.step_tick());
  EXPECT_EQ(value(master, "g.y"), 5);
}

}  // namespace
}  // namespace cotwin::master::beside_test
