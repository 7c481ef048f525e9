#include "components/unit/unit_table.h"

#include <algorithm>

#include "components/unit/si.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/file_store.h"
#include "models/foundation/support/text.h"

namespace cotwin {

namespace {

constexpr std::string_view kScheme = "unit:";

/// `value`, given in `unit` (one that the set defines, or a common one), in the measure of the element, or of all (-1).
double in_measure_of(const FoundElement& found, double value, const ParameterValue& given, const ParameterSet& set) {
  const Variable& variable = *found.variable;
  if (given.unit.empty()) return value;
  if (found.element < 0 && variable.mixed())
    throw Error(given.place, given.name + ": its elements are in " + text::joined(variable.elements->si) +
                                 ", expected a value of each, or none in " + given.unit);
  const std::string& si = variable.si_of(static_cast<std::size_t>(std::max<std::ptrdiff_t>(found.element, 0)));
  if (si.empty()) return value;
  const auto defined =
      std::find_if(set.units.begin(), set.units.end(), [&](const UnitDefinition& u) { return u.name == given.unit; });
  const si::Measure from = defined != set.units.end() ? si::from(*defined) : si::parse(given.unit);
  const si::Measure to = si::parse(si);
  if (!si::convertible(from, to)) throw Error(given.place, given.name + ": " + given.unit + " cannot give " + si);
  const si::Conversion c = si::conversion(from, to);
  return c.factor * value + (variable.relative ? 0 : c.offset);
}

}  // namespace

const UnitType& find_type(std::string_view name, std::span<const UnitType> types) {
  std::vector<std::string> names;
  for (const UnitType& type : types) {
    if (type.name == name) return type;
    names.emplace_back(type.name);
  }
  const std::string all = text::joined(names);
  const std::string closest = text::closest(name, names);
  throw Error("unit:" + std::string(name),
              "no such unit; there are " + all + (closest.empty() ? "" : "; did you mean '" + closest + "'?"));
}

UnitSource parse_unit_source(const std::string& source) {
  if (source.rfind(kScheme, 0) != 0) throw Error(source, "expected unit:<name> or unit:<name>?<setting>=<value>&…");
  const std::string rest = source.substr(kScheme.size());
  const std::size_t question = rest.find('?');
  return {rest.substr(0, question), question == std::string::npos ? "" : rest.substr(question + 1)};
}

Instance make_unit(const std::string& source, const std::map<std::string, std::string>& defaults,
                   const std::vector<std::filesystem::path>& folders, std::span<const UnitType> types,
                   std::vector<std::string>* defaults_used, std::shared_ptr<FileStore> models) {
  const UnitSource parts = parse_unit_source(source);
  Settings settings(parts.unit, parts.query, defaults, folders, std::move(models));
  Instance instance = make_unit(settings, types);
  if (defaults_used != nullptr) *defaults_used = settings.defaults_used();
  return instance;
}

Instance make_unit(Settings& settings, std::span<const UnitType> types) {
  Instance instance;
  instance.unit = construct(find_type(settings.unit(), types), settings);
  settings.check_all_used();
  instance.unit->declare(instance.variables);
  for (const std::filesystem::path& robot : settings.robot_files()) {
    const std::filesystem::path values = robot.parent_path() / (settings.unit() + ".ssv");
    if (robot.filename() != "robot.urdf" || !std::filesystem::exists(values)) continue;
    const auto set =
        read_once<ParameterSet>(settings.models(), kValuesKey + values.string(), [&] { return load_parameter_set(values); });
    apply(*set, instance.variables);
    for (const ParameterValue& value : set->values) instance.given.push_back(value.name);
  }
  instance.warnings = settings.warnings();
  instance.robots = settings.robots_used();
  return instance;
}

void apply(const ParameterSet& set, const Variables& variables) {
  for (const ParameterValue& given : set.values) {
    try {
      FoundElement found = find_element(variables, given.name);
      if (found.variable == nullptr) {
        const ElementName name = parse_element_name(given.name);
        found = {&variables.at(name.name), name.element};
      }
      const Variable& variable = *found.variable;
      if (variable.role == Role::kOutput && !variable.has_start)
        throw Error(given.name, "is an output, expected a parameter, an input or a state");
      const bool number = std::holds_alternative<double>(given.value) || std::holds_alternative<std::int64_t>(given.value);
      const bool fits = (variable.kind() == Kind::kReal && number) ||
                        (variable.kind() == Kind::kInteger && std::holds_alternative<std::int64_t>(given.value)) ||
                        (variable.kind() == Kind::kBoolean && std::holds_alternative<bool>(given.value)) ||
                        std::holds_alternative<std::string>(given.value);
      if (!fits) throw Error(given.name, "is " + std::string(name_of(variable.kind())) + ", expected a value of that kind");

      std::string value;
      if (const auto* text = std::get_if<std::string>(&given.value)) {
        value = *text;
      } else if (const auto* boolean = std::get_if<bool>(&given.value)) {
        value = *boolean ? "true" : "false";
      } else if (std::holds_alternative<std::int64_t>(given.value) &&
                 (variable.kind() == Kind::kInteger || variable.exact != nullptr)) {
        value = std::to_string(std::get<std::int64_t>(given.value));
      } else {
        const auto* integer = std::get_if<std::int64_t>(&given.value);
        const double real = integer != nullptr ? static_cast<double>(*integer) : std::get<double>(given.value);
        value = text::to_text(in_measure_of(found, real, given, set));
      }
      if (found.element < 0) {
        assign_text(variable, value);
      } else {
        assign_text(variable, static_cast<std::size_t>(found.element), value);
      }
    } catch (const Error& error) {
      if (given.place.empty() || std::string_view(error.what()).rfind(given.place, 0) == 0) throw;
      throw Error(given.place, error.what());
    }
  }
}

}  // namespace cotwin
