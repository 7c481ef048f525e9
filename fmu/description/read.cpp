#include "fmu/description/read.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <set>
#include <span>
#include <unordered_map>
#include <unordered_set>

#include "fmu/description/values.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

constexpr std::size_t kMaxVariables = 2'000'000;

/// Variables and the structure can have a million elements. They are converted while the XML is parsed and their elements are
/// not stored. Everything else is read at the end.
class Reader {
 public:
  explicit Reader(ModelDescription& description) : d_(description) {}

  void read(std::string_view xml, const std::string& place) {
    const xml::Element root =
        xml::parse(xml, place, [&](std::span<const xml::Element> around, xml::Element& e) { return !take(around, e); });
    begin(root);
    read_all(root);
  }

 private:
  /// Returns whether the element was read and need not be stored.
  bool take(std::span<const xml::Element> around, const xml::Element& e) {
    begin(around[0]);
    if (around.size() == 1) {
      has_variables_ = has_variables_ || e.name == "ModelVariables";
      if (e.name == "UnitDefinitions") units(e);
      if (e.name == "TypeDefinitions") types(e);
      return e.name == "UnitDefinitions" || e.name == "TypeDefinitions";
    }
    if (around[1].name == "ModelVariables") {
      if (around.size() > 2) return false;  // a child of a variable
      if (has_variables_) throw Error(e.place, "ModelVariables appears twice");
      read_variable(e);
      return true;
    }
    // Against the schema, ModelStructure may precede ModelVariables. It is then stored and read at the end.
    if (around[1].name != "ModelStructure" || !has_variables_) return false;
    end_variables();
    if (two_) return around.size() == 3 && structure2(around[2].name, e);
    return around.size() == 2 && structure3(e);
  }

  /// Reads the attributes of the root element.
  void begin(const xml::Element& root) {
    if (begun_) return;
    begun_ = true;
    if (root.name != "fmiModelDescription") throw Error(root.place, "<" + root.name + ">, expected <fmiModelDescription>");
    d_.fmi_version = xml::text(root, "fmiVersion");
    if (d_.fmi_version == "1.0") throw Error(root.place, "FMI 1.0 is not supported, expected FMI 2.0 or 3.0");
    const std::optional<Version> version = version_of(d_.fmi_version);
    if (!version) throw Error(root.place, "FMI '" + d_.fmi_version + "' is not supported, expected FMI 2.0 or 3.0");
    d_.version = *version;
    two_ = d_.version == Version::k2;
    d_.model_name = xml::text(root, "modelName");
    d_.token = xml::text(root, two_ ? "guid" : "instantiationToken");
    d_.description = xml::text(root, "description", "");
    d_.author = xml::text(root, "author", "");
    d_.model_version = xml::text(root, "version", "");
    d_.copyright = xml::text(root, "copyright", "");
    d_.license = xml::text(root, "license", "");
    d_.generation_tool = xml::text(root, "generationTool", "");
    d_.generation_date = xml::text(root, "generationDateAndTime", "");
    d_.structured_names = xml::text(root, "variableNamingConvention", "flat") == "structured";
    if (const auto n = optional_unsigned(root, "numberOfEventIndicators")) {
      at(root.place, [&] { check_event_indicators(*n); });
      d_.event_indicators = static_cast<unsigned>(*n);
    }
  }

  void read_all(const xml::Element& root) {
    const xml::Element* variables = nullptr;
    const xml::Element* structure = nullptr;
    for (const xml::Element& e : root.children) {
      if (e.name == "ModelExchange") interface(e, d_.model_exchange);
      if (e.name == "CoSimulation") interface(e, d_.co_simulation);
      if (e.name == "ScheduledExecution" && !two_) interface(e, d_.scheduled_execution);
      if (e.name == "LogCategories") {
        for (const xml::Element& c : e.children) {
          if (c.name == "Category") d_.log_categories.push_back({xml::text(c, "name"), xml::text(c, "description", "")});
        }
      }
      if (e.name == "DefaultExperiment") experiment(e);
      if (e.name == "ModelVariables") variables = &e;
      if (e.name == "ModelStructure") structure = &e;
    }
    if (!d_.model_exchange && !d_.co_simulation && !d_.scheduled_execution) {
      throw Error(root.place, "neither ModelExchange nor CoSimulation, expected one of them");
    }
    if (variables == nullptr) throw Error(root.place, "no ModelVariables");
    end_variables();
    if (structure == nullptr) throw Error(root.place, "no ModelStructure");
    for (const xml::Element& e : structure->children) {  // elements that could not be read during parsing
      if (!two_) structure3(e);
      for (const xml::Element& unknown : e.children) {
        if (two_) structure2(e.name, unknown);
      }
    }
  }

  void interface(const xml::Element& e, std::optional<Interface>& out) {
    if (out) throw Error(e.place, e.name + " appears twice");
    Interface i;
    i.model_identifier = xml::text(e, "modelIdentifier");
    if (!is_library_name(i.model_identifier)) bad(e, "modelIdentifier", i.model_identifier, "the name of a shared library");
    const auto flag = [&](const char* in2, const char* in3, bool standard = false) {
      const char* name = two_ ? in2 : in3;
      return name == nullptr ? standard : xml::boolean(e, name, standard);
    };
    i.needs_execution_tool = flag("needsExecutionTool", "needsExecutionTool");
    i.only_once_per_process = flag("canBeInstantiatedOnlyOncePerProcess", "canBeInstantiatedOnlyOncePerProcess");
    i.can_get_and_set_state = flag("canGetAndSetFMUstate", "canGetAndSetFMUState");
    i.can_serialise_state = flag("canSerializeFMUstate", "canSerializeFMUState");
    i.provides_directional_derivatives = flag("providesDirectionalDerivative", "providesDirectionalDerivatives");
    i.provides_adjoint_derivatives = flag(nullptr, "providesAdjointDerivatives");
    i.provides_per_element_dependencies = flag(nullptr, "providesPerElementDependencies");
    i.variable_step = flag("canHandleVariableCommunicationStepSize", "canHandleVariableCommunicationStepSize");
    i.fixed_internal_step = optional_real(e, "fixedInternalStepSize");
    i.max_output_derivative_order =
        static_cast<unsigned>(std::min<std::uint64_t>(optional_unsigned(e, "maxOutputDerivativeOrder").value_or(0), 100));
    i.provides_intermediate_update = flag(nullptr, "providesIntermediateUpdate");
    i.might_return_early = flag(nullptr, "mightReturnEarlyFromDoStep");
    i.can_return_early_after_intermediate_update = flag(nullptr, "canReturnEarlyAfterIntermediateUpdate");
    i.has_event_mode = flag(nullptr, "hasEventMode");
    i.provides_evaluate_discrete_states = flag(nullptr, "providesEvaluateDiscreteStates");
    i.can_interpolate_inputs = flag("canInterpolateInputs", nullptr);
    i.can_run_asynchronously = flag("canRunAsynchronuously", nullptr);
    i.needs_completed_integrator_step = two_ ? !xml::boolean(e, "completedIntegratorStepNotNeeded", false)
                                             : xml::boolean(e, "needsCompletedIntegratorStep", true);
    i.can_not_use_memory_functions = flag("canNotUseMemoryManagementFunctions", nullptr);
    for (const xml::Element& list : e.children) {
      if (list.name != "SourceFiles") continue;
      for (const xml::Element& file : list.children) {
        if (file.name == "File") i.source_files.push_back(xml::text(file, "name"));
      }
    }
    out = std::move(i);
  }

  void units(const xml::Element& list) {
    std::set<std::string> names;
    for (const xml::Element& e : list.children) {
      if (e.name != "Unit") continue;
      MeasurementUnit unit;
      unit.name = xml::text(e, "name");
      if (!names.insert(unit.name).second) throw Error(e.place, "unit '" + unit.name + "' is defined twice");
      for (const xml::Element& c : e.children) {
        if (c.name == "BaseUnit") {
          UnitDefinition u;
          u.name = unit.name;
          const std::pair<const char*, int*> exponents[] = {{"kg", &u.kg}, {"m", &u.m},     {"s", &u.s},   {"A", &u.A},
                                                            {"K", &u.K},   {"mol", &u.mol}, {"cd", &u.cd}, {"rad", &u.rad}};
          for (const auto& [name, exponent] : exponents) *exponent = xml::integer(c, name, 0);
          u.factor = xml::real(c, "factor", 1.0);
          u.offset = xml::real(c, "offset", 0.0);
          at(c.place, [&] { check_unit(u); });
          unit.definition = std::move(u);
        } else if (c.name == "DisplayUnit") {
          unit.display_units.push_back({xml::text(c, "name"), xml::real(c, "factor", 1.0), xml::real(c, "offset", 0.0),
                                        xml::boolean(c, "inverse", false)});
        }
      }
      d_.units.push_back(std::move(unit));
    }
  }

  /// Returns the type of an element such as <Real> or, if `definition`, <Float64Type>.
  std::optional<Type> type_of(std::string name, bool definition) const {
    if (two_) {
      if (name == "Real") return Type::kFloat64;
      if (name == "Integer") return Type::kInt32;
      if (name == "Boolean") return Type::kBoolean;
      if (name == "String") return Type::kString;
      if (name == "Enumeration") return Type::kEnumeration;
      return std::nullopt;
    }
    if (definition) {
      if (name.size() < 4 || name.substr(name.size() - 4) != "Type") return std::nullopt;
      name.resize(name.size() - 4);
    }
    return read_word(name, Type::kClock);
  }

  void types(const xml::Element& list) {
    std::set<std::string> names;
    for (const xml::Element& e : list.children) {
      const xml::Element* content = &e;
      TypeDefinition t;
      if (two_) {
        if (e.name != "SimpleType" || e.children.empty()) continue;
        content = &e.children.front();
      }
      const std::optional<Type> type = type_of(content->name, true);
      if (!type) continue;
      t.type = *type;
      t.name = xml::text(e, "name");
      t.description = xml::text(e, "description", "");
      read_numeric(*content, t.numeric);
      t.mime_type = xml::text(*content, "mimeType", "");
      t.max_size = optional_unsigned(*content, "maxSize");
      if (t.type == Type::kClock) read_clock(*content, t.clock);
      for (const xml::Element& item : content->children) {
        if (item.name != "Item") continue;
        const std::optional<long long> value = text::parse_integer(xml::text(item, "value"));
        if (!value) bad(item, "value", xml::text(item, "value"), "an integer");
        t.items.push_back({xml::text(item, "name"), *value, xml::text(item, "description", "")});
      }
      if (!names.insert(t.name).second) throw Error(e.place, "type '" + t.name + "' is defined twice");
      d_.types.push_back(std::move(t));
    }
  }

  void experiment(const xml::Element& e) {
    DefaultExperiment x{optional_real(e, "startTime"), optional_real(e, "stopTime"), optional_real(e, "tolerance"),
                        optional_real(e, "stepSize")};
    for (const auto* value : {&x.start, &x.stop, &x.tolerance, &x.step}) {
      if (*value && !std::isfinite(**value)) throw Error(e.place, "DefaultExperiment has a value that is not finite");
    }
    d_.default_experiment = x;
  }

  void read_variable(const xml::Element& e) {
    const xml::Element* content = &e;
    if (two_) {
      if (e.name != "ScalarVariable") throw Error(e.place, "<" + e.name + ">, expected <ScalarVariable>");
      content = nullptr;
      for (const xml::Element& c : e.children) {
        if (type_of(c.name, false)) content = &c;
      }
      if (content == nullptr) throw Error(e.place, "a variable without Real, Integer, Boolean, String or Enumeration");
    }
    const std::optional<Type> type = type_of(content->name, false);
    if (!type) throw Error(e.place, "<" + content->name + ">, expected the type of a variable");
    if (d_.variables.size() == kMaxVariables) throw Error(e.place, "more than " + std::to_string(kMaxVariables) + " variables");
    d_.variables.push_back(variable(e, *content, *type));
    places_.push_back(content->place);
    if (const std::string* of = xml::find(*content, "derivative")) derivatives_.emplace_back(d_.variables.size() - 1, *of);
  }

  /// Makes the checks that need all variables: unique names and references, derivatives, start values.
  void end_variables() {
    if (check_) return;
    std::unordered_map<std::string_view, std::size_t> names;  // name → index of its variable
    std::unordered_set<std::uint32_t> references;
    names.reserve(d_.variables.size());
    references.reserve(d_.variables.size());
    for (std::size_t i = 0; i < d_.variables.size(); ++i) {
      const ModelVariable& v = d_.variables[i];
      const auto name_once = [&](const std::string& name) {
        const auto [first, fresh] = names.emplace(name, i);
        if (!fresh) throw Error(places_[i], "variable '" + name + "' appears also at " + places_[first->second].text());
      };
      name_once(v.name);
      for (const Alias& alias : v.aliases) name_once(alias.name);
      if (!references.insert(v.reference).second && !two_)
        throw Error(places_[i], "value reference " + std::to_string(v.reference) + " appears twice");
    }
    check_.emplace(d_);
    for (const auto& [i, of] : derivatives_) d_.variables[i].derivative = derivative(places_[i], of);
    for (std::size_t i = 0; i < d_.variables.size(); ++i) {
      at(places_[i], [&] { check_->variable(d_.variables[i]); });
    }
    places_ = {};
    derivatives_ = {};
    d_.variables.shrink_to_fit();
  }

  /// Returns the value of our annotation of an FMI 2 input; true if it is missing.
  static bool interpolated(const xml::Element& variable) {
    const xml::Element* annotations = xml::child(variable, "", "Annotations");
    if (annotations == nullptr) return true;
    for (const xml::Element& tool : annotations->children) {
      if (tool.name != "Tool" || xml::text(tool, "name", "") != "cotwin") continue;
      if (const xml::Element* input = xml::child(tool, "", "Input")) return xml::boolean(*input, "interpolated", true);
    }
    return true;
  }

  ModelVariable variable(const xml::Element& e, const xml::Element& content, Type type) {
    ModelVariable v;
    v.name = xml::text(e, "name");
    if (!is_variable_name(v.name)) throw Error(e.place, "a variable's name is empty, too long or has control characters");
    v.reference = reference_from(e, "valueReference", xml::text(e, "valueReference"));
    v.type = type;
    v.description = xml::text(e, "description", "");
    v.causality = word_of(e, "causality", Causality::kStructuralParameter).value_or(Causality::kLocal);
    if (two_ && v.causality == Causality::kStructuralParameter)
      bad(e, "causality", "structuralParameter", "a causality of FMI 2.0");
    const bool parameter = v.causality == Causality::kParameter || v.causality == Causality::kCalculatedParameter ||
                           v.causality == Causality::kStructuralParameter;
    const Variability standard = parameter && !two_       ? Variability::kFixed
                                 : is_float(type) || two_ ? Variability::kContinuous
                                                          : Variability::kDiscrete;
    v.variability = word_of(e, "variability", Variability::kContinuous).value_or(standard);
    v.initial = word_of(e, "initial", Initial::kCalculated);
    if (!v.initial) v.initial = standard_initial(v.causality, v.variability);
    if (xml::find(e, "canHandleMultipleSetPerTimeInstant") != nullptr)
      v.can_handle_multiple_set = xml::boolean(e, "canHandleMultipleSetPerTimeInstant");
    if (const std::string* clocks = xml::find(e, "clocks")) {
      for (const std::string_view word : words(*clocks)) v.clocks.push_back(reference_from(e, "clocks", word));
    }
    v.intermediate_update = xml::boolean(e, "intermediateUpdate", false);
    if (const std::string* previous = xml::find(e, "previous")) v.previous = reference_from(e, "previous", *previous);
    v.declared_type = xml::text(content, "declaredType", "");
    if (type != Type::kString && type != Type::kBinary && type != Type::kBoolean && type != Type::kClock)
      read_numeric(content, v.numeric);
    if (type == Type::kClock) read_clock(e, v.clock);
    v.mime_type = xml::text(content, "mimeType", "");
    v.max_size = optional_unsigned(content, "maxSize");
    v.reinit = xml::boolean(content, "reinit", false);
    if (two_) v.interpolated = interpolated(e);
    for (const xml::Element& c : e.children) {
      if (two_) continue;
      if (c.name == "Dimension") {
        Dimension dimension;
        dimension.size = optional_unsigned(c, "start");
        if (const std::string* reference = xml::find(c, "valueReference"))
          dimension.reference = reference_from(c, "valueReference", *reference);
        at(c.place, [&] { check_dimension(dimension); });
        v.dimensions.push_back(dimension);
      } else if (c.name == "Alias") {
        v.aliases.push_back({xml::text(c, "name"), xml::text(c, "description", ""), xml::text(c, "displayUnit", "")});
        if (!is_variable_name(v.aliases.back().name))
          throw Error(c.place, "an alias's name is empty, too long or has control characters");
      }
    }
    v.start = read_start(content, v, d_.version);
    return v;
  }

  /// Returns the index of the variable that the attribute refers to by an index from 1 (FMI 2) or a value reference (FMI 3).
  std::size_t derivative(const xml::Place& place, const std::string& of) const {
    const std::optional<std::uint64_t> number = read_unsigned(of);
    const auto fail = [&](const char* expected) { throw Error(place, "derivative '" + of + "', expected " + expected); };
    if (two_) {
      if (!number || *number < 1 || *number > d_.variables.size()) fail("the index of a variable");
      return static_cast<std::size_t>(*number - 1);
    }
    const auto found = number && *number <= std::numeric_limits<std::uint32_t>::max()
                           ? check_->index_of(static_cast<std::uint32_t>(*number))
                           : std::nullopt;
    if (!found) fail("the value reference of a variable");
    return *found;
  }

  std::size_t index_of(const xml::Element& e, std::string_view attribute, std::string_view word) const {
    const std::optional<std::size_t> found = check_->index_of(reference_from(e, attribute, word));
    if (!found) bad(e, attribute, word, "the value reference of a variable");
    return *found;
  }

  /// `find_index` returns the variable that a word refers to: by an index (FMI 2) or by a value reference (FMI 3).
  Unknown unknown(const xml::Element& e, std::size_t variable, const std::function<std::size_t(std::string_view)>& find_index) {
    Unknown u;
    u.variable = variable;
    if (const std::string* list = xml::find(e, "dependencies")) {
      u.dependencies.emplace();
      for (const std::string_view word : words(*list)) u.dependencies->push_back(find_index(word));
    }
    if (const std::string* list = xml::find(e, "dependenciesKind")) {
      for (const std::string_view word : words(*list)) {
        const auto kind = read_word(word, DependencyKind::kDiscrete);
        if (!kind) bad(e, "dependenciesKind", word, "dependent, constant, fixed, tunable or discrete");
        u.kinds.push_back(*kind);
      }
      if (!u.dependencies || u.kinds.size() != u.dependencies->size())
        throw Error(e.place, "dependenciesKind differs in length from dependencies");
    }
    return u;
  }

  /// Reads an element of a list of ModelStructure. Returns false if it does not belong to the list.
  bool structure2(std::string_view list, const xml::Element& e) {
    std::vector<Unknown>* out = list == "Outputs"           ? &d_.structure.outputs
                                : list == "Derivatives"     ? &d_.structure.derivatives
                                : list == "InitialUnknowns" ? &d_.structure.initial_unknowns
                                                            : nullptr;
    if (out == nullptr || e.name != "Unknown") return false;
    const auto index = [&](const char* attribute, std::string_view word) {
      const std::optional<std::uint64_t> number = read_unsigned(word);
      if (!number || *number < 1 || *number > d_.variables.size()) {
        bad(e, attribute, word, "the index of a variable, 1 to " + std::to_string(d_.variables.size()));
      }
      return static_cast<std::size_t>(*number - 1);
    };
    out->push_back(
        unknown(e, index("index", xml::text(e, "index")), [&](std::string_view w) { return index("dependencies", w); }));
    if (out == &d_.structure.derivatives) at(e.place, [&] { check_->derivative(out->back()); });
    return true;
  }

  bool structure3(const xml::Element& e) {
    std::vector<Unknown>* out = e.name == "Output"                      ? &d_.structure.outputs
                                : e.name == "ContinuousStateDerivative" ? &d_.structure.derivatives
                                : e.name == "ClockedState"              ? &d_.structure.clocked_states
                                : e.name == "InitialUnknown"            ? &d_.structure.initial_unknowns
                                : e.name == "EventIndicator"            ? &d_.structure.event_indicators
                                                                        : nullptr;
    if (out == nullptr) return false;
    out->push_back(unknown(e, index_of(e, "valueReference", xml::text(e, "valueReference")),
                           [&](std::string_view w) { return index_of(e, "dependencies", w); }));
    if (out == &d_.structure.derivatives) at(e.place, [&] { check_->derivative(out->back()); });
    return true;
  }

  ModelDescription& d_;
  bool begun_ = false, has_variables_ = false, two_ = false;
  std::vector<xml::Place> places_;                                // of the variables
  std::vector<std::pair<std::size_t, std::string>> derivatives_;  // variable, and what it is the derivative of
  std::optional<DescriptionCheck> check_;
};

}  // namespace

ModelDescription parse_model_description(std::string_view xml, const std::string& place) {
  ModelDescription description;
  Reader(description).read(xml, place);
  return description;
}

ModelDescription load_model_description(const std::filesystem::path& file) {
  return parse_model_description(text::read_file(file, "modelDescription.xml"), "modelDescription.xml");
}

}  // namespace cotwin::fmu
