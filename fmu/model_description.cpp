#include "fmu/model_description.h"

#include <algorithm>
#include <array>

#include "models/text/error.h"

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

const Variable* find(const ModelDescription& description, std::uint32_t reference) {
  const auto found = std::find_if(description.variables.begin(), description.variables.end(),
                                  [&](const Variable& v) { return v.reference == reference; });
  return found == description.variables.end() ? nullptr : &*found;
}

std::size_t elements(const ModelDescription& description, const Variable& variable,
                     const std::map<std::uint32_t, std::uint64_t>& chosen) {
  std::uint64_t n = 1;
  for (const Dimension& dimension : variable.dimensions) {
    std::uint64_t extent = dimension.size.value_or(0);
    if (dimension.reference) {
      const auto said = chosen.find(*dimension.reference);
      const Variable* parameter = find(description, *dimension.reference);
      const auto* start = parameter == nullptr ? nullptr : std::get_if<std::vector<std::uint64_t>>(&parameter->start);
      if (said != chosen.end()) {
        extent = said->second;
      } else if (start != nullptr && start->size() == 1) {
        extent = start->front();
      } else {
        throw Error("variable '" + variable.name + "'", "an extent cannot be found");
      }
    }
    if (extent > kMaxElements || n * extent > kMaxElements) {
      throw Error("variable '" + variable.name + "'", "more than " + std::to_string(kMaxElements) + " elements");
    }
    n *= extent;
  }
  return static_cast<std::size_t>(n);
}

Numeric effective(const ModelDescription& description, const Variable& variable) {
  Numeric n = variable.numeric;
  if (variable.declared_type.empty()) return n;
  const auto type = std::find_if(description.types.begin(), description.types.end(),
                                 [&](const TypeDefinition& t) { return t.name == variable.declared_type; });
  if (type == description.types.end()) return n;
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

}  // namespace cotwin::fmu
