#pragma once
#include <cstddef>
#include <cstdint>
#include <iosfwd>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <variant>
#include <vector>

#include "models/foundation/formats/parameter_set.h"

/// The contents of modelDescription.xml as plain values, for FMI 2 and FMI 3. References to variables are indices into
/// ModelDescription::variables, counted from 0. In XML, FMI 2 writes them as indices from 1 and FMI 3 as value references.
namespace cotwin::fmu {

enum class Version : std::uint8_t { k2 = 2, k3 = 3 };

/// FMI 2's Real and Integer are kFloat64 and kInt32.
enum class Type : std::uint8_t {
  kFloat32,
  kFloat64,
  kInt8,
  kUInt8,
  kInt16,
  kUInt16,
  kInt32,
  kUInt32,
  kInt64,
  kUInt64,
  kBoolean,
  kString,
  kBinary,
  kEnumeration,
  kClock
};
enum class Causality : std::uint8_t {
  kParameter,
  kCalculatedParameter,
  kInput,
  kOutput,
  kLocal,
  kIndependent,
  kStructuralParameter
};
enum class Variability : std::uint8_t { kConstant, kFixed, kTunable, kDiscrete, kContinuous };
enum class Initial : std::uint8_t { kExact, kApprox, kCalculated };
enum class DependencyKind : std::uint8_t { kDependent, kConstant, kFixed, kTunable, kDiscrete };
enum class IntervalVariability : std::uint8_t { kConstant, kFixed, kTunable, kChanging, kCountdown, kTriggered };

constexpr Version first(Version) { return Version::k2; }
constexpr Version last(Version) { return Version::k3; }
constexpr Type last(Type) { return Type::kClock; }
constexpr Causality last(Causality) { return Causality::kStructuralParameter; }
constexpr Variability last(Variability) { return Variability::kContinuous; }
constexpr Initial last(Initial) { return Initial::kCalculated; }
constexpr DependencyKind last(DependencyKind) { return DependencyKind::kDiscrete; }
constexpr IntervalVariability last(IntervalVariability) { return IntervalVariability::kTriggered; }

/// The names in the standard: "Float64" (FMI 3), "calculatedParameter", …
std::string_view name_of(Type);
std::string_view name_of(Causality);
std::string_view name_of(Variability);
std::string_view name_of(Initial);
std::string_view name_of(DependencyKind);
std::string_view name_of(IntervalVariability);

/// The start values of a variable, one per element; monostate if there are none. Floats are stored as double; signed integers,
/// enumerations and unsigned integers below 64 bits as int64.
using StartValues = std::variant<std::monostate, std::vector<double>, std::vector<std::int64_t>, std::vector<std::uint64_t>,
                                 std::vector<bool>, std::vector<std::string>, std::vector<std::vector<std::uint8_t>>>;

/// Attributes of a numeric variable or type. Limits of integers beyond 2^53 are rounded.
struct Numeric {
  std::string quantity, unit, display_unit;
  bool relative_quantity = false;
  bool unbounded = false;
  std::optional<double> min, max, nominal;
  static auto fields(auto& n, auto each) {
    return each(n.quantity, n.unit, n.display_unit, n.relative_quantity, n.unbounded, n.min, n.max, n.nominal);
  }
  friend bool operator==(const Numeric&, const Numeric&) = default;
};

struct Clock {
  bool can_be_deactivated = false;
  std::optional<std::uint32_t> priority;
  IntervalVariability interval_variability = IntervalVariability::kTriggered;
  std::optional<double> interval;  // s
  double shift = 0;                // s
  bool supports_fraction = false;
  std::optional<std::uint64_t> resolution, interval_counter;
  std::uint64_t shift_counter = 0;
  static auto fields(auto& c, auto each) {
    return each(c.can_be_deactivated, c.priority, c.interval_variability, c.interval, c.shift, c.supports_fraction,
                c.resolution, c.interval_counter, c.shift_counter);
  }
  friend bool operator==(const Clock&, const Clock&) = default;
};

/// The extent of one dimension of an array: a number, or the value of a structural parameter.
struct Dimension {
  std::optional<std::uint64_t> size;
  std::optional<std::uint32_t> reference;  // value reference
  static auto fields(auto& d, auto each) { return each(d.size, d.reference); }
  friend bool operator==(const Dimension&, const Dimension&) = default;
};

/// Another name of the same variable (FMI 3; in FMI 2 an alias is a variable with the same value reference).
struct Alias {
  std::string name, description, display_unit;
  static auto fields(auto& a, auto each) { return each(a.name, a.description, a.display_unit); }
  friend bool operator==(const Alias&, const Alias&) = default;
};

struct ModelVariable {
  std::string name;
  std::uint32_t reference = 0;  // value reference
  Type type = Type::kFloat64;
  std::string description;
  Causality causality = Causality::kLocal;
  Variability variability = Variability::kContinuous;
  std::optional<Initial> initial;
  std::optional<bool> can_handle_multiple_set;
  std::vector<std::uint32_t> clocks;  // value references
  std::vector<Dimension> dimensions;  // none: a scalar
  bool intermediate_update = false;
  std::optional<std::uint32_t> previous;  // value reference
  std::string declared_type;
  Numeric numeric;
  StartValues start;
  std::optional<std::size_t> derivative;  // index of the variable whose time derivative this is
  bool reinit = false;
  std::string mime_type;  // kBinary
  std::optional<std::uint64_t> max_size;
  Clock clock;  // kClock
  std::vector<Alias> aliases;
  /// Inputs of FMI 2: false if our annotation excludes this input from canInterpolateInputs.
  bool interpolated = true;
  static auto fields(auto& v, auto each) {
    return each(v.name, v.reference, v.type, v.description, v.causality, v.variability, v.initial, v.can_handle_multiple_set,
                v.clocks, v.dimensions, v.intermediate_update, v.previous, v.declared_type, v.numeric, v.start, v.derivative,
                v.reinit, v.mime_type, v.max_size, v.clock, v.aliases, v.interpolated);
  }
  friend bool operator==(const ModelVariable&, const ModelVariable&) = default;
};

struct EnumerationItem {
  std::string name;
  std::int64_t value = 0;
  std::string description;
  static auto fields(auto& i, auto each) { return each(i.name, i.value, i.description); }
  friend bool operator==(const EnumerationItem&, const EnumerationItem&) = default;
};

/// A type definition; variables refer to it by `declared_type`.
struct TypeDefinition {
  std::string name;
  Type type = Type::kFloat64;
  std::string description;
  Numeric numeric;
  std::vector<EnumerationItem> items;  // kEnumeration
  std::string mime_type;               // kBinary
  std::optional<std::uint64_t> max_size;
  Clock clock;  // kClock
  static auto fields(auto& t, auto each) {
    return each(t.name, t.type, t.description, t.numeric, t.items, t.mime_type, t.max_size, t.clock);
  }
  friend bool operator==(const TypeDefinition&, const TypeDefinition&) = default;
};

struct DisplayUnit {
  std::string name;
  double factor = 1, offset = 0;
  bool inverse = false;
  static auto fields(auto& u, auto each) { return each(u.name, u.factor, u.offset, u.inverse); }
  friend bool operator==(const DisplayUnit&, const DisplayUnit&) = default;
};

/// A unit of measure; without a definition it has a name only.
struct MeasurementUnit {
  std::string name;
  std::optional<UnitDefinition> definition;
  std::vector<DisplayUnit> display_units;
  static auto fields(auto& u, auto each) { return each(u.name, u.definition, u.display_units); }
  friend bool operator==(const MeasurementUnit&, const MeasurementUnit&) = default;
};

struct Unknown {
  std::size_t variable = 0;
  std::optional<std::vector<std::size_t>> dependencies;  // no value: on all possible variables
  std::vector<DependencyKind> kinds;                     // empty, or one per dependency
  static auto fields(auto& u, auto each) { return each(u.variable, u.dependencies, u.kinds); }
  friend bool operator==(const Unknown&, const Unknown&) = default;
};

struct ModelStructure {
  std::vector<Unknown> outputs, derivatives, clocked_states, initial_unknowns, event_indicators;
  static auto fields(auto& s, auto each) {
    return each(s.outputs, s.derivatives, s.clocked_states, s.initial_unknowns, s.event_indicators);
  }
  friend bool operator==(const ModelStructure&, const ModelStructure&) = default;
};

/// One interface type of an FMU (Co-Simulation, Model Exchange or Scheduled Execution) and its capabilities.
struct Interface {
  std::string model_identifier;  // name of the shared library without its ending
  bool needs_execution_tool = false;
  bool only_once_per_process = false;
  bool can_get_and_set_state = false;
  bool can_serialise_state = false;
  bool provides_directional_derivatives = false;
  bool provides_adjoint_derivatives = false;
  bool provides_per_element_dependencies = false;
  // Co-Simulation
  bool variable_step = false;
  std::optional<double> fixed_internal_step;  // s
  unsigned max_output_derivative_order = 0;
  int recommended_input_smoothness = 0;
  bool provides_intermediate_update = false;
  bool might_return_early = false;
  bool can_return_early_after_intermediate_update = false;
  bool has_event_mode = false;
  bool provides_evaluate_discrete_states = false;
  bool can_interpolate_inputs = false;  // FMI 2
  bool can_run_asynchronously = false;  // FMI 2
  // Model Exchange
  bool needs_completed_integrator_step = true;
  // FMI 2
  bool can_not_use_memory_functions = false;
  std::vector<std::string> source_files;
  static auto fields(auto& i, auto each) {
    return each(i.model_identifier, i.needs_execution_tool, i.only_once_per_process, i.can_get_and_set_state,
                i.can_serialise_state, i.provides_directional_derivatives, i.provides_adjoint_derivatives,
                i.provides_per_element_dependencies, i.variable_step, i.fixed_internal_step, i.max_output_derivative_order,
                i.recommended_input_smoothness, i.provides_intermediate_update, i.might_return_early,
                i.can_return_early_after_intermediate_update, i.has_event_mode, i.provides_evaluate_discrete_states,
                i.can_interpolate_inputs, i.can_run_asynchronously, i.needs_completed_integrator_step,
                i.can_not_use_memory_functions, i.source_files);
  }
  friend bool operator==(const Interface&, const Interface&) = default;
};

struct DefaultExperiment {
  std::optional<double> start, stop, tolerance, step;
  static auto fields(auto& e, auto each) { return each(e.start, e.stop, e.tolerance, e.step); }
  friend bool operator==(const DefaultExperiment&, const DefaultExperiment&) = default;
};

struct LogCategory {
  std::string name, description;
  static auto fields(auto& c, auto each) { return each(c.name, c.description); }
  friend bool operator==(const LogCategory&, const LogCategory&) = default;
};

struct ModelDescription {
  Version version = Version::k3;
  std::string fmi_version;  // as written, "2.0", "3.0", "3.0-beta.1"; empty: that of `version`
  std::string model_name, token, description, author, model_version, copyright, license, generation_tool, generation_date;
  bool structured_names = false;
  unsigned event_indicators = 0;  // FMI 2
  std::optional<Interface> model_exchange, co_simulation, scheduled_execution;
  std::vector<MeasurementUnit> units;
  std::vector<TypeDefinition> types;
  std::vector<LogCategory> log_categories;
  std::optional<DefaultExperiment> default_experiment;
  std::vector<ModelVariable> variables;
  ModelStructure structure;
  static auto fields(auto& d, auto each) {
    return each(d.version, d.fmi_version, d.model_name, d.token, d.description, d.author, d.model_version, d.copyright,
                d.license, d.generation_tool, d.generation_date, d.structured_names, d.event_indicators, d.model_exchange,
                d.co_simulation, d.scheduled_execution, d.units, d.types, d.log_categories, d.default_experiment, d.variables,
                d.structure);
  }
  friend bool operator==(const ModelDescription&, const ModelDescription&) = default;
};

/// The largest number of elements of an array, and of all variables of an FMU, that the importer accepts.
inline constexpr std::uint64_t kMaxElements = 10'000'000;

/// Look-up in a description, which must not change meanwhile.
class DescriptionIndex {
 public:
  explicit DescriptionIndex(const ModelDescription& description);

  /// Return nullptr for an unknown name.
  const ModelVariable* variable(std::string_view name) const;
  const TypeDefinition* type(std::string_view name) const;
  const MeasurementUnit* unit(std::string_view name) const;
  /// Limits, unit and nominal value of a variable; what the variable lacks is taken from its declared type.
  Numeric effective(const ModelVariable& variable) const;
  /// Returns the number of elements of a variable: the product of its dimensions. Structural parameters have the values in
  /// `chosen` (by value reference), else their start values. Throws Error above kMaxElements and for an unknown dimension.
  std::size_t elements(const ModelVariable& variable, const std::map<std::uint32_t, std::uint64_t>& chosen = {}) const;

 private:
  const ModelDescription& description_;
  std::unordered_map<std::string_view, const TypeDefinition*> types_;
  std::unordered_map<std::string_view, const MeasurementUnit*> units_;
  std::unordered_map<std::uint32_t, const ModelVariable*> extents_;  // value reference → variable that can be an array's size
  mutable std::unordered_map<std::string_view, const ModelVariable*> variables_;  // filled at the first look-up
};

/// Writes modelDescription.xml for `description.version`. Throws Error for a feature that this version lacks (an array in FMI
/// 2) and for characters that XML does not allow.
void write(std::ostream& out, const ModelDescription& description);

}  // namespace cotwin::fmu
