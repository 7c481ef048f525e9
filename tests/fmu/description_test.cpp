// Foreign modelDescription.xml files: read correctly, or an Error with the line.
#include <gmock/gmock-matchers.h>
#include <gtest/gtest.h>

#include <array>
#include <map>
#include <sstream>

#include "components/unit/unit_table.h"
#include "fmu/check/check.h"
#include "fmu/description/dependencies.h"
#include "fmu/description/describe.h"
#include "fmu/description/read.h"
#include "fmu/import/unit/variables.h"
#include "models/foundation/support/error.h"
#include "tests/fmu/foreign.h"

namespace cotwin::fmu::description_test {
namespace {

using namespace testing;
using ::testing::Contains;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

ModelDescription parse(const std::string& xml) { return parse_model_description(xml, "md.xml"); }

/// FMI 2 or 3 with the given variables and structure.
std::string fmi2(const std::string& variables, const std::string& structure = "") {
  return "<fmiModelDescription fmiVersion='2.0' modelName='m' guid='g'>\n<CoSimulation "
         "modelIdentifier='m'/>\n<ModelVariables>\n" +
         variables + "\n</ModelVariables>\n<ModelStructure>" + structure + "</ModelStructure></fmiModelDescription>";
}
std::string fmi3(const std::string& variables, const std::string& structure = "") {
  return "<fmiModelDescription fmiVersion='3.0' modelName='m' instantiationToken='g'>\n<CoSimulation "
         "modelIdentifier='m'/>\n<ModelVariables>\n" +
         variables + "\n</ModelVariables>\n<ModelStructure>" + structure + "</ModelStructure></fmiModelDescription>";
}

TEST(ReadDescription, FillsInWhatTheStandardLeavesToDefaults) {
  const ModelDescription two =
      parse(fmi2("<ScalarVariable name='a' valueReference='7'><Real/></ScalarVariable>"
                 "<ScalarVariable name='p' valueReference='8' causality='parameter' variability='fixed'><Integer "
                 "start='3'/></ScalarVariable>"));
  EXPECT_EQ(two.variables[0].causality, Causality::kLocal);
  EXPECT_EQ(two.variables[0].variability, Variability::kContinuous);
  EXPECT_EQ(two.variables[0].initial, Initial::kCalculated);
  EXPECT_EQ(two.variables[1].initial, Initial::kExact);
  EXPECT_EQ(std::get<std::vector<std::int64_t>>(two.variables[1].start), std::vector<std::int64_t>{3});
  const ModelDescription three =
      parse(fmi3("<Int32 name='i' valueReference='1'/><Float32 name='f' valueReference='2'/>"
                 "<Float64 name='p' valueReference='3' causality='parameter' start='1'/>"));
  EXPECT_EQ(three.variables[0].variability, Variability::kDiscrete);
  EXPECT_EQ(three.variables[1].variability, Variability::kContinuous);
  EXPECT_EQ(three.variables[2].variability, Variability::kFixed);
  EXPECT_TRUE(three.co_simulation.has_value());
}

TEST(ReadDescription, ReadsArraysAliasesTypesAndSpecialNumbers) {
  const ModelDescription d = parse(
      "<fmiModelDescription fmiVersion='3.0.1' modelName='m' instantiationToken='g'><ModelExchange modelIdentifier='m'/>"
      "<UnitDefinitions><Unit name='deg'><BaseUnit rad='1' factor='0.0174532925199433'/></Unit></UnitDefinitions>"
      "<TypeDefinitions><Float64Type name='Angle' unit='deg' min='-INF' max='180' "
      "nominal='10'/></TypeDefinitions><ModelVariables>"
      "<UInt64 name='n' valueReference='1' causality='structuralParameter' variability='fixed' start='2'/>"
      "<Float64 name='A' valueReference='2' declaredType='Angle' causality='input' start='1 NaN 3 INF 5 6'><Dimension "
      "valueReference='1'/><Dimension start='3'/>"
      "<Alias name='B'/></Float64>"
      "<Binary name='b' valueReference='3' causality='input'><Start "
      "value='00fF'/></Binary></ModelVariables><ModelStructure/></fmiModelDescription>");
  EXPECT_EQ(DescriptionIndex(d).elements(d.variables[1]), 6u);
  EXPECT_EQ(DescriptionIndex(d).elements(d.variables[1], {{1, 5}}), 15u);
  EXPECT_EQ(DescriptionIndex(d).effective(d.variables[1]).unit, "deg");
  EXPECT_EQ(DescriptionIndex(d).effective(d.variables[1]).max, 180);
  EXPECT_EQ(d.variables[1].aliases.at(0).name, "B");
  EXPECT_EQ(std::get<std::vector<std::vector<std::uint8_t>>>(d.variables[2].start).at(0), (std::vector<std::uint8_t>{0, 255}));
  EXPECT_THROW(static_cast<void>(DescriptionIndex(d).elements(d.variables[1], {{1, 1ull << 40}})), Error);
}

TEST(ReadDescription, RefusesInvalidDescriptionsAndNamesTheLine) {
  const std::string a = "<Float64 name='a' valueReference='1'/>";
  const std::pair<std::string, const char*> wrong[] = {
      {"", "md.xml"},
      {"<a/>", "md.xml:1: <a>, expected <fmiModelDescription>"},
      {"<fmiModelDescription fmiVersion='1.0'/>", "FMI 1.0 is not supported"},
      {"<fmiModelDescription fmiVersion='4.0'/>", "FMI '4.0' is not supported"},
      {fmi3(a + a), "variable 'a' appears also at md.xml:4"},
      {fmi3(a + "<Float64 name='b' valueReference='1'/>"), "value reference 1 appears twice"},
      {fmi3("<Float64 name='' valueReference='1'/>"), "a variable's name is empty"},
      {fmi3("<Float64 name='a' valueReference='-1'/>"), "valueReference '-1'"},
      {fmi3("<Float64 name='a' valueReference='4294967296'/>"), "valueReference '4294967296'"},
      {fmi3("<Float65 name='a' valueReference='1'/>"), "<Float65>, expected the type of a variable"},
      {fmi3("<Float64 name='a' valueReference='1' causality='output '/>"), "causality 'output '"},
      {fmi3("<Float64 name='a' valueReference='1' start='x'/>"), "start 'x', expected numbers"},
      {fmi3("<Int8 name='a' valueReference='1' start='128'/>"), "start '128', expected integers in the range of Int8"},
      {fmi3("<UInt64 name='a' valueReference='1' start='18446744073709551616'/>"), "start '18446744073709551616'"},
      {fmi3("<Float64 name='a' valueReference='1' start='1 2'/>"), "2 start values for 1 elements"},
      {fmi3("<Float64 name='a' valueReference='1'><Dimension start='3000'/><Dimension start='4000'/></Float64>"),
       "more than 10000000 elements"},
      {fmi3("<Float64 name='a' valueReference='1'><Dimension start='18446744073709551615'/></Float64>"),
       "more than 10000000 elements"},
      {fmi3("<Float64 name='a' valueReference='1'><Dimension valueReference='9'/></Float64>"),
       "reference 9 is not a structural parameter"},
      {fmi3("<Boolean name='n' valueReference='9' causality='structuralParameter' start='true'/><Float64 name='a' "
            "valueReference='1'><Dimension valueReference='9'/></Float64>"),
       "reference 9 is not a structural parameter or constant of type UInt64"},
      {fmi3("<UInt64 name='n' valueReference='9' causality='structuralParameter'/>"), "'n' has no start value"},
      {fmi3("<Float64 name='a' valueReference='1'><Dimension/></Float64>"), "either start or valueReference"},
      {fmi3("<Float64 name='a' valueReference='1'><Alias name=''/></Float64>"), "an alias's name is empty"},
      {fmi3("<Int32 name='a' valueReference='1'/><Float64 name='b' valueReference='2' derivative='1'/>"),
       "derivative of 'a', expected a floating-point variable"},
      {fmi3("<Float64 name='a' valueReference='1' derivative='5'/>"), "derivative '5'"},
      {fmi3("<Float64 name='a' valueReference='1' declaredType='T'/>"), "type 'T' is not defined"},
      {fmi3("<Int32 name='a' valueReference='1' clocks='2'/>"), "clock 2 is not a variable of type Clock"},
      {fmi3("<Binary name='a' valueReference='1'><Start value='0'/></Binary>"), "even number"},
      {fmi3(a, "<Output valueReference='2'/>"), "valueReference '2', expected the value reference of a variable"},
      {fmi3(a, "<Output valueReference='1' dependencies='1' dependenciesKind='fixed fixed'/>"), "differs in length"},
      {fmi3(a, "<ContinuousStateDerivative valueReference='1'/>"), "'a' is not the derivative of a variable"},
      {fmi2("<ScalarVariable name='a' valueReference='1'/>"), "a variable without Real"},
      {fmi2("<Real name='a' valueReference='1'/>"), "expected <ScalarVariable>"},
      {fmi2("<ScalarVariable name='a' valueReference='1'><Real min='2' max='1'/></ScalarVariable>"), "min is greater than max"},
      {fmi2("<ScalarVariable name='a' valueReference='1'><Real derivative='2'/></ScalarVariable>"), "derivative '2'"},
      {fmi2("<ScalarVariable name='a' valueReference='1'><Real/></ScalarVariable>", "<Outputs><Unknown index='2'/></Outputs>"),
       "index '2'"},
      {fmi2("<ScalarVariable name='a' valueReference='1'><Real/></ScalarVariable>", "<Outputs><Unknown index='0'/></Outputs>"),
       "index '0'"},
      {replaced(fmi2(""), "modelIdentifier='m'", "modelIdentifier='../m'"), "modelIdentifier '../m'"},
      {replaced(fmi2(""), "<CoSimulation modelIdentifier='m'/>", ""), "neither ModelExchange nor CoSimulation"},
      {replaced(fmi2(""), "<ModelStructure></ModelStructure>", ""), "no ModelStructure"},
      {replaced(fmi2(""), "guid='g'", ""), "guid"},
  };
  for (const auto& [xml, expected] : wrong) {
    const std::string& text = xml;
    EXPECT_THAT([&] { parse(text); }, ThrowsMessage<Error>(HasSubstr(expected))) << xml;
  }
}

// Writer and reader check each other.
TEST(ReadDescription, ReadsWhatWasWritten) {
  for (const char* name : {"rogue2", "rogue3", "ball2", "ball3"}) {
    const ModelDescription first = parse(description_of(name));
    std::ostringstream xml;
    write(xml, first);
    const ModelDescription second = parse(xml.str());
    EXPECT_EQ(first.variables, second.variables) << name << '\n' << xml.str();
    EXPECT_EQ(first.structure, second.structure) << name;
    EXPECT_EQ(first.types, second.types);
    EXPECT_EQ(first.co_simulation, second.co_simulation);
    EXPECT_EQ(first.model_exchange, second.model_exchange);
    EXPECT_EQ(first.log_categories, second.log_categories);
    EXPECT_EQ(first.default_experiment, second.default_experiment);
    EXPECT_EQ(first.token, second.token);
  }
}

std::string scalar(const std::string& name, int reference, const std::string& content = "<Real start='1' unit='rad'/>",
                   const std::string& causality = "input") {
  return "<ScalarVariable name='" + name + "' valueReference='" + std::to_string(reference) + "' causality='" + causality +
         "'>" + content + "</ScalarVariable>";
}

TEST(ForeignVectors, AreBuiltFromScalarsWithEqualAttributesButForTheirUnits) {
  const ModelDescription d = parse(
      fmi2(scalar("q[2]", 2, "<Real start='20' unit='rad'/>") + scalar("u", 9) +
           scalar("q[1]", 1, "<Real start='10' unit='rad'/>") + scalar("q[3]", 3, "<Real start='30' unit='rad'/>") +
           scalar("A[1,1]", 4) + scalar("x[0]", 5) + scalar("x[1]", 6) + scalar("y[1]", 7) +
           scalar("y[2]", 8, "<Real start='1' unit='m'/>") + scalar("z[1]", 10) + scalar("z[3]", 11) + scalar("w[1]", 12)));
  ForeignVariables foreign(d, {});
  Variables v;
  foreign.declare(v);
  std::vector<std::string> names;
  for (const Variable& variable : v) names.push_back(variable.name);
  EXPECT_THAT(names, ElementsAre("q", "u", "A[1,1]", "x[0]", "x[1]", "y", "z[1]", "z[3]", "w[1]"));
  EXPECT_THAT(v.at("q").reals(), ElementsAre(10, 20, 30));
  EXPECT_EQ(v.at("y").si, "");
  EXPECT_EQ(v.at("y").si_of(0), "rad");
  EXPECT_EQ(v.at("y").si_of(1), "m");
  EXPECT_EQ(find_element(v, "q[2]").element, 1);
  EXPECT_EQ(find_element(v, "A[1,1]").element, -1);
  EXPECT_EQ(find_element(v, "x[1]").variable, &v.at("x[1]"));
  EXPECT_EQ(find_element(v, "q[0]").variable, nullptr);
}

TEST(ForeignUnits, AreReadByDefinitionThenByNameAndOtherwiseKept) {
  const std::string xml =
      replaced(fmi2(scalar("a", 1, "<Real start='90' unit='deg'/>") + scalar("b", 2, "<Real start='1' unit='mm'/>") +
                    scalar("c", 3, "<Real start='1' unit='K'/>") + scalar("d", 4, "<Real start='20' unit='degC'/>") +
                    scalar("e", 5, "<Real start='20' unit='degC' relativeQuantity='true'/>") +
                    scalar("f", 6, "<Real start='2' unit='smoot' min='1' max='3'/>") + scalar("g", 7, "<Real start='5'/>") +
                    scalar("h", 8, "<Real start='5' unit='foo'/>") + scalar("i", 9, "<Real start='3' unit='N.m'/>")),
               "<ModelVariables>",
               "<UnitDefinitions><Unit name='smoot'><BaseUnit m='1' factor='1.702'/></Unit></UnitDefinitions><ModelVariables>");
  const ModelDescription d = parse(xml);
  ForeignVariables foreign(d, {});
  Variables v;
  foreign.declare(v);
  const auto value = [&](const char* name) { return v.at(name).reals()[0]; };
  EXPECT_EQ(v.at("a").si, "rad");
  EXPECT_NEAR(value("a"), 1.5707963267948966, 1e-15);
  EXPECT_EQ(v.at("b").si, "m");
  EXPECT_DOUBLE_EQ(value("b"), 1e-3);
  EXPECT_DOUBLE_EQ(value("d"), 293.15);
  EXPECT_DOUBLE_EQ(value("e"), 20);
  EXPECT_TRUE(v.at("e").relative);
  EXPECT_FALSE(v.at("d").relative);
  EXPECT_EQ(v.at("f").si, "m");
  EXPECT_DOUBLE_EQ(value("f"), 3.404);
  EXPECT_DOUBLE_EQ(v.at("f").min, 1.702);
  EXPECT_DOUBLE_EQ(v.at("f").max, 5.106);
  EXPECT_EQ(v.at("g").si, "");
  EXPECT_EQ(v.at("h").si, "");
  EXPECT_EQ(value("h"), 5);
  EXPECT_EQ(v.at("i").si, "N.m");
  EXPECT_THAT(foreign.warnings(), ElementsAre(HasSubstr("unit 'foo'")));
}

std::map<std::string, double> nominals_of(const ModelDescription& d) {
  ForeignVariables foreign(d, {});
  Variables v;
  foreign.declare(v);
  std::map<std::string, double> found;
  for (const Variable& variable : v) found[variable.name] = variable.nominal;
  return found;
}

TEST(ForeignNominals, AreMagnitudesInSi) {
  const auto real = [](const char* attributes) { return "<Real start='1' " + std::string(attributes) + "/>"; };
  const auto two = nominals_of(parse(
      replaced(fmi2(scalar("a", 1, real("unit='mm' nominal='20'")) + scalar("b", 2, real("declaredType='T'")) +
                    scalar("c", 3, real("declaredType='T' nominal='2'")) + scalar("d", 4, real("unit='degC' nominal='20'")) +
                    scalar("e", 5, real("nominal='-3'")) + scalar("f", 6, real("nominal='0'")) +
                    scalar("g", 7, real("nominal='INF'")) + scalar("h", 8, real("")) + scalar("i", 9, "<Integer start='1'/>")),
               "<ModelVariables>",
               "<UnitDefinitions><Unit name='smoot'><BaseUnit m='1' factor='-1.702'/></Unit></UnitDefinitions>"
               "<TypeDefinitions><SimpleType name='T'><Real unit='smoot' nominal='10'/></SimpleType></TypeDefinitions>"
               "<ModelVariables>")));
  EXPECT_DOUBLE_EQ(two.at("a"), 0.02);
  EXPECT_DOUBLE_EQ(two.at("b"), 17.02);
  EXPECT_DOUBLE_EQ(two.at("c"), 3.404);
  EXPECT_DOUBLE_EQ(two.at("d"), 20);  // of a difference in K
  EXPECT_EQ(two.at("e"), 3);
  for (const char* none : {"f", "g", "h", "i"}) EXPECT_EQ(two.at(none), 0) << none;

  const auto three = nominals_of(parse(
      replaced(fmi3("<Float64 name='a' valueReference='1' declaredType='T' causality='input' start='1 2'><Dimension start='2'/>"
                    "</Float64><Float32 name='b' valueReference='2' nominal='0.5'/><Float64 name='c' valueReference='3'/>"),
               "<ModelVariables>",
               "<UnitDefinitions><Unit name='kN'><BaseUnit kg='1' m='1' s='-2' factor='1000'/></Unit></UnitDefinitions>"
               "<TypeDefinitions><Float64Type name='T' unit='kN' nominal='4'/></TypeDefinitions><ModelVariables>")));
  EXPECT_DOUBLE_EQ(three.at("a"), 4000);
  EXPECT_EQ(three.at("b"), 0.5);
  EXPECT_EQ(three.at("c"), 0);
}

TEST(ForeignNominals, OfTheElementsOfAVectorTheSmallestCounts) {
  const auto found = nominals_of(
      parse(replaced(fmi2(scalar("q[1]", 1, "<Real start='1' nominal='5'/>") + scalar("q[2]", 2, "<Real start='1'/>") +
                          scalar("q[3]", 3, "<Real start='1' nominal='0.1'/>")),
                     "modelName='m'", "modelName='m' variableNamingConvention='structured'")));
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found.at("q"), 0.1);
}

/// A unit with nominal values.
class Scaled final : public Unit {
 public:
  void declare(Variables& v) override {
    v.input("u", u_, "N", "force").nominal(1e-3 / 7);
    v.output("y", y_, "m", "positions").range(-1, 1).nominal(250);
    v.output("plain", plain_, "m", "without a nominal value");
  }
  void initialise(Time) override {}
  StepResult step(Time, Duration) override { return StepResult::kDone; }

 private:
  double u_ = 0, plain_ = 0;
  std::array<double, 2> y_{};
};

TEST(ForeignNominals, ComeBackFromTheDescriptionOfAnExportedUnit) {
  const UnitType type{"scaled", "a unit with nominal values", nullptr};
  Scaled unit;
  Variables variables;
  unit.declare(variables);
  for (const Version version : {Version::k2, Version::k3}) {
    std::ostringstream xml;
    write(xml, describe(type, unit, variables, version));
    const auto found = nominals_of(parse(xml.str()));
    EXPECT_EQ(found.at("u"), 1e-3 / 7);
    EXPECT_EQ(found.at("y"), 250);
    EXPECT_EQ(found.at("plain"), 0);
  }
}

TEST(CheckDescription, FindsNothingInValidDescriptions) {
  for (const char* name : {"rogue3", "ball2", "ball3"}) {
    for (const Finding& finding : check_description(parse(description_of(name)))) ADD_FAILURE() << name << ": " << finding.text;
  }
}

TEST(CheckDescription, FindsWhatTheStandardForbids) {
  const auto texts = [](const std::string& xml) {
    std::vector<std::string> all;
    for (const Finding& f : check_description(parse(xml))) all.push_back(f.text);
    return all;
  };
  EXPECT_THAT(texts(fmi2(scalar("a", 1, "<Real/>"))), Contains(HasSubstr("'a' has no start value")));
  EXPECT_THAT(texts(fmi2(scalar("a", 1, "<Real unit='m'/>", "output"))), Contains(HasSubstr("not listed in ModelStructure")));
  EXPECT_THAT(texts(fmi2(scalar("a", 1, "<Real unit='m'/>", "output"))),
              Contains(HasSubstr("the unit 'm', which is not defined")));
  EXPECT_THAT(texts(fmi3("<Float64 name='a' valueReference='1' start='1'/>")),
              Contains(HasSubstr("must not have a start value")));
  const auto aliases = [&](const std::string& second) {
    return texts(fmi2(scalar("a", 1, "<Real start='1'/>") + scalar("b", 1, second)));
  };
  EXPECT_THAT(aliases("<Real start='2'/>"),
              Contains("variables 'a' and 'b' have the same value reference 1 and different start "
                       "values, expected one start value"));
  EXPECT_THAT(aliases("<Real start='1'/>"), Contains(HasSubstr("the same value reference 1 and a start value each")));
  EXPECT_THAT(aliases("<Integer start='2'/>"), ::testing::Not(Contains(HasSubstr("value reference"))));
  EXPECT_THAT(texts(fmi3("<Float64 name='a' valueReference='1' causality='input' start='1' min='2'/>")),
              Contains(HasSubstr("has a start value outside its range: 1")));
  for (const std::string number : {"nan", "inf"}) {
    EXPECT_THAT(texts(fmi3("<Float64 name='a' valueReference='1' causality='input' start='" + number + "'/>")),
                Contains(HasSubstr("has the start value " + number + ", expected a finite number")));
  }
  EXPECT_THAT(texts(fmi3("<Float64 name='a' valueReference='1'/>", "<Output valueReference='1'/><Output valueReference='1'/>")),
              ::testing::AllOf(Contains(HasSubstr("listed as an output in ModelStructure, but its causality is not output")),
                               Contains(HasSubstr("appears twice"))));
}

/// `n` variables, each with a type, a unit of measure and an entry in the structure; in pairs of a state and its derivative.
std::string many(std::size_t n, bool two) {
  std::string units, types, variables, structure;
  const std::string reference = two ? "index" : "valueReference";
  for (std::size_t i = 0; i < n; ++i) {
    const std::string k = std::to_string(i), name = "model.part" + k + ".value";
    if (i % 10 == 0) {
      units += "<Unit name='u" + k + "'><BaseUnit m='1' factor='" + std::to_string(i + 2) + "'/></Unit>";
      const std::string unit = " unit='u" + k + "'";
      types += two ? "<SimpleType name='T" + k + "'><Real" + unit + "/></SimpleType>"
                   : "<Float64Type name='T" + k + "'" + unit + "/>";
    }
    const std::string type = " declaredType='T" + std::to_string(i - i % 10) + "'";
    const std::string slope = i % 2 == 1 ? " derivative='" + std::to_string(two ? i : i - 1) + "'" : "";
    if (two) {
      variables += "<ScalarVariable name='" + name + "' valueReference='" + k + "' causality='output'><Real" + type + slope +
                   "/></ScalarVariable>";
      structure += "<Unknown index='" + std::to_string(i + 1) + "'/>";
    } else {
      variables += "<Float64 name='" + name + "' valueReference='" + k + "' causality='output'" + type + slope + ">" +
                   (i % 4 == 0 ? "<Dimension valueReference='" + std::to_string(n) + "'/>" : "") + "</Float64>";
      structure += "<Output valueReference='" + k + "'/>";
    }
  }
  if (!two)
    variables += "<UInt64 name='size' valueReference='" + std::to_string(n) + "' causality='structuralParameter' start='2'/>";
  return std::string("<fmiModelDescription modelName='m' ") +
         (two ? "fmiVersion='2.0' guid='g'" : "fmiVersion='3.0' instantiationToken='g'") +
         "><CoSimulation modelIdentifier='m'/><UnitDefinitions>" + units + "</UnitDefinitions><TypeDefinitions>" + types +
         "</TypeDefinitions><ModelVariables>" + variables + "</ModelVariables><ModelStructure>" +
         (two ? "<Outputs>" + structure + "</Outputs>" : structure) + "</ModelStructure></fmiModelDescription>";
}

// With a linear search for variables, types, units or derivatives this would take hours.
TEST(ReadDescription, TheTimeItTakesGrowsWithTheVariablesAndNotWithTheirSquare) {
  constexpr std::size_t kMany = 100'000;
  for (const bool two : {true, false}) {
    const ModelDescription d = parse(many(kMany, two));
    EXPECT_EQ(d.structure.outputs.size(), kMany);
    EXPECT_EQ(*d.variables[kMany - 1].derivative, kMany - 2);
    EXPECT_TRUE(check_description(d).empty());
    ForeignVariablesOptions options;
    options.slopes = true;
    ForeignVariables foreign(d, options);
    Variables variables;
    foreign.declare(variables);
    const Variable* const last = variables.find("model.part" + std::to_string(kMany - 1) + ".value");
    ASSERT_NE(last, nullptr);
    EXPECT_EQ(last->si, "m");
    EXPECT_EQ(variables.at("model.part0.value").size(), two ? 1u : 2u);
  }
}

TEST(ReadDescription, MoreVariablesThanAnyFmuHasAreRefused) {
  std::string variables;
  for (int i = 0; i < 2'000'001; ++i) variables += "<Int8 name='a' valueReference='1'/>";
  EXPECT_THAT([&] { parse(fmi3(variables)); }, ThrowsMessage<Error>(HasSubstr("more than 2000000 variables")));
}

TEST(ReadDescription, TheStructureMayPrecedeTheVariables) {
  for (const bool two : {true, false}) {
    const std::string xml = many(10, two);
    const std::size_t a = xml.find("<ModelVariables>"), b = xml.find("<ModelStructure>"),
                      c = xml.find("</fmiModelDescription>");
    const ModelDescription moved = parse(xml.substr(0, a) + xml.substr(b, c - b) + xml.substr(a, b - a) + xml.substr(c));
    EXPECT_EQ(moved.structure, parse(xml).structure);
    EXPECT_EQ(moved.variables, parse(xml).variables);
  }
}

// Scalars q[1], q[2] of FMI 2 are one vector of the imported unit; arrays of FMI 3 have one name.
TEST(DeclaredDependencies, AreThoseOfTheElements) {
  ModelDescription d;
  for (const char* name : {"u[1]", "u[2]", "y[1]", "y[2]", "a", "b", "c"}) d.variables.emplace_back().name = name;
  d.structure.outputs = {{2, std::vector<std::size_t>{0}, {}},
                         {3, std::vector<std::size_t>{1}, {}},
                         {5, std::vector<std::size_t>{0, 4}, {}},
                         {6, std::nullopt, {}}};
  const auto depends = [&](const char* output, std::size_t row, const char* input, std::size_t column) {
    Variable y, u;
    y.name = output;
    u.name = input;
    return declares_dependency(d, y, row, u, column);
  };
  EXPECT_TRUE(depends("y", 0, "u", 0));
  EXPECT_FALSE(depends("y", 0, "u", 1));
  EXPECT_TRUE(depends("y", 1, "u", 1));
  EXPECT_FALSE(depends("y", 1, "a", 0));
  EXPECT_TRUE(depends("b", 0, "a", 0));
  EXPECT_TRUE(depends("b", 1, "a", 2));  // an array: any of its elements
  EXPECT_TRUE(depends("b", 0, "u", 0));
  EXPECT_FALSE(depends("c", 0, "a", 0));  // not declared
}

}  // namespace
}  // namespace cotwin::fmu::description_test
