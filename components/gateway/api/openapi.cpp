#include <algorithm>
#include <nlohmann/json.hpp>

#include "components/gateway/api/api.h"

namespace cotwin::gateway {

namespace {

using Json = nlohmann::ordered_json;

Json reference(const std::string& schema) { return {{"$ref", "#/components/schemas/" + schema}}; }

Json content(const std::string& type, const std::string& schema) { return {{type, {{"schema", reference(schema)}}}}; }

Json parameters_of(const http::Router::Entry& entry) {
  Json all = Json::array();
  const std::vector<http::Parameter>& given = entry.route.parameters;
  for (const std::string& name : entry.names) {
    const auto own = std::find_if(given.begin(), given.end(), [&](const auto& p) { return p.in == "path" && p.name == name; });
    Json part{{"name", name}, {"in", "path"}, {"required", true}};
    if (own != given.end()) part["description"] = own->description;
    part["schema"] = own != given.end() ? Json::parse(own->schema) : Json{{"type", "string"}};
    all.push_back(std::move(part));
  }
  for (const http::Parameter& p : given) {
    if (p.in == "path") continue;
    all.push_back({{"name", p.name},
                   {"in", p.in},
                   {"description", p.description},
                   {"required", p.required},
                   {"schema", Json::parse(p.schema)}});
  }
  return all;
}

Json headers_of(const std::vector<std::string>& names) {
  Json all = Json::object();
  for (const std::string& name : names) all[name] = {{"required", true}, {"schema", {{"type", "string"}}}};
  return all;
}

/// The events of a stream, by name: {"job": {"description", "schema"}}.
Json messages_of(const http::Route& route) {
  Json all = Json::object();
  for (const http::Message& m : route.messages) all[m.name] = {{"description", m.description}, {"schema", reference(m.schema)}};
  return all;
}

/// OpenAPI 3.1 has no schema for the events of a stream: their names and schemas are in the extension x-messages.
Json stream_content(const http::Route& route) {
  return {{"text/event-stream",
           {{"schema", {{"type", "string"}, {"description", "Server-sent events (HTML Living Standard, 9.2)"}}},
            {"x-messages", messages_of(route)}}}};
}

/// The problems that every route of this kind can answer with.
std::vector<http::Answer> general_problems(const http::Router::Entry& entry) {
  const http::Route& route = entry.route;
  std::vector<http::Answer> all = {
      http::problem_answer(400, "The query, the header or the body cannot be read, or has an unknown or repeated name")};
  const auto add = [&](int status, const char* description) { all.push_back(http::problem_answer(status, description)); };
  const bool closed = !route.scope.empty();
  if (closed) add(401, "The gateway has tokens, and the request has none of them");
  if (route.changes()) add(403, "The token, or the local user, may not do this");
  if (!entry.names.empty()) add(404, "There is no such thing");
  if (!route.gives.empty()) add(406, "The field Accept does not admit the answer");
  if (!route.takes.empty()) {
    add(413, "The body is too long");
    add(415, "The body is not application/json, or is encoded");
    add(422, "A member is missing, unknown or out of range: pointer names it");
  } else {
    add(415, "The request has a body");
  }
  add(429, "This client has too many requests or connections: Retry-After");
  add(503, "No room for the request, or no answer in time: Retry-After");
  return all;
}

Json answers_of(const http::Router::Entry& entry) {
  const http::Route& route = entry.route;
  Json all = Json::object();
  const auto add = [&](const http::Answer& answer) {
    Json& one = all[std::to_string(answer.status)];
    one["description"] = answer.description;
    std::vector<std::string> fields = answer.fields;
    if (answer.status == 429 || answer.status == 503) fields.push_back("Retry-After");
    if (answer.status == 401) fields.push_back("WWW-Authenticate");
    if (!fields.empty()) one["headers"] = headers_of(fields);
    if (answer.type == "text/event-stream") {
      one["content"] = stream_content(route);
    } else if (!answer.schema.empty()) {
      one["content"] = content(answer.type, answer.schema);
    }
  };
  for (const http::Answer& answer : route.answers) add(answer);
  if (route.gives == "text/event-stream") {
    all["101"] = {{"description",
                   "With the handshake of a WebSocket (RFC 6455): each message is {\"event\": name, \"id\": text, \"data\": …} "
                   "with the names and data of x-messages"}};
  }
  for (const http::Answer& answer : general_problems(entry)) {
    if (!all.contains(std::to_string(answer.status))) add(answer);
  }
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
  operation["responses"] = answers_of(entry);
  Json security = Json::array();
  Json scopes = Json::array();  // any of them is enough
  for (const auto& [word, scope] : access::kScopeWords) {
    if (route.scope.has(scope)) scopes.push_back(word);
  }
  if (!route.scope.empty()) {
    for (const Json& scope : scopes) security.push_back({{"token", Json::array({scope})}});
    if (route.ticket) security.push_back({{"ticket", Json::array()}});
    security.push_back(Json::object());  // at loopback addresses without a file of tokens
  }
  operation["security"] = std::move(security);
  operation["x-scopes"] = std::move(scopes);
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
  document["components"] = {{"schemas", std::move(schemas)},
                            {"securitySchemes",
                             {{"token",
                               {{"type", "http"},
                                {"scheme", "bearer"},
                                {"description",
                                 "A token of the gateway's file, with one of the scopes of the operation (x-scopes): read, "
                                 "jobs, tune, acknowledge, end"}}},
                              {"ticket",
                               {{"type", "apiKey"},
                                {"in", "query"},
                                {"name", "ticket"},
                                {"description", "A ticket of POST /tickets, used once, for browsers"}}}}}};
  return document.dump(2) + "\n";
}

}  // namespace cotwin::gateway
