#include "master/scenario/scenario.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <fstream>
#include <map>

#include "components/unit/si.h"
#include "fmu/archive/archive.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"
#include "tests/support/error_of.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::master::scenario_test {
namespace {

namespace fs = std::filesystem;
using cotwin::testing::TemporaryFolder;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

const fs::path kVehicle = fs::path(places::source()) / "tests/master/data/vehicle/SystemStructure.ssd";

constexpr const char* kHead =
    "<d:SystemStructureDescription version='1.0' name='n' xmlns:d='http://ssp-standard.org/SSP1/SystemStructureDescription' "
    "xmlns:c='http://ssp-standard.org/SSP1/SystemStructureCommon' "
    "xmlns:v='http://ssp-standard.org/SSP1/SystemStructureParameterValues' "
    "xmlns:m='http://ssp-standard.org/SSP1/SystemStructureParameterMapping'>";

/// A document: line 1 is its root, `system` starts on line 2 inside the root system, `after` follows the system.
std::string ssd(const std::string& system, const std::string& after = "") {
  return std::string(kHead) + "<d:System name='root'>\n" + system + "\n</d:System>" + after + "</d:SystemStructureDescription>";
}

/// The same with components a and b and the Cotwin annotation: line 2 is the cotwin:Master tag, its content starts on line 3.
std::string annotated(const std::string& attributes, const std::string& content) {
  return ssd(
      "<d:Elements><d:Component name='a' source='unit:a'/><d:Component name='b' source='unit:b'/></d:Elements>"
      "<d:Annotations><c:Annotation type='cotwin.master'><t:Master xmlns:t='urn:cotwin:master:1' " +
      attributes + ">\n" + content + "</t:Master></c:Annotation></d:Annotations>");
}

std::string elements(const std::string& list) { return "<d:Elements>" + list + "</d:Elements>"; }

std::string component(const std::string& name, const std::string& connectors = "", const std::string& bindings = "") {
  return "<d:Component name='" + name + "' source='unit:x'>" +
         (connectors.empty() ? "" : "<d:Connectors>" + connectors + "</d:Connectors>") +
         (bindings.empty() ? "" : "<d:ParameterBindings>" + bindings + "</d:ParameterBindings>") + "</d:Component>";
}

std::string connector(const std::string& name, const std::string& kind, const std::string& unit = "") {
  return "<d:Connector name='" + name + "' kind='" + kind + "'>" + (unit.empty() ? "" : "<c:Real unit='" + unit + "'/>") +
         "</d:Connector>";
}

std::string inline_set(const std::string& parameters) {
  return "<d:ParameterBinding><d:ParameterValues><v:ParameterSet version='1.0' name='s'><v:Parameters>" + parameters +
         "</v:Parameters></v:ParameterSet></d:ParameterValues></d:ParameterBinding>";
}

Scenario parse(const std::string& xml) { return parse_scenario(xml, "f.ssd", fs::temp_directory_path()); }

std::string value_text(const ParameterValue& v) {
  if (const double* x = std::get_if<double>(&v.value)) return text::to_text(*x);
  if (const std::int64_t* i = std::get_if<std::int64_t>(&v.value)) return "int " + std::to_string(*i);
  if (const bool* b = std::get_if<bool>(&v.value)) return *b ? "true" : "false";
  return "'" + std::get<std::string>(v.value) + "'";
}

/// "R = 1 Ohm", in order of application.
std::vector<std::string> values_of(const Scenario& s, const std::string& component) {
  std::vector<std::string> list;
  for (const ComponentSpec& c : s.components) {
    if (c.name != component) continue;
    for (const ParameterValue& v : c.start_values)
      list.push_back(v.name + " = " + value_text(v) + (v.unit.empty() ? "" : " " + v.unit));
  }
  return list;
}

std::vector<std::string> names_of(const Scenario& s) {
  std::vector<std::string> names;
  for (const ComponentSpec& c : s.components) names.push_back(c.name);
  return names;
}

/// "a.x [mV] -> b.u [V]: 2, 0.5".
std::vector<std::string> connections_of(const Scenario& s) {
  std::vector<std::string> list;
  const auto port = [](const Port& p) { return p.component + "." + p.variable + (p.unit.empty() ? "" : " [" + p.unit + "]"); };
  for (const ConnectionSpec& c : s.connections) {
    list.push_back(port(c.from) + " -> " + port(c.to) + ": " + text::to_text(c.factor) + ", " + text::to_text(c.offset) +
                   (c.suppress_unit_conversion ? ", numbers" : ""));
  }
  return list;
}

TEST(ForeignSystemStructure, IsFlattenedIntoComponentsWithTheirFiles) {
  const Scenario s = load_scenario(kVehicle);
  EXPECT_EQ(s.name, "vehicle");
  EXPECT_EQ(s.file, kVehicle);
  EXPECT_THAT(names_of(s), ElementsAre("controller", "drive.motor", "drive.body.chassis", "drive.body.left.tyre",
                                       "drive.body.right.tyre", "drive.body.spare.tyre", "display", "cabin.radio"));
  EXPECT_EQ(s.components[0].source, "resources/My Controller.fmu");    // %20
  EXPECT_EQ(s.components[2].source, "sub/resources/Chassis.fmu");      // relative to the outer file, like all references
  EXPECT_EQ(s.components[0].type, "application/x-fmu-sharedlibrary");  // the default of the schema
  EXPECT_EQ(s.components[0].implementation, fmu::InterfaceChoice::kCoSimulation);
  EXPECT_EQ(s.components[1].implementation, fmu::InterfaceChoice::kAny);
  ASSERT_EQ(s.components[0].connectors.size(), 4U);
  EXPECT_EQ(s.components[0].connectors[3].type, "Enumeration");
  EXPECT_EQ(s.components[0].connectors[2].unit, "mV");
  EXPECT_EQ(s.components[0].connectors[2].kind, ConnectorKind::kOutput);
  EXPECT_EQ(s.components[0].place, kVehicle.string() + ":42");
}

TEST(ForeignSystemStructure, RunsWithDefaults) {
  const Scenario s = load_scenario(kVehicle);
  EXPECT_EQ(s.start, Time{500'000'000});
  EXPECT_EQ(s.stop, Time{2'500'000'000});
  EXPECT_EQ(s.tick, Duration{1'000'000});
  EXPECT_EQ(s.clock.kind, ClockKind::kFree);
  EXPECT_EQ(s.threads, 0);
  EXPECT_EQ(s.tolerance, 0);
  EXPECT_TRUE(s.ignore_unknown_parameters);
  EXPECT_THAT(s.recording, IsEmpty());
  for (const ComponentSpec& c : s.components) {
    EXPECT_EQ(c.stage, 0);
    EXPECT_EQ(c.period, 1);
    EXPECT_TRUE(c.threads);
  }
  const Scenario bare = parse(ssd(""));
  EXPECT_EQ(bare.start, Time{0});
  EXPECT_EQ(bare.stop, Time{1'000'000'000});
}

// The names of several years: libcosim reads the first.
TEST(ForeignSystemStructure, HasTheStepOfTheOpenSimulationPlatform) {
  const auto with = [](const std::string& type, const std::string& algorithm, const std::string& ours = "") {
    return ssd("", "<d:DefaultExperiment><d:Annotations><c:Annotation type='" + type + "'><o:Algorithm xmlns:o='urn:o'>" +
                       algorithm + "</o:Algorithm></c:Annotation>" + ours + "</d:Annotations></d:DefaultExperiment>");
  };
  const std::string type = "com.opensimulationplatform", step = "<o:FixedStepAlgorithm baseStepSize='1e-4'/>";
  EXPECT_EQ(parse(with(type, step)).tick, Duration{100'000});
  EXPECT_EQ(parse(with(type, "<o:FixedStepAlgorithm stepSize='0.002'/>")).tick, Duration{2'000'000});
  EXPECT_EQ(parse(with("org.open-simulation-platform", "<o:FixedStepMaster stepSize='0.01'/>")).tick, Duration{10'000'000});
  EXPECT_EQ(parse(with("another.tool", step)).tick, Duration{1'000'000});
  const auto ours = [](const std::string& tick) {
    return "<c:Annotation type='cotwin.master'><t:Master xmlns:t='urn:cotwin:master:1'" + tick + "/></c:Annotation>";
  };
  EXPECT_EQ(parse(with(type, step, ours(" tick='0.005'"))).tick, Duration{5'000'000});
  EXPECT_EQ(parse(with(type, step, ours(""))).tick, Duration{100'000});
  EXPECT_THAT([&] { parse(with(type, "<o:FixedStepAlgorithm baseStepSize='0'/>")); },
              ThrowsMessage<Error>(HasSubstr("attribute 'baseStepSize' of 'FixedStepAlgorithm': '0', expected 1e-09 s")));
}

TEST(ForeignSystemStructure, HasComposedConnections) {
  EXPECT_THAT(connections_of(load_scenario(kVehicle)),
              ElementsAre(
                  // through the connector of a referenced file and of an embedded system; right and spare are not connected
                  "drive.motor.w [rad/s] -> drive.body.left.tyre.w [rad/s]: 1, 0",
                  "drive.motor.w [rad/s] -> drive.body.chassis.w [rad/s]: 1, 0",
                  // mV to V, then 2·V + 0.5 V within the drive
                  "controller.u [mV] -> drive.motor.u [V]: 2, 0.5",
                  // through a signal dictionary that one reference uses in V and another in kV
                  "controller.u [mV] -> cabin.radio.supply [V]: 1, 0",
                  // written in the other direction inside the drive; +10 1/min outside
                  "drive.motor.w [rad/s] -> display.n [rev/min]: 1, 10", "drive.motor.T [degC] -> display.T [degF]: 1, 0",
                  // °C becomes K at the border of the drive, and the number in K is halved: 0.5·(x + 273.15)
                  "drive.motor.T [degC] -> display.T_raw [degF]: 0.5, 136.575, numbers",
                  // the display has no unit: values arrive in mV
                  "controller.u [mV] -> display.u [mV]: 1, 0"));
}

TEST(ForeignSystemStructure, AppliesOuterBindingsLast) {
  const Scenario s = load_scenario(kVehicle);
  // Inline at the motor; the drive's file with prefix; the root's mapping (2 as a bare number, and 2·2 poles); the root's
  // what-if; and the drive's connector "ratio", which feeds −ratio to the motor.
  EXPECT_THAT(values_of(s, "drive.motor"), ElementsAre("R = 1 Ohm", "poles = int 4", "R = 0.25 Ohm", "L = 3 mH", "R = 2 Ohm",
                                                       "poles = int 4", "R = 500 mOhm", "i = -9"));
  EXPECT_THAT(values_of(s, "controller"), ElementsAre("comfort = false", "mode = 'on'", "gear = int -1", "speed_ref = 10 m/s"));
  EXPECT_EQ(s.components[1].start_values[2].place, (kVehicle.parent_path() / "resources/motor.ssv").string() + ":4");
}

TEST(ForeignSystemStructure, KeepsEveryFilesUnitsOfMeasureApart) {
  const Scenario s = load_scenario(kVehicle);
  // In body.ssd t is 1016.0469088 kg, in the outer file 1000 kg: 1500 kg + 0.08 t of the inner file.
  const std::string inner = "t (" + (kVehicle.parent_path() / "sub/body.ssd").string() + ")";
  const std::vector<ParameterValue>& values = s.components[2].start_values;
  ASSERT_EQ(values.size(),
            5U);  // drag, area, the outer drag, m through the mapping with offset, m through the connector "mass"
  EXPECT_EQ(values[3].unit, inner);
  EXPECT_DOUBLE_EQ(std::get<double>(values[3].value), 1500 / 1016.0469088 + 0.08);
  EXPECT_EQ(values_of(s, "drive.body.chassis")[2], "drag = 0.4");
  EXPECT_EQ(values_of(s, "drive.body.chassis")[4], "m = 1500 kg");
  double outer_t = 0, inner_t = 0;
  for (const UnitDefinition& d : s.units) {
    if (d.name == "t") outer_t = d.factor;
    if (d.name == inner) inner_t = d.factor;
  }
  EXPECT_EQ(outer_t, 1000);
  EXPECT_EQ(inner_t, 1016.0469088);
}

TEST(ForeignSystemStructure, WarnsOfUnknownParameters) {
  // SSP: a parameter value whose name matches nothing is ignored.
  EXPECT_THAT(load_scenario(kVehicle).warnings,
              ElementsAre(HasSubstr("SystemStructure.ssd:35: 'nobody.cares' is not a parameter of 'Root'")));
}

TEST(Scenarios, OfThisRepositoryFollowTheStandard) {
  using cotwin::testing::schema_faults;
  using cotwin::testing::Standard;
  int files = 0;
  for (const char* folder : {"examples", "models", "tests/master/data"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(places::source()) / folder)) {
      const std::string ending = entry.path().extension();
      if (ending != ".ssd" && ending != ".ssv") continue;
      std::ifstream in(entry.path());
      const std::string text((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
      EXPECT_THAT(schema_faults(text, ending == ".ssd" ? Standard::kSsd : Standard::kSsv), IsEmpty()) << entry.path();
      ++files;
    }
  }
  EXPECT_GE(files, 15);
}

TEST(ForeignSystemStructure, OfThisTestIsValidSsp) {
  const fs::path schemas = fs::path(places::public_data("schemas/ssp1"));
  if (!fs::exists(schemas)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  const std::map<std::string, std::string> schema_of = {{".ssd", "SystemStructureDescription.xsd"},
                                                        {".ssv", "SystemStructureParameterValues.xsd"},
                                                        {".ssm", "SystemStructureParameterMapping.xsd"},
                                                        {".ssb", "SystemStructureSignalDictionary.xsd"}};
  int files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(kVehicle.parent_path())) {
    const auto schema = schema_of.find(entry.path().extension().string());
    if (schema == schema_of.end()) continue;
    EXPECT_EQ(cotwin::testing::schema_errors(schemas / schema->second, entry.path()), "");
    ++files;
  }
  EXPECT_EQ(files, 7);
}

TEST(Documentation, ShowsAScenarioThatIsReadAndValid) {
  std::ifstream in(fs::path(places::source()) / "docs/scenario.md");
  const std::string page((std::istreambuf_iterator<char>(in)), std::istreambuf_iterator<char>());
  const std::size_t begin = page.find("<?xml"), end = page.find("```", begin);
  ASSERT_NE(end, std::string::npos);
  const TemporaryFolder folder("scenario");
  const fs::path file = folder.write("twin.ssd", page.substr(begin, end - begin));
  folder.write(
      "drive.ssv",
      "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0' name='d'><Parameters>"
      "<Parameter name='K'><Real value='10000' unit='N.m/rad'/></Parameter></Parameters></ParameterSet>");
  const Scenario s = load_scenario(file);
  EXPECT_THAT(names_of(s), ElementsAre("motion", "drive", "link"));
  EXPECT_EQ(s.components[0].source, "unit:motion?kind=waypoints");
  EXPECT_THAT(values_of(s, "drive"), ElementsAre("K = 10000 N.m/rad", "K[2] = 12 kN.m/rad", "d = '5 5 4 4 3 2 2'"));
  EXPECT_EQ(s.tick, Duration{1'000'000});
  EXPECT_EQ(s.settings.at("robot"), "lwr4");
  EXPECT_EQ(s.components[1].stage, 1);
  ASSERT_EQ(s.events.size(), 1U);
  EXPECT_EQ(s.events[0].ramp, Duration{10'000'000});
  ASSERT_EQ(s.recording.size(), 3U);
  EXPECT_EQ(s.recording[2].variables, "motion.*");
  EXPECT_EQ(s.decimation, 5);
  ASSERT_EQ(s.comparisons.size(), 1U);
  ASSERT_EQ(s.reports.size(), 1U);
  ASSERT_EQ(s.bonds.size(), 1U);
  EXPECT_FALSE(s.ignore_unknown_parameters);
  EXPECT_THAT(s.warnings, IsEmpty());

  EXPECT_THAT(cotwin::testing::schema_faults(page.substr(begin, end - begin), cotwin::testing::Standard::kSsd), IsEmpty());
  const fs::path schema = fs::path(places::public_data("schemas/ssp1/SystemStructureDescription.xsd"));
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  EXPECT_EQ(cotwin::testing::schema_errors(schema, file), "");
}

TEST(Annotation, ReadsAClockCompletely) {
  const ClockSpec c = parse(annotated("",
                                      "<t:Clock kind='locked' component='b' overrun='skip' late='50 us' silence='wait' "
                                      "timeout='20 ms' cycle='500 us' shift='-0.1 ms' bandwidth='2.5' within='1 us' "
                                      "priority='80' cpu='3, 1'/>"))
                          .clock;
  EXPECT_EQ(c.kind, ClockKind::kLocked);
  EXPECT_EQ(c.component, "b");
  EXPECT_EQ(c.overrun, OverrunPolicy::kSkip);
  EXPECT_EQ(c.late, Duration{50'000});
  EXPECT_EQ(c.silence, SilencePolicy::kWait);
  EXPECT_EQ(c.timeout, Duration{20'000'000});
  EXPECT_EQ(c.cycle, Duration{500'000});
  EXPECT_EQ(c.shift, Duration{-100'000});
  EXPECT_EQ(c.bandwidth, 2.5);
  EXPECT_EQ(c.within, Duration{1'000});
  EXPECT_EQ(c.priority, 80);
  EXPECT_EQ(c.cpus, (std::vector<int>{3, 1}));
  EXPECT_EQ(c.place, "f.ssd:3");
  EXPECT_EQ(parse(annotated("clock='arrivals'", "")).clock.kind, ClockKind::kArrivals);
}

TEST(ChooseClock, KeepsTheSettingsThatTheNewKindHas) {
  ClockSpec c;
  c.kind = ClockKind::kLocked;
  c.component = "io";
  c.overrun = OverrunPolicy::kStop;
  c.silence = SilencePolicy::kStop;
  c.shift = Duration{1};
  choose_clock(c, "arrivals:bus.io");
  EXPECT_EQ(c.kind, ClockKind::kArrivals);
  EXPECT_EQ(c.component, "bus.io");
  EXPECT_EQ(c.overrun, OverrunPolicy::kStop);
  EXPECT_EQ(c.silence, SilencePolicy::kStop);
  EXPECT_EQ(c.shift, Duration{0});
  choose_clock(c, "real-time");
  EXPECT_EQ(c.kind, ClockKind::kWall);
  EXPECT_EQ(c.overrun, OverrunPolicy::kStop);
  EXPECT_EQ(c.silence, SilencePolicy::kWall);
  EXPECT_EQ(c.component, "");
  choose_clock(c, "free");
  EXPECT_EQ(c.overrun, OverrunPolicy::kCatchUp);
  EXPECT_EQ(cotwin::testing::error_of([&] { choose_clock(c, "wall:io"); }),
            "--clock wall:io: a component, expected one only with 'arrivals' or 'locked'");
  EXPECT_EQ(cotwin::testing::error_of([&] { choose_clock(c, "bus"); }),
            "--clock bus: 'bus', expected one of free, wall, arrivals, locked, real-time");
}

TEST(Annotation, IsReadCompletely) {
  const Scenario s = parse(annotated(
      "tick='250 us' stop='2 s' clock='real-time' threads='4' tolerance='1e-4' unknownParameters='ignore'",
      "<t:Setting name='robot' value='lwr4'/><t:Setting name='joints' value='7'/>"
      "<t:Component name='b' stage='3' period='10' threads='false' beside='true'/>"
      "<t:Event time='0.5' variable='a.x[2]' value='1 2' ramp='0.25'/><t:Event time='0.1 s' variable='b.y' value='true'/>"
      "<t:Event time='0.5' variable='a.z' value='second of its time'/>"
      "<t:Recording decimation='20'><t:Record variables='a.*, b.y\n*.tau_J'/><t:Record variables='a.z'/></t:Recording>"
      "<t:Comparison name='torque' a='a.tau' b='b.tau' segments='10' from='0.1' to='1 s'/>"
      "<t:Comparison name='position' a='a.q' b='b.q'/>"
      "<t:Report a='a.q'/><t:Report name='work' kind='energy' a='a.tau' b='a.dq'/>"
      "<t:Bond name='joint' effortA='a.tau' flowA='a.dq' effortB='b.tau' flowB='b.dq' tolerance='0.5'/>"));
  EXPECT_EQ(s.tick, Duration{250'000});
  EXPECT_EQ(s.stop, Time{2'000'000'000});
  EXPECT_EQ(s.clock.kind, ClockKind::kWall);
  EXPECT_EQ(s.threads, 4);
  EXPECT_EQ(s.tolerance, 1e-4);
  EXPECT_TRUE(s.ignore_unknown_parameters);
  EXPECT_EQ(s.settings, (std::map<std::string, std::string>{{"robot", "lwr4"}, {"joints", "7"}}));
  EXPECT_EQ(s.components[0].stage, 0);
  EXPECT_EQ(s.components[1].stage, 3);
  EXPECT_EQ(s.components[1].period, 10);
  EXPECT_FALSE(s.components[1].threads);
  EXPECT_TRUE(s.components[1].beside);
  EXPECT_FALSE(s.components[0].beside);
  ASSERT_EQ(s.events.size(), 3U);  // by time, those of equal time in the order of the file
  EXPECT_EQ(s.events[0].variable, "b.y");
  EXPECT_EQ(s.events[1].value, "1 2");
  EXPECT_EQ(s.events[1].ramp, Duration{250'000'000});
  EXPECT_EQ(s.events[2].value, "second of its time");
  EXPECT_EQ(s.events[2].ramp, Duration{0});
  EXPECT_EQ(s.decimation, 20);
  ASSERT_EQ(s.recording.size(), 4U);
  EXPECT_EQ(s.recording[0].variables, "a.*");
  EXPECT_EQ(s.recording[2].variables, "*.tau_J");
  EXPECT_EQ(s.comparisons[0].segments, 10);
  EXPECT_EQ(s.comparisons[0].from, Time{100'000'000});
  EXPECT_EQ(s.comparisons[0].to, Time{1'000'000'000});
  EXPECT_EQ(s.comparisons[1].segments, 8);
  EXPECT_FALSE(s.comparisons[1].from);
  EXPECT_EQ(s.reports[0].kind, ReportKind::kSignal);
  EXPECT_EQ(s.reports[1].b, "a.dq");
  EXPECT_EQ(s.bonds[0].flow_b, "b.dq");
  EXPECT_EQ(s.bonds[0].tolerance, 0.5);
}

TEST(Annotation, MayStandAtTheRootOrInTheExperimentToo) {
  const std::string list =
      "<d:Annotations><c:Annotation type='other'/><c:Annotation type='cotwin.master'><Master xmlns='urn:cotwin:master:1' "
      "tick='2 ms'/>"
      "</c:Annotation></d:Annotations>";
  EXPECT_EQ(parse(ssd("", list)).tick, Duration{2'000'000});
  EXPECT_EQ(parse(ssd("", "<d:DefaultExperiment>" + list + "</d:DefaultExperiment>")).tick, Duration{2'000'000});
  EXPECT_EQ(parse(ssd(list)).tick, Duration{2'000'000});
}

TEST(Connections, AreReadInEitherDirectionAndWithoutListedConnectors) {
  const std::string list = elements(component("a", connector("y", "output") + connector("p", "calculatedParameter")) +
                                    component("b", connector("u", "input") + connector("k", "parameter")) + component("c"));
  const Scenario s =
      parse(ssd(list + "<d:Connections><d:Connection startElement='b' startConnector='u' endElement='a' endConnector='y'/>"
                       "<d:Connection startElement='a' startConnector='p' endElement='b' endConnector='k'/>"
                       "<d:Connection startElement='c' startConnector='out[2]' endElement='c' endConnector='in[3]'/>"
                       "<d:Connection startElement='c' startConnector='x' endElement='a' endConnector='y'/></d:Connections>"));
  EXPECT_THAT(connections_of(s),
              ElementsAre("a.y -> b.u: 1, 0", "a.p -> b.k: 1, 0", "c.out[2] -> c.in[3]: 1, 0", "a.y -> c.x: 1, 0"));
}

TEST(Connections, FromAnInputOfTheRootSystemLeaveTheStartValue) {
  const Scenario s = parse(ssd("<d:Connectors>" + connector("u", "input", "mm") + "</d:Connectors><d:ParameterBindings>" +
                               inline_set("<v:Parameter name='u'><v:Real value='5'/></v:Parameter>") +
                               "</d:ParameterBindings>" + elements(component("a", connector("x", "input", "m"))) +
                               "<d:Connections><d:Connection startConnector='u' endElement='a' "
                               "endConnector='x'><c:LinearTransformation factor='2' offset='1'/>"
                               "</d:Connection></d:Connections>"));
  EXPECT_THAT(s.connections, IsEmpty());
  // 5 of the connector's mm are 0.005 m; 2·0.005 + 1
  EXPECT_THAT(values_of(s, "a"), ElementsAre("x = 1.01 m"));
}

TEST(ParameterNames, ApplyToAllVariablesOfThatName) {
  // A dot is ambiguous in SSP: component "b.c" with variable d, and system "b" with component "c" with d.
  EXPECT_THROW(parse(ssd(elements(component("b.c") + "<d:System name='b'>" + elements(component("c")) + "</d:System>"))),
               Error);
  const Scenario s =
      parse(ssd("<d:ParameterBindings>" + inline_set("<v:Parameter name='b.c.d'><v:Boolean value='true'/></v:Parameter>") +
                "</d:ParameterBindings>" + elements(component("b") + component("b.c"))));
  EXPECT_THAT(values_of(s, "b"), ElementsAre("c.d = true"));
  EXPECT_THAT(values_of(s, "b.c"), ElementsAre("d = true"));
}

TEST(SplitName, TakesTheLongestComponent) {
  const Scenario s = parse(ssd(elements(component("b") + component("b.c"))));
  ASSERT_TRUE(split_name(s, "b.c.d[2]"));
  EXPECT_EQ(split_name(s, "b.c.d[2]")->component, "b.c");
  EXPECT_EQ(split_name(s, "b.c.d[2]")->variable, "d[2]");
  EXPECT_EQ(split_name(s, "b.c")->variable, "c");
  EXPECT_FALSE(split_name(s, "b"));
  EXPECT_FALSE(split_name(s, "b."));
  EXPECT_FALSE(split_name(s, "bc.d"));
}

TEST(Assignment, BecomesTheLastStartValueOrASetting) {
  Scenario s = parse(ssd(elements(component("a", "", inline_set("<v:Parameter name='K'><v:Real value='1'/></v:Parameter>")) +
                                  "<d:System name='cell'>" + elements(component("drive")) + "</d:System>")));
  assign(s, "a.K=2 3 4");
  assign(s, "a.K[2]=7");
  assign(s, " cell.drive.file = a=b ");
  assign(s, "robot=lwr4");
  assign(s, "robot=ur10");
  assign(s, "note=");
  EXPECT_THAT(values_of(s, "a"), ElementsAre("K = 1", "K = '2 3 4'", "K[2] = '7'"));
  EXPECT_THAT(values_of(s, "cell.drive"), ElementsAre("file = ' a=b '"));
  EXPECT_EQ(s.settings, (std::map<std::string, std::string>{{"robot", "ur10"}, {"note", ""}}));
  EXPECT_EQ(s.components[0].start_values.back().place, "--set a.K[2]=7");
}

TEST(Assignment, OfASettingOfOneUnitChangesItsSourceAlone) {
  static const UnitType kTypes[] = {{"solver", "has a method", nullptr, [](SettingList& s) {
                                       s.choice("method", {"exact", "fast"}, "of solution");
                                       s.text("label", "", "any text");
                                     }}};
  Scenario s =
      parse(ssd("<d:Elements><d:Component name='a' source='unit:solver?method=exact&amp;robot=lwr4'/>"
                "<d:Component name='cell.b' source='unit:solver'/><d:Component name='c' source='c.fmu'/></d:Elements>"));
  assign(s, "a.method=fast", kTypes);
  assign(s, "cell.b.method=fast", kTypes);
  assign(s, "cell.b.label=50 % & more=less", kTypes);
  assign(s, "cell.b.other=1", kTypes);
  assign(s, "c.method=2", kTypes);  // variables of an FMU may have any name
  assign(s, "c?timeout=5", kTypes);
  assign(s, "c?tolerance=1e-6", kTypes);
  assign(s, "c?timeout=6", kTypes);
  EXPECT_EQ(s.components[0].source, "unit:solver?robot=lwr4&method=fast");
  EXPECT_EQ(s.components[1].source, "unit:solver?method=fast&label=50 %25 %26 more%3Dless");
  EXPECT_EQ(s.components[2].source, "c.fmu?tolerance=1e-6&timeout=6");
  EXPECT_THAT(values_of(s, "a"), ElementsAre());
  EXPECT_THAT(values_of(s, "cell.b"), ElementsAre("other = '1'"));
  EXPECT_THAT(values_of(s, "c"), ElementsAre("method = '2'"));
  EXPECT_THROW(assign(s, "b?method=fast", kTypes), Error);
  EXPECT_THROW(assign(s, "a?=fast", kTypes), Error);
  assign(s, "a.method=exact");  // without types: a start value
  EXPECT_THAT(values_of(s, "a"), ElementsAre("method = 'exact'"));
}

TEST(Assignment, OfAnExistingFileIsRelativeToTheWorkingDirectory) {
  const TemporaryFolder folder("scenario");
  folder.write("logs/run.csv", "t\n");
  folder.write("1.5", "");
  const fs::path before = fs::current_path();
  fs::create_directories(folder.path() / "here");
  fs::current_path(folder.path() / "here");
  Scenario s = parse(ssd(elements(component("a"))));
  assign(s, "a.file=../logs/run.csv");
  assign(s, "a.file=../logs/none.csv");
  assign(s, "a.file=../logs");
  fs::current_path(folder.path());
  assign(s, "a.x=1.5");  // a number, although a file has that name
  assign(s, "robot=logs/run.csv");
  fs::current_path(before);
  EXPECT_THAT(values_of(s, "a"), ElementsAre("file = '" + fs::canonical(folder.path() / "logs/run.csv").string() + "'",
                                             "file = '../logs/none.csv'", "file = '../logs'", "x = '1.5'"));
  EXPECT_EQ(s.settings.at("robot"), fs::canonical(folder.path() / "logs/run.csv").string());
}

TEST(Assignment, RefusesInvalidAssignments) {
  Scenario s = parse(ssd(elements(component("drive"))));
  const auto message = [&](const std::string& text) -> std::string {
    try {
      assign(s, text);
    } catch (const Error& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_EQ(message("drvie.K=1"), "--set drvie.K=1: 'drvie.K' is not a variable of a component, did you mean 'drive.K'?");
  EXPECT_THAT(message("drive.K"), HasSubstr("expected component.variable=value"));
  EXPECT_THAT(message("=1"), HasSubstr("expected component.variable=value"));
  EXPECT_THAT(message(""), HasSubstr("expected component.variable=value"));
  EXPECT_THAT(message("drive.=1"), HasSubstr("is not a variable"));
}

TEST(References, ThatContainThemselvesAreRefused) {
  const TemporaryFolder folder("scenario");
  const std::string loop = ssd(elements("<d:Component name='x' type='application/x-ssp-definition' source='b.ssd'/>"));
  folder.write("b.ssd", ssd(elements("<d:Component name='y' type='application/x-ssp-definition' source='sub/../a.ssd'/>")));
  const fs::path a = folder.write("a.ssd", loop);
  fs::create_directories(folder.path() / "sub");
  EXPECT_THAT([&] { load_scenario(a); }, ::testing::ThrowsMessage<Error>(HasSubstr("b.ssd:2: 'sub/../a.ssd' contains itself")));
  EXPECT_THAT(
      [&] {
        parse(
            ssd(elements("<d:System name='s' id='i'>" +
                         elements("<d:Component name='x' type='application/x-ssp-definition' source='#i'/>") + "</d:System>")));
      },
      ::testing::ThrowsMessage<Error>(HasSubstr("f.ssd:2: '#i' contains itself")));
}

TEST(References, ThatMultiplyWithoutEndAreBounded) {
  // Each system instantiates the next one ten times: 10²⁰ components in twenty lines.
  std::string systems;
  for (int i = 0; i < 20; ++i) {
    std::string copies;
    for (int k = 0; k < 10; ++k) {
      copies += "<d:Component name='c" + std::to_string(k) + "' type='application/x-ssp-definition' source='#s" +
                std::to_string(i + 1) + "'/>";
    }
    systems +=
        "<d:System name='s" + std::to_string(i) + "' id='s" + std::to_string(i) + "'>" + elements(copies) + "</d:System>\n";
  }
  systems += "<d:System name='s20' id='s20'/>";
  EXPECT_THAT([&] { parse(ssd(elements(systems))); }, ::testing::ThrowsMessage<Error>(HasSubstr("more than 100000 elements")));
}

TEST(References, InsideOneAnotherAreBounded) {
  // Each system instantiates the next one: nested 5000 deep.
  std::string systems;
  for (int i = 0; i < 5000; ++i) {
    systems +=
        "<d:System name='s" + std::to_string(i) + "' id='s" + std::to_string(i) + "'>" +
        elements("<d:Component name='c' type='application/x-ssp-definition' source='#s" + std::to_string(i + 1) + "'/>") +
        "</d:System>\n";
  }
  systems += "<d:System name='s5000' id='s5000'/>";
  EXPECT_THAT([&] { parse(ssd(elements(systems))); },
              ::testing::ThrowsMessage<Error>(HasSubstr("more than 100 nested references")));
}

TEST(UnitsOfMeasure, OfOneFileDoNotLeakIntoAnother) {
  // The parameter set defines another t; the structure, which defines none, means 1000 kg.
  const TemporaryFolder folder("scenario");
  folder.write(
      "long.ssv",
      "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0' name='d'><Parameters>"
      "<Parameter name='a'><Real value='1' unit='t'/></Parameter></Parameters><Units><Unit "
      "xmlns='http://ssp-standard.org/SSP1/SystemStructureCommon' "
      "name='t'><BaseUnit kg='1' factor='1016'/></Unit></Units></ParameterSet>");
  const fs::path file = folder.write(
      "s.ssd", ssd(elements(component("x", "",
                                      "<d:ParameterBinding source='long.ssv'/>" +
                                          inline_set("<v:Parameter name='b'><v:Real value='1' unit='t'/></v:Parameter>")))));
  const Scenario s = load_scenario(file);
  EXPECT_THAT(values_of(s, "x"), ElementsAre("a = 1 t (" + (folder.path() / "long.ssv").string() + ")", "b = 1 t"));
  ASSERT_EQ(s.units.size(), 1U);
  EXPECT_EQ(s.units[0].factor, 1016);
}

TEST(SystemStructure, OfFiveThousandComponentsInAChainIsReadCompletely) {
  std::string list, connections = "<d:Connections>";
  constexpr int kCount = 5000;
  for (int i = 0; i < kCount; ++i) {
    list += component("c" + std::to_string(i));
    if (i > 0) {
      connections += "<d:Connection startElement='c" + std::to_string(i - 1) + "' startConnector='y' endElement='c" +
                     std::to_string(i) + "' endConnector='u'/>";
    }
  }
  const Scenario s = parse(ssd(elements(list) + connections + "</d:Connections>"));
  EXPECT_EQ(s.components.size(), static_cast<std::size_t>(kCount));
  EXPECT_EQ(s.connections.size(), static_cast<std::size_t>(kCount - 1));
}

struct Bad {
  const char* name;
  std::string xml;
  const char* message;
};
void PrintTo(const Bad& bad, std::ostream* out) { *out << bad.name; }
class BadScenario : public ::testing::TestWithParam<Bad> {};

TEST_P(BadScenario, IsRefusedWithLineAndReason) {
  try {
    parse(GetParam().xml);
    FAIL() << "was read";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), StartsWith(GetParam().message));
  }
}

std::string connect(const std::string& list, const std::string& connections) {
  return ssd(elements(list) + "<d:Connections>\n" + connections + "</d:Connections>");
}
const std::string kPair = component("a", connector("y", "output", "N.m") + connector("z", "output", "N.m")) +
                          component("b", connector("u", "input", "rad"));
std::string from_to(const std::string& from, const std::string& y, const std::string& to, const std::string& u,
                    const std::string& inside = "") {
  return "<d:Connection startElement='" + from + "' startConnector='" + y + "' endElement='" + to + "' endConnector='" + u +
         "'>" + inside + "</d:Connection>\n";
}
std::string bound(const std::string& binding) { return ssd(elements("\n" + component("a", "", binding))); }

INSTANTIATE_TEST_SUITE_P(
    Structure, BadScenario,
    ::testing::Values(
        Bad{"Malformed", "<a", "f.ssd:1: malformed XML"}, Bad{"OtherRoot", "<a/>", "f.ssd:1: 'a' of namespace ''"},
        Bad{"Version",
            "<SystemStructureDescription xmlns='http://ssp-standard.org/SSP1/SystemStructureDescription' version='2.0' "
            "name='x'/>",
            "f.ssd:1: version '2.0'"},
        Bad{"NoSystem",
            "<SystemStructureDescription xmlns='http://ssp-standard.org/SSP1/SystemStructureDescription' version='1.0' "
            "name='x'/>",
            "f.ssd:1: 'SystemStructureDescription' without 'System'"},
        Bad{"NameTwice", ssd(elements(component("a") + "\n" + component("a"))),
            "f.ssd:3: a second element 'a' in system 'root'"},
        Bad{"EmptyName", ssd(elements(component(""))), "f.ssd:2: an empty name"},
        Bad{"ConnectorTwice", ssd(elements(component("a", connector("y", "output") + "\n" + connector("y", "output")))),
            "f.ssd:3: a second connector 'y'"},
        Bad{"Kind", ssd(elements(component("a", connector("y", "out")))),
            "f.ssd:2: attribute 'kind' of 'Connector': 'out', expected one of 'input', 'output'"},
        Bad{"Implementation", ssd(elements("<d:Component name='a' source='x.fmu' implementation='Any'/>")),
            "f.ssd:2: attribute 'implementation' of 'Component': 'Any'"},
        Bad{"NoSource", ssd(elements("<d:Component name='a'/>")), "f.ssd:2: 'Component' without the attribute 'source'"},
        Bad{"Package", ssd(elements("<d:Component name='a' source='x.ssp' type='application/x-ssp-package'/>")),
            "f.ssd:2: component 'a' is an SSP package"},
        Bad{"Scheme", ssd(elements("<d:Component name='a' source='https://x/y.fmu'/>")),
            "f.ssd:2: 'https://x/y.fmu': scheme 'https' is not supported"},
        Bad{"Escape", ssd(elements("<d:Component name='a' source='x%2.fmu'/>")), "f.ssd:2: 'x%2.fmu': malformed escape"},
        Bad{"EscapedNul", ssd(elements("<d:Component name='a' source='x%00.fmu'/>")), "f.ssd:2: 'x%00.fmu': malformed escape"},
        Bad{"NoSuchStructure", ssd(elements("<d:Component name='a' source='none.ssd' type='application/x-ssp-definition'/>")),
            "f.ssd:2: 'none.ssd' is not a file: looked for "},
        Bad{"NoSuchId", ssd(elements("<d:Component name='a' source='#none' type='application/x-ssp-definition'/>")),
            "f.ssd:2: no 'System' with the id 'none'"},
        Bad{"Dictionary",
            ssd(elements("<d:SignalDictionaryReference name='r' dictionary='none'><d:Connectors>" + connector("y", "inout") +
                         "</d:Connectors></d:SignalDictionaryReference>" + component("a")) +
                "<d:Connections>" + from_to("a", "y", "r", "y") + "</d:Connections>"),
            "f.ssd:2: no signal dictionary 'none'"},
        Bad{"StopBeforeStart", ssd("", "\n<d:DefaultExperiment startTime='2' stopTime='1'/>"),
            "f.ssd:4: start time 2 s, stop time 1 s"},
        Bad{"StopHuge", ssd("", "<d:DefaultExperiment stopTime='1e300'/>"), "f.ssd:3: start time 0 s"},
        Bad{"StopNaN", ssd("", "<d:DefaultExperiment stopTime='NaN'/>"), "f.ssd:3: start time 0 s"}),
    [](const auto& p) { return p.param.name; });

INSTANTIATE_TEST_SUITE_P(
    Connections, BadScenario,
    ::testing::Values(
        Bad{"UnknownElement", connect(kPair, from_to("aa", "y", "b", "u")),
            "f.ssd:3: 'aa' is not an element of system 'root', did you mean 'a'?"},
        Bad{"UnknownConnector",
            ssd("<d:Connectors>" + connector("speed", "input") + "</d:Connectors>" + elements(kPair) +
                "<d:Connections>\n<d:Connection startConnector='sped' endElement='b' endConnector='u'/></d:Connections>"),
            "f.ssd:3: 'sped' is not a connector of 'root', did you mean 'speed'?"},
        Bad{"TwoSources", connect(kPair, from_to("a", "y", "b", "v") + from_to("a", "z", "b", "v")),
            "f.ssd:4: 'b.v' has two sources, the first at f.ssd:3"},
        Bad{"OutputToOutput", connect(kPair, from_to("a", "y", "a", "z")),
            "f.ssd:3: 'a.y' (output) and 'a.z' (output) are both sources"},
        Bad{"Units", connect(kPair, from_to("a", "y", "b", "u")), "f.ssd:3: N.m cannot feed rad"},
        Bad{"NoConnector", connect(kPair, "<d:Connection startElement='a' endElement='b' endConnector='u'/>"),
            "f.ssd:3: 'Connection' without the attribute 'startConnector'"},
        Bad{"EmptyConnector", connect(kPair, from_to("a", "", "b", "u")),
            "f.ssd:3: a connection without the name of a connector"},
        Bad{"DiscreteTransformation", connect(kPair, from_to("a", "y", "b", "v", "\n<c:BooleanMappingTransformation/>")),
            "f.ssd:4: 'BooleanMappingTransformation' is not supported"},
        Bad{"Factor", connect(kPair, from_to("a", "y", "b", "v", "\n<c:LinearTransformation factor='x'/>")),
            "f.ssd:4: attribute 'factor' of 'LinearTransformation': 'x'"},
        Bad{"InfiniteFactor", connect(kPair, from_to("a", "y", "b", "v", "\n<c:LinearTransformation factor='INF'/>")),
            "f.ssd:4: factor or offset is not finite"},
        Bad{"Circle",
            ssd(elements("<d:System name='s'><d:Connectors>" + connector("i", "input") + connector("o", "output") +
                         "</d:Connectors>" + elements(component("a", connector("u", "input"))) +
                         "<d:Connections><d:Connection startConnector='i' endConnector='o'/><d:Connection startConnector='i' "
                         "endElement='a' endConnector='u'/></d:Connections></d:System>") +
                "<d:Connections>" + from_to("s", "o", "s", "i") + "</d:Connections>"),
            "f.ssd:2: the connections to 's.a.u' form a loop"}),
    [](const auto& p) { return p.param.name; });

const std::string kMapped =
    "<d:ParameterBinding><d:ParameterValues><v:ParameterSet version='1.0' name='s'><v:Parameters><v:Parameter name='K'><v:Real "
    "value='1' unit='mm'/></v:Parameter>"
    "<v:Parameter name='n'><v:Integer value='5'/></v:Parameter></v:Parameters></v:ParameterSet></d:ParameterValues>"
    "<d:ParameterMapping><m:ParameterMapping version='1.0'>\n";
std::string mapping(const std::string& entries) {
  return bound(kMapped + entries + "</m:ParameterMapping></d:ParameterMapping></d:ParameterBinding>");
}

INSTANTIATE_TEST_SUITE_P(
    Bindings, BadScenario,
    ::testing::Values(
        Bad{"NoFile", bound("<d:ParameterBinding source='no/such.ssv'/>"), "f.ssd:3: 'no/such.ssv' is not a file: looked for "},
        Bad{"Both", bound("<d:ParameterBinding source='x.ssv'><d:ParameterValues/></d:ParameterBinding>"),
            "f.ssd:3: a binding with both"},
        Bad{"EmptyValues", bound("<d:ParameterBinding><d:ParameterValues/></d:ParameterBinding>"),
            "f.ssd:3: 'ParameterValues' without 'ParameterSet'"},
        Bad{"Type", bound("<d:ParameterBinding type='text/csv' source='x.csv'/>"), "f.ssd:3: type 'text/csv' is not supported"},
        Bad{"InsideComponent", bound("<d:ParameterBinding source='x.ssv' sourceBase='component'/>"),
            "f.ssd:3: 'x.ssv' is inside the component"},
        Bad{"Unit", bound(inline_set("<v:Parameter name='K'><v:Real value='1' unit='furlong'/></v:Parameter>")),
            "f.ssd:3: unit of measure 'furlong': unknown symbol 'furlong', and the file does not define it"},
        Bad{"TargetTwice", mapping("<m:MappingEntry source='K' target='x'/>\n<m:MappingEntry source='n' target='x'/>"),
            "f.ssd:5: a second entry maps to 'x'"},
        Bad{"NotInTheTable",
            mapping("<m:MappingEntry source='n' target='x'><c:IntegerMappingTransformation><c:MapEntry source='4' "
                    "target='1'/></c:IntegerMappingTransformation></m:MappingEntry>"),
            "f.ssd:4: parameter 'n': the transformation has no entry for its value"},
        Bad{"TableOfReal",
            mapping("<m:MappingEntry source='K' target='x'><c:IntegerMappingTransformation><c:MapEntry source='4' "
                    "target='1'/></c:IntegerMappingTransformation></m:MappingEntry>"),
            "f.ssd:4: parameter 'K': the transformation has no entry for its value"},
        Bad{"TableOfAnotherKind",
            mapping("<m:MappingEntry source='n' target='x'><c:EnumerationMappingTransformation><c:MapEntry source='5' "
                    "target='on'/></c:EnumerationMappingTransformation></m:MappingEntry>"),
            "f.ssd:4: parameter 'n': the transformation has no entry for its value"},
        Bad{"EmptyTable", mapping("<m:MappingEntry source='n' target='x'><c:IntegerMappingTransformation/></m:MappingEntry>"),
            "f.ssd:4: 'IntegerMappingTransformation' without 'MapEntry'"},
        Bad{"OffsetInUnknownUnit",
            mapping("<m:MappingEntry source='K' target='x'><c:LinearTransformation offset='1'/></m:MappingEntry>"),
            "f.ssd:3: parameter 'x' in mm: a linear transformation needs the unit of measure of its target"}),
    [](const auto& p) { return p.param.name; });

INSTANTIATE_TEST_SUITE_P(
    Annotations, BadScenario,
    ::testing::Values(
        Bad{"Attribute", annotated("tik='1 ms'", ""), "f.ssd:2: 'tik' is not an attribute of 'Master', did you mean 'tick'?"},
        Bad{"Element", annotated("", "<t:Evnt/>"), "f.ssd:3: 'Evnt' is not an element of 'Master', did you mean 'Event'?"},
        Bad{"ForeignElement", annotated("", "<Event xmlns='urn:x'/>"),
            "f.ssd:3: 'Event' of namespace 'urn:x' in our annotation"},
        Bad{"TickUnit", annotated("tick='1 mm'", ""), "f.ssd:2: attribute 'tick' of 'Master': '1 mm', expected a time such as"},
        Bad{"TickText", annotated("tick='fast'", ""), "f.ssd:2: attribute 'tick' of 'Master': 'fast', expected a time such as"},
        Bad{"TickZero", annotated("tick='0'", ""), "f.ssd:2: attribute 'tick' of 'Master': '0', expected 1e-09 s to"},
        Bad{"TickHuge", annotated("tick='1e30'", ""), "f.ssd:2: attribute 'tick' of 'Master': '1e30', expected 1e-09 s to"},
        Bad{"TickFraction", annotated("tick='1.5 ns'", ""),
            "f.ssd:2: attribute 'tick' of 'Master': '1.5 ns', expected a whole number of nanoseconds"},
        Bad{"StopBeforeStart", annotated("stop='-1'", ""), "f.ssd:2: attribute 'stop' of 'Master': '-1', expected 0 s to"},
        Bad{"Clock", annotated("clock='bus'", ""),
            "f.ssd:2: attribute 'clock' of 'Master': 'bus', expected one of 'free', 'wall', 'arrivals', 'locked', 'real-time'"},
        Bad{"ClockKind", annotated("", "<t:Clock kind='bus'/>"),
            "f.ssd:3: attribute 'kind' of 'Clock': 'bus', expected one of"},
        Bad{"ClockTwice", annotated("clock='wall'", "<t:Clock kind='wall'/>"), "f.ssd:3: a second clock"},
        Bad{"ClockComponent", annotated("", "<t:Clock kind='locked' component='aa'/>"),
            "f.ssd:3: 'aa' is not a component, did you mean 'a'?"},
        Bad{"ClockFreeOverrun", annotated("", "<t:Clock kind='free' overrun='skip'/>"),
            "f.ssd:3: attribute 'overrun' of 'Clock' of kind 'free', expected it only with 'wall', 'arrivals' or 'locked'"},
        Bad{"ClockWallSilence", annotated("", "<t:Clock kind='wall' silence='stop'/>"),
            "f.ssd:3: attribute 'silence' of 'Clock' of kind 'wall', expected it only with 'arrivals' or 'locked'"},
        Bad{"ClockArrivalsShift", annotated("", "<t:Clock kind='arrivals' shift='1 us'/>"),
            "f.ssd:3: attribute 'shift' of 'Clock' of kind 'arrivals', expected it only with 'locked'"},
        Bad{"ClockOverrun", annotated("", "<t:Clock kind='wall' overrun='slip'/>"),
            "f.ssd:3: attribute 'overrun' of 'Clock': 'slip', expected one of 'catch_up', 'skip', 'stop'"},
        Bad{"ClockTimeout", annotated("", "<t:Clock kind='locked' timeout='0'/>"),
            "f.ssd:3: attribute 'timeout' of 'Clock': '0', expected 1e-09 s to"},
        Bad{"ClockBandwidth", annotated("", "<t:Clock kind='locked' bandwidth='0'/>"),
            "f.ssd:3: attribute 'bandwidth' of 'Clock': 0, expected 0.001 to 1000 Hz"},
        Bad{"ClockPriority", annotated("", "<t:Clock kind='wall' priority='100'/>"),
            "f.ssd:3: attribute 'priority' of 'Clock': 100, expected 0 to 99"},
        Bad{"ClockCpu", annotated("", "<t:Clock kind='wall' cpu='1.5'/>"),
            "f.ssd:3: attribute 'cpu' of 'Clock': '1.5', expected numbers of CPUs such as '2' or '2 3'"},
        Bad{"ClockAttribute", annotated("", "<t:Clock kind='wall' prioriti='1'/>"),
            "f.ssd:3: 'prioriti' is not an attribute of 'Clock', did you mean 'priority'?"},
        Bad{"Threads", annotated("threads='-1'", ""), "f.ssd:2: attribute 'threads' of 'Master': -1, expected 0 to 1024"},
        Bad{"Tolerance", annotated("tolerance='-1'", ""),
            "f.ssd:2: attribute 'tolerance' of 'Master': -1, expected a finite number"},
        Bad{"Component", annotated("", "<t:Component name='aa' stage='1'/>"),
            "f.ssd:3: 'aa' is not a component, did you mean 'a'?"},
        Bad{"ComponentTwice", annotated("", "<t:Component name='a'/>\n<t:Component name='a'/>"),
            "f.ssd:4: a second 'Component' with the name 'a'"},
        Bad{"Period", annotated("", "<t:Component name='a' period='0'/>"),
            "f.ssd:3: attribute 'period' of 'Component': 0, expected 1 to"},
        Bad{"SettingTwice", annotated("", "<t:Setting name='r' value='1'/>\n<t:Setting name='r' value='2'/>"),
            "f.ssd:4: a second setting 'r'"},
        Bad{"EventVariable", annotated("", "<t:Event time='1' variable='aa.x' value='1'/>"),
            "f.ssd:3: 'aa.x' is not a variable of a component, did you mean 'a.x'?"},
        Bad{"EventWithoutValue", annotated("", "<t:Event time='1' variable='a.x'/>"),
            "f.ssd:3: 'Event' without the attribute 'value'"},
        Bad{"EventRamp", annotated("", "<t:Event time='1' variable='a.x' value='1' ramp='-1'/>"),
            "f.ssd:3: attribute 'ramp' of 'Event': '-1'"},
        Bad{"Segments", annotated("", "<t:Comparison name='c' a='a.x' b='b.x' segments='0'/>"),
            "f.ssd:3: attribute 'segments' of 'Comparison': 0"},
        Bad{"FromTo", annotated("", "<t:Comparison name='c' a='a.x' b='b.x' from='2' to='1'/>"),
            "f.ssd:3: comparison 'c': from is not before to"},
        Bad{"ReportB", annotated("", "<t:Report a='a.x' b='b.x'/>"), "f.ssd:3: a report of kind 'signal' has no 'b'"},
        Bad{"ReportWithoutB", annotated("", "<t:Report kind='energy' a='a.x'/>"),
            "f.ssd:3: 'Report' without the attribute 'b'"},
        Bad{"EmptyRecord", annotated("", "<t:Recording><t:Record variables=' ,'/></t:Recording>"),
            "f.ssd:3: 'Record' without variables"},
        Bad{"RecordingTwice", annotated("", "<t:Recording/>\n<t:Recording/>"), "f.ssd:4: a second 'Recording'"},
        Bad{"Twice",
            ssd("<d:Annotations><c:Annotation type='cotwin.master'><Master "
                "xmlns='urn:cotwin:master:1'/></c:Annotation>\n<c:Annotation type='cotwin.master'/></d:Annotations>"),
            "f.ssd:3: an annotation 'cotwin.master', expected it once"},
        Bad{"Elsewhere",
            ssd(elements("<d:Component name='a' source='unit:a'><d:Annotations><c:Annotation "
                         "type='cotwin.master'/></d:Annotations></d:Component>")),
            "f.ssd:2: an annotation 'cotwin.master', expected it once"},
        Bad{"Empty", ssd("<d:Annotations><c:Annotation type='cotwin.master'/></d:Annotations>"),
            "f.ssd:2: annotation 'cotwin.master', expected one element 'Master'"},
        // With the Cotwin annotation the rest of the file is read strictly.
        Bad{"StrictStructure",
            ssd("<d:Annotations><c:Annotation type='cotwin.master'><Master "
                "xmlns='urn:cotwin:master:1'/></c:Annotation></d:Annotations>\n<d:Conections/>"),
            "f.ssd:3: 'Conections' is not an element of 'System', did you mean 'Connections'?"}),
    [](const auto& p) { return p.param.name; });

TEST(SystemStructure, WithoutTheCotwinAnnotationIsReadLeniently) {
  const Scenario s = parse(ssd(
      "<d:Conections/>" +
      elements(component("a", "<d:Connector name='x' kind='input' flavour='salty'><c:Real unit='furlong'/></d:Connector>"))));
  EXPECT_THAT(s.warnings,
              ElementsAre("f.ssd:2: 'Conections' is not an element of 'System', did you mean 'Connections'?",
                          "f.ssd:2: 'flavour' is not an attribute of 'Connector'",
                          "f.ssd:2: unit of measure 'furlong': unknown symbol 'furlong', and the file does not define it"));
  EXPECT_EQ(s.components[0].connectors[0].unit, "");
  const Scenario values = parse(bound(inline_set("<v:Parameter name='K'><v:Real value='1' unit='None'/></v:Parameter>")));
  EXPECT_THAT(values.warnings, ElementsAre("f.ssd:3: unit of measure 'None' of 'K' is none: its number is taken as it is"));
  EXPECT_EQ(values.components[0].start_values[0].unit, "");
}

TEST(SystemStructure, WithoutTheCotwinAnnotationMayOmitDefaults) {
  const Scenario s = parse(
      "<SystemStructureDescription xmlns='http://ssp-standard.org/SSP1/SystemStructureDescription'><System "
      "name='r'><Elements>\n"
      "<Component name='a' "
      "source='a.fmu'><ParameterBindings><ParameterBinding/></ParameterBindings></Component></Elements></System>"
      "</SystemStructureDescription>");
  EXPECT_THAT(names_of(s), ElementsAre("a"));
  EXPECT_THAT(s.warnings,
              ElementsAre(HasSubstr("without the attribute 'version'"), HasSubstr("f.ssd:2: a binding without values")));
}

TEST(SystemStructure, WithTheCotwinAnnotationRefusesUnknownParameters) {
  const std::string binding = "<d:ParameterBindings>" +
                              inline_set("<v:Parameter name='drvie.K'><v:Real value='1'/></v:Parameter>") +
                              "</d:ParameterBindings>";
  const auto document = [&](const std::string& attributes) {
    return ssd(binding + elements(component("drive")) +
               "<d:Annotations><c:Annotation type='cotwin.master'><Master xmlns='urn:cotwin:master:1' " + attributes +
               "/></c:Annotation></d:Annotations>");
  };
  EXPECT_THAT([&] { parse(document("")); },
              ::testing::ThrowsMessage<Error>("f.ssd:2: 'drvie.K' is not a parameter of 'root', did you mean 'drive.K'?"));
  EXPECT_THAT(parse(document("unknownParameters='ignore'")).warnings, ElementsAre(HasSubstr("did you mean 'drive.K'?")));
}

TEST(SystemStructure, IsReadFromAPackageWhateverItsNameIs) {
  const TemporaryFolder folder("scenario");
  const std::vector<fmu::ArchiveFile> files = {{"SystemStructure.ssd", ssd(elements(component("only")))}};
  for (const char* name : {"twin.ssp", "TWIN.SSP", "twin.zip", "twin"}) {
    fmu::write_archive(folder.path() / name, files);
    const Scenario scenario = load_scenario(folder.path() / name);
    ASSERT_EQ(scenario.components.size(), 1u) << name;
    EXPECT_EQ(scenario.components[0].name, "only") << name;
  }
}

TEST(SystemStructure, ThatIsMissingIsNamed) {
  EXPECT_THAT([] { load_scenario("no/such.ssd"); }, ::testing::ThrowsMessage<Error>(StartsWith("no/such.ssd: cannot be read")));
}

class InPackage : public ::testing::TestWithParam<std::string> {};

TEST_P(InPackage, ReferencesThatLeaveThePackageAreRefused) {
  const TemporaryFolder folder("scenario");
  folder.write("outside.ssd", ssd(elements(component("only"))));
  folder.write("outside.ssv",
               "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0' "
               "name='d'><Parameters/></ParameterSet>");
  const std::string document = ssd(elements(GetParam()));
  fmu::write_archive(folder.path() / "p.ssp", std::vector<fmu::ArchiveFile>{{"SystemStructure.ssd", document}});
  EXPECT_THAT([&] { load_scenario(folder.path() / "p.ssp"); },
              ::testing::ThrowsMessage<Error>(::testing::AllOf(HasSubstr("p.ssp/SystemStructure.ssd:2: "),
                                                               HasSubstr("is outside the package, expected a file in it"))));
}

INSTANTIATE_TEST_SUITE_P(
    Sources, InPackage,
    ::testing::Values("<d:Component name='a' source='../x.fmu'/>", "<d:Component name='a' source='/elsewhere/x.fmu'/>",
                      "<d:Component name='a' source='file:///elsewhere/x.fmu'/>",
                      "<d:Component name='a' source='b/../../x.fmu'/>", "<d:Component name='a' source='%2e%2e/x.fmu'/>",
                      "<d:Component name='a' type='application/x-ssp-definition' source='../outside.ssd'/>",
                      "<d:Component name='a' source='unit:motion?robot=/etc/passwd'/>",
                      "<d:Component name='a' source='unit:motion?robot=%2Fetc%2Fpasswd'/>",
                      "<d:Component name='a' source='unit:contact_world?robots=l:lwr4,r:../r.urdf'/>",
                      component("a", "", "<d:ParameterBinding source='../outside.ssv'/>"),
                      component("a", "", "<d:ParameterBinding source='/etc/passwd'/>"),
                      component("a", "",
                                inline_set("<v:Parameter name='file'><v:String value='../../etc/passwd'/></v:Parameter>"))));

TEST(References, OfUnpackedFilesMayPointAnywhere) {
  const TemporaryFolder folder("scenario");
  fs::create_directories(folder.path() / "sub");
  folder.write("other.ssd", ssd(elements(component("only"))));
  const fs::path own = folder.write(
      "sub/own.ssd", ssd(elements("<d:Component name='a' type='application/x-ssp-definition' source='../other.ssd'/>"
                                  "<d:Component name='b' source='/elsewhere/x.fmu'/>")));
  EXPECT_EQ(load_scenario(own).components.size(), 2u);
}

// With a linear search for components, connectors or units of measure this would take hours.
TEST(SystemStructure, TheTimeToReadItGrowsWithItsSizeAndNotWithItsSquare) {
  constexpr int kMany = 50'000;
  std::string units, ports, annotation, components, connections, values;
  for (int i = 0; i < kMany; ++i) {
    const std::string k = std::to_string(i);
    units += "<c:Unit name='u" + k + "'><c:BaseUnit m='1' factor='" + k + "1'/></c:Unit>";
    ports += connector("y" + k, "output", "u" + k) + connector("u" + k, "input", "u" + k);
    if (i % 2 == 0) components += "<d:Component name='c" + k + "' source='unit:x'/>";
    connections += "<d:Connection startElement='a' startConnector='y" + k + "' endElement='b' endConnector='u" + k + "'/>";
    values +=
        "<v:Parameter name='c" + std::to_string(i - i % 2) + ".p" + k + "'><v:Real value='1' unit='u" + k + "'/></v:Parameter>";
    annotation += "<t:Event time='0.5' variable='c" + std::to_string(i - i % 2) + ".e' value='1'/>";
    if (i % 2 == 0) annotation += "<t:Component name='c" + k + "' stage='1'/>";
  }
  const std::string system =
      "<d:ParameterBindings>" + inline_set(values) + "</d:ParameterBindings>" +
      elements(component("a", ports) + component("b", ports) + components) + "<d:Connections>" + connections +
      "</d:Connections><d:Annotations><c:Annotation type='cotwin.master'><t:Master xmlns:t='urn:cotwin:master:1'>" +
      annotation + "</t:Master></c:Annotation></d:Annotations>";
  const Scenario scenario = parse(ssd(system, "<d:Units>" + units + "</d:Units>"));
  EXPECT_EQ(scenario.connections.size(), static_cast<std::size_t>(kMany));
  EXPECT_EQ(scenario.events.size(), static_cast<std::size_t>(kMany));
  EXPECT_EQ(scenario.components.back().stage, 1);
}

}  // namespace
}  // namespace cotwin::master::scenario_test
