#include "master/members.h"

#include <algorithm>
#include <array>

#include "models/text/error.h"
#include "models/text/text.h"

namespace cotwin::master {

namespace {

std::string in_quotes(std::string_view s) { return "'" + std::string(s) + "'"; }

std::string suggestion(std::string_view wanted, const std::vector<std::string>& candidates) {
  const std::string closest = text::closest(wanted, candidates);
  return closest.empty() ? "" : "; did you mean " + in_quotes(closest) + "?";
}

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
                              ", but the variable is a " + std::string(name_of(variable->role)));
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

}  // namespace

void fail(const std::string& place, const std::string& what) {
  if (place.empty()) throw Error(what);
  throw Error(place, what);
}

si::Measure measure(const Scenario& scenario, const std::string& name) {
  const auto found = std::find_if(scenario.units.begin(), scenario.units.end(), [&](const auto& u) { return u.name == name; });
  return found != scenario.units.end() ? si::from(*found) : si::parse(name);
}

std::vector<Member> load_members(const Scenario& scenario, std::span<const UnitType> types,
                                 const std::vector<std::filesystem::path>& folders) {
  std::vector<Member> members;
  std::vector<std::string> used;
  for (const ComponentSpec& spec : scenario.components) {
    if (spec.source.rfind("unit:", 0) != 0) {
      fail(spec.place, "component " + in_quotes(spec.name) + ": source " + in_quotes(spec.source) +
                           " cannot be run by this version, expected unit:<name>");
    }
    try {
      std::vector<std::string> asked;
      members.push_back({spec, make_unit(spec.source, scenario.settings, folders, types, &asked)});
      used.insert(used.end(), asked.begin(), asked.end());
    } catch (const Error& error) {
      fail(spec.place, "component " + in_quotes(spec.name) + ": " + error.what());
    }
    const Member& member = members.back();
    for (const ConnectorSpec& connector : spec.connectors) check_connector(connector, member, scenario);
    // A value's own place is told by apply.
    apply(ParameterSet{spec.name, spec.start_values, scenario.units}, member.variables());
  }
  for (const auto& [key, value] : scenario.settings) {
    if (std::find(used.begin(), used.end(), key) == used.end()) {
      fail(scenario.file.filename().string(), "setting " + in_quotes(key) + " = " + in_quotes(value) +
                                                  ": no unit of this scenario has it" + suggestion(key, used));
    }
  }
  return members;
}

std::string element_name(const std::string& member, const Variable& variable, std::size_t element) {
  const std::string name = member + "." + variable.name;
  return variable.size() == 1 ? name : name + "[" + std::to_string(element + 1) + "]";
}

Signal find_signal(std::span<const Member> members, std::string_view name, const std::string& place) {
  // Names of nested components contain dots, and so may those of foreign variables: every dot may be the one between them.
  const Member* with_name = nullptr;
  for (std::size_t dot = name.find('.'); dot != std::string_view::npos; dot = name.find('.', dot + 1)) {
    for (std::size_t m = 0; m < members.size(); ++m) {
      if (members[m].name() != name.substr(0, dot)) continue;
      with_name = &members[m];
      FoundElement found;
      try {
        found = find_element(with_name->variables(), name.substr(dot + 1));
      } catch (const Error& error) {
        fail(place, error.what());
      }
      if (!found.variable) continue;
      if (found.element < 0) return {m, found.variable, 0, found.variable->size(), std::string(name)};
      const auto element = static_cast<std::size_t>(found.element);
      if (element >= found.variable->size()) {
        fail(place,
             in_quotes(name) + ": " + found.variable->name + " has " + std::to_string(found.variable->size()) + " elements");
      }
      return {m, found.variable, element, 1, std::string(name)};
    }
  }
  std::vector<std::string> candidates;
  for (const Member& member : members) {
    for (const Variable& v : member.variables()) candidates.push_back(member.name() + "." + v.name);
  }
  fail(place,
       (with_name ? "component " + in_quotes(with_name->name()) + " has no variable " : std::string("there is no variable ")) +
           in_quotes(name) + suggestion(name, candidates));
}

Signal find_real_signal(std::span<const Member> members, std::string_view name, const std::string& place) {
  Signal signal = find_signal(members, name, place);
  if (signal.variable->kind() != Kind::kReal) {
    fail(place, in_quotes(name) + " is " + std::string(name_of(signal.variable->kind())) + ", expected a real variable");
  }
  return signal;
}

bool glob(std::string_view pattern, std::string_view name) {
  // After a mismatch the last * takes one character more: linear in the product of the lengths, no recursion.
  std::size_t p = 0, n = 0, star = std::string_view::npos, resume = 0;
  while (n < name.size()) {
    if (p < pattern.size() && pattern[p] == '*') {
      star = p++;
      resume = n;
    } else if (p < pattern.size() && (pattern[p] == '?' || pattern[p] == name[n])) {
      ++p;
      ++n;
    } else if (star != std::string_view::npos) {
      p = star + 1;
      n = ++resume;
    } else {
      return false;
    }
  }
  return pattern.find_first_not_of('*', p) == std::string_view::npos;
}

}  // namespace cotwin::master
