// Loops whose values begin to diverge during a run: seen by their growth, and solved from before it.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <functional>
#include <sstream>

#include "master/engine/coupling/growth_watch.h"
#include "master/results/summary.h"
#include "master/twin/twin.h"
#include "tests/master/test_units.h"
#include "tests/support/files.h"

namespace cotwin::master::coupling_growth_test {
namespace {

namespace fs = std::filesystem;
using ::cotwin::testing::Build;
using ::cotwin::testing::error_of;
using ::cotwin::testing::value;
using ::testing::AllOf;
using ::testing::HasSubstr;

/// m ẍ = −c x − d ẋ + k(t) (u − x): a body whose connection with the other becomes stiff at time t_s.
class Body final : public Unit {
 public:
  Body(bool held, bool has_cheap_rollback) : held_(held), goes_back_(has_cheap_rollback) {}
  void declare(Variables& v) override {
    auto u = v.input("u", u_, "m", "position of the other body");
    if (!held_) u.rate(du_);
    v.output("y", y_, "m", "position");
    v.parameter("start", start_, "m", "position at the start");
    v.parameter("t_s", t_s_, "s", "when the connection becomes stiff");
    v.state("x", x_, "m", "position");
    v.state("dx", dx_, "m/s", "speed");
  }
  void initialise(Time) override {
    x_ = y_ = start_;
    dx_ = 0;
  }
  StepResult step(Time now, Duration h) override {
    constexpr int kParts = 400;
    const double s = h.seconds() / kParts;
    for (int i = 0; i < kParts; ++i) {  // symplectic Euler: stable at this stiffness
      const double t = now.seconds() + i * s, u = u_ + (held_ ? 0 : du_ * i * s);
      const double k = t < t_s_ ? 1 : 1e4;
      dx_ += s * (-x_ - 0.05 * dx_ + k * (u - x_));
      x_ += s * dx_;
    }
    y_ = x_;
    return StepResult::kDone;
  }
  bool has_cheap_rollback() const override { return goes_back_; }

 private:
  bool held_, goes_back_;
  double u_ = 0, du_ = 0, y_ = 0, start_ = 0, t_s_ = 6, x_ = 0, dx_ = 0;
};

/// y = u + v without delay.
class Sum final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "rad", "first");
    v.input("v", v_, "rad", "second");
    v.output("y", y_, "rad", "sum");
  }
  void initialise(Time) override { y_ = u_ + v_; }
  StepResult step(Time, Duration) override {
    y_ = u_ + v_;
    return StepResult::kDone;
  }

 private:
  double u_ = 0, v_ = 0, y_ = 0;
};

std::span<const UnitType> types() {
  static const std::vector<UnitType> kTypes = {
      {"sum", "y = u + v", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Sum>(); }},
      {"gain", "y = gain u", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<cotwin::testing::Gain>(1); }},
      {"body", "held input", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Body>(true, true); }},
      {"ramped_body", "linear input", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Body>(false, true); }},
      {"fixed_body", "cannot go back", [](Settings&) -> std::unique_ptr<Unit> { return std::make_unique<Body>(true, false); }}};
  return kTypes;
}

Build bodies(const std::string& type, CouplingChoice coupling, double t_s = 6) {
  Build b;
  b.unit("a", type)
      .with("start", 1.0)
      .with("t_s", t_s)
      .unit("b", type)
      .with("t_s", t_s)
      .connect("a.y", "b.u")
      .connect("b.y", "a.u")
      .until(8);
  b.scenario.tick = Duration::from_seconds(0.01);
  b.scenario.coupling = coupling;
  return b;
}

struct Ended {
  Summary summary;
  std::string csv;
};

class Growth : public ::testing::Test {
 protected:
  Growth() { fs::create_directories(folder_); }
  ~Growth() override { fs::remove_all(folder_); }

  Master make(const Build& b) {
    MasterOptions options;
    options.types = types();
    options.results = folder_;
    options.threads = 2;
    options.always_threads = true;
    options.resume = std::exchange(saved_, std::nullopt);
    return Master(b.scenario, std::move(options));
  }
  Ended run(const Build& b) {
    Master master = make(b);
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
    return {master.summary(), cotwin::testing::content(folder_ / "signals.csv")};
  }
  /// Saves the run at the first checkpoint from the tick on, and ends it some ticks later without a result.
  void run_and_abandon(const Build& b, std::int64_t tick) {
    Master master = make(b);
    master.initialise();
    while (master.tick() < tick) master.step_tick();
    std::optional<RunState> state;
    master.save([&](RunState s) { state = std::move(s); });
    while (!state) ASSERT_TRUE(master.step_tick());
    ASSERT_TRUE(master.sync_recording(*state));
    for (int i = 0; i < 7; ++i) master.step_tick();
    saved_ = std::move(state);
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_growth_" + std::to_string(::getpid()));
  std::optional<RunState> saved_;
};

/// The largest magnitude and the number of rows of a recording of numbers.
struct Rows {
  int count = 0;
  double largest = 0, last_time = -1;
  bool in_order = true;
};

Rows rows_of(const std::string& csv) {
  Rows rows;
  std::istringstream in(csv);
  std::string line;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::istringstream cells(line);
    std::string cell;
    std::getline(cells, cell, ',');
    rows.in_order = rows.in_order && std::stod(cell) > rows.last_time;
    rows.last_time = std::stod(cell);
    while (std::getline(cells, cell, ',')) rows.largest = std::max(rows.largest, std::abs(std::stod(cell)));
    ++rows.count;
  }
  return rows;
}

TEST_F(Growth, OfALoopThatBecomesStiffIsSolvedFromBeforeIt) {
  for (const char* type : {"body", "ramped_body"}) {
    const Ended ended = run(bodies(type, CouplingChoice::kAuto));
    ASSERT_EQ(ended.summary.loops.size(), 1u);
    EXPECT_TRUE(ended.summary.loops[0].solved) << type;
    EXPECT_EQ(ended.summary.loops[0].solved_from, 5.12) << type;  // the last checkpoint before the stiffness
    const Rows rows = rows_of(ended.csv);
    EXPECT_EQ(rows.count, 801) << type;  // each tick once, none of those that were taken back
    EXPECT_TRUE(rows.in_order) << type;
    EXPECT_LT(rows.largest, 1.1) << type;  // the energy of the start
  }
}

// Also on threads. Where a checkpoint was taken amid the growth, what had grown until then stays.
TEST_F(Growth, IsEndedWhereverItBegins) {
  for (const char* type : {"body", "ramped_body"}) {
    for (const double t_s : {1.5, 2.5, 2.53, 2.6, 5.05}) {
      const Ended ended = run(bodies(type, CouplingChoice::kAuto, t_s));
      EXPECT_TRUE(ended.summary.loops[0].solved) << type << ", stiff from " << t_s << " s";
      EXPECT_LT(rows_of(ended.csv).largest, 2.5) << type << ", stiff from " << t_s << " s";
    }
  }
}

TEST_F(Growth, HasTheSameBitsInAScenarioThatIsOneUnit) {
  for (const char* type : {"body", "ramped_body"}) {
    const Build b = bodies(type, CouplingChoice::kAuto);
    MasterOptions options;
    options.types = types();
    Master master(b.scenario, std::move(options));
    master.initialise();
    Twin twin(b.scenario, load_members(b.scenario, types(), {}), {"a.y"});
    Variables v;
    twin.declare(v);
    twin.initialise(Time{});
    Snapshot before;
    const auto step = [&](int n) { return twin.step(Time::from_seconds(0.16 * n), Duration::from_seconds(0.16)); };  // 16 ticks
    for (int n = 0; n < 50; ++n) {
      if (n == 32) before.take(v, twin);
      ASSERT_EQ(step(n), StepResult::kDone);
    }
    while (master.step_tick()) {
    }
    const double end = v.at("a.y").reals()[0];
    EXPECT_EQ(end, value(master, "a.y")) << type;
    before.restore(v, twin);  // from before the loop was solved
    for (int n = 32; n < 50; ++n) ASSERT_EQ(step(n), StepResult::kDone);
    EXPECT_EQ(v.at("a.y").reals()[0], end) << type;
  }
}

TEST_F(Growth, IsTheSameInAResumedRun) {
  const Build b = bodies("body", CouplingChoice::kAuto);
  const Ended whole = run(b);
  for (const std::int64_t tick : {10, 700}) {  // before and after the switch
    run_and_abandon(b, tick);
    ASSERT_TRUE(saved_.has_value());
    const Ended resumed = run(b);
    EXPECT_EQ(resumed.csv, whole.csv) << tick;
    EXPECT_EQ(resumed.summary.loops[0].counts.steps, whole.summary.loops[0].counts.steps) << tick;
    EXPECT_EQ(resumed.summary.loops[0].solved_from, whole.summary.loops[0].solved_from) << tick;
  }
}

TEST_F(Growth, EndsTheRunWhereNothingHelps) {
  EXPECT_THAT(error_of([&] { run(bodies("fixed_body", CouplingChoice::kAuto)); }),
              AllOf(HasSubstr("the values that a, b exchange diverge: at t = "), HasSubstr("or a shorter tick")));
  EXPECT_THAT(error_of([&] { run(bodies("body", CouplingChoice::kExplicit)); }),
              AllOf(HasSubstr("the values that a, b exchange diverge: at t = "),
                    HasSubstr("expected coupling=implicit or a shorter tick")));
  EXPECT_LT(rows_of(cotwin::testing::content(folder_ / "signals.csv")).last_time, 8);
}

// With gain 1.5 and nothing that comes in, the loop is at rest; an event ends that.
TEST_F(Growth, EndsTheRunOfAFeedthroughLoopThatBeganAtRest) {
  Build b;
  b.unit("a", "sum").unit("b", "gain").with("gain", 1.5).connect("a.y", "b.u").connect("b.y", "a.u").until(1);
  b.scenario.coupling = CouplingChoice::kExplicit;
  EXPECT_EQ(error_of([&] { run(b); }), "");
  b.event(0.5, "a.v", "0.001");
  EXPECT_THAT(error_of([&] { run(b); }), HasSubstr("the values that a, b exchange diverge: at t = 0.5"));
}

/// How often the watch asks for a closer look, and whether it is sure of a divergence.
std::pair<int, bool> watched(const std::function<double(int)>& signal, bool dismiss) {
  double x = signal(0);
  GrowthWatch watch({&x}, {1e-3});
  watch.watch(true);
  int looks = 0;
  bool sure = false;
  for (int i = 1; i < 5000; ++i) {
    x = signal(i);
    if (!watch.tick()) continue;
    ++looks;
    sure = sure || watch.diverges();
    if (dismiss) watch.dismiss();
  }
  return {looks, sure};
}

// Signals that change more and more for a while are no divergence.
TEST(GrowthWatch, TellsSignalsFromDivergence) {
  using ::testing::Ge;
  using ::testing::Le;
  using ::testing::Pair;
  const auto jump = [](int i) { return i < 1000 ? 0.0 : 5e3; };
  const auto cubic = [](int i) { return 1e-6 * std::pow(i, 3); };
  const auto fast = [](int i) { return 1e-9 * std::pow(-1.2, std::min(i, 200)); };
  const auto slow = [](int i) { return 1e-3 * std::pow(1.02, std::min(i, 2500)) * std::cos(0.3 * i); };
  EXPECT_THAT(watched([](int i) { return 100 * std::sin(1e-3 * i); }, false), Pair(Le(8), false));
  EXPECT_THAT(watched([](int i) { return std::exp(-1e-2 * i) * std::cos(0.5 * i); }, false), Pair(0, false));
  EXPECT_THAT(watched(jump, false), Pair(Le(2), false));
  EXPECT_THAT(watched(cubic, false), Pair(Le(16), false));
  EXPECT_THAT(watched(fast, false), Pair(Ge(4), true));
  EXPECT_THAT(watched(slow, false), Pair(Ge(4), true));
  EXPECT_LT(watched(slow, true).first, watched(slow, false).first);
}

}  // namespace
}  // namespace cotwin::master::coupling_growth_test
