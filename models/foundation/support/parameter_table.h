#pragma once
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

/// Parameters of joints, described once. A struct holds one vector of values per parameter; a table of ParameterRow describes
/// each vector. Start values, checks, smooth following, declaration (components/unit/joint_variables.h) and files loop over
/// the table.
namespace cotwin {

/// Whether and how a parameter changes while the robot moves.
enum class Mutability : std::uint8_t {
  kFixed,     // fixed from initialise on
  kFollowed,  // tunable: the value in force follows the tunable smoothly, see follow()
  kByUnit     // tunable: the unit has a rule of its own
};

template <class Struct>
struct ParameterRow {
  static constexpr double kNoLimit = std::numeric_limits<double>::infinity();
  /// Least value of a parameter that must be positive, and a bound that no drive reaches.
  static constexpr double kPositive = 1e-9, kLargest = 1e12;

  const char* name;
  std::vector<double> Struct::*values;
  const char* si;  // unit of measure of revolute joints
  const char* description;
  double start = 0;
  double min = -kNoLimit, max = kNoLimit;  // both ends belong to the range
  Mutability mutability = Mutability::kFixed;
  std::size_t per_joint = 1;      // values per joint; 0: one value for all joints
  bool prismatic_differs = true;  // false: `si` holds for prismatic joints, too (angular frequencies)

  std::size_t size(std::size_t joints) const { return per_joint == 0 ? 1 : per_joint * joints; }
};

/// Resizes all vectors for `joints` joints and writes the start values.
template <class Struct, class Table>
void write_start_values(Struct& parameters, const Table& table, std::size_t joints) {
  for (const auto& row : table) (parameters.*row.values).assign(row.size(joints), row.start);
}

/// Throws Error `place.K[2]: is -1, expected a finite value >= 0` for the first value outside its range. Only parameters whose
/// start value is infinite may be infinite.
template <class Struct, class Table>
void check_values(const Struct& parameters, const Table& table, const std::string& place) {
  for (const auto& row : table) {
    const std::vector<double>& values = parameters.*row.values;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double value = values[i];
      if (value >= row.min && value <= row.max && std::isfinite(value)) continue;
      if (std::isinf(value) && std::isinf(row.start)) continue;
      const std::string expected = row.max < row.kLargest     ? text::to_text(row.min) + " to " + text::to_text(row.max)
                                   : row.min == row.kPositive ? "a finite value > 0"
                                   : row.min == 0             ? "a finite value >= 0"
                                                              : "a finite value";
      throw Error(place + "." + row.name + "[" + std::to_string(i + 1) + "]",
                  "is " + text::to_text(value) + ", expected " + expected);
    }
  }
}

/// Returns whether all parameters that may change while the robot moves are the same, bit by bit. Without branches on values,
/// because it is called in every step.
template <class Struct, class Table>
bool same(const Struct& a, const Struct& b, const Table& table) {
  std::uint64_t difference = 0;
  for (const auto& row : table) {
    if (row.mutability == Mutability::kFixed) continue;
    const double *x = (a.*row.values).data(), *y = (b.*row.values).data();
    const std::size_t size = (a.*row.values).size();
    std::size_t i = 0;
    for (; i + 1 < size; i += 2) {
      difference |= std::bit_cast<std::uint64_t>(x[i]) ^ std::bit_cast<std::uint64_t>(y[i]);
      difference |= std::bit_cast<std::uint64_t>(x[i + 1]) ^ std::bit_cast<std::uint64_t>(y[i + 1]);
    }
    if (i < size) difference |= std::bit_cast<std::uint64_t>(x[i]) ^ std::bit_cast<std::uint64_t>(y[i]);
  }
  return difference == 0;
}

/// Returns whether a parameter with Mutability::kFollowed has not reached its wanted value.
template <class Struct, class Table>
bool differ(const Struct& in_force, const Struct& wanted, const Table& table) {
  return std::ranges::any_of(table, [&](const auto& row) {
    return row.mutability == Mutability::kFollowed && in_force.*row.values != wanted.*row.values;
  });
}

/// Moves parameters with Mutability::kFollowed towards their wanted values: `remaining` of each difference is left. A rest
/// below `negligible` times the wanted value is dropped, so that the motion ends. Allocates nothing.
template <class Struct, class Table>
void follow(Struct& in_force, const Struct& wanted, const Table& table, double remaining, double negligible = 0) {
  for (const auto& row : table) {
    if (row.mutability != Mutability::kFollowed) continue;
    std::vector<double>& values = in_force.*row.values;
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double target = (wanted.*row.values)[i], next = target + (values[i] - target) * remaining;
      values[i] = std::abs(next - target) <= negligible * (std::abs(target) + 1e-3) ? target : next;
    }
  }
}

/// Copies the parameters that never change. Allocates nothing.
template <class Struct, class Table>
void copy_fixed(Struct& to, const Struct& from, const Table& table) {
  for (const auto& row : table) {
    if (row.mutability == Mutability::kFixed) std::ranges::copy(from.*row.values, (to.*row.values).begin());
  }
}

}  // namespace cotwin
