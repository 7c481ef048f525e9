#include <cmath>
#include <ostream>

#include "fmu/description/consistency.h"
#include "fmu/description/model_description.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

std::string to_xml(double value) {
  if (std::isnan(value)) return "NaN";
  if (std::isinf(value)) return value > 0 ? "INF" : "-INF";
  return text::to_text(value);
}
std::string to_xml(bool value) { return value ? "true" : "false"; }
std::string to_xml(std::int64_t value) { return std::to_string(value); }
std::string to_xml(std::uint64_t value) { return std::to_string(value); }

bool is_integer(Type type) { return type >= Type::kInt8 && type <= Type::kUInt64; }

/// Writes one XML element: first its attributes, then its children.
class Tag {
 public:
  Tag(std::ostream& out, int depth, std::string_view name) : out_(out), depth_(depth), name_(name) {
    indent(depth_);
    out_ << '<' << name_;
  }
  Tag(const Tag&) = delete;
  ~Tag() {
    if (!open_) {
      out_ << "/>\n";
    } else {
      indent(depth_);
      out_ << "</" << name_ << ">\n";
    }
  }

  Tag& set(std::string_view name, std::string_view value) {
    out_ << ' ' << name << "=\"" << xml::escaped(value) << '"';
    return *this;
  }
  Tag& set_if(std::string_view name, std::string_view value) { return value.empty() ? *this : set(name, value); }
  /// Writes the attribute unless it has the standard's default value.
  Tag& flag(std::string_view name, bool value, bool standard = false) {
    return value == standard ? *this : set(name, to_xml(value));
  }
  template <class Number>
  Tag& number(std::string_view name, const std::optional<Number>& value) {
    if constexpr (std::is_same_v<Number, double>) return value ? set(name, to_xml(*value)) : *this;
    return value ? set(name, std::to_string(*value)) : *this;
  }
  Tag child(std::string_view name) {
    if (!open_) out_ << ">\n";
    open_ = true;
    return Tag(out_, depth_ + 1, name);
  }

 private:
  void indent(int depth) { out_ << std::string(static_cast<std::size_t>(2 * depth), ' '); }

  std::ostream& out_;
  int depth_;
  std::string name_;
  bool open_ = false;
};

template <class Range, class Print>
std::string list(const Range& values, Print print) {
  std::string text;
  for (const auto& value : values) text::append(text, print(value), " ");
  return text;
}

class Writer {
 public:
  Writer(std::ostream& out, const ModelDescription& description)
      : out_(out), d_(description), fmi2_(description.version == Version::k2) {}

  void write() {
    out_ << "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n";
    Tag root(out_, 0, "fmiModelDescription");
    root.set("fmiVersion", !d_.fmi_version.empty() ? d_.fmi_version : fmi2_ ? "2.0" : "3.0").set("modelName", d_.model_name);
    root.set(fmi2_ ? "guid" : "instantiationToken", d_.token).set_if("description", d_.description).set_if("author", d_.author);
    root.set_if("version", d_.model_version).set_if("copyright", d_.copyright).set_if("license", d_.license);
    root.set_if("generationTool", d_.generation_tool).set_if("generationDateAndTime", d_.generation_date);
    root.set("variableNamingConvention", d_.structured_names ? "structured" : "flat");
    if (fmi2_) root.set("numberOfEventIndicators", std::to_string(d_.event_indicators));

    if (d_.model_exchange) model_exchange(root, *d_.model_exchange);
    if (d_.co_simulation) co_simulation(root, *d_.co_simulation);
    if (d_.scheduled_execution) {
      if (fmi2_) throw Error(d_.model_name, "Scheduled Execution does not exist in FMI 2");
      Tag tag = root.child("ScheduledExecution");
      common(tag, *d_.scheduled_execution);
    }
    units(root);
    types(root);
    if (!d_.log_categories.empty()) {
      Tag categories = root.child("LogCategories");
      for (const LogCategory& c : d_.log_categories) {
        categories.child("Category").set("name", c.name).set_if("description", c.description);
      }
    }
    if (d_.default_experiment) {
      const DefaultExperiment& e = *d_.default_experiment;
      root.child("DefaultExperiment")
          .number("startTime", e.start)
          .number("stopTime", e.stop)
          .number("tolerance", e.tolerance)
          .number("stepSize", e.step);
    }
    {
      Tag variables = root.child("ModelVariables");
      for (const ModelVariable& v : d_.variables) {
        if (fmi2_) {
          scalar(variables, v);
        } else {
          variable(variables, v);
        }
      }
    }
    if (fmi2_) {
      structure2(root);
    } else {
      structure3(root);
    }
  }

 private:
  void common(Tag& tag, const Interface& i) {
    tag.set("modelIdentifier", i.model_identifier).flag("needsExecutionTool", i.needs_execution_tool);
    tag.flag("canBeInstantiatedOnlyOncePerProcess", i.only_once_per_process);
    tag.flag(fmi2_ ? "canGetAndSetFMUstate" : "canGetAndSetFMUState", i.can_get_and_set_state);
    tag.flag(fmi2_ ? "canSerializeFMUstate" : "canSerializeFMUState", i.can_serialise_state);
    tag.flag(fmi2_ ? "providesDirectionalDerivative" : "providesDirectionalDerivatives", i.provides_directional_derivatives);
    if (fmi2_) {
      tag.flag("canNotUseMemoryManagementFunctions", i.can_not_use_memory_functions);
    } else {
      tag.flag("providesAdjointDerivatives", i.provides_adjoint_derivatives);
      tag.flag("providesPerElementDependencies", i.provides_per_element_dependencies);
    }
  }

  void sources(Tag& tag, const Interface& i) {
    if (!fmi2_ || i.source_files.empty()) return;
    Tag files = tag.child("SourceFiles");
    for (const std::string& file : i.source_files) files.child("File").set("name", file);
  }

  void model_exchange(Tag& root, const Interface& i) {
    Tag tag = root.child("ModelExchange");
    common(tag, i);
    if (fmi2_) {
      tag.flag("completedIntegratorStepNotNeeded", !i.needs_completed_integrator_step);
    } else {
      tag.flag("needsCompletedIntegratorStep", i.needs_completed_integrator_step);
      tag.flag("providesEvaluateDiscreteStates", i.provides_evaluate_discrete_states);
    }
    sources(tag, i);
  }

  void co_simulation(Tag& root, const Interface& i) {
    Tag tag = root.child("CoSimulation");
    common(tag, i);
    tag.flag("canHandleVariableCommunicationStepSize", i.variable_step);
    if (i.max_output_derivative_order > 0) tag.set("maxOutputDerivativeOrder", std::to_string(i.max_output_derivative_order));
    if (fmi2_) {
      tag.flag("canInterpolateInputs", i.can_interpolate_inputs).flag("canRunAsynchronuously", i.can_run_asynchronously);
    } else {
      tag.number("fixedInternalStepSize", i.fixed_internal_step);
      if (i.recommended_input_smoothness != 0) {
        tag.set("recommendedIntermediateInputSmoothness", std::to_string(i.recommended_input_smoothness));
      }
      tag.flag("providesIntermediateUpdate", i.provides_intermediate_update);
      tag.flag("mightReturnEarlyFromDoStep", i.might_return_early);
      tag.flag("canReturnEarlyAfterIntermediateUpdate", i.can_return_early_after_intermediate_update);
      tag.flag("hasEventMode", i.has_event_mode).flag("providesEvaluateDiscreteStates", i.provides_evaluate_discrete_states);
    }
    sources(tag, i);
  }

  void units(Tag& root) {
    if (d_.units.empty()) return;
    Tag all = root.child("UnitDefinitions");
    for (const MeasurementUnit& u : d_.units) {
      Tag tag = all.child("Unit");
      tag.set("name", u.name);
      if (u.definition) {
        const UnitDefinition& b = *u.definition;
        Tag base = tag.child("BaseUnit");
        const std::pair<const char*, int> exponents[] = {{"kg", b.kg}, {"m", b.m},     {"s", b.s},   {"A", b.A},
                                                         {"K", b.K},   {"mol", b.mol}, {"cd", b.cd}, {"rad", b.rad}};
        for (const auto& [name, exponent] : exponents) {
          if (exponent != 0) base.set(name, std::to_string(exponent));
        }
        if (b.factor != 1) base.set("factor", to_xml(b.factor));
        if (b.offset != 0) base.set("offset", to_xml(b.offset));
      }
      for (const DisplayUnit& display : u.display_units) {
        Tag shown = tag.child("DisplayUnit");
        shown.set("name", display.name);
        if (display.factor != 1) shown.set("factor", to_xml(display.factor));
        if (display.offset != 0) shown.set("offset", to_xml(display.offset));
        if (display.inverse && fmi2_) throw Error(display.name, "inverse display units do not exist in FMI 2");
        shown.flag("inverse", display.inverse);
      }
    }
  }

  void numeric(Tag& tag, const Numeric& n, Type type) {
    tag.set_if("quantity", n.quantity);
    if (is_float(type)) {
      tag.set_if("unit", n.unit).set_if("displayUnit", n.display_unit).flag("relativeQuantity", n.relative_quantity);
      tag.flag("unbounded", n.unbounded).number("min", n.min).number("max", n.max).number("nominal", n.nominal);
    } else {
      const auto whole = [](const std::optional<double>& value) {
        return value ? std::optional(static_cast<std::int64_t>(*value)) : std::nullopt;
      };
      tag.number("min", whole(n.min)).number("max", whole(n.max));
    }
  }

  void clock(Tag& tag, const Clock& c) {
    tag.flag("canBeDeactivated", c.can_be_deactivated).number("priority", c.priority);
    tag.set("intervalVariability", name_of(c.interval_variability)).number("intervalDecimal", c.interval);
    if (c.shift != 0) tag.set("shiftDecimal", to_xml(c.shift));
    tag.flag("supportsFraction", c.supports_fraction).number("resolution", c.resolution);
    tag.number("intervalCounter", c.interval_counter);
    if (c.shift_counter != 0) tag.set("shiftCounter", std::to_string(c.shift_counter));
  }

  std::string_view name2(Type type, const std::string& who) {
    switch (type) {
      case Type::kFloat64:
        return "Real";
      case Type::kInt32:
        return "Integer";
      case Type::kBoolean:
        return "Boolean";
      case Type::kString:
        return "String";
      case Type::kEnumeration:
        return "Enumeration";
      default:
        throw Error(who, "type " + std::string(name_of(type)) + " does not exist in FMI 2");
    }
  }

  void items(Tag& tag, const TypeDefinition& t) {
    for (const EnumerationItem& item : t.items) {
      tag.child("Item").set("name", item.name).set("value", to_xml(item.value)).set_if("description", item.description);
    }
  }

  void types(Tag& root) {
    if (d_.types.empty()) return;
    Tag all = root.child("TypeDefinitions");
    for (const TypeDefinition& t : d_.types) {
      const bool numbers = is_float(t.type) || is_integer(t.type) || t.type == Type::kEnumeration;
      if (fmi2_) {
        Tag simple = all.child("SimpleType");
        simple.set("name", t.name).set_if("description", t.description);
        Tag tag = simple.child(name2(t.type, t.name));
        if (t.type == Type::kEnumeration) {
          tag.set_if("quantity", t.numeric.quantity);
        } else if (numbers) {
          numeric(tag, t.numeric, t.type);
        }
        items(tag, t);
      } else {
        Tag tag = all.child(std::string(name_of(t.type)) + "Type");
        tag.set("name", t.name).set_if("description", t.description);
        if (numbers) numeric(tag, t.numeric, t.type);
        if (t.type == Type::kBinary) tag.set_if("mimeType", t.mime_type).number("maxSize", t.max_size);
        if (t.type == Type::kClock) clock(tag, t.clock);
        items(tag, t);
      }
    }
  }

  /// Writes the attributes of a variable that are equal in both versions.
  void variable_head(Tag& tag, const ModelVariable& v) {
    tag.set("name", v.name).set("valueReference", std::to_string(v.reference)).set_if("description", v.description);
    tag.set("causality", name_of(v.causality));
    if (v.type != Type::kClock) tag.set("variability", name_of(v.variability));
    if (v.can_handle_multiple_set) tag.set("canHandleMultipleSetPerTimeInstant", to_xml(*v.can_handle_multiple_set));
  }

  void scalar(Tag& all, const ModelVariable& v) {
    if (v.causality == Causality::kStructuralParameter || !v.dimensions.empty() || !v.clocks.empty() || !v.aliases.empty() ||
        v.previous || v.intermediate_update) {
      throw Error(v.name, "has dimensions, clocks, aliases or intermediate updates, which do not exist in FMI 2");
    }
    Tag outer = all.child("ScalarVariable");
    variable_head(outer, v);
    if (v.initial) outer.set("initial", name_of(*v.initial));
    content2(outer, v);
    if (!v.interpolated)
      outer.child("Annotations").child("Tool").set("name", "cotwin").child("Input").set("interpolated", "false");
  }

  void content2(Tag& outer, const ModelVariable& v) {
    Tag tag = outer.child(name2(v.type, v.name));
    tag.set_if("declaredType", v.declared_type);
    if (is_float(v.type) || is_integer(v.type) || v.type == Type::kEnumeration) numeric(tag, v.numeric, v.type);
    if (v.start.index() != 0) {
      std::string value;
      std::visit(
          [&](const auto& values) {
            if constexpr (!std::is_same_v<std::decay_t<decltype(values)>, std::monostate>) {
              if (values.size() != 1)
                throw Error(v.name, std::to_string(values.size()) + " start values, expected one in FMI 2");
              using Element = typename std::decay_t<decltype(values)>::value_type;
              if constexpr (std::is_same_v<Element, std::string>) {
                value = values.front();
              } else if constexpr (!std::is_same_v<Element, std::vector<std::uint8_t>>) {
                value = to_xml(static_cast<Element>(values.front()));
              }
            }
          },
          v.start);
      tag.set("start", value);
    }
    if (v.derivative) tag.set("derivative", std::to_string(*v.derivative + 1));
    tag.flag("reinit", v.reinit);
  }

  void variable(Tag& all, const ModelVariable& v) {
    Tag tag = all.child(name_of(v.type));
    variable_head(tag, v);
    const auto number = [](auto value) { return std::to_string(value); };
    if (!v.clocks.empty()) tag.set("clocks", list(v.clocks, number));
    if (v.type == Type::kClock) {
      tag.set_if("declaredType", v.declared_type);
      clock(tag, v.clock);
      aliases(tag, v);
      return;
    }
    tag.flag("intermediateUpdate", v.intermediate_update).number("previous", v.previous);
    tag.set_if("declaredType", v.declared_type);
    if (v.initial) tag.set("initial", name_of(*v.initial));
    if (is_float(v.type) || is_integer(v.type) || v.type == Type::kEnumeration) numeric(tag, v.numeric, v.type);
    if (v.type == Type::kBinary) tag.set_if("mimeType", v.mime_type).number("maxSize", v.max_size);
    if (const auto* reals = std::get_if<std::vector<double>>(&v.start)) {
      tag.set("start", list(*reals, [](double x) { return to_xml(x); }));
    } else if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&v.start)) {
      tag.set("start", list(*integers, number));
    } else if (const auto* naturals = std::get_if<std::vector<std::uint64_t>>(&v.start)) {
      tag.set("start", list(*naturals, number));
    } else if (const auto* booleans = std::get_if<std::vector<bool>>(&v.start)) {
      tag.set("start", list(*booleans, [](bool x) { return to_xml(x); }));
    }
    if (v.derivative) tag.set("derivative", std::to_string(d_.variables.at(*v.derivative).reference));
    tag.flag("reinit", v.reinit);

    for (const Dimension& dimension : v.dimensions) {
      tag.child("Dimension").number("start", dimension.size).number("valueReference", dimension.reference);
    }
    if (const auto* strings = std::get_if<std::vector<std::string>>(&v.start)) {
      for (const std::string& s : *strings) tag.child("Start").set("value", s);
    } else if (const auto* binaries = std::get_if<std::vector<std::vector<std::uint8_t>>>(&v.start)) {
      for (const auto& bytes : *binaries) tag.child("Start").set("value", hexadecimal(bytes));
    }
    aliases(tag, v);
  }

  static std::string hexadecimal(const std::vector<std::uint8_t>& bytes) {
    static constexpr char kDigits[] = "0123456789abcdef";
    std::string text;
    for (const std::uint8_t b : bytes) {
      text += kDigits[b >> 4];
      text += kDigits[b & 15];
    }
    return text;
  }

  void aliases(Tag& tag, const ModelVariable& v) {
    for (const Alias& a : v.aliases) {
      tag.child("Alias").set("name", a.name).set_if("description", a.description).set_if("displayUnit", a.display_unit);
    }
  }

  void unknown(Tag& parent, std::string_view name, const Unknown& u) {
    const auto reference = [&](std::size_t index) {
      return std::to_string(fmi2_ ? index + 1 : d_.variables.at(index).reference);
    };
    Tag tag = parent.child(name);
    tag.set(fmi2_ ? "index" : "valueReference", reference(u.variable));
    if (u.dependencies) tag.set("dependencies", list(*u.dependencies, reference));
    if (!u.kinds.empty()) {
      tag.set("dependenciesKind", list(u.kinds, [](DependencyKind kind) { return name_of(kind); }));
    }
  }

  void structure2(Tag& root) {
    Tag structure = root.child("ModelStructure");
    const std::pair<const char*, const std::vector<Unknown>*> groups[] = {{"Outputs", &d_.structure.outputs},
                                                                          {"Derivatives", &d_.structure.derivatives},
                                                                          {"InitialUnknowns", &d_.structure.initial_unknowns}};
    for (const auto& [name, unknowns] : groups) {
      if (unknowns->empty()) continue;
      Tag group = structure.child(name);
      for (const Unknown& u : *unknowns) unknown(group, "Unknown", u);
    }
  }

  void structure3(Tag& root) {
    Tag structure = root.child("ModelStructure");
    const ModelStructure& s = d_.structure;
    for (const Unknown& u : s.outputs) unknown(structure, "Output", u);
    for (const Unknown& u : s.derivatives) unknown(structure, "ContinuousStateDerivative", u);
    for (const Unknown& u : s.clocked_states) unknown(structure, "ClockedState", u);
    for (const Unknown& u : s.initial_unknowns) unknown(structure, "InitialUnknown", u);
    for (const Unknown& u : s.event_indicators) unknown(structure, "EventIndicator", u);
  }

  std::ostream& out_;
  const ModelDescription& d_;
  bool fmi2_;
};

}  // namespace

void write(std::ostream& out, const ModelDescription& description) { Writer(out, description).write(); }

}  // namespace cotwin::fmu
