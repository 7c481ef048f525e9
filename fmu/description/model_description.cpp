#include "fmu/description/model_description.h"

#include <algorithm>
#include <array>

#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

template <std::size_t N, class Enum>
std::string_view word(const std::array<std::string_view, N>& words, Enum value) {
  return words.at(static_cast<std::size_t>(value));
}

}  // namespace

std::string_view name_of(Type type) {
  static constexpr std::array<std::string_view, 15> kWords = {"Float32", "Float64", "Int8",   "UInt8",       "Int16",
                                                              "UInt16",  "Int32",   "UInt32", "Int64",       "UInt64",
                                                              "Boolean", "String",  "Binary", "Enumeration", "Clock"};
  return word(kWords, type);
}

std::string_view name_of(Causality causality) {
  static constexpr std::array<std::string_view, 7> kWords = {"parameter",   "calculatedParameter", "input", "output", "local",
                                                             "independent", "structuralParameter"};
  return word(kWords, causality);
}

std::string_view name_of(Variability variability) {
  static constexpr std::array<std::string_view, 5> kWords = {"constant", "fixed", "tunable", "discrete", "continuous"};
  return word(kWords, variability);
}

std::string_view name_of(Initial initial) {
  static constexpr std::array<std::string_view, 3> kWords = {"exact", "approx", "calculated"};
  return word(kWords, initial);
}

std::string_view name_of(DependencyKind kind) {
  static constexpr std::array<std::string_view, 5> kWords = {"dependent", "constant", "fixed", "tunable", "discrete"};
  return word(kWords, kind);
}

std::string_view name_of(IntervalVariability variability) {
  static constexpr std::array<std::string_view, 6> kWords = {"constant", "fixed",     "tunable",
                                                             "changing", "countdown", "triggered"};
  return word(kWords, variability);
}

namespace {

/// `find_reference` returns the variable with a value reference, or nullptr.
template <class Find>
std::size_t count_elements(const ModelVariable& variable, const std::map<std::uint32_t, std::uint64_t>& chosen,
                           const Find& find_reference) {
  std::uint64_t n = 1;
  for (const Dimension& dimension : variable.dimensions) {
    std::uint64_t extent = dimension.size.value_or(0);
    if (dimension.reference) {
      const auto said = chosen.find(*dimension.reference);
      const ModelVariable* parameter = said != chosen.end() ? nullptr : find_reference(*dimension.reference);
      const auto* start = parameter == nullptr ? nullptr : std::get_if<std::vector<std::uint64_t>>(&parameter->start);
      if (said != chosen.end()) {
        extent = said->second;
      } else if (start != nullptr && start->size() == 1) {
        extent = start->front();
      } else {
        throw Error("variable '" + variable.name + "'", "the size of a dimension is unknown");
      }
    }
    if (extent > kMaxElements || n * extent > kMaxElements) {
      throw Error("variable '" + variable.name + "'", "more than " + std::to_string(kMaxElements) + " elements");
    }
    n *= extent;
  }
  return static_cast<std::size_t>(n);
}

Numeric with_type(const ModelVariable& variable, const TypeDefinition* type) {
  Numeric n = variable.numeric;
  if (type == nullptr) return n;
  const auto inherit = [](auto& own, const auto& declared) {
    if (!own) own = declared;
  };
  if (n.unit.empty()) n.unit = type->numeric.unit;
  if (n.quantity.empty()) n.quantity = type->numeric.quantity;
  if (n.display_unit.empty()) n.display_unit = type->numeric.display_unit;
  n.relative_quantity = n.relative_quantity || type->numeric.relative_quantity;
  inherit(n.min, type->numeric.min);
  inherit(n.max, type->numeric.max);
  inherit(n.nominal, type->numeric.nominal);
  return n;
}

template <class Key, class Map>
auto found_in(const Map& map, const Key& key) -> typename Map::mapped_type {
  const auto found = map.find(key);
  return found == map.end() ? nullptr : found->second;
}

}  // namespace

DescriptionIndex::DescriptionIndex(const ModelDescription& description) : description_(description) {
  for (const TypeDefinition& type : description.types) types_.emplace(type.name, &type);
  for (const MeasurementUnit& unit : description.units) units_.emplace(unit.name, &unit);
  for (const ModelVariable& v : description.variables) {
    if (v.type == Type::kUInt64 && v.dimensions.empty()) extents_.emplace(v.reference, &v);
  }
}

const ModelVariable* DescriptionIndex::variable(std::string_view name) const {
  if (variables_.empty()) {
    variables_.reserve(description_.variables.size());
    for (const ModelVariable& v : description_.variables) variables_.emplace(v.name, &v);
  }
  return found_in(variables_, name);
}

const TypeDefinition* DescriptionIndex::type(std::string_view name) const { return found_in(types_, name); }
const MeasurementUnit* DescriptionIndex::unit(std::string_view name) const { return found_in(units_, name); }

Numeric DescriptionIndex::effective(const ModelVariable& variable) const {
  return with_type(variable, variable.declared_type.empty() ? nullptr : type(variable.declared_type));
}

std::size_t DescriptionIndex::elements(const ModelVariable& variable,
                                       const std::map<std::uint32_t, std::uint64_t>& chosen) const {
  return count_elements(variable, chosen, [&](std::uint32_t reference) { return found_in(extents_, reference); });
}

}  // namespace cotwin::fmu
