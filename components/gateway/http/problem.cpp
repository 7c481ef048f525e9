#include "components/gateway/http/problem.h"

#include <nlohmann/json.hpp>

namespace cotwin::gateway::http {

Response to_response(const Problem& problem, std::vector<Field> fields) {
  nlohmann::ordered_json j;
  j["type"] = "about:blank";
  j["title"] = problem.title.empty() ? std::string(reason_of(problem.status)) : problem.title;
  j["status"] = problem.status;
  if (!problem.detail.empty()) j["detail"] = problem.detail;
  if (!problem.pointer.empty()) j["pointer"] = problem.pointer;
  for (const auto& [name, value] : problem.members) j[name] = value;
  Response response;
  response.status = problem.status;
  response.type = "application/problem+json";
  response.body = j.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  response.fields = std::move(fields);
  return response;
}

}  // namespace cotwin::gateway::http
