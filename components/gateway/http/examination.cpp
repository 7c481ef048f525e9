// What a request must be before a handler gets it.
#include <algorithm>

#include "components/gateway/http/connection.h"
#include "models/foundation/support/text.h"

namespace cotwin::gateway::http {

/// Target, Host and Origin.
std::optional<Response> Connection::check_names(Request& request) {
  std::string authority;
  if (const std::string wrong =
          read_target({parser_->get().target().data(), parser_->get().target().size()}, request, authority);
      !wrong.empty() && request.method != "OPTIONS") {
    return refusal(400, wrong);
  }
  std::size_t hosts = 0;
  for (const Field& f : request.fields) hosts += equal_names(f.name, "Host") ? 1 : 0;
  if (hosts != 1) return refusal(400, "the header has " + std::to_string(hosts) + " fields Host, expected one");
  if (authority.empty()) authority = *request.field("Host");
  if (!server_.options.authority.allows_host(authority) || !server_.options.authority.allows_host(*request.field("Host")))
    return refusal(421,
                   "the host of the request is not one of this gateway's names, expected localhost, an address at which it "
                   "listens, or a name of cotwin serve --host (parameter hosts of unit:gateway)");
  const std::string* const origin = request.field("Origin");
  if (origin == nullptr) return std::nullopt;
  switch (server_.options.authority.check_origin(*origin, server_.tls ? "https" : "http", authority)) {
    case access::Authority::Origin::kOwn:
      return std::nullopt;
    case access::Authority::Origin::kNamed:
      allowed_origin_ = *origin;
      return std::nullopt;
    default:
      return refusal(403,
                     "pages of this origin may not call the gateway, expected one of cotwin serve --origin (parameter origins "
                     "of unit:gateway)");
  }
}

/// The question of a browser whether a page of another origin may send a request.
Response Connection::preflight(const Request& request) const {
  if (allowed_origin_.empty() || request.field("Access-Control-Request-Method") == nullptr)
    return refusal(405,
                   "OPTIONS is answered only for pages of the named origins, expected one of cotwin serve --origin (parameter "
                   "origins of unit:gateway)");
  Response response;
  response.status = 204;
  response.type = "";
  response.fields = {{"Access-Control-Allow-Methods", "GET, HEAD, POST, PUT, DELETE"},
                     {"Access-Control-Allow-Headers",
                      "Authorization, Content-Type, Idempotency-Key, If-Match, If-None-Match, Last-Event-ID, Prefer"},
                     {"Access-Control-Max-Age", "600"}};
  return response;
}

std::optional<Response> Connection::check_route(Request& request) {
  if (parser_->get().method() == bhttp::verb::unknown) return refusal(501, "the method is not known");
  auto found = server_.router.find(request);
  if (const auto* const refused = std::get_if<Refusal>(&found)) return to_response(refused->problem, refused->fields);
  entry_ = std::get<const Router::Entry*>(found);
  const std::string& gives = entry_->route.gives;
  const bool upgrade = beast::websocket::is_upgrade(parser_->get());
  if (gives == "text/event-stream" && upgrade) {
    request.upgrade = true;
    return std::nullopt;
  }
  if (gives == "websocket") {
    request.upgrade = upgrade;
    if (!request.upgrade) return refusal(426, "expected a WebSocket handshake", {{"Upgrade", "websocket"}});
    return std::nullopt;
  }
  const std::string* const accept = request.field("Accept");
  if (accept != nullptr && !gives.empty() && !accepts(*accept, gives))
    return refusal(406, "the response is " + gives + ", which the field Accept does not allow");
  return std::nullopt;
}

/// What a client may do without a token.
std::optional<Response> Connection::check_local_user(Request& request) {
  if (!local_user_) local_user_ = server_.find_local_user(stream_.next_layer());
  request.by = local_user_->name;
  request.scopes = local_user_->scopes;
  if (request.scopes.any_of(entry_->route.scope)) return std::nullopt;
  return refusal(
      403,
      "only the user who runs this gateway, and root, may do this, and this connection is of " + local_user_->name +
          ", expected another user, tokens, or all local users by --local-writes=all (parameter local_writes of unit:gateway)");
}

std::optional<Response> Connection::check_access(Request& request) {
  const Route& route = entry_->route;
  request.owner = owner_;
  ErrorCode gone;
  const tcp::endpoint peer = stream_.next_layer().remote_endpoint(gone);
  request.address = gone ? address : peer.address().to_string();
  request.audit = server_.options.audit;
  if (route.scope.empty()) return std::nullopt;
  if (server_.options.token_file.empty()) return check_local_user(request);
  std::size_t fields = 0;
  for (const Field& f : request.fields) fields += equal_names(f.name, "Authorization") ? 1 : 0;
  if (fields > 1) return refusal(400, "the header has more than one field Authorization");
  const std::string* const authorization = request.field("Authorization");
  const std::string* const ticket = route.ticket ? request.query_value("ticket") : nullptr;
  constexpr std::string_view kBearer = "Bearer ";
  if (authorization != nullptr) {
    const std::string_view value = *authorization;
    if (value.size() > kBearer.size() && equal_names(value.substr(0, kBearer.size()), kBearer))
      request.bearer = access::digest_of(value.substr(kBearer.size()));
  } else if (ticket != nullptr) {
    request.bearer = server_.options.tickets->redeem(*ticket, std::chrono::steady_clock::now());
  } else {
    return refusal(401, "expected a token: Authorization: Bearer TOKEN", {{"WWW-Authenticate", "Bearer"}});
  }
  const bool is_ticket = authorization == nullptr;
  // Secrets are needed no longer, and must not reach a log or a handler.
  std::erase_if(request.fields, [](const Field& f) { return equal_names(f.name, "Authorization"); });
  std::erase_if(request.query, [](const auto& pair) { return pair.first == "ticket"; });
  const access::Bearer* const found = request.bearer ? server_.find_bearer(*request.bearer) : nullptr;
  if (found == nullptr) {
    request.bearer.reset();
    late_answer_ = server_.note_wrong_token(address);
    return refusal(401,
                   is_ticket ? "the ticket is not valid: used, expired or unknown" : "the token is not one of the gateway's",
                   {{"WWW-Authenticate", "Bearer error=\"invalid_token\""}});
  }
  bearer = request.bearer;
  request.scopes = found->scopes;
  request.by = found->name;
  request.client = found->client;
  request.owner = "token " + found->client;
  if (!request.scopes.any_of(route.scope))
    return refusal(403, "the token has the scopes " + request.scopes.words(", ") + ", expected " + route.scope.words(" or "),
                   {{"WWW-Authenticate", "Bearer error=\"insufficient_scope\", scope=\"" + route.scope.words(" ") + "\""}});
  return std::nullopt;
}

/// A name that the route does not read, as one that is misspelt, would be ignored in silence.
std::optional<Response> Connection::check_query(const Request& request) {
  const Route& route = entry_->route;
  for (auto pair = request.query.begin(); pair != request.query.end(); ++pair) {
    const std::string& name = pair->first;
    const auto is_it = [&](const auto& other) { return other.first == name; };
    if (std::any_of(request.query.begin(), pair, is_it))
      return refusal(400, "the query has '" + name.substr(0, 40) + "' twice");
    std::string known = route.ticket ? "ticket" : "";
    bool found = route.ticket && name == "ticket";
    for (const Parameter& p : route.parameters) {
      if (p.in != "query") continue;
      found = found || p.name == name;
      text::append(known, p.name);
    }
    if (!found)
      return refusal(400, "the query has '" + name.substr(0, 40) + "', expected " + (known.empty() ? "no query" : known));
  }
  return std::nullopt;
}

std::optional<Response> Connection::check_body(const Request& request) {
  const bool body = !parser_->is_done() && (parser_->chunked() || parser_->content_length().value_or(0) > 0);
  const std::string& takes = entry_->route.takes;
  if (takes.empty()) {
    if (body) return refusal(415, request.method + " " + request.path + " takes no body");
    return std::nullopt;
  }
  const std::string* const type = request.field("Content-Type");
  if (type == nullptr || media_type(*type) != "application/json")
    return refusal(415, "expected a body with Content-Type: application/json");
  if (const std::string* const coding = request.field("Content-Encoding");
      coding != nullptr && !equal_names(*coding, "identity"))
    return refusal(415, "a body with Content-Encoding is not accepted");
  return std::nullopt;
}

}  // namespace cotwin::gateway::http
