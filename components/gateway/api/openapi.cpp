#include <nlohmann/json.hpp>

#include "components/gateway/api/api.h"

namespace cotwin::gateway {

namespace {

using Json = nlohmann::ordered_json;

Json reference(const std::string& schema) { return {{"$ref", "#/components/schemas/" + schema}}; }

Json content(const std::string& type, const std::string& schema) { return {{type, {{"schema", reference(schema)}}}}; }

Json parameters_of(const http::Router::Entry& entry) {
  Json all = Json::array();
  for (const std::string& name : entry.names)
    all.push_back({{"name", name}, {"in", "path"}, {"required", true}, {"schema", {{"type", "string"}}}});
  for (const http::Parameter& p : entry.route.parameters) {
    all.push_back({{"name", p.name},
                   {"in", p.in},
                   {"description", p.description},
                   {"required", p.required},
                   {"schema", Json::parse(p.schema)}});
  }
  return all;
}

Json answers_of(const http::Route& route) {
  Json all = Json::object();
  for (const http::Answer& answer : route.answers) {
    Json& one = all[std::to_string(answer.status)];
    one["description"] = answer.description;
    if (!answer.schema.empty()) one["content"] = content(answer.type, answer.schema);
  }
  if (all.empty()) all["200"] = {{"description", route.summary.empty() ? "Done" : route.summary}};
  all["default"] = {{"description", "A problem: what is wrong and what was expected (RFC 9457)"},
                    {"content", content("application/problem+json", "Problem")}};
  return all;
}

Json operation_of(const http::Router::Entry& entry) {
  const http::Route& route = entry.route;
  Json operation;
  operation["operationId"] = route.id;
  if (!route.summary.empty()) operation["summary"] = route.summary;
  operation["tags"] = Json::array({route.tag});
  if (Json parameters = parameters_of(entry); !parameters.empty()) operation["parameters"] = std::move(parameters);
  if (!route.takes.empty())
    operation["requestBody"] = {{"required", true}, {"content", content("application/json", route.takes)}};
  operation["responses"] = answers_of(route);
  Json security = Json::array();
  if (route.scope != http::Scope::kNone) {
    security.push_back({{"token", Json::array()}});
    if (route.ticket) security.push_back({{"ticket", Json::array()}});
    security.push_back(Json::object());  // at loopback addresses without a file of tokens
  }
  operation["security"] = std::move(security);
  operation["x-scope"] = route.scope == http::Scope::kNone ? "none" : route.scope == http::Scope::kRead ? "read" : "operate";
  return operation;
}

std::string lower(std::string text) {
  for (char& c : text) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return text;
}

}  // namespace

std::string openapi(const http::Router& router, const std::string& version) {
  Json document;
  document["openapi"] = "3.1.1";
  document["info"] = {
      {"title", "Cotwin gateway"},
      {"version", version},
      {"summary", "Services of a robot twin: feasibility, time and energy of motions, better motions, jobs, live signals"},
      {"license", {{"name", "Apache License 2.0"}, {"identifier", "Apache-2.0"}}}};
  document["jsonSchemaDialect"] = "https://spec.openapis.org/oas/3.1/dialect/base";
  document["servers"] = Json::array({{{"url", "/"}}});
  Json& paths = document["paths"] = Json::object();
  for (const http::Router::Entry& entry : router.entries())
    paths[entry.route.pattern][lower(entry.route.method)] = operation_of(entry);
  Json schemas = Json::object();
  for (const auto& [name, schema] : router.schemas()) schemas[name] = Json::parse(schema);
  document["components"] = {
      {"schemas", std::move(schemas)},
      {"securitySchemes",
       {{"token",
         {{"type", "http"}, {"scheme", "bearer"}, {"description", "A token of the gateway's file; scopes read and operate"}}},
        {"ticket",
         {{"type", "apiKey"},
          {"in", "query"},
          {"name", "ticket"},
          {"description", "A ticket of POST /tickets, used once, for browsers"}}}}}};
  return document.dump(2) + "\n";
}

}  // namespace cotwin::gateway
