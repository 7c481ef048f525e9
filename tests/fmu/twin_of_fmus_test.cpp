// A scenario whose components are FMUs of Cotwin and foreign FMUs, as one FMU: compared with the run of the scenario in the
// master.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <cstring>
#include <thread>

#include "components/unit/unit_table.h"
#include "fmu/description/read.h"
#include "fmu/export/pack.h"
#include "fmu/import/package.h"
#include "fmu/import/unit/fmu_unit.h"
#include "fmu/import/unit/variables.h"
#include "master/run/master.h"
#include "master/run/recorder.h"
#include "master/twin/pack_twin.h"
#include "master/twin/twin.h"
#include "models/foundation/support/bytes.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/driver.h"
#include "tests/fmu/foreign.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::master::twin_of_fmus_test {
namespace {

namespace fs = std::filesystem;
using fmu::Version;
using fmu::testing::Driver;
using fmu::testing::LoadedFmu;
using fmu::testing::make_fmu;
using ::testing::HasSubstr;

constexpr double kMillisecond = 1e-3;  // s

const std::vector<fs::path>& folders() {
  static const std::vector<fs::path> all = {fs::path(places::source()) / "models"};
  return all;
}

fs::path pack(const Scenario& scenario, Version version, const fs::path& out, std::vector<std::string> platforms = {}) {
  PackageOptions options;
  options.types = unit_types();
  options.folders = folders();
  options.version = version;
  options.platforms = std::move(platforms);
  pack_twin(scenario, options, out);
  return out;
}

fs::path pack_drive_train(Version version, const fs::path& out) {
  fmu::PackRequest request;
  request.source = "unit:drive_train?robot=lwr4";
  request.folders = folders();
  request.types = unit_types();
  request.version = version;
  fmu::pack_unit(request, out);
  return out;
}

ComponentSpec component(const std::string& name, const std::string& source) {
  ComponentSpec spec;
  spec.name = name;
  spec.source = source;
  return spec;
}

/// Example 02 with its drive as an FMU, in the folder of this FMU.
Scenario with_our_fmu(const fs::path& folder, Version version) {
  Scenario scenario = load_scenario(fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd");
  pack_drive_train(version, folder / "drive.fmu");
  scenario.stop = Time::from_seconds(0.7);  // the motion begins at 0.5 s
  for (ComponentSpec& spec : scenario.components) {
    // The other sources are settings and names, not files of the scenario's folder.
    if (spec.name == "drive") spec.source = "drive.fmu";
  }
  scenario.folder = folder;
  return scenario;
}

/// The same with foreign FMUs: FMI 2 Co-Simulation with names and units of measure that Cotwin never exports, FMI 3
/// Co-Simulation with event mode, and FMI 3 Model Exchange, one of them twice.
Scenario with_foreign_fmus(const fs::path& folder, Version version) {
  Scenario scenario = with_our_fmu(folder, version);
  for (const char* name : {"rogue2", "rogue3", "ball3"}) make_fmu(name, folder);
  scenario.components.push_back(component("cell.speed", "rogue2.fmu"));
  scenario.components.push_back(component("events", "rogue3.fmu?structural.n=2"));
  scenario.components.push_back(component("ball", "ball3.fmu"));
  scenario.components.push_back(component("ball two", "ball3.fmu"));
  scenario.components.back().start_values.push_back({"h", 2.0, "", ""});
  scenario.connections.push_back({{"drive", "dq[1]", ""}, {"ball", "u", ""}, 2, 0.5, false, ""});
  scenario.connections.push_back({{"ball", "v", ""}, {"events", "u[2]", ""}, 1, 0, false, ""});
  scenario.recording.push_back({"*", ""});
  return scenario;
}

/// All variables of a scenario's FMU in the order of its components' variables, and a master for comparison.
class Pair {
 public:
  Pair(const Scenario& scenario, Version version, const fs::path& archive)
      : fmu_(pack(scenario, version, archive), version), master_(make_master(scenario)) {
    std::vector<Member> members = load_members(scenario, unit_types(), folders());
    std::set<std::string> outputs;
    for (const Column& column : choose_columns(scenario, members))
      outputs.insert(members[column.signal.member].name() + "." + column.signal.variable->name);
    layout_ = std::make_unique<Twin>(scenario, std::move(members), outputs);
    layout_->declare(variables_);
  }
  static Master make_master(const Scenario& scenario) {
    MasterOptions options;
    options.types = unit_types();
    options.folders = folders();
    options.threads = 1;
    return Master(scenario, std::move(options));
  }

  const LoadedFmu& fmu() const { return fmu_; }
  Master& master() { return master_; }
  const Variables& variables() const { return variables_; }

  /// All numbers and booleans of the FMU, as bits.
  std::string bits(Driver& d) const {
    std::string text;
    for (const Variable& v : variables_) text += bits(d, v);
    return text;
  }
  std::string bits(Driver& d, const Variable& v) const {
    const std::vector<unsigned> references = fmu::testing::references(variables_, v.name, fmu_.version());
    std::string text = v.name + "=";
    const auto read = [&](auto values) {
      EXPECT_EQ(d.get(references, values), 0) << v.name << ": " << d.last_message();
      text.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
    };
    std::vector<double> reals(v.size());
    std::vector<std::int32_t> integers(v.size());
    std::array<bool, 64> booleans{};
    if (v.kind() == Kind::kReal) read(std::span(reals));
    if (v.kind() == Kind::kInteger) read(std::span(integers));
    if (v.kind() == Kind::kBoolean) read(std::span(booleans).first(v.size()));
    return text;
  }
  void expect_same(Driver& d, const std::string& when) {
    auto of_fmu = variables_.begin();
    for (const Member& member : master_.members()) {
      for (const Variable& v : member.variables()) {
        const Variable& same = *of_fmu++;
        if (v.kind() == Kind::kString) continue;
        std::string expected = same.name + "=";
        std::visit(
            [&](auto values) {
              using Element = typename decltype(values)::value_type;
              if constexpr (!std::is_same_v<Element, std::string>)
                expected.append(reinterpret_cast<const char*>(values.data()), values.size_bytes());
            },
            v.storage);
        ASSERT_TRUE(bits(d, same) == expected) << member.name() << "." << v.name << " differs " << when;
      }
    }
  }

 private:
  LoadedFmu fmu_;
  Master master_;
  std::unique_ptr<Twin> layout_;
  Variables variables_;
};

class TwinOfFmus : public ::testing::TestWithParam<Version> {
 protected:
  Version other() const { return GetParam() == Version::k2 ? Version::k3 : Version::k2; }
  static void step(Driver& d, int begin, int end) {
    for (int i = begin; i < end; ++i) ASSERT_EQ(d.step(i * kMillisecond, kMillisecond), 0) << d.last_message();
  }
  fmu::TemporaryFolder folder_;
};

TEST_P(TwinOfFmus, GivesTheBitsOfTheRun) {
  Pair pair(with_foreign_fmus(folder_.path(), other()), GetParam(), folder_.path() / "twin.fmu");
  const std::size_t before = fmu::testing::temporary_folders();
  {
    Driver d(pair.fmu());
    ASSERT_TRUE(d.alive()) << d.last_message();
    pair.master().initialise();
    d.initialise();
    pair.expect_same(d, "after initialisation");
    for (int i = 0; i < 700; ++i) {
      ASSERT_TRUE(pair.master().step_tick());
      step(d, i, i + 1);
      if (i % 50 == 0 || i > 690) pair.expect_same(d, "after tick " + std::to_string(i));
    }
    EXPECT_EQ(fmu::testing::temporary_folders(), before) << "the FMU unpacks nothing";
  }
  const double bounces = find_signal(pair.master().members(), "ball.bounces", "").variable->integers()[0];
  EXPECT_GT(bounces, 0) << "the ball had no events";
}

TEST_P(TwinOfFmus, GoesOnFromASavedStateInAFreshInstanceAndAfterAReset) {
  const Pair pair(with_our_fmu(folder_.path(), other()), GetParam(), folder_.path() / "twin.fmu");
  Driver d(pair.fmu());
  d.initialise();
  step(d, 0, 520);
  void* state = nullptr;
  ASSERT_EQ(d.save(&state), 0) << d.last_message();
  step(d, 520, 650);
  const std::string expected = pair.bits(d);
  ASSERT_EQ(d.restore(state), 0) << d.last_message();
  step(d, 520, 650);
  EXPECT_TRUE(pair.bits(d) == expected);

  Driver fresh(pair.fmu());
  void* taken = nullptr;
  ASSERT_EQ(fresh.deserialise(d.serialise(state), &taken), 0) << fresh.last_message();
  ASSERT_EQ(fresh.restore(taken), 0) << fresh.last_message();
  step(fresh, 520, 650);
  EXPECT_TRUE(pair.bits(fresh) == expected);

  ASSERT_EQ(d.reset(), 0) << d.last_message();
  d.initialise();
  step(d, 0, 650);
  EXPECT_TRUE(pair.bits(d) == expected);
}

TEST_P(TwinOfFmus, SharesNothingBetweenInstancesAndThreads) {
  const Pair pair(with_our_fmu(folder_.path(), other()), GetParam(), folder_.path() / "twin.fmu");
  const auto run = [&](double tau) {
    Driver d(pair.fmu());
    const std::vector<double> values(7, tau);
    EXPECT_EQ(d.set(fmu::testing::references(pair.variables(), "drive.tau_e", GetParam()), std::span<const double>(values)), 0);
    d.initialise();
    step(d, 0, 100);
    return pair.bits(d);
  };
  const std::string one = run(1), two = run(2);
  EXPECT_FALSE(one == two);
  std::array<std::string, 4> seen;
  std::vector<std::thread> threads;
  for (std::size_t k = 0; k < seen.size(); ++k) threads.emplace_back([&, k] { seen[k] = run(k % 2 == 0 ? 1 : 2); });
  for (std::thread& thread : threads) thread.join();
  for (std::size_t k = 0; k < seen.size(); ++k) EXPECT_TRUE(seen[k] == (k % 2 == 0 ? one : two)) << k;
}

TEST_P(TwinOfFmus, ContainsAnotherTwin) {
  Scenario inner = with_our_fmu(folder_.path(), other());
  pack(inner, other(), folder_.path() / "inner.fmu");
  Scenario outer;
  outer.name = "outer";
  outer.folder = folder_.path();
  outer.stop = inner.stop;
  outer.components = {component("cell", "inner.fmu")};
  Pair pair(outer, GetParam(), folder_.path() / "outer.fmu");
  Driver d(pair.fmu());
  ASSERT_TRUE(d.alive()) << d.last_message();
  pair.master().initialise();
  d.initialise();
  Master flat = Pair::make_master(inner);
  flat.initialise();
  for (int i = 0; i < 600; ++i) {
    ASSERT_TRUE(pair.master().step_tick() && flat.step_tick());
    step(d, i, i + 1);
  }
  pair.expect_same(d, "after 0.6 s");
  const auto q = find_signal(pair.master().members(), "cell.drive.q", "").reals(),
             expected = find_signal(flat.members(), "drive.q", "").reals();
  EXPECT_TRUE(std::equal(q.begin(), q.end(), expected.begin(), expected.end()));
}

TEST_P(TwinOfFmus, HoldsTheFilesOfSeveralInstancesOnceUnlessAProcessMayHoldOneOnly) {
  const std::string plain = "<ModelExchange ";
  const auto held = [&](const fmu::testing::Edits& edits) {
    make_fmu("ball3", folder_.path(), edits);
    Scenario scenario;
    scenario.name = "x";
    scenario.folder = folder_.path();
    scenario.stop = Time::from_seconds(1);
    for (const char* name : {"a", "b", "c"}) scenario.components.push_back(component(name, "ball3.fmu"));
    scenario.components[1].start_values.push_back({"h", 2.0, "", ""});
    const LoadedFmu loaded(pack(scenario, GetParam(), folder_.path() / "x.fmu"), GetParam());
    const std::size_t before = fmu::testing::mapped_libraries("ball.so");
    Driver d(loaded);
    EXPECT_TRUE(d.alive()) << d.last_message();
    d.initialise();
    std::size_t packed = 0;
    for (const fmu::ArchiveEntry& entry : fmu::list_archive(loaded.archive())) packed += entry.name.ends_with("/ball.so");
    EXPECT_EQ(fmu::testing::mapped_libraries("ball.so"), before + packed);
    return packed;
  };
  EXPECT_EQ(held({}), 1u);
  EXPECT_EQ(held({{plain, plain + "canBeInstantiatedOnlyOncePerProcess=\"true\" "}}), 3u);
}

TEST_P(TwinOfFmus, DeclaresTheRequirementsOfItsFmus) {
  const auto said_with = [&](const std::string& name, const fmu::testing::Edits& edits) {
    make_fmu(name, folder_.path(), edits);
    Scenario scenario;
    scenario.name = "x";
    scenario.folder = folder_.path();
    scenario.stop = Time::from_seconds(1);
    scenario.components = {component("a", name + ".fmu")};
    const fs::path archive = pack(scenario, GetParam(), folder_.path() / "x.fmu");
    return *fmu::parse_model_description(fmu::read_archive_file(archive, "modelDescription.xml"), "x").co_simulation;
  };
  const std::string plain = "<ModelExchange ";
  const fmu::Interface ball = said_with("ball3", {});
  EXPECT_FALSE(ball.only_once_per_process || ball.needs_execution_tool);
  EXPECT_FALSE(ball.can_get_and_set_state) << "no other instance can restore its state";
  EXPECT_TRUE(said_with("rogue2", {}).can_get_and_set_state) << "it serialises its state";
  EXPECT_TRUE(said_with("ball3", {{plain, plain + "canBeInstantiatedOnlyOncePerProcess=\"true\" "}}).only_once_per_process);
  EXPECT_TRUE(said_with("ball3", {{plain, plain + "needsExecutionTool=\"true\" "}}).needs_execution_tool);
}

TEST_P(TwinOfFmus, HasADescriptionThatFollowsTheStandard) {
  const LoadedFmu loaded(pack(with_foreign_fmus(folder_.path(), other()), GetParam(), folder_.path() / "twin.fmu"), GetParam());
  const auto standard = GetParam() == Version::k2 ? cotwin::testing::Standard::kFmi2 : cotwin::testing::Standard::kFmi3;
  const std::string xml = fmu::testing::read_text(loaded.folder() / "modelDescription.xml");
  EXPECT_THAT(cotwin::testing::faults(xml, standard), ::testing::IsEmpty());
}

TEST_P(TwinOfFmus, HasADescriptionThatTheSchemaAccepts) {
  const fs::path schema = fs::path(places::public_data("schemas")) /
                          (GetParam() == Version::k2 ? "fmi2/fmi2ModelDescription.xsd" : "fmi3-3.0.2/fmi3ModelDescription.xsd");
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  const LoadedFmu loaded(pack(with_foreign_fmus(folder_.path(), other()), GetParam(), folder_.path() / "twin.fmu"), GetParam());
  EXPECT_EQ(cotwin::testing::schema_errors(schema, loaded.folder() / "modelDescription.xml"), "");
}

INSTANTIATE_TEST_SUITE_P(BothVersions, TwinOfFmus, ::testing::Values(Version::k2, Version::k3),
                         [](const auto& version) { return version.param == Version::k2 ? "Fmi2" : "Fmi3"; });

TEST(TwinOfFmusArchive, KeepsTheNamesOfForeignVariablesApart) {
  const fmu::TemporaryFolder folder;
  make_fmu("rogue2", folder.path(), {{"name=\"on\"", "name=\"y_in_mm\""}});  // and there is "y in mm"
  Scenario scenario;
  scenario.name = "x";
  scenario.folder = folder.path();
  scenario.stop = Time::from_seconds(1);
  scenario.components = {component("a b", "rogue2.fmu")};
  const Pair pair(scenario, Version::k3, folder.path() / "x.fmu");
  EXPECT_EQ(pair.variables().at("a_b.y_in_mm").kind(), Kind::kReal);
  EXPECT_EQ(pair.variables().at("a_b.y_in_mm_").kind(), Kind::kBoolean);
  EXPECT_EQ(pair.variables().at("a_b.longest_step").si, "") << "furlong is not a known unit of measure";
}

TEST(TwinOfFmusArchive, RefusesFmusThatCannotBePacked) {
  const fmu::TemporaryFolder folder;
  make_fmu("rogue2", folder.path());
  Scenario scenario;
  scenario.name = "x";
  scenario.folder = folder.path();
  scenario.stop = Time::from_seconds(1);
  scenario.components = {component("a", "rogue2.fmu")};
  scenario.components[0].place = "x.ssd:7";
  const auto refusal = [&](const std::vector<std::string>& platforms) -> std::string {
    try {
      pack(scenario, Version::k3, folder.path() / "x.fmu", platforms);
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  EXPECT_EQ(refusal({"linux64", "aarch64-linux"}),
            "x.ssd:7: component 'a': rogue2.fmu has no binaries/aarch64-linux/rogue.so, as platform aarch64-linux needs");
  EXPECT_THAT(refusal({"win64"}), HasSubstr("cannot hold on x86_64-windows"));
  scenario.components[0].process = fmu::ProcessChoice::kOwn;
  EXPECT_THAT(refusal({}), HasSubstr("rogue2.fmu is to run in a process of its own, expected"));
  scenario.components[0].process = fmu::ProcessChoice::kShared;
  scenario.tolerance = 1e-3;
  EXPECT_THAT(refusal({}), HasSubstr("adapts to a tolerance"));
  EXPECT_FALSE(fs::exists(folder.path() / "x.fmu"));
}

TEST(TwinOfFmusArchive, ReportsAMissingFmuToTheHost) {
  const fmu::TemporaryFolder folder;
  make_fmu("rogue2", folder.path());
  Scenario scenario;
  scenario.name = "x";
  scenario.folder = folder.path();
  scenario.stop = Time::from_seconds(1);
  scenario.components = {component("a", "rogue2.fmu")};
  const LoadedFmu loaded(pack(scenario, Version::k3, folder.path() / "x.fmu"), Version::k3);
  fs::remove_all(loaded.folder() / "resources/rogue2.fmu/binaries");
  const Driver d(loaded);
  EXPECT_FALSE(d.alive());
  EXPECT_THAT(d.last_message(),
              HasSubstr("component 'a': rogue2.fmu: no library for this platform, expected binaries/linux64/rogue.so"));
  fs::remove_all(loaded.folder() / "resources/rogue2.fmu");
  const Driver without(loaded);
  EXPECT_FALSE(without.alive());
  EXPECT_THAT(without.last_message(), HasSubstr("component 'a': rogue2.fmu: there is no folder resources/rogue2.fmu"));
}

/// rogue2 as a folder. It refuses a second instance called "only one".
Scenario with_only_one(const fs::path& folder) {
  const fmu::TemporaryFolder unpacked = fmu::unpack_archive(make_fmu("rogue2", folder));
  fs::create_directories(folder / "unpacked");
  fs::copy(unpacked.path(), folder / "unpacked/rogue2.fmu", fs::copy_options::recursive);
  Scenario scenario;
  scenario.name = "x";
  scenario.folder = folder;
  scenario.stop = Time::from_seconds(1);
  scenario.components = {component("only one", "unpacked/rogue2.fmu")};
  return scenario;
}

TEST(TwinOfFmusArchive, HoldsOneInstanceOfAnFmuAtATime) {
  for (const Version version : {Version::k2, Version::k3}) {
    const fmu::TemporaryFolder folder;
    const LoadedFmu loaded(pack(with_only_one(folder.path()), version, folder.path() / "x.fmu"), version);
    Driver d(loaded);
    ASSERT_TRUE(d.alive()) << d.last_message();
    EXPECT_FALSE(Driver(loaded).alive()) << "two at once, which the FMU must detect";
    for (int run = 0; run < 3; ++run) {
      d.initialise();
      for (int i = 0; i < 10; ++i) ASSERT_EQ(d.step(i * kMillisecond, kMillisecond), 0) << d.last_message();
      ASSERT_EQ(d.reset(), 0) << d.last_message();
    }
    fs::remove_all(loaded.folder() / "resources/rogue2.fmu");
    EXPECT_EQ(d.reset(), 3);
    EXPECT_THAT(d.last_message(), HasSubstr("there is no folder resources/rogue2.fmu"));
    void* state = nullptr;
    EXPECT_EQ(d.save(&state), 3) << "the unit no longer exists";
    EXPECT_EQ(d.reset(), 3);
  }
}

TEST(TwinOfFmusArchive, PassesTheWarningsOfItsFmusToTheHost) {
  for (const Version version : {Version::k2, Version::k3}) {
    const fmu::TemporaryFolder folder;
    const LoadedFmu loaded(pack(with_only_one(folder.path()), version, folder.path() / "x.fmu"), version);
    const Driver d(loaded);
    ASSERT_TRUE(d.alive()) << d.last_message();
    ASSERT_EQ(d.log().size(), 1u);
    EXPECT_EQ(d.log()[0].status, 1);
    EXPECT_EQ(d.log()[0].category, "logStatusWarning");
    EXPECT_THAT(d.log()[0].text, HasSubstr("only one: rogue2.fmu: unit 'furlong' is not defined"));
  }
}

TEST(TwinOfFmusArchive, PacksTheTargetsOfLinksInAnFmusFolder) {
  const fmu::TemporaryFolder folder;
  const Scenario scenario = with_only_one(folder.path());
  const fs::path fmu = folder.path() / "unpacked/rogue2.fmu";
  fs::create_directories(folder.path() / "elsewhere");
  std::ofstream(folder.path() / "elsewhere/table.txt") << "1 2 3";
  fs::create_directory_symlink(folder.path() / "elsewhere", fmu / "resources");
  {
    const LoadedFmu loaded(pack(scenario, Version::k3, folder.path() / "x.fmu"), Version::k3);
    EXPECT_EQ(fmu::testing::read_text(loaded.folder() / "resources/rogue2.fmu/resources/table.txt"), "1 2 3");
  }
  const auto refusal = [&]() -> std::string {
    try {
      pack(scenario, Version::k3, folder.path() / "y.fmu");
    } catch (const Error& error) {
      return error.what();
    }
    return "no error";
  };
  fs::create_directory_symlink("../unpacked", folder.path() / "elsewhere/around");
  EXPECT_THAT(refusal(), HasSubstr("resources/around/rogue2.fmu: is a link to a folder that it lies in"));
  fs::remove(folder.path() / "elsewhere/around");
  fs::create_symlink("nowhere", folder.path() / "elsewhere/lost");
  EXPECT_THAT(refusal(), HasSubstr("resources/lost: is neither a file nor a folder"));
}

constexpr const char* kStrangers[] = {"rogue2", "rogue3", "ball2", "ball3", "clocks3"};

fmu::ForeignPackage package_of(const std::string& name) {
  fmu::ForeignPackage package;
  package.name = name + ".fmu";
  package.folder = "folder";
  package.description = fmu::parse_model_description(fmu::testing::description_of(name), name);
  package.options.kind =
      package.description.co_simulation ? fmu::InterfaceChoice::kCoSimulation : fmu::InterfaceChoice::kModelExchange;
  package.options.tolerance = 1e-4;
  package.options.si = false;
  double value = 3;
  Variables variables;
  variables.input("u", value, "1", "an input");
  package.start.take(variables);
  return package;
}

/// 8 bytes of kind and version, 8 of hash, and the data of this hash: so that damaged bytes are not refused because of the
/// hash.
constexpr std::size_t kHead = 2 * sizeof(std::uint64_t);
std::string with_fresh_hash(std::string bytes) {
  const std::uint64_t hash = hash_of(std::string_view(bytes).substr(kHead));
  std::memcpy(bytes.data() + kHead / 2, &hash, sizeof hash);
  return bytes;
}
std::string with_number(std::string bytes, std::size_t at, std::uint64_t number) {
  std::memcpy(bytes.data() + at, &number, std::min(sizeof number, bytes.size() - at));
  return with_fresh_hash(std::move(bytes));
}
/// `to` replaces the first text `from`, including its length.
std::string with_text(const std::string& bytes, const std::string& from, const std::string& to) {
  ByteWriter before, after;
  before.text(from);
  after.text(to);
  return with_fresh_hash(fmu::testing::replaced(bytes, before.bytes(), after.bytes()));
}
/// The first byte of a package that differs after `change`.
template <class Change>
std::size_t place_of(const fmu::ForeignPackage& package, Change change) {
  fmu::ForeignPackage other = package;
  change(other);
  const std::string a = serialise(package), b = serialise(other);
  for (std::size_t i = kHead; i < std::min(a.size(), b.size()); ++i) {
    if (a[i] != b[i]) return i;
  }
  throw std::runtime_error("no difference");
}
std::string refusal(const std::string& bytes) {
  try {
    static_cast<void>(fmu::deserialise_foreign(bytes, "here"));
  } catch (const Error& error) {
    return error.what();
  }
  return "no error";
}

TEST(ForeignPackage, KeepsTheWholeDescriptionAndRefusesDamagedBytes) {
  for (const char* name : kStrangers) {
    fmu::ForeignPackage package = package_of(name);
    package.options.structural = {{"n", 4}, {"m", 5}};
    const std::string bytes = serialise(package);
    EXPECT_TRUE(fmu::is_foreign_package(bytes));
    const fmu::ForeignPackage back = fmu::deserialise_foreign(bytes, "here");
    EXPECT_EQ(serialise(back), bytes);
    EXPECT_EQ(back.name, package.name);
    EXPECT_EQ(back.options.structural, package.options.structural);
    EXPECT_EQ(back.options.tolerance, package.options.tolerance);
    EXPECT_FALSE(back.options.si);
    EXPECT_TRUE(back.start == package.start);
    EXPECT_TRUE(back.description == package.description) << name;
    for (std::size_t i = 0; i < bytes.size(); ++i) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ 1);
      EXPECT_THROW(fmu::deserialise_foreign(damaged, "here"), Error) << i;
      EXPECT_THROW(fmu::deserialise_foreign(std::string_view(bytes).substr(0, i), "here"), Error) << i;
    }
  }
}

TEST(ForeignPackage, WithDamageAndACorrectHashIsRefusedOrCanBeBuilt) {
  int refused = 0, built = 0;
  const auto take = [&](const std::string& bytes) {
    fmu::ForeignPackage package;
    try {
      package = fmu::deserialise_foreign(bytes, "here");
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), ::testing::StartsWith("here: "));
      ++refused;
      return;
    }
    EXPECT_EQ(serialise(fmu::deserialise_foreign(serialise(package), "again")), serialise(package));
    try {
      const fmu::ModelDescription& d = package.description;
      const fmu::LoadOptions& o = package.options;
      fmu::ForeignVariables variables(d, fmu::variables_options(d, fmu::chosen_kind(d, o.kind), fmu::unit_options(d, o)));
      Variables declared;
      variables.declare(declared);
      ++built;
    } catch (const Error&) {  // an unknown unit of measure, an extent beyond the options
    }
  };
  for (const char* name : kStrangers) {
    const std::string bytes = serialise(package_of(name));
    for (std::size_t i = kHead; i < bytes.size(); ++i) {
      std::string damaged = bytes;
      damaged[i] = static_cast<char>(damaged[i] ^ 0x81);
      take(with_fresh_hash(damaged));
      take(with_number(bytes, i, std::uint64_t{1} << 40));
      take(with_number(bytes, i, 3));
    }
  }
  EXPECT_GT(refused, 1000);
  EXPECT_GT(built, 1000) << "the code after the parser was not reached";
}

TEST(ForeignPackage, RefusesInvalidDescriptions) {
  using fmu::Causality;
  using fmu::ForeignPackage;
  ForeignPackage package = package_of("rogue3");
  package.description.model_name = "a model";  // also the name of its library
  const std::string bytes = serialise(package);
  for (const char* folder : {"..", ".", "", "../../inner", "/inner", "a/b", "a\\b"})
    EXPECT_EQ(refusal(with_text(bytes, "folder", folder)),
              "here: '" + std::string(folder) + "', expected the name of a folder");
  EXPECT_EQ(refusal(with_text(bytes, "folder", "...")), "no error");
  for (const char* identifier : {"..", "", "../../../inner/x", "/x"})
    EXPECT_EQ(refusal(with_text(bytes, "rogue", identifier)),
              "here: modelIdentifier '" + std::string(identifier) + "', expected the name of a shared library");
  const std::string& first = package.description.variables.front().name;
  EXPECT_THAT(refusal(with_text(bytes, first, "")), HasSubstr("here: a variable's name is empty"));
  EXPECT_THAT(refusal(with_text(bytes, first, package.description.variables.back().name)), HasSubstr("appears twice"));
  EXPECT_THAT(refusal(with_text(bytes, package.description.fmi_version, "2.0")), HasSubstr("does not belong to version 3"));

  std::string damaged = bytes;
  damaged[place_of(package,
                   [](ForeignPackage& p) { p.description.variables[0].causality = Causality::kCalculatedParameter; })] = 7;
  EXPECT_EQ(refusal(with_fresh_hash(damaged)), "here: has the invalid enumeration value 7, expected 0 to 6");

  ForeignPackage other = package;
  fmu::ModelVariable& v = other.description.variables.emplace_back();
  v.name = "rate";
  v.reference = 4'000'000'000;
  v.derivative = other.description.variables.size() - 1;
  const std::size_t at = place_of(other, [](ForeignPackage& p) { p.description.variables.back().derivative = 0; });
  EXPECT_THAT(refusal(with_number(serialise(other), at, std::uint64_t{1} << 40)),
              HasSubstr("here: variable 'rate': derivative refers to variable 1099511627776 of "));

  const std::size_t count = place_of(package, [&](ForeignPackage& p) { p.description = other.description; });
  const std::string large = bytes + std::string(std::size_t{64} << 20, '\0');
  EXPECT_EQ(refusal(with_number(large, count, std::uint64_t{64} << 20)), "here: is damaged or cut short");

  other.description.variables.back().derivative = std::size_t{1} << 40;
  EXPECT_THROW(static_cast<void>(serialise(other)), Error) << "a file that cannot be read is not written";
}

}  // namespace
}  // namespace cotwin::master::twin_of_fmus_test
