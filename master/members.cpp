#include "master/members.h"

#include <algorithm>
#include <array>

#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::master {

namespace {

/// An SSP connector's kind as the roles of ours that it may stand for.
bool connector_fits(const std::string& kind, Role role) {
  if (kind == "input") return role == Role::kInput;
  if (kind == "output") return role == Role::kOutput || role == Role::kState;
  if (kind == "parameter") return role == Role::kParameter || role == Role::kTunable;
  if (kind == "calculatedParameter") return role == Role::kOutput || role == Role::kParameter;
  return kind == "inout" && (role == Role::kInput || role == Role::kOutput);
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

Instance load_fmu(const FmuSource& source) { return fmu::load(source.path, source.options); }

}  // namespace

FmuSource fmu_source(const ComponentSpec& spec, const Scenario& scenario) {
  const std::size_t question = spec.source.rfind('?');
  fmu::LoadOptions options;
  options.instance_name = spec.name;
  options.kind = spec.implementation == "CoSimulation" ? "cs" : spec.implementation == "ModelExchange" ? "me" : "any";
  options.process = spec.process;
  if (question != std::string::npos) options = fmu::read_query(std::string_view(spec.source).substr(question + 1), options);
  return {scenario.folder / spec.source.substr(0, question), options};
}

ParameterSet start_values(const Scenario& scenario, const Member& member, std::vector<std::string>* unknown) {
  ParameterSet set{member.name(), {}, scenario.units};
  for (const ParameterValue& value : member.spec.start_values) {
    const bool by_the_user = value.place.rfind("--set ", 0) == 0;  // a slip there is never ignored
    if (by_the_user || !scenario.ignore_unknown_parameters ||
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
    fail(connector.place, "connector " + in_quotes(full) + " is of kind " + in_quotes(connector.kind) +
                              ", but the variable is " + with_article(variable->role));
  }
  if (!connector.type.empty() && !type_fits(connector.type, variable->kind())) {
    fail(connector.place, "connector " + in_quotes(full) + " is " + connector.type + ", but the variable is " +
                              std::string(name_of(variable->kind())));
  }
  if (!connector.unit.empty() && !variable->si.empty() &&
      !si::convertible(measure(scenario, connector.unit), si::parse(variable->si))) {
    fail(connector.place,
         "connector " + in_quotes(full) + ": " + connector.unit + " is not a measure of a variable in " + variable->si);
  }
}

Member load_member(const ComponentSpec& spec, const Scenario& scenario, std::span<const UnitType> types,
                   const std::vector<std::filesystem::path>& folders, std::vector<std::string>* settings_used) {
  try {
    return {spec, is_unit(spec) ? make_unit(spec.source, scenario.settings, folders, types, settings_used)
                                : load_fmu(fmu_source(spec, scenario))};
  } catch (const Error& error) {
    fail(spec.place, "component " + in_quotes(spec.name) + ": " + error.what());
  }
}

void check_settings(const Scenario& scenario, std::span<Member> members, const std::vector<std::string>& used) {
  for (const auto& [key, value] : scenario.settings) {
    if (std::find(used.begin(), used.end(), key) != used.end()) continue;
    const std::string setting = "setting " + in_quotes(key) + " = " + in_quotes(value);
    const auto sealed = std::find_if(members.begin(), members.end(), [](const Member& m) { return !is_unit(m.spec); });
    if (sealed == members.end())
      fail(scenario.file.filename().string(), setting + ": no unit of this scenario has it" + suggestion(key, used));
    sealed->instance.warnings.push_back(setting + " does not reach an FMU");
  }
}

std::vector<Member> load_members(const Scenario& scenario, std::span<const UnitType> types,
                                 const std::vector<std::filesystem::path>& folders) {
  std::vector<Member> members;
  std::vector<std::string> used;
  for (const ComponentSpec& spec : scenario.components) {
    std::vector<std::string> asked;
    members.push_back(load_member(spec, scenario, types, folders, &asked));
    used.insert(used.end(), asked.begin(), asked.end());
    Member& member = members.back();
    for (const ConnectorSpec& connector : spec.connectors) check_connector(connector, member, scenario);
    // A value's own place is told by apply.
    apply(start_values(scenario, member, &member.instance.warnings), member.variables());
  }
  check_settings(scenario, members, used);
  return members;
}

}  // namespace cotwin::master
