// Compares composed paths with the same path evaluated connection by connection.
#include "master/scenario/path.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"

namespace cotwin::master::ssp::ssp_path_test {
namespace {

struct Hop {
  Transformation transformation;
  std::string unit;  // "": not given
};

struct Walk {
  std::string start_own, start_given;  // the variable's own unit of measure, and that of the file
  std::vector<Hop> hops;
  std::string end_own;
};

double converted(double x, const std::string& from, const std::string& to) {
  const si::Conversion c = si::conversion(si::parse(from), si::parse(to));
  return c.factor * x + c.offset;
}

/// SSP, one connection at a time: convert if both ends have a unit of measure and conversion is not suppressed, then transform.
/// A system's connector without a unit has that of the arriving value, or none if conversion was suppressed; a component's
/// variable has its own.
double walked(const Walk& w, double x) {
  std::string unit = w.start_own;
  if (!w.start_given.empty()) {
    x = converted(x, unit, w.start_given);
    unit = w.start_given;
  }
  for (std::size_t i = 0; i < w.hops.size(); ++i) {
    const Hop& hop = w.hops[i];
    std::string next = hop.unit;
    if (next.empty() && i + 1 == w.hops.size()) next = w.end_own;
    if (hop.transformation.suppress_unit_conversion) {
      unit = next;
    } else if (!next.empty()) {
      if (!unit.empty()) x = converted(x, unit, next);
      unit = next;
    }
    x = hop.transformation.factor * x + hop.transformation.offset;
  }
  return unit.empty() ? x : converted(x, unit, w.end_own);
}

/// The result of the wiring for a composed path: the variable's unit to the given one, factor and offset, the given one to the
/// variable's.
double composed(const Walk& w, const Path::Result& r, double x) {
  const std::string from = r.from_unit.empty() ? w.start_own : r.from_unit, to = r.to_unit.empty() ? w.end_own : r.to_unit;
  x = converted(x, w.start_own, from);
  if (!r.suppress_unit_conversion) x = converted(x, from, to);
  return converted(r.factor * x + r.offset, to, w.end_own);
}

std::string describe(const Walk& w) {
  std::string text = w.start_own + "(" + w.start_given + ")";
  for (const Hop& h : w.hops) {
    text += " -" + std::string(h.transformation.suppress_unit_conversion ? "!" : "") + std::to_string(h.transformation.factor) +
            "," + std::to_string(h.transformation.offset) + "-> [" + h.unit + "]";
  }
  return text + " " + w.end_own;
}

TEST(Path, EqualsTheConnectionsOneByOne) {
  UnitTable units;
  const std::vector<std::string> measures = {"K", "degC", "degF", "mK"};  // scales with and without offset
  std::mt19937 random(42);
  const auto any = [&] { return measures[random() % measures.size()]; };
  int agreed = 0, refused = 0;
  for (int trial = 0; trial < 100'000; ++trial) {
    Walk w;
    w.start_own = any();
    if (random() % 2 == 0) w.start_given = any();
    w.end_own = any();
    for (std::size_t n = 1 + random() % 4; n > 0; --n) {
      Hop h;
      if (random() % 3 == 0) h.transformation.factor = static_cast<double>(static_cast<int>(random() % 9)) - 4;
      if (random() % 3 == 0) h.transformation.offset = static_cast<double>(static_cast<int>(random() % 9)) - 4;
      h.transformation.suppress_unit_conversion = random() % 5 == 0;
      if (random() % 4 != 0) h.unit = any();
      w.hops.push_back(h);
    }
    const bool none_given =
        w.start_given.empty() && std::all_of(w.hops.begin(), w.hops.end(), [](const Hop& h) { return h.unit.empty(); });
    if (none_given) w.end_own = w.start_own;  // then the file does not determine in which of two units a transformation applies
    try {
      Path path(units, Path::Start::kVariable, w.start_given);
      for (std::size_t i = 0; i < w.hops.size(); ++i)
        path.pass(w.hops[i].transformation, w.hops[i].unit, i + 1 == w.hops.size(), "here");
      const Path::Result r = path.result("here");
      for (const double x : {0.0, 1.0, -40.0, 300.0}) {
        const double expected = walked(w, x);
        // Every connection multiplies by at most 4 · 1000 and adds at most 500 K; 1e-12 of the largest number on the way.
        EXPECT_NEAR(composed(w, r, x), expected, 1e-12 * std::pow(4000.0, static_cast<double>(w.hops.size())))
            << describe(w) << ", x = " << x;
      }
      ++agreed;
    } catch (const Error&) {
      ++refused;
    }
  }
  EXPECT_GT(agreed, 10 * refused);  // only an offset in a unit of measure that the file does not give is refused
}

TEST(Path, WithoutTransformationsIsExact) {
  UnitTable units;
  Path path(units, Path::Start::kVariable, "mm");
  path.pass({}, "km", false, "");
  path.pass({}, "", false, "");
  path.pass({}, "um", true, "");
  const Path::Result r = path.result("");
  EXPECT_EQ(r.factor, 1);
  EXPECT_EQ(r.offset, 0);
  EXPECT_EQ(r.from_unit, "mm");
  EXPECT_EQ(r.to_unit, "um");
}

}  // namespace
}  // namespace cotwin::master::ssp::ssp_path_test
