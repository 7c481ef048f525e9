// The validator of the standards: what it accepts, what it refuses, rule by rule, and that it agrees with the schemas of the
// standards.
#include "tests/support/standard_validator.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <stdexcept>

#include "fmu/archive/archive.h"
#include "tests/fmu/foreign.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"

namespace cotwin::testing::standard_validator_test {
namespace {

namespace fs = std::filesystem;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

const std::string kFmi2 = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="all" guid="{1}" description="d" author="a" version="1" copyright="c" license="l"
    generationTool="t" generationDateAndTime="2024-02-29T12:00:00Z" variableNamingConvention="structured" numberOfEventIndicators="1">
  <ModelExchange modelIdentifier="all" completedIntegratorStepNotNeeded="true"><SourceFiles><File name="a.c"/></SourceFiles></ModelExchange>
  <CoSimulation modelIdentifier="all" canGetAndSetFMUstate="true" canSerializeFMUstate="1" maxOutputDerivativeOrder="1"/>
  <UnitDefinitions>
    <Unit name="K"><BaseUnit K="1"/><DisplayUnit name="degC" offset="-273.15"/><DisplayUnit name="degF" factor="1.8"/></Unit>
    <Unit name="m"><BaseUnit m="1" factor="1e0"/></Unit>
  </UnitDefinitions>
  <TypeDefinitions>
    <SimpleType name="Length"><Real quantity="Length" unit="m" min="-1" max="INF"/></SimpleType>
    <SimpleType name="Choice"><Enumeration><Item name="one" value="1"/><Item name="two" value="2"/></Enumeration></SimpleType>
  </TypeDefinitions>
  <LogCategories><Category name="logError"/><Category name="logAll" description="all"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="1" tolerance="1e-4" stepSize=".01"/>
  <VendorAnnotations><Tool name="t"><x:any xmlns:x="urn:x" a="1"><x:b>text</x:b></x:any></Tool></VendorAnnotations>
  <ModelVariables>
    <ScalarVariable name="x" valueReference="0" causality="output" initial="exact"><Real start="1" unit="K" displayUnit="degC"/></ScalarVariable>
    <ScalarVariable name="der(x)" valueReference="1"><Real derivative="1"/><Annotations><Tool name="t"/></Annotations></ScalarVariable>
    <ScalarVariable name="u" valueReference="2" causality="input" variability="discrete"><Integer start="-2" min="-3" max="3"/></ScalarVariable>
    <ScalarVariable name="b" valueReference="0" causality="parameter" variability="tunable"><Boolean start="true"/></ScalarVariable>
    <ScalarVariable name="s" valueReference="0" causality="parameter" variability="fixed"><String start=""/></ScalarVariable>
    <ScalarVariable name="e" valueReference="7" causality="output" variability="discrete"><Enumeration declaredType="Choice"/></ScalarVariable>
    <ScalarVariable name="t" valueReference="8" causality="independent"><Real/></ScalarVariable>
    <ScalarVariable name="l" valueReference="9" causality="calculatedParameter" variability="fixed"><Real declaredType="Length"/></ScalarVariable>
  </ModelVariables>
  <ModelStructure>
    <Outputs><Unknown index="1" dependencies="2 3" dependenciesKind="dependent fixed"/><Unknown index="6" dependencies=""/></Outputs>
    <Derivatives><Unknown index="2"/></Derivatives>
    <InitialUnknowns><Unknown index="2"/><Unknown index="6"/><Unknown index="8"/></InitialUnknowns>
  </ModelStructure>
</fmiModelDescription>)xml";

const std::string kFmi3 = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="all" instantiationToken="{1}" generationDateAndTime="2024-01-31T12:00:00.5+01:00"
    variableNamingConvention="flat">
  <ModelExchange modelIdentifier="all" needsCompletedIntegratorStep="true"/>
  <CoSimulation modelIdentifier="all" canGetAndSetFMUState="true" hasEventMode="true" fixedInternalStepSize="1e-3"/>
  <ScheduledExecution modelIdentifier="all"/>
  <UnitDefinitions><Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000" inverse="false"/></Unit></UnitDefinitions>
  <TypeDefinitions>
    <Float64Type name="Length" unit="m" displayUnit="mm" min="0"/>
    <EnumerationType name="Choice"><Item name="one" value="1"/><Item name="two" value="2"/></EnumerationType>
    <ClockType name="Ticks" intervalVariability="triggered"/>
  </TypeDefinitions>
  <LogCategories><Category name="logError"/></LogCategories>
  <DefaultExperiment startTime="0" stopTime="1"/>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent"/>
    <UInt64 name="n" valueReference="1" causality="structuralParameter" variability="tunable" start="2"/>
    <Float64 name="u" valueReference="2" causality="input" start="1 2"><Dimension valueReference="1"/></Float64>
    <Float64 name="x" valueReference="3" causality="output" initial="exact" declaredType="Length" start="1"><Alias name="x too" displayUnit="mm"/></Float64>
    <Float64 name="der(x)" valueReference="4" derivative="3" unit="m" nominal="2" reinit="false"/>
    <Float32 name="f" valueReference="5" causality="local" variability="discrete"><Annotations><Annotation type="a">any <b/> text</Annotation></Annotations><Dimension start="3"/></Float32>
    <Int8 name="i8" valueReference="6" causality="input" start="-128" min="-128" max="127"/>
    <UInt8 name="u8" valueReference="7" causality="input" start="255"/>
    <Int16 name="i16" valueReference="8" causality="input" start="-32768"/>
    <UInt16 name="u16" valueReference="9" causality="input" start="65535"/>
    <Int32 name="i32" valueReference="10" causality="input" start="-2147483648"/>
    <UInt32 name="u32" valueReference="11" causality="input" start="4294967295"/>
    <Int64 name="i64" valueReference="12" causality="input" start="-9223372036854775808"/>
    <UInt64 name="u64" valueReference="13" causality="input" start="18446744073709551615"/>
    <Boolean name="b" valueReference="14" causality="parameter" start="true"/>
    <String name="s" valueReference="15" causality="parameter"><Start value="a b"/></String>
    <Binary name="y" valueReference="16" causality="input" mimeType="a/b" maxSize="3"><Start value="00fF"/></Binary>
    <Enumeration name="e" valueReference="17" causality="output" declaredType="Choice"/>
    <Clock name="c" valueReference="18" causality="input" intervalVariability="constant" intervalDecimal="0.1" declaredType="Ticks"/>
    <Int32 name="k" valueReference="19" clocks="18" previous="20"/>
    <Int32 name="before" valueReference="20" clocks="18" initial="exact" start="0"/>
  </ModelVariables>
  <ModelStructure>
    <Output valueReference="3" dependencies="2 3" dependenciesKind="dependent constant"/>
    <Output valueReference="17"/>
    <ContinuousStateDerivative valueReference="4" dependencies=""/>
    <ClockedState valueReference="19"/>
    <InitialUnknown valueReference="4"/>
    <EventIndicator valueReference="4"/>
  </ModelStructure>
</fmiModelDescription>)xml";

const std::string kSsd = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<ssd:SystemStructureDescription xmlns:ssd="http://ssp-standard.org/SSP1/SystemStructureDescription"
    xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"
    version="1.0" name="all" id="root" generationDateAndTime="2024-06-01T00:00:00">
  <ssd:System name="top">
    <ssd:Connectors>
      <ssd:Connector name="u" kind="input"><ssc:Real unit="m"/></ssd:Connector>
      <ssd:Connector name="y" kind="output"><ssc:Real/><ssd:ConnectorGeometry x="1" y="0.5"/></ssd:Connector>
    </ssd:Connectors>
    <ssd:ElementGeometry x1="0" y1="0" x2="1" y2="1" iconFlip="true"/>
    <ssd:ParameterBindings>
      <ssd:ParameterBinding prefix="a."><ssd:ParameterValues><ssv:ParameterSet version="1.0" name="values"><ssv:Parameters>
        <ssv:Parameter name="k"><ssv:Real value="1"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet></ssd:ParameterValues></ssd:ParameterBinding>
      <ssd:ParameterBinding source="b.ssv"><ssd:ParameterMapping source="b.ssm"/></ssd:ParameterBinding>
    </ssd:ParameterBindings>
    <ssd:Elements>
      <ssd:Component name="a" source="a.fmu" implementation="CoSimulation" id="a">
        <ssd:Connectors>
          <ssd:Connector name="u" kind="input"><ssc:Real/></ssd:Connector>
          <ssd:Connector name="y" kind="output"><ssc:Real/></ssd:Connector>
          <ssd:Connector name="e" kind="parameter"><ssc:Enumeration name="E"/></ssd:Connector>
          <ssd:Connector name="w" kind="inout"/>
        </ssd:Connectors>
      </ssd:Component>
      <ssd:System name="b"><ssd:Connectors><ssd:Connector name="u" kind="input"><ssc:Boolean/></ssd:Connector></ssd:Connectors></ssd:System>
    </ssd:Elements>
    <ssd:Connections>
      <ssd:Connection startConnector="u" endElement="a" endConnector="u"><ssc:LinearTransformation factor="2"/><ssd:ConnectionGeometry pointsX="1 2" pointsY="1 2"/></ssd:Connection>
      <ssd:Connection startElement="a" startConnector="y" endConnector="y" suppressUnitConversion="true"/>
      <ssd:Connection startElement="a" startConnector="w" endElement="b" endConnector="u"><ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="0"/></ssc:BooleanMappingTransformation></ssd:Connection>
    </ssd:Connections>
    <ssd:SystemGeometry x1="0" y1="0" x2="1" y2="1"/>
    <ssd:GraphicalElements><ssd:Note x1="0" y1="0" x2="1" y2="1" text="note"/></ssd:GraphicalElements>
  </ssd:System>
  <ssd:Enumerations><ssc:Enumeration name="E"><ssc:Item name="one" value="1"/></ssc:Enumeration></ssd:Enumerations>
  <ssd:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit></ssd:Units>
  <ssd:DefaultExperiment startTime="0" stopTime="2"/>
  <ssd:Annotations><ssc:Annotation type="x"><own xmlns="urn:own" any="thing"/></ssc:Annotation></ssd:Annotations>
</ssd:SystemStructureDescription>)xml";

const std::string kSsv = R"xml(<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon"
    version="1.0" name="all">
  <ssv:Parameters>
    <ssv:Parameter name="r" id="p1" description="d"><ssv:Real value="-1.5e3" unit="m"/></ssv:Parameter>
    <ssv:Parameter name="i"><ssv:Integer value="-5"/></ssv:Parameter>
    <ssv:Parameter name="b"><ssv:Boolean value="false"/></ssv:Parameter>
    <ssv:Parameter name="s"><ssv:String value=""/></ssv:Parameter>
    <ssv:Parameter name="e"><ssv:Enumeration value="one" name="E"/></ssv:Parameter>
    <ssv:Parameter name="y"><ssv:Binary value="00ff" mime-type="a/b"/></ssv:Parameter>
  </ssv:Parameters>
  <ssv:Enumerations><ssc:Enumeration name="E"><ssc:Item name="one" value="1"/></ssc:Enumeration></ssv:Enumerations>
  <ssv:Units><ssc:Unit name="m"><ssc:BaseUnit m="1"/></ssc:Unit></ssv:Units>
</ssv:ParameterSet>)xml";

const std::string& document(Standard standard) {
  switch (standard) {
    case Standard::kFmi2:
      return kFmi2;
    case Standard::kFmi3:
      return kFmi3;
    case Standard::kSsd:
      return kSsd;
    case Standard::kSsv:
      return kSsv;
  }
  throw std::logic_error("no such standard");
}

constexpr std::array kAll = {Standard::kFmi2, Standard::kFmi3, Standard::kSsd, Standard::kSsv};

TEST(StandardValidator, AcceptsWhatTheStandardsAllow) {
  for (const Standard standard : kAll) EXPECT_THAT(faults(document(standard), standard), IsEmpty());
}

/// A change that breaks one rule, and the expected fault.
struct Breach {
  Standard standard;
  const char *from, *to, *message;
};

constexpr Standard k2 = Standard::kFmi2, k3 = Standard::kFmi3, kD = Standard::kSsd, kV = Standard::kSsv;

const Breach kSchemaBreaches[] = {
    {k2, "</fmiModelDescription>", "", "no well-formed XML"},
    {k2, "fmiVersion=\"2.0\" modelName", "fmiVersion=\"2.0\" fmiVersion=\"2.0\" modelName", "no well-formed XML"},
    {k2, "<x:any xmlns:x=\"urn:x\"", "<x:any", "no well-formed XML"},
    {kD, "1/SystemStructureDescription\"", "2/SystemStructureDescription\"", "is not the root"},
    {k2, " guid=\"{1}\"", "", "has no attribute 'guid'"},
    {k2, " guid=", " other=\"1\" guid=", "may not have the attribute 'other'"},
    {k2, "fmiVersion=\"2.0\"", "fmiVersion=\"2.1\"", "fmiVersion = '2.1', expected 2.0"},
    {k2, "canSerializeFMUstate=\"1\"", "canSerializeFMUstate=\"yes\"", "expected bool"},
    {k2, "start=\"-2\" min", "start=\"-2147483649\" min", "expected int"},
    {k2, "start=\"-2\" min", "start=\"1.0\" min", "expected int"},
    {k2, "valueReference=\"2\"", "valueReference=\"+2\"", "expected uint"},
    {k2, "stepSize=\".01\"", "stepSize=\"inf\"", "expected double"},
    {k2, "2024-02-29T12", "2023-02-29T12", "expected dateTime"},
    {k2, "causality=\"independent\"", "causality=\" independent\"", "expected parameter|calculatedParameter"},
    {k2, "dependencies=\"2 3\"", "dependencies=\"2 x\"", "expected uint*"},
    {k2, "dependent fixed", "dependent free", "expected dependent|constant|fixed|tunable|discrete*"},
    {k2, "<ModelVariables>", "<ModelVariables>text", "has text"},
    {k2, "<ModelVariables>", "<Other/><ModelVariables>", "<fmiModelDescription>: has elements"},
    {k2, "<UnitDefinitions>", "<ModelStructure/><UnitDefinitions>", "<fmiModelDescription>: has elements"},
    {k2, "<File name=\"a.c\"/>", "", "<SourceFiles>: has elements"},
    {k2, "<Real start=\"1\" unit=\"K\" displayUnit=\"degC\"/>", "", "<ScalarVariable>: has elements"},
    {k2, "<Boolean start=\"true\"/>", "<Boolean start=\"true\"/><String/>", "<ScalarVariable>: has elements"},
    {k2, "<File name=\"a.c\"/>", "<File name=\"a.c\"><b/></File>", "<File>: has elements"},
    {k3, "fmiVersion=\"3.0\"", "fmiVersion=\"3.\"", "expected fmi3version"},
    {k3, "start=\"-128\"", "start=\"-129\"", "expected byte*"},
    {k3, "start=\"255\"", "start=\"256\"", "expected ubyte*"},
    {k3, "start=\"-32768\"", "start=\"-32769\"", "expected short*"},
    {k3, "start=\"65535\"", "start=\"65536\"", "expected ushort*"},
    {k3, "start=\"-2147483648\"", "start=\"-2147483649\"", "expected int*"},
    {k3, "start=\"4294967295\"", "start=\"4294967296\"", "expected uint*"},
    {k3, "start=\"-9223372036854775808\"", "start=\"-9223372036854775809\"", "expected long*"},
    {k3, "start=\"18446744073709551615\"", "start=\"18446744073709551616\"", "expected ulong*"},
    {k3, "maxSize=\"3\"", "maxSize=\"-3\"", "expected natural"},
    {k3, "00fF", "00f", "expected hex"},
    {k3, "nominal=\"2\"", "nominal=\"2,5\"", "expected double"},
    {k3, " intervalVariability=\"constant\"", "", "has no attribute 'intervalVariability'"},
    {k3, "<Dimension valueReference=\"1\"/>", "<Alias name=\"v\"/><Dimension valueReference=\"1\"/>",
     "<Float64>: has elements"},
    {k3, "<InitialUnknown valueReference=\"4\"/>", "<Output valueReference=\"4\"/>", "<ModelStructure>: has elements"},
    {kD, "version=\"1.0\" name=\"all\"", "version=\"2.0\" name=\"all\"", "expected ssp1version"},
    {kD, "<ssd:Component name=\"a\"", "<ssd:Component name=\"\"", "expected nonempty"},
    {kD, " source=\"a.fmu\"", "", "has no attribute 'source'"},
    {kD, "kind=\"inout\"", "kind=\"both\"", "expected input|output"},
    {kD, "id=\"a\"", "id=\"root\"", "id 'root' is not unique"},
    {kD, "id=\"a\"", "id=\"1a\"", "expected id"},
    {kD, "<ssc:Boolean/>", "<ssd:Boolean/>", "<Connector>: has elements"},
    {kD, "<ssd:Elements>", "<ssd:Connections/><ssd:Elements>", "<System>: has elements"},
    {kV, "<ssv:Boolean value=\"false\"/>", "<ssv:Boolean/>", "has no attribute 'value'"},
    {kV, "<ssc:BaseUnit m=\"1\"/>", "", "<Unit>: has elements"},
};

const Breach kMeaningBreaches[] = {
    {k2, "modelIdentifier=\"all\" canGet", "modelIdentifier=\"a-b\" canGet", "is no identifier of C"},
    {k2, "canGetAndSetFMUstate=\"true\" ", "", "serialises states that it cannot get"},
    {k2, "name=\"m\"", "name=\"K\"", "unit 'K' is not unique"},
    {k2, "name=\"degF\"", "name=\"degC\"", "display unit 'degC' is not unique"},
    {k2, "SimpleType name=\"Choice\"", "SimpleType name=\"Length\"", "type 'Length' is not unique"},
    {k2, "name=\"two\" value=\"2\"", "name=\"one\" value=\"2\"", "item 'one' is not unique"},
    {k2, "name=\"two\" value=\"2\"", "name=\"two\" value=\"1\"", "value of an item '1' is not unique"},
    {k2, "Category name=\"logAll\"", "Category name=\"logError\"", "log category 'logError' is not unique"},
    {k2, "stopTime=\"1\"", "stopTime=\"-1\"", "ends before it starts"},
    {k2, "tolerance=\"1e-4\"", "tolerance=\"0\"", "tolerance is not positive"},
    {k2, "name=\"u\" valueReference", "name=\"x\" valueReference", "name 'x' is not unique"},
    {k2, "causality=\"calculatedParameter\" variability=\"fixed\"><Real declaredType=\"Length\"",
     "causality=\"independent\"><Real", "the independent variable '' is not unique"},
    {k2, "causality=\"input\" variability=\"discrete\"", "causality=\"input\" variability=\"fixed\"",
     "causality input with variability fixed"},
    {k2, "causality=\"input\" variability=\"discrete\"", "causality=\"input\" variability=\"continuous\"",
     "variability continuous of Integer"},
    {k2, "causality=\"input\" variability=\"discrete\"", "causality=\"input\" variability=\"discrete\" initial=\"exact\"",
     "initial = exact of input"},
    {k2, "<Boolean start=\"true\"/>", "<Boolean/>", "has no start value"},
    {k2, "<Real derivative=\"1\"/>", "<Real derivative=\"1\" start=\"0\"/>", "has a start value, but is calculated"},
    {k2, "unit=\"K\" displayUnit", "unit=\"R\" displayUnit", "unit 'R' is not defined"},
    {k2, "displayUnit=\"degC\"", "displayUnit=\"degR\"", "displayUnit 'degR' is none of unit 'K'"},
    {k2, "declaredType=\"Choice\"", "declaredType=\"None\"", "declaredType 'None' is not defined"},
    {k2, "declaredType=\"Choice\"", "declaredType=\"Length\"", "is of Real, not Enumeration"},
    {k2, "derivative=\"1\"", "derivative=\"99\"", "derivative of no other variable"},
    {k2, "derivative=\"1\"", "derivative=\"3\"", "derivative of no other variable"},
    {k2, "min=\"-3\" max=\"3\"", "min=\"3\" max=\"-3\"", "max is less than min"},
    {k2, "start=\"-2\" min", "start=\"-4\" min", "start -4 is out of range"},
    {k2, "<Unknown index=\"1\"", "<Unknown index=\"0\"", "is no variable"},
    {k2, "<Unknown index=\"6\" dependencies=\"\"/>", "<Unknown index=\"1\"/>", "stands twice among Outputs"},
    {k2, "<Unknown index=\"6\" dependencies=\"\"/>", "", "is an output that is not among those of ModelStructure"},
    {k2, "<Unknown index=\"6\" dependencies=\"\"/>", "<Unknown index=\"6\"/><Unknown index=\"8\"/>", "and is none"},
    {k2, "<Unknown index=\"2\"/><Unknown index=\"6\"/>", "<Unknown index=\"6\"/><Unknown index=\"2\"/>", "is out of order"},
    {k2, "<Derivatives><Unknown index=\"2\"/>", "<Derivatives><Unknown index=\"1\"/>", "is no derivative of a variable"},
    {k2, "dependencies=\"2 3\"", "dependencies=\"2 99\"", "depends on 99"},
    {k2, "\"dependent fixed\"", "\"dependent\"", "has 1 kinds of 2 dependencies"},
    {k2, "<CoSimulation modelIdentifier", "<ModelExchange modelIdentifier=\"all\"/><CoSimulation modelIdentifier",
     "ModelExchange stands there twice"},
    {k3, "name=\"i8\" valueReference=\"6\"", "name=\"i8\" valueReference=\"7\"", "value reference '7' is not unique"},
    {k3, "Alias name=\"x too\"", "Alias name=\"x\"", "name 'x' is not unique"},
    {k3, "<Dimension valueReference=\"1\"/>", "<Dimension/>", "expected either start or valueReference"},
    {k3, "<Dimension valueReference=\"1\"/>", "<Dimension valueReference=\"2\"/>", "is no structural parameter"},
    {k3, "<Dimension start=\"3\"/>", "<Dimension start=\"0\"/>", "start is 0"},
    {k3, "start=\"1 2\"", "start=\"1 2 3\"", "3 start values for 2 elements"},
    {k3, "clocks=\"18\" previous", "clocks=\"17\" previous", "belongs to a clock that is none"},
    {k3, "previous=\"20\"", "previous=\"4\"", "previous of no variable of its type"},
    {k3, " intervalDecimal=\"0.1\"", "", "a constant clock has no interval"},
    {k3, "nominal=\"2\"", "nominal=\"0\"", "nominal is 0"},
    {k3, "initial=\"exact\" declaredType", "declaredType", "has a start value, but is calculated"},
    {k3, "causality=\"independent\"", "causality=\"independent\" start=\"1\"", "has a start value, but is independent"},
    {kD, "endElement=\"a\" endConnector=\"u\"", "endElement=\"c\" endConnector=\"u\"", "element 'c' is not there"},
    {kD, "endElement=\"a\" endConnector=\"u\"", "endElement=\"a\" endConnector=\"v\"", "connector 'a.v' is not there"},
    {kD, "startConnector=\"u\" endElement", "startConnector=\"y\" endElement", "connects two connectors that take"},
    {kD, "<ssd:System name=\"b\"", "<ssd:System name=\"a\"", "element 'a' is not unique"},
    {kD, "Connector name=\"w\"", "Connector name=\"y\"", "connector 'y' is not unique"},
    {kD, "startConnector=\"w\" endElement=\"b\"", "startConnector=\"w\" endElement=\"a\"",
     "the connection to 'a.u' is not unique"},
    {kD, "unit=\"m\"", "unit=\"km\"", "unit 'km' is not there"},
    {kD, "Enumeration name=\"E\"/>", "Enumeration name=\"F\"/>", "enumeration 'F' is not there"},
    {kD, " source=\"b.ssv\"", "", "expected either a source or values"},
    {kD, "<ssv:Real value=\"1\"/>", "<ssv:Real/>", "has no attribute 'value'"},
    {kD, "stopTime=\"2\"", "stopTime=\"-2\"", "ends before it starts"},
    {kV, "Parameter name=\"i\"", "Parameter name=\"r\"", "parameter 'r' is not unique"},
    {kV, "unit=\"m\"", "unit=\"km\"", "unit 'km' is not there"},
    {kV, "name=\"E\"/>", "name=\"F\"/>", "enumeration 'F' is not there"},
};

TEST(StandardValidator, RefusesWhatTheSchemasRefuseRuleByRule) {
  for (const Breach& b : kSchemaBreaches) {
    const std::string broken = fmu::testing::replaced(document(b.standard), b.from, b.to);
    EXPECT_THAT(schema_faults(broken, b.standard), Contains(HasSubstr(b.message))) << b.from << " → " << b.to;
  }
}

TEST(StandardValidator, RefusesWhatTheTextsRefuseRuleByRule) {
  for (const Breach& b : kMeaningBreaches) {
    const std::string broken = fmu::testing::replaced(document(b.standard), b.from, b.to);
    EXPECT_THAT(schema_faults(broken, b.standard), IsEmpty()) << b.from << " → " << b.to;
    EXPECT_THAT(faults(broken, b.standard), Contains(HasSubstr(b.message))) << b.from << " → " << b.to;
  }
}

TEST(StandardValidator, RefusesAnFmuWithoutAnInterfaceType) {
  std::string broken = kFmi2;
  broken.erase(broken.find("<ModelExchange"), broken.find("<UnitDefinitions>") - broken.find("<ModelExchange"));
  EXPECT_THAT(faults(broken, Standard::kFmi2), Contains(HasSubstr("offers no interface")));
}

// Agreement with the schemas themselves, if they are present.

/// One random change to a document: an attribute's value; an attribute or an element removed, repeated, renamed or moved.
std::string mutated(const std::string& text, std::mt19937& random) {
  const auto below = [&](std::size_t n) { return std::uniform_int_distribution<std::size_t>(0, n - 1)(random); };
  struct Span {
    std::size_t begin, end;
  };
  std::vector<Span> values, attributes, tags, names;
  bool in_tag = false;
  for (std::size_t i = text.find("?>") + 2; i < text.size(); ++i) {
    if (text[i] == '<' && text[i + 1] != '/') {
      in_tag = true;
      const std::size_t end = text.find_first_of(" />\n", i);
      names.push_back({i + 1, end});
      const std::size_t close = text.find('>', i);
      if (text[close - 1] == '/') tags.push_back({i, close + 1});
      i = end - 1;
    } else if (text[i] == '>') {
      in_tag = false;
    } else if (in_tag && text[i] == '=') {
      const std::size_t begin = text.find_last_of(" \n", i), close = text.find('"', i + 2);
      if (text.compare(begin + 1, 5, "xmlns") != 0) {
        attributes.push_back({begin, close + 1});
        values.push_back({i + 2, close});
      }
      i = close;
    }
  }
  const auto replace = [&](Span at, const std::string& by) {
    return std::string(text).replace(at.begin, at.end - at.begin, by);
  };
  static const char* const kValues[] = {"",
                                        "0",
                                        "1",
                                        "-1",
                                        "1.5",
                                        "1e400",
                                        "NaN",
                                        "INF",
                                        "+3",
                                        " true ",
                                        "yes",
                                        "text",
                                        "input",
                                        "2 3",
                                        "00ff",
                                        "fixed",
                                        "12345678901234567890",
                                        "exact",
                                        "3.0",
                                        "-0",
                                        ".5e1",
                                        "2024-02-30T00:00:00Z",
                                        "2024-02-29T00:00:00Z",
                                        "a1"};
  const Span attribute = attributes[below(attributes.size())], tag = tags[below(tags.size())],
             name = names[below(names.size())];
  switch (below(8)) {
    case 0:
    case 1:
      return replace(values[below(values.size())], kValues[below(std::size(kValues))]);
    case 2:
      return replace(attribute, "");
    case 3:
      return replace(attribute, " unknown=\"1\"");
    case 4:
      return replace(tag, "");
    case 5:
      return replace(tag, text.substr(tag.begin, tag.end - tag.begin) + text.substr(tag.begin, tag.end - tag.begin));
    case 6: {  // moves an element of the document
      const Span other = tags[below(tags.size())];
      return std::string(text).insert(other.begin, text.substr(tag.begin, tag.end - tag.begin));
    }
    default: {  // inserts an empty element with the name of another
      const Span renamed{tag.begin + 1, text.find_first_of(" /", tag.begin)};
      return replace(renamed, text.substr(name.begin, name.end - name.begin));
    }
  }
}

TEST(StandardValidator, AgreesWithTheSchemasOnMutatedDocuments) {
  const fs::path schemas = fs::path(places::public_data("schemas"));
  if (!fs::exists(schemas) || std::system("xmllint --version >/dev/null 2>&1") != 0)
    GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests) and xmllint";
  static constexpr const char* kSchemas[] = {"fmi2/fmi2ModelDescription.xsd", "fmi3-3.0.2/fmi3ModelDescription.xsd",
                                             "ssp1/SystemStructureDescription.xsd", "ssp1/SystemStructureParameterValues.xsd"};
  constexpr int kMutants = 1500;
  for (const Standard standard : kAll) {
    const fmu::TemporaryFolder folder;
    std::mt19937 random(20240607);
    std::vector<std::string> mutants;
    for (int i = 0; i < kMutants; ++i) {
      std::string mutant = i == 0 ? document(standard) : mutated(document(standard), random);
      if (i % 3 == 2) mutant = mutated(mutant, random);
      std::ofstream(folder.path() / (std::to_string(i) + ".xml")) << mutant;
      mutants.push_back(std::move(mutant));
    }
    const std::string command = "cd '" + folder.path().string() + "' && ls *.xml | xargs xmllint --noout --nonet --schema '" +
                                (schemas / kSchemas[static_cast<std::size_t>(standard)]).string() + "' > output.txt 2>&1";
    static_cast<void>(std::system(command.c_str()));  // fails if a document is invalid
    const std::string output = "\n" + fmu::testing::read_text(folder.path() / "output.txt");
    int valid = 0, differing = 0;
    for (int i = 0; i < kMutants && differing < 10; ++i) {
      const bool accepted = output.find("\n" + std::to_string(i) + ".xml validates\n") != std::string::npos;
      const std::vector<std::string> found = schema_faults(mutants[static_cast<std::size_t>(i)], standard);
      valid += accepted ? 1 : 0;
      if (accepted == found.empty()) continue;
      ++differing;
      std::string of_schema;
      std::istringstream lines(output);
      for (std::string line; std::getline(lines, line);) {
        if (line.rfind(std::to_string(i) + ".xml", 0) == 0) of_schema += line + "\n";
      }
      ADD_FAILURE() << "mutant " << i << " of " << kSchemas[static_cast<std::size_t>(standard)] << "\nthe schema: " << of_schema
                    << "the validator: " << (found.empty() ? "valid" : found.front());
    }
    EXPECT_GT(valid, kMutants / 50) << "all mutants are invalid";
    EXPECT_LT(valid, kMutants * 49 / 50) << "all mutants are valid";
  }
}

}  // namespace
}  // namespace cotwin::testing::standard_validator_test
