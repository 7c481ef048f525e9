// One HTTP connection: request after request, or a stream of server-sent events at last.
#include <algorithm>
#include <array>
#include <boost/asio/write.hpp>

#include "components/gateway/http/server_impl.h"

namespace cotwin::gateway::http {

namespace {

namespace bhttp = beast::http;

constexpr std::size_t kRead = 4096, kLongestTarget = 4096;
constexpr std::size_t kMostDrained = 1 << 20;  // bytes that are read after a refusal, so that the client sees it
constexpr double kDrain = 2;                   // s
constexpr unsigned char kTlsHandshake = 0x16;

Response refusal(int status, std::string detail, std::vector<Field> fields = {}) {
  return to_response({status, std::move(detail), "", ""}, std::move(fields));
}

/// Part of a token's hash: enough to tell clients apart, and no secret.
std::string short_name(std::string_view token) {
  static const char* const kDigits = "0123456789abcdef";
  const Digest digest = digest_of(token);
  std::string name;
  for (std::size_t i = 0; i < 8; ++i) {
    name += kDigits[digest[i] >> 4];
    name += kDigits[digest[i] & 15];
  }
  return name;
}

std::string field_value(std::string value) {
  for (char& c : value) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return value;
}

class Connection final : public Client, public std::enable_shared_from_this<Connection> {
 public:
  Connection(Server::Impl& server, tcp::socket socket, std::unique_ptr<Seat> seat, std::string party)
      : server_(server),
        seat_(std::move(seat)),
        party_(std::move(party)),
        limits_(server.options.limits),
        stream_(std::move(socket), server.tls ? &*server.tls : nullptr),
        timer_(server.context),
        buffer_(limits_.header_bytes + (64 << 10)) {
    ++server_.counts.open;
  }
  ~Connection() override { --server_.counts.open; }

  void start() { server_.tls ? expect_tls() : read(); }
  /// Sends a refusal to a client for which there is no room.
  void turn_away(Response refusal) {
    turned_away_ = true;
    ++server_.refusing;
    respond(std::move(refusal));
  }
  void abort() override { finish(); }
  void respond(Response response);

 private:
  using Parser = bhttp::request_parser<bhttp::string_body>;

  /// A request that a handler answers. Carries the response to the server's thread, where alone connections live.
  struct Pending {
    std::shared_ptr<Gate> gate;
    std::weak_ptr<Connection> connection;
    std::atomic<bool> done = false;

    void send(Response response);
    ~Pending();
  };

  // Deadlines. The socket's operations end when it is cancelled; then late_ says why.
  void arm(double seconds);
  void disarm() {
    late_ = false;
    ++armed_;
    timer_.cancel();
  }

  void expect_tls();
  void read();
  void read_header();
  void examine();
  void read_body();
  void dispatch();
  std::optional<Response> check_names(Request& request);
  std::optional<Response> check_route(Request& request);
  std::optional<Response> check_access(Request& request);
  std::optional<Response> check_query(const Request& request);
  std::optional<Response> check_body(const Request& request);
  Response preflight(const Request& request) const;
  Response failure(const ErrorCode& error) const;
  /// A response without having read the body.
  void refuse(Response response);
  std::string head_of(const Response& response) const;

  /// The handler has not answered in time.
  void answer_late();
  void begin_stream(Response response);
  void watch();
  void pump();

  void close_in_order();
  void end_of_sending();
  /// Discards what arrives, encrypted or not.
  void drain();
  void finish();

  Server::Impl& server_;
  std::unique_ptr<Seat> seat_;
  const std::string party_;
  const Limits& limits_;
  AnyStream stream_;
  asio::steady_timer timer_;
  std::uint64_t armed_ = 0;
  bool late_ = false;
  beast::flat_buffer buffer_;
  std::optional<Parser> parser_;
  std::shared_ptr<Request> request_;
  const Router::Entry* entry_ = nullptr;
  std::string allowed_origin_;  // of the present request; "": none that must be named in the response
  std::string out_;
  std::weak_ptr<Pending> pending_;  // of the request that waits for its handler
  bool waiting_ = false;
  bool keep_ = false, head_ = false, finished_ = false, turned_away_ = false;
  std::array<unsigned char, 1024> scrap_{};
  std::size_t drained_ = 0;
  std::shared_ptr<Channel> channel_;
  bool writing_ = false;
};

void Connection::arm(double seconds) {
  late_ = false;
  const std::uint64_t number = ++armed_;
  timer_.expires_after(std::chrono::duration_cast<std::chrono::steady_clock::duration>(std::chrono::duration<double>(seconds)));
  timer_.async_wait([self = shared_from_this(), number](const ErrorCode& error) {
    if (error || number != self->armed_) return;
    if (self->waiting_) return self->answer_late();
    if (self->channel_ && !self->writing_) {
      self->channel_->send({"heartbeat", "", "{}"});
      self->pump();
      return;
    }
    self->late_ = true;
    ErrorCode none;
    self->stream_.next_layer().cancel(none);
  });
}

// A client that speaks HTTP to a port for TLS is told so.
void Connection::expect_tls() {
  arm(limits_.handshake);
  stream_.next_layer().async_read_some(
      asio::buffer(scrap_), [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
        if (error || n == 0) return self->finish();
        if (self->scrap_[0] != kTlsHandshake) {
          self->stream_.drop_tls();
          ++self->server_.counts.requests;
          self->keep_ = false;
          return self->respond(refusal(400, "this port expects TLS: https://"));
        }
        self->stream_.tls().async_handshake(
            asio::ssl::stream_base::server, asio::buffer(self->scrap_.data(), n),
            [self](const ErrorCode& failed, std::size_t) { failed ? self->finish() : self->read(); });
      });
}

void Connection::read() {
  parser_.emplace();
  parser_->header_limit(static_cast<std::uint32_t>(limits_.header_bytes));
  parser_->body_limit(limits_.body_bytes);
  request_ = std::make_shared<Request>();
  entry_ = nullptr;
  allowed_origin_.clear();
  head_ = false;
  if (buffer_.size() > 0) return read_header();
  buffer_.shrink_to_fit();
  arm(limits_.idle);
  stream_.async_read_some(buffer_.prepare(kRead), [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
    if (error) return self->late_ ? self->close_in_order() : self->finish();
    self->buffer_.commit(n);
    self->read_header();
  });
}

void Connection::read_header() {
  arm(limits_.request);
  bhttp::async_read_header(stream_, buffer_, *parser_, [self = shared_from_this()](const ErrorCode& error, std::size_t) {
    if (error == bhttp::error::end_of_stream) return self->finish();
    if (error &&
        (error.category() == asio::error::get_system_category() || error.category() == asio::error::get_ssl_category()) &&
        !self->late_)
      return self->finish();
    if (error) return self->refuse(self->failure(error));
    self->examine();
  });
}

Response Connection::failure(const ErrorCode& error) const {
  const auto kib = [](std::size_t bytes) { return std::to_string(bytes >> 10) + " KiB"; };
  if (late_)
    return refusal(408, "the request was not complete within " + std::to_string(static_cast<int>(limits_.request)) + " s");
  if (error == bhttp::error::header_limit || error == bhttp::error::buffer_overflow)
    return refusal(431, "the header is longer than " + kib(limits_.header_bytes));
  if (error == bhttp::error::body_limit) return refusal(413, "the body is longer than " + kib(limits_.body_bytes));
  if (error == bhttp::error::bad_version) return refusal(505, "not HTTP/1.1");
  return refusal(400, "the request is not HTTP/1.1: " + error.message());
}

void Connection::examine() {
  const auto& message = parser_->get();
  keep_ = message.keep_alive();
  head_ = message.method() == bhttp::verb::head;
  if (message.version() != 11) return refuse(refusal(505, "the request is not HTTP/1.1"));
  if (message.target().size() > kLongestTarget)
    return refuse(refusal(414, "the target is longer than " + std::to_string(kLongestTarget) + " characters"));
  Request& request = *request_;
  request.method = std::string(message.method_string());
  for (const auto& f : message) request.fields.push_back({std::string(f.name_string()), std::string(f.value())});
  if (auto wrong = check_names(request)) return refuse(std::move(*wrong));
  if (request.method == "OPTIONS") return refuse(preflight(request));
  if (auto wrong = check_route(request)) return refuse(std::move(*wrong));
  if (auto wrong = check_access(request)) return refuse(std::move(*wrong));
  if (auto wrong = check_query(request)) return refuse(std::move(*wrong));
  if (auto wrong = check_body(request)) return refuse(std::move(*wrong));
  if (message[bhttp::field::expect].empty() || parser_->is_done()) return read_body();
  if (!beast::iequals(message[bhttp::field::expect], "100-continue"))
    return refuse(refusal(417, "the only expectation that is met is 100-continue"));
  out_ = "HTTP/1.1 100 Continue\r\n\r\n";
  asio::async_write(stream_, asio::buffer(out_), [self = shared_from_this()](const ErrorCode& error, std::size_t) {
    error ? self->finish() : self->read_body();
  });
}

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
    case Authority::Origin::kOwn:
      return std::nullopt;
    case Authority::Origin::kNamed:
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

std::optional<Response> Connection::check_access(Request& request) {
  const Route& route = entry_->route;
  const Tokens& tokens = server_.options.tokens;
  if (tokens.empty()) {
    request.scope = Scope::kOperate;
    request.party = party_;
    return std::nullopt;
  }
  request.party = party_;
  if (route.scope == Scope::kNone) return std::nullopt;
  std::size_t fields = 0;
  for (const Field& f : request.fields) fields += equal_names(f.name, "Authorization") ? 1 : 0;
  if (fields > 1) return refusal(400, "the header has more than one field Authorization");
  std::optional<Scope> granted;
  std::string client;
  const std::string* const authorization = request.field("Authorization");
  const std::string* const ticket = route.ticket ? request.query_value("ticket") : nullptr;
  constexpr std::string_view kBearer = "Bearer ";
  if (authorization != nullptr) {
    const std::string_view value = *authorization;
    if (value.size() > kBearer.size() && equal_names(value.substr(0, kBearer.size()), kBearer))
      granted = tokens.scope_of(value.substr(kBearer.size()));
    if (granted) client = short_name(value.substr(kBearer.size()));
  } else if (ticket != nullptr) {
    if (auto grant = server_.options.tickets->redeem(*ticket, std::chrono::steady_clock::now())) {
      granted = grant->scope;
      client = std::move(grant->client);
    }
  } else {
    return refusal(401, "expected a token: Authorization: Bearer TOKEN", {{"WWW-Authenticate", "Bearer"}});
  }
  // Secrets are needed no longer, and must not reach a log or a handler.
  std::erase_if(request.fields, [](const Field& f) { return equal_names(f.name, "Authorization"); });
  std::erase_if(request.query, [](const auto& pair) { return pair.first == "ticket"; });
  if (!granted) {
    return refusal(401,
                   authorization != nullptr ? "the token is not one of the gateway's"
                                            : "the ticket is not valid: used, expired or unknown",
                   {{"WWW-Authenticate", "Bearer error=\"invalid_token\""}});
  }
  request.scope = *granted;
  request.client = std::move(client);
  request.party = request.client.empty() ? party_ : "token " + request.client;
  if (static_cast<int>(*granted) < static_cast<int>(route.scope))
    return refusal(403, "the token may read only, expected one with the scope operate",
                   {{"WWW-Authenticate", "Bearer error=\"insufficient_scope\", scope=\"operate\""}});
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
      known += (known.empty() ? "" : ", ") + p.name;
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

void Connection::read_body() {
  if (request_->upgrade) {
    disarm();
    keep_ = false;
    return dispatch();
  }
  bhttp::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](const ErrorCode& error, std::size_t) {
    if (error && (error == bhttp::error::partial_message || error.category() == asio::error::get_system_category()) &&
        !self->late_)
      return self->finish();
    if (error) return self->refuse(self->failure(error));
    self->disarm();
    self->request_->body = std::move(self->parser_->get().body());
    self->dispatch();
  });
}

void Connection::Pending::send(Response response) {
  if (done.exchange(true)) return;
  gate->post([to = connection, response = std::move(response)]() mutable {
    if (const auto c = to.lock()) c->respond(std::move(response));
  });
}

Connection::Pending::~Pending() { send(refusal(500, "the request was not answered")); }

void Connection::dispatch() {
  const auto pending = std::make_shared<Pending>();
  pending->gate = server_.gate;
  pending->connection = weak_from_this();
  pending_ = pending;
  waiting_ = true;
  arm(limits_.answer);
  server_.handle(
      *entry_, request_, [pending](Response response) { pending->send(std::move(response)); },
      [watched = std::weak_ptr<Pending>(pending)] {
        const auto p = watched.lock();
        return !p || p->done || p->connection.expired();
      });
}

void Connection::answer_late() {
  const auto pending = pending_.lock();
  if (!pending || pending->done.exchange(true)) return;  // the response is on its way
  respond(refusal(503, "there was no answer within " + std::to_string(static_cast<int>(limits_.answer)) + " s",
                  {{"Retry-After", "10"}}));
}

void Connection::refuse(Response response) {
  const bool whole = parser_->is_header_done() && parser_->is_done();
  if (!whole) keep_ = false;
  respond(std::move(response));
}

std::string Connection::head_of(const Response& response) const {
  std::string head = "HTTP/1.1 " + std::to_string(response.status) + " " + std::string(reason_of(response.status)) + "\r\n";
  const auto add = [&](std::string_view name, const std::string& value) {
    head.append(name).append(": ").append(field_value(value)).append("\r\n");
  };
  for (const Field& f : response.fields) add(f.name, f.value);
  if (!response.type.empty()) add("Content-Type", response.type);
  if (!response.stream && response.status != 204 && response.status != 304)
    add("Content-Length", std::to_string(response.body.size()));
  if (std::none_of(response.fields.begin(), response.fields.end(),
                   [](const Field& f) { return equal_names(f.name, "Cache-Control"); }))
    add("Cache-Control", "no-store");
  add("X-Content-Type-Options", "nosniff");
  if (!allowed_origin_.empty()) {
    add("Access-Control-Allow-Origin", allowed_origin_);
    add("Access-Control-Expose-Headers", "ETag, Location, Link, Preference-Applied, Retry-After");
    add("Vary", "Origin");
  }
  if (!keep_ || response.stream) add("Connection", "close");
  return head + "\r\n";
}

void Connection::respond(Response response) {
  if (finished_) return;
  waiting_ = false;
  ++server_.counts.requests;
  if (response.status >= 400) ++server_.counts.refused;
  if (response.stream && request_ && request_->upgrade) {
    disarm();
    upgrade(server_, std::move(stream_), std::move(seat_), parser_->get(), std::move(response.stream));
    finished_ = true;
    server_.remove(this);
    return;
  }
  if (response.stream) {
    if (!head_) return begin_stream(std::move(response));
    response.type = "text/event-stream";
    keep_ = false;
  }
  out_ = head_of(response);
  if (!head_) out_ += response.body;
  arm(limits_.response);
  asio::async_write(stream_, asio::buffer(out_), [self = shared_from_this()](const ErrorCode& error, std::size_t) {
    if (error) return self->finish();
    std::string().swap(self->out_);
    self->keep_ ? self->read() : self->close_in_order();
  });
}

void Connection::begin_stream(Response response) {
  response.type = "text/event-stream";
  out_ = head_of(response);
  const auto wake = [gate = server_.gate, to = weak_from_this()] {
    gate->post([to] {
      if (const auto c = to.lock()) c->pump();
    });
  };
  channel_ = std::make_shared<Channel>(Channel::Kind::kEvents, limits_.queue_bytes, wake, server_.counts.dropped);
  ++server_.counts.streams;
  writing_ = true;
  arm(limits_.response);
  asio::async_write(stream_, asio::buffer(out_),
                    [self = shared_from_this(), opened = std::move(response.stream)](const ErrorCode& error, std::size_t) {
                      self->writing_ = false;
                      if (error) return self->finish();
                      self->watch();
                      try {
                        opened(self->channel_);
                      } catch (const std::exception&) {
                        return self->finish();
                      }
                      self->pump();
                    });
}

/// Notices the end of the client; what it sends is discarded.
void Connection::watch() {
  stream_.async_read_some(asio::buffer(scrap_), [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
    self->drained_ += n;
    if (error || self->drained_ > kMostDrained) return self->finish();
    self->watch();
  });
}

void Connection::pump() {
  if (finished_ || !channel_) return;
  const Channel::Wish wish = channel_->wish();
  if (wish == Channel::Wish::kAbort) return finish();  // also during a write that the client does not take
  if (writing_) return;
  if (wish == Channel::Wish::kCloseInOrder) return finish();
  if (!channel_->take(out_)) return arm(limits_.heartbeat);
  writing_ = true;
  arm(limits_.response);
  asio::async_write(stream_, asio::buffer(out_), [self = shared_from_this()](const ErrorCode& error, std::size_t) {
    self->writing_ = false;
    if (error) return self->finish();
    self->channel_->written();
    self->pump();
  });
}

/// Ends the connection so that the client receives what was written before: bytes of it that were not read would reset it.
void Connection::close_in_order() {
  if (finished_) return;
  arm(kDrain);
  if (!stream_.has_tls()) return end_of_sending();
  // It fails at once if the client is still sending.
  stream_.tls().async_shutdown(
      [self = shared_from_this()](const ErrorCode&) { self->late_ ? self->finish() : self->end_of_sending(); });
}

void Connection::end_of_sending() {
  ErrorCode none;
  stream_.next_layer().shutdown(tcp::socket::shutdown_send, none);
  drain();
}

void Connection::drain() {
  stream_.next_layer().async_read_some(asio::buffer(scrap_),
                                       [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
                                         self->drained_ += n;
                                         if (error || self->drained_ > kMostDrained) return self->finish();
                                         self->drain();
                                       });
}

void Connection::finish() {
  if (finished_) return;
  finished_ = true;
  if (turned_away_) --server_.refusing;
  const auto self = shared_from_this();
  disarm();
  ErrorCode none;
  stream_.next_layer().close(none);
  if (channel_) {
    channel_->end();
    --server_.counts.streams;
  }
  server_.remove(this);
}

}  // namespace

void serve(Server::Impl& server, tcp::socket socket, std::unique_ptr<Seat> seat, std::string party) {
  const auto connection = std::make_shared<Connection>(server, std::move(socket), std::move(seat), std::move(party));
  server.add(connection);
  connection->start();
}

void turn_away(Server::Impl& server, tcp::socket socket, Response refusal) {
  const auto connection = std::make_shared<Connection>(server, std::move(socket), nullptr, "");
  server.add(connection);
  connection->turn_away(std::move(refusal));
}

}  // namespace cotwin::gateway::http
