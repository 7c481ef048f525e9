#include "models/trajectory/columns.h"

#include <algorithm>
#include <cctype>

#include "models/foundation/support/choice.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::trajectory {

// Patterns from 0 come first: a table with a column 0 would also match a pattern from 1, without its first column.
const Quantity kPositions = {
    "q",
    {"q{0}", "q{}", "q_{0}", "q_{}", "q[{0}]", "q[{}]", "actual_q_{0}", "position{0}", "position{}", "position_{0}",
     "position_{}", "{name}", "q_{name}", "position_{name}", "{name}_position", "{name}.position"}};
const Quantity kVelocities = {
    "dq", {"dq{0}",      "dq{}",         "dq_{0}",      "dq_{}",     "dq[{0}]",         "dq[{}]",          "qd{0}",
           "qd{}",       "qd_{0}",       "qd_{}",       "qdot{0}",   "qdot{}",          "actual_qd_{0}",   "velocity{0}",
           "velocity{}", "velocity_{0}", "velocity_{}", "dq_{name}", "velocity_{name}", "{name}_velocity", "{name}.velocity"}};
const Quantity kTorques = {
    "tau", {"tau{0}",     "tau{}",         "tau_{0}",       "tau_{}",        "tau[{0}]",      "tau[{}]",      "effort{0}",
            "effort{}",   "effort_{0}",    "effort_{}",     "torque{0}",     "torque{}",      "torque_{0}",   "torque_{}",
            "tau_{name}", "effort_{name}", "{name}_effort", "{name}.effort", "torque_{name}", "{name}_torque"}};
const Quantity kExternalTorques = {"tau_e",
                                   {"tau_e{0}", "tau_e{}", "tau_e_{0}", "tau_e_{}", "tau_e[{0}]", "tau_e[{}]", "tau_ext{0}",
                                    "tau_ext{}", "tau_ext_{0}", "tau_ext_{}", "tau_e_{name}", "tau_ext_{name}"}};

namespace {

/// Name of the column of joint j (from 0): replaces "{}", "{0}" and "{name}".
std::string column_of(std::string pattern, std::size_t j, std::span<const Axis> axes) {
  const auto replace = [&](std::string_view key, const std::string& by) {
    for (std::size_t at = pattern.find(key); at != std::string::npos; at = pattern.find(key, at + by.size())) {
      pattern.replace(at, key.size(), by);
    }
  };
  replace("{}", std::to_string(j + 1));
  replace("{0}", std::to_string(j));
  if (j < axes.size()) replace("{name}", axes[j].name);
  return pattern;
}

bool is_numbered(std::string_view pattern) { return pattern.find("{}") != pattern.npos || pattern.find("{0}") != pattern.npos; }

bool has(const csv::Source& reader, const std::string& name) {
  return std::find(reader.names().begin(), reader.names().end(), name) != reader.names().end();
}

std::vector<std::size_t> by_pattern(const csv::Source& reader, const std::string& file, const std::string& pattern,
                                    const Quantity& quantity, std::span<const Axis> axes) {
  const std::size_t n = axes.size();
  std::size_t found = 0;
  while (has(reader, column_of(pattern, found, axes)) && (found < n || is_numbered(pattern))) ++found;
  if (is_numbered(pattern) && found != n && found > 0) {
    throw Error(file, "has columns '" + column_of(pattern, 0, axes) + "' to '" + column_of(pattern, found - 1, axes) + "' of " +
                          quantity.name + ", expected " + std::to_string(n) +
                          ", one per joint; select columns by a list of names");
  }
  std::vector<std::size_t> columns;
  for (std::size_t j = 0; j < n; ++j) columns.push_back(reader.column(column_of(pattern, j, axes)));
  return columns;
}

std::vector<std::size_t> by_list(const csv::Source& reader, const std::string& file, const std::string& list,
                                 const Quantity& quantity, std::span<const Axis> axes) {
  std::vector<std::size_t> columns;
  for (const std::string_view name : text::split(list, ',')) columns.push_back(reader.column(text::trim(name)));
  if (columns.size() != axes.size()) {
    throw Error(file, std::to_string(columns.size()) + " columns given for " + quantity.name + " ('" + list + "'), expected " +
                          std::to_string(axes.size()) + ", one per joint");
  }
  return columns;
}

}  // namespace

std::vector<std::size_t> find_columns(const csv::Source& reader, const std::string& file, const std::string& columns,
                                      const Quantity& quantity, std::span<const Axis> axes) {
  if (columns == "none") return {};
  if (columns.find('{') != std::string::npos) return by_pattern(reader, file, columns, quantity, axes);
  if (!columns.empty()) return by_list(reader, file, columns, quantity, axes);
  // Joints whose names are numbers are meant by their names, as a bag has them: position_2.
  for (const std::string pattern : quantity.patterns) {
    const bool by_name = pattern == "position_{name}" || pattern == "velocity_{name}" || pattern == "effort_{name}";
    std::size_t found = 0;
    while (by_name && found < axes.size() && has(reader, column_of(pattern, found, axes))) ++found;
    if (by_name && found > 0 && found == axes.size()) return by_pattern(reader, file, pattern, quantity, axes);
  }
  for (const char* pattern : quantity.patterns) {
    if (has(reader, column_of(pattern, 0, axes))) return by_pattern(reader, file, pattern, quantity, axes);
  }
  return {};
}

std::string table_columns(const std::vector<std::string>& names) {
  if (names.size() == 1 && names[0].find(' ') != std::string::npos)
    return "; the table has one column, whose name has blanks, expected a comma, semicolon or tab between cells";
  std::vector<std::string> patterns;
  for (const std::string& name : names) {
    const std::size_t digits = name.find_last_not_of("0123456789") + 1;  // 0 for a name of digits alone
    const std::string number = name.substr(digits), stem = name.substr(0, digits);
    if (number != "0" && number != "1") continue;
    const std::string pattern = stem + (number == "0" ? "{0}" : "{}");
    const bool from_0 = std::ranges::find(patterns, stem + "{0}") != patterns.end();
    if (!from_0) patterns.push_back(pattern);
  }
  constexpr std::size_t kMostNames = 20;
  const bool is_numbered = !patterns.empty();
  if (!is_numbered)
    patterns.assign(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(std::min(names.size(), kMostNames)));
  for (std::string& pattern : patterns) pattern = "'" + pattern + "'";
  return (is_numbered ? "; numbered columns of the table: " : "; columns of the table: ") + text::joined(patterns) +
         (!is_numbered && names.size() > kMostNames ? ", …" : "");
}

std::size_t find_time_column(const csv::Source& reader, const std::string& file, const std::string& column,
                             const char* remedy) {
  if (!column.empty()) return reader.column(column);
  for (const char* wanted : {"t", "time", "timestamp"}) {
    for (std::size_t c = 0; c < reader.names().size(); ++c) {
      std::string name = reader.names()[c];
      std::transform(name.begin(), name.end(), name.begin(),
                     [](unsigned char x) { return static_cast<char>(std::tolower(x)); });
      if (name == wanted) return c;
    }
  }
  throw Error(file,
              "has no column 't', 'time' or 'timestamp', expected one" + std::string(remedy) + table_columns(reader.names()));
}

double seconds_per(const std::string& option, const std::string& word) {
  return text::choose<double>(option, word, {{"s", 1}, {"ms", 1e-3}, {"us", 1e-6}, {"ns", 1e-9}});
}

}  // namespace cotwin::trajectory
