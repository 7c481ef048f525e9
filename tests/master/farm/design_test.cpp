// Designs of experiments: published points, strata, distributions, grids and tables.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "master/farm/design.h"
#include "models/foundation/support/text.h"
#include "tests/support/error_of.h"

namespace cotwin::master::design_test {
namespace {

using cotwin::testing::error_of;
using Kind = Distribution::Kind;

Distribution distribution(Kind kind, std::vector<double> numbers) {
  Distribution d;
  d.kind = kind;
  d.numbers = std::move(numbers);
  return d;
}

Design unit_cube(DesignKind kind, std::int64_t runs, std::size_t factors, std::uint64_t seed = 1) {
  Design design;
  design.kind = kind;
  design.runs = runs;
  design.seed = seed;
  for (std::size_t k = 0; k < factors; ++k)
    design.factors.push_back({"x" + std::to_string(k), distribution(Kind::kUniform, {0, 1})});
  return design;
}

/// Values of one factor over all runs.
std::vector<double> column(const Design& design, std::size_t factor) {
  std::vector<double> all;
  for (std::int64_t run = 1; run <= design.runs; ++run) all.push_back(text::parse_real(design.point(run)[factor]).value());
  return all;
}

/// Sobol points by the definition: x_i = ⊕ of the direction numbers where the Gray code of i has ones, with the primitive polynomials and
/// first direction numbers that Joe and Kuo have published (new-joe-kuo-6.21201), dimensions 1 to 10.
double sobol_of_joe_and_kuo(std::uint64_t i, std::size_t dimension) {
  struct Row {
    unsigned s, a;
    std::array<std::uint64_t, 5> m;
  };
  static constexpr std::array<Row, 10> kRows = {{{0, 0, {}},
                                                 {1, 0, {1}},
                                                 {2, 1, {1, 3}},
                                                 {3, 1, {1, 3, 1}},
                                                 {3, 2, {1, 1, 1}},
                                                 {4, 1, {1, 1, 3, 3}},
                                                 {4, 4, {1, 3, 5, 13}},
                                                 {5, 2, {1, 1, 5, 5, 17}},
                                                 {5, 4, {1, 1, 5, 5, 5}},
                                                 {5, 7, {1, 1, 7, 11, 19}}}};
  const Row& row = kRows[dimension];
  constexpr unsigned kBits = 32;
  std::array<std::uint64_t, kBits + 1> v{};
  for (unsigned k = 1; k <= kBits; ++k) {
    if (row.s == 0) {
      v[k] = std::uint64_t{1} << (kBits - k);
    } else if (k <= row.s) {
      v[k] = row.m[k - 1] << (kBits - k);
    } else {
      v[k] = v[k - row.s] ^ (v[k - row.s] >> row.s);
      for (unsigned j = 1; j < row.s; ++j) v[k] ^= ((row.a >> (row.s - 1 - j)) & 1) * v[k - j];
    }
  }
  std::uint64_t x = 0;
  const std::uint64_t gray = i ^ (i >> 1);
  for (unsigned k = 0; k < kBits; ++k) {
    if ((gray >> k) & 1) x ^= v[k + 1];
  }
  return static_cast<double>(x) * 0x1p-32;
}

TEST(Design, GivesThePublishedSobolPoints) {
  const Design design = unit_cube(DesignKind::kSobol, 1000, 10);
  // The list that comes with the direction numbers, without the origin.
  const double published[9][3] = {{0.5, 0.5, 0.5},       {0.75, 0.25, 0.25},       {0.25, 0.75, 0.75},
                                  {0.375, 0.375, 0.625}, {0.875, 0.875, 0.125},    {0.625, 0.125, 0.875},
                                  {0.125, 0.625, 0.375}, {0.1875, 0.3125, 0.9375}, {0.6875, 0.8125, 0.4375}};
  for (int run = 1; run <= 9; ++run) {
    for (std::size_t k = 0; k < 3; ++k)
      EXPECT_EQ(design.point(run)[k], text::to_text(published[run - 1][k])) << run << ' ' << k;
  }
  for (std::int64_t run = 1; run <= 1000; ++run) {
    const std::vector<std::string> point = design.point(run);
    for (std::size_t k = 0; k < 10; ++k)
      ASSERT_EQ(point[k], text::to_text(sobol_of_joe_and_kuo(static_cast<std::uint64_t>(run), k))) << run << ' ' << k;
  }
}

TEST(Design, HasOnePointOfALatinHypercubePerStratum) {
  for (const std::int64_t n : {1, 2, 3, 7, 64, 100, 1000}) {
    for (const std::uint64_t seed : {0u, 1u, 77u}) {
      const Design design = unit_cube(DesignKind::kLatinHypercube, n, 4, seed);
      for (std::size_t k = 0; k < 4; ++k) {
        std::set<int> strata;
        for (const double x : column(design, k)) {
          EXPECT_GT(x, 0);
          EXPECT_LT(x, 1);
          strata.insert(static_cast<int>(std::floor(x * static_cast<double>(n))));
        }
        EXPECT_EQ(strata.size(), static_cast<std::size_t>(n)) << n << ' ' << seed << ' ' << k;
      }
    }
  }
}

TEST(Design, HasFactorsThatDoNotFollowOneAnother) {
  for (const DesignKind kind : {DesignKind::kLatinHypercube, DesignKind::kRandom}) {
    const Design design = unit_cube(kind, 2000, 5), other = unit_cube(kind, 2000, 5, 2);
    std::vector<std::vector<double>> columns;
    for (std::size_t k = 0; k < 5; ++k) columns.push_back(column(design, k));
    columns.push_back(column(other, 0));
    // And of a factor from run to run.
    std::vector<double> later = columns[0];
    std::rotate(later.begin(), later.begin() + 1, later.end());
    columns.push_back(later);
    for (std::size_t a = 0; a < columns.size(); ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        double sum = 0;
        for (std::size_t i = 0; i < 2000; ++i) sum += (columns[a][i] - 0.5) * (columns[b][i] - 0.5);
        EXPECT_LT(std::abs(sum / 2000 * 12), 0.1) << a << ' ' << b;  // 4.5 standard deviations of independent ones
      }
    }
  }
}

/// The largest distance between the shares of a sorted sample and a distribution function.
double distance(std::vector<double> sample, const std::function<double(double)>& cdf) {
  std::ranges::sort(sample);
  double most = 0;
  const auto n = static_cast<double>(sample.size());
  for (std::size_t i = 0; i < sample.size(); ++i) {
    const double share = cdf(sample[i]);
    most = std::max({most, share - static_cast<double>(i) / n, static_cast<double>(i + 1) / n - share});
  }
  return most;
}

TEST(Design, FollowsTheNamedDistributions) {
  const auto normal = [](double x) { return std::erfc(-x / std::sqrt(2)) / 2; };
  struct Case {
    Distribution distribution;
    std::function<double(double)> cdf;
  };
  Distribution cut = distribution(Kind::kNormal, {1, 2});
  cut.min = 0;
  cut.max = 2;
  Distribution cut_log = distribution(Kind::kLogUniform, {1, 1000});
  cut_log.max = 10;
  const std::vector<Case> cases = {
      {distribution(Kind::kUniform, {-2, 3}), [](double x) { return (x + 2) / 5; }},
      {distribution(Kind::kLogUniform, {1e-3, 10}), [](double x) { return std::log(x / 1e-3) / std::log(1e4); }},
      {cut_log, [](double x) { return std::log10(x); }},
      {distribution(Kind::kNormal, {1, 2}), [&](double x) { return normal((x - 1) / 2); }},
      {cut, [&](double x) { return (normal((x - 1) / 2) - normal(-0.5)) / (normal(0.5) - normal(-0.5)); }},
      {distribution(Kind::kLogNormal, {0.5, 0.25}), [&](double x) { return normal((std::log(x) - 0.5) / 0.25); }},
      {distribution(Kind::kTriangular, {0, 1, 4}), [](double x) { return x < 1 ? x * x / 4 : 1 - (4 - x) * (4 - x) / 12; }},
      {distribution(Kind::kTriangular, {0, 0, 1}), [](double x) { return 1 - (1 - x) * (1 - x); }},
  };
  for (std::size_t c = 0; c < cases.size(); ++c) {
    cases[c].distribution.check("");
    Design design;
    design.factors.push_back({"x", cases[c].distribution});
    design.runs = 500;
    // One point in each stratum of equal probability: a sample cannot follow a distribution more closely.
    EXPECT_LE(distance(column(design, 0), cases[c].cdf), 1.0 / 500 + 1e-9) << c;
    design.kind = DesignKind::kRandom;
    EXPECT_LE(distance(column(design, 0), cases[c].cdf), 1.95 / std::sqrt(500.0)) << c;  // Kolmogorov: 0.1 %
    for (const double u : {1e-300, 1e-17, 0.5, 1 - 1e-16}) {
      const double x = text::parse_real(cases[c].distribution.at(u)).value();
      EXPECT_TRUE(std::isfinite(x)) << c << ' ' << u;
      EXPECT_TRUE(x >= cases[c].distribution.min && x <= cases[c].distribution.max) << c << ' ' << u << ' ' << x;
    }
  }
  EXPECT_EQ(distribution(Kind::kNormal, {0, 1}).at(0.5), "0");
  EXPECT_NEAR(text::parse_real(distribution(Kind::kNormal, {0, 1}).at(0.975)).value(), 1.959963984540054, 1e-14);
}

TEST(Design, EnumeratesAGridWithTheLastFactorFastest) {
  Design design;
  design.kind = DesignKind::kGrid;
  for (const auto& [name, values] :
       std::vector<std::pair<std::string, std::vector<std::string>>>{{"robot", {"lwr4", "panda"}}, {"K", {"1", "2", "3"}}}) {
    Distribution d;
    d.values = values;
    design.factors.push_back({name, d});
  }
  design.runs = 6;
  std::vector<std::string> all;
  for (int run = 1; run <= 6; ++run) all.push_back(text::joined(design.point(run), " "));
  EXPECT_EQ(all, (std::vector<std::string>{"lwr4 1", "lwr4 2", "lwr4 3", "panda 1", "panda 2", "panda 3"}));
}

TEST(Design, SpreadsNamedValuesEvenly) {
  Design design = unit_cube(DesignKind::kLatinHypercube, 9, 1);
  design.factors[0].distribution = {};
  design.factors[0].distribution.values = {"a", "b", "c"};
  std::map<std::string, int> counts;
  for (int run = 1; run <= 9; ++run) ++counts[design.point(run)[0]];
  EXPECT_EQ(counts, (std::map<std::string, int>{{"a", 3}, {"b", 3}, {"c", 3}}));
}

TEST(Design, OfTenMillionRunsGivesEachAtOnce) {
  const Design design = unit_cube(DesignKind::kLatinHypercube, 10'000'000, 3);
  std::set<double> seen;
  for (std::int64_t run = 1; run <= design.runs; run += 99'991) {
    const double x = text::parse_real(design.point(run)[2]).value();
    EXPECT_TRUE(seen.insert(std::floor(x * 1e7)).second) << run;
  }
}

TEST(Distribution, TellsWhatItReaches) {
  EXPECT_EQ(distribution(Kind::kUniform, {-1, 2}).extremes(), (std::vector<std::string>{"-1", "2"}));
  EXPECT_EQ(distribution(Kind::kNormal, {0, 1}).extremes(), std::vector<std::string>{});
  EXPECT_EQ(distribution(Kind::kLogNormal, {0, 1}).extremes(), std::vector<std::string>{"0"});
  Distribution cut = distribution(Kind::kNormal, {0, 1});
  cut.min = -2;
  EXPECT_EQ(cut.extremes(), std::vector<std::string>{"-2"});
  Distribution values;
  values.values = {"3", "-1", "2"};
  EXPECT_EQ(values.extremes(), (std::vector<std::string>{"-1", "3"}));
  values.values.push_back("panda");
  EXPECT_EQ(values.extremes().size(), 4u);
}

TEST(Distribution, RefusesNumbersThatGiveNone) {
  const auto refused = [](Kind kind, std::vector<double> numbers, double min = -INFINITY, double max = INFINITY) {
    Distribution d = distribution(kind, std::move(numbers));
    d.min = min;
    d.max = max;
    return error_of([&] { d.check("/vary/x"); });
  };
  EXPECT_EQ(refused(Kind::kUniform, {2, 1}), "/vary/x: uniform: expected [low, high] with low < high");
  EXPECT_NE(refused(Kind::kUniform, {1, 1}), "");
  EXPECT_NE(refused(Kind::kUniform, {1}), "");
  EXPECT_NE(refused(Kind::kUniform, {-1e308, 1e308}), "");
  EXPECT_NE(refused(Kind::kUniform, {0, NAN}), "");
  EXPECT_NE(refused(Kind::kLogUniform, {0, 1}), "");
  EXPECT_NE(refused(Kind::kNormal, {0, 0}), "");
  EXPECT_NE(refused(Kind::kNormal, {0, -1}), "");
  EXPECT_NE(refused(Kind::kTriangular, {0, 2, 1}), "");
  EXPECT_NE(refused(Kind::kTriangular, {1, 1, 1}), "");
  EXPECT_NE(refused(Kind::kNormal, {0, 1}, 100, 101), "");
  EXPECT_NE(refused(Kind::kNormal, {0, 1}, 1, -1), "");
  EXPECT_NE(refused(Kind::kValues, {}), "");
  EXPECT_EQ(refused(Kind::kNormal, {0, 1}, 3), "");
}

}  // namespace
}  // namespace cotwin::master::design_test
