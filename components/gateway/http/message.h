#pragma once
#include <cstddef>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "components/gateway/access/access.h"
#include "components/gateway/access/audit.h"

/// HTTP/1.1 as the gateway uses it: requests and responses as plain values, without sockets.
namespace cotwin::gateway::http {

using access::Scope;
using access::Scopes;

struct Field {
  std::string name, value;
};

/// Bytes. Bodies of more are not read side by side, so that many of them leave processors and threads to others.
inline constexpr std::size_t kLongBody = 16 << 10;

struct Request {
  std::string method;                                        // "GET"
  std::string path;                                          // as sent, without the query
  std::vector<std::string> segments;                         // of the path, decoded
  std::vector<std::pair<std::string, std::string>> query;    // decoded
  std::vector<std::pair<std::string, std::string>> matched;  // name and value of each {name} of the route's pattern
  std::vector<Field> fields;                                 // of the header
  std::string body;
  Scopes scopes;                         // granted
  std::optional<access::Digest> bearer;  // its token, if there was one
  std::string client;                    // part of the hash of its token; "" without one
  std::string by;                        // who asks, for logs: the name of the token, "local user 1000"
  std::string address;                   // of the client
  std::string owner;  // whose fair share it takes: a token, else an address, at the loopback address a connection
  std::shared_ptr<access::Audit> audit;  // where it is written who changed what; nullptr: nowhere
  bool upgrade = false;                  // to a WebSocket

  /// The first header field of that name, in any case; nullptr: none.
  const std::string* field(std::string_view name) const;
  /// The value of {name} in the route's pattern, which has it.
  const std::string& part(std::string_view name) const;
  /// The first value of that name in the query; nullptr: none.
  const std::string* query_value(std::string_view name) const;
};

class Stream;

struct Response {
  int status = 200;
  std::string body;
  std::string type = "application/json";  // "": no body
  std::vector<Field> fields;
  /// If set: the response is a stream of server-sent events, or the WebSocket that the request asks for. Called once on the server's
  /// thread when messages can be sent.
  std::function<void(const std::shared_ptr<Stream>&)> stream;
};

/// Sends the response to a request; from any thread, once. A reply that is dropped without a call sends status 500.
using Reply = std::function<void(Response)>;

/// Whether two names of header fields are equal: ASCII without case.
bool equal_names(std::string_view a, std::string_view b);
/// "Not Found" …; "" for a number without a name here.
std::string_view reason_of(int status);

/// Decodes %-escapes. Nothing for an incomplete escape, a control character or, with `segment`, a slash or backslash.
std::optional<std::string> decode(std::string_view text, bool segment);
/// Splits the target of a request, "/a/b%20c?x=1", into path, segments and query. Accepts the absolute form, "http://host/a"; `host` is
/// then its authority, else "". Returns "" or what is wrong.
std::string read_target(std::string_view target, Request& request, std::string& host);
/// Escapes what is not allowed in a segment of a path.
std::string encode_segment(std::string_view text);

/// Whether the value of an Accept field admits the media type, for example "application/json".
bool accepts(std::string_view accept, std::string_view type);
/// The media type without parameters, in lower case: "application/json; charset=utf-8" → "application/json".
std::string media_type(std::string_view content_type);
/// The value of a token in a list as Prefer's "respond-async, wait=5": "" without a value; nothing if the token is not there.
std::optional<std::string> preference(std::string_view prefer, std::string_view token);

}  // namespace cotwin::gateway::http
