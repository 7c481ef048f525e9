// A whole scenario as one FMU, compared with the run of the scenario in the master: example 02, shortened, with an event.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <fstream>
#include <thread>

#include "components/unit/unit_table.h"
#include "master/run/master.h"
#include "master/run/recorder.h"
#include "master/twin/pack_twin.h"
#include "master/twin/twin_package.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/driver.h"
#include "tests/fmu/foreign.h"
#include "tests/fmu/old_glibc.h"
#include "tests/support/allocations.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::master::twin_fmu_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::run_command;
using cotwin::testing::RunResult;
using fmu::Version;
using fmu::testing::Driver;
using fmu::testing::LoadedFmu;
using fmu::testing::references;

constexpr std::int64_t kTick = 1'000'000;  // ns
constexpr double kMillisecond = 1e-3;      // s

const std::vector<fs::path>& folders() {
  static const std::vector<fs::path> all = {fs::path(places::source()) / "tests/components/properties",
                                            fs::path(places::source()) / "models"};
  return all;
}

Scenario example() {
  Scenario scenario = load_scenario(fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  scenario.start = Time{};
  scenario.stop = Time{900 * kTick};  // the motion begins at 0.5 s
  scenario.events.push_back({Time{200 * kTick}, "drive.tau_e[2]", "3", Duration{500 * kTick}, ""});
  scenario.events.push_back({Time{250 * kTick}, "compliance.omega", "12", Duration{}, ""});
  return scenario;
}

Master master_of(const Scenario& scenario) {
  MasterOptions options;
  options.types = unit_types();
  options.folders = folders();
  options.threads = 1;
  return Master(scenario, std::move(options));
}

/// The unit inside the FMU of a scenario, built without packing.
struct InProcess {
  std::unique_ptr<Twin> unit;
  Variables variables;

  explicit InProcess(const Scenario& scenario) {
    std::vector<Member> members = load_members(scenario, unit_types(), folders());
    std::set<std::string> outputs;
    for (const Column& column : choose_columns(scenario, members)) {
      outputs.insert(members[column.signal.member].name() + "." + column.signal.variable->name);
    }
    unit = std::make_unique<Twin>(scenario, std::move(members), outputs);
    unit->declare(variables);
  }
};

fs::path pack(const Scenario& scenario, Version version, const fs::path& out) {
  PackageOptions options;
  options.types = unit_types();
  options.folders = folders();
  options.version = version;
  pack_twin(scenario, options, out);
  return out;
}

/// All bits of a row of values.
template <class Values>
void append(std::string& text, const Values& values) {
  for (const auto& value : values) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(value)>, std::string>) {
      text += value;
    } else {
      text.append(reinterpret_cast<const char*>(&value), sizeof value);
    }
    text += ';';
  }
}
std::string bits(const Variable& v) {
  std::string text;
  std::visit([&](auto values) { append(text, values); }, v.storage);
  return text;
}

class TwinFmu : public ::testing::TestWithParam<Version> {
 protected:
  void SetUp() override {
    static fmu::TemporaryFolder archives;  // each is written once
    archive_ = archives.path() / ("twin." + std::to_string(static_cast<int>(GetParam())) + ".fmu");
    if (!fs::exists(archive_)) pack(scenario_, GetParam(), archive_);
    fmu_ = std::make_unique<LoadedFmu>(archive_, GetParam());
  }

  std::vector<unsigned> of(const std::string& name) const { return references(layout_.variables, name, GetParam()); }

  std::string bits(Driver& d, const Variable& v) const {
    std::string text;
    const std::vector<unsigned> refs = of(v.name);
    const auto read = [&](auto&& values) {
      EXPECT_EQ(d.get(refs, std::span(values)), 0) << v.name << ": " << d.last_message();
      append(text, values);
    };
    switch (v.kind()) {
      case Kind::kReal:
        read(std::vector<double>(v.size()));
        break;
      case Kind::kInteger:
        read(std::vector<std::int32_t>(v.size()));
        break;
      case Kind::kBoolean: {
        std::array<bool, 64> room{};
        read(std::span<bool>(room).first(v.size()));
        break;
      }
      case Kind::kString:
        read(std::vector<std::string>(v.size()));
        break;
    }
    return text;
  }
  std::string all_bits(Driver& d) const {
    std::string all;
    for (const Variable& v : layout_.variables) all += v.name + "=" + bits(d, v);
    return all;
  }
  void expect_same(Driver& d, Master& master, const std::string& when) const {
    for (const Member& member : master.members()) {
      for (const Variable& v : member.variables()) {
        if (v.kind() == Kind::kString) continue;
        const std::string name = member.name() + "." + v.name;
        ASSERT_EQ(bits(d, layout_.variables.at(name)), twin_fmu_test::bits(v)) << name << " differs " << when;
      }
    }
  }
  /// Steps [begin, end) of `h` seconds.
  void step(Driver& d, int begin, int end, double h = kMillisecond) const {
    for (int i = begin; i < end; ++i) ASSERT_EQ(d.step(i * h, h), 0) << d.last_message();
  }

  Scenario scenario_ = example();
  InProcess layout_{scenario_};
  fs::path archive_;
  std::unique_ptr<LoadedFmu> fmu_;
};

TEST_P(TwinFmu, HasADescriptionThatFollowsTheStandard) {
  const auto standard = GetParam() == Version::k2 ? cotwin::testing::Standard::kFmi2 : cotwin::testing::Standard::kFmi3;
  const std::string xml = fmu::testing::read_text(fmu_->folder() / "modelDescription.xml");
  EXPECT_THAT(cotwin::testing::faults(xml, standard), ::testing::IsEmpty());
}

TEST_P(TwinFmu, HasADescriptionThatTheSchemaAccepts) {
  const fs::path schema = fs::path(places::public_data("schemas")) /
                          (GetParam() == Version::k2 ? "fmi2/fmi2ModelDescription.xsd" : "fmi3-3.0.2/fmi3ModelDescription.xsd");
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  EXPECT_EQ(cotwin::testing::schema_errors(schema, fmu_->folder() / "modelDescription.xml"), "");
}

TEST_P(TwinFmu, GivesTheBitsOfTheRun) {
  Driver d(*fmu_);
  ASSERT_TRUE(d.alive()) << d.last_message();
  Master master = master_of(scenario_);
  master.initialise();
  d.initialise();
  expect_same(d, master, "after initialisation");
  for (int i = 0; i < 900; ++i) {
    ASSERT_TRUE(master.step_tick());
    step(d, i, i + 1);
    if (i % 50 == 0 || i > 880) expect_same(d, master, "after tick " + std::to_string(i));
  }
  EXPECT_FALSE(master.step_tick());
  step(d, 900, 910);  // the scenario's stop time is not that of the FMU
}

TEST_P(TwinFmu, TakesInputsAndTunablesFromOutside) {
  Driver d(*fmu_);
  Master master = master_of(scenario_);
  master.initialise();
  d.initialise();
  const auto change = [&](const std::string& name, const std::vector<double>& values) {
    ASSERT_EQ(d.set(of(name), std::span<const double>(values)), 0) << d.last_message();
    const std::span<double> own = find_signal(master.members(), name, "").reals();
    std::copy(values.begin(), values.end(), own.begin());
  };
  std::string untouched;
  for (int i = 0; i < 150; ++i) {
    if (i == 40) change("drive.tau_e", {1, -2, 3, -4, 5, -6, 7});
    if (i == 90) change("compliance.omega", std::vector<double>(7, 9.0));
    ASSERT_TRUE(master.step_tick());
    step(d, i, i + 1);
    if (i == 39) untouched = bits(d, layout_.variables.at("drive.q"));
  }
  expect_same(d, master, "after the changes");
  EXPECT_NE(bits(d, layout_.variables.at("drive.q")), untouched);
}

TEST_P(TwinFmu, GoesOnFromASavedStateHereAndInAFreshInstance) {
  for (const int at : {100, 400}) {  // before the scenario's event, and during its ramp
    Driver d(*fmu_);
    d.initialise();
    step(d, 0, at);
    void* state = nullptr;
    ASSERT_EQ(d.save(&state), 0) << d.last_message();
    step(d, at, 800);
    const std::string expected = all_bits(d);

    ASSERT_EQ(d.restore(state), 0) << d.last_message();
    step(d, at, 800);
    EXPECT_TRUE(all_bits(d) == expected) << "saved after " << at << " ticks";

    Driver fresh(*fmu_);
    void* taken = nullptr;
    const std::vector<char> bytes = d.serialise(state);
    ASSERT_EQ(fresh.deserialise(bytes, &taken), 0) << fresh.last_message();
    ASSERT_EQ(fresh.restore(taken), 0) << fresh.last_message();
    step(fresh, at, 800);
    EXPECT_TRUE(all_bits(fresh) == expected) << "fresh, saved after " << at << " ticks";
  }
}

TEST_P(TwinFmu, GivesTheSameTrajectoryAfterAReset) {
  Driver d(*fmu_);
  d.initialise();
  step(d, 0, 600);
  const std::string expected = all_bits(d);
  ASSERT_EQ(d.reset(), 0) << d.last_message();
  d.initialise();
  EXPECT_FALSE(all_bits(d) == expected);
  step(d, 0, 600);
  EXPECT_TRUE(all_bits(d) == expected);
}

TEST_P(TwinFmu, SharesNothingBetweenInstancesAndThreads) {
  const auto run = [&](double tau) {
    Driver d(*fmu_);
    const std::vector<double> values(7, tau);
    EXPECT_EQ(d.set(of("drive.tau_e"), std::span<const double>(values)), 0) << d.last_message();
    d.initialise();
    step(d, 0, 100);
    return all_bits(d);
  };
  const std::string one = run(1), two = run(2);
  EXPECT_FALSE(one == two);
  std::array<std::string, 4> seen;
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < seen.size(); ++k) threads.emplace_back([&, k] { seen[k] = run(k % 2 == 0 ? 1 : 2); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t k = 0; k < seen.size(); ++k) EXPECT_TRUE(seen[k] == (k % 2 == 0 ? one : two)) << k;
}

TEST_P(TwinFmu, StepsSeveralTicksAtOnceToTheSameBits) {
  Driver single(*fmu_), coarse(*fmu_);
  single.initialise();
  coarse.initialise();
  step(single, 0, 900);
  for (int i = 0; i < 900;) {
    const int n = std::min(1 + i % 7, 900 - i);
    ASSERT_EQ(coarse.step(i * kMillisecond, n * kMillisecond), 0) << coarse.last_message();
    i += n;
  }
  EXPECT_TRUE(all_bits(single) == all_bits(coarse));
}

TEST_P(TwinFmu, DividesAnyStepIntoTheFewestEqualTicks) {
  Scenario finer = scenario_;
  finer.tick = Duration{750'000};
  Master master = master_of(finer);
  master.initialise();
  Driver d(*fmu_);
  d.initialise();
  for (int i = 0; i < 300; ++i) {
    ASSERT_TRUE(master.step_tick() && master.step_tick());
    step(d, i, i + 1, 1.5e-3);
  }
  expect_same(d, master, "between two ticks of 0.75 ms and a step of 1.5 ms");
}

INSTANTIATE_TEST_SUITE_P(BothVersions, TwinFmu, ::testing::Values(Version::k2, Version::k3),
                         [](const auto& version) { return version.param == Version::k2 ? "Fmi2" : "Fmi3"; });

TEST(TwinUnit, HasRecordedVariablesAsOutputsAndUnconnectedInputsAsInputs) {
  const InProcess twin(example());
  const auto role = [&](const char* name) { return twin.variables.at(name).role; };
  EXPECT_EQ(role("drive.tau_J"), Role::kOutput);  // recorded
  EXPECT_EQ(role("drive.dq"), Role::kState);      // an output that is not
  EXPECT_EQ(role("drive.tau_e"), Role::kInput);   // open
  EXPECT_EQ(role("drive.tau_m"), Role::kState);   // connected
  EXPECT_EQ(role("drive.K"), Role::kParameter);
  EXPECT_EQ(role("compliance.omega"), Role::kTunable);
  EXPECT_EQ(twin.variables.at("drive.tau_J").si, "N.m");
  EXPECT_EQ(twin.variables.at("drive.tau_J").size(), 7u);
}

TEST(TwinUnit, AllocatesNothingInAStep) {
  InProcess twin(example());
  twin.unit->initialise(Time{});
  ASSERT_EQ(twin.unit->step(Time{}, Duration{kTick}), StepResult::kDone);
  const std::uint64_t before = cotwin::testing::allocations();
  for (int i = 1; i < 800; ++i) ASSERT_EQ(twin.unit->step(Time{i * kTick}, Duration{kTick}), StepResult::kDone);
  EXPECT_EQ(cotwin::testing::allocations() - before, 0u);
}

TEST(TwinUnit, MakesItsEventsAtTheTimesOfAHostThatStartsElsewhere) {
  Scenario later = example();
  later.start = Time{230 * kTick};  // after the first event and before the second
  Master master = master_of(later);
  master.initialise();
  InProcess twin(example());
  twin.unit->initialise(later.start);
  for (int i = 230; i < 300; ++i) {
    ASSERT_TRUE(master.step_tick());
    ASSERT_EQ(twin.unit->step(Time{i * kTick}, Duration{kTick}), StepResult::kDone);
  }
  EXPECT_EQ(bits(twin.variables.at("drive.q")), bits(*find_signal(master.members(), "drive.q", "").variable));
  EXPECT_EQ(twin.variables.at("compliance.omega").reals()[0], 12);
}

TEST(TwinUnit, RefusesAStateThatIsCutShort) {
  InProcess twin(example());
  twin.unit->initialise(Time{});
  std::string memory;
  twin.unit->save_memory(memory);
  EXPECT_NO_THROW(twin.unit->restore_memory(memory));
  EXPECT_THROW(twin.unit->restore_memory(memory.substr(0, memory.size() - 1)), Error);
}

TEST(TwinPackage, KeepsTheScenarioAndRefusesDamagedBytes) {
  TwinPackage package;
  Scenario& s = package.scenario;
  s.name = "x";
  s.start = Time{-5};
  s.stop = Time{7};
  s.tick = Duration{3};
  s.components.resize(1);
  s.components[0].name = "cell.a";
  s.components[0].stage = 2;
  s.components[0].period = 4;
  s.connections.push_back({{"cell.a", "y[2]", "deg"}, {"cell.a", "u", "mrad"}, 2.5, -1, true, "f.ssd:3"});
  s.events.push_back({Time{6}, "cell.a.u[2]", "1 2", Duration{9}, "f.ssd:4"});
  s.units.push_back({"mrad", 1, 2, -3, 4, -5, 6, -7, 8, 1e-3, 0.5});
  package.packages = {std::string("a\0b", 3)};
  package.given = {{{"u", 2, 0.25}, {"v", 0, -1}}};
  package.outputs = {"cell.a.y"};
  const std::string bytes = serialise(package);
  const TwinPackage back = deserialise_twin(bytes, "here");
  EXPECT_EQ(serialise(back), bytes);
  EXPECT_EQ(back.scenario.tick, s.tick);
  EXPECT_EQ(back.scenario.components[0].period, 4);
  EXPECT_EQ(back.scenario.connections[0].to.unit, "mrad");
  EXPECT_EQ(back.scenario.connections[0].offset, -1);
  EXPECT_TRUE(back.scenario.connections[0].suppress_unit_conversion);
  EXPECT_EQ(back.scenario.events[0].ramp, Duration{9});
  EXPECT_EQ(back.scenario.units[0].rad, 8);
  EXPECT_EQ(back.scenario.units[0].offset, 0.5);
  EXPECT_EQ(back.packages, package.packages);
  ASSERT_EQ(back.given.at(0).size(), 2u);
  EXPECT_EQ(back.given[0][0].variable, "u");
  EXPECT_EQ(back.given[0][0].element, 2u);
  EXPECT_EQ(back.given[0][0].value, 0.25);
  EXPECT_EQ(back.outputs, package.outputs);
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    std::string damaged = bytes;
    damaged[i] = static_cast<char>(damaged[i] ^ 1);
    EXPECT_THROW(deserialise_twin(damaged, "here"), Error) << i;
    EXPECT_THROW(deserialise_twin(std::string_view(bytes).substr(0, i), "here"), Error) << i;
  }
}

/// A recording that contains the motion of the robot, connected to a compliance.
Scenario with_a_file() {
  Scenario scenario;
  scenario.name = "recorded";
  scenario.stop = Time{100 * kTick};
  scenario.settings = {{"robot", "lwr4"}};
  ComponentSpec recording;
  recording.name = "the recording";  // names of variables have no blanks
  recording.source = "unit:io";
  for (const ParameterValue& value : load_parameter_set(folders()[0] / "io.ssv").values) {
    recording.start_values.push_back(value);
  }
  scenario.components = {recording};
  return scenario;
}

TEST(TwinArchive, CarriesTheFilesThatItsUnitsRead) {
  const fmu::TemporaryFolder folder;
  const LoadedFmu loaded(pack(with_a_file(), Version::k3, folder.path() / "x.fmu"), Version::k3);
  EXPECT_TRUE(fs::exists(loaded.folder() / "resources/io_recording.csv"));
  Driver d(loaded);
  ASSERT_TRUE(d.alive()) << d.last_message();
  d.initialise();
  Master master = master_of(with_a_file());
  master.initialise();
  for (int i = 0; i < 50; ++i) {
    ASSERT_TRUE(master.step_tick());
    ASSERT_EQ(d.step(i * kMillisecond, kMillisecond), 0) << d.last_message();
  }
  const InProcess layout(with_a_file());
  std::vector<double> q(7);
  ASSERT_EQ(d.get(references(layout.variables, "the_recording.q", Version::k3), std::span(q)), 0) << d.last_message();
  const std::span<double> expected = find_signal(master.members(), "the recording.q", "").reals();
  EXPECT_TRUE(std::equal(q.begin(), q.end(), expected.begin(), expected.end()));
  EXPECT_NE(q[0], 0);
}

TEST(TwinArchive, StandsAloneAndLoadsWhereverGlibcIs228OrNewer) {
  const fmu::TemporaryFolder folder;
  const LoadedFmu loaded(pack(example(), Version::k2, folder.path() / "x.fmu"), Version::k2);
  std::istringstream symbols(run_command({"nm", "-D", "--defined-only", loaded.library()}).out);
  int seen = 0;
  for (std::string address, kind, name; symbols >> address >> kind >> name; ++seen) {
    EXPECT_TRUE(kind == "T" && (name.starts_with("fmi2") || name.starts_with("fmi3"))) << kind << " " << name;
  }
  EXPECT_GT(seen, 100);
  for (const fmu::ArchiveEntry& entry : fmu::list_archive(loaded.archive())) {
    if (!entry.name.starts_with("resources/")) continue;
    EXPECT_THAT(fmu::read_archive_file(loaded.archive(), entry.name), ::testing::Not(::testing::HasSubstr(places::source())))
        << entry.name;
  }
  if (std::string(COTWIN_SANITIZERS).size() > 0) GTEST_SKIP() << "sanitizers need their library";
  fmu::testing::expect_loads_with_old_glibc(loaded.library(), run_command({"objdump", "-T", loaded.library()}).out);
}

TEST(TwinArchive, IsWrittenByTheProgram) {
  const fmu::TemporaryFolder folder;
  const std::string scenario = places::source() + "/examples/02_free_motion_lwr4/twin.ssd";
  const auto pack_as = [&](const fs::path& file) {
    return cotwin::testing::run_program({"pack", scenario, "--as-fmu", "--fmi", "3", "-o", file}, {.merge = true});
  };
  const fs::path out = folder.path() / "x.fmu";
  const RunResult packed = pack_as(out);
  EXPECT_EQ(packed.code, 0);
  EXPECT_EQ(packed.out, "");
  const LoadedFmu loaded(out, Version::k3);
  Driver d(loaded);
  EXPECT_TRUE(d.alive()) << d.last_message();
  EXPECT_THAT(fmu::read_archive_file(out, "modelDescription.xml"), ::testing::HasSubstr("modelName=\"free_motion_lwr4\""));
  EXPECT_THAT(pack_as(folder.path() / "x.ssp").out, ::testing::HasSubstr("expected a name that ends in .fmu"));
}

}  // namespace
}  // namespace cotwin::master::twin_fmu_test
