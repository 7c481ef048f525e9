#include "components/unit/si.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::si::si_test {
namespace {

using Exponents = std::array<int, 8>;  // kg, m, s, A, K, mol, cd, rad
constexpr double kPi = std::numbers::pi;

Measure m(Exponents exponents, double factor = 1, double offset = 0) { return {exponents, factor, offset}; }

struct Case {
  const char* text;
  Measure expected;
};

class Spelling : public ::testing::TestWithParam<Case> {};

TEST_P(Spelling, IsReadExactly) {
  const Measure read = parse(GetParam().text);
  EXPECT_EQ(read.exponents, GetParam().expected.exponents) << GetParam().text;
  EXPECT_EQ(read.factor, GetParam().expected.factor) << GetParam().text;  // the double nearest to the factor
  EXPECT_EQ(read.offset, GetParam().expected.offset) << GetParam().text;
}

// Definitions: SI Brochure (9th ed.), tables 2, 4, 7 and 8; a litre is 1e-3 m³, a bar 1e5 Pa, 0 °C is 273.15 K.
INSTANTIATE_TEST_SUITE_P(Base, Spelling,
                         ::testing::Values(Case{"1", m({})}, Case{"-", m({})}, Case{"kg", m({1})}, Case{"m", m({0, 1})},
                                           Case{"s", m({0, 0, 1})}, Case{"A", m({0, 0, 0, 1})}, Case{"K", m({0, 0, 0, 0, 1})},
                                           Case{"mol", m({0, 0, 0, 0, 0, 1})}, Case{"cd", m({0, 0, 0, 0, 0, 0, 1})},
                                           Case{"rad", m({0, 0, 0, 0, 0, 0, 0, 1})}));
INSTANTIATE_TEST_SUITE_P(
    Derived, Spelling,
    ::testing::Values(Case{"N", m({1, 1, -2})}, Case{"J", m({1, 2, -2})}, Case{"W", m({1, 2, -3})}, Case{"Pa", m({1, -1, -2})},
                      Case{"bar", m({1, -1, -2}, 1e5)}, Case{"mbar", m({1, -1, -2}, 100)}, Case{"Hz", m({0, 0, -1})},
                      Case{"V", m({1, 2, -3, -1})}, Case{"C", m({0, 0, 1, 1})}, Case{"Ohm", m({1, 2, -3, -2})},
                      Case{"Ω", m({1, 2, -3, -2})}, Case{"H", m({1, 2, -2, -2})}, Case{"T", m({1, 0, -2, -1})},
                      Case{"Wb", m({1, 2, -2, -1})}, Case{"F", m({-1, -2, 4, 2})}, Case{"S", m({-1, -2, 3, 2})}));
INSTANTIATE_TEST_SUITE_P(
    Scaled, Spelling,
    ::testing::Values(Case{"g", m({1}, 1e-3)}, Case{"t", m({1}, 1e3)}, Case{"mg", m({1}, 1e-6)}, Case{"mm", m({0, 1}, 1e-3)},
                      Case{"cm", m({0, 1}, 1e-2)}, Case{"km", m({0, 1}, 1e3)}, Case{"um", m({0, 1}, 1e-6)},
                      Case{"µm", m({0, 1}, 1e-6)}, Case{"μm", m({0, 1}, 1e-6)}, Case{"nm", m({0, 1}, 1e-9)},
                      Case{"mm3", m({0, 3}, 1e-9)}, Case{"mm^2", m({0, 2}, 1e-6)}, Case{"km2", m({0, 2}, 1e6)},
                      Case{"L", m({0, 3}, 1e-3)}, Case{"ml", m({0, 3}, 1e-6)}, Case{"ms", m({0, 0, 1}, 1e-3)},
                      Case{"us", m({0, 0, 1}, 1e-6)}, Case{"ns", m({0, 0, 1}, 1e-9)}, Case{"min", m({0, 0, 1}, 60)},
                      Case{"h", m({0, 0, 1}, 3600)}, Case{"d", m({0, 0, 1}, 86400)}, Case{"kN", m({1, 1, -2}, 1e3)},
                      Case{"MPa", m({1, -1, -2}, 1e6)}, Case{"kHz", m({0, 0, -1}, 1e3)}, Case{"mA", m({0, 0, 0, 1}, 1e-3)},
                      Case{"km/h", m({0, 1, -1}, 1000.0 / 3600)}, Case{"mm/min", m({0, 1, -1}, 1 / 60e3)},
                      Case{"%", m({}, 1e-2)}, Case{"percent", m({}, 1e-2)}, Case{"ppm", m({}, 1e-6)},
                      Case{"cd/m2", m({0, -2, 0, 0, 0, 0, 1})}));
INSTANTIATE_TEST_SUITE_P(
    Angles, Spelling,
    ::testing::Values(Case{"deg", m({0, 0, 0, 0, 0, 0, 0, 1}, kPi / 180)}, Case{"°", m({0, 0, 0, 0, 0, 0, 0, 1}, kPi / 180)},
                      Case{"mrad", m({0, 0, 0, 0, 0, 0, 0, 1}, 1e-3)}, Case{"rev", m({0, 0, 0, 0, 0, 0, 0, 1}, 2 * kPi)},
                      Case{"rpm", m({0, 0, -1, 0, 0, 0, 0, 1}, 2 * kPi / 60)},
                      Case{"rev/min", m({0, 0, -1, 0, 0, 0, 0, 1}, 2 * kPi / 60)},
                      Case{"r/min", m({0, 0, -1, 0, 0, 0, 0, 1}, 2 * kPi / 60)}, Case{"1/min", m({0, 0, -1}, 1.0 / 60)},
                      Case{"deg/s", m({0, 0, -1, 0, 0, 0, 0, 1}, kPi / 180)}, Case{"rad/s^2", m({0, 0, -2, 0, 0, 0, 0, 1})}));
INSTANTIATE_TEST_SUITE_P(Temperatures, Spelling,
                         ::testing::Values(Case{"degC", m({0, 0, 0, 0, 1}, 1, 273.15)},
                                           Case{"°C", m({0, 0, 0, 0, 1}, 1, 273.15)},
                                           Case{"degF", m({0, 0, 0, 0, 1}, 5.0 / 9, 459.67 * 5 / 9)},
                                           // In a product a degree is a temperature difference: no offset.
                                           Case{"degC/s", m({0, 0, -1, 0, 1})}, Case{"J/(kg.degC)", m({0, 2, -2, 0, -1})},
                                           Case{"W/degC", m({1, 2, -3, 0, -1})}, Case{"degC2", m({0, 0, 0, 0, 2})}));

struct Same {
  std::vector<const char*> spellings;
};
class Spellings : public ::testing::TestWithParam<Same> {};

TEST_P(Spellings, OfOneMeasureAreReadAlike) {
  const Measure first = parse(GetParam().spellings.front());
  for (const char* other : GetParam().spellings) EXPECT_EQ(parse(other), first) << other;
}

INSTANTIATE_TEST_SUITE_P(AsToolsWriteThem, Spellings,
                         ::testing::Values(Same{{"N.m",      "Nm",        "N*m",         "N·m",           "N⋅m",
                                                 "N m",      " N.m ",     "J",           "W.s",           "Ws",
                                                 "kg.m2/s2", "m2.kg.s-2", "kg.m^2.s^-2", "kg m² s⁻²",     "kgm2/s2",
                                                 "(N.m)",    "N.m/1",     "1.N.m",       "m**2*kg*s**-2", "kg.m^(2)/s^(+2)"}},
                                           Same{{"m/s2", "m/s^2", "m.s-2", "m.s^-2", "m s-2", "m/s²", "N/kg", "m/(s.s)"}},
                                           Same{{"kg.m2", "kg.m^2", "kgm2", "kgm^2", "kg*m*m", "N.m.s2"}},
                                           Same{{"N.m/rad", "Nm/rad", "N.m.rad-1", "N m/rad"}},
                                           Same{{"N.m.s/rad", "Nms/rad", "N.m/(rad/s)", "Nm/(rad.s-1)", "Nm.s/rad"}},
                                           Same{{"rpm", "rev/min", "r/min", "min-1.rev"}}, Same{{"1/s", "s-1", "s^-1", "Hz"}},
                                           Same{{"kN.m", "kNm", "kN m", "kJ"}},
                                           // One '/' divides by all factors after it.
                                           Same{{"W/m2.K", "W/(m2.K)", "W.m-2.K-1"}}));

TEST(Measures, AreRefusedWithTheWordThatIsWrong) {
  const std::pair<const char*, const char*> cases[] = {{"", "nothing"},
                                                       {"   ", "nothing"},
                                                       {"Nx", "unknown symbol 'Nx'"},
                                                       {"N.", "symbol is expected"},
                                                       {"N..m", "expected a symbol"},
                                                       {"/s", "expected a symbol"},
                                                       {"m/", "symbol is expected"},
                                                       {"m/s/s", "second '/'"},
                                                       {"m^", "'^' without"},
                                                       {"m^x", "'^' without"},
                                                       {"(N.m", "without ')'"},
                                                       {"N.m)", "at its end"},
                                                       {"m100", "exponent"},
                                                       {"m99999999999999999999", "exponent"},
                                                       {"m60.m60", "exponent"},
                                                       {"ym99", "factor"},
                                                       {"2m", "expected a symbol"},
                                                       {"m;s", "at its end"},
                                                       {"kt", "unknown symbol"},
                                                       {"m2^3", "at its end"},
                                                       {"((((((((((m))))))))))", "deeply"},
                                                       {"kkg", "unknown symbol"},
                                                       {"\xff", "expected a symbol"}};
  for (const auto& [text, part] : cases) {
    try {
      parse(text);
      ADD_FAILURE() << "'" << text << "' was read";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(part), std::string::npos) << text << ": " << error.what();
    }
  }
  EXPECT_THROW(parse(std::string(100'000, '(')), Error);
  EXPECT_THROW(parse(std::string(100'000, 'm')), Error);
}

TEST(Measures, OfRandomTextAreReadOrRefused) {
  const std::string alphabet = "Nmsradkg1290-+^*./() %°µ²⁻";
  std::mt19937 random(20261120);
  int read = 0;
  for (int i = 0; i < 200'000; ++i) {
    std::string text;
    for (std::size_t n = random() % 12; n > 0; --n) text += alphabet[random() % alphabet.size()];
    try {
      const Measure measure = parse(text);
      EXPECT_TRUE(std::isnormal(measure.factor)) << text;
      ++read;
    } catch (const Error&) {
    }
  }
  EXPECT_GT(read, 1000);
}

TEST(Conversion, OfEveryPrefixIsExactlyAPowerOfTen) {
  const std::pair<const char*, double> prefixes[] = {
      {"Y", 1e24}, {"Z", 1e21}, {"E", 1e18},  {"P", 1e15},  {"T", 1e12},  {"G", 1e9},   {"M", 1e6},
      {"k", 1e3},  {"h", 1e2},  {"da", 1e1},  {"d", 1e-1},  {"c", 1e-2},  {"m", 1e-3},  {"u", 1e-6},
      {"µ", 1e-6}, {"n", 1e-9}, {"p", 1e-12}, {"f", 1e-15}, {"a", 1e-18}, {"z", 1e-21}, {"y", 1e-24}};
  for (const auto& [prefix, factor] : prefixes) {
    EXPECT_EQ(parse(std::string(prefix) + "m").factor, factor) << prefix;
    EXPECT_EQ(parse(std::string(prefix) + "N").factor, factor) << prefix;
  }
}

TEST(Conversion, ThereAndBackIsTheIdentityToOneUlp) {
  const std::pair<const char*, const char*> pairs[] = {{"mm", "m"},      {"um", "m"}, {"km", "mm"},    {"deg", "rad"},
                                                       {"rpm", "rad/s"}, {"ms", "s"}, {"ns", "h"},     {"bar", "Pa"},
                                                       {"kN.m", "N.mm"}, {"L", "m3"}, {"km/h", "m/s"}, {"kg.mm2", "kg.m2"},
                                                       {"%", "1"},       {"t", "g"},  {"mm3", "m3"}};
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> mantissa(-2, 2);
  std::uniform_int_distribution<int> exponent(-60, 60);
  for (const auto& [a, b] : pairs) {
    const Conversion there = conversion(parse(a), parse(b)), back = conversion(parse(b), parse(a));
    EXPECT_EQ(there.offset, 0);
    for (int i = 0; i < 10'000; ++i) {
      const double x = std::ldexp(mantissa(random), exponent(random));
      const double y = back.factor * (there.factor * x);
      const double ulp = std::nextafter(std::abs(x), INFINITY) - std::abs(x);
      // Two factors and two products are rounded, each by half an ulp at most; positive powers of ten are exact.
      EXPECT_LE(std::abs(y - x), 2 * ulp) << a << " " << b << " " << x;
    }
  }
  // If one of the two factors is an integer, there are fewer rounding errors.
  const Conversion to_m = conversion(parse("mm"), parse("m")), to_mm = conversion(parse("m"), parse("mm"));
  EXPECT_EQ(to_mm.factor, 1000);
  for (int i = 0; i < 10'000; ++i) {
    const double x = std::ldexp(mantissa(random), exponent(random));
    const double y = to_mm.factor * (to_m.factor * x);
    EXPECT_TRUE(y == x || y == std::nextafter(x, INFINITY) || y == std::nextafter(x, -INFINITY)) << x;
  }
}

TEST(Conversion, OfAMeasureToItselfIsExactlyOne) {
  for (const char* text : {"deg", "degF", "mm3", "rpm", "kN.m/deg"}) {
    const Conversion c = conversion(parse(text), parse(text));
    EXPECT_EQ(c.factor, 1) << text;
    EXPECT_EQ(c.offset, 0) << text;
  }
}

TEST(Conversion, OfTemperaturesMeetsTheFixedPoints) {
  const auto convert = [](double value, const char* from, const char* to) {
    const Conversion c = conversion(parse(from), parse(to));
    return c.factor * value + c.offset;
  };
  constexpr double kTolerance = 1e-12;  // K; some ulp of 500
  EXPECT_EQ(convert(0, "degC", "K"), 273.15);
  EXPECT_EQ(convert(0, "K", "degC"), -273.15);
  EXPECT_NEAR(convert(0, "degC", "degF"), 32, kTolerance);
  EXPECT_NEAR(convert(100, "degC", "degF"), 212, kTolerance);
  EXPECT_NEAR(convert(-40, "degF", "degC"), -40, kTolerance);  // where both scales have the same number
  EXPECT_NEAR(convert(0, "K", "degF"), -459.67, kTolerance);
  EXPECT_NEAR(convert(1, "degF/s", "degC/s"), 5.0 / 9, 1e-15);
}

TEST(Convertible, HoldsForTheSameExponentsAndTheRadianCounts) {
  EXPECT_TRUE(convertible(parse("N.m"), parse("J")));
  EXPECT_TRUE(convertible(parse("bar"), parse("N/mm2")));
  EXPECT_FALSE(convertible(parse("N.m"), parse("N")));
  EXPECT_FALSE(convertible(parse("rad/s"), parse("rad")));
  EXPECT_FALSE(convertible(parse("N.m"), parse("N.m/rad")));
  EXPECT_FALSE(convertible(parse("Hz"), parse("rad/s")));
}

TEST(Definitions, OfAFileAreUsed) {
  UnitDefinition d;
  d.name = "Grad Celsius";
  d.K = 1;
  d.offset = 273.15;
  EXPECT_EQ(from(d), parse("degC"));
}

TEST(Definitions, AreAddedForEveryMeasureThatASetUsesAndReadBackAlike) {
  ParameterSet set;
  set.units.push_back({"own", 1, 0, 0, 0, 0, 0, 0, 0, 7, 0});
  for (const char* unit : {"own", "N.m/rad", "", "degF", "N.m/rad", "mm"})
    set.values.push_back({"p" + std::to_string(set.values.size()), 1.0, unit, ""});
  define_units(set);
  ASSERT_EQ(set.units.size(), 4U);  // own, N.m/rad, degF, mm
  for (std::size_t i = 1; i < set.units.size(); ++i)
    EXPECT_EQ(from(set.units[i]), parse(set.units[i].name)) << set.units[i].name;
  EXPECT_EQ(set.units[0].factor, 7);
  set.values.push_back({"bad", 1.0, "furlong", ""});
  EXPECT_THROW(define_units(set), Error);
}

}  // namespace
}  // namespace cotwin::si::si_test
