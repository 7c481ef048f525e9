#pragma once
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "components/gateway/http/server_impl.h"

namespace cotwin::gateway::http {

namespace bhttp = beast::http;

inline constexpr const char* kLocalOwner =
    "connection ";  // and its number, of requests without a token at the loopback address

/// A response that only says what is wrong.
inline Response refusal(int status, std::string detail, std::vector<Field> fields = {}) {
  return to_response({status, std::move(detail), "", ""}, std::move(fields));
}

/// One HTTP connection. The checks of a request are in examination.cpp.
class Connection final : public Client, public std::enable_shared_from_this<Connection> {
 public:
  Connection(Server::Impl& server, tcp::socket socket, std::string from, std::string owner)
      : server_(server),
        owner_(std::move(owner)),
        limits_(server.options.limits),
        stream_(std::move(socket), server.tls ? &*server.tls : nullptr),
        timer_(server.context),
        buffer_(limits_.header_bytes + (64 << 10)) {
    address = std::move(from);
    wait_for_client();
    ++server_.counts.open;
  }
  ~Connection() override { --server_.counts.open; }

  void start() { server_.tls ? expect_tls() : read(); }
  /// Sends a refusal to a client for which there is no room.
  void refuse_connection(Response refusal) {
    turned_away_ = true;
    ++server_.refusing;
    respond(std::move(refusal));
  }
  void abort() override { finish(); }
  const tcp::socket& socket() const override { return stream_.next_layer(); }
  void respond(Response response);

 private:
  using Parser = bhttp::request_parser<bhttp::string_body>;

  /// A request that a handler answers. Carries the response to the server's thread, where alone connections live.
  struct Pending {
    std::shared_ptr<ServerLoop> loop;
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

  void wait_for_client() { idle_since = std::chrono::steady_clock::now(); }
  void expect_tls();
  void read();
  void read_header();
  void examine();
  void read_body();
  void dispatch();
  std::optional<Response> check_names(Request& request);
  std::optional<Response> check_route(Request& request);
  std::optional<Response> check_access(Request& request);
  std::optional<Response> check_local_user(Request& request);
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
  const std::string owner_;
  const Limits& limits_;
  AnyStream stream_;
  asio::steady_timer timer_;
  std::uint64_t armed_ = 0;
  bool late_ = false;
  beast::flat_buffer buffer_;
  std::optional<Parser> parser_;
  std::shared_ptr<Request> request_;
  const Router::Entry* entry_ = nullptr;
  std::optional<LocalUser> local_user_;  // asked once
  std::chrono::seconds late_answer_{0};  // until a refusal is sent
  std::string allowed_origin_;           // of the present request; "": none that must be named in the response
  std::string out_;
  std::weak_ptr<Pending> pending_;  // of the request that waits for its handler
  bool waiting_ = false;
  bool keep_ = false, head_ = false, finished_ = false, turned_away_ = false;
  std::array<unsigned char, 1024> received_{};
  std::size_t drained_ = 0;
  std::shared_ptr<Channel> channel_;
  bool writing_ = false;
};

}  // namespace cotwin::gateway::http
