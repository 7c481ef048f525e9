// A run that is saved, killed and resumed has the same bits as an uninterrupted run.
#include "master/run/checkpoint.h"

#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <condition_variable>
#include <fstream>
#include <mutex>
#include <random>
#include <sstream>

#include "master/results/summary.h"
#include "models/foundation/support/atomic_file.h"
#include "models/foundation/support/bytes.h"
#include "tests/master/test_units.h"
#include "tests/support/files.h"

namespace cotwin::master::checkpoint_test {
namespace {

namespace fs = std::filesystem;
using ::cotwin::testing::Build;
using cotwin::testing::content;
using ::cotwin::testing::error_of;
using ::cotwin::testing::test_types;
using ::testing::HasSubstr;

class Saved : public ::testing::Test {
 protected:
  Saved() { fs::create_directories(folder_); }
  ~Saved() override { fs::remove_all(folder_); }

  static Master make(const Scenario& scenario, const fs::path& results, std::optional<RunState> resume = {}) {
    MasterOptions options;
    options.types = test_types();
    options.results = results;
    options.resume = std::move(resume);
    return Master(scenario, std::move(options));
  }
  /// The figures that depend on the scenario alone.
  static std::string figures(const Master& master) {
    Summary s = master.summary();
    s.wall_seconds = s.real_time_factor = s.exchange_share = s.check_share = s.observe_share = 0;
    s.units.clear();
    s.recording.clear();
    std::ostringstream out;
    write_json(out, s, {});
    return out.str();
  }
  struct Ended {
    std::string csv, figures;
  };
  Ended run_on(Master& master, const fs::path& results) const {
    while (master.step_tick()) {
    }
    master.finish();
    return {content(results / "signals.csv"), figures(master)};
  }
  /// The state after `ticks`; then the run continues for `lost` ticks and is abandoned.
  RunState state_of_abandoned_run(const Scenario& scenario, const fs::path& results, std::int64_t ticks, std::int64_t lost) {
    Master master = make(scenario, results);
    master.initialise();
    while (master.tick() < ticks && master.step_tick()) {
    }
    std::optional<RunState> state;
    master.save([&](RunState s) { state = std::move(s); });
    EXPECT_TRUE(state.has_value());  // all units are Cotwin's: at once
    EXPECT_TRUE(master.sync_recording(*state));
    for (std::int64_t i = 0; i < lost && master.step_tick(); ++i) {
    }
    return *state;
  }
  void expect_same_bits(const Scenario& scenario, std::initializer_list<std::int64_t> places) {
    Master straight = make(scenario, folder_ / "straight");
    straight.initialise();
    const Ended wanted = run_on(straight, folder_ / "straight");
    for (const std::int64_t place : places) {
      const fs::path results = folder_ / ("at" + std::to_string(place));
      const RunState state = state_of_abandoned_run(scenario, results, place, 7);
      Master resumed = make(scenario, results, state);
      resumed.initialise();
      EXPECT_EQ(resumed.tick(), place);
      const Ended got = run_on(resumed, results);
      EXPECT_EQ(got.csv, wanted.csv) << "saved at tick " << place;
      EXPECT_EQ(got.figures, wanted.figures) << "saved at tick " << place;
      EXPECT_FALSE(fs::exists(results / "signals.csv.part"));
    }
  }
  /// Active ramps, jumps, periods, stages, a loop, all kinds of values and all figures of the summary.
  static Scenario rich() {
    Build b;
    b.unit("h", "heavy").unit("slow", "integrator", 0, 7).unit("r", "ramped", 1).unit("m", "mixed").unit("p", "probe", 0, 3);
    b.unit("a", "oscillator_a").unit("b", "oscillator_b", 1).unit("g", "gain?n=1");
    b.connect("a.tau", "b.tau").connect("b.q", "a.q").connect("h.y", "slow.u").as_it_is();
    b.connect("slow.y", "r.u").as_it_is();
    b.event(0.05, "h.u", "0.9", 0.8).event(0.3, "g.gain", "4").event(0.31, "m.string", "moved").event(0.4, "m.integer", "5");
    b.event(0.45, "g.gain", "-2", 0.3).event(0.7, "m.boolean", "true");
    b.until(1.0005);
    b.scenario.coupling = CouplingChoice::kExplicit;  // so that it can be saved in any tick
    b.scenario.recording = {{"*", "test.ssd:70"}};
    b.scenario.decimation = 3;
    b.scenario.reports = {{"", ReportKind::kSignal, "r.y", "", ""},
                          {"e", ReportKind::kEnergy, "a.tau", "b.dq", ""},
                          {"d", ReportKind::kDifference, "a.theta", "b.q", ""}};
    b.scenario.comparisons = {{"c", "a.theta", "b.q", 5, {}, {}, ""}};
    b.scenario.bonds = {{"gear", "a.tau", "b.dq", "b.tau", "b.dq", 0, ""}};
    return b.scenario;
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_saved_" + std::to_string(::getpid()) + "_" +
                                                        ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(Saved, GoesOnToTheSameBitsFromAnyTick) { expect_same_bits(rich(), {0, 1, 49, 255, 256, 257, 500, 993, 1000}); }

TEST_F(Saved, GoesOnToTheSameBitsWithAToleranceAndWithDiscardedSteps) {
  Build discarding;
  discarding.unit("p", "picky").with("longest", 0.0004).with("from", 0.1).unit("h", "heavy").until(0.5);
  expect_same_bits(discarding.scenario, {50, 99, 101, 140, 300});
  fs::remove_all(folder_);
  Build tolerant;
  tolerant.unit("p", "picky").unit("i", "integrator").connect("p.y", "i.u").as_it_is().event(0.03, "p.u", "9").until(0.2);
  tolerant.scenario.tolerance = 1e-4;
  expect_same_bits(tolerant.scenario, {1, 29, 31, 150});
}

TEST_F(Saved, ResumesWithoutARecordingAndAnEndedRunIsNotSaved) {
  Build b;
  b.unit("h", "heavy").until(0.1);
  const RunState state = state_of_abandoned_run(b.scenario, {}, 40, 0);
  Master resumed = make(b.scenario, {}, state), straight = make(b.scenario, {});
  resumed.initialise();
  straight.initialise();
  EXPECT_EQ(run_on(resumed, folder_).figures, run_on(straight, folder_).figures);
  bool handed = false;
  straight.save([&](RunState) { handed = true; });
  EXPECT_FALSE(handed);
}

TEST_F(Saved, RefusesTheStateOfAnotherRun) {
  const Scenario scenario = rich();
  const RunState state = state_of_abandoned_run(scenario, folder_ / "one", 100, 0);
  const auto refused = [&](const Scenario& other, const RunState& with, const fs::path& results) {
    return error_of([&] { make(other, results, with).initialise(); });
  };
  Scenario other = scenario;
  other.components.front().start_values.push_back({"start", 0.31, "", ""});
  EXPECT_THAT(refused(other, state, folder_ / "one"), HasSubstr("had other initial values"));
  other = scenario;
  other.events.pop_back();
  EXPECT_THAT(refused(other, state, folder_ / "one"), HasSubstr("other events"));
  other = scenario;
  other.reports.clear();
  EXPECT_THAT(refused(other, state, folder_ / "one"), HasSubstr("other signals"));
  other = scenario;
  other.stop = Time::from_seconds(0.05);
  EXPECT_THAT(refused(other, state, folder_ / "one"), HasSubstr("another run"));
  EXPECT_THAT(refused(scenario, state, folder_ / "nowhere"), HasSubstr("No such file"));
  // Another recording: fewer columns, or fewer rows than the state expects.
  other = scenario;
  other.recording = {{"h.*", ""}};
  EXPECT_THAT(refused(other, state, folder_ / "one"), HasSubstr("its columns are not those of the run"));
  fs::resize_file(folder_ / "one/signals.csv.part", 2000);
  EXPECT_THAT(refused(scenario, state, folder_ / "one"), HasSubstr("has 2000 bytes"));
}

TEST_F(Saved, RefusesARecordingWithOneOtherByteAndLeavesItAlone) {
  const Scenario scenario = rich();
  const fs::path file = folder_ / "one/signals.csv.part";
  const RunState state = state_of_abandoned_run(scenario, folder_ / "one", 100, 7);
  const std::string good = content(file);
  const std::size_t kept = state.recording->bytes;
  ASSERT_LT(kept, good.size());
  std::mt19937_64 random(11);
  for (int i = 0; i < 40; ++i) {
    std::string bad = good;
    const std::size_t at = i < 2 ? (i == 0 ? 0 : kept - 2) : random() % kept;
    bad[at] = static_cast<char>(bad[at] ^ (1 << random() % 7));
    write_file(file, bad);
    EXPECT_THAT(error_of([&] { make(scenario, folder_ / "one", state).initialise(); }),
                HasSubstr("signals.csv: cannot be resumed: "))
        << at;
    ASSERT_EQ(content(file), bad) << "nothing is cut off";
  }
  // What came after the checkpoint is written again, whatever it is.
  std::string bad = good;
  bad[kept] ^= 1;
  write_file(file, bad);
  Master resumed = make(scenario, folder_ / "one", state);
  resumed.initialise();
  Master straight = make(scenario, folder_ / "straight");
  straight.initialise();
  EXPECT_EQ(run_on(resumed, folder_ / "one").csv, run_on(straight, folder_ / "straight").csv);
}

// The hash goes on with that of the rows that are kept.
TEST_F(Saved, HashesTheRecordingOverSeveralRuns) {
  const Scenario scenario = rich();
  const RunState first = state_of_abandoned_run(scenario, folder_ / "one", 300, 5);
  Master second = make(scenario, folder_ / "one", first);
  second.initialise();
  while (second.tick() < 600 && second.step_tick()) {
  }
  std::optional<RunState> later;
  second.save([&](RunState s) { later = std::move(s); });
  ASSERT_TRUE(later && second.sync_recording(*later));
  const RunState at_once = state_of_abandoned_run(scenario, folder_ / "two", 600, 0);
  EXPECT_EQ(later->recording->bytes, at_once.recording->bytes);
  EXPECT_EQ(later->recording->hash, at_once.recording->hash);
  EXPECT_NE(later->recording->hash, first.recording->hash);
}

TEST_F(Saved, NamesTheUnitThatCannotBeSaved) {
  Build b;
  b.unit("h", "heavy").unit("bus", "picky?restorable=false");
  Master master = make(b.scenario, {});
  master.initialise();
  EXPECT_EQ(master.unsavable(), "'bus' cannot be saved");
  EXPECT_THAT(error_of([&] { master.save([](RunState) {}); }), HasSubstr("'bus' cannot be saved"));
}

RunCheckpoint checkpoint_with(RunState state) {
  return {{"1.2", 0x1234, "x86-64-v3"}, 77, "{\"file\":\"a.ssd\"}", "/somewhere", std::move(state)};
}

TEST_F(Saved, IsWrittenAndReadByteForByte) {
  const RunCheckpoint made = checkpoint_with(state_of_abandoned_run(rich(), folder_ / "one", 300, 0));
  write_file(folder_ / "file", to_bytes(made));
  const RunCheckpoint read = load_checkpoint(folder_ / "file");
  EXPECT_EQ(read.build, made.build);
  EXPECT_EQ(read.command, made.command);
  EXPECT_EQ(read.state.bytes, made.state.bytes);
  EXPECT_EQ(to_bytes(read), to_bytes(made));
  EXPECT_THAT(error_of([&] { load_checkpoint(folder_ / "none"); }), HasSubstr("No such file"));
}

TEST_F(Saved, FileThatIsCutOrDamagedIsAnError) {
  const std::string good = to_bytes(checkpoint_with(state_of_abandoned_run(rich(), {}, 300, 0)));
  for (std::size_t length = 0; length < good.size(); length += 1 + length / 40)
    EXPECT_NE(error_of([&] { parse_checkpoint(good.substr(0, length), "file"); }), "") << length;
  std::mt19937_64 random(3);
  for (int i = 0; i < 2000; ++i) {
    std::string bad = good;
    bad[random() % bad.size()] ^= static_cast<char>(1 + random() % 255);
    EXPECT_NE(error_of([&] { parse_checkpoint(bad, "file"); }), "");
  }
}

TEST_F(Saved, StateWithDamageAndACorrectHashIsAnErrorOrARun) {
  // The hash of the file detects accidental changes; these checks come after it.
  const Scenario scenario = rich();
  const RunState good = state_of_abandoned_run(scenario, {}, 300, 0);
  std::mt19937_64 random(5);
  for (int i = 0; i < 3000; ++i) {
    RunState bad = good;
    const std::uint64_t edits = 1 + random() % 3;
    for (std::uint64_t e = 0; e < edits; ++e) {
      if (random() % 16 == 0) bad.bytes.resize(random() % (bad.bytes.size() + 1));
      if (bad.bytes.empty()) break;
      char& byte = bad.bytes[random() % bad.bytes.size()];
      byte = random() % 4 == 0 ? static_cast<char>(random()) : static_cast<char>(byte ^ (1 << random() % 8));
    }
    try {
      Master master = make(scenario, {}, bad);
      master.initialise();
      for (int tick = 0; tick < 3 && master.step_tick(); ++tick) {
      }
      static_cast<void>(master.summary());
    } catch (const Error&) {
    }
  }
}

TEST_F(Saved, TheFirstCheckpointIsDueSoonerThanTheNextOnes) {
  std::mutex mutex;
  std::condition_variable changed;
  bool due = false;
  CheckpointWriter::Options options;
  options.file = folder_ / "run.checkpoint";
  options.every = std::chrono::hours(1);
  options.head = checkpoint_with({});
  options.due = [&] {
    const std::lock_guard lock(mutex);
    due = true;
    changed.notify_all();
  };
  CheckpointWriter writer(std::move(options));
  std::unique_lock lock(mutex);
  EXPECT_TRUE(changed.wait_for(lock, std::chrono::minutes(1), [&] { return due; }));
}

TEST_F(Saved, TheWriterKeepsTheEarlierFileWhereItCannotWriteAnother) {
  std::atomic<int> due{0};
  CheckpointWriter::Options options;
  options.file = folder_ / "run.checkpoint";
  options.every = std::chrono::duration<double>(0);
  options.head = checkpoint_with({});
  options.due = [&] { ++due; };
  CheckpointWriter writer(std::move(options));
  writer.write({1, {}, {}, 2.5, "first"});
  writer.wait_until_idle();
  EXPECT_EQ(load_checkpoint(folder_ / "run.checkpoint").state.bytes, "first");
  EXPECT_EQ(writer.failure(), "");
  fs::remove(folder_ / "run.checkpoint");
  fs::create_directory(folder_ / "run.checkpoint");  // this cannot come from a file
  writer.write({1, {}, {}, 2.5, "second"});
  writer.end();
  EXPECT_THAT(writer.failure(), HasSubstr("run.checkpoint: cannot be written: Is a directory"));
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_)) EXPECT_EQ(entry.path().filename(), "run.checkpoint");
}

}  // namespace
}  // namespace cotwin::master::checkpoint_test
