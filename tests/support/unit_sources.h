#pragma once
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

#include "components/unit/unit_table.h"
#include "tests/support/places.h"

/// All units for tests that do not name them. Settings and start values that a unit needs are in
/// tests/components/properties/<unit>.sources (one line per variant: the query of its source), <unit>.ssv for the first variant and
/// <unit>.2.ssv … for the others.
namespace cotwin::testing {

inline std::filesystem::path properties_folder() {
  return std::filesystem::path(places::source()) / "tests/components/properties";
}

/// Whether no FMU can contain the unit (HOST_ONLY of cotwin_unit).
inline bool is_host_only(const UnitType& type) { return std::string_view(type.name) == "gateway"; }

/// The sources of all variants of a unit, at least one.
inline std::vector<std::string> unit_sources(const UnitType& type) {
  const std::string source = std::string("unit:") + type.name;
  std::ifstream queries(properties_folder() / (std::string(type.name) + ".sources"));
  std::vector<std::string> all;
  for (std::string query; std::getline(queries, query);) all.push_back(query.empty() ? source : source + "?" + query);
  if (all.empty()) all.push_back(source);
  return all;
}

/// The start values of a source of unit_sources(); none for most.
inline std::vector<ParameterSet> start_values(const std::string& source) {
  const std::string unit = parse_unit_source(source).unit;
  const std::vector<std::string> all = unit_sources({unit.c_str(), "", nullptr});
  const auto variant = std::find(all.begin(), all.end(), source) - all.begin() + 1;
  const std::string number = variant > 1 ? "." + std::to_string(variant) : "";
  const std::filesystem::path file = properties_folder() / (unit + number + ".ssv");
  if (!std::filesystem::exists(file)) return {};
  return {load_parameter_set(file)};
}

}  // namespace cotwin::testing
