#pragma once
#include <array>
#include <boost/asio/io_context.hpp>
#include <boost/asio/steady_timer.hpp>
#include <boost/beast/http.hpp>
#include <chrono>
#include <filesystem>
#include <map>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "components/gateway/access/offences.h"
#include "components/gateway/http/any_stream.h"
#include "components/gateway/http/channel.h"
#include "components/gateway/http/fair_pool.h"
#include "components/gateway/http/server.h"

namespace cotwin::gateway::http {

/// The way of other threads to the server's one. Outlives the server.
class ServerLoop {
 public:
  explicit ServerLoop(asio::io_context& context) : context_(&context) {}
  /// Runs the function on the server's thread, unless the server has stopped.
  template <class Function>
  void post(Function function) {
    const std::lock_guard lock(mutex_);
    if (context_ != nullptr) asio::post(*context_, std::move(function));
  }
  void close() {
    const std::lock_guard lock(mutex_);
    context_ = nullptr;
  }

 private:
  std::mutex mutex_;
  asio::io_context* context_;
};

/// A connection. Lives until it removes itself from the server, and is used only on the server's thread.
class Client {
 public:
  virtual ~Client() = default;
  /// Closes the connection at once.
  virtual void abort() = 0;
  virtual const tcp::socket& socket() const = 0;

  /// It waits for the client: for a whole request, or until the client takes a response. At the bound it may be closed.
  bool idle() const { return idle_since.has_value(); }

  std::optional<access::Digest> bearer;  // the token of what it does at present, if it needs one
  std::string address;                   // where it counts; "": nowhere, because it only gets a refusal
  std::string holder;                    // for whom it counts: a token, a local user, an address; "": not asked yet
  std::optional<std::chrono::steady_clock::time_point> idle_since;
};

/// A client without a token, at the loopback address.
struct LocalUser {
  std::string name;
  Scopes scopes;
};

struct Server::Impl {
  Impl(ServerOptions given, const Router& table);
  void open();
  void start();
  void stop() noexcept;

  void add(const std::shared_ptr<Client>& client) { clients[client.get()] = client; }
  void remove(Client* client) { clients.erase(client); }
  /// Runs a handler: here, or on the pool, unless `given_up` by then. `reply` is called on any thread.
  void handle(const Router::Entry& entry, std::shared_ptr<Request> request, Reply reply, std::function<bool()> given_up);

  /// nullptr: the token is not valid now.
  const access::Bearer* find_bearer(const access::Digest& token) { return tokens.find(token, clock.now()); }
  /// Returns how long the answer to it waits.
  std::chrono::seconds note_wrong_token(const std::string& address);
  /// Why there is no place for one more that is not idle, if so: the last ones are kept for clients that have none.
  std::optional<Problem> deny_place(Client& client);
  /// Who is at the other end of this connection.
  LocalUser find_local_user(const tcp::socket& socket) const;

  ServerOptions options;
  const Router& router;
  Counts counts;
  std::size_t refusing = 0;  // connections that only get a refusal
  asio::io_context context{1};
  std::optional<asio::ssl::context> tls;  // of new connections
  access::Tokens tokens;
  ForwardClock clock;
  std::shared_ptr<ServerLoop> loop = std::make_shared<ServerLoop>(context);
  std::map<Client*, std::shared_ptr<Client>> clients;
  std::uint16_t port = 0;
  std::string name = "localhost";  // of url() where the address is 0.0.0.0 or ::

 private:
  struct Listener {
    explicit Listener(asio::io_context& c) : acceptor(c), pause(c) {}
    tcp::acceptor acceptor;
    asio::steady_timer pause;
  };
  /// A file that is read again when it was changed.
  class Watched {
   public:
    /// Before it is read for the first time.
    explicit Watched(std::filesystem::path file) : file_(std::move(file)), seen_(mark()), read_(seen_) {}
    /// Whether it is another one than when this said so last, and the same as at the last call: whoever writes it has ended.
    bool changed();

   private:
    std::array<std::int64_t, 7> mark() const;
    std::filesystem::path file_;
    std::array<std::int64_t, 7> seen_, read_;
  };
  void load_certificate();
  void look_at_files();
  void end_bearers();
  void look();
  bool listen(const std::string& address, bool must);
  void accept(Listener& listener);
  void admit(tcp::socket socket);
  const std::string& holder_of(Client& client) const;
  /// The places of an address, "": of all.
  std::size_t places(const std::string& address, bool idle_ones) const;
  bool make_room(const std::string& address);

  std::vector<std::unique_ptr<Listener>> listeners_;
  Watched token_file_, certificate_, key_;
  asio::steady_timer next_look_{context};
  access::Offences wrong_tokens_{1};
  FairPool pool_;
  std::thread thread_;
  bool stopped_ = false;
};

/// Begins to serve a connection (connection.cpp). `owner`: of requests without a token.
void serve(Server::Impl& server, tcp::socket socket, std::string address, std::string owner);
/// Sends a refusal and closes the connection, in order.
void refuse_connection(Server::Impl& server, tcp::socket socket, Response refusal);

/// Makes a WebSocket of a connection whose request was granted (web_socket.cpp).
void upgrade(Server::Impl& server, AnyStream stream, const Client& connection,
             const beast::http::request<beast::http::string_body>& request,
             std::function<void(const std::shared_ptr<Stream>&)> opened);

}  // namespace cotwin::gateway::http
