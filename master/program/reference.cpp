#include "master/program/reference.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <ostream>

#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

constexpr std::array kRoles = {Role::kInput, Role::kOutput, Role::kTunable, Role::kParameter, Role::kState};

const char* title(Role role) {
  switch (role) {
    case Role::kInput:
      return "Inputs";
    case Role::kOutput:
      return "Outputs";
    case Role::kTunable:
      return "Tunable parameters";
    case Role::kParameter:
      return "Fixed parameters";
    case Role::kState:
      return "States";
  }
  return "";
}

std::string range(const Variable& v) { return std::isfinite(v.min) || std::isfinite(v.max) ? allowed_values(v) : ""; }

std::vector<std::string> values(const Variable& v) {
  std::vector<std::string> texts;
  switch (v.kind()) {
    case Kind::kReal:
      for (const double x : v.reals()) texts.push_back(text::to_text(x));
      break;
    case Kind::kInteger:
      for (const std::int32_t x : v.integers()) texts.push_back(std::to_string(x));
      break;
    case Kind::kBoolean:
      for (const bool x : v.booleans()) texts.emplace_back(x ? "true" : "false");
      break;
    case Kind::kString:
      for (const std::string& x : v.strings()) texts.push_back(x);
      break;
  }
  return texts;
}

/// Returns the start value as text: a single value if all elements are equal.
std::string start_value(const Variable& v) {
  if (v.role == Role::kOutput || v.role == Role::kState) return "";
  const std::vector<std::string> all = values(v);
  if (all.empty()) return "";
  if (std::all_of(all.begin(), all.end(), [&](const std::string& x) { return x == all.front(); })) return all.front();
  return text::joined(all);
}

/// The units of measure of its elements, each once, or the kind.
std::string measure_of(const Variable& v) {
  if (v.kind() != Kind::kReal) return std::string(name_of(v.kind()));
  std::vector<std::string> all;
  for (std::size_t i = 0; i < v.size() && (i == 0 || v.mixed()); ++i) {
    if (std::ranges::find(all, v.si_of(i)) == all.end()) all.push_back(v.si_of(i));
  }
  return text::joined(all);
}

template <class Do>
void for_each_role(const Variables& variables, const Do& action) {
  for (const Role role : kRoles) {
    std::vector<const Variable*> list;
    for (const Variable& v : variables) {
      if (v.role == role) list.push_back(&v);
    }
    if (!list.empty()) action(role, list);
  }
}

std::string cell(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2) text.replace(at, 1, "\\|");
  return text;
}

void describe_settings(std::ostream& out, const Settings& settings) {
  if (settings.list().all().empty()) return;
  std::size_t name_width = 0;
  for (const Setting& s : settings.list()) name_width = std::max(name_width, s.name.size());
  out << "\nSettings (unit:name?setting=value, or --set component.setting=value)\n";
  for (const Setting& s : settings.list()) {
    std::string name = s.name, kind(name_of(s.kind));
    name.resize(name_width, ' ');
    kind.resize(std::max<std::size_t>(kind.size(), 7), ' ');
    const std::string values = allowed_values(s);
    out << "  " << name << "  " << kind << "  " << s.description;
    if (!values.empty()) out << "; " << values;
    out << (s.fallback ? "; default: " : "; ") << default_value(s);
    if (const auto given = settings.given(s.name)) out << "; here: " << *given;
    out << '\n';
  }
}

nlohmann::ordered_json json_of(const Setting& s, const std::optional<std::string>& given) {
  nlohmann::ordered_json item = {{"name", s.name}, {"kind", name_of(s.kind)}, {"description", s.description}};
  if (s.kind == Setting::Kind::kChoice) item["choices"] = s.choices;
  if (s.kind == Setting::Kind::kInteger) {
    item["min"] = s.min;
    item["max"] = s.max;
  }
  item["required"] = !s.fallback.has_value();
  if (!s.fallback_rule.empty()) {
    item["default_rule"] = s.fallback_rule;
  } else if (s.fallback) {
    item["default"] = *s.fallback;
  }
  if (given) item["value"] = *given;
  return item;
}

}  // namespace

void describe(std::ostream& out, const Described& unit) {
  const Instance& instance = unit.instance;
  out << unit.source << '\n';
  describe_settings(out, unit.settings);
  if (!unit.missing.empty()) out << "\nThe variables depend on a missing setting:\n  " << unit.missing << '\n';
  std::size_t name_width = 0, measure_width = 0;
  for (const Variable& v : instance.variables) {
    name_width = std::max(name_width, v.name.size() + (v.size() == 1 ? 0 : 2 + std::to_string(v.size()).size()));
    measure_width = std::max(measure_width, measure_of(v).size());
  }
  for_each_role(instance.variables, [&](Role role, const std::vector<const Variable*>& list) {
    out << '\n' << title(role) << '\n';
    for (const Variable* v : list) {
      std::string name = v->name + (v->size() == 1 ? "" : "[" + std::to_string(v->size()) + "]");
      name.resize(name_width, ' ');
      std::string measure = measure_of(*v);
      measure.resize(measure_width, ' ');
      const std::string value = start_value(*v), limits = range(*v);
      out << "  " << name << "  " << measure << "  " << v->description;
      if (!value.empty()) out << "; starts at " << value;
      if (!limits.empty()) out << "; " << limits;
      out << '\n';
    }
  });
  for (const std::string& warning : instance.warnings) out << "\nwarning: " << warning << '\n';
}

void describe_json(std::ostream& out, const Described& unit) {
  const Instance& instance = unit.instance;
  nlohmann::ordered_json j;
  j["source"] = unit.source;
  j["settings"] = nlohmann::ordered_json::array();
  for (const Setting& s : unit.settings.list()) j["settings"].push_back(json_of(s, unit.settings.given(s.name)));
  if (!unit.missing.empty()) j["missing"] = unit.missing;
  j["variables"] = nlohmann::ordered_json::array();
  for (const Variable& v : instance.variables) {
    nlohmann::ordered_json item = {
        {"name", v.name}, {"role", name_of(v.role)},     {"kind", name_of(v.kind())}, {"size", v.size()},
        {"unit", v.si},   {"description", v.description}};
    if (std::isfinite(v.min)) item["min"] = v.min;
    if (std::isfinite(v.max)) item["max"] = v.max;
    if (v.role != Role::kOutput && v.role != Role::kState) item["start"] = values(v);
    item["ramped"] = !v.rate.empty();
    if (v.mixed()) item["units"] = v.elements->si;
    if (v.elements != nullptr && !v.elements->names.empty()) item["joints"] = v.elements->names;
    j["variables"].push_back(std::move(item));
  }
  j["warnings"] = instance.warnings;
  out << j.dump(2, ' ', false, nlohmann::ordered_json::error_handler_t::replace) << '\n';
}

void describe_markdown(std::ostream& out, const UnitType& type, const Described& unit, const std::string& given_settings) {
  const Instance& instance = unit.instance;
  out << "# `unit:" << type.name << "`\n\n"
      << type.summary << "\n\nWritten by `cotwin reference` from the unit's declarations, with " << given_settings
      << ": sizes and start values are that robot's.\n";
  if (const auto names = unit.settings.list().first_variables(); !names.empty()) {
    out << "\n## To begin with\n\n| name | role | measure | meaning |\n|---|---|---|---|\n";
    for (const std::string& name : names) {
      const Variable& v = instance.variables.at(name);
      out << "| `" << name << "` | " << name_of(v.role) << " | " << measure_of(v) << " | " << cell(v.description) << " |\n";
    }
  }
  out << "\n## Settings\n\n"
      << "Chosen before the unit has variables: in its source, `unit:" << type.name
      << "?setting=value`, or by `--set component.setting=value`.\n\n| name | values | default | meaning "
         "|\n|---|---|---|---|\n";
  for (const Setting& s : unit.settings.list()) {
    const std::string values = allowed_values(s);
    out << "| `" << s.name << "` | " << cell(values.empty() ? std::string(name_of(s.kind)) : values) << " | "
        << cell(default_value(s)) << " | " << cell(s.description) << " |\n";
  }
  for_each_role(instance.variables, [&](Role role, const std::vector<const Variable*>& list) {
    const bool given = role != Role::kOutput && role != Role::kState;
    out << "\n## " << title(role) << "\n\n| name | size | measure | meaning |" << (given ? " start value | range |" : "")
        << "\n|---|---|---|---|" << (given ? "---|---|" : "") << '\n';
    for (const Variable* v : list) {
      out << "| `" << v->name << "` | " << v->size() << " | " << measure_of(*v) << " | " << cell(v->description) << " |";
      if (given) out << ' ' << cell(start_value(*v)) << " | " << range(*v) << " |";
      out << '\n';
    }
  });
}

}  // namespace cotwin::master
