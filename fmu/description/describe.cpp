#include "fmu/description/describe.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <span>

#include "components/unit/si.h"
#include "fmu/description/categories.h"
#include "fmu/description/rate.h"

namespace cotwin::fmu {

namespace {

constexpr double kDegrees = 180 / std::numbers::pi;  // degrees per radian

/// A physical quantity: unit, usual name of the type, display unit.
struct Quantity {
  const char* si;
  const char* name;
  const char* display;
  double factor;  // display = factor · value
};
constexpr Quantity kQuantities[] = {
    {"rad", "Angle", "deg", kDegrees},
    {"rad/s", "AngularVelocity", "deg/s", kDegrees},
    {"rad/s2", "AngularAcceleration", "deg/s2", kDegrees},
    {"N.m", "Torque", nullptr, 1},
    {"N.m/rad", "RotationalSpringConstant", nullptr, 1},
    {"N.m.s/rad", "RotationalDampingConstant", nullptr, 1},
    {"kg.m2", "MomentOfInertia", nullptr, 1},
    {"s", "Time", "ms", 1e3},
    {"Hz", "Frequency", nullptr, 1},
    {"m", "Length", "mm", 1e3},
    {"m/s", "Velocity", nullptr, 1},
    {"m/s2", "Acceleration", nullptr, 1},
    {"N", "Force", nullptr, 1},
    {"kg", "Mass", nullptr, 1},
    {"J", "Energy", nullptr, 1},
    {"W", "Power", nullptr, 1},
};

const Quantity* quantity_of(const std::string& si) {
  const auto* found =
      std::find_if(std::begin(kQuantities), std::end(kQuantities), [&](const Quantity& q) { return si == q.si; });
  return found == std::end(kQuantities) ? nullptr : found;
}

MeasurementUnit describe_measure(const std::string& si) {
  const si::Measure m = si::parse(si);
  MeasurementUnit unit;
  unit.name = si;
  UnitDefinition base;
  base.name = si;
  int* const exponents[] = {&base.kg, &base.m, &base.s, &base.A, &base.K, &base.mol, &base.cd, &base.rad};
  for (std::size_t i = 0; i < m.exponents.size(); ++i) *exponents[i] = m.exponents[i];
  base.factor = m.factor;
  base.offset = m.offset;
  unit.definition = base;
  if (const Quantity* q = quantity_of(si); q != nullptr && q->display != nullptr) {
    unit.display_units.push_back({q->display, q->factor, 0, false});
  }
  return unit;
}

Type type_of(Kind kind) {
  switch (kind) {
    case Kind::kReal:
      return Type::kFloat64;
    case Kind::kInteger:
      return Type::kInt32;
    case Kind::kBoolean:
      return Type::kBoolean;
    case Kind::kString:
      return Type::kString;
  }
  return Type::kFloat64;
}

StartValues start_of(const Variable& v, std::size_t first, std::size_t count) {
  return std::visit(
      [&](auto all) -> StartValues {
        const auto part = all.subspan(first, count);
        using Element = typename decltype(all)::value_type;
        if constexpr (std::is_same_v<Element, std::int32_t>) {
          return std::vector<std::int64_t>(part.begin(), part.end());
        } else {
          return std::vector<Element>(part.begin(), part.end());
        }
      },
      v.storage);
}

/// Returns `count` elements of `v`, from `first` on, as an FMI variable.
ModelVariable make_variable(const Variable& v, std::size_t first, std::size_t count) {
  ModelVariable out;
  out.name = v.name;
  if (count != v.size())
    out.name.insert(v.name.size() - (v.name.ends_with(')') ? 1 : 0), "[" + std::to_string(first + 1) + "]");
  out.type = type_of(v.kind());
  out.description = v.description;
  out.variability = v.kind() == Kind::kReal && !v.discrete ? Variability::kContinuous : Variability::kDiscrete;
  switch (v.role) {
    case Role::kInput:
      out.causality = Causality::kInput;
      break;
    case Role::kOutput:
      out.causality = Causality::kOutput;
      break;
    case Role::kState:
      out.causality = Causality::kLocal;
      break;
    case Role::kParameter:
      out.causality = Causality::kParameter;
      out.variability = Variability::kFixed;
      break;
    case Role::kTunable:
      out.causality = Causality::kParameter;
      out.variability = Variability::kTunable;
      break;
  }
  switch (v.role) {
    case Role::kInput:
      break;  // FMI 2 does not allow the attribute for inputs
    case Role::kOutput:
      out.initial = Initial::kCalculated;
      break;
    case Role::kState:
      out.initial = Initial::kApprox;
      break;
    case Role::kParameter:
    case Role::kTunable:
      out.initial = Initial::kExact;
      break;
  }
  if (v.role != Role::kOutput) out.start = start_of(v, first, count);
  if (v.kind() == Kind::kReal) {
    out.numeric.unit = v.si_of(first);
    if (v.nominal > 0) out.numeric.nominal = v.nominal;
    out.numeric.relative_quantity = v.relative;
    if (const Quantity* q = quantity_of(v.si_of(first))) out.declared_type = q->name;
  }
  if (v.kind() == Kind::kReal || v.kind() == Kind::kInteger) {
    if (std::isfinite(v.min)) out.numeric.min = v.min;
    if (std::isfinite(v.max)) out.numeric.max = v.max;
  }
  return out;
}

/// The number of variables of the description that a variable is: arrays have one unit of measure, and FMI 2 has no arrays.
std::size_t parts_of(const Variable& v, Version version) { return version == Version::k2 || v.mixed() ? v.size() : 1; }

/// Adds the inputs on which an output depends directly, from the blocks of the unit's Jacobian.
void add_dependencies(ModelDescription& d, const Unit& unit, const Variables& variables,
                      const std::map<std::string, std::size_t, std::less<>>& first_of) {
  for (const Partial& p : unit.partials()) {
    const Variable &unknown = variables.at(p.unknown), &known = variables.at(p.known);
    if (known.role != Role::kInput) continue;
    const std::size_t rows = parts_of(unknown, d.version), columns = parts_of(known, d.version);
    const std::size_t row = first_of.find(unknown.name)->second, column = first_of.find(known.name)->second;
    for (Unknown& output : d.structure.outputs) {
      if (output.variable < row || output.variable >= row + rows) continue;
      for (std::size_t j = 0; j < columns; ++j) {
        if (!p.elementwise || columns == 1 || rows == 1 || j == output.variable - row)
          output.dependencies->push_back(column + j);
      }
    }
  }
  for (Unknown& output : d.structure.outputs) std::sort(output.dependencies->begin(), output.dependencies->end());
}

constexpr std::size_t kLongestList = 2000;  // of dependencies; a host assumes all where there is no list

/// Adds the inputs and parameters on which an output depends in the initialisation.
void add_initial_dependencies(ModelDescription& d, const Variables& variables,
                              const std::map<std::string, std::size_t, std::less<>>& first_of) {
  const auto append = [&](std::vector<std::size_t>& knowns, const Variable& v) {
    const std::size_t elements = parts_of(v, d.version);
    for (std::size_t i = 0; i < elements; ++i) knowns.push_back(first_of.at(v.name) + i);
  };
  std::vector<std::size_t> parameters;
  for (const Variable& v : variables) {
    if (v.role == Role::kParameter || v.role == Role::kTunable) append(parameters, v);
  }
  if (parameters.size() > kLongestList) return;
  for (const Variable& output : variables) {
    if (!output.initial_inputs) continue;
    std::vector<std::size_t> knowns = parameters, unknowns;
    for (const std::string& input : *output.initial_inputs) append(knowns, variables.at(input));
    std::ranges::sort(knowns);
    append(unknowns, output);
    auto unknown = std::ranges::lower_bound(d.structure.initial_unknowns, unknowns.front(), {}, &Unknown::variable);
    for (std::size_t i = 0; i < unknowns.size(); ++i) (unknown++)->dependencies = knowns;
  }
}

}  // namespace

ModelDescription describe(const UnitType& type, const Unit& unit, const Variables& variables, Version version) {
  const bool scalars = version == Version::k2;
  ModelDescription d;
  d.version = version;
  d.model_name = type.name;
  d.description = type.summary;
  d.author = "Cotwin";
  d.generation_tool = kGenerationTool;
  d.license = "Apache-2.0, with parts under licenses of their own: see documentation/licenses";
  d.structured_names = true;
  d.default_experiment = DefaultExperiment{0.0, 1.0, std::nullopt, 1e-3};
  for (const LogCategoryText& c : kLogCategoryTexts) d.log_categories.push_back({c.name, c.description});

  Interface co;
  co.model_identifier = type.name;
  co.can_get_and_set_state = co.can_serialise_state = unit.restorable();
  co.variable_step = true;
  co.can_not_use_memory_functions = true;
  co.provides_directional_derivatives = !unit.partials().empty();
  co.provides_adjoint_derivatives = !scalars && co.provides_directional_derivatives;
  const bool derivatives =
      std::any_of(variables.begin(), variables.end(), [](const auto& v) { return !v.derivative_of.empty(); });
  co.max_output_derivative_order = derivatives ? 1 : 0;
  co.can_interpolate_inputs = std::any_of(variables.begin(), variables.end(), [](const auto& v) { return !v.rate.empty(); });
  d.co_simulation = co;

  ModelVariable time;
  time.name = "time";
  time.description = "independent variable";
  time.causality = Causality::kIndependent;
  time.numeric.unit = "s";
  time.declared_type = "Time";
  d.variables.push_back(time);

  std::vector<std::string> measures = {"s"};
  std::map<std::string, std::size_t, std::less<>> first_of;  // variable → index of its first element
  const auto use = [&](const std::string& si) {
    if (!si.empty() && std::find(measures.begin(), measures.end(), si) == measures.end()) measures.push_back(si);
  };
  for (const Variable& v : variables) {
    const std::size_t parts = parts_of(v, version);
    first_of[v.name] = d.variables.size();
    for (std::size_t part = 0; part < parts; ++part) {
      ModelVariable out = make_variable(v, part, v.size() / parts);
      out.reference = static_cast<std::uint32_t>(d.variables.size());
      const bool held = v.role == Role::kInput && v.kind() == Kind::kReal && v.rate.empty();
      out.interpolated = !(scalars && co.can_interpolate_inputs && held);
      if (!scalars && v.size() > parts) out.dimensions.push_back({v.size(), std::nullopt});
      if (v.kind() == Kind::kReal) use(v.si_of(part));
      if (!v.derivative_of.empty()) out.derivative = first_of.at(v.derivative_of) + part;
      if (v.role == Role::kOutput) {
        // Outputs are computed at the end of a step. Values set afterwards do not change them, except through the
        // dependencies that add_dependencies adds.
        d.structure.outputs.push_back({d.variables.size(), std::vector<std::size_t>{}, {}});
        d.structure.initial_unknowns.push_back({d.variables.size(), std::nullopt, {}});
      }
      d.variables.push_back(std::move(out));
    }
  }
  for (const Variable& v : variables) {
    if (scalars || v.rate.empty()) continue;
    const Variable rate = rate_variable(v);
    const std::size_t parts = parts_of(rate, version);
    for (std::size_t part = 0; part < parts; ++part) {
      use(rate.si_of(part));
      ModelVariable out = make_variable(rate, part, rate.size() / parts);
      out.reference = static_cast<std::uint32_t>(d.variables.size());
      if (rate.size() > parts) out.dimensions.push_back({rate.size(), std::nullopt});
      out.derivative = first_of.at(v.name) + part;
      d.variables.push_back(std::move(out));
    }
  }
  add_dependencies(d, unit, variables, first_of);
  add_initial_dependencies(d, variables, first_of);
  std::sort(measures.begin(), measures.end());
  for (const std::string& si : measures) {
    d.units.push_back(describe_measure(si));
    if (const Quantity* q = quantity_of(si)) {
      TypeDefinition definition;
      definition.name = q->name;
      definition.numeric.quantity = q->name;
      definition.numeric.unit = si;
      if (q->display != nullptr) definition.numeric.display_unit = q->display;
      d.types.push_back(std::move(definition));
    }
  }
  return d;
}

}  // namespace cotwin::fmu
