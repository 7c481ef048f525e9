#include "fmu/check/check.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <ostream>
#include <set>
#include <span>
#include <utility>

#include "fmu/check/libraries.h"
#include "fmu/import/load.h"
#include "models/foundation/formats/xml.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file.h"
#include "models/foundation/support/text.h"

namespace cotwin::fmu {

namespace {

namespace fs = std::filesystem;
using Level = Finding::Level;

void check_resources(const fs::path& folder, const ModelDescription& d, std::vector<Finding>& out) {
  if (d.version == Version::k3 && fs::exists(folder / "binaries" / "linux64")) {
    out.push_back({Level::kWarning, "binaries/linux64 is the platform name of FMI 2, expected x86_64-linux"});
  }
  if (libraries(folder).empty() && !fs::exists(folder / "sources"))
    out.push_back({Level::kError, "neither binaries nor sources"});
}

/// The attributes that FMI 2.0 and 3.0 have, of elements in which a wrong one is easily overlooked.
using Attributes = std::map<std::string, std::vector<std::string>>;
const Attributes& attributes_of_fmi2() {
  static const Attributes kAttributes{
      {"fmiModelDescription",
       {"fmiVersion", "modelName", "guid", "description", "author", "version", "copyright", "license", "generationTool",
        "generationDateAndTime", "variableNamingConvention", "numberOfEventIndicators"}},
      {"CoSimulation",
       {"modelIdentifier", "needsExecutionTool", "canHandleVariableCommunicationStepSize", "canInterpolateInputs",
        "maxOutputDerivativeOrder", "canRunAsynchronuously", "canBeInstantiatedOnlyOncePerProcess",
        "canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"}},
      {"ModelExchange",
       {"modelIdentifier", "needsExecutionTool", "completedIntegratorStepNotNeeded", "canBeInstantiatedOnlyOncePerProcess",
        "canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate", "providesDirectionalDerivative"}},
      {"DefaultExperiment", {"startTime", "stopTime", "tolerance", "stepSize"}},
      {"ScalarVariable",
       {"name", "valueReference", "description", "causality", "variability", "initial", "canHandleMultipleSetPerTimeInstant"}},
      {"Real",
       {"declaredType", "quantity", "unit", "displayUnit", "relativeQuantity", "min", "max", "nominal", "unbounded", "start",
        "derivative", "reinit"}},
      {"Integer", {"declaredType", "quantity", "min", "max", "start"}},
      {"Boolean", {"declaredType", "start"}},
      {"String", {"declaredType", "start"}},
      {"Enumeration", {"declaredType", "quantity", "min", "max", "start"}}};
  return kAttributes;
}
const Attributes& attributes_of_fmi3() {
  static const Attributes kAttributes{
      {"fmiModelDescription",
       {"fmiVersion", "modelName", "instantiationToken", "description", "author", "version", "copyright", "license",
        "generationTool", "generationDateAndTime", "variableNamingConvention"}},
      {"CoSimulation",
       {"modelIdentifier", "needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess", "canGetAndSetFMUState",
        "canSerializeFMUState", "providesDirectionalDerivatives", "providesAdjointDerivatives",
        "providesPerElementDependencies", "canHandleVariableCommunicationStepSize", "fixedInternalStepSize",
        "maxOutputDerivativeOrder", "recommendedIntermediateInputSmoothness", "providesIntermediateUpdate",
        "mightReturnEarlyFromDoStep", "canReturnEarlyAfterIntermediateUpdate", "hasEventMode",
        "providesEvaluateDiscreteStates"}},
      {"ModelExchange",
       {"modelIdentifier", "needsExecutionTool", "canBeInstantiatedOnlyOncePerProcess", "canGetAndSetFMUState",
        "canSerializeFMUState", "providesDirectionalDerivatives", "providesAdjointDerivatives",
        "providesPerElementDependencies", "needsCompletedIntegratorStep", "providesEvaluateDiscreteStates"}},
      {"DefaultExperiment", {"startTime", "stopTime", "tolerance", "stepSize"}}};
  return kAttributes;
}

void check_attributes(const fs::path& folder, Version version, std::vector<Finding>& out) {
  const Attributes& known = version == Version::k2 ? attributes_of_fmi2() : attributes_of_fmi3();
  constexpr std::uintmax_t kLargest = 1'000'000'000;  // bytes
  const std::string xml = text::read_file(folder / "modelDescription.xml", "a model description", kLargest);
  const auto check = [&](const xml::Element& e) {
    const auto found = known.find(e.name);
    if (found == known.end() || !e.space.empty()) return;
    xml::check_attributes(e, found->second, [&](const std::string& place, const std::string& what) {
      out.push_back({Level::kWarning, place + ": " + what});
    });
  };
  check(xml::parse(xml, "modelDescription.xml", [&](std::span<const xml::Element> around, const xml::Element& e) {
    // Of type definitions Real and others are named SimpleType's children, with other attributes.
    if (std::ranges::none_of(around, [](const xml::Element& a) {
          return a.name == "TypeDefinitions" || a.name == "Annotations" || a.name == "VendorAnnotations";
        }))
      check(e);
    return false;
  }));
}

/// Variables of FMI 2 with one value reference are one: a start value belongs to one of them.
void check_alias_starts(const ModelDescription& d, std::vector<Finding>& out) {
  std::map<std::pair<Type, std::uint32_t>, const ModelVariable*> first;
  for (const ModelVariable& v : d.variables) {
    if (std::holds_alternative<std::monostate>(v.start)) continue;
    const auto [known, is_new] = first.emplace(std::pair{v.type, v.reference}, &v);
    if (is_new) continue;
    const ModelVariable& other = *known->second;
    const bool same = other.start == v.start;
    out.push_back({same ? Level::kWarning : Level::kError,
                   "variables '" + other.name + "' and '" + v.name + "' have the same value reference " +
                       std::to_string(v.reference) + (same ? " and a start value each" : " and different start values") +
                       ", expected one start value"});
  }
}

bool is_number(Type type) { return type <= Type::kUInt64; }

}  // namespace

std::vector<Finding> check_description(const ModelDescription& d) {
  std::vector<Finding> out;
  const auto add = [&](Level level, std::string text) { out.push_back({level, std::move(text)}); };
  const bool two = d.version == Version::k2;
  if (d.token.empty()) add(Level::kError, two ? "guid is empty" : "instantiationToken is empty");
  const DescriptionIndex index(d);
  std::vector<bool> outputs(d.variables.size());
  for (const Unknown& u : d.structure.outputs) outputs[u.variable] = true;
  for (std::size_t i = 0; i < d.variables.size(); ++i) {
    const ModelVariable& v = d.variables[i];
    const auto name = [&] { return "variable '" + v.name + "'"; };
    const bool starts = !std::holds_alternative<std::monostate>(v.start);
    const bool parameter = v.causality == Causality::kParameter || v.causality == Causality::kStructuralParameter;
    if ((parameter || v.causality == Causality::kInput || v.initial == Initial::kExact || v.initial == Initial::kApprox) &&
        v.causality != Causality::kIndependent && !starts && v.type != Type::kClock && v.type != Type::kBinary &&
        v.type != Type::kString) {
      add(Level::kError, name() + " has no start value, expected one");
    }
    if (starts && (v.initial == Initial::kCalculated || v.causality == Causality::kIndependent)) {
      add(Level::kError, name() + " is calculated and must not have a start value");
    }
    if (v.variability == Variability::kContinuous && v.type != Type::kFloat64 && v.type != Type::kFloat32) {
      add(two ? Level::kWarning : Level::kError, name() + " is continuous, but not of a floating-point type");
    }
    if (parameter && (v.variability == Variability::kDiscrete || v.variability == Variability::kContinuous)) {
      add(Level::kError, name() + " is a parameter and cannot be " + std::string(name_of(v.variability)));
    }
    if ((v.causality == Causality::kInput || v.causality == Causality::kOutput) &&
        (v.variability == Variability::kFixed || v.variability == Variability::kTunable)) {
      add(Level::kError,
          name() + " is an " + std::string(name_of(v.causality)) + " and cannot be " + std::string(name_of(v.variability)));
    }
    const Numeric numeric = index.effective(v);
    if (is_number(v.type) && !numeric.unit.empty() && index.unit(numeric.unit) == nullptr) {
      add(Level::kWarning, name() + " has the unit '" + numeric.unit + "', which is not defined");
    }
    if (const auto* start = std::get_if<std::vector<double>>(&v.start)) {
      for (const double value : *start) {
        if (!std::isfinite(value)) {
          add(Level::kWarning, name() + " has the start value " + text::to_text(value) + ", expected a finite number");
          break;
        }
        if ((numeric.min && value < *numeric.min) || (numeric.max && value > *numeric.max)) {
          add(Level::kWarning, name() + " has a start value outside its range: " + text::to_text(value));
          break;
        }
      }
    }
    if (v.causality == Causality::kOutput && v.type != Type::kClock && !outputs[i])
      add(Level::kError, name() + " is an output, but not listed in ModelStructure");
  }
  for (std::size_t i = 0; i < outputs.size(); ++i) {
    if (outputs[i] && d.variables[i].causality != Causality::kOutput)
      add(Level::kError,
          "'" + d.variables[i].name + "' is listed as an output in ModelStructure, but its causality is not output");
  }
  for (const auto* list : {&d.structure.outputs, &d.structure.derivatives, &d.structure.initial_unknowns,
                           &d.structure.clocked_states, &d.structure.event_indicators}) {
    std::vector<bool> seen(d.variables.size());
    for (const Unknown& u : *list) {
      if (seen[u.variable])
        add(Level::kError, "'" + d.variables[u.variable].name + "' appears twice in one list of ModelStructure");
      seen[u.variable] = true;
    }
  }
  if (two) check_alias_starts(d, out);
  for (const auto* interface : {&d.co_simulation, &d.model_exchange}) {
    if (!*interface) continue;
    if ((*interface)->can_serialise_state && !(*interface)->can_get_and_set_state)
      add(Level::kError, "states can be serialised, but not read and set");
    if ((*interface)->needs_execution_tool) add(Level::kNote, "the FMU needs the installation of its tool");
  }
  std::stable_sort(out.begin(), out.end(), [](const Finding& a, const Finding& b) { return a.level < b.level; });
  return out;
}

std::vector<Finding> check_fmu(const fs::path& path, bool load_it) {
  std::vector<Finding> out;
  try {
    const std::shared_ptr<const ForeignFmu> fmu = open_fmu(path);
    const ModelDescription& d = fmu->description;
    out = check_description(d);
    check_attributes(fmu->folder, d.version, out);
    check_resources(fmu->folder, d, out);
    check_libraries(fmu->folder, d, out);
    for (const InterfaceChoice kind : {InterfaceChoice::kCoSimulation, InterfaceChoice::kModelExchange}) {
      const bool co = kind == InterfaceChoice::kCoSimulation;
      if (!load_it || !(co ? d.co_simulation : d.model_exchange)) continue;
      const std::string name = co ? "Co-Simulation" : "Model Exchange";
      try {
        LoadOptions options;
        options.kind = kind;
        options.process = ProcessChoice::kOwn;  // a crash ends only that process
        Instance instance = load(fmu, options);
        instance.unit->initialise({});
        for (const std::string& warning : instance.warnings) out.push_back({Level::kNote, warning});
        out.push_back({Level::kNote, name + ": instantiated and initialised"});
      } catch (const Error& error) {
        out.push_back({Level::kError, name + ": " + error.what()});
      }
    }
  } catch (const Error& error) {
    out.push_back({Level::kError, error.what()});
  } catch (const fs::filesystem_error& error) {
    out.push_back({Level::kError, error.what()});
  }
  std::stable_sort(out.begin(), out.end(), [](const Finding& a, const Finding& b) { return a.level < b.level; });
  return out;
}

void write_info(std::ostream& out, const fs::path& path) {
  const std::shared_ptr<const ForeignFmu> fmu = open_fmu(path);
  const ModelDescription& d = fmu->description;
  const auto line = [&](std::string_view what, const std::string& text) {
    if (!text.empty()) out << std::string(what) << std::string(what.size() < 18 ? 18 - what.size() : 1, ' ') << text << '\n';
  };
  line("FMI version", d.fmi_version);
  line("Model name", d.model_name);
  line("Description", d.description);
  line("Author", d.author);
  line("Version", d.model_version);
  line("License", d.license);
  line("Generated by", d.generation_tool);
  line("Generated at", d.generation_date);
  line(d.version == Version::k2 ? "GUID" : "Token", d.token);
  const auto abilities = [&](const char* what, const std::optional<Interface>& interface) {
    if (!interface) return;
    std::vector<std::string> can = {interface->model_identifier};
    const auto add = [&](bool there, const char* text) {
      if (there) can.emplace_back(text);
    };
    add(interface->can_get_and_set_state, "states");
    add(interface->can_serialise_state, "states as bytes");
    add(interface->provides_directional_derivatives, "directional derivatives");
    add(interface->variable_step, "variable steps");
    add(interface->has_event_mode, "event mode");
    add(interface->might_return_early, "early return");
    add(interface->provides_intermediate_update, "intermediate update");
    add(interface->can_interpolate_inputs, "input derivatives");
    add(interface->only_once_per_process, "once per process only");
    line(what, text::joined(can));
  };
  abilities("Co-Simulation", d.co_simulation);
  abilities("Model Exchange", d.model_exchange);
  abilities("Sched. Execution", d.scheduled_execution);
  std::set<std::string> platforms;
  for (const fs::path& file : libraries(fmu->folder)) platforms.insert(file.parent_path().filename().string());
  line("Platforms", text::joined({platforms.begin(), platforms.end()}));
  if (d.version == Version::k2 && d.model_exchange) line("Event indicators", std::to_string(d.event_indicators));
  line("Continuous states", std::to_string(d.structure.derivatives.size()));
  if (d.default_experiment) {
    const DefaultExperiment& e = *d.default_experiment;
    std::vector<std::string> parts;
    const auto add = [&](const char* what, const std::optional<double>& value, const char* unit) {
      if (value) parts.push_back(what + text::to_text(*value) + unit);
    };
    add("from ", e.start, " s");
    add("to ", e.stop, " s");
    add("step ", e.step, " s");
    add("tolerance ", e.tolerance, "");
    line("Experiment", text::joined(parts));
  }
  std::map<Causality, std::size_t> counts;
  for (const ModelVariable& v : d.variables) ++counts[v.causality];
  std::vector<std::string> parts;
  for (const auto& [causality, n] : counts) parts.push_back(std::to_string(n) + " " + std::string(name_of(causality)));
  line("Variables", std::to_string(d.variables.size()) + " (" + text::joined(parts) + ")");
  const DescriptionIndex index(d);
  for (const Causality causality :
       {Causality::kInput, Causality::kOutput, Causality::kParameter, Causality::kStructuralParameter}) {
    for (const ModelVariable& v : d.variables) {
      if (v.causality != causality) continue;
      std::string size;
      if (!v.dimensions.empty()) size = "[" + std::to_string(index.elements(v)) + "]";
      const std::string unit = index.effective(v).unit;
      out << "  " << name_of(causality) << "  " << v.name << size << "  " << name_of(v.type)
          << (unit.empty() ? "" : "  " + unit) << (v.description.empty() ? "" : "  " + v.description) << '\n';
    }
  }
}

bool write_findings(std::ostream& out, const std::vector<Finding>& findings) {
  static constexpr std::array<const char*, 3> kWords = {"error", "warning", "note"};
  std::array<std::size_t, 3> counts{};
  for (const Finding& f : findings) {
    ++counts[static_cast<std::size_t>(f.level)];
    out << kWords[static_cast<std::size_t>(f.level)] << ": " << f.text << '\n';
  }
  const auto counted = [&](std::size_t level) {
    return text::counted(static_cast<std::int64_t>(counts[level]), kWords[level]);
  };
  out << counted(0) << ", " << counted(1) << '\n';
  return counts[0] == 0;
}

}  // namespace cotwin::fmu
