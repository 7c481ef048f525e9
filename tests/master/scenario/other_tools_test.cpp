// What other tools require of a package (docs/interoperability.md), each on the written files. "tried": the tool ran the package;
// "reported": neither tried nor read here.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>
#include <optional>
#include <set>

#include "fmu/archive/archive.h"
#include "fmu/description/model_description.h"
#include "fmu/description/read.h"
#include "master/scenario/scenario.h"
#include "master/twin/pack_twin.h"
#include "master/twin/package.h"
#include "models/foundation/formats/xml.h"
#include "tests/support/places.h"

namespace cotwin::master::other_tools_test {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::Not;
using ::testing::UnorderedElementsAre;

const fs::path kExamples = fs::path(places::source()) / "examples";

PackageOptions options_for(const Scenario& scenario, fmu::Version version) {
  PackageOptions options;
  options.types = unit_types();
  options.folders = {scenario.folder, fs::path(places::source()) / "models"};
  options.version = version;
  return options;
}

/// The elements of this name below `element`, at any depth.
std::vector<const xml::Element*> all(const xml::Element& element, const std::string& name) {
  std::vector<const xml::Element*> found;
  for (const xml::Element& c : element.children) {
    if (c.name == name) found.push_back(&c);
    for (const xml::Element* below : all(c, name)) found.push_back(below);
  }
  return found;
}

std::vector<std::string> names_of(const std::vector<xml::Element>& elements) {
  std::vector<std::string> names;
  for (const xml::Element& e : elements) names.push_back(e.name);
  return names;
}

/// The package of an example.
struct Packed {
  explicit Packed(const char* example) {
    const Scenario scenario = load_scenario(kExamples / example);
    pack_scenario(scenario, options_for(scenario, fmu::Version::k2), folder.path() / "x.ssp");
    unpacked.emplace(fmu::unpack_archive(folder.path() / "x.ssp"));
    text = fmu::read_archive_file(folder.path() / "x.ssp", "SystemStructure.ssd");
    ssd = xml::parse(text, "ssd");
  }
  fmu::TemporaryFolder folder;
  std::optional<fmu::TemporaryFolder> unpacked;
  std::string text;
  xml::Element ssd;
};

class Package : public ::testing::TestWithParam<const char*> {
 protected:
  static const Packed& packed() {
    static std::map<std::string, Packed> made;  // each once: packing takes longer than a test
    return made.try_emplace(GetParam(), GetParam()).first->second;
  }
  const std::string& text() const { return packed().text; }
  const xml::Element& ssd() const { return packed().ssd; }
  const xml::Element& system() const { return *all(ssd(), "System").front(); }
  static const xml::Element& annotation(const xml::Element& of, std::size_t index) {
    return of.children.back().children.at(index);  // Annotations are the last child
  }
  static fmu::ModelDescription description(const std::string& component) {
    const fs::path file = packed().unpacked->path() / "resources" / (component + ".fmu");
    return fmu::parse_model_description(fmu::read_archive_file(file, "modelDescription.xml"), component);
  }
};

// OMSimulator (6287cf42, July 2026): tried. It refuses annotations at the root and systems without its own annotation, and reads only the first
// of a system's annotations.
TEST_P(Package, HasTheAnnotationOfOmSimulatorFirstInTheSystem) {
  EXPECT_THAT(names_of(ssd().children), Not(::testing::Contains("Annotations")));
  const xml::Element& first = annotation(system(), 0);
  EXPECT_EQ(xml::text(first, "type"), "org.openmodelica");
  EXPECT_THAT(text(), ::testing::HasSubstr("<oms:FixedStepMaster description=\"oms-ma\" stepSize=\"0.001\""));
  EXPECT_EQ(xml::text(annotation(system(), 1), "type"), "cotwin.master");
}

// libcosim (52cc825, August 2025): tried. It needs its algorithm in the DefaultExperiment; prefixes are compared as text.
TEST_P(Package, HasTheStepOfLibcosimInTheDefaultExperiment) {
  const xml::Element& experiment = *all(ssd(), "DefaultExperiment").front();
  const xml::Element& only = annotation(experiment, 0);
  EXPECT_EQ(xml::text(only, "type"), "com.opensimulationplatform");
  EXPECT_EQ(xml::real(*all(only, "FixedStepAlgorithm").front(), "baseStepSize"), 0.001);
  EXPECT_THAT(text(), ::testing::HasSubstr("<osp:FixedStepAlgorithm "));
  EXPECT_LT(text().find("xmlns:osp="), text().find('\n', text().find("<ssd:SystemStructureDescription")))
      << "on the root element";
}

// openMCx: reported, it ignores files with values and stops at parameters without a value. FMPy (e8b71b7, July 2026): tried, it connects
// inputs without a connection to a wrong source, and stops at connectors of type String.
TEST_P(Package, HasValuesInTheDescriptionAndConnectorsThatAreUsed) {
  for (const auto& entry : fs::recursive_directory_iterator(packed().unpacked->path()))
    EXPECT_NE(entry.path().extension(), ".ssv");
  std::set<std::string> connected;
  for (const xml::Element* c : all(ssd(), "Connection")) {
    connected.insert(xml::text(*c, "startElement") + "." + xml::text(*c, "startConnector"));
    connected.insert(xml::text(*c, "endElement") + "." + xml::text(*c, "endConnector"));
  }
  for (const xml::Element* component : all(system(), "Component")) {
    std::set<std::string> valued;
    for (const xml::Element* p : all(*component, "Parameter")) valued.insert(xml::text(*p, "name"));
    for (const xml::Element* c : all(*component, "Connector")) {
      const std::string& name = xml::text(*c, "name");
      const std::string& kind = xml::text(*c, "kind");
      const bool is_connected = connected.erase(xml::text(*component, "name") + "." + name) != 0;
      EXPECT_TRUE(is_connected || (kind == "output" && c->children[0].name != "String") || valued.contains(name))
          << kind << ' ' << name;
    }
  }
  EXPECT_TRUE(connected.empty()) << *connected.begin() << " has no connector";
}

// Also those that the master adds for loads: the examples' own connections ask for no such thing.
TEST_P(Package, SuppressesConversionsOnlyWithALinearTransformation) {
  for (const xml::Element* c : all(ssd(), "Connection"))
    EXPECT_EQ(xml::find(*c, "suppressUnitConversion") != nullptr, !c->children.empty());
}

INSTANTIATE_TEST_SUITE_P(Examples, Package,
                         ::testing::Values("02_free_motion_lwr4/twin.ssd", "04_peg_in_hole/twin.ssd",
                                           "10_cooperation/clamping.ssd"));

/// By name; the elements of a vector of FMI 2 are joined.
std::vector<double> starts(const fmu::ModelDescription& d, const std::string& name) {
  std::vector<double> values;
  for (const fmu::ModelVariable& v : d.variables) {
    if (v.name != name && v.name.rfind(name + "[", 0) != 0) continue;
    const auto& start = std::get<std::vector<double>>(v.start);
    values.insert(values.end(), start.begin(), start.end());
  }
  return values;
}

/// The inputs that the output (without its elements) is declared to depend on in the initialisation.
std::set<std::string> initial_inputs(const fmu::ModelDescription& d, const std::string& output) {
  std::set<std::string> inputs;
  for (const fmu::Unknown& unknown : d.structure.initial_unknowns) {
    const auto stem = [&](std::size_t i) { return d.variables[i].name.substr(0, d.variables[i].name.find('[')); };
    if (stem(unknown.variable) != output) continue;
    if (!unknown.dependencies) return {"all"};
    for (const std::size_t i : *unknown.dependencies) {
      if (d.variables[i].causality == fmu::Causality::kInput) inputs.insert(stem(i));
    }
  }
  return inputs;
}

using Example02 = Package;

// A host that exchanges nothing before the first step (FMPy's runner would, if it did not set all inputs to 0) lets the controller begin
// at the robot's pose and the drive with the torque that holds it.
TEST_P(Example02, ConnectedInputsStartAtTheValuesOfARun) {
  const std::vector<double> q0 = {0, 0.3, 0, -1.2, 0, 0.9, 0};
  EXPECT_EQ(starts(description("compliance"), "q"), q0);
  EXPECT_EQ(starts(description("compliance"), "q_d"), q0);
  const std::vector<double> tau_m = starts(description("drive"), "tau_m");
  ASSERT_EQ(tau_m.size(), 7U);
  EXPECT_NEAR(tau_m[1], -23.2374, 1e-4) << "the gravity torque of the second joint";
}

// OMSimulator: tried; it solved loops of 35 unknowns in the initialisation of this package where there are none.
TEST_P(Example02, TheDriveStartsFromItsLoadAlone) {
  const fmu::ModelDescription drive = description("drive");
  EXPECT_EQ(initial_inputs(drive, "q"), std::set<std::string>{});
  EXPECT_EQ(initial_inputs(drive, "dtheta"), std::set<std::string>{});
  EXPECT_THAT(initial_inputs(drive, "theta"), ElementsAre("tau_e"));
  EXPECT_THAT(initial_inputs(drive, "ddq"), ElementsAre("all"));
  EXPECT_THAT(initial_inputs(description("compliance"), "tau_m"), ElementsAre("all"));
}

INSTANTIATE_TEST_SUITE_P(Examples, Example02, ::testing::Values("02_free_motion_lwr4/twin.ssd"));

// libcosim (52cc825): tried. OMSimulator (6287cf42): tried, it refuses a component with an annotation.
TEST(Period, IsKeptForLibcosimAndWarnedAbout) {
  const fmu::TemporaryFolder folder;
  Scenario scenario = load_scenario(kExamples / "02_free_motion_lwr4/twin.ssd");
  scenario.components[1].period = 4;
  const auto warnings = pack_scenario(scenario, options_for(scenario, fmu::Version::k2), folder.path() / "x.ssp");
  EXPECT_THAT(warnings,
              ElementsAre(::testing::HasSubstr("compliance: of other tools only libcosim keeps its period of 4 ticks")));
  const xml::Element ssd = xml::parse(fmu::read_archive_file(folder.path() / "x.ssp", "SystemStructure.ssd"), "ssd");
  const auto hints = all(ssd, "StepSizeHint");
  ASSERT_EQ(hints.size(), 1U);
  EXPECT_EQ(xml::real(*hints[0], "value"), 0.004);
}

// libcosim (52cc825): tried. It keeps unpacked FMUs by their token, in ~/.cache/cosim, also those of an older Cotwin.
TEST(Token, IsAnotherOneForAnotherLibrary) {
  const fmu::TemporaryFolder folder;
  const auto token = [&](const char* ending) {
    const fs::path platform = folder.path() / fmu::own_platform();
    fs::create_directories(platform);
    fs::copy_file(fmu::library_folder() / fmu::own_platform() / "motion.so", platform / "motion.so",
                  fs::copy_options::overwrite_existing);
    std::ofstream(platform / "motion.so", std::ios::app) << ending;
    fmu::PackRequest request;
    request.source = "unit:motion";
    request.types = unit_types();
    request.libraries = folder.path();
    fmu::pack_unit(request, folder.path() / "x.fmu");
    return fmu::parse_model_description(fmu::read_archive_file(folder.path() / "x.fmu", "modelDescription.xml"), "x").token;
  };
  const std::string first = token("");
  EXPECT_EQ(token(""), first);
  EXPECT_NE(token("x"), first);
}

class OneFmu : public ::testing::TestWithParam<fmu::Version> {};

TEST_P(OneFmu, HasItsOwnNameAndTheInputsThatItsOutputsStartFrom) {
  const fmu::TemporaryFolder folder;
  Scenario scenario = load_scenario(kExamples / "02_free_motion_lwr4/twin.ssd");
  std::erase_if(scenario.connections, [](const ConnectionSpec& c) { return c.to.variable == "q_d"; });
  scenario.name = "Zelle 7/b";
  pack_twin(scenario, options_for(scenario, GetParam()), folder.path() / "x.fmu");
  const auto d = fmu::parse_model_description(fmu::read_archive_file(folder.path() / "x.fmu", "modelDescription.xml"), "x");
  EXPECT_EQ(d.co_simulation->model_identifier, "cotwin_Zelle_7_b") << "no other twin on the machine has a library of this name";
  EXPECT_EQ(initial_inputs(d, "drive.q"), std::set<std::string>{});
  EXPECT_THAT(initial_inputs(d, "drive.theta"), ElementsAre("drive.tau_e"));
  EXPECT_THAT(initial_inputs(d, "compliance.tau_m"), UnorderedElementsAre("compliance.q_d", "compliance.tau_e", "drive.tau_e"));
}

INSTANTIATE_TEST_SUITE_P(Versions, OneFmu, ::testing::Values(fmu::Version::k2, fmu::Version::k3));

}  // namespace
}  // namespace cotwin::master::other_tools_test
