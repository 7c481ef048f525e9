#pragma once
#include <array>
#include <string>
#include <string_view>

#include "models/foundation/formats/parameter_set.h"

/// Units of measure. They are never called "units" here: a unit is a co-simulation unit.
namespace cotwin::si {

/// A unit of measure as in FMI and SSP: value in SI base units = factor · value + offset.
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
/// Adds definitions to the set for all units of measure that its values use and that are not defined yet. Throws Error for a
/// name that parse() cannot read.
void define_units(ParameterSet& set);

/// Returns whether the exponents are equal. rad is a base unit, as in FMI: otherwise a frequency in Hz could be connected to an
/// angular velocity.
bool convertible(const Measure& from, const Measure& to);

/// Whether `rate` is a measure of the first time derivative of what is measured in `of`; also if one of them is "", unknown. Throws
/// Error for texts that parse() cannot read.
bool is_rate(const std::string& rate, const std::string& of);

/// to = factor · from + offset.
struct Conversion {
  double factor = 1;
  double offset = 0;
};
Conversion conversion(const Measure& from, const Measure& to);

}  // namespace cotwin::si
