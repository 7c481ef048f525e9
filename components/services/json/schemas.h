#pragma once
#include <nlohmann/json.hpp>
#include <string>

namespace cotwin::services {

/// The JSON Schema (2020-12) of the reply of a service, one of service_names().
nlohmann::ordered_json reply_schema(const std::string& service);

}  // namespace cotwin::services
