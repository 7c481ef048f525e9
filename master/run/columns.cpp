#include "master/run/columns.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string_view>
#include <unordered_map>
#include <unordered_set>

#include "master/clock/clock.h"
#include "models/foundation/support/error.h"

namespace cotwin::master {

namespace {

constexpr const char* kClockName = "clock";

bool has_wildcard(const std::string& pattern) { return pattern.find_first_of("*?") != std::string::npos; }

/// Whether a pattern with a wildcard selects the variable.
bool matches(const std::string& pattern, const std::string& name, const Variable& variable) {
  return variable.role != Role::kParameter && variable.kind() != Kind::kString && glob(pattern, name);
}

/// Those of any clock, for a scenario that does not run.
const Variables& clock_variables() {
  static ClockState state;
  static const Variables variables = [] {
    Variables v;
    state.declare(v);
    return v;
  }();
  return variables;
}

/// Last parts of the names of variables that a page draws from (master/view).
constexpr std::string_view kShown[] = {"q",
                                       "S_p",
                                       "separation_p_a",
                                       "separation_p_b",
                                       "q_link",
                                       "q_c",
                                       "q_d",
                                       "base_p",
                                       "base_quat",
                                       "p",
                                       "quat",
                                       "ranges",
                                       "p_scan",
                                       "quat_scan",
                                       "angle_increment",
                                       "present",
                                       "scale",
                                       "closed",
                                       "f",
                                       "contact_p",
                                       "contact_f",
                                       "tau_e",
                                       "p_a",
                                       "p_b",
                                       "distance",
                                       "zone",
                                       "S_a",
                                       "S_T",
                                       "work_m",
                                       "work_e",
                                       "drawn",
                                       "energy_kinetic",
                                       "energy_potential",
                                       "energy_elastic",
                                       "stored",
                                       "copper",
                                       "converter",
                                       "iron",
                                       "energy_dissipated",
                                       "chopped",
                                       "idle",
                                       "controller_energy",
                                       "supply_losses"};
constexpr std::string_view kPositions[] = {"q", "q_link", "q_c", "q_d"};

bool is_shown(const Variable& variable) {
  if (variable.kind() == Kind::kString || variable.role == Role::kParameter || variable.size() == 0) return false;
  const std::string_view last = std::string_view(variable.name).substr(variable.name.rfind('.') + 1);
  const bool copy = variable.role == Role::kInput && std::ranges::find(kPositions, last) != std::end(kPositions);
  return !copy && std::ranges::find(kShown, last) != std::end(kShown);
}

}  // namespace

std::vector<Column> choose_columns(const Scenario& scenario, std::span<const Member> members, const Variables* clock) {
  std::vector<bool> found(scenario.recording.size());
  std::unordered_map<std::string_view, std::vector<std::size_t>> plain;  // without a wildcard, by name
  std::vector<std::size_t> patterns;
  for (std::size_t r = 0; r < scenario.recording.size(); ++r) {
    const std::string& variables = scenario.recording[r].variables;
    (has_wildcard(variables) ? patterns : plain[variables]).push_back(r);
  }
  std::vector<Column> columns;
  const auto take = [&](const std::string& name, const Variable& variable) {
    bool any = false;
    const auto accept = [&](std::size_t r) {
      if (variable.kind() == Kind::kString)
        fail(scenario.recording[r].place, "'" + name + "' is a String, which cannot be recorded");
      found[r] = any = true;
    };
    if (const auto same = plain.find(name); same != plain.end()) std::ranges::for_each(same->second, accept);
    for (const std::size_t r : patterns) {
      if (matches(scenario.recording[r].variables, name, variable)) accept(r);
    }
    return any;
  };
  for (std::size_t m = 0; m < members.size(); ++m) {
    for (const Variable& variable : members[m].variables()) {
      const std::string whole = members[m].name() + "." + variable.name;
      const std::size_t n = variable.size();
      const bool by_default = (scenario.recording.empty() || scenario.all_outputs) && variable.role == Role::kOutput &&
                              variable.kind() != Kind::kString;
      if (take(whole, variable) || by_default) {
        for (std::size_t i = 0; i < n && scenario.all_outputs; ++i) take(whole + "[" + std::to_string(i + 1) + "]", variable);
        Column column{{}, {m, &variable, 0, n, whole}};
        for (std::size_t i = 0; i < n; ++i) column.names.push_back(element_name(members[m].name(), variable, i));
        columns.push_back(std::move(column));
        continue;
      }
      for (std::size_t i = 0; i < n; ++i) {
        const std::string element = whole + "[" + std::to_string(i + 1) + "]";
        if (take(element, variable))
          columns.push_back({{element_name(members[m].name(), variable, i)}, {m, &variable, i, 1, element}});
      }
    }
  }
  const auto is_clock = [](const Member& member) { return member.name() == kClockName; };
  if (std::ranges::none_of(members, is_clock)) {
    const std::string prefix = std::string(kClockName) + ".";
    for (const Variable& variable : clock != nullptr ? *clock : clock_variables()) {
      const std::string name = prefix + variable.name;
      const auto selects = [&](const RecordSpec& spec) {
        return spec.variables.starts_with(prefix) && glob(spec.variables, name);
      };
      bool any = false;
      for (std::size_t r = 0; r < found.size(); ++r) {
        if (selects(scenario.recording[r])) found[r] = any = true;
      }
      if (any) columns.push_back({{name}, {members.size(), &variable, 0, 1, name}});
    }
  }
  for (std::size_t r = 0; r < found.size(); ++r) {
    const RecordSpec& spec = scenario.recording[r];
    if (found[r]) continue;
    if (!has_wildcard(spec.variables)) (void)find_signal(members, spec.variables, spec.place);  // throws a better message
    fail(spec.place, "nothing to record matches '" + spec.variables + "'");
  }
  return columns;
}

std::vector<Column> choose_view_columns(std::span<const Member> members) {
  std::vector<Column> columns;
  for (std::size_t m = 0; m < members.size(); ++m) {
    for (const Variable& variable : members[m].variables()) {
      if (!is_shown(variable)) continue;
      Column column{{}, {m, &variable, 0, variable.size(), members[m].name() + "." + variable.name}};
      for (std::size_t i = 0; i < variable.size(); ++i) column.names.push_back(element_name(members[m].name(), variable, i));
      columns.push_back(std::move(column));
    }
  }
  return columns;
}

bool has_all(std::span<const Column> columns, Duration interval, std::span<const Column> wanted) {
  if (!wanted.empty() && interval.ns * kViewRate > 1'000'000'000) return false;
  std::unordered_set<const Variable*> whole;
  for (const Column& column : columns) {
    if (column.signal.count == column.signal.variable->size()) whole.insert(column.signal.variable);
  }
  return std::ranges::all_of(wanted, [&](const Column& column) { return whole.contains(column.signal.variable); });
}

std::string columns_json(std::span<const Column> columns) {
  nlohmann::ordered_json all = nlohmann::ordered_json::array();
  all.push_back({{"name", "time"}, {"elements", 1}, {"unit", "s"}});
  for (const Column& column : columns) {
    all.push_back({{"name", column.signal.name}, {"elements", column.signal.count}, {"unit", column.signal.si()}});
    const Elements elements = column.signal.of_elements();
    if (!elements.si.empty()) all.back()["units"] = elements.si;
    if (!elements.names.empty()) all.back()["joints"] = elements.names;
  }
  return all.dump(-1, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

std::string view_heading(std::span<const Column> columns) {
  return R"({"format":"cotwin view 1","columns":)" + columns_json(columns) + "}\n";
}

}  // namespace cotwin::master
