#include "fmu/model_description_read.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <set>
#include <sstream>
#include <unordered_map>

#include "models/text/error.h"
#include "models/text/text.h"
#include "models/text/xml.h"

namespace cotwin::fmu {

namespace {

constexpr std::uintmax_t kMaxFileBytes = 256u << 20;

/// The enumerator that `word` is the name of.
template <class Enum>
std::optional<Enum> read_word(std::string_view word, Enum last) {
  for (int i = 0; i <= static_cast<int>(last); ++i) {
    if (name_of(static_cast<Enum>(i)) == word) return static_cast<Enum>(i);
  }
  return std::nullopt;
}

template <class Enum>
std::optional<Enum> word_of(const xml::Element& e, std::string_view attribute, Enum last) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<Enum> word = read_word(*value, last);
  if (word) return word;
  std::string all;
  for (int i = 0; i <= static_cast<int>(last); ++i) {
    all += (all.empty() ? "" : ", ") + std::string(name_of(static_cast<Enum>(i)));
  }
  throw Error(e.place, std::string(attribute) + " '" + *value + "', expected one of " + all);
}

/// XML Schema's double: with INF, -INF and NaN.
std::optional<double> read_double(std::string_view word) {
  if (word == "INF" || word == "+INF") return std::numeric_limits<double>::infinity();
  if (word == "-INF") return -std::numeric_limits<double>::infinity();
  if (word == "NaN") return std::numeric_limits<double>::quiet_NaN();
  return text::parse_real(word);
}

std::optional<std::uint64_t> read_unsigned(std::string_view word) {
  word = text::trim(word);
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  if (word.empty() || word.size() > 20) return std::nullopt;
  std::uint64_t value = 0;
  for (const char c : word) {
    if (c < '0' || c > '9') return std::nullopt;
    const auto digit = static_cast<std::uint64_t>(c - '0');
    if (value > (std::numeric_limits<std::uint64_t>::max() - digit) / 10) return std::nullopt;
    value = 10 * value + digit;
  }
  return value;
}

std::vector<std::string_view> words(std::string_view list) {
  std::vector<std::string_view> found;
  constexpr std::string_view kBlank = " \t\r\n";
  for (std::size_t begin = list.find_first_not_of(kBlank); begin != std::string_view::npos;) {
    const std::size_t end = std::min(list.find_first_of(kBlank, begin), list.size());
    found.push_back(list.substr(begin, end - begin));
    begin = list.find_first_not_of(kBlank, end);
  }
  return found;
}

[[noreturn]] void bad(const xml::Element& e, std::string_view attribute, std::string_view value, const std::string& expected) {
  const std::string shown(value.substr(0, 60));
  throw Error(e.place, std::string(attribute) + " '" + shown + (value.size() > 60 ? "…" : "") + "', expected " + expected);
}

std::optional<double> optional_real(const xml::Element& e, std::string_view attribute) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<double> number = read_double(*value);
  if (!number) bad(e, attribute, *value, "a number");
  return number;
}

std::optional<std::uint64_t> optional_unsigned(const xml::Element& e, std::string_view attribute) {
  const std::string* value = xml::find(e, attribute);
  if (value == nullptr) return std::nullopt;
  const std::optional<std::uint64_t> number = read_unsigned(*value);
  if (!number) bad(e, attribute, *value, "an integer that is not negative");
  return number;
}

std::uint32_t reference_from(const xml::Element& e, std::string_view attribute, std::string_view word) {
  const std::optional<std::uint64_t> number = read_unsigned(word);
  if (!number || *number > std::numeric_limits<std::uint32_t>::max()) bad(e, attribute, word, "a value reference");
  return static_cast<std::uint32_t>(*number);
}

struct IntegerRange {
  std::int64_t min, max;
};
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

bool is_float(Type type) { return type == Type::kFloat32 || type == Type::kFloat64; }

std::vector<std::uint8_t> read_hex(const xml::Element& e, std::string_view digits) {
  const auto value = [&](char c) {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    bad(e, "value", digits, "hexadecimal digits");
  };
  if (digits.size() % 2 != 0) bad(e, "value", digits, "an even number of hexadecimal digits");
  std::vector<std::uint8_t> bytes;
  bytes.reserve(digits.size() / 2);
  for (std::size_t i = 0; i < digits.size(); i += 2) {
    bytes.push_back(static_cast<std::uint8_t>(16 * value(digits[i]) + value(digits[i + 1])));
  }
  return bytes;
}

template <class T, class Read>
std::vector<T> read_list(const xml::Element& e, std::string_view list, const std::string& expected, Read read) {
  std::vector<T> values;
  for (const std::string_view word : words(list)) {
    const auto value = read(word);
    if (!value) bad(e, "start", word, expected);
    values.push_back(static_cast<T>(*value));
  }
  return values;
}

/// The start values that the attribute `start`, or for strings and binaries of FMI 3 the children <Start>, give.
StartValues read_start(const xml::Element& e, const Variable& v, Version version) {
  const std::string* start = xml::find(e, "start");
  const bool scalar2 = version == Version::k2;
  if (v.type == Type::kString || v.type == Type::kBinary) {
    std::vector<std::string> texts;
    if (scalar2) {
      if (start == nullptr) return {};
      texts.push_back(*start);
    } else {
      for (const xml::Element& child : e.children) {
        if (child.name == "Start") texts.push_back(xml::text(child, "value"));
      }
      if (texts.empty()) return {};
    }
    if (v.type == Type::kString) return texts;
    std::vector<std::vector<std::uint8_t>> binaries;
    for (const std::string& text : texts) binaries.push_back(read_hex(e, text));
    return binaries;
  }
  if (start == nullptr || v.type == Type::kClock) return {};
  if (is_float(v.type)) return read_list<double>(e, *start, "numbers", read_double);
  if (v.type == Type::kBoolean) {
    return read_list<bool>(e, *start, "true or false", [](std::string_view w) { return text::parse_boolean(w); });
  }
  if (v.type == Type::kUInt64) return read_list<std::uint64_t>(e, *start, "integers that are not negative", read_unsigned);
  const IntegerRange range = range_of(scalar2 ? Type::kInt32 : v.type);
  return read_list<std::int64_t>(e, *start, "integers of the range of " + std::string(name_of(v.type)),
                                 [&](std::string_view w) -> std::optional<std::int64_t> {
                                   const auto n = text::parse_integer(w);
                                   if (!n || *n < range.min || *n > range.max) return std::nullopt;
                                   return static_cast<std::int64_t>(*n);
                                 });
}

void read_numeric(const xml::Element& e, Numeric& n) {
  n.quantity = xml::text(e, "quantity", "");
  n.unit = xml::text(e, "unit", "");
  n.display_unit = xml::text(e, "displayUnit", "");
  n.relative_quantity = xml::boolean(e, "relativeQuantity", false);
  n.unbounded = xml::boolean(e, "unbounded", false);
  n.min = optional_real(e, "min");
  n.max = optional_real(e, "max");
  n.nominal = optional_real(e, "nominal");
  if (n.min && n.max && *n.min > *n.max) throw Error(e.place, "min is greater than max");
}

void read_clock(const xml::Element& e, Clock& c) {
  c.can_be_deactivated = xml::boolean(e, "canBeDeactivated", false);
  if (const auto priority = optional_unsigned(e, "priority")) c.priority = static_cast<std::uint32_t>(*priority);
  c.interval_variability =
      word_of(e, "intervalVariability", IntervalVariability::kTriggered).value_or(IntervalVariability::kTriggered);
  c.interval = optional_real(e, "intervalDecimal");
  c.shift = optional_real(e, "shiftDecimal").value_or(0);
  c.supports_fraction = xml::boolean(e, "supportsFraction", false);
  c.resolution = optional_unsigned(e, "resolution");
  c.interval_counter = optional_unsigned(e, "intervalCounter");
  c.shift_counter = optional_unsigned(e, "shiftCounter").value_or(0);
}

/// The table of the standards (FMI 2.0: 2.2.7, FMI 3.0: 2.4.7.5) that tells `initial` where a variable does not.
std::optional<Initial> standard_initial(Causality causality, Variability variability) {
  switch (causality) {
    case Causality::kParameter:
    case Causality::kStructuralParameter:
      return Initial::kExact;
    case Causality::kInput:
      return Initial::kExact;
    case Causality::kIndependent:
      return std::nullopt;
    default:
      return variability == Variability::kConstant ? Initial::kExact : Initial::kCalculated;
  }
}

class Reader {
 public:
  Reader(const xml::Element& root, ModelDescription& description) : root_(root), d_(description) {}

  void read() {
    if (root_.name != "fmiModelDescription") throw Error(root_.place, "<" + root_.name + ">, expected <fmiModelDescription>");
    d_.fmi_version = xml::text(root_, "fmiVersion");
    if (d_.fmi_version == "1.0") throw Error(root_.place, "FMI 1.0 is not supported, expected FMI 2.0 or 3.0");
    if (d_.fmi_version == "2.0") {
      d_.version = Version::k2;
    } else if (d_.fmi_version.rfind("3.", 0) == 0) {
      d_.version = Version::k3;
    } else {
      throw Error(root_.place, "FMI '" + d_.fmi_version + "' is not supported, expected FMI 2.0 or 3.0");
    }
    two_ = d_.version == Version::k2;
    d_.model_name = xml::text(root_, "modelName");
    d_.token = xml::text(root_, two_ ? "guid" : "instantiationToken");
    d_.description = xml::text(root_, "description", "");
    d_.author = xml::text(root_, "author", "");
    d_.model_version = xml::text(root_, "version", "");
    d_.copyright = xml::text(root_, "copyright", "");
    d_.license = xml::text(root_, "license", "");
    d_.generation_tool = xml::text(root_, "generationTool", "");
    d_.generation_date = xml::text(root_, "generationDateAndTime", "");
    d_.structured_names = xml::text(root_, "variableNamingConvention", "flat") == "structured";
    if (const auto n = optional_unsigned(root_, "numberOfEventIndicators")) {
      if (*n > kMaxElements)
        throw Error(root_.place, std::to_string(*n) + " event indicators, expected at most " + std::to_string(kMaxElements));
      d_.event_indicators = static_cast<unsigned>(*n);
    }
    const xml::Element* variables = nullptr;
    const xml::Element* structure = nullptr;
    for (const xml::Element& e : root_.children) {
      if (e.name == "ModelExchange") interface(e, d_.model_exchange);
      if (e.name == "CoSimulation") interface(e, d_.co_simulation);
      if (e.name == "ScheduledExecution" && !two_) interface(e, d_.scheduled_execution);
      if (e.name == "UnitDefinitions") units(e);
      if (e.name == "TypeDefinitions") types(e);
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
      throw Error(root_.place, "neither ModelExchange nor CoSimulation, expected one of them");
    }
    if (variables == nullptr) throw Error(root_.place, "no ModelVariables");
    read_variables(*variables);
    if (structure == nullptr) throw Error(root_.place, "no ModelStructure");
    two_ ? structure2(*structure) : structure3(*structure);
  }

 private:
  void interface(const xml::Element& e, std::optional<Interface>& out) {
    if (out) throw Error(e.place, e.name + " stands twice");
    Interface i;
    i.model_identifier = xml::text(e, "modelIdentifier");
    const std::string& id = i.model_identifier;
    if (id.empty() || id.size() > 200 || id.find_first_of("/\\") != std::string::npos || id.front() == '.') {
      bad(e, "modelIdentifier", id, "the name of a shared library");
    }
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
      Unit unit;
      unit.name = xml::text(e, "name");
      if (!names.insert(unit.name).second) throw Error(e.place, "unit '" + unit.name + "' is defined twice");
      for (const xml::Element& c : e.children) {
        if (c.name == "BaseUnit") {
          UnitDefinition u;
          u.name = unit.name;
          const std::pair<const char*, int*> exponents[] = {{"kg", &u.kg}, {"m", &u.m},     {"s", &u.s},   {"A", &u.A},
                                                            {"K", &u.K},   {"mol", &u.mol}, {"cd", &u.cd}, {"rad", &u.rad}};
          for (const auto& [name, exponent] : exponents) {
            *exponent = xml::integer(c, name, 0);
            if (std::abs(*exponent) > 99) throw Error(c.place, "unit '" + unit.name + "': exponent beyond 99");
          }
          u.factor = xml::real(c, "factor", 1.0);
          u.offset = xml::real(c, "offset", 0.0);
          if (!std::isnormal(u.factor) || !std::isfinite(u.offset))
            throw Error(c.place, "unit '" + unit.name + "': factor 0 or not finite");
          unit.definition = std::move(u);
        } else if (c.name == "DisplayUnit") {
          unit.display_units.push_back({xml::text(c, "name"), xml::real(c, "factor", 1.0), xml::real(c, "offset", 0.0),
                                        xml::boolean(c, "inverse", false)});
        }
      }
      d_.units.push_back(std::move(unit));
    }
  }

  /// The type that an element <Real> or <Float64Type> declares.
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
      if (!type_index_.emplace(t.name, d_.types.size()).second) throw Error(e.place, "type '" + t.name + "' is defined twice");
      d_.types.push_back(std::move(t));
    }
  }

  void experiment(const xml::Element& e) {
    DefaultExperiment x{optional_real(e, "startTime"), optional_real(e, "stopTime"), optional_real(e, "tolerance"),
                        optional_real(e, "stepSize")};
    for (const auto* value : {&x.start, &x.stop, &x.tolerance, &x.step}) {
      if (*value && !std::isfinite(**value)) throw Error(e.place, "DefaultExperiment has a number that is not finite");
    }
    d_.default_experiment = x;
  }

  void read_variables(const xml::Element& list) {
    std::unordered_map<std::string, std::string> places;  // of names
    const auto name_once = [&](const std::string& name, const std::string& place) {
      const auto [at, fresh] = places.emplace(name, place);
      if (!fresh) throw Error(place, "variable '" + name + "' stands also at " + at->second);
    };
    std::vector<const xml::Element*> elements_of;
    for (const xml::Element& e : list.children) {
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
      d_.variables.push_back(variable(e, *content, *type));
      elements_of.push_back(content);
      name_once(d_.variables.back().name, e.place);
      for (const Alias& alias : d_.variables.back().aliases) name_once(alias.name, e.place);
      const bool fresh = index_.emplace(d_.variables.back().reference, d_.variables.size() - 1).second;
      if (!fresh && !two_) {
        throw Error(e.place, "value reference " + std::to_string(d_.variables.back().reference) + " stands twice");
      }
    }
    std::uint64_t total = 0;
    for (std::size_t i = 0; i < d_.variables.size(); ++i) check_variable(d_.variables[i], *elements_of[i], total);
  }

  /// What our annotation says of an input of FMI 2.
  static bool interpolated(const xml::Element& variable) {
    const xml::Element* annotations = xml::child(variable, "", "Annotations");
    if (annotations == nullptr) return true;
    for (const xml::Element& tool : annotations->children) {
      if (tool.name != "Tool" || xml::text(tool, "name", "") != "cotwin") continue;
      if (const xml::Element* input = xml::child(tool, "", "Input")) return xml::boolean(*input, "interpolated", true);
    }
    return true;
  }

  Variable variable(const xml::Element& e, const xml::Element& content, Type type) {
    Variable v;
    v.name = xml::text(e, "name");
    if (v.name.empty() || v.name.size() > 10'000 ||
        std::any_of(v.name.begin(), v.name.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20 || c == 0x7f; })) {
      throw Error(e.place, "a variable's name is empty, too long or has control characters");
    }
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
        if (dimension.size.has_value() == dimension.reference.has_value())
          throw Error(c.place, "a dimension has either start or valueReference");
        v.dimensions.push_back(dimension);
      } else if (c.name == "Alias") {
        v.aliases.push_back({xml::text(c, "name"), xml::text(c, "description", ""), xml::text(c, "displayUnit", "")});
      }
    }
    v.start = read_start(content, v, d_.version);
    return v;
  }

  void check_variable(Variable& v, const xml::Element& content, std::uint64_t& total) {
    const std::string& place = content.place;
    if (!v.declared_type.empty()) {
      const auto found = type_index_.find(v.declared_type);
      if (found == type_index_.end())
        throw Error(place, "variable '" + v.name + "': type '" + v.declared_type + "' is not defined");
      if (d_.types[found->second].type != v.type) {
        throw Error(place, "variable '" + v.name + "' is " + std::string(name_of(v.type)) + ", but its type '" +
                               v.declared_type + "' is " + std::string(name_of(d_.types[found->second].type)));
      }
    }
    if (const std::string* of = xml::find(content, "derivative")) {
      const std::optional<std::uint64_t> number = read_unsigned(*of);
      if (two_) {
        if (!number || *number < 1 || *number > d_.variables.size()) bad(content, "derivative", *of, "the index of a variable");
        v.derivative = static_cast<std::size_t>(*number - 1);
      } else {
        v.derivative = index_of(content, "derivative", *of);
      }
      if (!is_float(d_.variables[*v.derivative].type)) bad(content, "derivative", *of, "a variable of floats");
    }
    for (const std::uint32_t clock : v.clocks) {
      const auto found = index_.find(clock);
      if (found == index_.end() || d_.variables[found->second].type != Type::kClock) {
        throw Error(place, "variable '" + v.name + "': clock " + std::to_string(clock) + " is not a variable of type Clock");
      }
    }
    if (v.previous && index_.count(*v.previous) == 0)
      throw Error(place, "variable '" + v.name + "': no variable has the reference of previous");
    std::size_t size = 0;
    try {
      size = elements(v);
    } catch (const Error& error) {
      throw Error(place, error.what());
    }
    total += size;
    if (total > kMaxElements)
      throw Error(place, "the variables have more than " + std::to_string(kMaxElements) + " elements together");
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
    // One start value may stand for all elements of an array (FMI 3.0, 2.4.7.4).
    if (!none && given != size && !(given == 1 && !v.dimensions.empty())) {
      throw Error(place, "variable '" + v.name + "': " + std::to_string(given) + " start values for " + std::to_string(size) +
                             " elements");
    }
    if (v.causality == Causality::kStructuralParameter && (v.type != Type::kUInt64 || none)) {
      throw Error(place, "structural parameter '" + v.name + "', expected a UInt64 with a start value");
    }
  }

  std::size_t elements(const Variable& v) const {
    std::uint64_t n = 1;
    for (const Dimension& dimension : v.dimensions) {
      std::uint64_t extent = 0;
      if (dimension.size) {
        extent = *dimension.size;
      } else {
        const auto found = index_.find(*dimension.reference);
        const Variable* parameter = found == index_.end() ? nullptr : &d_.variables[found->second];
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

  std::size_t index_of(const xml::Element& e, std::string_view attribute, std::string_view word) const {
    const auto found = index_.find(reference_from(e, attribute, word));
    if (found == index_.end()) bad(e, attribute, word, "the value reference of a variable");
    return found->second;
  }

  /// `find_index` reads what one word of the standard means: an index (FMI 2) or a value reference (FMI 3).
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
        throw Error(e.place, "dependenciesKind has another length than dependencies");
    }
    return u;
  }

  void structure2(const xml::Element& structure) {
    for (const xml::Element& list : structure.children) {
      std::vector<Unknown>* out = list.name == "Outputs"           ? &d_.structure.outputs
                                  : list.name == "Derivatives"     ? &d_.structure.derivatives
                                  : list.name == "InitialUnknowns" ? &d_.structure.initial_unknowns
                                                                   : nullptr;
      if (out == nullptr) continue;
      for (const xml::Element& e : list.children) {
        if (e.name != "Unknown") continue;
        const auto index = [&](const char* attribute, std::string_view word) {
          const std::optional<std::uint64_t> number = read_unsigned(word);
          if (!number || *number < 1 || *number > d_.variables.size()) {
            bad(e, attribute, word, "the index of a variable, 1 to " + std::to_string(d_.variables.size()));
          }
          return static_cast<std::size_t>(*number - 1);
        };
        out->push_back(
            unknown(e, index("index", xml::text(e, "index")), [&](std::string_view w) { return index("dependencies", w); }));
        if (out == &d_.structure.derivatives) check_derivative(e, out->back());
      }
    }
  }

  void structure3(const xml::Element& structure) {
    for (const xml::Element& e : structure.children) {
      std::vector<Unknown>* out = e.name == "Output"                      ? &d_.structure.outputs
                                  : e.name == "ContinuousStateDerivative" ? &d_.structure.derivatives
                                  : e.name == "ClockedState"              ? &d_.structure.clocked_states
                                  : e.name == "InitialUnknown"            ? &d_.structure.initial_unknowns
                                  : e.name == "EventIndicator"            ? &d_.structure.event_indicators
                                                                          : nullptr;
      if (out == nullptr) continue;
      out->push_back(unknown(e, index_of(e, "valueReference", xml::text(e, "valueReference")),
                             [&](std::string_view w) { return index_of(e, "dependencies", w); }));
      if (out == &d_.structure.derivatives) check_derivative(e, out->back());
    }
  }

  void check_derivative(const xml::Element& e, const Unknown& u) const {
    const Variable& v = d_.variables[u.variable];
    if (!is_float(v.type) || !v.derivative) throw Error(e.place, "'" + v.name + "' is not the derivative of a variable");
    if (v.type != Type::kFloat64 || d_.variables[*v.derivative].type != Type::kFloat64)
      throw Error(e.place, "'" + v.name + "': continuous states are of type Float64");
    if (elements(v) != elements(d_.variables[*v.derivative]))
      throw Error(e.place, "'" + v.name + "' has another size than its state");
  }

  const xml::Element& root_;
  ModelDescription& d_;
  bool two_ = false;
  std::unordered_map<std::uint32_t, std::size_t> index_;  // value reference → first variable
  std::unordered_map<std::string, std::size_t> type_index_;
};

}  // namespace

ModelDescription parse_model_description(std::string_view xml, const std::string& place) {
  const xml::Element root = xml::parse(xml, place);
  ModelDescription description;
  Reader(root, description).read();
  return description;
}

ModelDescription load_model_description(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  std::error_code none;
  const std::uintmax_t size = std::filesystem::file_size(file, none);
  if (!in || none) throw Error(file.string(), "cannot be read, expected modelDescription.xml");
  if (size > kMaxFileBytes)
    throw Error(file.string(), std::to_string(size) + " bytes, expected at most " + std::to_string(kMaxFileBytes));
  std::ostringstream bytes;
  bytes << in.rdbuf();
  return parse_model_description(std::move(bytes).str(), "modelDescription.xml");
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
