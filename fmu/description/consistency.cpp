#include "fmu/description/consistency.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string>
#include <type_traits>
#include <unordered_set>

#include "models/foundation/support/error.h"

namespace cotwin::fmu {

namespace {

bool has_control_characters(std::string_view text) {
  return std::any_of(text.begin(), text.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; });
}

std::string shown(std::string_view text) { return "'" + std::string(text.substr(0, 60)) + (text.size() > 60 ? "…'" : "'"); }

template <class T>
bool holds(const StartValues& start) {
  return std::holds_alternative<std::vector<T>>(start);
}

/// Returns whether the start values, if any, have the alternative of StartValues that belongs to the variable's type.
bool start_has_type(const ModelVariable& v) {
  if (std::holds_alternative<std::monostate>(v.start)) return true;
  switch (v.type) {
    case Type::kFloat32:
    case Type::kFloat64:
      return holds<double>(v.start);
    case Type::kBoolean:
      return holds<bool>(v.start);
    case Type::kString:
      return holds<std::string>(v.start);
    case Type::kBinary:
      return holds<std::vector<std::uint8_t>>(v.start);
    case Type::kUInt64:
      return holds<std::uint64_t>(v.start);
    case Type::kClock:
      return false;
    default:
      break;
  }
  const auto* list = std::get_if<std::vector<std::int64_t>>(&v.start);
  if (list == nullptr) return false;
  const IntegerRange range = range_of(v.type);
  return std::all_of(list->begin(), list->end(), [&](std::int64_t n) { return n >= range.min && n <= range.max; });
}

bool is_of_fmi2(const ModelVariable& v) {
  const bool type = v.type == Type::kFloat64 || v.type == Type::kInt32 || v.type == Type::kBoolean || v.type == Type::kString ||
                    v.type == Type::kEnumeration;
  return type && v.causality != Causality::kStructuralParameter && v.dimensions.empty() && v.clocks.empty() &&
         v.aliases.empty();
}

void check_index(std::size_t index, std::size_t size, const std::string& of) {
  if (index >= size)
    throw Error(of + " refers to variable " + std::to_string(index) + " of " + std::to_string(size) + ", counted from 0");
}

void check_names(const ModelDescription& d) {
  std::unordered_set<std::string_view> names;
  std::unordered_set<std::uint32_t> references;
  const auto name_once = [&](const std::string& name) {
    if (!is_variable_name(name)) throw Error("a variable's name is empty, too long or has control characters");
    if (!names.insert(name).second) throw Error("variable " + shown(name) + " appears twice");
  };
  for (const ModelVariable& v : d.variables) {
    name_once(v.name);
    for (const Alias& alias : v.aliases) name_once(alias.name);
    if (!references.insert(v.reference).second && d.version != Version::k2)
      throw Error("value reference " + std::to_string(v.reference) + " appears twice");
  }
  names.clear();
  for (const TypeDefinition& t : d.types) {
    if (!names.insert(t.name).second) throw Error("type " + shown(t.name) + " is defined twice");
    check_range(t.numeric);
  }
  names.clear();
  for (const MeasurementUnit& unit : d.units) {
    if (!names.insert(unit.name).second) throw Error("unit " + shown(unit.name) + " is defined twice");
    if (unit.definition) check_unit(*unit.definition);
  }
}

}  // namespace

IntegerRange range_of(Type type) {
  switch (type) {
    case Type::kInt8:
      return {-128, 127};
    case Type::kUInt8:
      return {0, 255};
    case Type::kInt16:
      return {-32768, 32767};
    case Type::kUInt16:
      return {0, 65535};
    case Type::kInt32:
      return {std::numeric_limits<std::int32_t>::min(), std::numeric_limits<std::int32_t>::max()};
    case Type::kUInt32:
      return {0, std::numeric_limits<std::uint32_t>::max()};
    default:
      return {std::numeric_limits<std::int64_t>::min(), std::numeric_limits<std::int64_t>::max()};
  }
}

std::optional<Version> version_of(std::string_view fmi_version) {
  if (fmi_version == "2.0") return Version::k2;
  if (fmi_version.starts_with("3.")) return Version::k3;
  return std::nullopt;
}

bool is_file_name(std::string_view name) {
  return !name.empty() && name.size() <= 255 && name.find_first_of("/\\") == std::string_view::npos &&
         !has_control_characters(name) && name != "." && name != "..";
}

bool is_library_name(std::string_view name) { return is_file_name(name) && name.size() <= 200 && name.front() != '.'; }

bool is_variable_name(std::string_view name) { return !name.empty() && name.size() <= 10'000 && !has_control_characters(name); }

void check_unit(const UnitDefinition& unit) {
  for (const int exponent : {unit.kg, unit.m, unit.s, unit.A, unit.K, unit.mol, unit.cd, unit.rad}) {
    if (exponent < -99 || exponent > 99) throw Error("unit " + shown(unit.name) + ": exponent beyond ±99");
  }
  if (!std::isnormal(unit.factor) || !std::isfinite(unit.offset))
    throw Error("unit " + shown(unit.name) + ": factor 0, or factor or offset not finite");
}

void check_range(const Numeric& numeric) {
  if (numeric.min && numeric.max && *numeric.min > *numeric.max) throw Error("min is greater than max");
}

void check_event_indicators(std::uint64_t n) {
  if (n > kMaxElements) throw Error(std::to_string(n) + " event indicators, expected at most " + std::to_string(kMaxElements));
}

void check_dimension(const Dimension& dimension) {
  if (dimension.size.has_value() == dimension.reference.has_value())
    throw Error("a dimension needs either start or valueReference, but not both");
}

DescriptionCheck::DescriptionCheck(const ModelDescription& description) : d_(description) {
  for (std::size_t i = 0; i < d_.variables.size(); ++i) index_.emplace(d_.variables[i].reference, i);
  for (const TypeDefinition& type : d_.types) types_.emplace(type.name, &type);
}

std::optional<std::size_t> DescriptionCheck::index_of(std::uint32_t reference) const {
  const auto found = index_.find(reference);
  return found == index_.end() ? std::nullopt : std::optional(found->second);
}

void DescriptionCheck::variable(const ModelVariable& v) {
  const std::string name = "variable '" + v.name + "'";
  check_range(v.numeric);
  if (!v.declared_type.empty()) {
    const auto found = types_.find(v.declared_type);
    if (found == types_.end()) throw Error(name + ": type '" + v.declared_type + "' is not defined");
    if (found->second->type != v.type) {
      throw Error(name + " is " + std::string(name_of(v.type)) + ", but its type '" + v.declared_type + "' is " +
                  std::string(name_of(found->second->type)));
    }
  }
  if (v.derivative) {
    check_index(*v.derivative, d_.variables.size(), name + ": derivative");
    const ModelVariable& of = d_.variables[*v.derivative];
    if (!is_float(of.type)) throw Error(name + ": derivative of '" + of.name + "', expected a floating-point variable");
  }
  for (const std::uint32_t clock : v.clocks) {
    const std::optional<std::size_t> found = index_of(clock);
    if (!found || d_.variables[*found].type != Type::kClock)
      throw Error(name + ": clock " + std::to_string(clock) + " is not a variable of type Clock");
  }
  if (v.previous && !index_of(*v.previous)) throw Error(name + ": no variable has the value reference of 'previous'");
  const std::size_t size = elements(v);
  total_ += size;
  if (total_ > kMaxElements) throw Error("the variables have more than " + std::to_string(kMaxElements) + " elements together");
  const std::size_t given = std::visit(
      [](const auto& start) -> std::size_t {
        if constexpr (std::is_same_v<std::remove_cvref_t<decltype(start)>, std::monostate>) {
          return 0;
        } else {
          return start.size();
        }
      },
      v.start);
  const bool none = std::holds_alternative<std::monostate>(v.start);
  // A single start value applies to all elements of an array (FMI 3.0, 2.4.7.4).
  if (!none && given != size && !(given == 1 && !v.dimensions.empty())) {
    throw Error(name + ": " + std::to_string(given) + " start values for " + std::to_string(size) + " elements");
  }
  if (v.causality == Causality::kStructuralParameter && none)
    throw Error("structural parameter '" + v.name + "' has no start value, expected one");
}

std::size_t DescriptionCheck::elements(const ModelVariable& v) const {
  std::uint64_t n = 1;
  for (const Dimension& dimension : v.dimensions) {
    check_dimension(dimension);
    std::uint64_t extent = dimension.size.value_or(0);
    if (dimension.reference) {
      const std::optional<std::size_t> found = index_of(*dimension.reference);
      const ModelVariable* parameter = found ? &d_.variables[*found] : nullptr;
      const auto* start = parameter == nullptr ? nullptr : std::get_if<std::vector<std::uint64_t>>(&parameter->start);
      const bool fits = parameter != nullptr && (parameter->causality == Causality::kStructuralParameter ||
                                                 parameter->variability == Variability::kConstant);
      if (!fits || start == nullptr || start->size() != 1) {
        throw Error("variable '" + v.name + "': the dimension's reference " + std::to_string(*dimension.reference) +
                    " is not a structural parameter or constant of type UInt64");
      }
      extent = start->front();
    }
    if (extent > kMaxElements || n * extent > kMaxElements) {
      throw Error("variable '" + v.name + "' has more than " + std::to_string(kMaxElements) + " elements");
    }
    n *= extent;
  }
  return static_cast<std::size_t>(n);
}

void DescriptionCheck::derivative(const Unknown& unknown) const {
  const ModelVariable& v = d_.variables[unknown.variable];
  if (!is_float(v.type) || !v.derivative) throw Error("'" + v.name + "' is not the derivative of a variable");
  if (v.type != Type::kFloat64 || d_.variables[*v.derivative].type != Type::kFloat64)
    throw Error("'" + v.name + "': expected a continuous state of type Float64");
  if (elements(v) != elements(d_.variables[*v.derivative])) throw Error("'" + v.name + "' differs in size from its state");
}

void check_all(const ModelDescription& d) {
  if (!d.fmi_version.empty() && version_of(d.fmi_version) != d.version)
    throw Error("FMI " + shown(d.fmi_version) + " does not belong to version " + std::to_string(static_cast<int>(d.version)));
  check_event_indicators(d.event_indicators);
  if (!d.model_exchange && !d.co_simulation && !d.scheduled_execution)
    throw Error("neither ModelExchange nor CoSimulation, expected one of them");
  for (const auto* interface : {&d.model_exchange, &d.co_simulation, &d.scheduled_execution}) {
    if (*interface && !is_library_name((*interface)->model_identifier))
      throw Error("modelIdentifier " + shown((*interface)->model_identifier) + ", expected the name of a shared library");
  }
  check_names(d);
  DescriptionCheck check(d);
  for (const ModelVariable& v : d.variables) {
    if (d.version == Version::k2 && !is_of_fmi2(v)) throw Error("variable '" + v.name + "' is not possible in FMI 2.0");
    if (!start_has_type(v))
      throw Error("variable '" + v.name + "': start values are not of type " + std::string(name_of(v.type)));
    check.variable(v);
  }
  const ModelStructure& s = d.structure;
  for (const auto* list : {&s.outputs, &s.derivatives, &s.clocked_states, &s.initial_unknowns, &s.event_indicators}) {
    for (const Unknown& unknown : *list) {
      check_index(unknown.variable, d.variables.size(), "ModelStructure");
      const std::vector<std::size_t> dependencies = unknown.dependencies.value_or(std::vector<std::size_t>{});
      for (const std::size_t i : dependencies) check_index(i, d.variables.size(), "ModelStructure");
      if (!unknown.kinds.empty() && unknown.kinds.size() != dependencies.size())
        throw Error("dependenciesKind differs in length from dependencies");
      if (list == &s.derivatives) check.derivative(unknown);
    }
  }
}

}  // namespace cotwin::fmu
