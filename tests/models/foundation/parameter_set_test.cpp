#include "models/foundation/formats/parameter_set.h"

#include <gmock/gmock-more-matchers.h>
#include <gtest/gtest.h>

#include <bit>
#include <cmath>
#include <fstream>
#include <limits>
#include <random>
#include <sstream>

#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "tests/support/files.h"
#include "tests/support/places.h"
#include "tests/support/public_data.h"
#include "tests/support/standard_validator.h"
#include "tests/support/xmllint.h"

namespace cotwin::parameter_set_test {
namespace {

namespace fs = std::filesystem;

/// A set with the given content of ssv:Parameters, each line of the argument on a line of its own from line 2 on.
std::string set_with(const std::string& parameters, const std::string& after = "") {
  return "<ssv:ParameterSet version=\"1.0\" name=\"s\" "
         "xmlns:ssv=\"http://ssp-standard.org/SSP1/SystemStructureParameterValues\" "
         "xmlns:ssc=\"http://ssp-standard.org/SSP1/SystemStructureCommon\"><ssv:Parameters>\n" +
         parameters + "\n</ssv:Parameters>" + after + "</ssv:ParameterSet>\n";
}

std::string written(const ParameterSet& set) {
  std::ostringstream out;
  write_parameter_set(out, set);
  return out.str();
}

void expect_same(const ParameterSet& a, const ParameterSet& b) {
  EXPECT_EQ(a.name, b.name);
  ASSERT_EQ(a.values.size(), b.values.size());
  for (std::size_t i = 0; i < a.values.size(); ++i) {
    EXPECT_EQ(a.values[i].name, b.values[i].name);
    EXPECT_EQ(a.values[i].unit, b.values[i].unit);
    ASSERT_EQ(a.values[i].value.index(), b.values[i].value.index()) << a.values[i].name;
    if (const double* x = std::get_if<double>(&a.values[i].value); x != nullptr && !std::isnan(*x)) {
      EXPECT_EQ(std::bit_cast<std::uint64_t>(*x), std::bit_cast<std::uint64_t>(std::get<double>(b.values[i].value))) << *x;
    } else if (x != nullptr) {
      EXPECT_TRUE(std::isnan(std::get<double>(b.values[i].value)));
    } else {
      EXPECT_EQ(a.values[i].value, b.values[i].value) << a.values[i].name;
    }
  }
  ASSERT_EQ(a.units.size(), b.units.size());
  for (std::size_t i = 0; i < a.units.size(); ++i) {
    const UnitDefinition &u = a.units[i], &v = b.units[i];
    EXPECT_EQ(u.name, v.name);
    EXPECT_EQ((std::array{u.kg, u.m, u.s, u.A, u.K, u.mol, u.cd, u.rad}),
              (std::array{v.kg, v.m, v.s, v.A, v.K, v.mol, v.cd, v.rad}));
    EXPECT_EQ(u.factor, v.factor);
    EXPECT_EQ(u.offset, v.offset);
  }
}

/// Every kind of content of a set, including what is difficult to write.
ParameterSet demanding_set() {
  ParameterSet set;
  set.name = "drive & <\"data\"> 'of' µ";
  const double reals[] = {0.0, -0.0, 0.1, 1e-300, 5e-324, 1.7976931348623157e308, -3, INFINITY, -INFINITY, NAN, 1.0 / 3};
  for (const double x : reals)
    set.values.push_back({"r" + std::to_string(set.values.size()), x, x == 0.1 ? "N.m/rad" : "", ""});
  std::mt19937_64 random(7);
  for (int i = 0; i < 1000; ++i) {
    const double x = std::bit_cast<double>(random());
    if (std::isfinite(x)) set.values.push_back({"q[" + std::to_string(i + 1) + "]", x, "", ""});
  }
  set.values.push_back({"i", std::int64_t{std::numeric_limits<std::int32_t>::min()}, "", ""});
  set.values.push_back({"b", true, "", ""});
  set.values.push_back({"c", false, "", ""});
  set.values.push_back({"s & <t>", std::string(" blanks \t tab\nline\r\n \"quotes\" 'single' & < > ü €  "), "", ""});
  set.values.push_back({"empty", std::string(), "", ""});
  set.units.push_back({"N.m/rad", 1, 2, -2, 0, 0, 0, 0, -1, 1, 0});
  set.units.push_back({"°F", 0, 0, 0, 0, 1, 0, 0, 0, 5.0 / 9, 459.67 * 5 / 9});
  return set;
}

TEST(ParameterSetFile, ReadsBackWhatWasWrittenBitForBit) {
  const ParameterSet set = demanding_set();
  expect_same(set, parse_parameter_set(written(set), "memory"));
}

TEST(ParameterSetFile, IsWrittenTheSameEveryTime) {
  EXPECT_EQ(written(demanding_set()), written(parse_parameter_set(written(demanding_set()), "x")));
}

TEST(ParameterSetFile, FollowsTheStandard) {
  for (const ParameterSet& set : {demanding_set(), ParameterSet{"empty", {}, {}}}) {
    EXPECT_THAT(cotwin::testing::schema_faults(written(set), cotwin::testing::Standard::kSsv), ::testing::IsEmpty());
  }
}

TEST(ParameterSetFile, ValidatesAgainstTheSchema) {
  const fs::path schema = fs::path(places::public_data("schemas/ssp1/SystemStructureParameterValues.xsd"));
  if (!fs::exists(schema)) GTEST_SKIP() << "needs schemas (scripts/fetch_logs.py --tests)";
  for (const ParameterSet& set : {demanding_set(), ParameterSet{"empty", {}, {}}}) {
    const cotwin::testing::TemporaryFile file(written(set), "set.ssv");
    EXPECT_EQ(cotwin::testing::schema_errors(schema, file.path()), "");
  }
}

TEST(ParameterSetFile, IsReadAsOtherToolsWriteIt) {
  // Default namespace, byte order mark, comments, CDATA, foreign annotations and extensions, notations of numbers in XML
  // Schema.
  const ParameterSet set = parse_parameter_set(
      "\xEF\xBB\xBF<?xml version='1.0' encoding='utf-8'?><!-- by hand -->\n"
      "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' xmlns:x='urn:other' version='1.0' "
      "name='n'\n"
      "  generationTool='T' x:note='ignored'>\n"
      "<Parameters><!-- <nothing/> --><x:extension/>\n"
      "<Parameter name='a' id='i1' description='d'><Real value=' +1.5E3 ' unit='mm'/><Annotations/></Parameter>\n"
      "<Parameter name='b'><Real value='-INF'/></Parameter><Parameter name='c'><Boolean value='1'/></Parameter>\n"
      "<Parameter name='d'><Enumeration value='closed' name='Valve'/></Parameter><Parameter name='e'><Integer "
      "value='-7'/></Parameter>\n"
      "<Parameter name='f'><String value='&#x41;&lt;&amp;&quot;'/></Parameter>\n"
      "</Parameters>\n"
      "<Enumerations><Enumeration name='Valve'/></Enumerations>\n"
      "<Units><s:Unit name='mm' xmlns:s='http://ssp-standard.org/SSP1/SystemStructureCommon'><s:BaseUnit m='1' "
      "factor='0.001'/></s:Unit></Units>\n"
      "</ParameterSet>",
      "t.ssv");
  EXPECT_EQ(set.name, "n");
  ASSERT_EQ(set.values.size(), 6U);
  EXPECT_EQ(std::get<double>(set.values[0].value), 1500);
  EXPECT_EQ(set.values[0].unit, "mm");
  EXPECT_EQ(set.values[0].place, "t.ssv:5");
  EXPECT_EQ(std::get<double>(set.values[1].value), -INFINITY);
  EXPECT_EQ(std::get<bool>(set.values[2].value), true);
  EXPECT_EQ(std::get<std::string>(set.values[3].value), "closed");
  EXPECT_EQ(std::get<std::int64_t>(set.values[4].value), -7);
  EXPECT_EQ(std::get<std::string>(set.values[5].value), "A<&\"");
  ASSERT_EQ(set.units.size(), 1U);
  EXPECT_EQ(set.units[0].m, 1);
  EXPECT_EQ(set.units[0].factor, 1e-3);
}

struct Bad {
  const char* name;
  std::string xml;
  const char* message;  // starts with the place
};
void PrintTo(const Bad& bad, std::ostream* out) { *out << bad.name; }
class BadParameterSet : public ::testing::TestWithParam<Bad> {};

TEST_P(BadParameterSet, IsRefusedWithLineAndReason) {
  try {
    parse_parameter_set(GetParam().xml, "f.ssv");
    FAIL() << "was read";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), ::testing::StartsWith(GetParam().message));
  }
}

std::string units_with(const std::string& units) { return set_with("", "<ssv:Units>\n" + units + "</ssv:Units>"); }

INSTANTIATE_TEST_SUITE_P(
    Files, BadParameterSet,
    ::testing::Values(
        Bad{"Empty", "", "f.ssv: malformed XML"}, Bad{"NoXml", "K = 3", "f.ssv:1: malformed XML"},
        Bad{"Unclosed", "<a>\n<b>\n</a>", "f.ssv:2: malformed XML"},  // the element that is not closed
        Bad{"TwoRoots", "<a xmlns='u'/>\n<b/>", "f.ssv:2: a second root"},
        Bad{"OtherRoot", "<a/>", "f.ssv:1: 'a' of namespace ''"},
        Bad{"UnboundPrefix", "<p:ParameterSet/>", "f.ssv:1: the prefix 'p' has no namespace"},
        Bad{"NotUtf8", "<a>\n\xE9</a>", "f.ssv:2: byte 0xE9 is not UTF-8, expected UTF-8: iconv -f ISO-8859-1"},
        Bad{"Nul", std::string("<a>\0</a>", 8), "f.ssv:1: byte 0x00, a character"},
        Bad{"Deep",
            [] {
              std::string s;
              for (int i = 0; i < 100'000; ++i) s += "<a>";
              return s;
            }(),
            "f.ssv:1: malformed XML: elements nested too deeply"},
        Bad{"AttributeTwice", "<a b='1'\n b='2'/>", "f.ssv:2: malformed XML"},
        Bad{"AttributeTwiceByNamespace", "<a xmlns:p='u' xmlns:q='u'\n p:b='1' q:b='2'/>",
            "f.ssv:1: attribute 'q:b' is given twice"},
        Bad{"Version",
            "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='2.0' name='x'/>",
            "f.ssv:1: version '2.0'"},
        Bad{"NoName", "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0'/>",
            "f.ssv:1: 'ParameterSet' without the attribute 'name'"},
        Bad{"NoParameters",
            "<ParameterSet xmlns='http://ssp-standard.org/SSP1/SystemStructureParameterValues' version='1.0' name='x'/>",
            "f.ssv:1: parameter set 'x' without 'Parameters'"},
        Bad{"NameTwice",
            set_with("<ssv:Parameter name='K'><ssv:Real value='1'/></ssv:Parameter>\n\n<ssv:Parameter name='K'><ssv:Real "
                     "value='1'/></ssv:Parameter>"),
            "f.ssv:4: parameter 'K' is given twice, first at f.ssv:2"},
        Bad{"NoType", set_with("<ssv:Parameter name='K'/>"), "f.ssv:2: parameter 'K' without a value"},
        Bad{"TwoTypes", set_with("<ssv:Parameter name='K'><ssv:Real value='1'/>\n<ssv:Integer value='1'/></ssv:Parameter>"),
            "f.ssv:3: parameter 'K' has a second value"},
        Bad{"UnknownType", set_with("<ssv:Parameter name='K'>\n<ssv:Rael value='1'/></ssv:Parameter>"),
            "f.ssv:3: parameter 'K': 'Rael' is not a type, did you mean 'Real'?"},
        Bad{"Binary", set_with("<ssv:Parameter name='K'><ssv:Binary value='00'/></ssv:Parameter>"),
            "f.ssv:2: parameter 'K' is binary"},
        Bad{"NotANumber", set_with("<ssv:Parameter name='K'><ssv:Real value='1,5'/></ssv:Parameter>"),
            "f.ssv:2: attribute 'value' of 'Real': '1,5', expected a number"},
        Bad{"Huge", set_with("<ssv:Parameter name='K'><ssv:Real value='1e999'/></ssv:Parameter>"),
            "f.ssv:2: attribute 'value' of 'Real': '1e999'"},
        Bad{"HugeInteger", set_with("<ssv:Parameter name='K'><ssv:Integer value='2147483648'/></ssv:Parameter>"),
            "f.ssv:2: attribute 'value' of 'Integer': '2147483648', expected an integer of 32"},
        Bad{"NotABoolean", set_with("<ssv:Parameter name='K'><ssv:Boolean value='yes'/></ssv:Parameter>"),
            "f.ssv:2: attribute 'value' of 'Boolean': 'yes', expected 'true' or 'false'"},
        Bad{"UnknownAttribute", set_with("<ssv:Parameter name='K'><ssv:Real value='1' units='m'/></ssv:Parameter>"),
            "f.ssv:2: 'units' is not an attribute of 'Real', did you mean 'unit'?"},
        Bad{"UnknownElement", set_with("<ssv:Paramter name='K'/>"),
            "f.ssv:2: 'Paramter' is not an element of 'Parameters', did you mean 'Parameter'?"},
        Bad{"UnitTwice",
            units_with("<ssc:Unit name='x'><ssc:BaseUnit/></ssc:Unit>\n<ssc:Unit name='x'><ssc:BaseUnit/></ssc:Unit>"),
            "f.ssv:5: unit of measure 'x' is defined twice"},
        Bad{"UnitWithoutBase", units_with("<ssc:Unit name='x'/>"), "f.ssv:4: unit of measure 'x' without 'BaseUnit'"},
        Bad{"UnitFactorZero", units_with("<ssc:Unit name='x'><ssc:BaseUnit factor='0'/></ssc:Unit>"),
            "f.ssv:4: unit of measure 'x': factor 0"},
        Bad{"UnitExponent", units_with("<ssc:Unit name='x'><ssc:BaseUnit m='1.5'/></ssc:Unit>"),
            "f.ssv:4: attribute 'm' of 'BaseUnit': '1.5'"}),
    [](const auto& p) { return p.param.name; });

TEST(ParameterSetFile, ThatIsMissingIsNamed) {
  EXPECT_THAT([] { load_parameter_set("no/such.ssv"); },
              ::testing::ThrowsMessage<Error>(::testing::StartsWith("no/such.ssv: cannot be read")));
  EXPECT_THROW(load_parameter_set(::testing::TempDir()), Error);  // a folder
}

TEST(ParameterSetFile, IsNotWrittenWithInvalidValues) {
  EXPECT_THROW(written({"s", {{"i", std::int64_t{1} << 40, "", ""}}, {}}), Error);
  EXPECT_THROW(written({"s", {{"i", std::string("\x01"), "", ""}}, {}}), Error);
  EXPECT_THROW(written({"s", {{"i", std::string("\xC3\x28"), "", ""}}, {}}), Error);
}

TEST(XmlText, IsUtf8OfAllowedCharactersOnly) {
  for (const char* good : {"", "abc \t\r\n", "ü", "€", "\xF0\x9F\x98\x80", "\xEF\xBF\xBD"})
    EXPECT_TRUE(xml::is_xml_text(good)) << good;
  for (const char* bad :
       {"\x01", "\x1F", "\x80", "\xC0\x80", "\xC1\xBF", "\xC3", "\xE2\x82", "\xE0\x80\x80", "\xED\xA0\x80", "\xEF\xBF\xBE",
        "\xEF\xBF\xBF", "\xF0\x80\x80\x80", "\xF4\x90\x80\x80", "\xF8\x88\x80\x80\x80", "a\xFFz"}) {
    EXPECT_FALSE(xml::is_xml_text(bad)) << bad;
  }
}

TEST(Xml, ResolvesNamespacesByTheirScope) {
  const xml::Element root =
      xml::parse("<a xmlns='u' xmlns:p='v'><b xmlns='w' xmlns:p='x'><p:c p:d='1' d='2'/></b><p:e/></a>", "m");
  EXPECT_EQ(root.space, "u");
  const xml::Element* b = xml::child(root, "w", "b");
  ASSERT_NE(b, nullptr);
  const xml::Element* c = xml::child(*b, "x", "c");
  ASSERT_NE(c, nullptr);
  EXPECT_EQ(*xml::find(*c, "d"), "2");
  EXPECT_NE(xml::child(root, "v", "e"), nullptr);
}

TEST(Xml, PassesElementsOnAsTheyEnd) {
  std::vector<std::string> seen;
  const xml::Element root = xml::parse("<a x='1'><b><c/>text</b><b>more</b><d/></a>", "m",
                                       [&](std::span<const xml::Element> around, xml::Element& e) {
                                         std::string path;
                                         for (const xml::Element& outer : around) path += outer.name + "/";
                                         seen.push_back(path + e.name + "=" + e.content);
                                         return e.name != "b";
                                       });
  EXPECT_THAT(seen, ::testing::ElementsAre("a/b/c=", "a/b=", "a/b=more", "a/d="));
  ASSERT_EQ(root.children.size(), 1u);
  EXPECT_EQ(root.children[0].name, "d");
}

TEST(Xml, DeclaresNoEntities) {
  // 10⁹ words from a few lines, and an external file.
  const std::string laughs = "<!DOCTYPE a [<!ENTITY b 'ha'><!ENTITY c '&b;&b;'>]><a>&c;</a>";
  const auto error = [](const std::string& xml) {
    try {
      xml::parse(xml, "m");
    } catch (const Error& e) {
      return std::string(e.what());
    }
    return std::string("none");
  };
  EXPECT_THAT(error(laughs), ::testing::HasSubstr("m:1: malformed XML: a document type with declarations, expected none"));
  EXPECT_THAT(error("<!DOCTYPE a SYSTEM 'file:///etc/passwd'><a>&b;</a>"),
              ::testing::HasSubstr("an entity other than the five"));
  EXPECT_THAT(error("<a>&b;</a>"), ::testing::HasSubstr("an entity other than the five"));
  EXPECT_EQ(xml::parse("<!DOCTYPE a><a>&lt;&#228;</a>", "m").content, "<ä");
  EXPECT_EQ(xml::parse("\n\n<?xml version='1.0'?>\n<a/>", "m").place.text(), "m:4");
}

TEST(Xml, LimitsItsMemory) {
  // 30 MB of text would be a tree of more than 1 GB.
  std::string text = "<a>";
  for (int i = 0; i < 6'000'000; ++i) text += "<b/>\n";
  EXPECT_THAT([&] { xml::parse(text + "</a>", "m"); },
              ::testing::ThrowsMessage<Error>(::testing::HasSubstr("tree needs more than")));
}

// With a linear search over earlier prefixes or attributes this would take minutes.
TEST(Xml, TheTimeToReadGrowsWithTheTextAndNotWithItsSquare) {
  constexpr int kMany = 100'000;
  std::string text = "<a";
  for (int i = 0; i < kMany; ++i) text += " xmlns:p" + std::to_string(i) + "='u" + std::to_string(i) + "'";
  text += "><b";
  for (int i = 0; i < kMany; ++i) text += " p" + std::to_string(i) + ":x='1'";
  text += "/>";
  for (int i = 0; i < kMany; ++i) text += "<c xmlns:q='v'/>";
  const xml::Element root = xml::parse(text + "</a>", "m");
  EXPECT_EQ(root.children.size(), kMany + 1u);
  EXPECT_EQ(root.children[0].attributes.size(), static_cast<std::size_t>(kMany));
}

}  // namespace
}  // namespace cotwin::parameter_set_test
