#pragma once
#include <functional>
#include <string>
#include <variant>
#include <vector>

#include "components/gateway/http/message.h"
#include "components/gateway/http/problem.h"

namespace cotwin::gateway::http {

/// A status that a route answers with, for the OpenAPI document. `schema`: its name in Router::schemas(); "": no body.
struct Answer {
  int status = 200;
  std::string schema, description;
  std::string type = "application/json";
  std::vector<std::string> fields = {};  // of the header that the answer always has: "ETag"
};

/// A message of a stream. `schema`: of its data.
struct Message {
  std::string name, schema, description;
};

/// A value in the query or the header that a route reads, or a part of its path. `schema`: JSON Schema of the value as text.
struct Parameter {
  std::string name, in, description;  // in: "query", "header" or "path"
  std::string schema = R"({"type":"string"})";
  bool required = false;
};

struct Route {
  std::string method;   // GET, POST, PUT, DELETE
  std::string pattern;  // "/job-orders/{id}/commands"
  std::string id;       // operationId of the OpenAPI document; "": from method and pattern
  std::string summary, tag = "gateway";
  Scopes scope = Scope::kRead;  // of which a token must have one; empty: it needs no token
  std::string takes;            // schema of the request's body, which must be application/json; "": no body
  /// Media type of a success; "": no body. "text/event-stream": also over a WebSocket, if the client asks for the upgrade;
  /// "websocket": only over one.
  std::string gives = "application/json";
  std::vector<Answer> answers;    // those that are no problems, and problems that only this route has
  std::vector<Message> messages;  // of a stream
  std::vector<Parameter> parameters;
  bool slow = false;    // the handler runs on a thread of the pool, not on that of the sockets
  bool ticket = false;  // a ticket in the query (?ticket=…) is enough instead of a token

  /// Whether it changes something: then it is written who asked.
  bool changes() const { return scope.any_of(Scopes::changing()); }
};

/// An answer that is a problem (RFC 9457).
Answer problem_answer(int status, std::string description);

/// Answers at once. May throw Refusal; an Error becomes status 422, anything else 500.
using Handler = std::function<Response(const Request&)>;
/// Answers by a call of the reply, perhaps later and from another thread.
using LaterHandler = std::function<void(const Request&, const Reply&)>;

/// The table of routes. Complete before the server starts, constant afterwards.
class Router {
 public:
  struct Entry {
    Route route;
    LaterHandler handler;
    std::vector<std::string> segments;  // of the pattern; "{" for a part
    std::vector<std::string> names;     // of the parts
  };

  /// Throws Error for a pattern that cannot be read, or a route that is there already.
  void add(Route route, Handler handler);
  void add_later(Route route, LaterHandler handler);
  void add(const std::string& method, const std::string& pattern, Handler handler) {
    Route route;
    route.method = method;
    route.pattern = pattern;
    add(std::move(route), std::move(handler));
  }

  /// The route of a request, whose parts are written into `request.matched`; else a refusal, 404 or 405. HEAD is GET.
  std::variant<const Entry*, Refusal> find(Request& request) const;
  const std::vector<Entry>& entries() const { return entries_; }

  /// JSON Schemas by name, as text, to which routes and other schemas ("$ref": "#/components/schemas/…") refer. Throws Error for a name
  /// that is there already.
  void add_schema(const std::string& name, const std::string& schema);
  const std::vector<std::pair<std::string, std::string>>& schemas() const { return schemas_; }

 private:
  std::vector<Entry> entries_;
  std::vector<std::pair<std::string, std::string>> schemas_;
};

}  // namespace cotwin::gateway::http
