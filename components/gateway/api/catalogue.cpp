#include "components/gateway/api/catalogue.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "components/services/json/control/control.h"
#include "components/services/json/json.h"

namespace cotwin::gateway {

const std::vector<ServiceInfo>& all_services() {
  static const std::vector<ServiceInfo> kAll = [] {
    std::vector<ServiceInfo> all;
    for (const std::string& name : services::service_names()) {
      const auto schema = nlohmann::ordered_json::parse(services::schema(name));
      const bool is_long = name == "optimise" || name == "verify" || name == "reactionless" || name == "grow";
      all.push_back({name, schema.at("description"), is_long, schema.at("request").dump(), schema.at("reply").dump()});
    }
    return all;
  }();
  return kAll;
}

bool is_long(const nlohmann::ordered_json& request) {
  if (services::is_chain(request)) return std::ranges::any_of(request["steps"], is_long);
  const auto name = request.find("service");
  return name != request.end() &&
         std::ranges::any_of(all_services(), [&](const ServiceInfo& s) { return s.is_long && *name == s.name; });
}

}  // namespace cotwin::gateway
