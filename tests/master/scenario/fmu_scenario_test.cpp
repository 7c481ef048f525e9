// Scenarios with FMUs: the same bits as with units, packages, single FMUs, and errors in files.
#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "components/io/ethercat/sii.h"
#include "fmu/archive/archive.h"
#include "fmu/export/pack.h"
#include "master/run/master.h"
#include "master/twin/package.h"
#include "master/workflows/check.h"
#include "master/workflows/fmu_run.h"
#include "models/foundation/formats/csv.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/run_program.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::master::fmu_scenario_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::content;
using cotwin::testing::error_of;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const fs::path kExample = fs::path(places::source()) / "examples/02_free_motion_lwr4/twin.ssd";
const std::vector<fs::path> kFolders = {fs::path(places::source()) / "models"};

const bool kSanitized = !std::string(COTWIN_SANITIZERS).empty();

/// The findings of `cotwin check`; with sanitizers only errors, because then Cotwin's libraries need those of the sanitizers.
std::vector<std::string> complaints(const fs::path& file) {
  std::vector<std::string> texts;
  for (const auto& finding : check_scenario(file, unit_types(), kFolders)) {
    if (!kSanitized || finding.level == fmu::Finding::Level::kError) texts.push_back(finding.text);
  }
  return texts;
}

class FmuScenario : public ::testing::Test {
 protected:
  FmuScenario() {
    fs::create_directories(temporary_);
    setenv("TMPDIR", temporary_.c_str(), 1);
  }
  ~FmuScenario() override {
    EXPECT_TRUE(fs::is_empty(temporary_)) << "left behind: " << fs::directory_iterator(temporary_)->path();
    unsetenv("TMPDIR");
    fs::remove_all(folder_);
  }

  /// A fraction of a second of example 02.
  static Scenario example() {
    Scenario scenario = load_scenario(kExample);
    scenario.stop = Time::from_seconds(0.6);  // the motion begins at 0.5 s
    scenario.decimation = 1;
    return scenario;
  }

  /// The recording of a run.
  std::string recorded(Scenario scenario) {
    MasterOptions options;
    options.types = unit_types();
    options.folders = kFolders;
    options.results = folder_ / "results";
    Master master(std::move(scenario), std::move(options));
    master.initialise();
    while (master.step_tick()) {
    }
    master.finish();
    return content(folder_ / "results/signals.csv");
  }

  fs::path pack(const Scenario& scenario, fmu::Version version = fmu::Version::k2) {
    PackageOptions options;
    options.types = unit_types();
    options.folders = kFolders;
    options.folders.insert(options.folders.begin(), scenario.folder);
    options.version = version;
    pack_scenario(scenario, options, folder_ / "twin.ssp");
    return folder_ / "twin.ssp";
  }

  fs::path pack_unit(const std::string& source, fmu::Version version, const std::string& name) {
    fmu::PackRequest request;
    request.source = source;
    request.folders = kFolders;
    request.types = unit_types();
    request.version = version;
    fmu::pack_unit(request, folder_ / name);
    return folder_ / name;
  }

  fs::path write(const std::string& name, const std::string& text) {
    std::ofstream(folder_ / name) << text;
    return folder_ / name;
  }

  /// Runs the program: exit code and output.
  std::pair<int, std::string> program(const std::string& arguments) {
    const testing::RunResult ran = testing::run_program(testing::words(arguments), {.folder = folder_, .merge = true});
    return {ran.code, ran.out};
  }

  const fs::path folder_ = fs::temp_directory_path() / ("cotwin_fmu_scenario_" + std::to_string(::getpid()));
  const fs::path temporary_ = folder_ / "temporary";
};

TEST_F(FmuScenario, APackageGivesTheSameBitsAsTheScenario) {
  const std::string units = recorded(example());
  EXPECT_GT(units.size(), 100'000u);
  EXPECT_EQ(recorded(load_scenario(pack(example()))) == units, true) << "FMI 2";
}

TEST_F(FmuScenario, OneAttributeTurnsAUnitIntoItsFmuInBothVersions) {
  const std::string units = recorded(example());
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) {
    Scenario scenario = example();
    scenario.components[0].source = pack_unit("unit:motion?kind=waypoints&points=7&robot=lwr4", version, "motion.fmu").string();
    EXPECT_EQ(recorded(std::move(scenario)) == units, true) << "motion, FMI " << static_cast<int>(version);
    scenario = example();  // its drive train ramps tau_m over a step
    scenario.components[2].source = pack_unit("unit:drive_train?robot=lwr4", version, "drive.fmu").string();
    EXPECT_EQ(recorded(std::move(scenario)) == units, true) << "drive train, FMI " << static_cast<int>(version);
  }
}

TEST_F(FmuScenario, AnFmuInAProcessOfItsOwnGivesTheSameBits) {
  Scenario scenario = example();
  scenario.stop = Time::from_seconds(0.1);
  const std::string units = recorded(scenario);
  scenario.components[1].source = pack_unit("unit:compliance?robot=lwr4", fmu::Version::k2, "compliance.fmu").string();
  scenario.components[1].process = fmu::ProcessChoice::kOwn;
  EXPECT_EQ(recorded(std::move(scenario)) == units, true);
}

std::string with_process(const std::string& source) {
  return R"(<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="one"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="one">
    <ssd:Elements><ssd:Component name="link" source=")" +
         source + R"("/></ssd:Elements>
  </ssd:System>
  <ssd:Annotations>
    <ssc:Annotation type="cotwin.master">
      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1"><cotwin:Component name="link" process="own"/></cotwin:Master>
    </ssc:Annotation>
  </ssd:Annotations>
</ssd:SystemStructureDescription>
)";
}

TEST_F(FmuScenario, OnlyAnFmuHasAProcessOfItsOwn) {
  const ComponentSpec link = parse_scenario(with_process("link.fmu?timeout=5"), "one.ssd", folder_).components.at(0);
  EXPECT_EQ(link.process, fmu::ProcessChoice::kOwn);
  EXPECT_EQ(link.source, "link.fmu?timeout=5");
  EXPECT_THAT(error_of([&] { parse_scenario(with_process("unit:motion"), "one.ssd", folder_); }),
              HasSubstr("is a built-in unit, expected an FMU"));
}

TEST_F(FmuScenario, AMissingFmuOrAnInvalidOptionIsAnErrorWithItsPlace) {
  const auto loaded = [&](const std::string& source) {
    return error_of([&] { load_members(parse_scenario(with_process(source), "one.ssd", folder_), unit_types(), kFolders); });
  };
  EXPECT_THAT(loaded("nowhere.fmu"), StartsWith("one.ssd:6: component 'link': nowhere.fmu: no such file"));
  pack_unit("unit:motion?robot=lwr4", fmu::Version::k2, "link.fmu");
  EXPECT_THAT(loaded("link.fmu?timeout=never"), HasSubstr("timeout=never: expected a number"));
  EXPECT_THAT(loaded("link.fmu?colour=red"), HasSubstr("'colour': not a setting of an FMU"));
  EXPECT_EQ(loaded("link.fmu?timeout=5"), "");
}

TEST_F(FmuScenario, AnEnumerationOfAnFmuTakesTheNameOfAnItemOrItsNumber) {
  fmu::testing::make_fmu(
      "rogue2", folder_,
      {{"<LogCategories>",
        "<TypeDefinitions><SimpleType name=\"Way\"><Enumeration><Item name=\"polite\" value=\"0\"/>"
        "<Item name=\"with 2 words\" value=\"1\"/></Enumeration></SimpleType></TypeDefinitions><LogCategories>"},
       {"<Integer start=\"0\" min=\"0\" max=\"9\"/>", "<Enumeration declaredType=\"Way\" start=\"0\"/>"}});
  const auto mode = [&](const std::string& value) {
    Scenario scenario;
    scenario.folder = folder_;
    ComponentSpec spec;
    spec.name = "rogue";
    spec.source = "rogue2.fmu";
    spec.start_values.push_back({"mode", value, "", "values.ssv:5"});
    scenario.components.push_back(spec);
    return load_members(scenario, {}, {}).front().variables().at("mode").integers()[0];
  };
  EXPECT_EQ(mode("with 2 words"), 1);
  EXPECT_EQ(mode("polite"), 0);
  EXPECT_EQ(mode("1"), 1);
  EXPECT_EQ(error_of([&] { mode("rude"); }),
            "values.ssv:5: rogue.mode: 'rude' is not an item of 'Way', expected 'polite', 'with 2 words', or a number");
}

TEST_F(FmuScenario, ThePackageOfAPackageHasTheSameSystem) {
  const fs::path first = pack(example());
  const std::string system = fmu::read_archive_file(first, "SystemStructure.ssd");
  PackageOptions options;
  options.types = unit_types();
  options.folders = kFolders;
  pack_scenario(load_scenario(first), options, folder_ / "again.ssp");
  const Scenario a = load_scenario(first), b = load_scenario(folder_ / "again.ssp");
  ASSERT_EQ(a.connections.size(), b.connections.size());
  EXPECT_EQ(a.connections.size(), 8u * 7u);
  for (std::size_t i = 0; i < a.connections.size(); ++i) {
    EXPECT_EQ(a.connections[i].from.variable, b.connections[i].from.variable);
    EXPECT_EQ(a.connections[i].to.variable, b.connections[i].to.variable);
  }
  ASSERT_EQ(a.components.size(), b.components.size());
  for (std::size_t i = 0; i < a.components.size(); ++i) EXPECT_EQ(a.components[i].stage, b.components[i].stage);
  EXPECT_EQ(recorded(a) == recorded(b), true);
}

TEST_F(FmuScenario, ExtrapolatedInputsUseTheSlopesOfAnFmuOnRequest) {
  fmu::testing::make_fmu("rogue2", folder_, {{"canInterpolateInputs", "maxOutputDerivativeOrder=\"1\" canInterpolateInputs"}});
  fmu::testing::make_fmu("ball3", folder_);
  // Both in one stage: the ball's input is extrapolated from y with a slope. y'' = u' = 2 m/s2, so the slope of the last step,
  // which is the alternative, lags by h.
  const auto last_slope = [&](const std::string& query) {
    Scenario scenario;
    scenario.name = "slopes";
    scenario.folder = folder_;
    scenario.stop = Time::from_seconds(0.5);
    for (const char* name : {"source", "ball"}) {
      ComponentSpec spec;
      spec.name = name;
      spec.source = spec.name == "ball" ? "ball3.fmu" : "rogue2.fmu" + query;
      scenario.components.push_back(spec);
    }
    scenario.connections.push_back({{"source", "der(position of \"it\").y", ""}, {"ball", "u", ""}, 1, 0, true, ""});
    scenario.events.push_back({Time{}, "source.u", "2", Duration::from_seconds(1), ""});
    MasterOptions options;
    options.types = unit_types();
    Master master(scenario, std::move(options));
    master.initialise();
    while (master.step_tick()) {
    }
    return find_signal(master.members(), "ball.u", "").variable->rate[0];
  };
  // The last step starts at 0.499 s, where u = y' = 0.998 m/s; over the step before, y rose with its mean, at 0.4985 s.
  EXPECT_NEAR(last_slope("?slopes=true"), 0.998, 1e-9);
  EXPECT_NEAR(last_slope(""), 0.997, 1e-9);
}

TEST_F(FmuScenario, UnitsAndForeignFmusOfBothVersionsMixAndArePackedTogether) {
  fmu::testing::make_fmu("ball2", folder_);
  fmu::testing::make_fmu("ball3", folder_);
  const fs::path file = write("mixed.ssd", R"(<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="mixed"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">
  <ssd:System name="mixed">
    <ssd:Elements>
      <ssd:Component name="low" source="ball2.fmu" implementation="ModelExchange">
        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues>
          <ssv:ParameterSet version="1.0" name="start"><ssv:Parameters>
            <ssv:Parameter name="h"><ssv:Real value="2"/></ssv:Parameter>
          </ssv:Parameters></ssv:ParameterSet>
        </ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
      </ssd:Component>
      <ssd:Component name="high" source="ball3.fmu"/>
      <ssd:Component name="compliance" source="unit:compliance?robot=lwr4" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="low" startConnector="h" endElement="high" endConnector="u"/>
      <ssd:Connection startElement="high" startConnector="h" endElement="compliance" endConnector="tau_e[2]">
        <ssc:LinearTransformation factor="0.5" offset="1"/>
      </ssd:Connection>
    </ssd:Connections>
  </ssd:System>
  <ssd:DefaultExperiment startTime="0" stopTime="0.8"/>
</ssd:SystemStructureDescription>
)");
  const std::string loose = recorded(load_scenario(file));
  EXPECT_THAT(loose.substr(0, loose.find('\n')),
              AllOf(HasSubstr("low.h"), HasSubstr("high.h"), HasSubstr("compliance.q_c[2]")));
  EXPECT_THAT(loose, HasSubstr("\n0,2,"));  // the ball starts where the scenario says
  const fs::path package = pack(load_scenario(file));
  EXPECT_EQ(recorded(load_scenario(package)) == loose, true);
  EXPECT_THAT(complaints(package), IsEmpty());
  // Without units of measure none can be wrong: a power is the product of the numbers.
  Scenario scenario = load_scenario(file);
  scenario.reports.push_back({"power", ReportKind::kEnergy, "low.h", "low.v", ""});
  EXPECT_EQ(recorded(std::move(scenario)) == loose, true);
}

TEST_F(FmuScenario, ThePackagesFilesFollowTheStandards) {
  using cotwin::testing::faults;
  using cotwin::testing::Standard;
  const auto check = [&](const Scenario& scenario, fmu::Version version) {
    const fmu::TemporaryFolder unpacked = fmu::unpack_archive(pack(scenario, version));
    std::size_t fmus = 0;
    for (const auto& entry : fs::recursive_directory_iterator(unpacked.path())) {
      const std::string ending = entry.path().extension();
      if (ending == ".ssd") {
        EXPECT_THAT(faults(content(entry.path()), Standard::kSsd), IsEmpty()) << entry.path();
      } else if (ending == ".fmu") {
        const std::string xml = fmu::read_archive_file(entry.path(), "modelDescription.xml");
        EXPECT_THAT(faults(xml, version == fmu::Version::k2 ? Standard::kFmi2 : Standard::kFmi3), IsEmpty()) << entry.path();
        ++fmus;
      }
    }
    EXPECT_EQ(fmus, scenario.components.size());
  };
  for (const char* name : {"01_joint_admittance/arm.ssd", "04_peg_in_hole/twin.ssd", "05_maturation/twin.ssd"}) {
    const Scenario scenario = load_scenario(fs::path(places::source()) / "examples" / name);
    for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) check(scenario, version);
  }
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) check(example(), version);
}

TEST_F(FmuScenario, ThePackagesFilesAreValid) {
  const fs::path schemas = fs::path(places::public_data("schemas/ssp1"));
  if (!fs::exists(schemas)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  const fmu::TemporaryFolder unpacked = fmu::unpack_archive(pack(example()));
  const auto faults = [&](const char* schema, const char* file) {
    return testing::schema_errors(schemas / schema, unpacked.path() / file);
  };
  EXPECT_EQ(faults("SystemStructureDescription.xsd", "SystemStructure.ssd"), "");
  EXPECT_NE(faults("SystemStructureParameterValues.xsd", "SystemStructure.ssd"), "");
}

TEST_F(FmuScenario, AnInvalidPackageIsAnErrorAndLeavesNoFiles) {
  EXPECT_THAT(error_of([&] { load_scenario(folder_ / "none.ssp"); }), HasSubstr("none.ssp"));
  EXPECT_THAT(error_of([&] { load_scenario(write("text.ssp", "no archive")); }), HasSubstr("text.ssp"));
  fmu::write_archive(folder_ / "empty.ssp", std::vector<fmu::ArchiveFile>{{"readme.txt", std::string("nothing")}});
  EXPECT_THAT(error_of([&] { load_scenario(folder_ / "empty.ssp"); }), HasSubstr("no SystemStructure.ssd"));
  fmu::write_archive(folder_ / "broken.ssp",
                     std::vector<fmu::ArchiveFile>{{"SystemStructure.ssd", std::string("<ssd:System")}});
  EXPECT_THAT(error_of([&] { load_scenario(folder_ / "broken.ssp"); }),
              StartsWith((folder_ / "broken.ssp").string() + "/SystemStructure.ssd:1"));

  // Cut off anywhere, and with any byte changed: an error or a scenario, nothing else.
  const std::string good = content(pack(example()));
  for (std::size_t size = 0; size < good.size(); size += good.size() / 7 + 1) {
    EXPECT_NE(error_of([&] { load_scenario(write("cut.ssp", good.substr(0, size))); }), "") << size;
  }
  for (std::size_t i = 0; i < 40; ++i) {
    std::string bad = good;
    bad[bad.size() - 1 - i * 7] ^= 0x41;
    (void)error_of([&] { load_scenario(write("bad.ssp", bad)); });
  }
}

TEST_F(FmuScenario, AnInvalidStepSizeOfTheFmuIsNotUsed) {
  for (const char* step : {"0", "-0.01", "1e-12", "0.25"}) {
    FmuRunOptions options;
    options.file =
        fmu::testing::make_fmu("rogue2", folder_,
                               {{"<ModelVariables>", "<DefaultExperiment startTime=\"0\" stopTime=\"1\" stepSize=\"" +
                                                         std::string(step) + "\"/><ModelVariables>"}});
    const Duration expected =
        Duration::from_seconds(step == std::string("0.25") ? 0.25 : 0.002);  // otherwise a 500th of the run
    EXPECT_EQ(FmuRun(options).master().scenario().tick, expected) << step;
  }
}

TEST_F(FmuScenario, InputsInterpolateTheFileAndAreConstantBeforeAndAfterIt) {
  // Without external torques the compliant motion is the desired one: after a step q_c is q_d of its beginning.
  FmuRunOptions options;
  options.file = pack_unit("unit:compliance?robot=lwr4", fmu::Version::k2, "compliance.fmu");
  options.input_file = write("in.csv", "time,q_d[1]\n0.1,0.2\n0.3,0.6\n0.3,-0.5\n0.5,-0.1\n");
  options.output_file = folder_ / "out.csv";
  options.output_variables = {"q_c[1]"};
  options.stop = 0.7;
  options.interval = 0.01;
  FmuRun run(options);
  run.initialise();
  while (run.step_tick()) {
  }
  run.finish();
  EXPECT_THAT(content(options.output_file), StartsWith("\"time\",\"q_c[1]\"\n0,"));
  const csv::Table table = csv::load(options.output_file);
  ASSERT_EQ(table.rows(), 71u);
  for (std::size_t n = 1; n < table.rows(); ++n) {
    const double t = 0.01 * static_cast<double>(n - 1);
    const double expected = t < 0.0999 ? 0.2 : t < 0.2999 ? 0.2 + 2 * (t - 0.1) : t < 0.4999 ? -0.5 + 2 * (t - 0.3) : -0.1;
    EXPECT_NEAR(table.column("q_c[1]")[n], expected, 1e-12) << "t = " << table.column("time")[n];
    EXPECT_EQ(table.column("time")[n], static_cast<double>(n) / 100);
  }
}

TEST_F(FmuScenario, InputsAndOutputsMayBeCalledByElementOrWholeInBothVersions) {
  std::vector<std::string> results;
  for (const fmu::Version version : {fmu::Version::k2, fmu::Version::k3}) {
    FmuRunOptions options;
    options.file = pack_unit("unit:compliance?robot=lwr4", version, "compliance.fmu");
    options.output_file = folder_ / "out.csv";
    options.output_variables = {"q_c[1]", "q_c"};
    options.stop = 0.5;
    options.interval = 0.01;
    for (const char* table : {"time,q_d[1]\n0,0\n1,1\n", "time,q_d\n0,0 0 0 0 0 0 0\n1,1 0 0 0 0 0 0\n"}) {
      options.input_file = write("in.csv", table);
      FmuRun run(options);
      run.initialise();
      while (run.step_tick()) {
      }
      run.finish();
      results.push_back(content(options.output_file));
    }
  }
  EXPECT_THAT(results.front(), StartsWith("\"time\",\"q_c[1]\",\"q_c\"\n0,0,0 0 0 0 0 0 0\n"));
  const std::size_t last = results.front().rfind("\n0.5,");
  ASSERT_NE(last, std::string::npos);
  EXPECT_NEAR(std::stod(results.front().substr(last + 5)), 0.49, 1e-12);  // q_d at the beginning of the last step
  EXPECT_THAT(results, ::testing::Each(results.front()));
}

TEST_F(FmuScenario, AnInputFileThatDoesNotFitIsAnErrorThatNamesTheLine) {
  FmuRunOptions options;
  options.file = pack_unit("unit:compliance?robot=lwr4", fmu::Version::k2, "compliance.fmu");
  const auto error = [&](const std::string& csv) {
    options.input_file = write("in.csv", csv);
    return error_of([&] { FmuRun{options}; });
  };
  EXPECT_THAT(error("time,q_x\n0,0\n"), HasSubstr("q_x"));
  EXPECT_THAT(error("time,q_c[1]\n0,0\n"), HasSubstr("is an output, expected an input"));
  EXPECT_THAT(error("time,q_d[1]\n0,0\n1,high\n"), HasSubstr("in.csv:3: column 'q_d[1]': 'high', expected"));
  EXPECT_THAT(error("time,q_d[1]\n1,0\n0.5,0\n"), HasSubstr("in.csv:3: column 'time': time decreases"));
  EXPECT_THAT(error("time,q_d[1]\n"), HasSubstr("no row"));
}

/// A motion from 0 to 1 rad in `seconds`, and a value that the scenario gives another component.
std::string small_scenario(const std::string& seconds, const std::string& values = "") {
  return R"(<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="small"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="small">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=lwr4" type="application/x-cotwin-unit">
        <ssd:ParameterBindings><ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="p"><ssv:Parameters>
          <ssv:Parameter name="waypoint_q[8]"><ssv:Real value="1"/></ssv:Parameter>
          <ssv:Parameter name="waypoint_t[2]"><ssv:Real value=")" +
         seconds + R"("/></ssv:Parameter>)" + values + R"(
        </ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding></ssd:ParameterBindings>
      </ssd:Component>
    </ssd:Elements>
  </ssd:System>
  <ssd:Annotations>
    <ssc:Annotation type="cotwin.master"><cotwin:Master xmlns:cotwin="urn:cotwin:master:1"/></ssc:Annotation>
  </ssd:Annotations>
</ssd:SystemStructureDescription>
)";
}

// What a run refuses before its first tick: units that cannot be initialised.
TEST_F(FmuScenario, CheckFindsWhatRunRefuses) {
  const auto errors_of = [](const fs::path& file) {
    std::vector<std::string> errors;
    for (const auto& finding : check_scenario(file, unit_types(), kFolders)) {
      if (finding.level == fmu::Finding::Level::kError) errors.push_back(finding.text);
    }
    return errors;
  };
  EXPECT_THAT(errors_of(write("good.ssd", small_scenario("2"))), IsEmpty());
  for (const fs::path& file :
       {write("fast.ssd", small_scenario("0.01")),
        write("missing.ssd",
              small_scenario("2", "<ssv:Parameter name=\"file\"><ssv:String value=\"no.csv\"/></ssv:Parameter>")),
        write("word.ssd", small_scenario("2", "<ssv:Parameter name=\"passing\"><ssv:String value=\"by\"/></ssv:Parameter>"))}) {
    std::string refusal;
    try {
      recorded(load_scenario(file));
    } catch (const Error& error) {
      refusal = error.what();
    }
    EXPECT_NE(refusal, "");
    EXPECT_THAT(errors_of(file), ElementsAre(refusal));
  }
}

TEST_F(FmuScenario, CheckFindsEverythingInOneGo) {
  const fs::path file = write("wrong.ssd", R"(<?xml version="1.0"?>
<ssd:SystemStructureDescription version="1.0" name="wrong"
    xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssd:System name="wrong">
    <ssd:Elements>
      <ssd:Component name="motion" source="unit:motion?robot=lwr4" type="application/x-cotwin-unit"/>
      <ssd:Component name="drive" source="unit:drive_train?robot=lwr4" type="application/x-cotwin-unit"/>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startElement="motion" startConnector="q_d" endElement="drive" endConnector="tau_m"/>
      <ssd:Connection startElement="motion" startConnector="nothing" endElement="drive" endConnector="tau_e"/>
    </ssd:Connections>
  </ssd:System>
  <ssd:Annotations>
    <ssc:Annotation type="cotwin.master">
      <cotwin:Master xmlns:cotwin="urn:cotwin:master:1">
        <cotwin:Event time="0" variable="drive.q" value="1"/>
        <cotwin:Recording><cotwin:Record variables="drive.nowhere"/></cotwin:Recording>
      </cotwin:Master>
    </ssc:Annotation>
  </ssd:Annotations>
</ssd:SystemStructureDescription>
)");
  const auto findings = check_scenario(file, unit_types(), kFolders);
  std::vector<std::string> errors;
  for (const auto& finding : findings) {
    if (finding.level == fmu::Finding::Level::kError) errors.push_back(finding.text);
  }
  EXPECT_THAT(errors, ElementsAre(HasSubstr("rad cannot feed N.m"), HasSubstr("motion.nothing"), HasSubstr("drive.q"),
                                  HasSubstr("drive.nowhere")));
  EXPECT_THAT(complaints(kExample), IsEmpty());
  EXPECT_THAT(complaints(pack(example())), IsEmpty());
  EXPECT_EQ(check_scenario(folder_ / "none.ssd", unit_types(), kFolders).size(), 1u);
}

TEST_F(FmuScenario, TheProgramPacksInspectsAndRunsAnFmu) {
  EXPECT_EQ(program("pack unit:motion?robot=lwr4 -o motion.ssp").first, 2);
  ASSERT_EQ(program("pack unit:motion?robot=lwr4 --fmi 3 -o motion.fmu"), std::pair(0, std::string()));
  EXPECT_EQ(program("check motion.fmu").first, 0);
  EXPECT_THAT(program("info motion.fmu").second, HasSubstr("motion"));
  const auto [code, output] = program("run motion.fmu --stop-time 0.05 --output-interval 0.01 --output-variable q_d");
  EXPECT_EQ(code, 0) << output;
  EXPECT_THAT(content(folder_ / "motion_out.csv"), StartsWith("\"time\",\"q_d\"\n0,0 0 0 0 0 0 0\n0.01,"));
  EXPECT_EQ(program("run motion.fmu --out somewhere").first, 2);
  EXPECT_EQ(program("run motion.fmu --start-value nonsense 1").first, 2);
  EXPECT_EQ(program("run " + kExample.string() + " --output-file x.csv").first, 2);
  write("not.fmu", "no archive");
  EXPECT_EQ(program("check not.fmu").first, 2);
  EXPECT_EQ(program("run not.fmu").first, 2);
}

TEST_F(FmuScenario, PacksBothSidesOfAUrRobot) {
  EXPECT_EQ(program("pack unit:io?robot=ur5e&link=rtde_controller --set port=0 -o robot.fmu"), std::pair(0, std::string()));
  EXPECT_EQ(program("pack unit:io?robot=ur5e&link=rtde --set controller=127.0.0.1:9 --set mode=position -o twin.fmu"),
            std::pair(0, std::string()));
  for (const char* name : {"robot", "twin"}) {
    const std::string fmu = std::string(name) + ".fmu";
    EXPECT_THAT(program("check " + fmu).second, HasSubstr(kSanitized ? "0 errors" : "0 errors, 0 warnings"));
    const auto [code, output] = program("run " + fmu + " --stop-time 0.02 --output-interval 0.01 --output-variable q" +
                                        (fmu == "robot.fmu" ? "_command" : ""));
    EXPECT_EQ(code, 0) << output;
  }
}

TEST_F(FmuScenario, PacksAnEtherCatMasterWithTheImagesOfItsSlaves) {
  // Two devices, 8 and 16 inputs, whose images have the same name in different folders.
  for (const std::uint8_t bits : {std::uint8_t{8}, std::uint8_t{16}}) {
    ethercat::Sii sii;
    sii.vendor = 0x1234;
    sii.product = bits;
    sii.general.order = "XY" + std::to_string(bits);
    sii.fmmus = {2};
    sii.sync_managers = {{0x1000, 0, 0x20, 0, 1, ethercat::SyncManagerType::kInputs}};
    ethercat::Pdo in;
    in.index = 0x1a00;
    in.sync_manager = 0;
    in.entries = {{0x6000, 1, "a", 5, bits, 0}};
    sii.tx_pdos = {in};
    const std::vector<std::uint8_t> image = ethercat::write_sii(sii);
    fs::create_directories(folder_ / std::to_string(bits));
    write(std::to_string(bits) + "/device.bin", std::string(image.begin(), image.end()));
  }
  const auto pack_bus = [&](const std::string& more, const std::string& to) {
    return program("pack unit:io?link=ethercat" + more +
                   "&slaves=EK1100,a:8/device.bin,b:" + (folder_ / "16/device.bin").string() + ",axis:EL5101 -o " + to);
  };
  ASSERT_EQ(pack_bus("", "bus.fmu"), std::pair(0, std::string()));
  // Packing does not operate a bus: the interface is at the host's machine.
  ASSERT_EQ(pack_bus("&interface=none0", "there.fmu"), std::pair(0, std::string()));
  ASSERT_EQ(pack_bus("_bus&interface=none0", "field.fmu"), std::pair(0, std::string()));
  fs::remove_all(folder_ / "8");
  fs::remove_all(folder_ / "16");
  EXPECT_EQ(program("check bus.fmu").first, 0);
  const auto [code, output] =
      program("run bus.fmu --stop-time 0.2 --output-interval 0.001 --output-variable operational --output-variable answering");
  EXPECT_EQ(code, 0) << output;
  EXPECT_THAT(content(folder_ / "bus_out.csv"), HasSubstr("0.2,4,1"));
  const auto [failed, message] = program("run there.fmu --stop-time 0.2 --output-interval 0.001");
  EXPECT_NE(failed, 0);
  EXPECT_THAT(message, HasSubstr("interface 'none0': there is no such interface"));
}

TEST_F(FmuScenario, PacksNoUnitThatNoHostCouldInitialise) {
  for (const char* set : {"", "--set file=elsewhere.csv"}) {
    const auto [code, output] = program("pack unit:io -o io.fmu " + std::string(set));
    EXPECT_EQ(code, 2);
    EXPECT_THAT(output, AllOf(HasSubstr("unit:io: cannot be initialised as an FMU"), HasSubstr("--set NAME=VALUE")));
    EXPECT_FALSE(fs::exists(folder_ / "io.fmu"));
  }
  EXPECT_EQ(program("pack unit:io?link=sensors -o sensors.fmu").first, 0);
  std::string log = "t,q1,tau1\n";
  for (int i = 0; i < 100; ++i) log += std::to_string(i * 0.01) + ",0.1,1\n";
  write("log.csv", log);
  EXPECT_EQ(program("pack unit:io --set file=log.csv -o io.fmu"), std::pair(0, std::string()));
  fs::remove(folder_ / "log.csv");  // the FMU contains it
  const auto [code, output] = program("run io.fmu --stop-time 0.05 --output-interval 0.01 --output-variable q");
  EXPECT_EQ(code, 0) << output;
}

// rogue3 makes no step beyond 11 ms (mode 5), rogue2 none beyond `longest_step`: a tick of 100 ms is divided into 16 parts.
// Both return ∫u.
TEST_F(FmuScenario, HalvesATickThatAForeignFmuDiscardsAndNamesIt) {
  namespace foreign = fmu::testing;
  Scenario scenario;
  scenario.name = "two of others";
  scenario.folder = folder_;
  scenario.tick = Duration{100'000'000};
  scenario.stop = Time::from_seconds(1);
  const auto add =
      [&](const char* name, const std::string& archive,
          const std::vector<std::pair<std::string, std::variant<double, std::int64_t, bool, std::string>>>& values) {
        ComponentSpec spec;
        spec.name = name;
        spec.source = foreign::make_fmu(archive, folder_).filename().string() + "?rollback=true";  // rogue3 keeps its states
        for (const auto& [variable, value] : values) spec.start_values.push_back({variable, value, "", "test"});
        scenario.components.push_back(spec);
      };
  add("three", "rogue3", {{"u", 1.0}, {"mode", std::int64_t{5}}});
  add("two", "rogue2", {{"u", 1.0}, {"longest_step", 0.05}});
  MasterOptions options;
  options.types = unit_types();
  Master master(scenario, std::move(options));
  master.initialise();
  while (master.step_tick()) {
  }
  const auto value = [&](const char* name) { return find_signal(master.members(), name, "").reals()[0]; };
  EXPECT_NEAR(value("three.y"), 1, 1e-12);
  EXPECT_NEAR(value("two.y in mm"), 1e-3, 1e-15);
  const Summary s = master.summary();
  EXPECT_EQ(s.discarded, 10);
  EXPECT_THAT(s.discarded_by, ElementsAre(::testing::Pair("three", 10)));  // steps first; with 1/16 both succeed
  EXPECT_EQ(s.most_parts, 16);
  EXPECT_THAT(s.notes, ::testing::Contains(HasSubstr("three: ")));
}

}  // namespace
}  // namespace cotwin::master::fmu_scenario_test
