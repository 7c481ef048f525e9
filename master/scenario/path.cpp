#include "master/scenario/path.h"

#include <cmath>

#include "models/foundation/support/error.h"

namespace cotwin::master::ssp {

si::Conversion Path::conversion(const std::string& from, const std::string& to, const std::string& place) const {
  if (from.empty() || to.empty() || from == to) return {};
  const si::Measure a = units_->measure(from), b = units_->measure(to);
  if (!si::convertible(a, b)) throw Error(place, from + " cannot feed " + to);
  return si::conversion(a, b);
}

void Path::pass(const Transformation& t, const std::string& unit, bool component, const std::string& place) {
  if (t.suppress_unit_conversion) {
    if (!suppressed_) {
      // From here on numbers are not converted: the conversion so far becomes part of factor and offset.
      const si::Conversion c = conversion(from_, current_, place);
      offset_ += factor_ * c.offset;
      factor_ *= c.factor;
    }
    suppressed_ = true;
    current_ = unit;
  } else if (!unit.empty()) {
    const bool untouched = factor_ == 1 && offset_ == 0 && !suppressed_;
    if (current_.empty() && untouched) {
      from_ = unit;
    } else if (current_.empty() && !suppressed_ && start_ == Start::kVariable) {
      throw Error(place, "a linear transformation in an unknown unit of measure, then a connector in " + unit +
                             ": expected the units of all connectors on the path");
    }
    const si::Conversion c = conversion(current_, unit, place);
    // f·v + o in the old measure is f·w + (c.factor·o + c.offset·(1 − f)) in the new one, where w is v converted.
    offset_ = suppressed_ ? c.factor * offset_ + c.offset : c.factor * offset_ + c.offset * (1 - factor_);
    if (suppressed_) factor_ *= c.factor;
    current_ = unit;
  } else if (component && !current_.empty()) {
    // The transformation is in the variable's declared unit. A factor alone can be applied before the conversion to that unit,
    // if the conversion has no offset. Otherwise the value must be converted completely before, so nothing before may depend on
    // `current_`.
    const bool offsets = units_->has_offsets(current_);
    if (t.offset != 0 || (t.factor != 1 && offsets)) {
      if (offset_ != 0 || suppressed_ || (factor_ != 1 && offsets)) {
        throw Error(place, "a linear transformation in an unknown unit of measure, expected the connector's unit");
      }
      open_ = true;
    }
  }
  factor_ *= t.factor;
  offset_ = t.factor * offset_ + t.offset;
}

Path::Result Path::result(const std::string& place) const {
  if (!std::isfinite(factor_) || !std::isfinite(offset_)) throw Error(place, "the factor of this path is not finite");
  return {from_, open_ ? "" : current_, factor_, offset_, suppressed_};
}

ParameterValue Path::applied(const ParameterValue& value) const {
  ParameterValue result = value;
  if (open_)
    throw Error(value.place,
                "parameter '" + value.name + "' in " + from_ +
                    ": a linear transformation needs the unit of measure of its target, expected a connector with a unit");
  const bool plain = factor_ == 1 && offset_ == 0 && !suppressed_;
  if (const double* real = std::get_if<double>(&value.value)) {
    // Without a transformation the value keeps its unit. The code that sets the variable converts it.
    if (plain) {
      if (value.unit.empty()) result.unit = current_;
      return result;
    }
    const si::Conversion c = suppressed_ ? si::Conversion{} : conversion(from_, current_, value.place);
    result.value = factor_ * (c.factor * *real + c.offset) + offset_;
    result.unit = current_;
  } else if (const std::int64_t* integer = std::get_if<std::int64_t>(&value.value); integer != nullptr && !plain) {
    const double transformed = factor_ * static_cast<double>(*integer) + offset_;
    const bool whole = transformed == std::trunc(transformed) && std::abs(transformed) < 0x1p53;
    if (whole) {
      result.value = static_cast<std::int64_t>(transformed);
    } else {
      result.value = transformed;
    }
  }
  return result;
}

}  // namespace cotwin::master::ssp
