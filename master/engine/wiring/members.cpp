#include "master/engine/wiring/members.h"

#include <algorithm>
#include <array>
#include <iterator>
#include <map>

#include "components/bus/live_run.h"
#include "fmu/process/process.h"
#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

/// Whether an SSP connector of this kind may stand for a variable of this role.
bool connector_fits(ConnectorKind kind, Role role) {
  switch (kind) {
    case ConnectorKind::kInput:
      return role == Role::kInput;
    case ConnectorKind::kOutput:
      return role == Role::kOutput || role == Role::kState;
    case ConnectorKind::kParameter:
      return role == Role::kParameter || role == Role::kTunable;
    case ConnectorKind::kCalculatedParameter:
      return role == Role::kOutput || role == Role::kParameter;
    case ConnectorKind::kInout:
      return role == Role::kInput || role == Role::kOutput;
  }
  return false;
}

bool type_fits(const std::string& type, Kind kind) {
  switch (kind) {
    case Kind::kReal:
      return type == "Real";
    case Kind::kInteger:
      return type == "Integer" || type == "Enumeration";
    case Kind::kBoolean:
      return type == "Boolean";
    case Kind::kString:
      return type == "String";
  }
  return false;
}

std::vector<std::string> names_of(const Variables& variables) {
  std::vector<std::string> names;
  for (const Variable& v : variables) names.push_back(v.name);
  return names;
}

/// SSP gives the value of an enumeration by the name of its item: replaces it by the number in the FMU's type definition.
void number_items(Member& member, const fmu::ModelDescription& description) {
  const fmu::DescriptionIndex index(description);
  for (ParameterValue& value : member.spec.start_values) {
    const auto* item_name = std::get_if<std::string>(&value.value);
    const Variable* variable = item_name != nullptr ? find_element(member.variables(), value.name).variable : nullptr;
    if (variable == nullptr || variable->kind() != Kind::kInteger) continue;
    const fmu::ModelVariable* declared = index.variable(value.name);
    if (declared == nullptr) declared = index.variable(variable->name);
    if (declared == nullptr) declared = index.variable(variable->name + "[1]");
    if (declared == nullptr || declared->type != fmu::Type::kEnumeration) continue;
    const fmu::TypeDefinition* const type = index.type(declared->declared_type);
    if (type == nullptr) continue;
    const auto item = std::find_if(type->items.begin(), type->items.end(),
                                   [&](const fmu::EnumerationItem& i) { return i.name == *item_name; });
    if (item != type->items.end()) {
      value.value = std::int64_t{item->value};
      continue;
    }
    if (item_name->find_first_not_of("+-0123456789, \t\n\r") == std::string::npos) continue;  // numbers
    std::string expected;
    for (const fmu::EnumerationItem& i : type->items) expected += in_quotes(i.name) + ", ";
    fail(value.place, member.name() + "." + value.name + ": " + in_quotes(*item_name) + " is not an item of " +
                          in_quotes(type->name) + ", expected " + expected + "or a number");
  }
}

/// The setting `tools` of a component: the tools of the scenario with collision shapes. Throws Error for one that is mounted at
/// two places.
std::string tools_with_shapes(const Scenario& scenario, const std::string& component) {
  std::string all;
  std::map<std::string, std::string> seen;
  const auto list = [](const std::array<double, 3>& v) {
    return text::to_text(v[0]) + " " + text::to_text(v[1]) + " " + text::to_text(v[2]);
  };
  for (const ToolSpec& tool : scenario.tools) {
    if (tool.shapes.empty() || (!tool.scope.empty() && component.rfind(tool.scope + ".", 0) != 0)) continue;
    const std::string item =
        tool.name + "|" + tool.parent + "|" + list(tool.xyz) + "|" + list(tool.rpy) + "|" + tool.shapes.string();
    const auto [at, first] = seen.emplace(tool.name, item);
    if (first) all += (all.empty() ? "" : ";") + item;
    if (at->second != item)
      fail(tool.place, "tool '" + tool.name + "' has collision shapes and is attached at two places, expected a name for each");
  }
  return all;
}

}  // namespace

std::vector<GivenStart> given_starts(const ParameterSet& set, const Member& member) {
  std::vector<GivenStart> given;
  for (const ParameterValue& value : set.values) {
    const auto [variable, element] = find_element(member.variables(), value.name);
    if (variable == nullptr || variable->kind() != Kind::kReal) continue;
    if (variable->role != Role::kInput && variable->role != Role::kOutput) continue;
    const std::size_t first = element < 0 ? 0 : static_cast<std::size_t>(element);
    const std::size_t last = element < 0 ? variable->size() : first + 1;
    for (std::size_t e = first; e < last; ++e) given.push_back({variable->name, e, variable->reals()[e]});
  }
  return given;
}

void check_name(const ParameterValue& value, const Member& member, std::span<const Member> all) {
  if (find_element(member.variables(), value.name).variable != nullptr) return;
  const std::string name = value.name.substr(0, value.name.find('['));
  if (member.variables().find(name) != nullptr) return;  // the element is malformed; apply() reports that
  if (const Setting* setting = member.settings.find(name)) {
    fail(value.place, in_quotes(name) + " is a setting of " + member.spec.source.substr(0, member.spec.source.find('?')) +
                          " and no variable, expected it in the source of the component, …?" + name + "=" +
                          (setting->choices.empty() ? "…" : setting->choices.front()) + ", or as --set " + member.name() + "." +
                          name + "=…");
  }
  std::vector<std::string> names = names_of(member.variables());
  for (const std::string& known : member.settings.names()) names.push_back(known);
  std::vector<std::string> elsewhere;
  for (const Member& other : all) {
    if (&other == &member) continue;
    const bool setting = other.settings.find(name) != nullptr;
    if (setting || other.variables().find(name) != nullptr)
      elsewhere.push_back(other.name() + "." + name + (setting ? " (a setting)" : ""));
  }
  fail(value.place, member.name() + ": no variable " + (member.settings.all().empty() ? "" : "and no setting ") +
                        in_quotes(value.name) +
                        (elsewhere.empty() ? suggestion(name, names) : "; there is " + text::joined(elsewhere)));
}

FmuSource fmu_source(const ComponentSpec& spec, const Scenario& scenario) {
  const std::size_t question = spec.source.rfind('?');
  fmu::LoadOptions options;
  options.instance_name = spec.name;
  options.kind = spec.implementation;
  options.process = spec.process;
  if (scenario.tolerance > 0 || scenario.coupling == CouplingChoice::kImplicit)
    options.rollback = true;  // steps are repeated in each tick
  if (question != std::string::npos) options = fmu::read_query(std::string_view(spec.source).substr(question + 1), options);
  return {scenario.folder / spec.source.substr(0, question), options};
}

ParameterSet start_values(const Scenario& scenario, const Member& member, std::vector<std::string>* unknown) {
  ParameterSet set{member.name(), {}, scenario.units};
  for (const ParameterValue& value : member.spec.start_values) {
    // Typing errors of the user are never ignored.
    if (value.by_user || !scenario.ignore_unknown_parameters ||
        find_element(member.variables(), value.name).variable != nullptr) {
      set.values.push_back(value);
    } else if (unknown != nullptr) {
      unknown->push_back(value.place + ": " + member.spec.source + " has no variable " + in_quotes(value.name));
    }
  }
  return set;
}

void check_connector(const ConnectorSpec& connector, const Member& member, const Scenario& scenario) {
  const std::string full = member.name() + "." + connector.name;
  const auto [variable, element] = find_element(member.variables(), connector.name);
  if (!variable) {
    fail(connector.place, "connector " + in_quotes(full) + ": " + member.spec.source + " has no variable " +
                              in_quotes(connector.name) + suggestion(connector.name, names_of(member.variables())));
  }
  if (element >= static_cast<std::ptrdiff_t>(variable->size())) {
    fail(connector.place,
         "connector " + in_quotes(full) + ": the variable has " + std::to_string(variable->size()) + " elements");
  }
  if (!connector_fits(connector.kind, variable->role)) {
    fail(connector.place, "connector " + in_quotes(full) + " is of kind " +
                              in_quotes(text::word_of(connector.kind, kConnectorWords)) + ", but the variable is " +
                              with_article(variable->role));
  }
  if (!connector.type.empty() && !type_fits(connector.type, variable->kind())) {
    fail(connector.place, "connector " + in_quotes(full) + " is " + connector.type + ", but the variable is " +
                              std::string(name_of(variable->kind())));
  }
  if (connector.unit.empty()) return;
  const std::size_t first = element < 0 ? 0 : static_cast<std::size_t>(element);
  const std::size_t last = element < 0 && variable->mixed() ? variable->size() - 1 : first;
  for (std::size_t i = first; i <= last; ++i) {
    const std::string& si = variable->si_of(i);
    if (!si.empty() && !si::convertible(measure(scenario, connector.unit), si::parse(si)))
      fail(connector.place,
           "connector " + in_quotes(full) + ": " + connector.unit + " is not a measure of a variable in " + si);
  }
}

Member load_member(const ComponentSpec& spec, const Scenario& scenario, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders, fmu::FmuStore& fmus,
                   std::vector<std::string>* settings_used, const std::shared_ptr<FileStore>& models) {
  Member member{spec, {}};
  std::shared_ptr<const fmu::ForeignFmu> foreign;
  try {
    if (is_unit(spec)) {
      if (const std::string tools = tools_with_shapes(scenario, spec.name);
          !tools.empty() && has_setting(spec.source, "tools", types))
        member.spec.source = with_setting(spec.source, "tools", tools);
      member.instance = make_unit(member.spec.source, settings_for(scenario, spec.name), folders, types, settings_used, models);
      member.settings = settings_of(find_type(parse_unit_source(spec.source).unit, types));
    } else {
      const FmuSource source = fmu_source(spec, scenario);
      foreign = fmus.open(source.path, source.options);
      member.instance = fmu::load(foreign, source.options);
      if (!scenario.tools.empty()) member.instance.robots = robots_of_fmu(foreign->folder);
    }
  } catch (const Error& error) {
    fail(spec.place, "component " + in_quotes(spec.name) + ": " + error.what());
  }
  if (foreign) number_items(member, foreign->description);
  return member;
}

void check_settings(const Scenario& scenario, std::span<Member> members, const std::vector<std::string>& used) {
  for (const NestedSetting& nested : scenario.nested_settings) {
    const std::string prefix = nested.scope + ".";
    std::vector<std::string> names;
    bool known = false;
    for (const Member& m : members) {
      if (m.name().rfind(prefix, 0) != 0) continue;
      known = known || m.settings.find(nested.name) != nullptr;
      for (const std::string& name : m.settings.names()) names.push_back(name);
    }
    if (known) continue;
    fail(nested.place, "setting " + in_quotes(nested.name) + " = " + in_quotes(nested.value) +
                           ": no unit of the nested scenario " + in_quotes(nested.scope) + " has it" +
                           suggestion(nested.name, names));
  }
  for (const auto& [key, value] : scenario.settings) {
    if (std::find(used.begin(), used.end(), key) != used.end()) continue;
    const std::string setting = "setting " + in_quotes(key) + " = " + in_quotes(value);
    const auto sealed = std::find_if(members.begin(), members.end(), [](const Member& m) { return !is_unit(m.spec); });
    if (sealed == members.end()) {
      std::vector<std::string> names;  // settings other than `key`
      for (const Member& m : members) std::ranges::remove_copy(m.settings.names(), std::back_inserter(names), key);
      for (const Member& m : members)
        if (m.settings.find(key) != nullptr)
          fail(scenario.file.filename().string(), setting + " has no effect: " + in_quotes(m.name()) +
                                                      " has its own value or does not read it with its other settings (" +
                                                      m.spec.source + "), expected --set " + m.name() + "." + key + "=…" +
                                                      suggestion(key, names));
      fail(scenario.file.filename().string(), setting + ": no unit of this scenario has it" + suggestion(key, names));
    }
    sealed->instance.warnings.push_back(setting + " does not reach an FMU");
  }
}

fmu::ProcessChoice trial_process(const ComponentSpec& spec) {
  const bool own = !is_unit(spec) && spec.process == fmu::ProcessChoice::kAuto && !fmu::host_program().empty();
  return own ? fmu::ProcessChoice::kOwn : spec.process;
}

bool reaches_outside(const Member& member) {
  const Unit& unit = *member.instance.unit;
  return is_unit(member.spec) && (!unit.restorable() || dynamic_cast<const bus::RunObserver*>(&unit) != nullptr);
}

std::vector<Member> load_members(const Scenario& scenario, std::span<const UnitType> types,
                                 const std::vector<std::filesystem::path>& folders, const std::shared_ptr<FileStore>& models) {
  std::vector<Member> members;
  std::vector<std::string> used;
  fmu::FmuStore fmus;
  for (const ComponentSpec& spec : scenario.components) {
    std::vector<std::string> asked;
    members.push_back(load_member(spec, scenario, types, folders, fmus, &asked, models));
    used.insert(used.end(), asked.begin(), asked.end());
    Member& member = members.back();
    for (const ConnectorSpec& connector : spec.connectors) check_connector(connector, member, scenario);
    const ParameterSet values = start_values(scenario, member, &member.instance.warnings);
    try {
      for (const ParameterValue& value : values.values) check_name(value, member);
    } catch (const Error&) {
      // The units after this one, which may have what is meant; not FMUs, whose code would run for the sake of a message.
      const auto next = static_cast<std::ptrdiff_t>(members.size());
      for (auto later = scenario.components.begin() + next; later != scenario.components.end(); ++later) {
        if (!is_unit(*later)) continue;
        try {
          members.push_back(load_member(*later, scenario, types, folders, fmus, nullptr));
        } catch (const Error&) {  // one fault at a time
        }
      }
      for (const ParameterValue& value : values.values) check_name(value, members[static_cast<std::size_t>(next - 1)], members);
    }
    apply(values, member.variables());  // an error names the value's place
    member.given = given_starts(values, member);
  }
  check_settings(scenario, members, used);
  return members;
}

}  // namespace cotwin::master
