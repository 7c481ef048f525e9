#pragma once
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace cotwin::gateway {

/// A service that can be asked.
struct ServiceInfo {
  std::string name, summary;
  bool is_long = false;                      // answered by a job
  std::string request_schema, reply_schema;  // JSON Schema 2020-12
};

/// Those of components/services.
const std::vector<ServiceInfo>& all_services();
/// Whether a request that names its service, or one of the steps of a chain, is for a long one.
bool is_long(const nlohmann::ordered_json& request);

}  // namespace cotwin::gateway
