#include "master/services/motion_file.h"

#include <nlohmann/json.hpp>
#include <sstream>

#include "components/unit/si.h"
#include "models/foundation/formats/parameter_set.h"
#include "models/foundation/support/error.h"
#include "models/foundation/support/text.h"

namespace cotwin::master {

std::string motion_file(const std::string& motion) {
  using Json = nlohmann::ordered_json;
  Json object;
  try {
    object = Json::parse(motion);
  } catch (const nlohmann::json::exception& e) {
    throw Error("motion", std::string("is not JSON: ") + e.what());
  }
  ParameterSet set;
  if (!object.is_object() || !object.contains("unit") || !object["unit"].is_string() || !object.contains("T_s") ||
      !object["T_s"].is_number())
    throw Error("motion", "lacks its unit or its duration, expected those of a reply");
  set.name = object["unit"].get<std::string>();
  set.values.push_back({"T", object["T_s"].get<double>(), "s", ""});
  for (const char* name : {"q_start", "q_end", "c_r"}) {
    for (const std::string& member : {std::string(name), std::string(name) + "_rad"}) {
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
