#include "master/services/motion_file.h"

#include <nlohmann/json.hpp>
#include <sstream>

#include "components/unit/si.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

namespace {

using Json = nlohmann::ordered_json;

/// Postures over time as CSV.
std::string table_of(const Json& motion) {
  const Json &times = motion["t_s"], &rows = motion.contains("q") ? motion["q"] : motion.value("q_rad", Json());
  if (!times.is_array() || !rows.is_array() || rows.empty() || rows.size() != times.size())
    throw Error("motion", "lacks a posture per time, expected those of a reply");
  std::string table = "t";
  for (std::size_t j = 0; j < rows[0].size(); ++j) table += ",q[" + std::to_string(j + 1) + "]";
  for (std::size_t k = 0; k < rows.size(); ++k) {
    table += "\n" + times[k].dump();
    for (const Json& value : rows[k]) table += "," + value.dump();
  }
  return table + "\n";
}

}  // namespace

std::string motion_file(const std::string& motion) {
  Json object;
  try {
    object = Json::parse(motion);
  } catch (const nlohmann::json::exception& e) {
    throw Error("motion", "is not JSON: " + text::reason_of(e));
  }
  if (object.is_object() && object.contains("t_s")) return table_of(object);
  ParameterSet set;
  if (!object.is_object() || !object.contains("unit") || !object["unit"].is_string() || !object.contains("T_s") ||
      !object["T_s"].is_number())
    throw Error("motion", "lacks its unit or its duration, expected those of a reply");
  set.name = object["unit"].get<std::string>();
  set.values.push_back({"T", object["T_s"].get<double>(), "s", ""});
  using Name = std::pair<const char*, const char*>;
  for (const auto& [name, unit] : {Name{"q_start", "_rad"},
                                   {"dq_start", "_rad_per_s"},
                                   {"ddq_start", "_rad_per_s2"},
                                   {"q_end", "_rad"},
                                   {"dq_end", "_rad_per_s"},
                                   {"ddq_end", "_rad_per_s2"},
                                   {"c_r", "_rad"}}) {
    for (const std::string& member : {std::string(name), std::string(name) + unit}) {
      if (!object.contains(member)) continue;
      std::string list;
      for (const Json& value : object[member]) {
        if (!value.is_number()) throw Error("motion: " + member, "has a value that is no number, expected numbers");
        text::append(list, text::to_text(value.get<double>()), " ");
      }
      set.values.push_back({name, list, "", ""});
    }
  }
  si::define_units(set);
  std::ostringstream out;
  write_parameter_set(out, set);
  return out.str();
}

}  // namespace cotwin::master
