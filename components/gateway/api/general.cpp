// What every gateway has: health, its description, tickets.
#include <memory>
#include <mutex>

#include "components/gateway/api/api.h"
#include "components/gateway/api/json_tools.h"

namespace cotwin::gateway {

namespace {

using http::Request;
using http::Response;

}  // namespace

void add_common_schemas(http::Router& router) {
  router.add_schema("Problem", R"({
    "type": "object", "description": "RFC 9457",
    "properties": {
      "type": {"type": "string", "format": "uri-reference"}, "title": {"type": "string"}, "status": {"type": "integer"},
      "detail": {"type": "string", "description": "Place, fact and expectation"},
      "pointer": {"type": "string", "format": "json-pointer", "description": "Member of the request's body that is wrong"},
      "ReturnStatus": {"type": "string", "pattern": "^[0-9]+$", "description": "Of job control (OPC 10031-4): a set of 64 bits as a decimal number"},
      "JobOrderID": {"type": "string", "description": "The job order that is meant"}},
    "required": ["type", "title", "status"]})");
  router.add_schema("Nothing",
                    R"({"type": "object", "description": "An object without members", "additionalProperties": false})");
  router.add_schema("Health", R"({
    "type": "object", "properties": {"status": {"const": "ok"}, "version": {"type": "string"}}, "required": ["status", "version"], "additionalProperties": false})");
  router.add_schema("Ticket", R"({
    "type": "object",
    "properties": {"ticket": {"type": "string"}, "expires_s": {"type": "integer", "description": "Lifetime"}},
    "required": ["ticket", "expires_s"], "additionalProperties": false})");
  router.add_schema("OpenApi", R"({
    "type": "object", "properties": {"openapi": {"type": "string"}, "info": {"type": "object"}, "paths": {"type": "object"}},
    "required": ["openapi", "info", "paths"]})");
}

void add_general_routes(http::Router& router, std::shared_ptr<access::Tickets> tickets, const std::string& version) {
  add_common_schemas(router);

  http::Route health;
  health.method = "GET";
  health.pattern = "/health";
  health.id = "health";
  health.summary = "Whether the gateway is there";
  health.scope = {};
  health.answers = {{200, "Health", "It is"}};
  router.add(health, [version](const Request&) { return give({{"status", "ok"}, {"version", version}}); });

  http::Route description;
  description.method = "GET";
  description.pattern = "/openapi.json";
  description.id = "openapi";
  description.summary = "This description, OpenAPI 3.1";
  description.scope = {};
  description.answers = {{200, "OpenApi", "The document"}};
  struct Once {
    std::once_flag flag;
    std::string text;
  };
  router.add(description, [&router, version, once = std::make_shared<Once>()](const Request&) {
    std::call_once(once->flag, [&] { once->text = openapi(router, version); });
    Response response;
    response.body = once->text;
    return response;
  });

  http::Route ticket;
  ticket.method = "POST";
  ticket.pattern = "/tickets";
  ticket.id = "makeTicket";
  ticket.summary = "A ticket for one event stream or WebSocket, for browsers: they cannot send a token there";
  ticket.answers = {{201, "Ticket", "Use it once, as ?ticket=…"}};
  router.add(ticket, [tickets = std::move(tickets)](const Request& request) {
    const std::string made =
        tickets->issue(request.bearer.value_or(access::Digest{}), request.owner, std::chrono::steady_clock::now());
    if (made.empty()) throw http::Refusal{{503, "too many tickets are not used yet", "", ""}, {{"Retry-After", "30"}}};
    return give({{"ticket", made}, {"expires_s", access::Tickets::kLife.count()}}, 201);
  });
}

}  // namespace cotwin::gateway
