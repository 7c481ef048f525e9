// One HTTP connection: request after request, or a stream of server-sent events at last.
#include "components/gateway/http/connection.h"

#include "components/gateway/http/audited.h"

#include <algorithm>
#include <boost/asio/write.hpp>

namespace cotwin::gateway::http {

namespace {

constexpr std::size_t kRead = 4096, kLongestTarget = 4096;
constexpr std::uint64_t kBodyRead = 48 << 10;  // bytes of a body at a time
constexpr std::size_t kMostDrained = 1 << 20;  // bytes that are read after a refusal, so that the client sees it
constexpr double kDrain = 2;                   // s
constexpr unsigned char kTlsHandshake = 0x16;

std::string field_value(std::string value) {
  for (char& c : value) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return value;
}

}  // namespace

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
      asio::buffer(received_), [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
        if (error || n == 0) return self->finish();
        if (self->received_[0] != kTlsHandshake) {
          self->stream_.drop_tls();
          ++self->server_.counts.requests;
          self->keep_ = false;
          return self->respond(refusal(400, "this port expects TLS: https://"));
        }
        self->stream_.tls().async_handshake(
            asio::ssl::stream_base::server, asio::buffer(self->received_.data(), n),
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
  bearer.reset();
  wait_for_client();
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

void Connection::read_body() {
  if (request_->upgrade) {
    disarm();
    keep_ = false;
    return dispatch();
  }
  // Beast reads what the buffer has room for: long bodies in few calls, which all connections wait for.
  const std::uint64_t more = std::min<std::uint64_t>(parser_->content_length_remaining().value_or(0), kBodyRead);
  buffer_.reserve(std::min(buffer_.max_size(), buffer_.size() + static_cast<std::size_t>(more)));
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
  loop->post([to = connection, response = std::move(response)]() mutable {
    if (const auto c = to.lock()) c->respond(std::move(response));
  });
}

Connection::Pending::~Pending() { send(refusal(500, "the request was not answered")); }

void Connection::dispatch() {
  if (request_->bearer) holder = request_->owner;
  if (const auto problem = server_.deny_place(*this)) return refuse(to_response(*problem, {{"Retry-After", "1"}}));
  idle_since.reset();
  if (request_->owner.starts_with(kLocalOwner) && request_->body.size() > kLongBody)
    request_->owner = "long bodies of local programs";
  const auto pending = std::make_shared<Pending>();
  pending->loop = server_.loop;
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
  if (entry_ != nullptr && entry_->route.changes()) audit_refusal(*request_, response);
  if (late_answer_.count() == 0) return respond(std::move(response));
  disarm();
  timer_.expires_after(std::exchange(late_answer_, std::chrono::seconds(0)));
  timer_.async_wait([self = shared_from_this(), response = std::move(response)](const ErrorCode& error) mutable {
    if (!error) self->respond(std::move(response));
  });
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
    upgrade(server_, std::move(stream_), *this, parser_->get(), std::move(response.stream));
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
  wait_for_client();
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
  const auto wake = [loop = server_.loop, to = weak_from_this()] {
    loop->post([to] {
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
  stream_.async_read_some(asio::buffer(received_), [self = shared_from_this()](const ErrorCode& error, std::size_t n) {
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
  stream_.next_layer().async_read_some(asio::buffer(received_),
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

void serve(Server::Impl& server, tcp::socket socket, std::string address, std::string owner) {
  const auto connection = std::make_shared<Connection>(server, std::move(socket), std::move(address), std::move(owner));
  server.add(connection);
  connection->start();
}

void refuse_connection(Server::Impl& server, tcp::socket socket, Response refusal) {
  const auto connection = std::make_shared<Connection>(server, std::move(socket), "", "");
  server.add(connection);
  connection->refuse_connection(std::move(refusal));
}

}  // namespace cotwin::gateway::http
