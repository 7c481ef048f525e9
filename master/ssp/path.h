#pragma once
#include <string>

#include "master/ssp/system.h"

namespace cotwin::master::ssp {

/// What a value goes through on its way over several connections, as one conversion and one linear transformation:
///   to = factor · convert(from, from_unit → to_unit) + offset
/// Units of measure are those that the file gives; a component's variable without one has its own, which only the unit or FMU
/// knows, and a system's connector without one has that of what arrives. A transformation that would have to be told in a
/// measure that is not given throws; where no connector on the way gives any, both ends are taken to have the same.
class Path {
 public:
  /// Starts at a component's variable, or at a parameter value, in `unit`. Where it is not given (""), a variable has its own,
  /// and a value is in whatever its target is in.
  enum class Start { kVariable, kValue };
  Path(const UnitTable& units, Start start, std::string unit)
      : units_(&units), start_(start), from_(unit), current_(std::move(unit)) {}

  /// Over one connection or mapping to an end in `unit` ("": not given), which is a component's variable or not.
  void pass(const Transformation& t, const std::string& unit, bool component, const std::string& place);

  struct Result {
    std::string from_unit, to_unit;  // "": the variable's own
    double factor = 1, offset = 0;
    bool suppress_unit_conversion = false;
  };
  Result result(const std::string& place) const;

  /// A parameter value at the end of the path.
  ParameterValue applied(const ParameterValue& value) const;

 private:
  si::Conversion conversion(const std::string& from, const std::string& to, const std::string& place) const;

  const UnitTable* units_;
  Start start_;
  std::string from_, current_;
  double factor_ = 1, offset_ = 0;  // after the conversion from_ → current_, or instead of it where that is suppressed
  bool suppressed_ = false;
  bool open_ = false;  // the last transformation holds in the unit of the variable at the end, which is not given
};

}  // namespace cotwin::master::ssp
