#pragma once
#include <array>
#include <string>
#include <string_view>

#include "models/support/parameter_set.h"

/// Units of measure (never called "units": that word is taken).
namespace cotwin::si {

/// A unit of measure as FMI and SSP see it: value in SI base units = factor · value + offset.
struct Measure {
  std::array<int, 8> exponents{};  // kg, m, s, A, K, mol, cd, rad
  double factor = 1;
  double offset = 0;
  friend bool operator==(const Measure&, const Measure&) = default;
};

/// Reads "N.m/rad", "m/s2", "rad/s^2", "kg.m2", "deg", "mm", "ms", "degC", "1", "N.m.s/rad", "%". Products are '.' or '*', one
/// '/' divides by all that follows it (parentheses allowed), exponents are a number after the symbol (with or without '^', may
/// be negative). Throws Error for anything else.
Measure parse(std::string_view text);
Measure from(const UnitDefinition& definition);
/// Gives the set a definition of every unit of measure that its values name and it does not define yet, as a file needs them.
/// Throws Error for a name that parse() cannot read.
void define_units(ParameterSet& set);

/// Two measures can be converted into each other if their exponents agree. rad is a base unit of its own, as in FMI: else a
/// frequency in Hz would feed an angular velocity by the factor 1.
bool convertible(const Measure& from, const Measure& to);

/// to = factor · from + offset.
struct Conversion {
  double factor = 1;
  double offset = 0;
};
Conversion conversion(const Measure& from, const Measure& to);

}  // namespace cotwin::si
