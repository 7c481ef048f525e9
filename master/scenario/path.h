#pragma once
#include <string>

#include "master/scenario/system.h"

namespace cotwin::master::ssp {

/// Composes the conversions and transformations of several connections to one conversion and one linear transformation:
///   to = factor · convert(from, from_unit → to_unit) + offset
/// Units of measure are those of the file. A component's variable without one has the unit that its co-simulation unit or FMU
/// declares; a system's connector without one has the unit of the incoming value. A transformation in an unknown unit of
/// measure is an Error; if no connector on the path has a unit, both ends are assumed to have the same.
class Path {
 public:
  /// Starts at a component's variable or at a parameter value in `unit`. Without unit (""), a variable has its declared unit
  /// and a value has that of its target.
  enum class Start { kVariable, kValue };
  Path(const UnitTable& units, Start start, std::string unit)
      : units_(&units), start_(start), from_(unit), current_(std::move(unit)) {}

  /// Continues over one connection or mapping to an end in `unit` ("": not given). `component`: the end is a component's
  /// variable.
  void pass(const Transformation& t, const std::string& unit, bool component, const std::string& place);

  struct Result {
    std::string from_unit, to_unit;  // "": the unit that the variable declares
    double factor = 1, offset = 0;
    bool suppress_unit_conversion = false;
  };
  Result result(const std::string& place) const;

  /// Returns a parameter value as it arrives at the end of the path.
  ParameterValue applied(const ParameterValue& value) const;

 private:
  si::Conversion conversion(const std::string& from, const std::string& to, const std::string& place) const;

  const UnitTable* units_;
  Start start_;
  std::string from_, current_;
  double factor_ = 1, offset_ = 0;  // applied after the conversion from_ → current_, or instead of it if suppressed_
  bool suppressed_ = false;
  bool open_ = false;  // the last transformation is in the declared unit of the variable at the end, which the file lacks
};

}  // namespace cotwin::master::ssp
