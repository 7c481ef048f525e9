#pragma once
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

/// Designs of experiments: the values of factors in numbered runs. A value depends on nothing but the number of its run and the design.
namespace cotwin::master {

/// How a factor is spread over the runs.
struct Distribution {
  enum class Kind : std::uint8_t { kValues, kUniform, kLogUniform, kNormal, kLogNormal, kTriangular };

  Kind kind = Kind::kValues;
  /// values: none; uniform, log_uniform: low, high; normal: mean, standard deviation; log_normal: the same of the natural logarithm;
  /// triangular: low, mode, high.
  std::vector<double> numbers;
  double min = -std::numeric_limits<double>::infinity(), max = std::numeric_limits<double>::infinity();  // truncated there
  std::vector<std::string> values;

  /// The value below which is the share u of the runs, 0 < u < 1, as text that reads back to the same bits.
  std::string at(double u) const;
  /// The smallest and the largest value, where there are any; the first 100 values where one is no number.
  std::vector<std::string> extremes() const;
  /// Throws Error at `place` for numbers that give no distribution.
  void check(const std::string& place) const;
};
inline constexpr std::pair<const char*, Distribution::Kind> kDistributionWords[] = {
    {"values", Distribution::Kind::kValues},          {"uniform", Distribution::Kind::kUniform},
    {"log_uniform", Distribution::Kind::kLogUniform}, {"normal", Distribution::Kind::kNormal},
    {"log_normal", Distribution::Kind::kLogNormal},   {"triangular", Distribution::Kind::kTriangular}};

struct Factor {
  std::string name;
  Distribution distribution;
};

enum class DesignKind : std::uint8_t { kLatinHypercube, kSobol, kRandom, kGrid, kTable };
inline constexpr std::pair<const char*, DesignKind> kDesignWords[] = {{"latin_hypercube", DesignKind::kLatinHypercube},
                                                                      {"sobol", DesignKind::kSobol},
                                                                      {"random", DesignKind::kRandom},
                                                                      {"grid", DesignKind::kGrid},
                                                                      {"table", DesignKind::kTable}};

struct Design {
  DesignKind kind = DesignKind::kLatinHypercube;
  std::int64_t runs = 0;
  std::uint64_t seed = 1;  // of latin_hypercube and random
  std::vector<Factor> factors;
  std::vector<std::vector<std::string>> rows;  // of a table

  /// The values of all factors in a run, 1 to `runs`: row by row of a table; of a grid with the last factor fastest; of the Sobol points
  /// with the direction numbers of Joe and Kuo (2008), the first of which is (1/2, 1/2, …).
  std::vector<std::string> point(std::int64_t run) const;

  /// The medians of all factors, or the first row of a table.
  std::vector<std::string> typical() const;
  struct Extreme {
    std::string what;  // "drive.K[1]=5000"
    std::vector<std::string> point;
  };
  /// For each extreme value of a factor the typical point with that value, or the first row of a table that has it.
  std::vector<Extreme> extremes() const;
};

}  // namespace cotwin::master
